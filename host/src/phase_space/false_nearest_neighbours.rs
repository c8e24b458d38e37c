//! Embedding dimension: false nearest neighbours (Kennel, Brown and Abarbanel 1992) and Cao's
//! measure (Cao 1997).
//!
//! With n(i, d) the nearest neighbour of vector i in dimension d (outside the Theiler window) and
//! R_d(i) its distance, it is false where |s(i + d T_d) − s(n(i, d) + d T_d)| > 15 R_d(i), or where
//! R_{d+1}(i) exceeds two standard deviations of the series (of an even spread over the circle or
//! the span: 0.577). A neighbour whose jump lies within the noise is not called false by the first
//! test: quantised counts would make all of them so. Cao: E1(d) = E(d + 1)/E(d), E(d) =
//! ⟨R_{d+1}(i)/R_d(i)⟩ with both distances to n(i, d); E1 stops changing at the embedding
//! dimension. E2(d) = E*(d + 1)/E*(d), E*(d) = ⟨|s(i + d T_d) − s(n + d T_d)|⟩, is 1 in all
//! dimensions for noise alone.
//!
//! Means and shares are over all vectors that have a neighbour; sums are made in fixed order.

use serde::Serialize;

use super::embedding::Embedding;
use super::neighbours::{NOBODY, Tree};
use super::observable::{Observable, distance};

/// Choices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Highest dimension. Default 10.
    pub dimensions: usize,
    /// Neighbours in time within so many samples do not count.
    pub theiler: u32,
    /// Ratio beyond which a neighbour is false. Default 15.
    pub ratio: f64,
    /// Second test: distance beyond which a neighbour is none, in units of the observable (turns or
    /// spans). Default 0.577: two standard deviations of an even spread over the circle.
    pub loneliness: f64,
    /// Jumps below this are noise, in units of the observable (turns or spans). Default 0.
    pub noise: f64,
    /// Most vectors. Default: all.
    pub most: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { dimensions: 10, theiler: 0, ratio: 15.0, loneliness: 0.577, noise: 0.0, most: usize::MAX }
    }
}

/// Shares and measures by dimension 1, 2, ….
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FalseNeighbours {
    /// Share of false neighbours.
    pub share: Vec<f64>,
    /// Cao's E1(d); one shorter.
    pub e1: Vec<f64>,
    /// Cao's E2(d); one shorter.
    pub e2: Vec<f64>,
    /// Vectors compared.
    pub vectors: usize,
    /// Theiler window, samples.
    pub theiler: u32,
}

/// Both measures at dimensions 1 … `settings.dimensions` with a delay in samples. Fewer dimensions
/// where the longest stretch holds no longer vectors.
pub fn false_nearest_neighbours(series: &Observable, delay: usize, settings: &Settings) -> FalseNeighbours {
    let delay = delay.max(1);
    let longest = series.stretches.iter().map(|r| r.len()).max().unwrap_or(0);
    let top = settings.dimensions.min(longest.saturating_sub(1) / delay);
    // The same vectors for all dimensions: each has the component that the highest is tested with.
    let e = Embedding::of_one(series, delay, top, delay, settings.most);
    let mut out =
        FalseNeighbours { share: vec![], e1: vec![], e2: vec![], vectors: e.len(), theiler: settings.theiler };
    let (mut growth, mut jump): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let index = Index::new(&e);
    let mut hints: Vec<Vec<u32>> = Vec::new();
    for d in 1..=top {
        let found = Tree::new(&e, d).nearest(settings.theiler, &hints);
        let (mut wrong, mut count, mut ratios, mut jumps) = (0u64, 0u64, 0.0, 0.0);
        for ((start, near), r2) in e.starts.iter().zip(&found.start).zip(&found.distance2) {
            if *near == NOBODY {
                continue;
            }
            let (i, k) = (*start as usize + d * delay, *near as usize + d * delay);
            let step = f64::from(distance(series.values[i], series.values[k], series.period));
            let r = f64::from(*r2).sqrt();
            let next = (r * r + step * step).sqrt();
            count += 1;
            wrong += u64::from((step > settings.ratio * r && step > settings.noise) || next > settings.loneliness);
            jumps += step;
            // Coinciding vectors have no ratio: they grow by the jump over what single precision
            // tells apart.
            ratios += next / r.max(6e-8);
        }
        let n = count.max(1) as f64;
        out.share.push(wrong as f64 / n);
        growth.push(ratios / n);
        jump.push(jumps / n);
        hints = vec![index.shifted(&found.start, delay), found.start];
    }
    let quotients = |v: &[f64]| v.windows(2).map(|w| if w[0] > 0.0 { w[1] / w[0] } else { 1.0 }).collect();
    (out.e1, out.e2) = (quotients(&growth), quotients(&jump));
    out
}

/// Where each start is among an embedding's.
struct Index<'a> {
    starts: &'a [u32],
    of: Vec<u32>,
}

impl<'a> Index<'a> {
    fn new(e: &'a Embedding<'a>) -> Self {
        let mut of = vec![NOBODY; e.starts.last().map_or(0, |t| *t as usize + 1)];
        (0..).zip(&e.starts).for_each(|(i, t)| of[*t as usize] = i);
        Self { starts: &e.starts, of }
    }

    fn of(&self, time: usize) -> Option<usize> {
        self.of.get(time).filter(|i| **i != NOBODY).map(|i| *i as usize)
    }

    /// What is near to the vector `by` samples later, as much earlier: a vector's last components
    /// are that one's first, so that it is likely to be near to this one too.
    fn shifted(&self, near: &[u32], by: usize) -> Vec<u32> {
        let of = |time: &u32| {
            let near = near[self.of(*time as usize + by)?];
            let start = if near == NOBODY { None } else { (near as usize).checked_sub(by) }?;
            self.of(start).map(|_| start as u32)
        };
        self.starts.iter().map(|t| of(t).unwrap_or(NOBODY)).collect()
    }
}

/// The first dimension with a share below `threshold`; none where all are above.
pub fn dimension(share: &[f64], threshold: f64) -> Option<usize> {
    share.iter().position(|s| *s < threshold).map(|i| i + 1)
}

/// The dimension from which on Cao's E1 stays within `tolerance` of its last value; none where it
/// has not settled two dimensions before the end.
pub fn cao_dimension(e1: &[f64], tolerance: f64) -> Option<usize> {
    let last = *e1.last()?;
    let settled = e1.iter().rposition(|e| (e - last).abs() > tolerance * last).map_or(0, |i| i + 1);
    (settled + 2 < e1.len()).then_some(settled + 1)
}

#[cfg(test)]
mod tests {
    use super::super::test_series::henon;
    use super::*;

    #[test]
    fn henon_needs_two_dimensions_and_noise_more_than_there_are() {
        let x = henon(4000);
        let s = Settings { dimensions: 6, ..Settings::default() };
        let found = false_nearest_neighbours(&Observable::number(&[&x[100..]], 0.0, 0), 1, &s);
        assert!(found.share[0] > 0.3 && found.share[1] < 0.01 && found.share[2] < 0.01, "{found:?}");
        assert_eq!(dimension(&found.share, 0.01), Some(2));
        let mut state = 9u64;
        let noise: Vec<f64> = (0..4000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f64
            })
            .collect();
        let found = false_nearest_neighbours(&Observable::number(&[&noise], 0.0, 0), 1, &s);
        assert!(found.share[..3].iter().all(|s| *s > 0.05) && dimension(&found.share, 0.01).is_none(), "{found:?}");
        assert!(found.e2.iter().all(|e| (e - 1.0).abs() < 0.1), "{found:?}");
    }

    #[test]
    fn a_whirling_angle_on_the_circle_needs_no_more_than_its_motion() {
        // A uniform whirl with a modulation: a torus, of dimension 2 and embedded in 2 angles;
        // unwrapped it would never return.
        let x: Vec<f64> = (0..20_000).map(|i| 0.11 * f64::from(i) + 0.9 * (f64::from(i) * 0.0371).sin()).collect();
        let s = Settings { dimensions: 5, theiler: 60, ..Settings::default() };
        let found = false_nearest_neighbours(&Observable::angle(&[&x], 0.0, 0), 20, &s);
        assert!(found.share[0] > 0.3 && found.share[3] < 0.01, "{found:?}");
    }

    #[test]
    fn definitions_by_hand() {
        // Vectors 0 … 3 of (0, 1, 0.1, 0.3, …): neighbours can be written down.
        let x = [0.0, 1.0, 0.1, 0.3, 0.9];
        let s = Settings { dimensions: 1, loneliness: 9.0, ratio: 2.0, ..Settings::default() };
        let found = false_nearest_neighbours(&Observable::number(&[&x], 0.0, 0), 1, &s);
        // 0 → 2 (0.1; jump 0.7: false), 1 → 3 (0.7; 0.8), 2 → 0 (false), 3 → 2 (0.2; 0.6: false).
        assert_eq!((found.vectors, found.share.clone()), (4, vec![0.75]));
        assert_eq!(cao_dimension(&[0.2, 0.5, 0.97, 0.98, 0.99, 1.0], 0.05), Some(3));
        assert_eq!(cao_dimension(&[0.2, 0.5, 0.6, 0.9], 0.05), None);
        let none = false_nearest_neighbours(&Observable::number(&[&[1.0]], 0.0, 0), 3, &s);
        assert!(none.share.is_empty() && none.vectors == 0);
    }
}

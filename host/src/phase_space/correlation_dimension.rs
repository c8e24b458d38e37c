//! Correlation dimension (Grassberger and Procaccia 1983): the slope of ln C(r) against ln r, C(r)
//! the share of pairs of vectors outside the Theiler window that are closer than r.
//!
//! Pairs: up to `references` vectors, evenly spread, with all others. Distances are Euclidean on
//! the circle; they are counted in bins of a quarter of an octave of r². The fit takes the
//! straightest long part of the curve between the radius below which there are too few pairs (or
//! noise) and C = 0.05, above which the attractor's size bends it. Standard error: jackknife over
//! blocks of references, and the spread of the slopes over the thirds of the fit, in squares.
//! Limits: a dimension D needs about 10^(D/2) vectors (Eckmann and Ruelle 1992):
//! [`CorrelationDimension::most`] states the largest that the record could show, 2 log₁₀ N.

use rayon::prelude::*;
use serde::Serialize;

use super::embedding::Embedding;
use super::observable::distance;

/// Blocks of the jackknife.
const BLOCKS: usize = 16;
/// Bits of a single-precision number dropped: two of the mantissa stay.
const SHIFT: u32 = 21;
/// Bins: exponents of distances from 2⁻³² to 2¹⁶ squared.
const BINS: usize = 4 * 96;
/// First bin's bits.
const FIRST: u32 = (127 - 64) << 2;

/// C(r) and its slope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CorrelationDimension {
    /// Radii, turns or spans.
    pub radius: Vec<f64>,
    /// Share of pairs closer than each.
    pub sum: Vec<f64>,
    /// The slope; none where no part is straight.
    pub dimension: Option<f64>,
    /// Its standard error.
    pub std_error: f64,
    /// Radii between which it was fitted.
    pub fitted: (f64, f64),
    /// Largest dimension that so many vectors could show.
    pub most: f64,
    /// Vectors.
    pub vectors: usize,
    /// Pairs.
    pub pairs: u64,
}

/// C(r) of the vectors of `e`. `noise`: radii below are not fitted.
pub fn correlation_dimension(e: &Embedding<'_>, theiler: u32, references: usize, noise: f64) -> CorrelationDimension {
    let n = e.len();
    let columns: Vec<Vec<f32>> =
        (0..e.components.len()).map(|j| e.starts.iter().map(|s| e.at(*s, j)).collect()).collect();
    let stride = n.div_ceil(references.max(1)).max(1);
    let chosen: Vec<usize> = (0..n).step_by(stride).collect();
    let blocks: Vec<Vec<u64>> = chosen
        .par_chunks(chosen.len().div_ceil(BLOCKS).max(1))
        .map(|block| {
            let mut counts = vec![0u64; BINS];
            let mut squares = vec![0.0f32; n];
            for i in block {
                squares.fill(0.0);
                for (column, component) in columns.iter().zip(&e.components) {
                    let (x, period) = (column[*i], component.of.period);
                    for (s, y) in squares.iter_mut().zip(column) {
                        let d = distance(x, *y, period);
                        *s += d * d;
                    }
                }
                let here = e.starts[*i];
                for (s, start) in squares.iter().zip(&e.starts) {
                    if start.abs_diff(here) > theiler {
                        let bin = (s.to_bits() >> SHIFT).saturating_sub(FIRST) as usize;
                        counts[bin.min(BINS - 1)] += 1;
                    }
                }
            }
            counts
        })
        .collect();
    let mut total = vec![0u64; BINS];
    for b in &blocks {
        total.iter_mut().zip(b).for_each(|(t, c)| *t += c);
    }
    let pairs: u64 = total.iter().sum();
    // Upper edge of each bin.
    let radii: Vec<f64> =
        (0..BINS as u32).map(|b| f64::from(f32::from_bits((FIRST + b + 1) << SHIFT)).sqrt()).collect();
    let sums = cumulative(&total);
    let share = |s: u64| s as f64 / pairs.max(1) as f64;
    let first = (0..BINS).find(|b| sums[*b] >= 300 && radii[*b] > noise).unwrap_or(BINS);
    let end = (0..BINS).find(|b| share(sums[*b]) > 0.05).unwrap_or(BINS);
    let x: Vec<f64> = radii.iter().map(|r| r.ln()).collect();
    let logs = |s: &[u64]| -> Vec<f64> { s.iter().map(|c| (*c as f64).max(0.5).ln()).collect() };
    let y = logs(&sums);
    let fitted = straightest(&x, &y, first, end);
    let (dimension, std_error, range) = match fitted {
        None => (None, 0.0, (0.0, 0.0)),
        Some((from, to)) => {
            let slope = |y: &[f64], a: usize, b: usize| line(&x[a..=b], &y[a..=b]).0;
            let m = blocks.len() as f64;
            let without: Vec<f64> = blocks
                .iter()
                .map(|b| {
                    let rest: Vec<u64> = total.iter().zip(b).map(|(t, c)| t - c).collect();
                    slope(&logs(&cumulative(&rest)), from, to)
                })
                .collect();
            let mean = without.iter().sum::<f64>() / m;
            let statistical = ((m - 1.0) / m * without.iter().map(|v| (v - mean).powi(2)).sum::<f64>()).sqrt();
            let third = (to - from) / 3;
            let parts = [0, 1, 2].map(|i| slope(&y, from + i * third, from + (i + 1) * third));
            let mean = parts.iter().sum::<f64>() / 3.0;
            let window = (parts.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 6.0).sqrt();
            (Some(slope(&y, from, to)), statistical.hypot(window), (radii[from], radii[to]))
        }
    };
    let shown = |b: &usize| sums[*b] > 0 && (*b == 0 || sums[b - 1] < pairs);
    CorrelationDimension {
        radius: (0..BINS).filter(shown).map(|b| radii[b]).collect(),
        sum: (0..BINS).filter(shown).map(|b| share(sums[b])).collect(),
        dimension,
        std_error,
        fitted: range,
        most: 2.0 * (n.max(1) as f64).log10(),
        vectors: n,
        pairs,
    }
}

fn cumulative(counts: &[u64]) -> Vec<u64> {
    counts
        .iter()
        .scan(0u64, |sum, c| {
            *sum += c;
            Some(*sum)
        })
        .collect()
}

/// Slope and rms deviation of y over x.
fn line(x: &[f64], y: &[f64]) -> (f64, f64) {
    let n = x.len().max(1) as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let (mut sxy, mut sxx) = (0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        sxy += (x - mx) * (y - my);
        sxx += (x - mx) * (x - mx);
    }
    let slope = if sxx > 0.0 { sxy / sxx } else { 0.0 };
    let squares: f64 = x.iter().zip(y).map(|(x, y)| (y - my - slope * (x - mx)).powi(2)).sum();
    (slope, (squares / n).sqrt())
}

/// The part of at least one octave and a half of r whose line is the longest that still describes
/// it.
fn straightest(x: &[f64], y: &[f64], first: usize, end: usize) -> Option<(usize, usize)> {
    const LEAST: usize = 12;
    let mut best: Option<(f64, usize, usize)> = None;
    for from in first..end.saturating_sub(LEAST) {
        for to in from + LEAST..end {
            let (slope, deviation) = line(&x[from..=to], &y[from..=to]);
            let score = slope * (x[to] - x[from]) / (deviation + 0.03);
            if best.is_none_or(|b| score > b.0) {
                best = Some((score, from, to));
            }
        }
    }
    best.map(|b| (b.1, b.2))
}

#[cfg(test)]
mod tests {
    use super::super::observable::Observable;
    use super::super::test_series::henon;
    use super::*;

    #[test]
    fn henon_1_22_and_a_circle_1_and_a_square_2() {
        let x = henon(10_100);
        let o = Observable::number(&[&x[100..]], 0.0, 0);
        let found = correlation_dimension(&Embedding::of_one(&o, 1, 2, 0, usize::MAX), 5, 2500, 0.0);
        let d = found.dimension.unwrap();
        // 1.21 ± 0.01 (Grassberger and Procaccia 1983), 1.220 (Sprott and Rowlands 2001).
        assert!(
            (d - 1.22).abs() < 0.04 && (d - 1.22).abs() < 4.0 * found.std_error && found.std_error < 0.05,
            "{d} {}",
            found.std_error
        );
        // A golden rotation fills the circle evenly; across ±π its neighbours must be found.
        let angle: Vec<f64> = (0..4000).map(|i| f64::from(i) * 2.399_963_229).collect();
        let o = Observable::angle(&[&angle], 0.0, 0);
        let found = correlation_dimension(&Embedding::of_one(&o, 1, 1, 0, usize::MAX), 0, 500, 2e-3);
        assert!((found.dimension.unwrap() - 1.0).abs() < 0.04, "{:?}", found.dimension);
        let two: Vec<f64> = (0..8000).map(|i| f64::from(i) * f64::from(i) * 0.777).collect();
        let o = Observable::angle(&[&two], 0.0, 0);
        let found = correlation_dimension(&Embedding::of_one(&o, 1, 2, 0, usize::MAX), 3, 500, 0.0);
        assert!((found.dimension.unwrap() - 2.0).abs() < 0.1, "{:?}", found.dimension);
    }

    #[test]
    fn counts_are_those_of_the_definition() {
        let x = [0.0, 0.5, 0.625, 1.0];
        let o = Observable::number(&[&x], 0.0, 0);
        let found = correlation_dimension(&Embedding::of_one(&o, 1, 1, 0, usize::MAX), 0, 100, 0.0);
        assert_eq!((found.pairs, found.vectors, found.dimension), (12, 4, None));
        let at = |r: f64| found.radius.iter().zip(&found.sum).rfind(|(x, _)| **x <= r).map_or(0.0, |(_, c)| *c);
        // Distances 0.125, 0.375, 0.5, 0.5, 0.625, 1, each twice.
        assert!((at(0.2) - 2.0 / 12.0).abs() < 1e-12 && (at(0.45) - 4.0 / 12.0).abs() < 1e-12, "{found:?}");
        assert_eq!(found.sum.last(), Some(&1.0));
        let none = correlation_dimension(&Embedding::of_one(&o, 9, 2, 0, 9), 0, 100, 0.0);
        assert!(none.pairs == 0 && none.radius.is_empty() && none.dimension.is_none());
    }
}

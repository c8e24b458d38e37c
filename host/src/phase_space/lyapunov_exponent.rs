//! Largest Lyapunov exponent from a record, by the divergence of nearest neighbours (Rosenstein,
//! Collins and De Luca 1993).
//!
//! S(k) = ⟨ln ‖S(n + k) − S(n′ + k)‖⟩ over the vectors n with their nearest neighbours n′ outside
//! the Theiler window; the exponent is the slope of S over the samples in which it rises in a
//! straight line, divided by the sampling step.
//!
//! **Fit window.** S leaves the first distance as the difference turns into the growing direction,
//! and it saturates at S_∞, the mean of ln of the distance of unrelated vectors. The window ends
//! where S comes within `ceiling` of S_∞ and starts after a settling time; within that the pair
//! (start, end) is taken whose straight line is the longest that still describes the curve: the
//! largest (rise of the line)/(rms deviation from it + a floor). Driven records are fitted over
//! whole drive periods, within which S ripples.
//!
//! **Uncertainty.** Standard error by the delete-one jackknife over blocks of time (neighbouring
//! samples of chaos are not independent), to which the spread of the slopes over the thirds of the
//! window is added in squares: the choice of the window is the larger error. The interval is ± 1.96
//! of the sum. Noise makes the first distance too large, and shortens the window; it does not
//! change the slope that is left.
//!
//! Limits: needs a drive or dynamics that return; a record of 20 periods has no window, and says so
//! by `None`.

use rayon::prelude::*;
use serde::Serialize;

use super::embedding::Embedding;
use super::neighbours::{NOBODY, Tree};
use super::observable::distance;

/// Blocks of the jackknife.
const BLOCKS: usize = 16;
/// Distances multiplied before a logarithm is taken: squares above 1e-18 to the 16th power stay
/// above 1e-288.
const PRODUCT: usize = 16;

/// Choices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Neighbours in time within so many samples do not count.
    pub theiler: u32,
    /// Steps followed, samples.
    pub steps: usize,
    /// Components that distances are followed in: the first so many (a drive's phase, which never
    /// diverges, comes last).
    pub followed: usize,
    /// Windows are whole multiples of this, samples: the drive's period, 1 where there is none.
    pub unit: f64,
    /// Samples after which the difference has turned into its growing direction.
    pub settle: usize,
    /// The window ends where S is so far below its saturation. Default 1.
    pub ceiling: f64,
}

/// S(k) and its parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Divergence {
    /// S(0), S(1), …: mean of the logarithm of the distance, ln of turns or spans.
    pub curve: Vec<f64>,
    /// The same in blocks of time.
    #[serde(skip)]
    pub blocks: Vec<Vec<f64>>,
    /// Its saturation S_∞.
    pub saturation: f64,
    /// Pairs followed.
    pub pairs: usize,
}

/// The straight part of S. Slopes are per sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StraightPart {
    /// Slope, 1/sample.
    pub slope: f64,
    /// Its standard error, jackknife and window together.
    pub std_error: f64,
    /// First sample of the window.
    pub from: usize,
    /// Last sample of the window.
    pub to: usize,
    /// Value of the line at step 0.
    pub at_zero: f64,
    /// Rise of S over the window, e-foldings.
    pub rise: f64,
    /// Rms deviation of S from the line.
    pub deviation: f64,
}

/// Follows all vectors of `e` (made with `ahead` ≥ `settings.steps`) and their neighbours.
pub fn divergence(e: &Embedding<'_>, settings: &Settings) -> Divergence {
    let near = Tree::new(e, e.components.len()).nearest(settings.theiler, &[]);
    let pairs: Vec<(u32, u32)> =
        e.starts.iter().zip(&near.start).filter(|(_, n)| **n != NOBODY).map(|(a, b)| (*a, *b)).collect();
    let followed = settings.followed.min(e.components.len());
    let size = pairs.len().div_ceil(BLOCKS).max(1);
    let blocks: Vec<Vec<f64>> =
        pairs.par_chunks(size).map(|b| followed_block(e, b, followed, settings.steps)).collect();
    let weights: Vec<f64> = pairs.chunks(size).map(|b| b.len() as f64).collect();
    let all: f64 = weights.iter().sum::<f64>().max(1.0);
    let curve =
        (0..settings.steps).map(|k| blocks.iter().zip(&weights).map(|(b, w)| b[k] * w).sum::<f64>() / all).collect();
    Divergence { curve, blocks, saturation: saturation(e, followed), pairs: pairs.len() }
}

/// Means over one block of pairs.
fn followed_block(e: &Embedding<'_>, pairs: &[(u32, u32)], followed: usize, steps: usize) -> Vec<f64> {
    let mut sums = vec![0.0; steps];
    let mut products = vec![1.0f64; steps];
    let mut squares = vec![0.0f32; steps];
    for (i, (a, b)) in pairs.iter().enumerate() {
        squares.fill(0.0);
        for c in &e.components[..followed] {
            let part = |t: u32| &c.of.values[t as usize + c.delay..][..steps];
            let period = c.of.period;
            for (s, (x, y)) in squares.iter_mut().zip(part(*a).iter().zip(part(*b))) {
                let d = distance(*x, *y, period);
                *s += d * d;
            }
        }
        for (p, s) in products.iter_mut().zip(&squares) {
            // Equal values differ by less than single precision tells.
            *p *= f64::from(*s).max(1e-18);
        }
        if (i + 1) % PRODUCT == 0 || i + 1 == pairs.len() {
            for (sum, p) in sums.iter_mut().zip(&mut products) {
                *sum += 0.5 * p.ln();
                *p = 1.0;
            }
        }
    }
    sums.iter_mut().for_each(|s| *s /= pairs.len().max(1) as f64);
    sums
}

/// Mean logarithm of the distance of unrelated vectors: each with one a fixed irrational share of
/// the record away.
fn saturation(e: &Embedding<'_>, followed: usize) -> f64 {
    let n = e.len();
    let (mut sum, mut count) = (0.0, 0usize);
    for i in (0..n).step_by((n / 5000).max(1)) {
        let other = (i + (0.381_966_011 * n as f64) as usize) % n;
        sum += 0.5 * f64::from(e.distance2(e.starts[i], e.starts[other], followed)).max(1e-18).ln();
        count += 1;
    }
    sum / count.max(1) as f64
}

/// Least squares of the values from … to (inclusive): slope, value at zero, rms deviation.
fn line(curve: &[f64], from: usize, to: usize) -> (f64, f64, f64) {
    let n = (to - from + 1) as f64;
    let middle = 0.5 * (from + to) as f64;
    let mean = curve[from..=to].iter().sum::<f64>() / n;
    let (mut sxy, mut sxx) = (0.0, 0.0);
    for k in from..=to {
        let x = k as f64 - middle;
        sxy += x * (curve[k] - mean);
        sxx += x * x;
    }
    let slope = if sxx > 0.0 { sxy / sxx } else { 0.0 };
    let squares: f64 = (from..=to).map(|k| (curve[k] - mean - slope * (k as f64 - middle)).powi(2)).sum();
    (slope, mean - slope * middle, (squares / n).sqrt())
}

/// The straight part of a divergence; none where S has no room to rise between settling and
/// saturation.
pub fn fit(divergence: &Divergence, settings: &Settings) -> Option<StraightPart> {
    let s = &divergence.curve;
    let end = s.iter().position(|v| *v > divergence.saturation - settings.ceiling).unwrap_or(s.len());
    let unit = settings.unit.max(1.0);
    // At least one drive period; at least four samples without a drive.
    let least = if unit > 1.0 { 1.0 } else { 3.0 };
    let room = end.checked_sub(settings.settle + 1)?;
    let most = (room as f64 / unit).floor();
    let mut best: Option<(f64, usize, usize)> = None;
    let shift = ((unit / 4.0).round() as usize).max(1);
    let mut length = least;
    while length <= most {
        let samples = (length * unit).round() as usize;
        for from in (settings.settle..=end - 1 - samples).step_by(shift) {
            let (slope, _, deviation) = line(s, from, from + samples);
            // 0.05 e-foldings: what statistics leave in a curve of some thousand pairs.
            let score = slope * samples as f64 / (deviation + 0.05);
            if best.is_none_or(|b| score > b.0) {
                best = Some((score, from, from + samples));
            }
        }
        length += if unit > 1.0 { 1.0 } else { (most / 40.0).ceil() };
    }
    let (_, from, to) = best?;
    let (slope, at_zero, deviation) = line(s, from, to);
    let statistical = jackknife(divergence, from, to);
    // Slopes over the thirds of the window.
    let third = (to - from) / 3;
    let window = if third >= 2 {
        let slopes = [0, 1, 2].map(|i| line(s, from + i * third, from + (i + 1) * third).0);
        let mean = slopes.iter().sum::<f64>() / 3.0;
        (slopes.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 6.0).sqrt()
    } else {
        0.0
    };
    let std_error = statistical.hypot(window);
    Some(StraightPart { slope, std_error, from, to, at_zero, rise: slope * (to - from) as f64, deviation })
}

/// Standard error of the slope over a window by leaving out one block at a time.
fn jackknife(divergence: &Divergence, from: usize, to: usize) -> f64 {
    let slopes: Vec<f64> = divergence.blocks.iter().map(|b| line(b, from, to).0).collect();
    // A line's slope is linear in the curve: leaving one of m equal blocks out is the mean of the
    // others.
    let m = slopes.len() as f64;
    if m < 2.0 {
        return 0.0;
    }
    let mean = slopes.iter().sum::<f64>() / m;
    (slopes.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (m * (m - 1.0))).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::observable::Observable;
    use super::super::test_series::{henon, lorenz};
    use super::*;

    fn exponent(x: &[f64], delay: usize, dimension: usize, settings: &Settings) -> StraightPart {
        let o = Observable::number(&[x], 0.0, 0);
        let e = Embedding::of_one(&o, delay, dimension, settings.steps, usize::MAX);
        let d = divergence(&e, settings);
        fit(&d, settings).unwrap()
    }

    #[test]
    fn henon_0_419_a_step() {
        let x = henon(6000);
        let s = Settings { theiler: 5, steps: 25, followed: 2, unit: 1.0, settle: 1, ceiling: 1.0 };
        let fit = exponent(&x[100..], 1, 2, &s);
        assert!((fit.slope - 0.419).abs() < 0.03, "{fit:?}");
        assert!((fit.slope - 0.419).abs() < 3.0 * fit.std_error + 0.005 && fit.std_error < 0.03, "{fit:?}");
    }

    #[test]
    fn lorenz_0_906_a_second() {
        let [x, ..] = lorenz(22_000, 1);
        let series: Vec<f64> = x.into_iter().skip(2).step_by(2).collect();
        let s = Settings { theiler: 50, steps: 400, followed: 3, unit: 1.0, settle: 40, ceiling: 1.0 };
        let fit = exponent(&series, 8, 3, &s);
        let slope = fit.slope / 0.02;
        assert!((slope - 0.906).abs() < 0.06, "{slope} {fit:?}");
        assert!((slope - 0.906).abs() < 3.0 * fit.std_error / 0.02 + 0.02, "{fit:?}");
    }

    #[test]
    fn a_sine_does_not_diverge() {
        let x: Vec<f64> = (0..6000).map(|i| (f64::from(i) * 0.1).sin() + 0.3 * (f64::from(i) * 0.1618).cos()).collect();
        let o = Observable::number(&[&x], 0.0, 0);
        let s = Settings { theiler: 60, steps: 300, followed: 4, unit: 1.0, settle: 20, ceiling: 1.0 };
        let d = divergence(&Embedding::of_one(&o, 15, 4, 300, usize::MAX), &s);
        let slope = fit(&d, &s).map_or(0.0, |f| f.slope);
        assert!(slope.abs() < 2e-3, "{slope}");
    }
}

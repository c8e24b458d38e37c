//! A periodic release described by its frequency and harmonics, from displacements alone.
//!
//! x(t) = Σ_k C_k cos k(ωt) + S_k sin k(ωt), k = 0 … K, all channels with one ω. For a given ω the
//! harmonics are linear least squares; ω follows by Gauss–Newton on what is left (variable
//! projection, L. Kaufman, *BIT* 15, 1975): δω = Σ d⊥·r/Σ d⊥², d = ∂x/∂ω with its part in the
//! harmonics taken out. Afterwards time is shifted so that the major coordinate is at its greatest
//! first harmonic at phase 0: then S_k = 0 for a motion on a mode (which passes through rest), and
//! the even harmonics are 0 where that mode is symmetric.
//!
//! Frequencies in rad per unit of time. Standard error of ω from the residual, with its correlation
//! taken as lasting one period.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Highest harmonic looked for.
const MOST_HARMONICS: usize = 15;
/// Most samples in a release: a fit holds some thirty numbers for each.
pub const MOST_SAMPLES: usize = 1 << 18;
/// Least number of periods in a record for a fit.
pub const LEAST_PERIODS: f64 = 3.0;

/// A fitted release. Shapes are `[k][channel]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ReleaseFit {
    /// Angular frequency.
    pub omega: f64,
    /// Its standard error.
    pub omega_error: f64,
    /// Phase at the first sample, rad.
    pub phase: f64,
    /// Cosine coefficients, k = 0 … K.
    pub cosine: Vec<Vec<f64>>,
    /// Sine coefficients, k = 0 … K (`sine[0]` is 0).
    pub sine: Vec<Vec<f64>>,
    /// Rms of what is left over rms of the motion, all channels.
    pub residual: f64,
    /// The same in the first and in the last third of the record, each refitted alone: growth tells
    /// an unstable mode.
    pub residual_thirds: [f64; 2],
    /// Periods in the record.
    pub periods: f64,
    /// Standard error of a harmonic's coefficients, one a channel.
    pub spread: Vec<f64>,
    /// Time of the middle of what was fitted, from the release's first sample.
    pub middle: f64,
}

impl ReleaseFit {
    /// Share of even harmonics (k ≥ 2 and the mean excepted) in amplitude.
    pub fn even_share(&self) -> f64 {
        let size = |even: bool| -> f64 {
            let of = |v: &[Vec<f64>]| -> f64 {
                v.iter()
                    .enumerate()
                    .filter(|(k, _)| *k > 0 && (k % 2 == 0) == even)
                    .flat_map(|(_, c)| c.iter().map(|x| x * x))
                    .sum()
            };
            of(&self.cosine) + of(&self.sine)
        };
        let (even, odd) = (size(true), size(false));
        if odd > 0.0 { (even / odd).sqrt() } else { 0.0 }
    }

    /// Share of the sine parts: motion that does not pass through rest, as on a mode it would.
    pub fn sine_share(&self) -> f64 {
        let of = |v: &[Vec<f64>]| -> f64 { v.iter().skip(1).flatten().map(|x| x * x).sum() };
        let (c, s) = (of(&self.cosine), of(&self.sine));
        if c > 0.0 { (s / c).sqrt() } else { 0.0 }
    }

    /// Displacement, velocity and acceleration of a channel at phase φ.
    pub fn motion(&self, channel: usize, phi: f64) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (k, (c, s)) in self.cosine.iter().zip(&self.sine).enumerate() {
            let (sin, cos) = (k as f64 * phi).sin_cos();
            let w = k as f64 * self.omega;
            out[0] += c[channel] * cos + s[channel] * sin;
            out[1] += w * (s[channel] * cos - c[channel] * sin);
            out[2] -= w * w * (c[channel] * cos + s[channel] * sin);
        }
        out
    }
}

/// Design matrix: 1, cos φ, sin φ, cos 2φ, … at the given phases.
fn design(phase: impl Fn(usize) -> f64, m: usize, harmonics: usize) -> DMatrix<f64> {
    let mut c = DMatrix::zeros(m, 2 * harmonics + 1);
    for i in 0..m {
        let (s1, c1) = phase(i).sin_cos();
        let (mut s, mut co) = (0.0, 1.0);
        c[(i, 0)] = 1.0;
        for k in 1..=harmonics {
            (s, co) = (s * c1 + co * s1, co * c1 - s * s1);
            c[(i, 2 * k - 1)] = co;
            c[(i, 2 * k)] = s;
        }
    }
    c
}

/// Harmonics for a given ω and what they leave: (coefficients, residual, the factorised design).
fn project(x: &DMatrix<f64>, c: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let normal = (c.transpose() * c).cholesky()?;
    let coefficients = normal.solve(&(c.transpose() * x));
    let residual = x - c * &coefficients;
    Some((coefficients, residual))
}

/// ω and harmonics by Gauss–Newton from a start; time is counted from the middle, where ω and phase
/// separate.
fn refine(
    x: &DMatrix<f64>,
    step: f64,
    mut omega: f64,
    harmonics: usize,
) -> Option<(f64, DMatrix<f64>, DMatrix<f64>, f64)> {
    let m = x.nrows();
    let time = |i: usize| (i as f64 - 0.5 * (m - 1) as f64) * step;
    let mut best: Option<(f64, DMatrix<f64>, DMatrix<f64>, f64)> = None;
    for _ in 0..40 {
        let c = design(|i| omega * time(i), m, harmonics);
        let (coefficients, residual) = project(x, &c)?;
        let mut slope = DMatrix::zeros(m, x.ncols());
        let mut turned = DMatrix::zeros(coefficients.nrows(), x.ncols());
        for k in 1..=harmonics {
            for j in 0..x.ncols() {
                // d/dφ of c cos kφ + s sin kφ.
                turned[(2 * k - 1, j)] = k as f64 * coefficients[(2 * k, j)];
                turned[(2 * k, j)] = -(k as f64) * coefficients[(2 * k - 1, j)];
            }
        }
        let moved = &c * turned;
        for i in 0..m {
            for j in 0..x.ncols() {
                slope[(i, j)] = time(i) * moved[(i, j)];
            }
        }
        let (_, slope) = project(&slope, &c)?;
        let weight = slope.norm_squared();
        let delta = slope.dot(&residual) / weight;
        let sum = residual.norm_squared();
        let converged = !delta.is_finite() || delta.abs() < 1e-13 * omega;
        best = Some((omega, coefficients, residual, weight));
        if converged || sum == 0.0 {
            break;
        }
        // A step of more than a fifth of a turn over the record would jump to another lobe.
        let limit = 0.2 * TAU / (m as f64 * step);
        omega += delta.clamp(-limit, limit);
        if omega <= 0.0 {
            return None;
        }
    }
    best
}

/// Angular frequency at which the channels' spectra have their common peak: by a scan of single
/// sines around the zero crossings' rate.
fn start(x: &DMatrix<f64>, step: f64, major: &[f64]) -> Option<f64> {
    let m = x.nrows();
    let y: Vec<f64> = (0..m).map(|i| major.iter().enumerate().map(|(j, p)| p * x[(i, j)]).sum()).collect();
    let mean = y.iter().sum::<f64>() / m as f64;
    let size = y.iter().fold(0.0_f64, |s, v| s.max((v - mean).abs()));
    // Zero crossings with a dead zone, so that noise makes none.
    let (mut crossings, mut first, mut last, mut side) = (0usize, 0.0, 0.0, 0.0);
    for (i, v) in y.iter().enumerate() {
        let v = v - mean;
        if v.abs() > 0.2 * size {
            let now = v.signum();
            if side != 0.0 && now != side {
                crossings += 1;
                if crossings == 1 {
                    first = i as f64;
                }
                last = i as f64;
            }
            side = now;
        }
    }
    if crossings < 4 {
        return None;
    }
    let rough = std::f64::consts::PI * (crossings - 1) as f64 / ((last - first) * step);
    let length = m as f64 * step;
    let mut best = (0.0, rough);
    for n in -40..=40 {
        let omega = rough + f64::from(n) * 0.1 * TAU / length;
        if omega <= 0.0 {
            continue;
        }
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in y.iter().enumerate() {
            let hann = 1.0 - (TAU * (i as f64 + 0.5) / m as f64).cos();
            let (s, c) = (omega * i as f64 * step).sin_cos();
            re += hann * (v - mean) * c;
            im += hann * (v - mean) * s;
        }
        if re.hypot(im) > best.0 {
            best = (re.hypot(im), omega);
        }
    }
    Some(best.1)
}

/// Fits one release: one slice for each channel, `step` apart; `major` weighs the channels into the
/// coordinate that sets the phase.
///
/// None where the record holds fewer than [`LEAST_PERIODS`] periods or more than [`MOST_SAMPLES`]
/// samples, or does not swing.
pub fn fit(channels: &[&[f64]], step: f64, major: &[f64]) -> Option<ReleaseFit> {
    let n = channels.len();
    let m = channels.iter().map(|c| c.len()).min()?;
    if !(16..=MOST_SAMPLES).contains(&m) || n == 0 || major.len() != n {
        return None;
    }
    let x = DMatrix::from_fn(m, n, |i, j| channels[j][i]);
    let omega = start(&x, step, major)?;
    let periods = omega * m as f64 * step / TAU;
    // At most two harmonics for three samples of a period.
    let most = ((TAU / (omega * step) / 2.2) as usize).min(MOST_HARMONICS).min(m / 6);
    if periods < LEAST_PERIODS || most < 1 {
        return None;
    }
    let mut chosen = refine(&x, step, omega, 1)?;
    let mut harmonics = 1;
    let mut sum = chosen.2.norm_squared();
    // Pairs of harmonics are added as long as they take away more than noise would (Schwarz's
    // criterion).
    for k in (3..=most).step_by(2) {
        let next = refine(&x, step, chosen.0, k)?;
        let left = next.2.norm_squared();
        let gain = (m * n) as f64 * (sum / left.max(1e-300)).ln();
        if gain < 4.0 * n as f64 * ((m * n) as f64).ln() {
            break;
        }
        (chosen, harmonics, sum) = (next, k, left);
    }
    let (omega, coefficients, residual, weight) = chosen;
    let mut cosine: Vec<Vec<f64>> = vec![coefficients.row(0).iter().copied().collect()];
    let mut sine = vec![vec![0.0; n]];
    for k in 1..=harmonics {
        cosine.push(coefficients.row(2 * k - 1).iter().copied().collect());
        sine.push(coefficients.row(2 * k).iter().copied().collect());
    }
    let (lag, motion) = in_phase(&mut cosine, &mut sine, major);
    let rms = (sum / m as f64).sqrt();
    // A residual that stays correlated over a period carries one independent number a period and
    // channel.
    let lasting = (TAU / (omega * step)).max(1.0);
    let lasting = correlation_factor(&residual, lasting);
    let omega_error = (sum / (m * n) as f64 * lasting / weight).sqrt();
    // A harmonic's coefficient is a mean of 2 x cos kφ.
    let spread = residual.column_iter().map(|r| (2.0 * r.norm_squared() * lasting).sqrt() / m as f64).collect();
    let third = |from: usize| -> f64 {
        let part = x.rows(from, m / 3).into_owned();
        let c = design(|i| omega * i as f64 * step, m / 3, harmonics);
        project(&part, &c).map_or(0.0, |(_, r)| (r.norm_squared() / (m / 3) as f64).sqrt() / motion.max(1e-300))
    };
    let ends = [third(0), third(m - m / 3)];
    Some(ReleaseFit {
        omega,
        omega_error,
        phase: -omega * 0.5 * (m - 1) as f64 * step - lag,
        cosine,
        sine,
        residual: rms / motion.max(1e-300),
        residual_thirds: ends,
        periods,
        spread,
        middle: 0.5 * (m - 1) as f64 * step,
    })
}

/// Turns harmonics (their mean first) so that the first along `major` is a cosine; the angle by
/// which they lagged, and the motion's rms.
pub(super) fn in_phase(cosine: &mut [Vec<f64>], sine: &mut [Vec<f64>], major: &[f64]) -> (f64, f64) {
    let dot = |v: &[f64]| -> f64 { v.iter().zip(major).map(|(a, b)| a * b).sum() };
    let lag = dot(&sine[1]).atan2(dot(&cosine[1]));
    for (k, (cosine, sine)) in cosine.iter_mut().zip(sine.iter_mut()).enumerate().skip(1) {
        let (s, c) = (k as f64 * lag).sin_cos();
        for (x, y) in cosine.iter_mut().zip(sine) {
            let (a, b) = (*x, *y);
            (*x, *y) = (a * c + b * s, b * c - a * s);
        }
    }
    let motion = cosine.iter().chain(&*sine).skip(1).flatten().map(|v| 0.5 * v * v).sum::<f64>().sqrt();
    (lag, motion)
}

/// How many samples carry one independent number: 1 + 2 Σ ρ_k over one period, at least 1.
fn correlation_factor(residual: &DMatrix<f64>, period: f64) -> f64 {
    let (m, n) = residual.shape();
    let lags = (period.ceil() as usize).min(m / 4);
    let power = residual.norm_squared();
    if power <= 0.0 {
        return 1.0;
    }
    let mut sum = 1.0;
    for lag in 1..lags {
        let rho: f64 =
            (0..n).map(|j| (lag..m).map(|i| residual[(i, j)] * residual[(i - lag, j)]).sum::<f64>()).sum::<f64>()
                / power;
        sum += 2.0 * rho.abs() * (1.0 - lag as f64 / lags as f64);
    }
    sum.max(1.0)
}

/// Least squares with relative weights; (coefficients, standard errors). None where columns depend
/// on each other.
pub fn least_squares(a: &DMatrix<f64>, b: &DVector<f64>) -> Option<(DVector<f64>, DVector<f64>)> {
    let n = a.ncols();
    let scale: Vec<f64> = (0..n).map(|j| a.column(j).norm()).collect();
    if scale.iter().any(|s| *s <= 0.0 || !s.is_finite()) || a.nrows() < n {
        return None;
    }
    let mut scaled = a.clone();
    for j in 0..n {
        scaled.column_mut(j).scale_mut(1.0 / scale[j]);
    }
    let svd = scaled.clone().svd(true, true);
    let first = svd.singular_values.max();
    if svd.singular_values.min() < 1e-12 * first {
        return None;
    }
    let x = svd.solve(b, 0.0).ok()?;
    let residual = b - &scaled * &x;
    let variance = residual.norm_squared() / (a.nrows() - n).max(1) as f64;
    let vt = svd.v_t?;
    let error = DVector::from_fn(n, |j, _| {
        let sum: f64 = (0..n).map(|k| (vt[(k, j)] / svd.singular_values[k]).powi(2)).sum();
        (variance * sum).sqrt() / scale[j]
    });
    Some((DVector::from_fn(n, |j, _| x[j] / scale[j]), error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequency_and_harmonics_come_back() {
        let (omega, step) = (1.2345, 0.11);
        let x = |i: usize, c: f64| {
            let p = omega * i as f64 * step - 0.4;
            c * p.cos() + 0.1 * (3.0 * p).cos() - 0.02 * c * (5.0 * p).cos()
        };
        let a: Vec<f64> = (0..1200).map(|i| x(i, 1.0)).collect();
        let b: Vec<f64> = (0..1200).map(|i| x(i, -0.5)).collect();
        let fit = fit(&[&a, &b], step, &[1.0, 0.0]).unwrap();
        assert!((fit.omega / omega - 1.0).abs() < 1e-10, "{}", fit.omega);
        assert!((fit.cosine[3][1] - 0.1).abs() < 1e-8 && (fit.cosine[5][0] + 0.02).abs() < 1e-8, "{fit:?}");
        assert!(fit.sine_share() < 1e-8 && fit.even_share() < 1e-8 && fit.residual < 1e-8);
        let at_start = fit.motion(0, fit.phase);
        assert!((at_start[0] - a[0]).abs() < 1e-7);
    }

    #[test]
    fn what_does_not_swing_is_not_fitted() {
        let ramp: Vec<f64> = (0..500).map(f64::from).collect();
        assert!(fit(&[&ramp], 0.1, &[1.0]).is_none());
        assert!(fit(&[&ramp[..5]], 0.1, &[1.0]).is_none());
        let endless: Vec<f64> = (0..=MOST_SAMPLES).map(|i| (i as f64 * 0.1).sin()).collect();
        assert!(fit(&[&endless], 0.1, &[1.0]).is_none());
        assert!(fit(&[&[0.0; 100]], 0.1, &[1.0]).is_none());
    }
}

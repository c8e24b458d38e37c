//! A decaying release: frequency and harmonics at every amplitude that it passes, from
//! displacements alone.
//!
//! Sliding windows of six periods, half overlapping. In each, u from −1 to 1 about its middle, x =
//! X_0 + Σ_k (C_k0 + C_k1 u + C_k2 u²) cos kψ + S_k sin kψ, ψ = ψ0 + Ψ_1 u + Ψ_2 u² + Ψ_3 u³. C and
//! S are linear least squares; ψ0 is such that the major coordinate's S_1 is 0 (the change of
//! amplitude goes with cos ψ); Ψ follows by Gauss–Newton on what is left (variable projection). The
//! window stands for its middle: X_k = C_k0, ω = Ψ_1 over half the window's length.
//!
//! Two things would be wrong with less. With amplitude and frequency linear in u, a decay by a
//! fifth over the window moves the middle's frequency by 0.35 % of its distance to the linear one,
//! because the phase's third derivative leaks into its first. And a release that is a little off
//! the mode lets other modes ring, which decay no faster: all samples weighing alike, their side
//! lobes fall into the harmonics at a hundredth of their size; with the weights cos²(πu/2) at less
//! than a thousandth. With light damping ζ the frequency found is the free one's up to ζ²/2.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::{FRAC_PI_2, TAU};

use super::release_fit::{self, ReleaseFit, in_phase};

/// Periods in a window.
const PERIODS: f64 = 6.0;
/// Harmonics in a window.
const HARMONICS: usize = 7;
/// Degree of the amplitudes over a window; the phase has one more.
const DEGREE: usize = 2;

/// Fits the windows of a decay: `omega` its mean frequency, from which that at its beginning may be
/// far, `major` as in [`super::release_fit::fit`].
pub fn windows(channels: &[&[f64]], step: f64, omega: f64, major: &[f64]) -> Vec<ReleaseFit> {
    let m = channels.iter().map(|c| c.len()).min().unwrap_or(0);
    let mut out = Vec::new();
    let beginning = ((PERIODS * TAU / omega / step).round() as usize).min(m);
    let first: Vec<&[f64]> = channels.iter().map(|c| &c[..beginning]).collect();
    let mut guess = release_fit::fit(&first, step, major).map_or(omega, |f| f.omega);
    let mut from = 0;
    loop {
        let length = (PERIODS * TAU / guess / step).round() as usize;
        if length < 24 || from + length > m {
            return out;
        }
        let part: Vec<&[f64]> = channels.iter().map(|c| &c[from..from + length]).collect();
        let Some(mut fit) = window(&part, step, guess, major) else { return out };
        fit.middle += from as f64 * step;
        guess = fit.omega;
        out.push(fit);
        from += length / 2;
    }
}

/// Row of C_kj, or with `j` = [`DEGREE`] + 1 of S_k.
fn row_of(k: usize, j: usize) -> usize {
    1 + (k - 1) * (DEGREE + 2) + j
}

/// A window after one round of Gauss–Newton.
struct Fitted {
    /// ψ0, Ψ_1, …
    phase: [f64; DEGREE + 2],
    /// Rows as in [`row_of`].
    coefficients: DMatrix<f64>,
    /// Weighted sum of squares left, by channel.
    left: Vec<f64>,
    /// Variance of C_10 for a unit variance of a sample.
    of_cosine: f64,
    /// Variance of Ψ_1 for a unit variance of a sample.
    spread: f64,
}

fn window(channels: &[&[f64]], step: f64, start: f64, major: &[f64]) -> Option<ReleaseFit> {
    let (m, n) = (channels[0].len(), channels.len());
    let half = 0.5 * m as f64 * step;
    let at = |i: usize| (2.0 * i as f64 + 1.0) / m as f64 - 1.0;
    // Square roots of the weights.
    let root: Vec<f64> = (0..m).map(|i| (FRAC_PI_2 * at(i)).cos()).collect();
    let x = DMatrix::from_fn(m, n, |i, j| root[i] * channels[j][i]);
    let harmonics = HARMONICS.min((TAU / (start * step) / 2.2) as usize).max(1);
    let mut phase = [0.0; DEGREE + 2];
    phase[1] = start * half;
    let dot = |v: &[f64]| -> f64 { v.iter().zip(major).map(|(a, b)| a * b).sum() };
    let mut last: Option<Fitted> = None;
    for _ in 0..30 {
        let mut a = DMatrix::zeros(m, row_of(harmonics + 1, 0));
        for i in 0..m {
            let u = at(i);
            let psi = phase.iter().rev().fold(0.0, |p, c| p * u + c);
            a[(i, 0)] = root[i];
            for k in 1..=harmonics {
                let (s, c) = (k as f64 * psi).sin_cos();
                for j in 0..=DEGREE {
                    a[(i, row_of(k, j))] = root[i] * c * u.powi(j as i32);
                }
                a[(i, row_of(k, DEGREE + 1))] = root[i] * s;
            }
        }
        let turned = a.transpose();
        let normal = (&turned * &a).cholesky()?;
        let coefficients = normal.solve(&(&turned * &x));
        let residual = &x - &a * &coefficients;
        let step = phase_step(&a, &coefficients, &residual, |s| s - &a * normal.solve(&(&turned * s)), &root, at)?;
        let row = |r: usize| -> Vec<f64> { coefficients.row(r).iter().copied().collect() };
        let lag = dot(&row(row_of(1, DEGREE + 1))).atan2(dot(&row(row_of(1, 0))));
        // The sandwich for C_10, as for the phase in [`phase_step`].
        let row = normal.solve(&DMatrix::from_fn(a.ncols(), 1, |i, _| f64::from(i == row_of(1, 0))));
        let of_sample = &a * row;
        let of_cosine = (0..m).map(|i| (root[i] * of_sample[i]).powi(2)).sum();
        let left = residual.column_iter().map(|r| r.norm_squared()).collect();
        last = Some(Fitted { phase, coefficients, left, of_cosine, spread: step.1 });
        for (p, d) in phase[1..].iter_mut().zip(step.0.iter()) {
            *p += d.clamp(-0.3, 0.3);
        }
        // The amplitude's change goes with cos ψ alone, so the phase must be the motion's own.
        phase[0] -= lag;
        if step.0.amax() < 1e-12 * phase[1].abs() && lag.abs() < 1e-9 {
            break;
        }
    }
    let fitted = last?;
    let row = |r: usize| -> Vec<f64> { fitted.coefficients.row(r).iter().copied().collect() };
    let (mut cosine, mut sine) = (vec![row(0)], vec![vec![0.0; n]]);
    for k in 1..=harmonics {
        cosine.push(row(row_of(k, 0)));
        sine.push(row(row_of(k, DEGREE + 1)));
    }
    let (lag, motion) = in_phase(&mut cosine, &mut sine, major);
    let weight: f64 = root.iter().map(|r| r * r).sum();
    let left: f64 = fitted.left.iter().sum();
    let residual = (left / weight).sqrt() / motion.max(1e-300);
    let omega = fitted.phase[1] / half;
    Some(ReleaseFit {
        omega,
        omega_error: (left / (weight * n as f64) * fitted.spread).sqrt() / half,
        // At the window's first sample, u = −1.
        phase: fitted.phase.iter().rev().fold(0.0, |p, c| c - p) - lag,
        cosine,
        sine,
        residual,
        residual_thirds: [residual; 2],
        periods: omega * m as f64 * step / TAU,
        spread: fitted.left.iter().map(|l| (l / weight * fitted.of_cosine).sqrt()).collect(),
        middle: half,
    })
}

/// Gauss–Newton's step of Ψ_1, Ψ_2, Ψ_3, and the variance of Ψ_1 for a unit variance of a sample.
/// `project` takes out what the harmonics hold.
fn phase_step(
    a: &DMatrix<f64>,
    coefficients: &DMatrix<f64>,
    residual: &DMatrix<f64>,
    project: impl Fn(&DMatrix<f64>) -> DMatrix<f64>,
    root: &[f64],
    at: impl Fn(usize) -> f64,
) -> Option<(DVector<f64>, f64)> {
    let (m, n) = residual.shape();
    // ∂x/∂ψ of C_k(u) cos kψ + S_k sin kψ, times the weight's root.
    let harmonics = (coefficients.nrows() - 1) / (DEGREE + 2);
    let mut slope = DMatrix::zeros(m, n);
    for i in 0..m {
        let u = at(i);
        for k in 1..=harmonics {
            let (c, s) = (a[(i, row_of(k, 0))], a[(i, row_of(k, DEGREE + 1))]);
            for j in 0..n {
                let cosine = (0..=DEGREE).rev().fold(0.0, |p, d| p * u + coefficients[(row_of(k, d), j)]);
                slope[(i, j)] += k as f64 * (coefficients[(row_of(k, DEGREE + 1), j)] * c - cosine * s);
            }
        }
    }
    let free: Vec<DMatrix<f64>> = (1..=DEGREE as i32 + 1)
        .map(|power| {
            let mut moved = slope.clone();
            for i in 0..m {
                moved.row_mut(i).scale_mut(at(i).powi(power));
            }
            project(&moved)
        })
        .collect();
    let inverse = DMatrix::from_fn(DEGREE + 1, DEGREE + 1, |p, q| free[p].dot(&free[q])).cholesky()?.inverse();
    let delta = &inverse * DVector::from_fn(DEGREE + 1, |p, _| free[p].dot(residual));
    // Least squares whose weights are not the noise's: the sandwich (FᵀWF)⁻¹ FᵀW²F (FᵀWF)⁻¹.
    let mut twice = DMatrix::zeros(DEGREE + 1, DEGREE + 1);
    for p in 0..=DEGREE {
        for q in 0..=DEGREE {
            twice[(p, q)] = (0..m).map(|i| root[i] * root[i] * free[p].row(i).dot(&free[q].row(i))).sum::<f64>();
        }
    }
    let spread = (&inverse * twice * &inverse)[(0, 0)];
    delta.iter().all(|d| d.is_finite()).then_some((delta, spread))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decaying_duffing_oscillators_frequency_follows_its_amplitude() {
        // x″ + 0.01 x′ + x + x³ = 0 by the extrapolation integrator; undamped frequency by 1 + 3/8
        // a² − 21/256 a⁴ for small a.
        let mut y = vec![0.5, 0.0];
        let (step, mut h) = (0.1, 0.1);
        let mut x = Vec::new();
        for _ in 0..2500 {
            x.push(y[0]);
            let mut f = |_: f64, y: &[f64], d: &mut [f64]| {
                d[0] = y[1];
                d[1] = -0.01 * y[1] - y[0] - y[0].powi(3);
            };
            assert!(super::super::integrate::advance(&mut f, &mut y, 0.0, step, 1e-11, &mut h));
        }
        let fits = windows(&[&x], step, 1.05, &[1.0]);
        assert!(fits.len() > 8);
        for fit in &fits {
            let a = fit.cosine[1][0];
            // Frequency by first harmonic a, harmonic balance of the second order.
            let want = (1.0 + 0.75 * a * a + 3.0 / 128.0 * a.powi(4) - 3.0 / 128.0 * 0.75 * a.powi(6)).sqrt();
            assert!((fit.omega / want - 1.0).abs() < 4e-4, "{a}: {} {want}", fit.omega);
        }
        assert!(fits[0].cosine[1][0] > 2.0 * fits.last().unwrap().cosine[1][0]);
    }
}

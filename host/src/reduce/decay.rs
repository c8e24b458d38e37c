//! A decaying release: frequency and harmonics at every amplitude that it passes, from displacements alone.
//!
//! Sliding windows of six periods, half overlapping. In each, t from its middle,
//! x(t) = X_0 + Σ_k (C_k + t C′_k) cos kψ + S_k sin kψ, ψ = ψ0 + ωt + ½ω̇t²: amplitude and frequency change linearly. C, C′ and S are linear least
//! squares; ψ0 is such that the major coordinate's S_1 is 0 (the change of amplitude goes with cos ψ); ω and ω̇ follow by Gauss–Newton on what is left (variable projection). The window stands for its middle.
//! With light damping the frequency found is the free one's up to ζ²/2.

use nalgebra::DMatrix;
use std::f64::consts::TAU;

use super::release_fit::ReleaseFit;

/// Periods in a window.
const PERIODS: f64 = 6.0;
/// Harmonics in a window.
const HARMONICS: usize = 7;

/// Fits the windows of a decay: `omega` a first guess of the frequency, `major` as in [`super::release_fit::fit`].
pub fn windows(channels: &[&[f64]], step: f64, omega: f64, major: &[f64]) -> Vec<ReleaseFit> {
    let m = channels.iter().map(|c| c.len()).min().unwrap_or(0);
    let mut out = Vec::new();
    let mut guess = omega;
    let mut from = 0;
    loop {
        let length = (PERIODS * TAU / guess / step).round() as usize;
        if length < 24 || from + length > m {
            return out;
        }
        let part: Vec<&[f64]> = channels.iter().map(|c| &c[from..from + length]).collect();
        let Some(fit) = window(&part, step, guess, major) else { return out };
        guess = fit.omega;
        out.push(fit);
        from += length / 2;
    }
}

fn window(channels: &[&[f64]], step: f64, start: f64, major: &[f64]) -> Option<ReleaseFit> {
    let (m, n) = (channels[0].len(), channels.len());
    let x = DMatrix::from_fn(m, n, |i, j| channels[j][i]);
    let half = 0.5 * m as f64 * step;
    let time = |i: usize| (i as f64 - 0.5 * (m - 1) as f64) * step;
    let harmonics = HARMONICS.min((TAU / (start * step) / 2.2) as usize).max(1);
    let columns = 1 + 3 * harmonics;
    let (mut omega, mut rate, mut origin) = (start, 0.0, 0.0);
    let dot = |v: &[f64]| -> f64 { v.iter().zip(major).map(|(a, b)| a * b).sum() };
    let mut last = None;
    for _ in 0..30 {
        let mut a = DMatrix::zeros(m, columns);
        for i in 0..m {
            let (t, u) = (time(i), time(i) / half);
            let psi = origin + omega * t + 0.5 * rate * t * t;
            a[(i, 0)] = 1.0;
            for k in 1..=harmonics {
                let (s, c) = (k as f64 * psi).sin_cos();
                a[(i, 3 * k - 2)] = c;
                a[(i, 3 * k - 1)] = s;
                a[(i, 3 * k)] = u * c;
            }
        }
        let normal = (a.transpose() * &a).cholesky()?;
        let coefficients = normal.solve(&(a.transpose() * &x));
        let residual = &x - &a * &coefficients;
        // ∂x/∂ψ, then times t and ½t².
        let mut slopes = [DMatrix::zeros(m, n), DMatrix::zeros(m, n)];
        for i in 0..m {
            let t = time(i);
            for j in 0..n {
                let mut d = 0.0;
                for k in 1..=harmonics {
                    let (c, s) = (a[(i, 3 * k - 2)], a[(i, 3 * k - 1)]);
                    let cosine = coefficients[(3 * k - 2, j)] + t / half * coefficients[(3 * k, j)];
                    d += k as f64 * (coefficients[(3 * k - 1, j)] * c - cosine * s);
                }
                slopes[0][(i, j)] = t * d;
                slopes[1][(i, j)] = 0.5 * t * t * d;
            }
        }
        let free = slopes.map(|s| {
            let fitted = normal.solve(&(a.transpose() * &s));
            s - &a * fitted
        });
        let (p, q, r) = (free[0].norm_squared(), free[0].dot(&free[1]), free[1].norm_squared());
        let (f, g) = (free[0].dot(&residual), free[1].dot(&residual));
        let determinant = p * r - q * q;
        if !determinant.is_finite() || determinant <= 0.0 {
            return None;
        }
        // The amplitude's change goes with cos ψ alone, so the phase must be the motion's own.
        let of = |r: usize| -> f64 { dot(&coefficients.row(r).iter().copied().collect::<Vec<_>>()) };
        let lag = of(2).atan2(of(1));
        let (dw, dr) = ((f * r - g * q) / determinant, (p * g - q * f) / determinant);
        let variance = residual.norm_squared() / (m * n) as f64 * r / determinant;
        last = Some((omega, origin, coefficients, residual.norm_squared(), variance.sqrt()));
        let limit = 0.3 / half;
        omega += dw.clamp(-limit, limit);
        rate += dr.clamp(-limit / half, limit / half);
        origin -= lag;
        if dw.abs() < 1e-12 * omega && lag.abs() < 1e-9 {
            break;
        }
    }
    let (omega, origin, coefficients, sum, error) = last?;
    let row = |r: usize| -> Vec<f64> { coefficients.row(r).iter().copied().collect() };
    let (mut cosine, mut sine) = (vec![row(0)], vec![vec![0.0; n]]);
    for k in 1..=harmonics {
        cosine.push(row(3 * k - 2));
        sine.push(row(3 * k - 1));
    }
    let lag = dot(&sine[1]).atan2(dot(&cosine[1]));
    for k in 1..=harmonics {
        let (s, c) = (k as f64 * lag).sin_cos();
        for j in 0..n {
            let (a, b) = (cosine[k][j], sine[k][j]);
            (cosine[k][j], sine[k][j]) = (a * c + b * s, b * c - a * s);
        }
    }
    let motion: f64 = cosine.iter().chain(&sine).skip(1).flatten().map(|v| 0.5 * v * v).sum::<f64>().sqrt();
    let residual = (sum / m as f64).sqrt() / motion.max(1e-300);
    Some(ReleaseFit {
        omega,
        omega_error: error,
        phase: origin - omega * half - lag,
        cosine,
        sine,
        residual,
        residual_thirds: [residual; 2],
        periods: omega * m as f64 * step / TAU,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decaying_duffing_oscillators_frequency_follows_its_amplitude() {
        // x″ + 0.01 x′ + x + x³ = 0 by the extrapolation integrator; undamped frequency by 1 + 3/8 a² − 21/256 a⁴ for small a.
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

//! Solutions of [`Dynamics`] at even times: Dormand and Prince's method of order 5 with its error
//! estimate of order 4 (J. Comput. Appl. Math. 6, 1980), steps chosen by the error.
//!
//! Laws that jump (dry friction) would drive the step to nothing: no step is shorter than
//! 1/`finest` of a sampling interval, and one of that length is taken as it is. A reversal is then
//! placed to that fraction, and a system that sticks creeps by no more than its acceleration over
//! such a step.

use super::dynamics::{Dynamics, Instant};
use super::tableau::{A, C, E};

/// What acts from outside: phase and inputs at a time.
pub trait Outside: Sync {
    /// Phase of the drive, rad.
    fn tau(&self, time: f64) -> f64;

    /// Writes the inputs.
    fn inputs(&self, time: f64, out: &mut [f64]);
}

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Sampling step, s.
    pub step_s: f64,
    /// Samples.
    pub count: usize,
    /// Error of one step, relative to the largest of each quantity so far.
    pub tolerance: f64,
    /// Number of inputs.
    pub inputs: usize,
    /// Steps within one sampling interval at most.
    pub finest: f64,
}

/// Coordinates and rates at every sample (count rows of 2n) from `initial` (q, then v) on; `None`
/// where the accelerations cease to exist or the motion leaves the finite numbers.
pub fn solve<D: Dynamics + ?Sized>(
    dynamics: &D,
    parameters: &[f64],
    initial: &[f64],
    outside: &dyn Outside,
    settings: &Settings,
) -> Option<Vec<Vec<f64>>> {
    let n = dynamics.degrees_of_freedom();
    let mut y = initial.to_vec();
    let mut inputs = vec![0.0; settings.inputs];
    let mut f = |time: f64, y: &[f64], out: &mut [f64]| {
        outside.inputs(time, &mut inputs);
        let at = Instant { time, tau: outside.tau(time), inputs: &inputs };
        out[..n].copy_from_slice(&y[n..]);
        dynamics.acceleration(parameters, &y[..n], &y[n..], &at, &mut out[n..])
    };
    let mut k = vec![vec![0.0; 2 * n]; 7];
    let mut stage = vec![0.0; 2 * n];
    let mut scale: Vec<f64> = y.iter().map(|x| x.abs()).collect();
    let least = settings.step_s / settings.finest;
    let mut h = settings.step_s;
    let mut out = Vec::with_capacity(settings.count);
    for sample in 0..settings.count {
        if !y.iter().all(|x| x.is_finite()) {
            return None;
        }
        out.push(y.clone());
        let from = settings.start_s + sample as f64 * settings.step_s;
        let mut done = 0.0;
        while done < settings.step_s {
            let left = settings.step_s - done;
            let whole = h >= left * (1.0 - 1e-9);
            let step = if whole { left } else { h };
            for i in 0..7 {
                let (before, rest) = k.split_at_mut(i);
                for (j, x) in stage.iter_mut().enumerate() {
                    *x = y[j] + step * before.iter().zip(&A[i]).map(|(k, a)| a * k[j]).sum::<f64>();
                }
                if !f(from + done + C[i] * step, &stage, &mut rest[0]) {
                    return None;
                }
            }
            // The last stage is the solution.
            let mut error = 0.0_f64;
            for j in 0..2 * n {
                let size = scale[j].max(stage[j].abs()).max(1e-12);
                let e = step * k.iter().zip(&E).map(|(k, e)| e * k[j]).sum::<f64>();
                error = error.max((e / (settings.tolerance * size)).abs());
            }
            // What is left of a sampling interval may exceed the least step by a rounding.
            if error > 1.0 && step.min(h) > least {
                h = (step * (0.9 * error.powf(-0.2)).clamp(0.1, 0.9)).max(least);
                continue;
            }
            y.copy_from_slice(&stage);
            scale.iter_mut().zip(&y).for_each(|(s, x)| *s = s.max(x.abs()));
            done = if whole { settings.step_s } else { done + step };
            let grown = step * (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 5.0);
            // A step cut short by a sample says nothing against the one before.
            h = if whole { grown.max(h) } else { grown }.clamp(least, settings.step_s);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::dynamics::Here;

    /// q̈ = −ω² q − c sign q̇ + u.
    struct Oscillator;

    impl Dynamics for Oscillator {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            2
        }
        fn acceleration_held(&self, Here { parameters: p, q, v, at, .. }: Here<'_>, out: &mut [f64]) -> bool {
            let sign = if v[0] == 0.0 { 0.0 } else { v[0].signum() };
            out[0] = -p[0] * p[0] * q[0] - p[1] * sign + at.inputs[0];
            out[0].is_finite()
        }
    }

    struct Force;

    impl Outside for Force {
        fn tau(&self, _: f64) -> f64 {
            0.0
        }
        fn inputs(&self, time: f64, out: &mut [f64]) {
            out[0] = 3.0 * (2.0 * time).cos();
        }
    }

    #[test]
    fn a_forced_oscillator_follows_its_closed_solution() {
        let settings = Settings { start_s: 0.5, step_s: 0.05, count: 400, tolerance: 1e-11, inputs: 1, finest: 400.0 };
        // x = 3 cos 2t/(ω² − 4) + A cos ωt + B sin ωt.
        let x = |t: f64| 3.0 * (2.0 * t).cos() / 5.0 + 0.4 * (3.0 * t).cos() - 0.7 * (3.0 * t).sin();
        let v = |t: f64| -6.0 * (2.0 * t).sin() / 5.0 - 1.2 * (3.0 * t).sin() - 2.1 * (3.0 * t).cos();
        let out = solve(&Oscillator, &[3.0, 0.0], &[x(0.5), v(0.5)], &Force, &settings).unwrap();
        for (i, y) in out.iter().enumerate() {
            let t = 0.5 + 0.05 * i as f64;
            assert!((y[0] - x(t)).abs() < 1e-8 && (y[1] - v(t)).abs() < 1e-8, "{t}: {y:?}");
        }
    }

    struct Free;

    impl Outside for Free {
        fn tau(&self, _: f64) -> f64 {
            0.0
        }
        fn inputs(&self, _: f64, out: &mut [f64]) {
            out.fill(0.0);
        }
    }

    /// A law that no step resolves is taken at the least step, whatever rounding leaves of an
    /// interval.
    #[test]
    fn a_law_that_no_step_resolves_comes_to_an_end() {
        struct Noise;
        impl Outside for Noise {
            fn tau(&self, _: f64) -> f64 {
                0.0
            }
            fn inputs(&self, time: f64, out: &mut [f64]) {
                out[0] = 1e6 * (1e12 * time).sin();
            }
        }
        // Steps of these sizes do not add up to an interval to the last digit.
        for finest in [50.0, 100.0, 300.0] {
            let settings = Settings { start_s: 0.0, step_s: 0.01, count: 30, tolerance: 1e-9, inputs: 1, finest };
            assert!(solve(&Oscillator, &[3.0, 0.45], &[1.0, 0.0], &Noise, &settings).is_some());
        }
    }

    /// Dry friction takes 2c/ω² off each half swing, then holds the mass.
    #[test]
    fn dry_friction_takes_its_part_and_then_holds() {
        let settings = Settings { start_s: 0.0, step_s: 0.01, count: 1500, tolerance: 1e-9, inputs: 1, finest: 400.0 };
        let out = solve(&Oscillator, &[3.0, 0.45], &[1.02, 0.0], &Free, &settings).unwrap();
        let half = |k: usize| (core::f64::consts::PI / 3.0 / 0.01 * k as f64).round() as usize;
        for k in 1..5 {
            let expected = (1.02 - 0.1 * k as f64) * if k % 2 == 0 { 1.0 } else { -1.0 };
            assert!((out[half(k)][0] - expected).abs() < 2e-4, "{k}: {} {expected}", out[half(k)][0]);
        }
        let (a, b) = (out[1300][0], out[1499][0]);
        assert!((a - b).abs() < 1e-4 && a.abs() <= 0.05, "{a} {b}");
        assert!(solve(&Oscillator, &[f64::NAN, 0.0], &[1.0, 0.0], &Free, &settings).is_none());
    }
}

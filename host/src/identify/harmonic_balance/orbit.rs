//! One orbit or piece, sampled: its angles, velocities and accelerations in τ.
//!
//! The angle of a whirling orbit is its mean rotation w/k (w whole turns over k periods) plus an
//! oscillation with a Fourier series (2.10), (2.11). Where the orbit fails to close, that series
//! has a jump, which its derivatives turn into an impulse; five-point differences (3.29), (3.30)
//! look at the record beyond both ends instead and have none.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex64;

use super::fourier::Fourier;
use super::settings::Differentiation;
use crate::identify::stretches::Stretch;
use crate::phase_space::unstable_periodic_orbit::lagrange;

/// Samples kept before and after an orbit.
pub const MARGIN: usize = 2;

/// Angles of an orbit, cut from a record.
#[derive(Clone, Debug)]
pub struct Orbit {
    /// Period or length k, drive periods.
    pub periods: usize,
    /// Time of its first sample, s.
    pub start_s: f64,
    /// How far it is from closing, share of the span (0 where that was not asked).
    pub closing_error: f64,
    /// τ at its first sample, rad.
    pub tau: f64,
    /// φ1, φ2 (0 where there is one coordinate): `MARGIN` samples before, n of the orbit,
    /// `MARGIN` + 1 after.
    pub phi: [Vec<f64>; 2],
}

impl Orbit {
    /// Cuts k drive periods of `period` samples each from a stretch, from sample `start` on. Where
    /// k·period is no whole number of samples, values between samples are four-point Lagrange
    /// interpolations. `None` where the record does not reach.
    pub fn cut(stretch: &Stretch, start: usize, periods: usize, period: f64, closing_error: f64) -> Option<Self> {
        let length = periods as f64 * period;
        let n = length.round().max(8.0) as usize;
        let step = length / n as f64;
        let whole = (step - 1.0).abs() * n as f64 * 1e3 < 1.0;
        // One sample more on either side for interpolation.
        let (before, after) = (MARGIN + 1, n + MARGIN + 3);
        if start < before || start + after + 1 > stretch.len() {
            return None;
        }
        let phi = [0, 1].map(|c| {
            let Some(x) = stretch.coordinates.get(c) else { return vec![0.0; n + 2 * MARGIN + 1] };
            (0..n + 2 * MARGIN + 1)
                .map(|i| {
                    if whole {
                        return x[start + i - MARGIN];
                    }
                    let t = start as f64 + (i as f64 - MARGIN as f64) * step;
                    let at = t.floor() as usize;
                    lagrange(t - at as f64).iter().zip(&x[at - 1..at + 3]).map(|(w, x)| w * x).sum()
                })
                .collect()
        });
        Some(Self { periods, start_s: stretch.time(start), closing_error, tau: stretch.tau(start), phi })
    }

    /// Samples n.
    pub fn len(&self) -> usize {
        self.phi[0].len().saturating_sub(2 * MARGIN + 1)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Everything at one instant that a term may depend on. Angles rad, rates and accelerations in τ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// φ1, φ2.
    pub angle: [f64; 2],
    /// φ1′, φ2′.
    pub rate: [f64; 2],
    /// φ1″, φ2″.
    pub accel: [f64; 2],
    /// τ of the drive, rad.
    pub tau: f64,
}

/// An orbit with its derivatives.
#[derive(Clone, Debug)]
pub struct Motion {
    /// States, n of them.
    pub states: Vec<State>,
    /// τ of each, rad.
    pub tau: Vec<f64>,
    /// k.
    pub periods: usize,
    /// Angles and rates at both ends, by five-point differences.
    pub ends: [State; 2],
}

/// (3.29) in τ, `h` the step in τ; x[2] is the middle of the five.
fn five_point_rate(x: &[f64], h: f64) -> f64 {
    (8.0 * (x[3] - x[1]) - x[4] + x[0]) / (12.0 * h)
}

/// (3.30).
fn five_point_acceleration(x: &[f64], h: f64) -> f64 {
    (16.0 * (x[3] + x[1] - 2.0 * x[2]) - x[4] - x[0] + 2.0 * x[2]) / (12.0 * h * h)
}

/// Velocities and accelerations of an orbit; `keep`: highest sub-harmonic that passes the low-pass.
pub fn motion(
    orbit: &Orbit,
    fourier: &Fourier,
    how: Differentiation,
    keep: Option<usize>,
    circle: [bool; 2],
) -> Motion {
    let n = orbit.len();
    let k = orbit.periods as f64;
    let h = TAU * k / n as f64;
    let keep = keep.unwrap_or(n);
    let derived = [0, 1].map(|c| {
        let whole = &orbit.phi[c];
        let x = &whole[MARGIN..MARGIN + n];
        let real = |c: Vec<Complex64>| -> Vec<f64> {
            let mut c = c;
            fourier.cut(&mut c, keep);
            fourier.series(c).into_iter().map(|z| z.re).collect()
        };
        // A coordinate on a line does not turn.
        let how = if how == Differentiation::Circle && !circle[c] { Differentiation::Fourier } else { how };
        match how {
            Differentiation::Fourier => {
                let turns = if circle[c] { ((whole[MARGIN + n] - x[0]) / TAU).round() } else { 0.0 };
                let rotation = TAU * turns / n as f64;
                // A whirling angle is large: only its change counts.
                let oscillation = x.iter().enumerate().map(|(i, v)| v - x[0] - rotation * i as f64);
                let c = fourier.coefficients(oscillation.map(|x| Complex64::new(x, 0.0)));
                let mut rate = real(fourier.derivative(&c, k));
                rate.iter_mut().for_each(|v| *v += turns / k);
                (rate, real(fourier.second_derivative(&c, k)))
            }
            Differentiation::Circle => {
                let z: Vec<Complex64> = x.iter().map(|x| Complex64::from_polar(1.0, *x)).collect();
                let mut c = fourier.coefficients(z.iter().copied());
                fourier.cut(&mut c, keep);
                let along = |d: Vec<Complex64>| -> Vec<f64> {
                    fourier.series(d).iter().zip(&z).map(|(d, z)| (z.conj() * d).im).collect()
                };
                let (rate, accel) = (along(fourier.derivative(&c, k)), along(fourier.second_derivative(&c, k)));
                (fourier.low_pass(&rate, keep), fourier.low_pass(&accel, keep))
            }
            Differentiation::FivePoint => {
                let five = |f: fn(&[f64], f64) -> f64| -> Vec<f64> {
                    (0..n).map(|i| f(&whole[i..i + 2 * MARGIN + 1], h)).collect()
                };
                let (rate, accel) = (five(five_point_rate), five(five_point_acceleration));
                (fourier.low_pass(&rate, keep), fourier.low_pass(&accel, keep))
            }
        }
    });
    let states = (0..n)
        .map(|i| State {
            angle: [0, 1].map(|c: usize| orbit.phi[c][MARGIN + i]),
            rate: [0, 1].map(|c: usize| derived[c].0[i]),
            accel: [0, 1].map(|c: usize| derived[c].1[i]),
            tau: orbit.tau + h * i as f64,
        })
        .collect();
    let end = |i: usize| State {
        angle: [0, 1].map(|c: usize| orbit.phi[c][MARGIN + i]),
        rate: [0, 1].map(|c: usize| five_point_rate(&orbit.phi[c][i..i + 2 * MARGIN + 1], h)),
        accel: [0.0; 2],
        tau: orbit.tau + h * i as f64,
    };
    Motion {
        states,
        tau: (0..n).map(|i| orbit.tau + h * i as f64).collect(),
        periods: orbit.periods,
        ends: [end(0), end(n)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::angles::Phase;
    use rustfft::FftPlanner;

    /// θ = 2τ/3·(turns) + 0.3 sin(τ/3): a whirling orbit of period 3.
    fn stretch(period: f64) -> Stretch {
        let tau = |i: usize| TAU * i as f64 / period;
        Stretch {
            start_s: 0.0,
            step_s: 0.01,
            coordinates: vec![
                (0..400).map(|i| 2.0 / 3.0 * tau(i) + 0.3 * (tau(i) / 3.0).sin()).collect(),
                (0..400).map(|i| 0.1 * tau(i).cos()).collect(),
            ],
            phase: Phase::Clock(TAU / (0.01 * period)),
            inputs: Vec::new(),
            amplitude_nm: None,
            history: None,
            base: None,
        }
    }

    #[test]
    fn all_three_ways_differentiate_a_whirling_orbit() {
        // A whole number of samples a period, and not.
        for period in [40.0, 40.25] {
            let orbit = Orbit::cut(&stretch(period), 10, 3, period, 0.0).unwrap();
            let fourier = Fourier::new(&mut FftPlanner::new(), orbit.len());
            for (how, tolerance) in
                [(Differentiation::Fourier, 2e-4), (Differentiation::Circle, 2e-4), (Differentiation::FivePoint, 2e-4)]
            {
                let m = motion(&orbit, &fourier, how, None, [true; 2]);
                for (s, tau) in m.states.iter().zip(&m.tau) {
                    let rate = [2.0 / 3.0 + 0.1 * (tau / 3.0).cos(), -0.1 * tau.sin()];
                    let accel = [-0.1 / 3.0 * (tau / 3.0).sin(), -0.1 * tau.cos()];
                    for c in 0..2 {
                        assert!((s.rate[c] - rate[c]).abs() < tolerance, "{period} {how:?} {} {}", s.rate[c], rate[c]);
                        assert!((s.accel[c] - accel[c]).abs() < 20.0 * tolerance, "{how:?} {}", s.accel[c]);
                    }
                }
                assert!((m.ends[0].rate[0] - m.states[0].rate[0]).abs() < 1e-3);
                assert!((m.ends[1].angle[0] - m.ends[0].angle[0] - 2.0 * TAU).abs() < 1e-6);
            }
        }
    }

    /// Figure 3.13: an orbit that does not close has an impulse in the Fourier series, none in the
    /// differences.
    #[test]
    fn five_points_do_not_see_the_jump() {
        let orbit = Orbit::cut(&stretch(40.0), 10, 2, 40.0, 0.0).unwrap();
        let fourier = Fourier::new(&mut FftPlanner::new(), orbit.len());
        let greatest = |how| {
            motion(&orbit, &fourier, how, None, [true; 2]).states.iter().map(|s| s.accel[0].abs()).fold(0.0, f64::max)
        };
        assert!(greatest(Differentiation::Fourier) > 1.0, "{}", greatest(Differentiation::Fourier));
        assert!(greatest(Differentiation::FivePoint) < 0.05);
    }

    #[test]
    fn what_the_record_does_not_reach_is_no_orbit() {
        let s = stretch(40.0);
        assert!(Orbit::cut(&s, 2, 1, 40.0, 0.0).is_none());
        assert!(Orbit::cut(&s, 370, 1, 40.0, 0.0).is_none());
        assert!(Orbit::cut(&s, 3, 9, 40.0, 0.0).is_some());
    }
}

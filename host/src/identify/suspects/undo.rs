//! What may have been done to a record by mistake, undone.
//!
//! Signals are the sensors in the rig's order, then the inputs, all in SI: y′ = M y for channels
//! that were exchanged, reversed, scaled or declared relative, y′(t) = y(t + d + e (t − t₀)) for
//! one that is late by d and whose clock is fast by −e (interpolated), τ′ = τ + δ (t − t₀)
//! for a drive off by δ.

use core::f64::consts::TAU;

use crate::identify::remeasured::Sensors;
use crate::identify::stretches::{Stretch, mixed};
use crate::model::model_file::Space;
use crate::rig::measures::ObservedModel;
use crate::signal::angles::Phase;
use crate::signal::lagrange;

/// One mistake to undo.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Undo {
    /// Two signals are exchanged; the second shows the first's raw values times the number, and
    /// the reverse.
    Exchange(usize, usize, f64),
    /// A sensor counts in the other sense.
    Reverse(usize),
    /// A sensor shows itself plus the number times another one.
    Against(usize, usize, f64),
    /// Sensors show so many times what they should.
    Scale(Vec<usize>, f64),
    /// The same, where turns may have been added in the wrong unit.
    Unit(Vec<usize>, f64),
    /// A signal lags.
    Lag {
        /// The signal.
        signal: usize,
        /// By so much, s.
        delay_s: f64,
        /// And by so much more a second.
        drift: f64,
        /// Longest lag that is looked at, s: so much is left out at both ends.
        most_s: f64,
    },
    /// The drive runs ahead of the stated phase, rad/s.
    Drive(f64),
}

impl Undo {
    /// The same with other numbers.
    pub fn at(&self, x: &[f64]) -> Self {
        let mut out = self.clone();
        match (&mut out, x) {
            (Self::Scale(_, f) | Self::Drive(f), [x, ..]) => *f = *x,
            (Self::Lag { delay_s, drift, .. }, [d, e, ..]) => (*delay_s, *drift) = (*d, *e),
            (Self::Lag { delay_s, .. }, [d]) => *delay_s = *d,
            _ => {}
        }
        out
    }

    /// Whether another one differs in its numbers alone.
    pub fn same_kind(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Scale(a, _) | Self::Unit(a, _), Self::Scale(b, _) | Self::Unit(b, _)) => a == b,
            (Self::Lag { signal: a, .. }, Self::Lag { signal: b, .. }) => a == b,
            (Self::Drive(_), Self::Drive(_)) => true,
            _ => self == other,
        }
    }

    /// The stretch with it undone; `start_s`: when the record begins.
    pub fn stretch(&self, s: &Stretch, bound: &ObservedModel, start_s: f64) -> Stretch {
        if let Self::Drive(rate) = self {
            return driven(s, *rate, start_s);
        }
        let mut shown = s.sensors(bound);
        let n = shown.len();
        let mut inputs = s.inputs.clone();
        match self {
            Self::Drive(_) => {}
            Self::Exchange(a, b, factor) => {
                let all = |k: usize| if k < n { shown[k].clone() } else { inputs[k - n].clone() };
                let (x, y) = (all(*a), all(*b));
                for (to, from, f) in [(*a, y, 1.0 / factor), (*b, x, *factor)] {
                    let values = from.into_iter().map(|v| v * f).collect();
                    if to < n { shown[to] = values } else { inputs[to - n] = values }
                }
            }
            Self::Reverse(i) => shown[*i].iter_mut().for_each(|x| *x = -*x),
            Self::Against(i, other, f) => {
                let other = shown[*other].clone();
                shown[*i].iter_mut().zip(&other).for_each(|(x, o)| *x += f * o);
            }
            Self::Scale(list, f) => {
                for &i in list {
                    shown[i].iter_mut().for_each(|x| *x /= f);
                }
            }
            Self::Unit(list, f) => {
                for &i in list {
                    let coordinates = &bound.model.coordinates;
                    let line = |k: &usize| bound.shown[(i, *k)] != 0.0 && coordinates[*k].space == Space::Line;
                    if !(0..coordinates.len()).any(|k| line(&k)) {
                        unwrap(&mut shown[i], TAU);
                    }
                    shown[i].iter_mut().for_each(|x| *x /= f);
                }
            }
            Self::Lag { signal, delay_s, drift, most_s } => {
                let reach = (most_s / s.step_s).ceil() as usize + 2;
                let (first, last) = (reach.min(s.len() / 2), s.len() - reach.min(s.len() / 2));
                let x = if *signal < n { &shown[*signal] } else { &inputs[*signal - n] };
                let later: Vec<f64> = (first..last)
                    .map(|i| {
                        let lag = delay_s + drift * (s.time(i) - start_s);
                        interpolated(x, i as f64 + lag.clamp(-most_s, *most_s) / s.step_s)
                    })
                    .collect();
                let mut out = s.part(first, last);
                if *signal < n {
                    let mut shown = out.sensors(bound);
                    shown[*signal] = later;
                    out.coordinates = mixed(&bound.coordinates, &shown);
                } else {
                    out.inputs[*signal - n] = later;
                }
                return out;
            }
        }
        Stretch { coordinates: mixed(&bound.coordinates, &shown), inputs, ..s.clone() }
    }

    /// What it does to the sensors' counts and noise.
    pub fn sensors(&self, sensors: &mut Sensors) {
        let Sensors { count, sigma, .. } = sensors;
        match self {
            Self::Exchange(a, b, f) if *a < sigma.len() && *b < sigma.len() => {
                count.swap(*a, *b);
                sigma.swap(*a, *b);
                for (i, f) in [(*a, 1.0 / f), (*b, *f)] {
                    count[i] = count[i].map(|c| c * f);
                    sigma[i] *= f;
                }
            }
            Self::Scale(list, f) | Self::Unit(list, f) => {
                for &i in list {
                    count[i] = count[i].map(|c| c / f);
                    sigma[i] /= f;
                }
            }
            _ => {}
        }
    }
}

/// A stretch whose drive runs ahead of its phase by `rate`, rad/s, from `start_s` on.
fn driven(s: &Stretch, rate: f64, start_s: f64) -> Stretch {
    let turns = 4_294_967_296.0 / TAU;
    let phase = (0..s.len())
        .map(|i| {
            let tau = s.tau(i) + rate * (s.time(i) - start_s);
            (tau * turns).rem_euclid(4_294_967_296.0) as u32
        })
        .collect();
    Stretch { phase: Phase::Device(phase), ..s.clone() }
}

/// Value at a place, in samples, of the polynomial through the eight samples around it (Lagrange):
/// the cubic through four makes a lag as much too large as (ω Δt)²/6 says, a hundredth at 25 samples
/// a period.
fn interpolated(x: &[f64], at: f64) -> f64 {
    const NODES: [f64; 8] = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0];
    let last = x.len() - 1;
    let at = at.clamp(0.0, last as f64);
    let (k, u) = (at as usize, at.fract());
    let sample = |node: f64| x[k.saturating_add_signed(node as isize).min(last)];
    lagrange::weights(&NODES, u).zip(NODES).map(|(w, node)| w * sample(node)).sum()
}

/// Adds whole moduli so that every sample lies as close as can be to the straight line through the
/// two before, and that most steps are below half a modulus.
pub(super) fn unwrap(x: &mut [f64], modulus: f64) {
    for i in 2..x.len() {
        let expected = 2.0 * x[i - 1] - x[i - 2];
        x[i] -= ((x[i] - expected) / modulus).round() * modulus;
    }
    let mut steps: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = steps.len() / 2;
    if middle > 0 {
        let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
        let turns = (*median / modulus).round() * modulus;
        x.iter_mut().enumerate().for_each(|(i, x)| *x -= turns * i as f64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_is_shifted_by_parts_of_a_sample() {
        let x: Vec<f64> = (0..200).map(|i| (0.5 * f64::from(i)).sin()).collect();
        for at in [20.0, 20.01, 20.25, 77.5, 150.9] {
            // As exact a share of the shift as of a whole sample.
            let (shift, exact) = (interpolated(&x, at) - x[at as usize], (0.5 * at).sin() - x[at as usize]);
            assert!((shift - exact).abs() <= 1e-4 * exact.abs(), "{at}: {shift} {exact}");
        }
        // Beyond the ends the last values stand.
        assert_eq!((interpolated(&x, -3.0), interpolated(&x, 500.0)), (x[0], x[199]));
    }

    #[test]
    fn turns_added_in_the_wrong_unit_go_again() {
        // Degrees read as radians: differences above π lost a turn of 2π.
        let truth: Vec<f64> = (0..500).map(|i| 400.0 * (0.02 * f64::from(i) + 0.5).sin()).collect();
        let mut read = truth.clone();
        for i in 1..read.len() {
            let turns = ((truth[i] - truth[i - 1]) / TAU).round();
            read[i] = read[i - 1] + truth[i] - truth[i - 1] - turns * TAU;
        }
        assert!((read[150] - truth[150]).abs() > 100.0);
        unwrap(&mut read, TAU);
        // The first step was read as one of the other sense.
        assert!((truth[1] - truth[0]).abs() > 0.5 * TAU);
        assert!(read.iter().zip(&truth).all(|(a, b)| (a - b - read[0] + truth[0]).abs() < 1e-9));
    }
}

//! Whether a driven record repeats: ‖S(n) − S(n − kT)‖ small on the circle over nearly the whole of
//! it.
//!
//! A locked record holds one orbit and cannot show what an identification needs. The distance is
//! the largest over the coordinates, each divided by its span (2π for one that turns over,
//! otherwise max − min), with angles compared on the circle; it is the displacement alone that is
//! compared. kT need not be a whole number of samples: the later sample is compared with a
//! four-point Lagrange interpolation of the earlier ones.

use serde::Serialize;
use std::f64::consts::TAU;

use super::motion::{Motion, Space};
use crate::signal::angles::wrap;

/// Longest period looked for, drive periods.
pub const LONGEST: usize = 16;

/// What kind of motion a record shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Nothing moves beyond a few quantisation steps.
    AtRest,
    /// Repeats after `period` drive periods.
    Periodic,
    /// Repeats from `locked_after_s` on, not before.
    LocksLater,
    /// Does not repeat within 16 drive periods: chaotic or transient.
    ChaoticOrTransient,
    /// No drive: decays or moves freely.
    Free,
}

/// Outcome of the search for a period.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Periodicity {
    /// Verdict.
    pub kind: Kind,
    /// Period k in drive periods, where there is one.
    pub period: Option<usize>,
    /// Share of the samples at which the orbit repeats within the tolerance, for the best k.
    pub repeats: f64,
    /// The k of `repeats`.
    pub best: usize,
    /// Tolerance, fraction of the span.
    pub tolerance: f64,
    /// Time since the start of the longest stretch after which it repeats, s.
    pub locked_after_s: Option<f64>,
}

/// Looks for a period in the longest stretch (index `stretch` of each motion).
///
/// `tolerance` is a fraction of the span; it is raised to four quantisation steps where these are
/// coarser.
pub fn periodicity(
    motions: &[Motion],
    stretch: usize,
    samples_per_period: Option<f64>,
    rate_hz: f64,
    tolerance: f64,
) -> Periodicity {
    let measured: Vec<(&[f64], Space, f64, f64)> = motions
        .iter()
        .filter(|m| !m.derived)
        .filter_map(|m| {
            let x = m.stretches.get(stretch)?;
            let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
            let span = if m.space == Space::S1 { (high - low).min(TAU) } else { high - low };
            Some((x.as_slice(), m.space, span, m.step))
        })
        .collect();
    let none = Periodicity { kind: Kind::Free, period: None, repeats: 0.0, best: 0, tolerance, locked_after_s: None };
    let still =
        |span: f64, space: Space, step: f64| span <= 6.0 * step || (space == Space::S1 && span < 2e-3) || span == 0.0;
    if measured.iter().all(|(_, space, span, step)| still(*span, *space, *step)) {
        return Periodicity { kind: Kind::AtRest, ..none };
    }
    let Some(period) = samples_per_period else { return none };
    let n = measured.iter().map(|m| m.0.len()).min().unwrap_or(0);
    let moving: Vec<_> = measured.iter().filter(|(_, space, span, step)| !still(*span, *space, *step)).collect();
    let close = |i: usize, lag: f64| {
        moving.iter().all(|(x, space, span, step)| {
            let difference = x[i] - interpolate(x, i as f64 - lag);
            let distance = if *space == Space::S1 { wrap(difference).abs() } else { difference.abs() };
            distance <= (tolerance * span).max(4.0 * step)
        })
    };
    let mut best = Periodicity { kind: Kind::ChaoticOrTransient, best: 1, ..none };
    for k in 1..=LONGEST {
        let lag = k as f64 * period;
        if lag.is_nan() || lag >= n as f64 {
            break;
        }
        let first = lag.ceil() as usize + 2;
        // Ten repeats at least: fewer than that any slow motion could give.
        if first + (10.0 * period) as usize > n {
            break;
        }
        let flags: Vec<bool> = (first..n).map(|i| close(i, lag)).collect();
        let repeats = flags.iter().filter(|f| **f).count() as f64 / flags.len() as f64;
        if repeats > best.repeats {
            best = Periodicity { repeats, best: k, ..best };
        }
        if repeats >= 0.97 {
            return Periodicity { kind: Kind::Periodic, period: Some(k), ..best };
        }
        // The record's end: the longest part of it in which nearly all samples repeat.
        let (mut close_ones, mut start) = (0usize, flags.len());
        for (i, flag) in flags.iter().enumerate().rev() {
            close_ones += usize::from(*flag);
            if close_ones as f64 >= 0.97 * (flags.len() - i) as f64 {
                start = i;
            }
        }
        let locked = flags.len() - start;
        if best.period.is_none() && locked as f64 >= 20.0 * period {
            let after = Some(start as f64 / rate_hz);
            best = Periodicity { kind: Kind::LocksLater, period: Some(k), locked_after_s: after, ..best };
        }
    }
    best
}

/// Four-point Lagrange interpolation at a real index; nearest samples at the ends.
fn interpolate(x: &[f64], at: f64) -> f64 {
    let i = (at.floor() as usize).clamp(1, x.len().saturating_sub(3).max(1));
    if x.len() < 4 {
        return x.first().copied().unwrap_or(0.0);
    }
    let u = at - i as f64;
    let (a, b, c, d) = (x[i - 1], x[i], x[i + 1], x[i + 2]);
    -u * (u - 1.0) * (u - 2.0) / 6.0 * a + (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0 * b
        - (u + 1.0) * u * (u - 2.0) / 2.0 * c
        + (u + 1.0) * u * (u - 1.0) / 6.0 * d
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angle(x: Vec<f64>) -> Motion {
        Motion {
            name: "theta1".into(),
            unit: "rad".into(),
            space: Space::S1,
            derived: false,
            step: 0.0015,
            quantisation_noise: 4e-4,
            stretches: vec![x],
        }
    }

    #[test]
    fn finds_period_three_of_a_whirl_when_a_period_is_no_whole_number_of_samples() {
        let period = 500.0 / 5.2;
        let x = (0..12_000)
            .map(|i| {
                let tau = TAU * f64::from(i) / period;
                tau + 0.8 * tau.sin() + 0.3 * (tau / 3.0).cos()
            })
            .collect();
        let found = periodicity(&[angle(x)], 0, Some(period), 500.0, 0.01);
        assert_eq!((found.kind, found.period), (Kind::Periodic, Some(3)));
        assert!(found.repeats > 0.999);
    }

    #[test]
    fn tells_rest_locking_and_drift_apart() {
        let period = 100.0;
        let rest = angle((0..5000).map(|i| 0.001 * f64::from(i % 2)).collect());
        assert_eq!(periodicity(&[rest], 0, Some(period), 500.0, 0.01).kind, Kind::AtRest);
        let incommensurate =
            angle((0..9000).map(|i| (f64::from(i) * 0.0511).sin() + (f64::from(i) * 0.0837).sin()).collect());
        let found = periodicity(std::slice::from_ref(&incommensurate), 0, Some(period), 500.0, 0.01);
        assert_eq!(found.kind, Kind::ChaoticOrTransient);
        assert_eq!(periodicity(&[incommensurate], 0, None, 500.0, 0.01).kind, Kind::Free);
        let settles = angle(
            (0..20_000)
                .map(|i| {
                    let t = f64::from(i);
                    (TAU * t / period).sin() + 2.0 * (-t / 1000.0).exp() * (0.0511 * t).sin()
                })
                .collect(),
        );
        let found = periodicity(&[settles], 0, Some(period), 500.0, 0.01);
        assert_eq!((found.kind, found.period), (Kind::LocksLater, Some(1)));
        let after = found.locked_after_s.unwrap();
        assert!((4.0..12.0).contains(&after), "{after}");
    }

    #[test]
    fn interpolation_is_exact_for_cubics() {
        let x: Vec<f64> = (0..9).map(|i| f64::from(i).powi(3) - f64::from(i)).collect();
        for at in [1.5, 3.25, 6.9] {
            assert!((interpolate(&x, at) - (at.powi(3) - at)).abs() < 1e-9);
        }
    }
}

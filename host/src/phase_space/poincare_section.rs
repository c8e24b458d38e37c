//! Poincaré sections of a driven record: value and velocity of each coordinate where the drive's
//! phase τ mod 2π passes a given one, once a drive period.
//!
//! Values between samples are four-point Lagrange interpolations; velocities are least-squares
//! slopes over 2 m + 1 samples about the nearest one, Σ i x_i/(h Σ i²). Values of an angle are
//! wrapped to [−π, π).

use serde::Serialize;

use super::unstable_periodic_orbit::{Trajectory, lagrange};

/// A section at one phase.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Section {
    /// Phase τ of the drive, rad.
    pub tau: f64,
    /// Values, one list for each coordinate.
    pub value: Vec<Vec<f32>>,
    /// Velocities, unit/s.
    pub velocity: Vec<Vec<f32>>,
}

/// The section at `turns` (share of a turn) of the drive; at most `most` points, the first.
/// `period`: samples; `half_width`: m of each coordinate.
pub fn section(record: &[Trajectory<'_>], turns: f64, period: f64, half_width: &[usize], most: usize) -> Section {
    let coordinates = record.first().map_or(0, |s| s.tracks.len());
    let mut out = Section {
        tau: turns * std::f64::consts::TAU,
        value: vec![Vec::new(); coordinates],
        velocity: vec![Vec::new(); coordinates],
    };
    let widest = half_width.iter().copied().max().unwrap_or(1).max(2);
    let mut taken = 0;
    for s in record {
        let n = s.tracks.iter().map(|t| t.values.len()).min().unwrap_or(0);
        let first = (turns - s.phase).rem_euclid(1.0) * period;
        for p in 0.. {
            let t = first + p as f64 * period;
            let i = t.floor() as usize;
            if i + widest + 3 > n || taken >= most {
                break;
            }
            if i < widest {
                continue;
            }
            taken += 1;
            for (c, track) in s.tracks.iter().enumerate() {
                let x = track.values;
                let v: f64 = lagrange(t - i as f64).iter().zip(&x[i - 1..i + 3]).map(|(a, b)| a * b).sum();
                let m = half_width.get(c).copied().unwrap_or(1).clamp(1, widest);
                let centre = if t - i as f64 > 0.5 { i + 1 } else { i };
                let slope: f64 = (1..=m).map(|k| k as f64 * (x[centre + k] - x[centre - k])).sum();
                let squares: f64 = (1..=m).map(|k| 2.0 * (k * k) as f64).sum();
                out.value[c].push(if track.angle { crate::signal::angles::wrap(v) } else { v } as f32);
                out.velocity[c].push((slope / squares / s.step_s) as f32);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::unstable_periodic_orbit::Track;
    use super::*;

    #[test]
    fn a_periodic_orbit_is_one_point_at_any_phase() {
        let (period, phase) = (40.7, 0.3);
        let tau = |i: f64| std::f64::consts::TAU * (i / period + phase);
        let x: Vec<f64> = (0..1000).map(|i| tau(f64::from(i)) + 0.5 * tau(f64::from(i)).sin()).collect();
        let s = Trajectory {
            tracks: vec![Track { values: &x, angle: true, span: 6.3 }],
            start_s: 0.0,
            step_s: 0.01,
            phase,
        };
        for turns in [0.0, 0.25, 0.9] {
            let found = section(std::slice::from_ref(&s), turns, period, &[2], 100);
            assert!((22..=25).contains(&found.value[0].len()));
            let t = std::f64::consts::TAU * turns;
            let rate = std::f64::consts::TAU / period / 0.01;
            for (v, w) in found.value[0].iter().zip(&found.velocity[0]) {
                let d = f64::from(*v) - t - 0.5 * t.sin();
                assert!((d / std::f64::consts::TAU - (d / std::f64::consts::TAU).round()).abs() < 1e-5, "{v} {turns}");
                // Half a sample off at most, and a slope over five.
                assert!((f64::from(*w) / rate - 1.0 - 0.5 * t.cos()).abs() < 0.05, "{w} {turns}");
            }
        }
        assert_eq!(section(std::slice::from_ref(&s), 0.0, period, &[2], 7).value[0].len(), 7);
        assert!(section(&[], 0.0, period, &[], 7).value.is_empty());
    }
}

//! Catalogue of extracted orbits: near-identical ones merged, each with period, closing error and
//! whirling numbers, and what share of the motion they cover.
//!
//! An orbit is sampled at [`POINTS`] phases of the drive a period, from phase 0, so that two of
//! period k compare point by point at k shifts by whole periods. The distance of two is the
//! largest, over points, coordinates and both delays, of the difference on the circle in spans.
//! Whirling number of an angle: its whole turns over the orbit, (θ(t + kT) − θ(t))/2π.

use serde::Serialize;
use std::f64::consts::TAU;

use super::unstable_periodic_orbit::{Closing, Settings, Trajectory, lagrange};

/// Points a drive period at which orbits are compared.
pub const POINTS: usize = 16;
/// Most states looked at for the coverage.
const STATES: usize = 20_000;

/// A distinct orbit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Orbit {
    /// Period k, drive periods.
    pub period: usize,
    /// Time at which its best closing stretch starts, s.
    pub start_s: f64,
    /// Closing error, share of the span.
    pub error: f64,
    /// Whole turns over the orbit, one for each coordinate; none for a coordinate that is no angle.
    pub turns: Vec<Option<i64>>,
    /// Closing stretches that are this orbit.
    pub seen: usize,
    /// Stretch of the record and sample where it starts.
    pub place: (usize, usize),
}

/// Orbits with their points.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    /// The orbits.
    pub orbits: Vec<Orbit>,
    /// Points of each: `period · POINTS` states of `2 · coordinates` values.
    pub points: Vec<Vec<Vec<f64>>>,
}

/// Value at a real sample.
pub(super) fn at(x: &[f64], t: f64) -> f64 {
    let i = (t.floor() as usize).clamp(1, x.len().saturating_sub(3).max(1));
    match x.get(i - 1..i + 3) {
        Some(w) => lagrange(t - i as f64).iter().zip(w).map(|(a, b)| a * b).sum(),
        None => x.first().copied().unwrap_or(0.0),
    }
}

/// States at phases 0, 1/POINTS, … of the drive; the piece is closed upon itself.
fn states(stretch: &Trajectory<'_>, c: &Closing, settings: &Settings) -> Vec<Vec<f64>> {
    let phase = (stretch.phase + c.start as f64 / settings.period).rem_euclid(1.0);
    (0..c.period * POINTS)
        .map(|s| {
            let periods = (s as f64 / POINTS as f64 - phase).rem_euclid(c.period as f64);
            let t = c.start as f64 + periods * settings.period;
            let pair = |v: &[f64]| [at(v, t), at(v, t + settings.delay as f64)];
            stretch.tracks.iter().flat_map(|k| pair(k.values)).collect()
        })
        .collect()
}

/// Whether all points of `a` lie within `limit` (spans) of those of `b`, `shift` points later.
fn alike(stretch: &Trajectory<'_>, a: &[Vec<f64>], b: &[Vec<f64>], shift: usize, limit: f64) -> bool {
    (0..a.len()).all(|s| within(stretch, &a[s], &b[(s + shift) % b.len()], limit))
}

fn within(stretch: &Trajectory<'_>, a: &[f64], b: &[f64], limit: f64) -> bool {
    stretch
        .tracks
        .iter()
        .enumerate()
        .all(|(i, t)| t.difference(a[2 * i] - b[2 * i]) < limit && t.difference(a[2 * i + 1] - b[2 * i + 1]) < limit)
}

/// Merges closing stretches, given by period 1, 2, …, best first.
pub fn catalogue(record: &[Trajectory<'_>], closing: &[Vec<Closing>], settings: &Settings) -> Catalogue {
    let mut out = Catalogue::default();
    let limit = settings.merge * settings.tolerance;
    for c in closing.iter().flatten() {
        let Some(stretch) = record.get(c.stretch) else { continue };
        let points = states(stretch, c, settings);
        // A shorter orbit gone round several times, or one that is known.
        let known = (0..out.orbits.len()).find(|o| {
            let k = out.orbits[*o].period;
            c.period.is_multiple_of(k) && (0..k).any(|j| alike(stretch, &points, &out.points[*o], j * POINTS, limit))
        });
        if let Some(o) = known {
            out.orbits[o].seen += 1;
            continue;
        }
        let repeats = (1..c.period)
            .filter(|j| c.period.is_multiple_of(*j))
            .any(|j| alike(stretch, &points, &points, j * POINTS, settings.tolerance));
        if repeats {
            continue;
        }
        let end = c.start as f64 + c.period as f64 * settings.period;
        let turns = stretch
            .tracks
            .iter()
            .map(|t| t.angle.then(|| ((at(t.values, end) - t.values[c.start]) / TAU).round() as i64))
            .collect();
        out.orbits.push(Orbit {
            period: c.period,
            start_s: stretch.start_s + c.start as f64 * stretch.step_s,
            error: c.error,
            turns,
            seen: 1,
            place: (c.stretch, c.start),
        });
        out.points.push(points);
    }
    out
}

/// Share of the record's states within the tolerance of an orbit's point at the same phase of the
/// drive.
pub fn coverage(record: &[Trajectory<'_>], catalogue: &Catalogue, settings: &Settings) -> f64 {
    let length = |s: &Trajectory<'_>| s.tracks.iter().map(|t| t.values.len()).min().unwrap_or(0);
    let periods: f64 = record.iter().map(|s| length(s) as f64 / settings.period).sum();
    // One state at some phase of each period, phases in turn; a whole number of states a period in
    // short records.
    let each = ((STATES as f64 / periods.max(1.0)) as usize).clamp(1, POINTS);
    let (mut covered, mut all) = (0usize, 0usize);
    for stretch in record {
        let n = length(stretch);
        let offset = (-stretch.phase).rem_euclid(1.0);
        for p in 0.. {
            let mut inside = false;
            for e in 0..each {
                let s = (e * POINTS / each + p) % POINTS;
                let t = (p as f64 + offset + s as f64 / POINTS as f64) * settings.period;
                if t + settings.delay as f64 + 3.0 > n as f64 {
                    continue;
                }
                inside = true;
                let state: Vec<f64> = stretch
                    .tracks
                    .iter()
                    .flat_map(|k| [at(k.values, t), at(k.values, t + settings.delay as f64)])
                    .collect();
                all += 1;
                let near = |orbit: &Vec<Vec<f64>>| {
                    orbit.iter().skip(s).step_by(POINTS).any(|b| within(stretch, &state, b, settings.tolerance))
                };
                covered += usize::from(catalogue.points.iter().any(near));
            }
            if !inside {
                break;
            }
        }
    }
    covered as f64 / all.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::unstable_periodic_orbit::Track;
    use super::*;

    #[test]
    fn one_orbit_seen_from_any_phase_is_one() {
        // Period 2 of T = 25.4 samples, whirling once in two periods; starts at many phases.
        let settings = Settings { tolerance: 0.02, longest: 4, merge: 2.0, delay: 6, period: 25.4, most: 99 };
        let x: Vec<f64> = (0..2000)
            .map(|i| {
                let t = TAU * (f64::from(i) / 25.4 + 0.4);
                0.5 * t + 0.4 * t.sin() + 0.2 * (0.5 * t).cos()
            })
            .collect();
        let stretch = Trajectory {
            tracks: vec![Track { values: &x, angle: true, span: TAU }],
            start_s: 3.0,
            step_s: 0.002,
            phase: 0.4,
        };
        let piece = |start, period| Closing { stretch: 0, start, period, error: 1e-6 };
        let twos: Vec<Closing> = [10, 17, 36, 61, 400, 1111].map(|n| piece(n, 2)).to_vec();
        let found = catalogue(std::slice::from_ref(&stretch), &[vec![], twos, vec![], vec![piece(5, 4)]], &settings);
        assert_eq!(found.orbits.len(), 1, "{:?}", found.orbits);
        let o = &found.orbits[0];
        assert_eq!((o.period, o.seen, o.turns.clone()), (2, 7, vec![Some(1)]));
        assert!((o.start_s - 3.02).abs() < 1e-12);
        assert_eq!(coverage(std::slice::from_ref(&stretch), &found, &settings), 1.0);
        assert_eq!(coverage(&[stretch], &Catalogue::default(), &settings), 0.0);
    }
}

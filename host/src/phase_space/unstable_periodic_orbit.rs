//! Unstable periodic orbits of a driven record: a stretch of k drive periods that nearly closes,
//! (3.24): ‖s_i(t) − s_i(t + kT)‖ < e · span_i for every coordinate i, with s_i(t) = [θ_i(t),
//! θ_i(t + T_d)] and distances on the circle.
//!
//! Times within the tolerance come in runs; each run gives its best closing stretch. A stretch that
//! repeats a shorter orbit is counted under that one, and near-identical ones are merged
//! (`orbit_catalogue`). kT need not be a whole number of samples: later values are four-point
//! Lagrange interpolations.
//!
//! The closing error of an extracted orbit is what remains of its distance from the true unstable
//! orbit, times about 1/(|multiplier| − 1). Cost: one comparison a sample and period.

use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;
use std::ops::Range;

use super::orbit_catalogue::{self, Orbit};

/// A coordinate of the record.
#[derive(Clone, Copy, Debug)]
pub struct Track<'a> {
    /// Unwrapped values of one stretch.
    pub values: &'a [f64],
    /// Whether it is an angle, rad.
    pub angle: bool,
    /// What tolerances are shares of: the span of the data, at most 2π for an angle.
    pub span: f64,
}

impl Track<'_> {
    /// Difference of two values, on the circle for an angle, in spans.
    pub fn difference(&self, d: f64) -> f64 {
        let d = if self.angle { d - TAU * (d / TAU).round() } else { d };
        d.abs() / self.span
    }
}

/// The coordinates over one unbroken stretch of a record.
#[derive(Clone, Debug)]
pub struct Trajectory<'a> {
    /// Coordinates, of equal length.
    pub tracks: Vec<Track<'a>>,
    /// Time of its first sample, s.
    pub start_s: f64,
    /// Sampling step, s.
    pub step_s: f64,
    /// Drive phase of its first sample, turns.
    pub phase: f64,
}

/// Choices of an extraction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// e, share of the span. Default 0.05; the seed uses 0.01 to 0.05, and 0.08 where too few are
    /// found.
    pub tolerance: f64,
    /// Longest period looked for, drive periods. Default 16.
    pub longest: usize,
    /// Two orbits are one where they lie nowhere farther apart than so many tolerances. Default 2.
    pub merge: f64,
    /// Delay T_d, samples.
    pub delay: usize,
    /// Drive period, samples.
    pub period: f64,
    /// Most stretches of one period that are looked at, the best closing ones. Default 2000.
    pub most: usize,
}

/// Outcome of an extraction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Extraction {
    /// Choices.
    pub settings: Settings,
    /// Distinct orbits, by period, then by closing error.
    pub orbits: Vec<Orbit>,
    /// Closing stretches found, before merging.
    pub recurrences: usize,
    /// Share of the record's states that lie within the tolerance of some orbit at the same phase
    /// of the drive.
    pub coverage: f64,
}

/// A stretch that closes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closing {
    /// Stretch of the record.
    pub stretch: usize,
    /// First sample.
    pub start: usize,
    /// Period k.
    pub period: usize,
    /// Largest over the coordinates of ‖s_i(t) − s_i(t + kT)‖/span_i.
    pub error: f64,
}

/// Four-point Lagrange weights at a fraction u past the second point.
pub fn lagrange(u: f64) -> [f64; 4] {
    [
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    ]
}

/// Extracts all orbits of periods 1 … `settings.longest`.
pub fn extract(record: &[Trajectory<'_>], settings: &Settings) -> Extraction {
    let periods: Vec<usize> = (1..=settings.longest).collect();
    let closing: Vec<Vec<Closing>> = periods
        .par_iter()
        .map(|k| {
            let mut found: Vec<Closing> =
                record.iter().enumerate().flat_map(|(i, s)| closing_runs(i, s, *k, settings)).collect();
            found.sort_by(|a, b| a.error.total_cmp(&b.error).then((a.stretch, a.start).cmp(&(b.stretch, b.start))));
            found.truncate(settings.most);
            found
        })
        .collect();
    let recurrences = closing.iter().map(Vec::len).sum();
    let catalogue = orbit_catalogue::catalogue(record, &closing, settings);
    let coverage = orbit_catalogue::coverage(record, &catalogue, settings);
    Extraction { settings: *settings, orbits: catalogue.orbits, recurrences, coverage }
}

/// The best closing stretch of each run of times within the tolerance.
fn closing_runs(index: usize, stretch: &Trajectory<'_>, k: usize, settings: &Settings) -> Vec<Closing> {
    let lag = k as f64 * settings.period;
    let (whole, weights) = (lag.floor() as usize, lagrange(lag - lag.floor()));
    let samples = stretch.tracks.iter().map(|t| t.values.len()).min().unwrap_or(0);
    let last = samples.saturating_sub(whole + settings.delay + 3);
    let error = |n: usize| {
        let mut worst: f64 = 0.0;
        for t in &stretch.tracks {
            let part = |m: usize| {
                let w = &t.values[m + whole - 1..m + whole + 3];
                let later = weights.iter().zip(w).map(|(a, b)| a * b).sum::<f64>();
                t.difference(later - t.values[m])
            };
            let first = part(n);
            // Most times fail in the first coordinate already.
            if first >= settings.tolerance {
                return f64::INFINITY;
            }
            worst = worst.max(first.hypot(part(n + settings.delay)));
        }
        worst
    };
    let mut out = Vec::new();
    let mut best: Option<Closing> = None;
    let mut run: Range<usize> = 0..0;
    // A lag below one sample has no sample before it.
    for start in usize::from(whole == 0)..last {
        let e = error(start);
        if e < settings.tolerance {
            run = run.start..start;
            if best.is_none_or(|b| e < b.error) {
                best = Some(Closing { stretch: index, start, period: k, error: e });
            }
        } else if let Some(b) = best.take() {
            out.push(b);
        }
    }
    out.extend(best);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const T: f64 = 20.3;

    fn tracks<'a>(x: &'a [f64], y: &'a [f64]) -> Trajectory<'a> {
        Trajectory {
            tracks: vec![Track { values: x, angle: true, span: TAU }, Track { values: y, angle: false, span: 2.0 }],
            start_s: 0.0,
            step_s: 0.01,
            phase: 0.25,
        }
    }

    fn settings() -> Settings {
        Settings { tolerance: 0.02, longest: 8, merge: 2.0, delay: 5, period: T, most: 2000 }
    }

    /// A record that follows a whirling period-1, then a period-3 orbit, with wandering between.
    fn record() -> (Vec<f64>, Vec<f64>) {
        let tau = |i: usize| TAU * (i as f64 / T + 0.25);
        (0..4000)
            .map(|i| {
                let t = tau(i);
                match i {
                    500..800 => (t + 0.3 * t.sin(), t.cos()),
                    1500..2100 => (1.0 + 0.8 * (t / 3.0).sin(), (t / 3.0).cos() * 0.7 + 0.3 * t.sin()),
                    _ => {
                        let w = 1e-4 * (i * i) as f64;
                        (2.0 * (0.61 * w).sin() + w, (0.37 * w + 0.1 * t).cos())
                    }
                }
            })
            .unzip()
    }

    #[test]
    fn finds_each_orbit_once_with_its_turns() {
        let (x, y) = record();
        let found = extract(&[tracks(&x, &y)], &settings());
        let seen: Vec<(usize, Vec<i64>)> = found
            .orbits
            .iter()
            .filter(|o| o.error < 1e-4)
            .map(|o| (o.period, o.turns.iter().map(|t| t.unwrap_or(-9)).collect()))
            .collect();
        assert_eq!(seen, [(1, vec![1, -9]), (3, vec![0, -9])], "{:?}", found.orbits);
        assert!(found.recurrences >= 2 && found.coverage > 0.15 && found.coverage < 0.6, "{}", found.coverage);
    }

    #[test]
    fn closing_is_3_24_by_hand() {
        let (x, y) = record();
        let s = tracks(&x, &y);
        let set = settings();
        for c in closing_runs(0, &s, 2, &set) {
            let at = |v: &[f64], t: f64| {
                let i = t.floor() as usize;
                lagrange(t - t.floor()).iter().zip(&v[i - 1..i + 3]).map(|(a, b)| a * b).sum::<f64>()
            };
            let n = c.start;
            let d = |v: &[f64], m: usize| at(v, m as f64 + 2.0 * T) - v[m];
            let on_circle = |d: f64| (d.sin().atan2(d.cos())).abs() / TAU;
            let first = on_circle(d(&x, n)).hypot(on_circle(d(&x, n + 5)));
            let second = (d(&y, n) / 2.0).hypot(d(&y, n + 5) / 2.0);
            assert!((first.max(second) - c.error).abs() < 1e-12 && c.error < 0.02);
        }
    }

    #[test]
    fn short_or_empty_stretches_have_none() {
        let x = [0.0; 30];
        let found = extract(&[tracks(&x, &x), tracks(&[], &[])], &settings());
        assert!(found.orbits.iter().all(|o| o.period == 1));
        assert!(extract(&[], &settings()).orbits.is_empty());
    }
}

//! A drive's frequency from the motion alone: a line that stands over the whole record.
//!
//! What is locked to a drive makes a line as narrow as the record is long, whose phase goes on from its beginning to its end, and which does
//! not die away; a free motion's lines wander with its amplitude. Looked at are the squares of the angles' velocities, which keep the line of a
//! vertical drive in chaos (see [`crate::inspect::drive_check`]), and the velocities themselves. Neither needs the angles' scale.

use super::columns::{Kind, Seen};
use super::raw::{Raw, nice};
use super::{DraftDrive, Statement};
use crate::inspect::motion;
use crate::report::format::significant;
use crate::rig::Direction;
use crate::signal::spectrum::{self, Density};

/// Parts of a record in each of which the line must be.
const PARTS: usize = 6;
/// Resultant of the parts' phases, in units of the sum of their amplitudes, from which they go on.
const COHERENT: f64 = 0.8;
/// Least amplitude in the last half over that in the first.
const LASTS: f64 = 0.5;
/// Score from which a line is one: standard deviations above the other bins.
const CLEAR: f64 = 8.0;
/// Fewest drive periods in a record.
const PERIODS: f64 = 30.0;
/// Lines that are looked at.
const MOST: usize = 12;

/// The drive of a record; none where no line stands.
pub(super) fn find(raw: &Raw, seen: &[Seen]) -> Option<DraftDrive> {
    let stretch = (0..raw.record.segments.len()).max_by_key(|s| raw.record.segments[*s].len())?;
    let segment = &raw.record.segments[stretch];
    let rate = 1.0 / segment.step_s;
    if let Some(hz) = crate::inspect::drive_check::phase_frequency(&raw.record).filter(|f| *f > 0.0) {
        let why = Statement::new("drive", format!("{} Hz", nice(hz, 1e-7)), "the device recorded the drive's phase");
        return Some(DraftDrive { direction: Direction::Vertical, frequency_hz: nice(hz, 1e-7), why: vec![why] });
    }
    let angles: Vec<&Seen> = seen.iter().filter(|s| s.kind == Kind::Angle).collect();
    let velocities: Vec<Vec<f64>> =
        angles.iter().filter_map(|s| Some(velocity(raw.values(s.index).get(stretch)?, s))).collect();
    let squares: Vec<Vec<f64>> = velocities.iter().map(|v| v.iter().map(|v| v * v).collect()).collect();
    let even = line(&squares, rate);
    let odd = line(&velocities, rate);
    let (hz, direction, why) = match (even, odd) {
        // Under a horizontal drive the velocity has the drive's line and its square twice that.
        (even, Some(odd))
            if even.is_none_or(|e| near(e.hz, 2.0 * odd.hz, odd.resolution) || odd.score > 2.0 * e.score) =>
        {
            (odd, Direction::Horizontal, "the velocity has it")
        }
        (Some(even), _) => (even, Direction::Vertical, "the square of the velocity has it"),
        (None, _) => return None,
    };
    let f = nice(hz.hz, 0.05 * hz.resolution / hz.hz);
    let text = format!(
        "a line at {} Hz stands over the whole record in one phase ({why}; {} standard deviations above its surroundings)",
        significant(hz.hz, 6),
        significant(hz.score, 2)
    );
    let direction_why = match direction {
        Direction::Horizontal => {
            "a motion that goes once to and fro in a drive period; a vertical drive of twice the frequency may do the same"
        }
        Direction::Vertical => "a line in the square of the velocity alone is what a vertical drive leaves",
    };
    Some(DraftDrive {
        direction,
        frequency_hz: f,
        why: vec![
            Statement::new("drive", format!("{f} Hz"), text),
            Statement::new(
                "drive",
                if direction == Direction::Vertical { "vertical" } else { "horizontal" },
                direction_why,
            )
            .to_check(),
        ],
    })
}

/// Velocity in the column's units a second, turns undone.
fn velocity(values: &[f64], seen: &Seen) -> Vec<f64> {
    let turn = match (seen.unit, seen.counts) {
        ("rad", _) => core::f64::consts::TAU,
        ("deg", _) => 360.0,
        (_, Some(n)) => f64::from(n),
        _ => f64::INFINITY,
    } / seen.factor.abs();
    let mut x = values.to_vec();
    if turn.is_finite() {
        x.iter_mut().for_each(|x| *x *= core::f64::consts::TAU / turn);
        motion::unwrap(&mut x);
    }
    x.windows(2).map(|w| w[1] - w[0]).collect()
}

/// A line that stands.
#[derive(Clone, Copy, Debug)]
struct Line {
    hz: f64,
    score: f64,
    resolution: f64,
}

fn near(a: f64, b: f64, resolution: f64) -> bool {
    (a - b).abs() < 1.5 * resolution
}

/// The line with the greatest score that stands in all series together.
fn line(series: &[Vec<f64>], rate: f64) -> Option<Line> {
    let piece = spectrum::fast_length(series.iter().map(Vec::len).min()?);
    let densities: Vec<Density> =
        series.iter().filter_map(|x| spectrum::welch(&[x.get(..piece)?], rate, piece).ok()).collect();
    let bin_hz = densities.first()?.bin_hz;
    let (from, to) = (PERIODS as usize, (0.1 * rate / bin_hz) as usize);
    if to < from + 50 {
        return None;
    }
    let sums: Vec<f64> = (from..=to)
        .map(|m| {
            let over = |d: &Density| d.density[m] / spectrum::surroundings(&d.density, m, 24).max(f64::MIN_POSITIVE);
            densities.iter().map(|d| over(d).ln_1p()).sum()
        })
        .collect();
    let middle = spectrum::median(&mut sums.clone());
    let spread = 1.4826 * spectrum::median(&mut sums.iter().map(|s| (s - middle).abs()).collect::<Vec<_>>());
    let mut order: Vec<usize> = (0..sums.len()).collect();
    order.sort_by(|a, b| sums[*b].total_cmp(&sums[*a]));
    let score = |i: usize| (sums[i] - middle) / spread.max(1e-9);
    order.into_iter().take(MOST).filter(|i| score(*i) > CLEAR).find_map(|i| {
        let lines = densities.iter().enumerate().filter_map(|(k, d)| Some((k, spectrum::line_at(d, from + i)?)));
        let (k, best) = lines.max_by(|a, b| a.1.prominence.total_cmp(&b.1.prominence))?;
        let hz = stands(&series[k], rate, best.frequency_hz)?;
        Some(Line { hz, score: score(i), resolution: bin_hz })
    })
}

/// The frequency of a line that goes on in one phase over all parts of a series; none where it does not.
fn stands(x: &[f64], rate: f64, hz: f64) -> Option<f64> {
    let length = x.len() / PARTS;
    let turn = |f: f64, k: usize| core::f64::consts::TAU * (f * (k * length) as f64 / rate).fract();
    let mut f = hz;
    let mut parts = Vec::new();
    // The phase's slope over the parts is what the frequency is off by.
    for _ in 0..3 {
        parts = (0..PARTS)
            .map(|k| {
                let a = spectrum::amplitude_at(&x[k * length..(k + 1) * length], rate, f);
                let (s, c) = turn(f, k).sin_cos();
                (a.re * c + a.im * s, a.im * c - a.re * s)
            })
            .collect::<Vec<(f64, f64)>>();
        let slope = parts.windows(2).fold((0.0, 0.0), |(re, im), w| {
            (re + w[0].0 * w[1].0 + w[0].1 * w[1].1, im + w[0].0 * w[1].1 - w[0].1 * w[1].0)
        });
        f += slope.1.atan2(slope.0) / core::f64::consts::TAU * rate / length as f64;
    }
    let sizes: Vec<f64> = parts.iter().map(|p| p.0.hypot(p.1)).collect();
    let resultant = parts.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
    let (first, last): (f64, f64) = (sizes[..PARTS / 2].iter().sum(), sizes[PARTS / 2..].iter().sum());
    let coherent = resultant.0.hypot(resultant.1) >= COHERENT * sizes.iter().sum::<f64>();
    (coherent && last >= LASTS * first && (f - hz).abs() < rate / length as f64).then_some(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_line_that_stands_is_told_from_one_that_dies_or_wanders() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut noise = || random.random::<f64>() - 0.5;
        let rate = 200.0;
        let n = 20_000;
        let t = |i: usize| i as f64 / rate;
        let stand: Vec<f64> = (0..n).map(|i| 0.3 * (31.4 * t(i)).sin() + 2.0 * noise()).collect();
        let found = line(&[stand], rate).unwrap();
        assert!((found.hz - 31.4 / core::f64::consts::TAU).abs() < 0.1 * found.resolution, "{found:?}");
        let dies: Vec<f64> = (0..n).map(|i| (-0.05 * t(i)).exp() * (31.4 * t(i)).sin() + 0.1 * noise()).collect();
        assert!(line(&[dies], rate).is_none());
        let wanders: Vec<f64> = (0..n).map(|i| (31.4 * t(i) + 0.02 * t(i).powi(2)).sin() + 0.1 * noise()).collect();
        assert!(line(&[wanders], rate).is_none());
        let nothing: Vec<f64> = (0..n).map(|_| noise()).collect();
        assert!(line(&[nothing], rate).is_none());
    }
}

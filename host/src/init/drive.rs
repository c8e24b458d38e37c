//! A drive's frequency from the motion alone: a line that stands over the whole record.
//!
//! What is locked to a drive makes a line as narrow as the record is long, whose phase goes on from
//! its beginning to its end, and which does not die away; a free motion's lines wander with its
//! amplitude. The equations of motion decide which of them is one ([`super::settle`]). Looked at
//! are the squares of the angles' velocities, which keep the line of a vertical drive in chaos (see
//! [`crate::inspect::drive_check`]), and the velocities themselves. Neither needs the angles'
//! scale.

use super::columns::{Kind, Seen};
use super::raw::{Raw, nice};
use super::{DraftDrive, Statement};
use crate::error::{BadInput, Result};
use crate::inspect::motion;
use crate::rig::{Direction, MOST_A_PERIOD, RATES};
use crate::signal::spectrum::{self, Density};
use crate::statistics::median;
use crate::wording::format::{shortest, significant};

/// Parts of a record in each of which the line must be.
const PARTS: usize = 6;
/// Resultant of the parts' phases, in units of the sum of their amplitudes, from which they go on.
const COHERENT: f64 = 0.8;
/// Least amplitude in the last half over that in the first.
const LASTS: f64 = 0.5;
/// Score from which a line is one: standard deviations above the other bins.
const CLEAR: f64 = 5.0;
/// A motion whose span shrinks by this factor from each part to the next dies away, until it is at
/// rest at this share of its first span.
const SHRINKS: f64 = 0.98;
const AT_REST: f64 = 0.02;
/// Fewest drive periods in a record.
const PERIODS: f64 = 30.0;
/// Lines that are looked at, and the bins within which two are one.
const MOST: usize = 12;
const APART: usize = 3;
/// Of those, how many may stand for a vertical drive, and for a horizontal one.
const MOST_EVEN: usize = 4;
const MOST_ODD: usize = 2;

/// What may drive a record.
#[derive(Debug, Default)]
pub(super) struct Drives {
    /// The drive whose phase the device recorded.
    pub known: Option<DraftDrive>,
    /// Drives that would make the lines of the motion's spectrum, the clearest lines first: the
    /// equations of motion decide.
    pub possible: Vec<DraftDrive>,
    /// Whether there may be one without a line.
    pub may_hide: bool,
}

/// The drive that a person names.
///
/// # Errors
/// A frequency that a record of this rate cannot have.
pub(super) fn told(hz: f64, rate_hz: f64) -> Result<Drives> {
    // What a rig file may have: see `rig::checks::drive`.
    let (least, most) = (RATES.start().max(rate_hz / MOST_A_PERIOD), rate_hz / 10.0);
    if hz != 0.0 && !(least..=most).contains(&hz) {
        let [least, most, rate] = [least, most, rate_hz].map(shortest);
        let expected = format!("0 (no drive), or {least} to {most} Hz, a tenth of the record's {rate} Hz");
        return Err(BadInput::new(format!("{hz}"), expected)
            .at("--drive-hz")
            .remedy("Say the frequency in Hz; a faster drive needs a record of a higher rate"));
    }
    let why = vec![
        Statement::new("drive", format!("{hz} Hz"), "--drive-hz says so"),
        Statement::new("drive", "vertical", "most drives of pendulums are").unsure(),
    ];
    let known = DraftDrive { direction: Direction::Vertical, frequency_hz: hz, why };
    Ok(Drives { known: (hz > 0.0).then_some(known), ..Drives::default() })
}

/// Looks for the drive of a record.
pub(super) fn find(raw: &Raw, seen: &[Seen]) -> Drives {
    if let Some(hz) = crate::inspect::drive_check::phase_frequency(&raw.record).filter(|f| *f > 0.0) {
        let why = Statement::new("drive", format!("{} Hz", nice(hz, 1e-7)), "the device recorded the drive's phase");
        let known = DraftDrive { direction: Direction::Vertical, frequency_hz: nice(hz, 1e-7), why: vec![why] };
        return Drives { known: Some(known), ..Drives::default() };
    }
    let Some(stretch) = (0..raw.record.segments.len()).max_by_key(|s| raw.record.segments[*s].len()) else {
        return Drives::default();
    };
    let rate = 1.0 / raw.record.segments[stretch].step_s;
    let angles = seen.iter().filter(|s| s.kind == Kind::Angle);
    let angles: Vec<Vec<f64>> = angles.filter_map(|s| Some(unwrapped(raw.values(s.index).get(stretch)?, s))).collect();
    // A free decay's own line is narrow enough, and a drive at it hides what the equations miss.
    if !angles.is_empty() && angles.iter().all(|x| dies_away(x)) {
        return Drives::default();
    }
    let velocities: Vec<Vec<f64>> = angles.iter().map(|x| x.windows(2).map(|w| w[1] - w[0]).collect()).collect();
    let squares: Vec<Vec<f64>> = velocities.iter().map(|v| v.iter().map(|v| v * v).collect()).collect();
    let even = lines(&squares, rate).into_iter().take(MOST_EVEN);
    let odd = lines(&velocities, rate).into_iter().take(MOST_ODD);
    let even = even.map(|l| of_line(&l, Direction::Vertical, "the square of the velocity has it"));
    // Under a horizontal drive the velocity has the drive's line.
    let odd = odd.map(|l| of_line(&l, Direction::Horizontal, "the velocity has it"));
    Drives { known: None, possible: even.chain(odd).collect(), may_hide: !angles.is_empty() }
}

/// The drive that a line would stand for.
fn of_line(line: &Line, direction: Direction, why: &str) -> DraftDrive {
    let f = nice(line.hz, 0.05 * line.resolution / line.hz);
    let phase = if line.stands { " stands over the whole record in one phase" } else { "" };
    let text = format!(
        "a line at {} Hz{phase} ({why}; {} standard deviations above its surroundings)",
        significant(line.hz, 6),
        significant(line.score, 2)
    );
    let (name, direction_why) = match direction {
        Direction::Horizontal => (
            "horizontal",
            "a motion that goes once to and fro in a drive period; a vertical drive of twice the frequency may do the same",
        ),
        Direction::Vertical => ("vertical", "a line in the square of the velocity is what a vertical drive leaves"),
    };
    let why =
        vec![Statement::new("drive", format!("{f} Hz"), text), Statement::new("drive", name, direction_why).unsure()];
    DraftDrive { direction, frequency_hz: f, why }
}

/// An angle with its turns undone: in rad where the column's turn is known, as it stands otherwise.
fn unwrapped(values: &[f64], seen: &Seen) -> Vec<f64> {
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
    x
}

/// Whether a motion is smaller in each part than in the one before: nothing drives it.
fn dies_away(x: &[f64]) -> bool {
    let length = x.len() / PARTS;
    if length < 2 {
        return false;
    }
    let span = |part: &[f64]| {
        let (least, most) = part.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
        most - least
    };
    let spans: Vec<f64> = x.chunks_exact(length).take(PARTS).map(span).collect();
    spans.windows(2).all(|w| w[1] < SHRINKS * w[0] || w[1] < AT_REST * spans[0])
}

/// A line that stands.
#[derive(Clone, Copy, Debug)]
struct Line {
    hz: f64,
    score: f64,
    resolution: f64,
    /// Whether it goes on in one phase and does not die away.
    stands: bool,
}

/// The lines of all series together: those that stand first, then by their score.
fn lines(series: &[Vec<f64>], rate: f64) -> Vec<Line> {
    let Some(piece) = series.iter().map(Vec::len).min().map(spectrum::fast_length) else { return Vec::new() };
    let densities: Vec<Density> =
        series.iter().filter_map(|x| spectrum::welch(&[x.get(..piece)?], rate, piece).ok()).collect();
    let Some(bin_hz) = densities.first().map(|d| d.bin_hz) else { return Vec::new() };
    let (from, to) = (PERIODS as usize, (0.1 * rate / bin_hz) as usize);
    if to < from + 50 {
        return Vec::new();
    }
    let sums: Vec<f64> = (from..=to)
        .map(|m| {
            let over = |d: &Density| d.density[m] / spectrum::surroundings(&d.density, m, 24).max(f64::MIN_POSITIVE);
            densities.iter().map(|d| over(d).ln_1p()).sum()
        })
        .collect();
    let middle = median(&mut sums.clone());
    let spread = 1.4826 * median(&mut sums.iter().map(|s| (s - middle).abs()).collect::<Vec<_>>());
    let mut order: Vec<usize> = (0..sums.len()).collect();
    order.sort_by(|a, b| sums[*b].total_cmp(&sums[*a]));
    let score = |i: usize| (sums[i] - middle) / spread.max(1e-9);
    let mut out: Vec<(usize, Line)> = Vec::new();
    for i in order.into_iter().take_while(|i| score(*i) > CLEAR) {
        if out.len() == MOST || out.iter().any(|(j, _)| i.abs_diff(*j) <= APART) {
            continue;
        }
        let found = densities.iter().enumerate().filter_map(|(k, d)| Some((k, spectrum::line_at(d, from + i)?)));
        let Some((k, best)) = found.max_by(|a, b| a.1.prominence.total_cmp(&b.1.prominence)) else { continue };
        let stands = stands(&series[k], rate, best.frequency_hz);
        let hz = stands.unwrap_or(best.frequency_hz);
        out.push((i, Line { hz, score: score(i), resolution: bin_hz, stands: stands.is_some() }));
    }
    out.sort_by_key(|(_, l)| !l.stands);
    out.into_iter().map(|(_, l)| l).collect()
}

/// The frequency of a line that goes on in one phase over all parts of a series; none where it does
/// not.
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
    fn a_drive_that_is_told_is_one_that_a_rig_file_may_have() {
        for (hz, is_driven) in [(0.0, false), (20.0, true), (0.01, true)] {
            assert_eq!(told(hz, 200.0).unwrap().known.is_some(), is_driven, "{hz}");
        }
        for hz in [50.0, 150.0, -5.0, f64::NAN, 1e-5] {
            let e = told(hz, 200.0).err().unwrap().to_string();
            assert!(
                e.starts_with("--drive-hz: ") && e.contains("0.0002 to 20 Hz, a tenth of the record's 200 Hz"),
                "{e}"
            );
        }
    }

    #[test]
    fn a_line_that_stands_is_told_from_one_that_dies_or_wanders() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut noise = || random.random::<f64>() - 0.5;
        let rate = 200.0;
        let n = 20_000;
        let t = |i: usize| i as f64 / rate;
        let stand: Vec<f64> = (0..n).map(|i| 0.3 * (31.4 * t(i)).sin() + 2.0 * noise()).collect();
        let found = lines(&[stand], rate)[0];
        assert!(found.stands && (found.hz - 31.4 / core::f64::consts::TAU).abs() < 0.1 * found.resolution, "{found:?}");
        let dies: Vec<f64> = (0..n).map(|i| (-0.05 * t(i)).exp() * (31.4 * t(i)).sin() + 0.1 * noise()).collect();
        assert!(lines(&[dies], rate).iter().all(|l| !l.stands));
        let wanders: Vec<f64> = (0..n).map(|i| (31.4 * t(i) + 0.02 * t(i).powi(2)).sin() + 0.1 * noise()).collect();
        assert!(lines(&[wanders], rate).iter().all(|l| !l.stands));
        let nothing: Vec<f64> = (0..n).map(|_| noise()).collect();
        assert!(lines(&[nothing], rate).iter().all(|l| !l.stands || l.score < 8.0));
    }

    #[test]
    fn what_dies_away_is_told_from_what_is_driven() {
        let rate = 100.0;
        let t = |i: usize| i as f64 / rate;
        let of = |size: &dyn Fn(f64) -> f64| (0..6000).map(|i| size(t(i)) * (5.3 * t(i)).cos()).collect::<Vec<f64>>();
        assert!(dies_away(&of(&|t| (-0.02 * t).exp())));
        // Dry friction: straight to rest, and there.
        assert!(dies_away(&of(&|t| (1.0 - t / 35.0).max(0.0))));
        assert!(!dies_away(&of(&|_| 1.0)));
        // A transient that ends in a driven motion.
        assert!(!dies_away(&of(&|t| 0.4 + (-0.2 * t).exp())));
        assert!(!dies_away(&[1.0; 5]));
    }
}

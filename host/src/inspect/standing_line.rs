//! Lines of a motion that stand over the whole record in one phase, as what is locked to a drive
//! does: as narrow as the record is long, and not dying away.

use super::motion::{self, Space};
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::spectrum::{self, Density};
use crate::statistics::median;
use crate::warning::Warning;
use crate::wording::format::to_digits_of;

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
/// Score from which a line alone, with no equations that ask for it, is told as a drive
/// (by hand).
const TOLD: f64 = 8.0;
/// Least rms velocity of the last half over that of the first of a motion that something drives (by
/// hand).
const KEEPS: f64 = 0.85;

/// A line that stands.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Frequency, Hz.
    pub hz: f64,
    /// Standard deviations above the other bins.
    pub score: f64,
    /// How finely the record tells frequencies apart, Hz.
    pub resolution: f64,
    /// Whether it goes on in one phase and does not die away.
    pub stands: bool,
}

/// The warning where a motion looks driven and the rig file has no drive; only of systems whose
/// equations have one.
pub fn not_stated(record: &Record, rig: &Rig) -> Option<Warning> {
    if rig.drive.is_some() || rig.base().is_some() || rig.pendulum().is_none() {
        return None;
    }
    let longest = (0..record.segments.len()).max_by_key(|s| record.segments[*s].len())?;
    let motions = motion::motions(record).into_iter().filter(|m| m.space == Space::S1);
    let angles: Vec<Vec<f64>> = motions.filter_map(|m| m.stretches.into_iter().nth(longest)).collect();
    let line = clearest(&angles, 1.0 / record.segments[longest].step_s)?;
    let hz = to_digits_of(line.hz, 0.1 * line.resolution);
    Some(
        Warning::new(
            "drive-not-stated",
            format!(
                "a line at {hz} Hz stands over the whole record in one phase, as a drive's does, and the motion does not die away; the rig file has no [drive]"
            ),
            format!(
                "If a shaker or motor runs, add [drive] with direction = \"vertical\" or \"horizontal\" and frequency_hz = {hz} to the rig file"
            ),
        )
        .with("frequency_hz", line.hz),
    )
}

/// The clearest line of angles that looks like a drive, at a rate in Hz: it stands, and the motion
/// keeps its size. None where nothing does.
pub fn clearest(angles: &[Vec<f64>], rate: f64) -> Option<Line> {
    if angles.is_empty() || angles.iter().all(|x| dies_away(x)) {
        return None;
    }
    let velocities: Vec<Vec<f64>> = angles.iter().map(|x| x.windows(2).map(|w| w[1] - w[0]).collect()).collect();
    let power = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
    let halves = velocities.iter().map(|v| v.split_at(v.len() / 2));
    let (first, last) = halves.fold((0.0, 0.0), |s, (a, b)| (s.0 + power(a), s.1 + power(b)));
    if last < KEEPS * KEEPS * first {
        return None;
    }
    let squares: Vec<Vec<f64>> = velocities.iter().map(|v| v.iter().map(|v| v * v).collect()).collect();
    // A vertical drive leaves its line in the squares, a horizontal one in the velocities.
    let told = |series: &[Vec<f64>]| lines(series, rate).into_iter().find(|l| l.stands && l.score > TOLD);
    told(&squares).or_else(|| told(&velocities))
}

/// Whether a motion is smaller in each part than in the one before: nothing drives it.
pub fn dies_away(x: &[f64]) -> bool {
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

/// The lines of all series together: those that stand first, then by their score.
pub fn lines(series: &[Vec<f64>], rate: f64) -> Vec<Line> {
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
    fn a_motion_that_keeps_its_size_at_a_standing_line_is_told() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let (rate, n) = (200.0, 20_000);
        let t = |i: usize| i as f64 / rate;
        let mut wander = 0.0;
        // A line beside a motion that wanders; the same, dying away.
        let driven: Vec<f64> = (0..n)
            .map(|i| {
                wander += 0.02 * (random.random::<f64>() - 0.5);
                wander + 0.1 * (core::f64::consts::TAU * 5.0 * t(i)).sin()
            })
            .collect();
        let found = clearest(std::slice::from_ref(&driven), rate).unwrap();
        assert!((found.hz - 5.0).abs() < 0.1 || (found.hz - 10.0).abs() < 0.1, "{found:?}");
        let dying: Vec<f64> = driven.iter().enumerate().map(|(i, x)| x * (-0.01 * t(i)).exp()).collect();
        assert!(clearest(&[dying], rate).is_none() && clearest(&[], rate).is_none());
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

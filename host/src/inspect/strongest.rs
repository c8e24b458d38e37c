//! Where most of a coordinate's motion is, for text and JSON alike: the strongest line of its
//! displacement, or the hump that stands above every line.
//!
//! A straight line is taken off each unbroken stretch, and Welch's density (Hann) is that of what
//! remains. Velocities would not do: they weigh what is fast, and of a slow swing that is read in
//! steps the sensor's noise is strongest in them. Only an arm that turns has no displacement with
//! a spectrum: there it is the velocity's.
//!
//! Pieces are doubled until they hold eight periods of what is strongest, up to the whole stretch:
//! a swing of two periods is no line in pieces that are shorter than a period. What does not stand
//! above the sensor's white noise, or has not one and a half periods in a piece, is no motion's
//! frequency. A line between two bins is found from the two greatest (`signal/spectrum.rs`).

use serde::Serialize;
use std::f64::consts::TAU;

use super::drive_check;
use super::motion::{Motion, Space};
use crate::signal::spectrum::{self, Density, Line};

/// Periods of what is strongest that a piece holds where the record is long enough.
const PERIODS: usize = 8;
/// Periods that a piece holds at least of what has a frequency at all: fewer are a drift.
const FEWEST_PERIODS: f64 = 1.5;
/// Samples of the longest piece: bounds the memory of long records.
const LONGEST: usize = 1 << 18;
/// What a line halfway between two bins has of the density that it had on one.
const BETWEEN: f64 = 0.7;

/// Where most of a coordinate's motion is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Strongest {
    /// A line's interpolated frequency, or the middle of a hump, Hz.
    pub frequency_hz: f64,
    /// Whether it is a hump rather than a line: a resonance that noise or many tones excite stands
    /// above every line without being one.
    pub broad: bool,
    /// `f_e`, `2 f_e`, `f_e/2`, … where a line belongs to the drive.
    pub name: Option<String>,
}

/// The strongest of a coordinate; none where nothing stands above its `noise`. `piece`: samples of
/// the first pieces; lines are named by fractions of the drive's frequency up to `denominator`.
pub fn find(
    motion: &Motion,
    noise: f64,
    rate_hz: f64,
    piece: usize,
    drive_hz: Option<f64>,
    denominator: u32,
) -> Option<Strongest> {
    let turns = motion.space == Space::S1 && motion.stretches.iter().any(|x| span(x) > TAU);
    let series: Vec<Vec<f64>> =
        if turns { motion.increments(rate_hz) } else { motion.stretches.iter().map(|x| detrended(x)).collect() };
    let parts: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
    let longest = parts.iter().map(|x| x.len()).max().unwrap_or(0).min(LONGEST);
    let mut piece = piece.min(longest);
    let density = loop {
        let mut d = spectrum::welch(&parts, rate_hz, piece).ok()?;
        if turns {
            for m in 0..d.density.len() {
                d.density[m] /= motion.response(d.frequency(m), rate_hz).powi(2);
            }
        }
        let top = (0..d.density.len()).max_by(|a, b| d.density[*a].total_cmp(&d.density[*b]))?;
        if top >= PERIODS || piece >= longest {
            break d;
        }
        piece = (2 * piece).min(longest);
    };
    // As in the coordinate's own spectrum: σ in x is 2σ²/f_s, and (2πf)² times that in its velocity.
    let floor = |f: f64| 2.0 * noise * noise / rate_hz * if turns { (TAU * f).powi(2) } else { 1.0 };
    let (frequency_hz, broad) = strongest_in(&density, floor)?;
    let belongs = |f: f64| drive_check::name(frequency_hz, f, 0.35 * density.bin_hz, denominator);
    Some(Strongest { frequency_hz, broad, name: drive_hz.filter(|_| !broad).and_then(belongs) })
}

/// Frequency of what is strongest above a floor, and whether it is broad.
fn strongest_in(d: &Density, floor: impl Fn(f64) -> f64) -> Option<(f64, bool)> {
    let p = &d.density;
    let limit = spectrum::threshold(d.averages, 1e-3 / p.len().max(1) as f64);
    let peaks: Vec<(usize, Line)> = (1..p.len().saturating_sub(1))
        .filter(|&m| p[m] > p[m - 1] && p[m] >= p[m + 1] && p[m] > limit * floor(d.frequency(m)))
        .filter_map(|m| Some((m, spectrum::line_at(d, m)?)))
        .filter(|(_, line)| line.frequency_hz >= FEWEST_PERIODS * d.bin_hz)
        .collect();
    let top = peaks.iter().map(|(_, line)| line.density).fold(0.0, f64::max);
    // A line between two bins has less density than one of its amplitude on a bin.
    let near = peaks.iter().filter(|(_, line)| line.density >= BETWEEN * top);
    let (m, line) = near.max_by(|a, b| a.1.amplitude.total_cmp(&b.1.amplitude))?;
    let broad = line.prominence <= limit;
    Some((if broad { middle(d, *m) } else { line.frequency_hz }, broad))
}

/// The middle of the hump around a bin, Hz: the mean over the bins of at least half its density, as
/// single bins of a hump scatter.
fn middle(d: &Density, top: usize) -> f64 {
    let near = top.saturating_sub(24).max(1)..(top + 25).min(d.density.len());
    let held = near.filter(|m| d.density[*m] >= 0.5 * d.density[top]);
    let (sum, weighted) = held.fold((0.0, 0.0), |(s, w), m| (s + d.density[m], w + d.density[m] * d.frequency(m)));
    weighted / sum
}

/// Greatest less least.
fn span(x: &[f64]) -> f64 {
    let (least, greatest) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), &x| (l.min(x), g.max(x)));
    greatest - least
}

/// A stretch without the straight line that fits it best.
fn detrended(x: &[f64]) -> Vec<f64> {
    let middle = 0.5 * (x.len() as f64 - 1.0);
    let from_middle = |i: usize| i as f64 - middle;
    let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
    let moment: f64 = (0..x.len()).map(|i| from_middle(i).powi(2)).sum();
    let along: f64 = x.iter().enumerate().map(|(i, x)| from_middle(i) * (x - mean)).sum();
    let slope = if moment > 0.0 { along / moment } else { 0.0 };
    x.iter().enumerate().map(|(i, x)| x - mean - slope * from_middle(i)).collect()
}

#[cfg(test)]
#[path = "strongest_tests.rs"]
mod tests;

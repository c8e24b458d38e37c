//! Whether the rig file's drive frequency is the record's.
//!
//! Chaos has a broad spectrum, but what is locked to the drive makes a line as narrow as the record is long. So the
//! periodogram of the longest unbroken stretch (Hann, one piece) is compared with its own surroundings at the frequency
//! named. A pendulum under a vertical drive is symmetric (φ → −φ), and chaos averages odd quantities over both signs:
//! the velocity of a chaotic record need have no line at the drive's frequency at all. Even quantities keep it, so cos x and
//! v² are looked at beside v ([`observables`]). Noise exceeds r times its median with probability 2⁻ʳ a bin. Where the
//! device recorded the drive's phase, its slope gives the frequency outright.

use serde::Serialize;

use super::motion::{Motion, Space};
use crate::record::Record;
use crate::signal::spectrum::{self, Line};

/// How much higher than its surroundings the drive's line must be: noise is so once in 2000 records.
const CLEAR: f64 = 16.0;
/// How much higher a line elsewhere must be to speak against the rig file: noise is so once in 10⁷ records.
const CLEAR_ELSEWHERE: f64 = 40.0;

/// What the record says of the drive's frequency.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveCheck {
    /// Frequency in the rig file, Hz.
    pub stated_hz: f64,
    /// Frequency from the device's own phase, Hz, where it was recorded.
    pub phase_hz: Option<f64>,
    /// Frequency of the record's line nearest to the stated one, Hz.
    pub line_hz: Option<f64>,
    /// That line's height over its surroundings.
    pub line_prominence: f64,
    /// The highest narrow line elsewhere, Hz, where there is one at no simple ratio to the stated frequency.
    pub other_hz: Option<f64>,
    /// Its height over its surroundings.
    pub other_prominence: f64,
    /// How finely this record tells frequencies apart, Hz: one over the longest unbroken stretch.
    pub resolution_hz: f64,
    /// True: the record has a line there. False: it has none there and a clear one elsewhere. None: it cannot tell.
    pub agrees: Option<bool>,
}

/// The drive's frequency from the device's phase: slope between first and last sample of the longest segment.
fn phase_frequency(record: &Record) -> Option<f64> {
    let segment = record.segments.iter().filter(|s| s.phase.is_some()).max_by_key(|s| s.len())?;
    let phase = segment.phase.as_ref().filter(|p| p.len() >= 2)?;
    let turns: f64 = phase.windows(2).map(|w| f64::from(w[1].wrapping_sub(w[0]) as i32) / 2f64.powi(32)).sum();
    Some(turns / ((phase.len() - 1) as f64 * segment.step_s))
}

/// What is looked at of one coordinate's longest stretch: (series, whether it is even under x → −x). An angle gives its
/// velocity v, v² and cos x; a number x gives x and x².
pub fn observables(motion: &Motion, stretch: usize, rate_hz: f64) -> Vec<(Vec<f64>, bool)> {
    let Some(x) = motion.stretches.get(stretch) else { return Vec::new() };
    let v = motion.increments(rate_hz).into_iter().nth(stretch).unwrap_or_default();
    let squares = v.iter().map(|v| v * v).collect();
    let mut out = vec![(v, false), (squares, true)];
    if motion.space == Space::S1 {
        out.push((x.iter().map(|x| x.cos()).collect(), true));
    }
    out
}

/// Checks the stated frequency against the observables of the longest unbroken stretch.
pub fn check(record: &Record, series: &[(Vec<f64>, bool)], rate_hz: f64, stated_hz: f64) -> DriveCheck {
    let mut at: Option<Line> = None;
    let mut other: Option<Line> = None;
    let mut resolution_hz = f64::INFINITY;
    let higher = |best: &mut Option<Line>, line: Line| {
        if best.is_none_or(|b| b.prominence < line.prominence) {
            *best = Some(line);
        }
    };
    for (x, even) in series {
        let piece = spectrum::fast_length(x.len());
        let Ok(density) = spectrum::welch(&[x.get(..piece).unwrap_or(x)], rate_hz, piece) else { continue };
        resolution_hz = resolution_hz.min(density.bin_hz);
        let middle = (stated_hz / density.bin_hz).round() as usize;
        let bins = middle.saturating_sub(1)..=middle + 1;
        let top = bins.filter_map(|m| spectrum::line_at(&density, m)).max_by(|a, b| a.density.total_cmp(&b.density));
        if let Some(line) = top {
            higher(&mut at, line);
        }
        // Odd quantities have narrow bumps of their own at natural frequencies; only even ones can contradict the file.
        for line in spectrum::lines(&density, 400).into_iter().filter(|_| *even) {
            if !is_simple_ratio(line.frequency_hz, stated_hz, 1.5 * density.bin_hz) {
                higher(&mut other, line);
            }
        }
    }
    let clear = |line: Option<Line>, factor: f64| line.filter(|l| l.prominence > factor);
    let phase_hz = phase_frequency(record);
    // A phase of zero slope means a drive that stands still: the record cannot contradict the file then.
    let by_phase = phase_hz.filter(|f| *f > 0.0).map(|f| (f - stated_hz).abs() < 1e-3 * stated_hz);
    let at_clear = clear(at, CLEAR);
    let other_clear = clear(other, CLEAR_ELSEWHERE);
    let by_line = match (at_clear, other_clear) {
        (Some(_), _) => Some(true),
        (None, Some(_)) => Some(false),
        (None, None) => None,
    };
    DriveCheck {
        stated_hz,
        phase_hz,
        line_hz: at_clear.map(|l| l.frequency_hz),
        line_prominence: at.map_or(0.0, |l| l.prominence),
        other_hz: other_clear.map(|l| l.frequency_hz),
        other_prominence: other.map_or(0.0, |l| l.prominence),
        resolution_hz: if resolution_hz.is_finite() { resolution_hz } else { 0.0 },
        agrees: by_phase.or(by_line),
    }
}

/// Whether f is p/q times the drive's frequency with q ≤ 4 and p ≤ 16, within a tolerance.
fn is_simple_ratio(f: f64, drive: f64, tolerance: f64) -> bool {
    (1..=4).any(|q| {
        let p = (f * f64::from(q) / drive).round();
        (1.0..=16.0).contains(&p) && (f - p * drive / f64::from(q)).abs() < tolerance
    })
}

/// Name of a frequency as a fraction of the drive's: `f_e`, `2 f_e`, `f_e/2`, `5 f_e/3`; none where no fraction of
/// denominator ≤ 8 is within the tolerance, or two are.
pub fn name(f: f64, drive: f64, tolerance: f64) -> Option<String> {
    for q in 1..=8u32 {
        let p = (f * f64::from(q) / drive).round();
        if p >= 1.0 && (f - p * drive / f64::from(q)).abs() < tolerance {
            let top = if p == 1.0 { "f_e".to_owned() } else { format!("{p} f_e") };
            return Some(if q == 1 { top } else { format!("{top}/{q}") });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_harmonics_and_sub_harmonics() {
        assert_eq!(name(5.01, 5.0, 0.02).as_deref(), Some("f_e"));
        assert_eq!(name(2.5, 5.0, 0.02).as_deref(), Some("f_e/2"));
        assert_eq!(name(10.0, 5.0, 0.02).as_deref(), Some("2 f_e"));
        assert_eq!(name(25.0 / 3.0, 5.0, 0.02).as_deref(), Some("5 f_e/3"));
        assert_eq!(name(5.11, 5.0, 0.02), None);
    }
}

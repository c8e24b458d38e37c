//! Whether the rig file's drive frequency is the record's.
//!
//! Chaos has a broad spectrum, but what is locked to the drive makes a line as narrow as the record
//! is long. A pendulum under a vertical drive is symmetric (φ → −φ), and chaos averages odd
//! quantities over both signs: the velocity of a chaotic record need have no line at the drive's
//! frequency at all. Even quantities keep it, so cos x and v² of every coordinate are looked at;
//! under a horizontal drive (φ → −φ with τ → τ + π) the odd ones do, v and sin x.
//!
//! Score of a frequency: with r_i the periodogram (Hann, one piece, the longest unbroken stretch)
//! of observable i over the median of the 48 bins around it, s = Σ_i ln(1 + r_i), and z = (s −
//! median s)/(1.4826 · median |s − median s|) over all bins from a half to twice the stated
//! frequency. Over 400 s of the chaotic rig cut into pieces of 20, 40 and 60 s the drive's bin had
//! the greatest score in each of 36. Where the device recorded the drive's phase, its slope gives
//! the frequency outright.

use serde::Serialize;
use whirl_shared::excitation::Law;

use super::motion::{Motion, Space};
use crate::record::Record;
use crate::rig::{Direction, Drive};
use crate::signal::spectrum::{self, Density};
use crate::statistics::median;

/// Score from which the drive's line is taken as seen wherever the greatest score lies.
const CLEAR: f64 = 5.0;
/// Score that a line elsewhere needs to speak against the rig file.
const CLEAR_ELSEWHERE: f64 = 6.0;

/// What the record says of the drive's frequency.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveCheck {
    /// Frequency in the rig file, Hz.
    pub stated_hz: f64,
    /// Frequency from the device's own phase, Hz, where it was recorded.
    pub phase_hz: Option<f64>,
    /// Frequency of the record's line at the stated one, Hz, where there is one.
    pub line_hz: Option<f64>,
    /// Score z of the stated frequency (greatest of the bins within three of it).
    pub line_score: f64,
    /// Where the record's drive seems to be instead, Hz, where a clear line says so.
    pub other_hz: Option<f64>,
    /// Greatest score elsewhere between half and twice the stated frequency.
    pub other_score: f64,
    /// How finely this record tells frequencies apart, Hz: one over the longest unbroken stretch.
    pub resolution_hz: f64,
    /// True: the record has a line there. False: it has none there and a clear one elsewhere. None:
    /// it cannot tell.
    pub agrees: Option<bool>,
}

/// Whether the device says that the drive's frequency glides.
pub fn glides(record: &Record) -> bool {
    record.metadata.as_ref().and_then(|m| m.excitation).is_some_and(|e| e.glide.law != Law::Steady)
}

/// The drive's frequency from the device's phase: its mean advance over the longest segment, but
/// for ticks in which the shaker rested and the phase stood still. None of a drive that glides.
pub fn phase_frequency(record: &Record) -> Option<f64> {
    if glides(record) {
        return None;
    }
    let segment = record.segments.iter().filter(|s| s.phase.is_some()).max_by_key(|s| s.len())?;
    let phase = segment.phase.as_ref().filter(|p| p.len() >= 2)?;
    let advances = phase.windows(2).map(|w| f64::from(w[1].wrapping_sub(w[0]).cast_signed())).filter(|a| *a != 0.0);
    let (turns, steps) = advances.fold((0.0, 0u32), |(turns, steps), a| (turns + a / 2f64.powi(32), steps + 1));
    Some(turns / (f64::from(steps.max(1)) * segment.step_s))
}

/// Checks the stated frequency against the motions of one stretch. A force has its line in a number
/// itself, whatever direction is stated: that is looked for where x² shows none. A line that a number
/// has elsewhere may be its own.
pub fn of(record: &Record, motions: &[Motion], stretch: usize, rate_hz: f64, drive: &Drive) -> DriveCheck {
    let checked = |direction: Direction, all: bool| {
        let chosen = motions.iter().filter(|m| all || m.space == Space::R);
        let series: Vec<Vec<f64>> = chosen.flat_map(|m| observables(m, stretch, rate_hz, direction)).collect();
        check(record, &series, rate_hz, drive.frequency_hz)
    };
    let found = checked(drive.direction, true);
    if found.agrees == Some(true) || drive.direction == Direction::Horizontal {
        return found;
    }
    let forced = checked(Direction::Horizontal, false);
    if forced.agrees == Some(true) { forced } else { found }
}

/// What is looked at of one coordinate's stretch, see the head of this file. Numbers that are no
/// angles: x² or x.
fn observables(motion: &Motion, stretch: usize, rate_hz: f64, direction: Direction) -> Vec<Vec<f64>> {
    let Some(x) = motion.stretches.get(stretch) else { return Vec::new() };
    let v = || motion.increments(rate_hz).into_iter().nth(stretch).unwrap_or_default();
    let squared = |x: &[f64]| x.iter().map(|x| x * x).collect();
    match (motion.space, direction) {
        (Space::S1, Direction::Vertical) => vec![squared(&v()), x.iter().map(|x| x.cos()).collect()],
        (Space::S1, Direction::Horizontal) => vec![v(), x.iter().map(|x| x.sin()).collect()],
        (Space::R, Direction::Vertical) => vec![squared(x)],
        (Space::R, Direction::Horizontal) => vec![x.clone()],
    }
}

/// Scores z of the bins from a half to twice the stated frequency: (first bin, scores, densities).
fn scores(series: &[Vec<f64>], rate_hz: f64, stated_hz: f64) -> Option<(usize, Vec<f64>, Vec<Density>)> {
    let piece = spectrum::fast_length(series.iter().map(Vec::len).min()?);
    let densities: Vec<Density> =
        series.iter().filter_map(|x| spectrum::welch(&[x.get(..piece)?], rate_hz, piece).ok()).collect();
    let first = densities.first()?;
    let (from, to) = ((0.52 * stated_hz / first.bin_hz).ceil() as usize, (1.95 * stated_hz / first.bin_hz) as usize);
    let to = to.min(first.density.len().checked_sub(2)?);
    if from < 3 || to < from + 8 {
        return None;
    }
    let sums: Vec<f64> = (from..=to)
        .map(|m| {
            let prominence =
                |d: &Density| d.density[m] / spectrum::surroundings(&d.density, m, 24).max(f64::MIN_POSITIVE);
            densities.iter().map(|d| prominence(d).ln_1p()).sum()
        })
        .collect();
    let middle = median(&mut sums.clone());
    let spread = 1.4826 * median(&mut sums.iter().map(|s| (s - middle).abs()).collect::<Vec<_>>());
    let z = sums.iter().map(|s| (s - middle) / spread.max(1e-9)).collect();
    Some((from, z, densities))
}

/// Checks the stated frequency against the observables of the longest unbroken stretch.
pub fn check(record: &Record, series: &[Vec<f64>], rate_hz: f64, stated_hz: f64) -> DriveCheck {
    let phase_hz = phase_frequency(record);
    let mut out = DriveCheck {
        stated_hz,
        phase_hz,
        line_hz: None,
        line_score: 0.0,
        other_hz: None,
        other_score: 0.0,
        resolution_hz: 0.0,
        agrees: None,
    };
    if let Some((from, z, densities)) = scores(series, rate_hz, stated_hz) {
        let bin_hz = densities[0].bin_hz;
        out.resolution_hz = bin_hz;
        let middle = (stated_hz / bin_hz).round() as usize;
        let greatest = |bins: &mut dyn Iterator<Item = usize>| {
            bins.map(|m| (m, z[m - from])).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((middle, 0.0))
        };
        let last = from + z.len() - 1;
        // Hann's main lobe: a drive that is off by a bin or two must not hide beside the frequency
        // stated.
        let (at, at_score) = greatest(&mut (from.max(middle.saturating_sub(3))..=last.min(middle + 3)));
        let (other, other_score) = greatest(&mut (from..=last).filter(|m| m.abs_diff(middle) > 3));
        let frequency = |m: usize| {
            let lines = densities.iter().filter_map(|d| spectrum::line_at(d, m));
            lines.max_by(|a, b| a.prominence.total_cmp(&b.prominence)).map(|l| l.frequency_hz)
        };
        (out.line_score, out.other_score) = (at_score, other_score);
        let near = frequency(at).filter(|_| at_score >= CLEAR || at_score > other_score);
        match near {
            Some(f) if (f - stated_hz).abs() <= bin_hz => (out.line_hz, out.agrees) = (near, Some(true)),
            Some(_) if at_score >= CLEAR => (out.other_hz, out.agrees) = (near, Some(false)),
            None if other_score >= CLEAR_ELSEWHERE => (out.other_hz, out.agrees) = (frequency(other), Some(false)),
            _ => {}
        }
    }
    // A phase of zero slope is a drive that stands still: the record cannot contradict the file
    // then.
    let by_phase = phase_hz.filter(|f| *f > 0.0).map(|f| (f - stated_hz).abs() < 1e-3 * stated_hz);
    out.agrees = by_phase.or(out.agrees);
    out
}

/// Name of a frequency as a fraction of the drive's: `f_e`, `2 f_e`, `f_e/2`, `5 f_e/3`, the
/// fraction of least denominator up to `denominator` that lies within the tolerance; none where
/// there is none.
pub fn name(f: f64, drive: f64, tolerance: f64, denominator: u32) -> Option<String> {
    for q in 1..=denominator {
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
    use crate::record::Segment;

    #[test]
    fn a_shaker_that_stopped_in_between_does_not_bend_the_phase() {
        let advance = 42_949_673_u32; // 5 Hz at 500 Hz
        let phase = |i: u32| advance.wrapping_mul(i.min(400) + i.saturating_sub(600));
        let phase = Some((0..2000).map(phase).collect());
        let segment = Segment { phase, ..Segment::new(0.0, 0.002, Vec::new()) };
        let record = Record { sample_rate_hz: 500.0, segments: vec![segment], ..Record::default() };
        let hz = phase_frequency(&record).unwrap();
        assert!((hz - 5.0).abs() < 1e-6, "{hz}");
    }

    /// A number that a force moves has the line in itself, whatever direction the file states; its own
    /// line elsewhere says nothing against the file.
    #[test]
    fn a_force_has_its_line_in_a_number_itself() {
        let agrees = |forced: f64, direction: Direction| {
            let mut state = 1_u32;
            let mut noise = move || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(state >> 8) / f64::from(1 << 24) - 0.5
            };
            let turn = core::f64::consts::TAU;
            let at = |t: f64| (turn * 1.37 * t + 2.0 * (0.3 * t).sin()).sin() + forced * (turn * t).cos();
            let x = (0..12_000).map(|i| at(0.05 * f64::from(i)) + 0.3 * noise()).collect();
            let motion = Motion {
                name: "x".to_owned(),
                unit: "m".to_owned(),
                space: Space::R,
                derived: false,
                step: 0.0,
                quantisation_noise: 0.0,
                stretches: vec![x],
            };
            let drive = Drive { direction, frequency_hz: 1.0, amplitude_m: None };
            of(&Record::default(), &[motion], 0, 20.0, &drive).agrees
        };
        assert_eq!(agrees(1.0, Direction::Vertical), Some(true));
        assert_eq!(agrees(1.0, Direction::Horizontal), Some(true));
        assert_eq!(agrees(0.0, Direction::Vertical), None);
    }

    #[test]
    fn names_harmonics_and_sub_harmonics() {
        assert_eq!(name(5.01, 5.0, 0.02, 4).as_deref(), Some("f_e"));
        assert_eq!(name(2.5, 5.0, 0.02, 4).as_deref(), Some("f_e/2"));
        assert_eq!(name(10.0, 5.0, 0.02, 4).as_deref(), Some("2 f_e"));
        assert_eq!(name(25.0 / 3.0, 5.0, 0.02, 4).as_deref(), Some("5 f_e/3"));
        assert_eq!(name(5.11, 5.0, 0.02, 4), None);
        assert_eq!(name(1.0, 5.0, 0.02, 4), None);
        assert_eq!(name(1.0, 5.0, 0.02, 5).as_deref(), Some("f_e/5"));
    }
}

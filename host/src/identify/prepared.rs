//! Records made ready: unbroken stretches of steady drive, the noise of their sensors, windows and
//! low-passes.

use rayon::prelude::*;

use super::geometry::{FEWEST_SAMPLES, geometry};
use super::index_marks::Indices;
use super::remeasured::Sensors;
use super::shooting::zeros::ZeroOffset;
use super::standstill::{Fineness, Still};
use super::stretches::{self, Stretch};
use super::windows::{Kernels, Windows, samples_needed};
use super::{Settings, boots, free_geometry, input_noise, standstill};
use crate::error::{BadInput, Result};
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::signal::angles::Phase;
use crate::signal::noise::{self, Noise};
use crate::warning::Warning;
use crate::wording::format::{rounded, rounded_up, shortest};

/// Windows and low-passes of an analysis.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Test functions.
    pub windows: Windows,
    /// Low-passes.
    pub kernels: Kernels,
    /// The drive's period; of a free system that of its dominant frequency, or a twentieth of a
    /// window where no motion stands above the noise, s.
    pub period_s: f64,
}

/// A record made ready for the weak form.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Unbroken stretches of steady drive.
    pub stretches: Vec<Stretch>,
    /// Record of each stretch.
    pub record_of: Vec<usize>,
    /// What is known of the sensors' zeros before anything is identified.
    pub indices: Indices,
    /// Noise of the sensors.
    pub sensors: Sensors,
    /// Windows and low-passes.
    pub geometry: Geometry,
    /// What was left out because a joint stands still.
    pub still: Vec<Still>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// Stretches, noise, windows and low-passes of one or several records.
///
/// # Errors
/// Settings out of range, channels that are not there, a shaker that never moved, records shorter
/// than one window.
pub fn prepare(records: &[Record], rig: &Rig, bound: &ObservedModel, settings: &Settings) -> Result<Prepared> {
    let out = Steady::of(records, rig, bound, &settings.zeros)?;
    let found = out.measured(records, rig, bound, settings)?;
    out.ready(found, rig, records, settings)
}

/// The same without what `standstill` leaves out: stretches in which dry friction may hold a
/// joint.
///
/// # Errors
/// As [`prepare`].
pub fn prepare_moving(records: &[Record], rig: &Rig, bound: &ObservedModel, settings: &Settings) -> Result<Prepared> {
    let mut out = Steady::of(records, rig, bound, &settings.zeros)?;
    let found = out.measured(records, rig, bound, settings)?;
    let Sensors { count, sigma, .. } = &found.sensors;
    let fineness = |(count, sigma): (&Option<f64>, &f64)| count.map_or(Fineness::Noise(*sigma), Fineness::Counts);
    let sensors: Vec<Fineness> = count.iter().zip(sigma).map(fineness).collect();
    let windows = &found.geometry.windows;
    let still = standstill::leave_out(&mut out.stretches, &mut out.record_of, bound, &sensors, windows);
    if still.is_empty() {
        return out.ready(found, rig, records, settings);
    }
    out.warnings.extend(standstill::told(&still, records, bound));
    let left = out.measured(records, rig, bound, settings).and_then(|found| out.ready(found, rig, records, settings));
    // What is left may ask for other windows than the whole, and have no room for them: nothing of
    // a record that can be used as a whole is left out then.
    left.map(|left| Prepared { still, ..left }).or_else(|_| prepare(records, rig, bound, settings))
}

/// Period of the motion of the slowest sensor of stretches, as pieces show it that hold three of
/// them, s; none where nothing stands above the noise.
pub fn swing_s(stretches: &[Stretch], bound: &ObservedModel) -> Option<f64> {
    let shown: Vec<Vec<Vec<f64>>> = stretches.iter().map(|s| s.sensors(bound)).collect();
    let of_sensor = |i: usize| shown.iter().map(move |s| &s[i][..]);
    free_geometry::swing_s((0..bound.sensors.len()).map(of_sensor), stretches.first()?.step_s)
}

/// Samples of the longest stretch.
fn longest(stretches: &[Stretch]) -> usize {
    stretches.iter().map(Stretch::len).max().unwrap_or(0)
}

/// Stretches of steady drive.
struct Steady {
    stretches: Vec<Stretch>,
    record_of: Vec<usize>,
    indices: Indices,
    warnings: Vec<Warning>,
}

/// What they show of the sensors, and what follows for the analysis.
struct Measured {
    sensors: Sensors,
    geometry: Geometry,
}

impl Measured {
    /// Samples that one window needs.
    fn needed(&self, step_s: f64) -> usize {
        samples_needed(&self.geometry.windows, &self.geometry.kernels, step_s)
    }
}

impl Steady {
    fn of(records: &[Record], rig: &Rig, bound: &ObservedModel, zeros: &[ZeroOffset]) -> Result<Self> {
        let mut warnings: Vec<Warning> = records.iter().flat_map(|r| r.warnings.clone()).collect();
        let (records, restarted) = boots::of_known_zero(records);
        let records = &*records;
        warnings.extend(restarted);
        let indices = Indices::of(records, rig, bound);
        let (mut stretches, mut record_of) = (Vec::new(), Vec::new());
        for (k, record) in records.iter().enumerate() {
            let given = |i: usize| zeros.iter().find(|z| z.is_of(k, &rig.channel[i].name)).map_or(0.0, |z| z.value);
            let zero = |(s, i): (usize, &usize)| indices.zero(k, s).map_or_else(|| given(*i), |z| z.0);
            let shifts: Vec<f64> = bound.sensors.iter().enumerate().map(zero).collect();
            let as_set = shifts.iter().all(|z| *z == 0.0);
            for s in stretches::of(record, rig, bound)? {
                stretches.push(if as_set { s } else { s.shifted(bound, &shifts) });
                record_of.push(k);
            }
        }
        // What does not rest on the drive's phase needs no steady drive.
        if rig.drive.is_some() && (bound.model.uses_phase() || bound.base.is_none()) {
            keep_steady_drive(records, &mut stretches, &mut record_of, &mut warnings)?;
            is_one_sine(records, &stretches)?;
        }
        Ok(Self { stretches, record_of, indices, warnings })
    }

    fn measured(&self, records: &[Record], rig: &Rig, bound: &ObservedModel, settings: &Settings) -> Result<Measured> {
        let step_s = 1.0 / rig.sample_rate_hz;
        let shown: Vec<Vec<Vec<f64>>> = self.stretches.iter().map(|s| s.sensors(bound)).collect();
        let of_sensor = |i: usize| shown.iter().map(move |s| &s[i][..]);
        let numbers: Vec<usize> = (0..bound.sensors.len()).collect();
        let noises: Vec<Option<Noise>> = numbers.par_iter().map(|i| noise::estimate(of_sensor(*i), step_s)).collect();
        let free = rig.drive.is_none();
        let band = if free { free_geometry::band(numbers.iter().map(|i| of_sensor(*i)), step_s) } else { None };
        drop(shown);
        let lengths: Vec<f64> = self.stretches.iter().map(|s| s.len() as f64 * s.step_s).collect();
        let inputs = !bound.inputs.is_empty();
        let geometry = geometry(rig, settings, &noises, inputs, step_s, band, &lengths)?;
        let step = |i: usize| records.iter().map(|r| r.channels[i].step()).fold(0.0, f64::max);
        let counted = |&i: &usize| (rig.channel[i].unit == "count").then(|| step(i));
        let count: Vec<Option<f64>> = bound.sensors.iter().map(counted).collect();
        let error = |(n, count): (&Option<Noise>, &Option<f64>)| match count {
            Some(_) => 0.0,
            None => n.map_or(0.0, |n| n.square_error),
        };
        let sensors = Sensors {
            sigma: noises.iter().map(|n| n.map_or(0.0, |n| n.sigma)).collect(),
            square_error: noises.iter().zip(&count).map(error).collect(),
            count,
            inputs: input_noise::of(&self.stretches),
        };
        Ok(Measured { sensors, geometry })
    }

    fn ready(self, found: Measured, rig: &Rig, records: &[Record], settings: &Settings) -> Result<Prepared> {
        let step_s = 1.0 / rig.sample_rate_hz;
        let (needed, longest) = (found.needed(step_s), longest(&self.stretches));
        let Measured { sensors, geometry } = found;
        if longest < needed {
            // Gaps that were filled cut nothing.
            let is_cut = self.stretches.len() > records.len();
            let nan_rows: u64 = if is_cut { records.iter().map(|r| r.losses.nan_rows).sum() } else { 0 };
            // Of a free system the shortest window was tried where none is asked for.
            let can_shorten = rig.drive.is_some() || settings.window_s.is_some();
            let remedy = remedy(records, self.stretches.len(), &longer(can_shorten, step_s));
            let mut error = too_short([longest, needed], step_s, &geometry.windows, nan_rows).remedy(remedy);
            if let Some(r) = records.first() {
                error = error.in_file(&r.path);
            }
            return Err(error);
        }
        let Self { stretches, record_of, indices, warnings } = self;
        Ok(Prepared { stretches, record_of, indices, sensors, geometry, still: Vec::new(), warnings })
    }
}

/// What to do about `stretches` that are all too short, beside recording longer.
fn remedy(records: &[Record], stretches: usize, longer: &str) -> String {
    let is_left_out =
        |w: &&Warning| w.details.get("left_out").and_then(serde_json::Value::as_u64).is_some_and(|n| n > 0);
    let otherwise = format!("Otherwise {}{}", longer[..1].to_lowercase(), &longer[1..]);
    if stretches <= records.len() {
        longer.to_owned()
    } else if records.iter().any(|r| r.losses.nan_rows > 0) {
        "Find out why the sensor gives no number there; --resample bridges short gaps. Otherwise record longer".into()
    } else if records.iter().any(|r| r.losses.gaps > 0) {
        format!("Gaps cut the record: --resample bridges short ones. {otherwise}")
    } else if let Some(w) = records.iter().flat_map(|r| &r.warnings).find(is_left_out) {
        format!("Rows that are left out cut the record: {}. {}. {otherwise}", w.text, w.advice)
    } else {
        longer.to_owned()
    }
}

/// A longest stretch of so many samples where so many are needed.
fn too_short([longest, needed]: [usize; 2], step_s: f64, windows: &Windows, nan_rows: u64) -> BadInput {
    let told = |s: f64| shortest(rounded(s, 4));
    let samples = if longest == 1 { "sample" } else { "samples" };
    let (found_s, window_s) = (told(longest as f64 * step_s), told(windows.length_s));
    let needed_s = shortest(rounded_up(needed as f64 * step_s, 4));
    BadInput::new(
        format!("{longest} {samples} ({found_s} s) in the longest unbroken stretch{}", broken_by(nan_rows)),
        format!("at least {needed} ({needed_s} s): one window of {window_s} s and the low-pass's reach on either side"),
    )
}

/// What to do about a record that is too short; where windows may be shorter, to what.
fn longer(can_shorten: bool, step_s: f64) -> String {
    if !can_shorten {
        return "Record longer, or with a higher sampling rate".to_owned();
    }
    let least_s = shortest(rounded_up(FEWEST_SAMPLES * step_s, 4));
    format!(
        "Record longer, or give `identify`, `explain` or `validate` a shorter window with --window-s, {least_s} s at least"
    )
}

/// Why stretches are short, where rows without a number are the reason.
pub(crate) fn broken_by(nan_rows: u64) -> String {
    match nan_rows {
        0 => String::new(),
        1 => ", which a row without a number breaks".to_owned(),
        n => format!(", which {n} rows without a number break"),
    }
}

/// Refuses a drive that is not measured and no sine of one frequency: a sweep, several sines.
fn is_one_sine(records: &[Record], stretches: &[Stretch]) -> Result<()> {
    let told = |r: &&Record| r.metadata.as_ref().and_then(|m| m.excitation).is_some_and(|e| !e.is_sine());
    let found = match (records.iter().find(told), stretches.iter().find_map(glide)) {
        (Some(_), _) => "a drive that is no sine of one frequency".to_owned(),
        (None, Some([least, most])) => format!("a drive whose frequency goes from {least:.3} to {most:.3} Hz"),
        (None, None) => return Ok(()),
    };
    let path = records.iter().find(told).or(records.first()).map(|r| r.path.clone()).unwrap_or_default();
    Err(BadInput::new(found, "one frequency, where no channel measures the base").in_file(path).remedy(
        "Capture with a channel that has measures = \"base\" (docs/rig-file.md), or use the part with one frequency (--from, --to)",
    ))
}

/// Least and greatest frequency (Hz) of the device's phase, where it is not the same but for single
/// samples.
fn glide(stretch: &Stretch) -> Option<[f64; 2]> {
    let Phase::Device(turns) = &stretch.phase else { return None };
    let mut advances: Vec<u32> = turns.windows(2).map(|w| w[1].wrapping_sub(w[0])).collect();
    advances.sort_unstable();
    let median = *advances.get(advances.len() / 2)?;
    let others = advances.iter().filter(|a| **a != median).count();
    let hertz = |advance: u32| f64::from(advance) / (4_294_967_296.0 * stretch.step_s);
    let (least, most) = (*advances.first()?, *advances.last()?);
    (others > advances.len() / 100).then(|| [hertz(least), hertz(most)])
}

/// Cuts stretches to those over which the device's drive ran steadily.
pub(super) fn keep_steady_drive(
    records: &[Record],
    stretches: &mut Vec<Stretch>,
    record_of: &mut Vec<usize>,
    warnings: &mut Vec<Warning>,
) -> Result<()> {
    if stretches.iter().any(|s| s.amplitude_nm.is_none()) {
        return Ok(());
    }
    let Some(target) = stretches.iter().filter_map(|s| s.amplitude_nm.as_ref()?.iter().copied().max()).max() else {
        return Ok(());
    };
    if target == 0 {
        let path = records.first().map(|r| r.path.clone()).unwrap_or_default();
        return Err(BadInput::new(
            "a record whose shaker never moved",
            "motion of the base, since the rig file has [drive]",
        )
        .in_file(path)
        .remedy("Start the shaker during the capture, or leave [drive] out of the rig file"));
    }
    let steady = |s: &Stretch| s.amplitude_nm.iter().flatten().all(|a| *a == target);
    if stretches.iter().all(steady) {
        return Ok(());
    }
    let (mut kept, mut from, mut dropped) = (Vec::new(), Vec::new(), 0);
    for (s, record) in stretches.drain(..).zip(record_of.drain(..)) {
        let mut start = 0;
        for run in s.amplitude_nm.clone().unwrap_or_default().chunk_by(|a, b| a == b) {
            if run[0] == target {
                kept.push(s.part(start, start + run.len()));
                from.push(record);
            } else {
                dropped += run.len();
            }
            start += run.len();
        }
    }
    if dropped > 0 {
        warnings.push(Warning::new(
            "drive-not-steady",
            format!("{dropped} samples were taken while the shaker's amplitude was not {} µm", f64::from(target) / 1e3),
            "They were left out; start the capture when the shaker runs to use all of it",
        ));
    }
    (*stretches, *record_of) = (kept, from);
    Ok(())
}

#[cfg(test)]
#[path = "prepared_tests.rs"]
mod tests;

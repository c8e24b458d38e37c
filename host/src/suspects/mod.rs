//! What a record's own channels tell of faults: a dead encoder, a spike, a slip, a stuck bit, rows
//! that are missing under times that hide it.
//!
//! Every record that is read as a whole goes through [`examine`]. It looks at the measured channels
//! alone, needs no model, and knows real motion by what it cannot do; what needs the equations
//! (exchanged channels, signs, units, delays) is looked for by [`crate::identify::suspects`]. An
//! input of a model file may jump, stand and saturate as it likes: it is not looked at. What is
//! certain is mended (slips) or left out as a gap (spikes, clipped and dead stretches); what cannot
//! be is named by a warning that takes the answer its standing.
//!
//! One check, one file: `dead`, `held`, `stuck_bit`, `row_steps`, `frozen` with `leap`, `cut`
//! and `filled`, and `screen` with `breaks` and `height`.

mod breaks;
mod cut;
mod dead;
mod filled;
mod frozen;
mod height;
mod held;
mod leap;
mod local_fit;
mod mending;
mod row_steps;
mod screen;
pub(crate) mod slipped;
mod sorting;
mod stuck_bit;
mod tail;
mod trace;
mod words;

use rayon::prelude::*;

use self::frozen::Run;
pub(crate) use self::mending::Mending;
use self::trace::{Samples, Trace};
use self::words::Wording;
use crate::record::{Column, Record};
use crate::rig::Rig;

/// Where what is left out would leave no stretch of at least 1/8 of the longest, nothing is:
/// windows of some dozens of swings would not fit any more, and an error about a record that is too
/// short would hide what is wrong with it.
const SHREDS: usize = 8;

/// How the rows of a record are counted where it came from.
#[derive(Clone, Debug)]
pub struct Numbering {
    /// What a row is called: "line" or "row".
    pub word: &'static str,
    /// Row of the first sample of each segment, from 0.
    pub first_rows: Vec<usize>,
    /// From row (from 0) on, places are so numbered: (row, its place), increasing.
    pub places: Vec<(usize, u64)>,
    /// Start (s), spacing (s) and samples of each segment as it was read, before anything was cut.
    pub stretches: Vec<(f64, f64, usize)>,
}

impl Numbering {
    /// Place of a sample.
    fn place(&self, segment: usize, sample: usize) -> u64 {
        let row = self.first_rows.get(segment).copied().unwrap_or(0) + sample;
        let k = self.places.partition_point(|p| p.0 <= row);
        let (from, place) = k.checked_sub(1).map_or((0, 1), |k| self.places[k]);
        place + (row - from) as u64
    }

    /// Place of the sample at a time of the record, s.
    pub fn at_time(&self, time_s: f64) -> Option<u64> {
        let near = |(start, step, count): &(f64, f64, usize)| {
            let sample = ((time_s - start) / step).round();
            // Neither negative nor beyond the segment.
            (sample >= 0.0 && sample < *count as f64).then_some(sample as usize)
        };
        self.stretches.iter().enumerate().find_map(|(k, s)| near(s).map(|sample| self.place(k, sample)))
    }
}

/// Channels that show the motion; all where the rig file does not tell.
pub fn sensors(record: &Record, rig: &Rig) -> Vec<usize> {
    match &rig.bound {
        Some(bound) => bound.sensors.clone(),
        None => (0..record.channels.len()).collect(),
    }
}

/// Looks a record over; adds warnings, mends and cuts.
pub fn examine(record: &mut Record, rig: &Rig, numbering: &Numbering) {
    let sensors = sensors(record, rig);
    let traces: Vec<Trace<'_>> = sensors.iter().map(|&k| trace(record, k)).collect();
    let wording = Wording::new(record, rig, numbering);
    let (mut warnings, mut mending) = (Vec::new(), Mending::default());
    let (mut slipped, mut coarse) = (Vec::new(), Vec::new());
    let dead: Vec<Option<f64>> = traces.par_iter().map(dead::dead).collect();
    let held: Vec<Option<usize>> = traces.par_iter().map(held::held).collect();
    for (i, &k) in sensors.iter().enumerate() {
        if let Some(value) = dead[i] {
            warnings.push(wording.dead(k, value, dead.iter().all(Option::is_some)));
        } else if let Some(n) = held[i] {
            warnings.push(wording.held(k, n));
        }
        let stuck = stuck_bit::stuck(&traces[i]);
        warnings.extend(wording.stuck(k, &stuck));
        coarse.extend(stuck_bit::coarse(&stuck).map(|s| (k, s)));
    }
    let alive: Vec<usize> = (0..traces.len()).filter(|&i| dead[i].is_none()).collect();
    if !warnings.iter().any(|w| w.invalidates) && !alive.is_empty() {
        let living: Vec<Trace<'_>> = alive.iter().map(|&i| traces[i].clone()).collect();
        let channels: Vec<usize> = alive.iter().map(|&i| sensors[i]).collect();
        let steps = row_steps::look(&living);
        warnings.extend(steps.doubled.iter().map(|f| wording.rows("rows-doubled", f)));
        warnings.extend(steps.missing.iter().map(|f| wording.rows("rows-missing", f)));
        if warnings.iter().all(|w| !w.invalidates) {
            let runs: Vec<Vec<Run>> = living.par_iter().map(frozen::runs).collect();
            for ((runs, t), &k) in runs.iter().zip(&living).zip(&channels) {
                warnings.extend(wording.runs(k, runs, t, &mut mending));
            }
            let found: Vec<Vec<breaks::Found>> = living
                .par_iter()
                .map(|t| {
                    let mut suspects = screen::screen(t);
                    suspects.retain(|s| !mending.near(s.stretch, s.from, s.to));
                    if suspects.is_empty() {
                        return vec![];
                    }
                    breaks::Judge::new(t).map_or_else(Vec::new, |judge| judge.judge(t, &suspects))
                })
                .collect();
            let sorted = sorting::sort(&living, &found);
            warnings.extend(wording.breaks(&channels, &sorted, &mut mending, &mut slipped));
        }
    }
    if SHREDS * mending.longest_left(record) < record.longest_segment() {
        mending.keep_all();
        for w in warnings.iter_mut().filter(|w| w.details.contains_key("left_out")) {
            w.advice =
                "They are so many that nothing would be left without them: find the cause and record again".to_owned();
            w.details.insert("left_out".to_owned(), 0.into());
            w.invalidates = true;
        }
    }
    mending.apply(record);
    record.warnings.extend(warnings);
    for (k, step) in slipped {
        slipped::tell(record, k, &[step], 0.0);
    }
    for (k, stuck) in coarse {
        record.channels[k].stuck = Some(stuck);
    }
}

/// A channel of a record, as it stands.
fn trace(record: &Record, channel: usize) -> Trace<'_> {
    let stretches = record.segments.iter().map(|s| match &s.columns[channel] {
        Column::Counts(c) => Samples::Counts(c),
        Column::Values(v) => Samples::Values(v),
    });
    Trace::new(stretches.collect())
}

#[cfg(test)]
mod tests;

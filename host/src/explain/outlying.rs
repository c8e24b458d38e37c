//! An explanation without the samples that stand alone far from what the equations say
//! ([`super::engine::outliers`]): left out as gaps, told in a warning, and the record explained
//! again, since one such sample may be all that is left, and lifts what is taken for the noise.

use super::engine::outliers::Outlier;
use super::{Explanation, Settings, Verdict, any_system};
use crate::error::Result;
use crate::record::{Record, Segment};
use crate::rig::Rig;
use crate::suspects::Mending;
use crate::warning::Warning;

/// Times that a record is explained again: a great one may hide smaller ones.
const ROUNDS: usize = 2;
/// Samples that a text names.
const NAMED: usize = 3;

/// Explains records, and again without what stands alone in them where something is left that has
/// no name.
///
/// # Errors
/// As [`super::explain`].
pub(super) fn explain(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    let mut result = any_system(records, rig, settings)?;
    let mut left: Vec<Record> = Vec::new();
    let mut told: Vec<Outlier> = Vec::new();
    for _ in 0..ROUNDS {
        let found = core::mem::take(&mut result.outliers);
        if result.verdict != Verdict::Unexplained || found.is_empty() {
            break;
        }
        let now = if left.is_empty() { records } else { &left };
        left = now.iter().enumerate().map(|(k, r)| without(r, k, &found)).collect();
        // What cannot be explained any more is told as it was.
        let Ok(again) = any_system(&left, rig, settings) else { break };
        told.extend(found);
        result = again;
    }
    result.warnings.extend(warnings(records, &told));
    Ok(result)
}

/// A record, the `index`-th, without outliers.
fn without(record: &Record, index: usize, found: &[Outlier]) -> Record {
    let mut out = record.clone();
    let mut mending = Mending::default();
    for f in found.iter().filter(|f| f.record == index) {
        if let Some((segment, sample)) = place(record, f.time_s) {
            mending.leave_out(segment, sample, sample + 1);
        }
    }
    mending.apply(&mut out);
    out
}

/// Segment and sample of a time.
fn place(record: &Record, time_s: f64) -> Option<(usize, usize)> {
    record.segments.iter().enumerate().find_map(|(k, s): (usize, &Segment)| {
        let sample = ((time_s - s.start_s) / s.step_s).round();
        (sample >= 0.0 && sample < s.len() as f64).then_some((k, sample as usize))
    })
}

/// One warning for each channel of each record.
fn warnings(records: &[Record], all: &[Outlier]) -> Vec<Warning> {
    let mut out = Vec::new();
    for (k, record) in records.iter().enumerate() {
        for (c, channel) in record.channels.iter().enumerate() {
            let mut own: Vec<&Outlier> = all.iter().filter(|o| (o.record, o.channel) == (k, c)).collect();
            own.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
            let Some(first) = own.first() else { continue };
            out.push(warning(record, &channel.name, &channel.unit, first, &own));
        }
    }
    out
}

fn warning(record: &Record, name: &str, unit: &str, first: &Outlier, own: &[&Outlier]) -> Warning {
    let unit = if unit == "count" { "counts" } else { unit };
    let row = |o: &Outlier| record.numbering.as_ref().and_then(|n| Some((n.word, n.at_time(o.time_s)?)));
    let time_s = |o: &Outlier| (o.time_s * 1e6).round() / 1e6;
    let one = |o: &&Outlier| {
        let t = format!("t = {} s", time_s(o));
        let place = row(o).map_or_else(|| t.clone(), |(word, row)| format!("{word} {row} ({t})"));
        format!("{place} by {:+.3} {unit}", o.size)
    };
    let list: Vec<String> = own.iter().take(NAMED).map(one).collect();
    let more = if own.len() > NAMED { format!(" and {} more", own.len() - NAMED) } else { String::new() };
    let (has, rows) = match own.len() {
        1 => ("a sample that stands".to_owned(), "This row is left out as a gap".to_owned()),
        n => (format!("{n} samples that stand"), format!("These {n} rows are left out as gaps")),
    };
    let text = format!("{name} has {has} alone, far from what the equations say: {}{more}", list.join(", "));
    let advice = format!("{rows}; look for a marker that was lost, or for disturbances on the sensor's line");
    let w = Warning::new("spike", text, advice)
        .with("channel", name)
        .with("time_s", time_s(first))
        .with("value", first.size)
        .with("sizes", own.iter().map(|o| o.size).collect::<Vec<f64>>())
        .with("left_out", own.len());
    let rows: Option<Vec<u64>> = own.iter().map(|o| row(o).map(|r| r.1)).collect();
    match rows {
        Some(rows) => w.with("row", rows[0]).with("rows", rows),
        None => w,
    }
}

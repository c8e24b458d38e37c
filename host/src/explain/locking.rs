//! An explanation of a record whose motion locks to the drive after a while: one orbit tells no
//! effects apart, what came before it may.

use super::decidability::freely_until_s;
use super::reason::{Reason, Undecidable};
use super::{Explanation, Settings, Verdict, outlying};
use crate::error::Result;
use crate::record::Record;
use crate::record::cut::Part;
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::in_seconds;

/// Explains records; where all of them lock to the drive and nothing is decided, by what came
/// before each did.
///
/// # Errors
/// As [`super::explain`].
pub(super) fn explain(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    let result = outlying::explain(records, rig, settings)?;
    if result.reason != Reason::Undecidable(Undecidable::Locked) {
        return Ok(result);
    }
    let ends: Vec<f64> = records.iter().filter_map(|r| freely_until_s(r, rig)).collect();
    // A record that repeats from the first on adds nothing that it would not add alone.
    if ends.len() < records.len() {
        return Ok(result);
    }
    let part = |by: f64| -> Result<Explanation> {
        let end = |(r, end): (&Record, &f64)| until(r, longer(r, *end, by));
        outlying::explain(&records.iter().zip(&ends).map(end).collect::<Result<Vec<_>>>()?, rig, settings)
    };
    let is_all = |by: f64| {
        let ends = records.iter().zip(&ends).map(|(r, end)| (r.segments.last(), longer(r, *end, by)));
        ends.into_iter().all(|(last, end)| last.is_none_or(|s| s.time(s.len()) <= end))
    };
    for by in PARTS.into_iter().filter(|by| !is_all(*by)) {
        if let Some(mut again) = part(by).ok().filter(|a| a.verdict != Verdict::NotDecidable) {
            again.warnings.extend(records.iter().zip(&ends).map(|(r, end)| told(r, *end, by)));
            return Ok(again);
        }
    }
    Ok(result)
}

/// What is explained of a record, in the time after which it repeats: that alone; where it is too
/// short for windows (a rotor settles within a dozen turns), so many times as much, with the first of
/// what repeats.
const PARTS: [f64; 4] = [1.0, 2.5, 6.0, 15.0];

/// The end of a part that is so many times longer than what comes before `end_s`, s.
fn longer(record: &Record, end_s: f64, by: f64) -> f64 {
    let from_s = record.segments.first().map_or(0.0, |s| s.start_s);
    from_s + by * (end_s - from_s)
}

/// What of a record lies before a time, s.
fn until(record: &Record, end_s: f64) -> Result<Record> {
    let mut out = record.clone();
    out.cut(&Part { from_s: None, to_s: Some(end_s) })?;
    Ok(out)
}

/// Id of the warning that what came before a motion locked to its drive was explained.
pub(super) const LOCKS_LATER: &str = "locks-later";

fn told(record: &Record, end_s: f64, by: f64) -> Warning {
    let last_s = record.segments.last().map_or(end_s, |s| s.start_s + s.len() as f64 * s.step_s);
    let (from, of) = (in_seconds(end_s), in_seconds(last_s));
    let text = format!("the motion repeats (locked to the drive) from {from} on, of {of}");
    let explained = match in_seconds(longer(record, end_s, by).min(last_s)) {
        _ if by <= 1.0 => "What came before is explained".to_owned(),
        until => format!("What came before is short: the record is explained until {until}"),
    };
    let advice = format!("{explained}; one orbit cannot tell effects apart (`whirl plan` proposes settings)");
    Warning::new(LOCKS_LATER, text, advice).with("from_s", end_s).with("until_s", longer(record, end_s, by).min(last_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Column, Segment};
    use std::path::Path;

    /// A motion of two frequencies for 30 s, then one of the drive's alone, is cut where it begins to
    /// repeat; one that never does is not.
    #[test]
    fn what_came_before_a_motion_repeats_is_cut() {
        let rig = Rig::parse(include_str!("../../../rigs/chaotic.toml"), Path::new("rig.toml")).unwrap();
        let drive_hz = rig.drive.unwrap().frequency_hz;
        let made = |until_s: f64| {
            let angle = |t: f64| {
                let other = if t < until_s { (0.618_034 * drive_hz * t * core::f64::consts::TAU).sin() } else { 0.0 };
                200.0 * (drive_hz * t * core::f64::consts::TAU).sin() + 200.0 * other
            };
            let column = |by: f64| (0..60_000).map(|i| (by * angle(f64::from(i) / 500.0)).round() as i32).collect();
            let columns = vec![Column::Counts(column(1.0)), Column::Counts(column(1.4))];
            Record::of("made", &rig, vec![Segment::new(0.0, 0.002, columns)])
        };
        let end_s = freely_until_s(&made(30.0), &rig).unwrap();
        // Nearly all of what follows must repeat: a little before it does.
        assert!((25.0..31.0).contains(&end_s), "{end_s}");
        let before = until(&made(30.0), end_s).unwrap();
        assert!((before.duration_s() - end_s).abs() < 0.1, "{}", before.duration_s());
        assert!((longer(&made(30.0), end_s, 2.5) - 2.5 * end_s).abs() < 1e-9);
        assert_eq!(freely_until_s(&made(f64::INFINITY), &rig), None);
    }
}

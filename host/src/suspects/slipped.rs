//! Steps of a channel that were taken back, told by one warning a channel: those that the samples
//! show and those that the equations show.
//!
//! A step that the samples show is right to about a count; what it misses, the equations show as
//! another one at the same place. Within what its place is known to they are one step by their sum.

use serde_json::Value;

use crate::record::Record;
use crate::warning::Warning;

/// The warning's id.
pub const ID: &str = "count-slip";
/// Places that a text names.
const NAMED: usize = 3;

/// A step that stays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Row of the first sample that is off, as its file counts; none of a record that has no file.
    pub row: Option<u64>,
    /// Its time, s.
    pub time_s: f64,
    /// By how much, in the channel's unit.
    pub size: f64,
    /// Whether the place is right to a few rows only, as the equations show it.
    pub near: bool,
}

/// Adds steps to those that a record's warnings tell of a channel. One that is within `same_s` of
/// another changes that one's size.
pub fn tell(record: &mut Record, channel: usize, steps: &[Step], same_s: f64) {
    let name = record.channels[channel].name.clone();
    let before = record.warnings.iter().position(|w| w.id == ID && w.details["channel"] == *name);
    let mut all = before.map_or_else(Vec::new, |k| told(&record.warnings[k]));
    for step in steps {
        match all.iter_mut().find(|s| (s.time_s - step.time_s).abs() <= same_s) {
            Some(one) => one.size += step.size,
            None => all.push(*step),
        }
    }
    all.retain(|s| s.size != 0.0);
    all.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let now = (!all.is_empty()).then(|| warning(record, channel, &all));
    let at = before.unwrap_or(record.warnings.len());
    record.warnings.splice(at..before.map_or(at, |k| k + 1), now);
}

/// One warning for all steps of a channel, in order of time.
fn warning(record: &Record, channel: usize, steps: &[Step]) -> Warning {
    let (name, unit) = (&record.channels[channel].name, record.channels[channel].unit.as_str());
    let word = record.numbering.as_ref().map_or("row", |n| n.word);
    let one = |s: &Step| {
        let unit = if unit == "count" && s.size.abs() != 1.0 { "counts" } else { unit };
        let near = if s.near { "near " } else { "" };
        let place =
            s.row.map_or_else(|| format!("t = {} s", s.time_s), |row| format!("{word} {row} (t = {} s)", s.time_s));
        format!("{near}{place} by {:+} {unit}", s.size)
    };
    let list: Vec<String> = steps.iter().take(NAMED).map(one).collect();
    let more = if steps.len() > NAMED { format!(" and {} more", steps.len() - NAMED) } else { String::new() };
    let times = if steps.len() == 1 { String::new() } else { format!(", {} times", steps.len()) };
    let known = if steps.iter().any(|s| s.near) {
        "The steps are taken back; the equations show those \"near\" a row, to a few rows"
    } else {
        "The steps are taken back, each right to about a count"
    };
    let mut warning = Warning::new(
        ID,
        format!("{name} slips by a step that stays{times}: {}{more}", list.join(", ")),
        format!("{known}; look at the encoder's signals: counts were lost or gained"),
    )
    .with("channel", name.clone())
    .with("time_s", steps[0].time_s)
    .with("value", steps[0].size)
    .with("sizes", steps.iter().map(|s| s.size).collect::<Vec<f64>>())
    .with("times_s", steps.iter().map(|s| s.time_s).collect::<Vec<f64>>())
    .with("near", steps.iter().map(|s| s.near).collect::<Vec<bool>>());
    if let Some(rows) = steps.iter().map(|s| s.row).collect::<Option<Vec<u64>>>() {
        warning = warning.with("row", rows[0]).with("rows", rows);
    }
    warning
}

/// The steps that a warning tells.
fn told(warning: &Warning) -> Vec<Step> {
    let of = |key: &str| warning.details.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let (rows, sizes, near) = (of("rows"), of("sizes"), of("near"));
    let one = |(k, time): (usize, &Value)| {
        Some(Step {
            row: rows.get(k).and_then(Value::as_u64),
            time_s: time.as_f64()?,
            size: sizes.get(k)?.as_f64()?,
            near: near.get(k)?.as_bool()?,
        })
    };
    of("times_s").iter().enumerate().filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::record::ReadOptions;
    use crate::rig::Rig;

    #[test]
    fn what_a_step_missed_is_no_other_step() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/single-pendulum.toml")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.csv");
        std::fs::write(&path, (0..60).fold("t,count1\n".to_owned(), |t, i| format!("{t}{},{i}\n", i as f64 * 0.004)))
            .unwrap();
        let mut record = Record::read(&path, &rig, &ReadOptions::default()).unwrap();
        let step = |row, time_s, size, near| Step { row: Some(row), time_s, size, near };
        tell(&mut record, 0, &[step(15_002, 30.0, 18.0, false)], 0.0);
        tell(&mut record, 0, &[step(15_004, 30.004, -1.0, true), step(902, 1.8, 1.0, true)], 0.024);
        let [w] = &record.warnings[..] else { panic!("{:?}", record.warnings) };
        assert_eq!((&w.details["rows"], &w.details["sizes"]), (&vec![902, 15_002].into(), &vec![1.0, 17.0].into()));
        assert!(
            w.text.contains("2 times: near line 902 (t = 1.8 s) by +1 count, line 15002 (t = 30 s) by +17 counts"),
            "{w:?}"
        );
        // Nothing is left of steps that cancel.
        tell(&mut record, 0, &[step(902, 1.8, -1.0, true), step(15_000, 29.996, -17.0, true)], 0.024);
        assert!(record.warnings.is_empty(), "{:?}", record.warnings);
    }
}

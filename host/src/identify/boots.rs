//! Stretches that count from one zero.
//!
//! An incremental encoder counts from where it stood when its device started, or where it was told
//! to. After a restart within a record that may be another place, by an offset that nobody knows:
//! pooled as if the zero were one, B12 of the chaotic rig came out as 0.0057 for 0.0708. The device
//! tells where its zeros are from ([`crate::record::DeviceBoot`]): boots whose zeros have the same
//! ids, as after a watchdog's reset of arms that rested, are pooled; others are kept apart, and of
//! those the longest is used, the first of equals. Where a record does not tell zeros, every boot
//! has one of its own.
//!
//! Limits: within one record; several records are taken as they are given.

use std::borrow::Cow;

use crate::record::{Record, Segment};
use crate::warning::Warning;
use crate::wording::format::{in_seconds, instant};

/// Segments that count from one zero: a boot of theirs, and their length.
struct Group {
    boot: u32,
    seconds: f64,
}

/// Whether two boots of a record count from the same zeros.
fn same_zeros(record: &Record, a: u32, b: u32) -> bool {
    let listed = |boot| record.metadata.as_ref()?.told_of(boot);
    a == b || listed(a).zip(listed(b)).is_some_and(|(a, b)| a.has_zeros_of(b, record.channels.len()))
}

/// The zeros of a record, in the order in which they come.
fn groups(record: &Record) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for segment in &record.segments {
        match groups.iter_mut().find(|group| same_zeros(record, group.boot, segment.boot)) {
            Some(group) => group.seconds += segment.duration_s(),
            None => groups.push(Group { boot: segment.boot, seconds: segment.duration_s() }),
        }
    }
    groups
}

/// The longest of them, the first of equals.
fn longest(groups: &[Group]) -> Option<&Group> {
    groups.iter().reduce(|best, group| if group.seconds > best.seconds { group } else { best })
}

/// When stretches are, for people: `0.000 to 12.000 s, 20.000 to 30.000 s`; of many, the first
/// ones.
fn times(segments: &[&Segment]) -> String {
    const SHOWN: usize = 3;
    let time = |s: &&Segment| {
        let of = |t: f64| instant(t, s.step_s);
        format!("{} to {} s", of(s.start_s), of(s.start_s + s.duration_s()))
    };
    let mut words: Vec<String> = segments.iter().take(SHOWN).map(time).collect();
    if segments.len() > SHOWN {
        words.push(format!("{} more", segments.len() - SHOWN));
    }
    words.join(", ")
}

/// The options that name a stretch.
fn options(s: &Segment) -> String {
    let of = |t: f64| instant(t, s.step_s).replace('−', "-");
    format!("--from {} --to {}", of(s.start_s), of(s.start_s + s.duration_s()))
}

/// The records, of each what counts from its longest zero, and a warning for each of which
/// something is left out.
pub fn of_known_zero(records: &[Record]) -> (Cow<'_, [Record]>, Vec<Warning>) {
    let all: Vec<Vec<Group>> = records.iter().map(groups).collect();
    if all.iter().all(|groups| groups.len() <= 1) {
        return (Cow::Borrowed(records), Vec::new());
    }
    let mut warnings = Vec::new();
    let kept = records.iter().zip(&all).map(|(record, groups)| {
        let Some(best) = longest(groups).filter(|_| groups.len() > 1) else { return record.clone() };
        let (used, left): (Vec<&Segment>, Vec<&Segment>) =
            record.segments.iter().partition(|s| same_zeros(record, best.boot, s.boot));
        let left_s: f64 = groups.iter().map(|group| group.seconds).sum::<f64>() - best.seconds;
        warnings.push(
            Warning::new(
                "restarted",
                format!(
                    "{}: the device restarted and counted from another zero: the longest part with one zero is used, t = {}; \
                     {} are left out, t = {}",
                    record.path.display(),
                    times(&used),
                    in_seconds(left_s),
                    times(&left)
                ),
                format!(
                    "To use another part, name it with --from and --to, such as {}; its zero may be another pose than the one set",
                    left.first().map_or_else(String::new, |s| options(s))
                ),
            )
            .with("kept_s", best.seconds)
            .with("left_out_s", left_s)
            .with("zeros", groups.len()),
        );
        let mut out = record.clone();
        out.segments.retain(|s| same_zeros(record, best.boot, s.boot));
        out
    });
    let kept = kept.collect();
    (Cow::Owned(kept), warnings)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::{Settings, identify};
    use crate::record::device_boot::EncoderZero;
    use crate::record::{Column, DeviceBoot, Metadata, ReadOptions};
    use crate::rig::Rig;

    fn chaotic() -> (Rig, Record) {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("record.parquet");
        crate::simulate::record(&rig, &[], 60.0, 3, &file, &indicatif::ProgressBar::hidden()).unwrap();
        let record = Record::read(&file, &rig, &ReadOptions::default()).unwrap();
        (rig, record)
    }

    /// Rows of a segment, as another boot's, its counts turned on.
    fn part(segment: &Segment, rows: core::ops::Range<usize>, boot: u32, turned: i32) -> Segment {
        let mut out = Segment { boot, ..segment.rows(rows) };
        for column in &mut out.columns {
            if let Column::Counts(c) = column {
                c.iter_mut().for_each(|c| *c += turned);
            }
        }
        out
    }

    /// The record with a restart after so many seconds, over which the zero was kept or not.
    fn restarted(record: &Record, at_s: f64, kept: bool) -> Record {
        let whole = &record.segments[0];
        let at = (at_s / whole.step_s).round() as usize;
        let boot = |tick: i64, id: u32| DeviceBoot {
            tick,
            boot_id: u32::from(tick != whole.first_tick),
            zeros: vec![EncoderZero { id, ..EncoderZero::default() }; 2],
            ..DeviceBoot::default()
        };
        // A tick stands between two boots.
        let (first, second) =
            (part(whole, 0..at, 0, 0), part(whole, at + 1..whole.len(), 1, if kept { 0 } else { 1024 }));
        let metadata = Metadata {
            boots: vec![second.first_tick],
            device: vec![boot(first.first_tick, 1), boot(second.first_tick, if kept { 1 } else { 2 })],
            ..record.metadata.clone().unwrap_or_default()
        };
        Record { segments: vec![first, second], metadata: Some(metadata), ..record.clone() }
    }

    #[test]
    fn boots_of_one_zero_are_pooled_and_others_are_not() {
        let (rig, record) = chaotic();
        assert!(matches!(of_known_zero(core::slice::from_ref(&record)), (Cow::Borrowed(_), w) if w.is_empty()));
        let b12 = |record: &Record| {
            let found = identify(core::slice::from_ref(record), &rig, &Settings::default()).unwrap();
            let b12 = found.parameter("B12").unwrap();
            (b12.value, b12.std_error, found.equations_used, found.warnings)
        };
        let plain = b12(&record);
        // Kept over a watchdog's reset: all samples are used.
        let kept = b12(&restarted(&record, 20.0, true));
        assert!(kept.3.iter().all(|w| w.id != "restarted"));
        assert!((kept.0 - plain.0).abs() < 3.0 * kept.1, "{} {} {}", kept.0, plain.0, kept.1);
        assert!(kept.2 * 10 > plain.2 * 8, "{} of {}", kept.2, plain.2);
        // Not kept: the longer part alone, whichever it is.
        let (start_s, step_s) = (record.segments[0].start_s, record.segments[0].step_s);
        for (at_s, begins_s) in [(20.0, start_s + 20.0 + step_s), (40.0, start_s)] {
            let other = b12(&restarted(&record, at_s, false));
            let warning = other.3.iter().find(|w| w.id == "restarted").unwrap();
            assert!(warning.text.contains(&format!("is used, t = {begins_s:.3} to")), "{}", warning.text);
            assert!((other.2 as f64) < 0.75 * plain.2 as f64 && other.2 * 2 > plain.2, "{} of {}", other.2, plain.2);
        }
        // A record that tells no zeros: as if every boot had one of its own.
        let mut silent = restarted(&record, 40.0, true);
        silent.metadata.as_mut().unwrap().device.clear();
        let (used, warnings) = of_known_zero(core::slice::from_ref(&silent));
        assert_eq!((used[0].segments.len(), warnings.len()), (1, 1));
    }
}

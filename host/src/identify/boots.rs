//! Stretches whose zero is known: those before the device restarted.
//!
//! An incremental encoder counts from where it stood when its device started. After a restart within a record that is another
//! place, by an offset that nobody knows: pooled as if the zero were one, B12 of the chaotic rig came out as 0.0057 for 0.0708. Only the
//! stretches of a record's first boot are used, since only their zero is the one that was set.
//!
//! Limits: what came after a restart is left out, even where it is longer.

use std::borrow::Cow;

use crate::record::Record;
use crate::warning::Warning;

/// The records without what came after a restart, and a warning for each in which something did.
pub fn of_known_zero(records: &[Record]) -> (Cow<'_, [Record]>, Vec<Warning>) {
    let restarted = |r: &Record| r.segments.iter().any(|s| s.boot != r.segments[0].boot);
    if !records.iter().any(restarted) {
        return (Cow::Borrowed(records), Vec::new());
    }
    let mut warnings = Vec::new();
    let kept = records
        .iter()
        .map(|record| {
            if !restarted(record) {
                return record.clone();
            }
            let first = record.segments[0].boot;
            let mut out = record.clone();
            out.segments.retain(|s| s.boot == first);
            let seconds =
                |r: &Record| r.segments.iter().map(|s| s.len() as f64 * s.step_s).sum::<f64>();
            let (kept, left) = (seconds(&out), seconds(record) - seconds(&out));
            warnings.push(
                Warning::new(
                    "restarted",
                    format!(
                        "{}: the device restarted after {kept:.3} s; the {left:.3} s after that count from another zero, which is not known, and are left out",
                        record.path.display()
                    ),
                    "Set the zero and record again where that is too little, or find what took the device's power away",
                )
                .with("kept_s", kept)
                .with("left_out_s", left),
            );
            out
        })
        .collect();
    (Cow::Owned(kept), warnings)
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::{Settings, identify};
    use crate::record::{Column, ReadOptions};
    use crate::rig::Rig;

    #[test]
    fn what_counts_from_another_zero_is_left_out() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("record.parquet");
        crate::simulate::record(&rig, &[], 60.0, 3, &file, &indicatif::ProgressBar::hidden()).unwrap();
        let record = Record::read(&file, &rig, &ReadOptions::default()).unwrap();
        assert!(matches!(of_known_zero(core::slice::from_ref(&record)), (Cow::Borrowed(_), w) if w.is_empty()));
        // The same again as after a restart with the arms a quarter turn further on.
        let mut twice = record.clone();
        let mut second = record.segments[0].clone();
        second.boot = 1;
        second.start_s += 100.0;
        for column in &mut second.columns {
            if let Column::Counts(c) = column {
                c.iter_mut().for_each(|c| *c += 1024);
            }
        }
        twice.segments.push(second);
        let [plain, found] = [record, twice].map(|r| identify(&[r], &rig, &Settings::default()).unwrap());
        assert_eq!(plain.parameter("B12").unwrap().value, found.parameter("B12").unwrap().value);
        let told = found.warnings.iter().find(|w| w.id == "restarted").unwrap();
        assert!(told.text.contains("60.000 s after that"), "{}", told.text);
    }
}

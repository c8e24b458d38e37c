//! Explanations of simulated rigs: a hidden effect is named with its strength, nothing is named where nothing is missing, and a locked
//! record decides nothing.

use std::path::Path;

use whirl::explain::{Explanation, Settings, Verdict, explain};
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;

/// Simulates `seconds` of a rig with effects and explains the record.
fn explained(rig: &str, effects: &[&str], seconds: f64, seed: u64) -> Explanation {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(rig);
    let mut text = std::fs::read_to_string(&path).unwrap();
    if rig == "seed.toml" {
        // Long enough for every transient to have died out.
        text = text.replace("settle_s = 20.0", "settle_s = 600.0");
    }
    let rig = Rig::parse(&text, &path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("record.parquet");
    let effects: Vec<String> = effects.iter().map(|e| (*e).to_owned()).collect();
    whirl::simulate::record(&rig, &effects, seconds, seed, &file, &indicatif::ProgressBar::hidden()).unwrap();
    let record = Record::read(&file, &rig, &ReadOptions::default()).unwrap();
    explain(&[record], &rig, &Settings::default()).unwrap()
}

#[test]
fn a_hidden_drag_is_named_with_its_strength_and_the_gap_closes() {
    let e = explained("chaotic.toml", &["quadratic-drag@arm2=2e-7"], 80.0, 1);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    assert_eq!(e.effects.len(), 1, "{:?}", e.effects);
    let f = &e.effects[0];
    assert_eq!((f.id.as_str(), f.at.as_str(), f.unit.as_str()), ("quadratic-drag", "arm2", "N m s²"));
    assert!((f.value - 2e-7).abs() < 5.0 * f.std_error && f.std_error < 2e-9, "{} ± {}", f.value, f.std_error);
    let steps = &e.gap.steps;
    assert!(steps[0].added.is_none() && steps[0].value > 3.0, "{steps:?}");
    assert!(steps[1].added.as_deref() == Some("quadratic-drag@arm2") && steps[1].value < 1.1, "{steps:?}");
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let e = explained("chaotic.toml", &[], 60.0, 2);
    assert_eq!(e.verdict, Verdict::NothingMissing, "{}", e.reason);
    assert!(e.effects.is_empty() && e.gap.steps.len() == 1 && e.gap.steps[0].value < 1.1);
}

#[test]
fn a_locked_record_decides_nothing() {
    let e = explained("seed.toml", &["quadratic-drag@arm2=2e-7"], 60.0, 1);
    assert_eq!(e.verdict, Verdict::NotDecidable, "{}", e.reason);
    assert!(e.effects.is_empty() && e.reason.contains("locked"), "{}", e.reason);
}

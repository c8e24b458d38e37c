//! Records too short for the windows that their motion asks for.

use core::f64::consts::TAU;

use super::*;
use crate::record::{Losses, ReadOptions};

const SYSTEM: &str = r#"
name = "swing"
time = "s"
coordinates = [{ name = "x", space = "R" }]

[[equation]]
balance = "-x''"
terms = { k = "x", c = "x'" }
"#;
const RIG: &str = r#"
name = "camera"
model = "swing.toml"
sample_rate_hz = 30.0
time = "t"
channel = [{ name = "x", measures = "x", unit = "m" }]
"#;

/// Made ready from so many samples of a camera at 30 Hz.
fn ready(samples: usize, x: impl Fn(f64) -> f64, window_s: Option<f64>) -> Result<Prepared> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("swing.toml"), SYSTEM).unwrap();
    let (rig, path) = (folder.path().join("rig.toml"), folder.path().join("r.csv"));
    std::fs::write(&rig, RIG).unwrap();
    let noise = |i: usize| 1e-4 * (((i * 7919) % 1009) as f64 / 1009.0 - 0.5);
    let row = |i: usize| format!("{:.6},{:.6}\n", i as f64 / 30.0, x(i as f64) + noise(i));
    std::fs::write(&path, format!("t,x\n{}", (0..samples).map(row).collect::<String>())).unwrap();
    let rig = Rig::read(&rig).unwrap();
    let record = Record::read(&path, &rig, &ReadOptions::default()).unwrap();
    let settings = Settings { window_s, ..Settings::default() };
    prepare_moving(&[record], &rig, rig.bound.as_ref().unwrap(), &settings)
}

/// A swing of 1.2 Hz that dies away.
fn swing(i: f64) -> f64 {
    0.1 * (-i / 135.0).exp() * (TAU * 1.2 * i / 30.0).sin()
}

#[test]
fn a_short_record_has_windows_of_its_motion() {
    for (samples, periods) in [(135, 1.8..4.3), (75, 1.2..2.5)] {
        let found = ready(samples, swing, None).unwrap_or_else(|e| panic!("{samples}: {e}"));
        let windows = found.geometry.windows;
        assert!(periods.contains(&(1.2 * windows.length_s)), "{samples}: {windows:?}");
    }
}

#[test]
fn a_refusal_tells_the_least_that_is_allowed() {
    let refused = |window_s| ready(45, swing, window_s).unwrap_err().to_string();
    let free = refused(None);
    assert!(free.contains("found 45 samples (1.5 s)"), "{free}");
    assert!(free.contains("at least 64 (2.134 s): one window of 1.067 s"), "{free}");
    assert!(free.ends_with("Record longer, or with a higher sampling rate"), "{free}");
    let asked = refused(Some(1.2));
    assert!(asked.ends_with("with --window-s, 1.067 s at least"), "{asked}");
}

#[test]
fn a_standstill_stays_where_only_pieces_too_short_would_be_left() {
    let stops = |i: f64| 0.1 * (0.63 * if i < 50.0 { i } else { (i - 30.0).max(50.0) }).sin();
    let found = ready(130, stops, Some(1.067)).unwrap_or_else(|e| panic!("{e}"));
    assert!(found.still.is_empty() && found.stretches.len() == 1 && found.stretches[0].len() == 130);
}

#[test]
fn what_cuts_a_record_is_said() {
    let left_out = Warning::new("channel-stopped", "a stops", "Look at its cable").with("left_out", 20);
    let of = |gaps: u64, warnings: &[Warning]| Record {
        losses: Losses { gaps, ..Losses::default() },
        warnings: warnings.to_vec(),
        ..Record::default()
    };
    let cut = remedy(&[of(0, std::slice::from_ref(&left_out))], 2, "Record longer");
    assert!(cut.contains("left out cut the record: a stops. Look at its cable. Otherwise record"), "{cut}");
    assert!(remedy(&[of(1, &[left_out])], 3, "Record longer").starts_with("Gaps cut the record"));
    assert!(remedy(&[of(0, &[])], 1, "Record longer").starts_with("Record longer"));
}

//! The measured double pendulum: dynamicslab/MultiArm-Pendulum (MIT).

use std::io::Write;
use std::path::PathBuf;

use whirl_tests::repository;

use super::program::{done, json};

/// Published distance between the joints, mm.
const PUBLISHED_MM: f64 = 172.72;

#[test]
fn the_measured_double_pendulum_gives_the_published_length() {
    let Some(records) = std::env::var_os("WHIRL_RECORDS").map(PathBuf::from) else {
        // Past the test harness's capture, so that it is seen.
        let _ = writeln!(
            std::io::stderr(),
            "measured double pendulum: did not run, WHIRL_RECORDS is not set; the record can be had from \
             https://github.com/dynamicslab/MultiArm-Pendulum (MIT), see README, \"Measured records\""
        );
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let record = records.join("multiarm/double.csv.gz");
    let rig = repository("rigs/measured-double-pendulum.toml");
    done(
        folder.path(),
        &format!("identify {} --rig {} --json out.json --report out.html", record.display(), rig.display()),
    );
    let out = json(&folder.path().join("out.json"));
    let parameters = out["parameters"].as_array().unwrap();
    let value = |name: &str| {
        let p = parameters.iter().find(|p| p["name"] == name).unwrap_or_else(|| panic!("no {name} in {out}"));
        let (value, std_error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!(value.is_finite() && std_error > 0.0 && std_error.is_finite(), "{p}");
        value
    };
    for name in ["B11", "B12", "B21", "B22", "C12", "C2"] {
        value(name);
    }
    // No drive: no columns of it.
    assert!(
        !parameters.iter().any(|p| ["B13", "B14", "B15", "B23", "B24", "B25"].contains(&p["name"].as_str().unwrap()))
    );
    let l1_mm = 1e3 * 9.8086 * value("B21") / value("B22");
    assert!((l1_mm - PUBLISHED_MM).abs() < 1.0, "l1 = {l1_mm:.3} mm");
    assert_eq!(out["record"]["samples"], 54_000);
    assert!(std::fs::metadata(folder.path().join("out.html")).unwrap().len() > 10_000);
}

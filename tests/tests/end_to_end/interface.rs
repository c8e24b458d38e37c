//! What programs outside rely on: JSON on standard output alone, exit statuses, lists.

use super::program::{done, rig_file, whirl};

#[test]
fn json_on_standard_output_is_alone_there() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    for command in [
        "simulate --rig rig.toml --seconds 20 --seed 1 -o r.parquet --json -",
        "capture --from sim --rig rig.toml --seconds 2 -o c.parquet --json -",
        "inspect r.parquet --rig rig.toml --json -",
        "identify r.parquet --rig rig.toml --json -",
    ] {
        let text = done(at, command);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{command}: {e}: {text}"));
        assert!(value.is_object(), "{command}");
    }
    let value: serde_json::Value =
        serde_json::from_str(&done(at, "identify r.parquet --rig rig.toml --json -")).unwrap();
    for key in [
        "model",
        "method",
        "parameters",
        "identification_error",
        "equations_used",
        "equations_dropped",
        "groups_not_separable",
        "record",
    ] {
        assert!(!value[key].is_null(), "{key}");
    }
    let names: Vec<&str> =
        value["parameters"].as_array().unwrap().iter().map(|p| p["name"].as_str().unwrap()).collect();
    assert_eq!(names[..13], ["B11", "B12", "B13", "B14", "B15", "B21", "B22", "B23", "B24", "B25", "C11", "C12", "C2"]);
    assert_eq!(value["record"], serde_json::json!({"samples": 10_000, "lost": 0, "segments": 1}));
}

#[test]
fn usage_errors_end_with_status_2_and_lists_with_0() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for wrong in
        ["frobnicate", "identify --frobnicate", "identify", "simulate --rig", "list colours", "demo --threads x"]
    {
        let run = whirl(at, wrong);
        assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{wrong}");
        assert!(!run.stderr.is_empty(), "{wrong}");
    }
    for list in ["models", "effects", "boards", "methods"] {
        let text = done(at, &format!("list {list}"));
        assert!(text.lines().count() >= 1 && text.lines().all(|l| l.split_whitespace().count() > 2), "{list}: {text}");
    }
    let effects = done(at, "list effects");
    let ids: Vec<&str> = effects.lines().map(|l| l.split_whitespace().next().unwrap()).collect();
    for id in [
        "viscous-friction coulomb-friction stribeck-friction load-dependent-friction quadratic-drag",
        "asymmetric-friction torsion-spring cubic-stiffness quadratic-stiffness backlash cogging",
        "amplitude-dependent-damping imbalance constant-force frame-tilt horizontal-motion vertical-motion",
        "drive-harmonic-2 drive-harmonic-3 amplitude-drift frequency-offset zero-offset scale-error eccentricity",
        "channel-delay quintic-stiffness friction-ripple friction-drift power-law-damping stiffness-modulation",
        "local-force distributed-drag dahl-friction lugre-friction hysteresis relaxation play tone coupling-stiffness",
        "resonator input-gain input-offset input-delay time-base zero-drift body-drag",
    ]
    .iter()
    .flat_map(|line| line.split(' '))
    {
        assert!(ids.contains(&id), "{id}");
    }
    assert!(done(at, "list models").contains("double-pendulum"));
    assert!(done(at, "list models --show cart-pendulum").contains("[[body]]"));
    let drag = done(at, "list effects --show quadratic-drag");
    assert!(drag.contains("\nconfirm = ") && drag.matches("[[effect]]").count() == 1, "{drag}");
    assert!(done(at, "list effects --show vertical-motion").contains("\nconfirm = "));
    assert_eq!(whirl(at, "list effects --show nothing").status, 2);
    assert!(done(at, "--version").starts_with("whirl "));
    for command in ["demo", "simulate", "capture", "inspect", "identify", "list"] {
        assert!(done(at, &format!("{command} --help")).contains("Usage"), "{command}");
    }
}

#[test]
fn strict_turns_missing_samples_into_status_1_with_results_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    done(at, "simulate --rig rig.toml --seconds 24 --seed 1 -o whole.csv");
    let text = std::fs::read_to_string(at.join("whole.csv")).unwrap();
    let gap: Vec<&str> =
        text.lines().enumerate().filter(|(i, _)| !(6000..6010).contains(i)).map(|(_, line)| line).collect();
    std::fs::write(at.join("gap.csv"), gap.join("\n") + "\n").unwrap();
    done(at, "identify whole.csv --rig rig.toml --strict");
    done(at, "identify gap.csv --rig rig.toml");
    for command in ["inspect", "identify"] {
        let run = whirl(at, &format!("{command} gap.csv --rig rig.toml --strict --json {command}.json"));
        assert_eq!(run.status, 1, "{run:?}");
        assert!(run.stderr.contains("10 samples are missing"), "{run:?}");
        assert!(at.join(format!("{command}.json")).exists());
    }
    let value: serde_json::Value = serde_json::from_str(&done(at, "identify gap.csv --rig rig.toml --json -")).unwrap();
    assert_eq!(value["record"], serde_json::json!({"samples": 11_990, "lost": 10, "segments": 2}));
}

//! `whirl reduce` from the command line: decays, forced response, tables, records taken block by
//! block, refusals.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;
use std::path::Path;

use super::program::{done, json, whirl};

/// Viscous damping of the decays, 1/s.
const DAMPING: f64 = 0.02;

/// Free decays of ẍ + 0.02 ẋ + x + x³ = 0 (classical Runge–Kutta, 10 ms) at two points, the second
/// of which moves half as far; 20 rows a second.
fn decays(folder: &Path) {
    std::fs::write(
        folder.join("rig.toml"),
        "name = \"oscillator\"\nmodel = \"records\"\nsample_rate_hz = 20.0\n\
         [[channel]]\nname = \"x1\"\nunit = \"m\"\nmeasures = \"x1\"\n\
         [[channel]]\nname = \"x2\"\nunit = \"m\"\nmeasures = \"x2\"\n",
    )
    .unwrap();
    let rate = |[x, v]: [f64; 2]| [v, -x - x.powi(3) - DAMPING * v];
    for (name, start) in [("high.csv", 0.6), ("low.csv", 0.3)] {
        let (mut state, h) = ([start, 0.0], 0.01);
        let mut text = "t,x1,x2\n".to_owned();
        for i in 0..12_000 {
            if i % 5 == 0 {
                writeln!(text, "{:.2},{:.10},{:.10}", f64::from(i) * h, state[0], 0.5 * state[0]).unwrap();
            }
            let moved = |k: [f64; 2], share: f64| [state[0] + share * h * k[0], state[1] + share * h * k[1]];
            let a = rate(state);
            let b = rate(moved(a, 0.5));
            let c = rate(moved(b, 0.5));
            let d = rate(moved(c, 1.0));
            for k in 0..2 {
                state[k] += h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]);
            }
        }
        std::fs::write(folder.join(name), text).unwrap();
    }
}

/// Frequency (Hz) of the free oscillator released at rest from x: Duffing's period is 4K/√(1 + x²),
/// and the complete elliptic integral K = π/(2 agm).
fn exact_hz(x: f64) -> f64 {
    let m = x * x / (2.0 * (1.0 + x * x));
    let (mut a, mut g) = (1.0, (1.0 - m).sqrt());
    for _ in 0..40 {
        (a, g) = (0.5 * (a + g), (a * g).sqrt());
    }
    (1.0 + x * x).sqrt() / (4.0 * PI / (2.0 * a))
}

#[test]
fn decays_give_backbone_damping_and_forced_response_as_numbers_and_as_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    decays(folder);
    done(folder, "reduce high.csv low.csv --rig rig.toml --force 0.02 --curves curves.csv --json out.json --quiet");
    let out = json(&folder.join("out.json"));
    let damping = out["forced"]["damping_found"]["value"].as_f64().unwrap();
    assert!((damping / DAMPING - 1.0).abs() < 1e-4, "{damping}");
    // Unit masses at both points: E = (1 + ¼)(½x² + ¼x⁴) at rest.
    let points = out["frequency_energy"]["reduced"].as_array().unwrap();
    assert!(points.len() >= 5);
    for point in points {
        let [energy, hz] = [0, 1].map(|i: usize| point[i].as_f64().unwrap());
        let x = ((1.0 + 4.0 * energy / 1.25).sqrt() - 1.0).sqrt();
        assert!((hz / exact_hz(x) - 1.0).abs() < 2e-4, "{energy}: {hz} {}", exact_hz(x));
    }
    let table = std::fs::read_to_string(folder.join("curves.csv")).unwrap();
    let mut rows = table.lines();
    assert_eq!(rows.next().unwrap(), "curve,frequency_hz,frequency_std_error_hz,amplitude,energy,lag_rad,stable");
    let forced: Vec<Vec<&str>> =
        rows.map(|r| r.split(',').collect()).filter(|r: &Vec<&str>| r[0] == "forced").collect();
    assert_eq!(forced.len(), out["forced"]["curve"].as_array().unwrap().len());
    // A hardening oscillator bends to higher frequencies: three answers somewhere, the middle one
    // unstable.
    assert!(forced.iter().any(|r| r[6] == "false") && forced.iter().any(|r| r[6] == "true"));
    assert!(!out["forced"]["folds"].as_array().unwrap().is_empty());
    for row in &forced {
        let hz: f64 = row[1].parse().unwrap();
        assert!(hz > 1.0 / TAU * 0.8 && hz < 1.0 / TAU * 1.5, "{hz}");
    }
}

#[test]
fn block_by_block_has_the_same_modes_and_what_makes_no_sense_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    decays(folder);
    done(folder, "reduce high.csv low.csv --rig rig.toml --json whole.json --quiet");
    let text = done(folder, "reduce high.csv low.csv --rig rig.toml --stream --quiet");
    assert!(text.contains("block by block"), "{text}");
    done(folder, "reduce high.csv low.csv --rig rig.toml --stream --json parts.json --quiet");
    let (whole, parts) = (json(&folder.join("whole.json")), json(&folder.join("parts.json")));
    for c in 0..2 {
        let of = |v: &serde_json::Value| v["modes"][0][c].as_f64().unwrap();
        assert!((of(&whole) - of(&parts)).abs() < 1e-9);
    }
    assert!((whole["modes"][0][0].as_f64().unwrap() - 2.0 / 5f64.sqrt()).abs() < 1e-6);
    for (arguments, place) in [
        ("--stream --constraint polar", "--constraint"),
        ("--force 0.02 --force-shape 1", "--force-shape"),
        ("--force nan", "--force"),
        ("--damping=-1 --force 0.02", "--damping"),
    ] {
        let run = whirl(folder, &format!("reduce high.csv low.csv --rig rig.toml {arguments}"));
        assert!(run.status == 2 && run.stderr.contains(place), "{arguments}: {run:?}");
        assert!(run.stdout.is_empty(), "{arguments}: {run:?}");
    }
}

//! Parameters of simulated rigs beside their truth.

use whirl_tests::accuracy::{coverage, table};

use super::program::{done, json, whirl};

/// Seeds for each drive frequency; `--example identification_table` prints what this test holds.
const SEEDS: u64 = 20;

#[test]
fn parameters_of_the_chaotic_rig_are_found_with_honest_standard_errors() {
    let table = table(&[5.0, 5.2], 1..=SEEDS);
    assert_eq!(table.len() as u64, 2 * SEEDS * 13);
    for c in &table {
        assert!(c.relative() <= c.allowed(), "off by {:.3} %: {c:?}", 100.0 * c.relative());
        assert!(c.std_error > 0.0 && c.deviations() <= 5.0, "{:.1} standard errors: {c:?}", c.deviations());
    }
    let (comparisons, within, worst) = coverage(&table);
    assert!(within as f64 >= 0.98 * comparisons as f64, "{within} of {comparisons} within 3, the farthest at {worst}");
}

/// Without a method: shooting where it stands, near the bound of Cramér and Rao; the weak form
/// where the model misses something, and it says so.
#[test]
fn the_default_is_shooting_where_it_stands() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let rig = whirl_tests::repository("rigs/chaotic.toml");
    let rig = rig.display();
    done(here, &format!("simulate --rig {rig} --seconds 40 --seed 12 -o clean.parquet"));
    done(here, &format!("identify clean.parquet --rig {rig} --json clean.json"));
    let out = json(&here.join("clean.json"));
    assert_eq!(out["method"], "shooting", "{}", out["not_by_shooting"]);
    let bounds = out["shooting"]["cramer_rao"].as_array().unwrap();
    for (name, bound) in out["correlation_names"].as_array().unwrap().iter().zip(bounds) {
        let p = out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == *name).unwrap();
        let (error, bound) = (p["std_error"].as_f64().unwrap(), bound.as_f64().unwrap());
        assert!(bound > 0.0 && error < 1.5 * bound, "{name}: {error} over {bound}");
    }
    done(here, &format!("identify clean.parquet --rig {rig} --method weak --json weak.json"));
    assert_eq!(json(&here.join("weak.json"))["method"], "weak");
    done(
        here,
        &format!("simulate --rig {rig} --effect quadratic-drag@arm2=2e-7 --seconds 40 --seed 12 -o drag.parquet"),
    );
    let run = whirl(here, &format!("identify drag.parquet --rig {rig} --json drag.json"));
    assert!(run.status < 2 && run.stdout.contains("Multiple shooting was not used: "), "{run:?}");
    let out = json(&here.join("drag.json"));
    assert!(out["method"] == "weak" && out["not_by_shooting"].is_string(), "{}", out["method"]);
}

/// A swing of some twenty periods: what its pieces of two periods tell of its friction is a small part
/// of what the whole tells, to `identify` and to `explain`.
#[test]
fn a_free_motion_is_fitted_over_its_whole_length() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let rig = [
        "name = \"swing\"\nmodel = \"single-pendulum\"\nsample_rate_hz = 100.0\n",
        "[[channel]]\nname = \"count1\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 2048\n",
        "[known]\nm1 = 0.1\ne1 = 0.02\n",
        "[plant]\nm1 = 0.1\ne1 = 0.02\nJ_o1 = 1.5e-4\nc_r1 = 3e-5\ninitial = [1.2, 0.0]\n",
    ];
    std::fs::write(here.join("swing.toml"), rig.concat()).unwrap();
    let (friction, inertia) = ("c_r1", "J_o1");
    let mut off = Vec::new();
    for seed in 1..=6 {
        done(here, &format!("simulate --rig swing.toml --seconds 11 --seed {seed} -o r.csv --force"));
        let told = |command: &str| {
            done(here, &format!("{command} r.csv --rig swing.toml --json out.json --force"));
            json(&here.join("out.json"))
        };
        let errors = |out: &serde_json::Value| {
            let of = |name: &str| {
                let p = out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name);
                let p = p.unwrap_or_else(|| panic!("{}", out["parameters"]));
                (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap())
            };
            [of(friction), of(inertia)]
        };
        let out = told("identify");
        let [c, j] = errors(&out);
        assert_eq!(out["method"], "shooting", "{}", out["not_by_shooting"]);
        let [c_of_pieces, _] = errors(&told("identify --segment-s 1"));
        assert!(c.1 < 0.2 * c_of_pieces.1, "{c:?} {c_of_pieces:?}");
        off.extend([(c.0 - 3e-5) / c.1, (j.0 - 1.5e-4) / j.1]);
        if seed == 1 {
            let details = told("explain")["details"].clone();
            // Windows of the search are whole stretches, less what a low-pass reaches over.
            assert!(details["window_s"].as_f64() > Some(7.0), "{details}");
        }
    }
    let rms = (off.iter().map(|z| z * z).sum::<f64>() / off.len() as f64).sqrt();
    assert!(off.iter().all(|z| z.abs() < 4.0) && rms < 1.8, "{off:?}");
}

/// Arms that turn by half a radian between samples, driven with two and a half times gravity: states
/// of pieces are found from a few samples on, where searches over whole ones lead nowhere.
#[test]
fn what_is_driven_hard_and_sampled_slowly_is_shot() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let channel = |k: usize| {
        format!("[[channel]]\nname = \"count{k}\"\nmeasures = \"theta{k}\"\nunit = \"count\"\ncounts_per_turn = 512\n")
    };
    let rig = [
        "name = \"driven hard\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 100.0\n".to_owned(),
        "[drive]\ndirection = \"vertical\"\nfrequency_hz = 4.0\n".to_owned(),
        channel(1),
        channel(2),
        "[known]\nm2 = 0.1\ne2 = 0.05\nl1 = 0.1\n".to_owned(),
        "[plant]\nm1 = 0.1\ne1 = 0.05\nl1 = 0.1\nm2 = 0.1\ne2 = 0.05\nJ_o1 = 1.4e-3\nJ_o2 = 4e-4\ntau_c1 = 2e-4\n"
            .to_owned(),
        "c_r2 = 2e-5\namplitude_m = 0.04\ninitial = [0.3, 2.0, 0.0, 0.0]\nsettle_s = 20.0\n".to_owned(),
    ];
    std::fs::write(here.join("kicked.toml"), rig.concat()).unwrap();
    done(here, "simulate --rig kicked.toml --seconds 60 --seed 2 -o r.csv");
    done(here, "identify r.csv --rig kicked.toml --json out.json");
    let out = json(&here.join("out.json"));
    assert_eq!(out["method"], "shooting", "{}", out["not_by_shooting"]);
    let scale = 1.0 / (1.4e-3 * (core::f64::consts::TAU * 4.0).powi(2));
    for (name, truth) in [("B11", 5e-4 / 1.4e-3), ("B21", 5e-4 / 4e-4), ("C11", 2e-4 * scale)] {
        let p = out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * error && error < 0.05 * truth, "{p}");
    }
}

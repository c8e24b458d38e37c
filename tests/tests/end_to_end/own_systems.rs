//! Systems of one's own (model files): measured benchmarks, and what is hidden in simulated ones,
//! found.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json, whirl};

/// The folder of measured records, or none, which is told.
fn records(what: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("WHIRL_RECORDS").map(PathBuf::from);
    if folder.is_none() {
        // Past the test harness's capture, so that it is seen.
        let _ = writeln!(
            std::io::stderr(),
            "{what}: did not run, WHIRL_RECORDS is not set; see README, \"Measured records\", for where the record can be had"
        );
    }
    folder
}

pub fn rig(name: &str) -> String {
    repository("rigs").join(name).display().to_string()
}

/// Explains a record; the JSON.
fn explained(folder: &Path, record: &Path, rig_path: &str, more: &str) -> Value {
    done(folder, &format!("explain {} --rig {rig_path} --json out.json {more}", record.display()));
    json(&folder.join("out.json"))
}

fn names(out: &Value) -> Vec<String> {
    let list = out["effects"].as_array().unwrap();
    list.iter().map(|e| format!("{}@{}", e["id"].as_str().unwrap(), e["at"].as_str().unwrap())).collect()
}

/// Place of a name in a list.
fn place(names: &[String], wanted: &str) -> usize {
    names.iter().position(|n| n == wanted).unwrap_or_else(|| panic!("no {wanted} in {names:?}"))
}

pub fn parameter(out: &Value, name: &str) -> f64 {
    let list = out["parameters"].as_array().unwrap();
    list.iter().find(|p| p["name"] == name).unwrap_or_else(|| panic!("no {name}"))["value"].as_f64().unwrap()
}

/// Simulation errors of the model as given and with everything, for the share that was fitted.
fn simulation(out: &Value, fitted: f64) -> [f64; 2] {
    let list = out["simulation"].as_array().unwrap();
    let s = list.iter().find(|s| (s["fitted"].as_f64().unwrap() - fitted).abs() < 1e-6).unwrap();
    let steps = s["steps"].as_array().unwrap();
    [steps[0]["value"].as_f64().unwrap(), steps.last().unwrap()["value"].as_f64().unwrap()]
}

#[test]
fn the_positioning_drive_gives_its_published_values() {
    let Some(records) = records("measured positioning drive (EMPS)") else { return };
    let folder = tempfile::tempdir().unwrap();
    let record = records.join("emps/estimation.csv.gz");
    let identify = |rig_path: &str| {
        // Status 1 says that ε exceeds its bound, which is not what is judged here.
        let run = whirl(folder.path(), &format!("identify {} --rig {rig_path} --json i.json", record.display()));
        assert!(run.status < 2, "{run:?}");
        json(&folder.path().join("i.json"))
    };
    let out = identify(&rig("emps.toml"));
    for (name, published) in [("M", 95.11), ("F_v", 203.5), ("F_c", 20.39), ("offset", -3.16)] {
        let value = parameter(&out, name);
        assert!((value / published - 1.0).abs() < 0.01, "{name} = {value}, published {published}");
    }
    let force_error = |out: &Value| out["details"]["balance_error"][0].as_f64().unwrap();
    assert!(force_error(&out) <= 0.0395, "{}", force_error(&out));
    // Friction that differs with direction.
    let shipped = std::fs::read_to_string(repository("models/positioning-drive.toml")).unwrap();
    let wider = shipped.replace("offset = \"1\"", "offset = \"1\", F_a = \"abs(q')\"");
    assert_ne!(wider, shipped);
    std::fs::write(folder.path().join("model.toml"), wider).unwrap();
    let text = std::fs::read_to_string(repository("rigs/emps-viscous.toml")).unwrap();
    let text = text.replace("../models/positioning-drive-viscous.toml", "./model.toml");
    std::fs::write(folder.path().join("rig.toml"), text).unwrap();
    let out = identify("rig.toml");
    assert!(force_error(&out) <= 0.0293, "{}", force_error(&out));
}

#[test]
fn the_positioning_drive_lacks_coulomb_friction_and_a_constant_force() {
    let Some(records) = records("measured positioning drive (EMPS)") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = explained(folder.path(), &records.join("emps/estimation.csv.gz"), &rig("emps-viscous.toml"), "");
    // What takes the place of another (of Dahl's friction) is told behind the others.
    let all = names(&out);
    let [friction, constant] = ["coulomb-friction@q", "constant-force@q"].map(|n| all.iter().position(|x| x == n));
    assert!(friction.is_some() && constant.is_some(), "{all:?}");
    let steps: Vec<f64> =
        out["gap"]["steps"].as_array().unwrap().iter().map(|s| s["value"].as_f64().unwrap()).collect();
    assert!(*steps.last().unwrap() < 0.2 * steps[0], "{steps:?}");
}

#[test]
fn the_silverbox_lacks_cubic_and_quadratic_stiffness_and_damping_that_grows() {
    let Some(records) = records("measured electronic oscillator (Silverbox)") else { return };
    let folder = tempfile::tempdir().unwrap();
    let record = records.join("silverbox/multisine.csv.gz");
    let out = explained(folder.path(), &record, &rig("silverbox-linear.toml"), "");
    let names = names(&out);
    let [cubic, quadratic, damping] =
        ["cubic-stiffness@y", "quadratic-stiffness@y", "amplitude-dependent-damping@y"].map(|n| place(&names, n));
    assert!(cubic < quadratic && cubic < damping, "{names:?}");
    // V over the last quarter.
    let [linear, all] = simulation(&out, 0.75);
    assert!(linear > 6.9e-3 && all <= 0.26e-3, "{linear} {all}");
}

#[test]
fn the_measured_single_pendulum_is_continued_to_a_fifth_of_a_degree() {
    let Some(records) = records("measured single pendulum") else { return };
    let folder = tempfile::tempdir().unwrap();
    let record = records.join("multiarm/single.csv.gz");
    let out = explained(folder.path(), &record, &rig("measured-single-pendulum-viscous.toml"), "");
    // A law of friction is named; none of the laws that take energy away gives any.
    let frictions = ["friction", "drag", "damping"];
    let effects = out["effects"].as_array().unwrap();
    let friction = |e: &&Value| frictions.iter().any(|f| e["id"].as_str().unwrap().ends_with(f));
    assert!(effects.iter().any(|e| friction(&e)), "{:?}", names(&out));
    assert!(effects.iter().filter(friction).all(|e| e["value"].as_f64().unwrap() > 0.0), "{effects:?}");
    assert!(parameter(&out, "viscous") >= 0.0);
    for s in out["simulation"].as_array().unwrap() {
        for p in s["parameters"].as_array().unwrap() {
            let name = p["name"].as_str().unwrap();
            // A level that ripples has a sine and a cosine of either sign.
            if name == "viscous" || (frictions.iter().any(|f| name.contains(f)) && !name.contains("ripple")) {
                assert!(p["value"].as_f64().unwrap() >= 0.0, "{p}");
            }
        }
    }
    // From viscous, Coulomb and quadratic friction: the encoder, and what repeats with the angle,
    // are missing.
    let out = explained(folder.path(), &record, &rig("measured-single-pendulum.toml"), "");
    let [three, found] = simulation(&out, 0.75);
    assert!(found <= 0.2 && found < 0.5 * three, "{found} {three}");
    let all = names(&out);
    assert!(all.iter().any(|n| n == "eccentricity@encoder1") && all.iter().any(|n| n == "cogging@phi1"), "{all:?}");
}

/// What linearised shooting tells of an oscillator is what shooting with the model itself tells:
/// the same coefficients within a standard error, none larger.
#[test]
fn explanations_of_driven_oscillators_are_as_exact_as_shooting() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rig = rig("duffing.toml");
    done(folder, &format!("simulate --rig {rig} --seconds 40 --seed 11 -o r.csv"));
    done(folder, &format!("identify r.csv --rig {rig} --method shooting --json i.json"));
    let (one, other) = (explained(folder, &folder.join("r.csv"), &rig, ""), json(&folder.join("i.json")));
    assert_eq!(one["verdict"], "nothing-missing", "{}", one["reason"]);
    let power = one["residual_power"][1].as_f64().unwrap();
    assert!((power - 1.0).abs() < 0.15, "{power}");
    for (name, true_value) in [("m", 1.0), ("c", 0.4), ("k", 40.0), ("k3", 60.0)] {
        let of = |out: &Value| {
            let p = out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap().clone();
            (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap())
        };
        let ((a, a_error), (b, b_error)) = (of(&one), of(&other));
        assert!((a - b).abs() < 2.0 * b_error && a_error < 1.5 * b_error, "{name}: {a} {a_error}, {b} {b_error}");
        assert!((a - true_value).abs() < 5.0 * a_error, "{name}: {a} {a_error}");
    }
}

/// On a cart with a pendulum, under a measured force, a drag at the pendulum and an encoder's
/// offset are found together, with their values.
#[test]
fn a_drag_and_an_offset_are_found_together_on_a_cart_with_a_pendulum() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rig = rig("cart-pendulum.toml");
    let effects = "--effect quadratic-drag@theta=0.002 --effect zero-offset@encoder2=0.01";
    done(folder, &format!("simulate --rig {rig} {effects} --seconds 40 --seed 7 -o r.csv"));
    let out = explained(folder, &folder.join("r.csv"), &rig, "");
    let mut found = names(&out);
    found.sort();
    assert_eq!(found, ["quadratic-drag@theta", "zero-offset@encoder2"], "{}", out["gap"]);
    assert_eq!(out["verdict"], "explained", "{}", out["reason"]);
    for e in out["effects"].as_array().unwrap() {
        let wanted = if e["id"] == "zero-offset" { 0.01 } else { 0.002 };
        let (value, error) = (e["value"].as_f64().unwrap(), e["std_error"].as_f64().unwrap());
        assert!((value - wanted).abs() < 5.0 * error && error < 2e-3 * wanted, "{e}");
    }
}

/// What is hidden is found at its coordinate; the model that is written starts the next
/// explanation, which finds nothing more.
#[test]
fn effects_hidden_in_an_oscillator_are_found_written_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rig = rig("duffing.toml");
    done(folder, &format!("simulate --rig {rig} --effect coulomb-friction@x=0.8 --seconds 60 --seed 3 -o r.csv"));
    let out = explained(folder, &folder.join("r.csv"), &rig, "-o model.toml");
    assert_eq!(names(&out), ["coulomb-friction@x"], "{}", out["gap"]);
    assert_eq!(out["verdict"], "explained", "{}", out["reason"]);
    let e = &out["effects"][0];
    assert!((e["value"].as_f64().unwrap() / 0.8 - 1.0).abs() < 0.02 && e["unit"] == "N", "{e}");
    assert!((parameter(&out, "k3") / 60.0 - 1.0).abs() < 0.02);
    // The file is a model file, too, and the same model goes in again.
    let again = explained(folder, &folder.join("r.csv"), &rig, "--model model.toml -o again.toml");
    assert_eq!(again["verdict"], "nothing-missing", "{} {}", again["reason"], again["gap"]);
    let steps = again["gap"]["steps"].as_array().unwrap();
    assert_eq!((steps[0]["added"].is_null(), &steps[1]["added"]), (true, &Value::from("refit")));
    assert!(steps[0]["value"].as_f64().unwrap() < 1.3, "{steps:?}");
    let text = std::fs::read_to_string(folder.join("again.toml")).unwrap();
    assert!(text.contains("id = \"coulomb-friction\"") && text.contains("[[equation]]"), "{text}");
    // What `identify -o` writes is taken, too; another system's is not.
    // Without the friction the equations do not describe the record.
    assert_eq!(whirl(folder, &format!("identify r.csv --rig {rig} -o plain.toml")).status, 1);
    let plain = explained(folder, &folder.join("r.csv"), &rig, "--model plain.toml");
    assert_eq!(names(&plain), ["coulomb-friction@x"]);
    let other = repository("rigs/van-der-pol.toml").display().to_string();
    done(folder, &format!("simulate --rig {other} --seconds 30 --seed 3 -o v.csv"));
    let run = whirl(folder, &format!("explain v.csv --rig {other} --model plain.toml"));
    assert!(run.status == 2 && run.stderr.contains("other equations"), "{run:?}");
}

/// Shooting finds the coefficients of an oscillator under a measured force, standard errors and
/// all.
#[test]
fn shooting_identifies_a_model_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rig = rig("duffing.toml");
    done(folder, &format!("simulate --rig {rig} --seconds 20 --seed 3 -o r.csv"));
    done(folder, &format!("identify r.csv --rig {rig} --method shooting --json i.json -o model.toml"));
    let out = json(&folder.join("i.json"));
    assert_eq!(out["method"], "shooting");
    for (name, true_value) in [("m", 1.0), ("c", 0.4), ("k", 40.0), ("k3", 60.0)] {
        let list = out["parameters"].as_array().unwrap();
        let p = list.iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!(((value - true_value) / error).abs() < 4.0 && error < 2e-3 * true_value, "{p}");
    }
    let ratio = out["shooting"]["noise_ratio"][0].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
}

/// A model file is validated, and a wrong one fails.
#[test]
fn a_model_file_is_validated() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rig = rig("van-der-pol.toml");
    done(folder, &format!("simulate --rig {rig} --seconds 20 --seed 1 -o r.parquet"));
    done(folder, &format!("identify r.parquet --rig {rig} -o m.toml"));
    let text = done(folder, &format!("validate r.parquet --rig {rig} --model m.toml --starts 6 --json v.json"));
    assert!(!text.contains("of its range") && text.contains(" V of the record for"), "{text}");
    assert_eq!(json(&folder.join("v.json"))["verdict"], "passed");
    let text = std::fs::read_to_string(folder.join("m.toml")).unwrap();
    let (head, tail) = text.split_once("k = { value = ").unwrap();
    let (_, rest) = tail.split_once(',').unwrap();
    std::fs::write(folder.join("wrong.toml"), format!("{head}k = {{ value = 10.0,{rest}")).unwrap();
    let said = whirl(folder, &format!("validate r.parquet --rig {rig} --model wrong.toml --starts 6 --json w.json"));
    assert_eq!(said.status, 1, "{said:?}");
    assert_eq!(json(&folder.join("w.json"))["verdict"], "failed");
}

/// Nothing in the program knows of Furuta's pendulum or of this effect: both are files.
#[test]
fn an_effect_of_ones_own_is_found_on_a_system_of_ones_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let effect =
        "[[effect]]\nid = \"magnet\"\nat = \"joint\"\nstrengths = [\"k\"]\nforce = \"-k*sin(3*x)*exp(-(x/0.8)^2)\"\n";
    std::fs::write(at.join("magnet.toml"), effect).unwrap();
    let text = std::fs::read_to_string(rig("rotary-pendulum.toml")).unwrap();
    std::fs::write(at.join("rig.toml"), text.replace("sample_rate_hz", "effects = [\"magnet.toml\"]\nsample_rate_hz"))
        .unwrap();
    done(at, "simulate --rig rig.toml --effect magnet@pivot=0.02 --seconds 60 -o r.parquet");
    let run = whirl(at, "explain r.parquet --rig rig.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!(e["effects"][0]["id"], "magnet", "{run:?}");
    assert_eq!(e["effects"][0]["at"], "pivot");
    let value = e["effects"][0]["value"].as_f64().unwrap();
    assert!((value / 0.02 - 1.0).abs() < 0.02, "{value}");
    let listed = whirl(at, "list effects --effects magnet.toml");
    assert!(listed.stdout.contains("magnet"), "{}", listed.stdout);
}

/// A delay of what is recorded of an input is named with its value; its offset is a constant force
/// as well, which is said.
#[test]
fn records_of_inputs_that_are_late_or_off_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let rig = repository("rigs").join("duffing.toml").display().to_string();
    for (effect, value, first) in [
        ("input-delay@force=0.0007", 0.0007, "input-delay@force"),
        ("input-offset@force=0.3", -0.3, "constant-force@x"),
    ] {
        done(folder.path(), &format!("simulate --rig {rig} --effect {effect} --seconds 60 --seed 5 -o r.csv --force"));
        done(folder.path(), &format!("explain r.csv --rig {rig} --json out.json -o m.toml --force"));
        let out = json(&folder.path().join("out.json"));
        let effects = out["effects"].as_array().unwrap();
        let name = |e: &serde_json::Value| format!("{}@{}", e["id"].as_str().unwrap(), e["at"].as_str().unwrap());
        assert_eq!(effects.iter().map(name).collect::<Vec<_>>(), [first], "{effect}: {}", out["gap"]);
        assert_eq!(out["verdict"], "explained", "{effect}");
        let (found, error) = (effects[0]["value"].as_f64().unwrap(), effects[0]["std_error"].as_f64().unwrap());
        assert!((found - value).abs() < 3.5 * error && error < 0.02 * value.abs(), "{}", effects[0]);
        if first != effect.split('=').next().unwrap() {
            let twins = effects[0]["indistinguishable_from"].to_string();
            assert!(twins.contains("input-offset@force"), "{twins}");
        }
        // The model written goes on: with it nothing is missing, and it makes records of its own.
        done(folder.path(), &format!("explain r.csv --rig {rig} --model m.toml --json again.json"));
        assert_eq!(json(&folder.path().join("again.json"))["verdict"], "nothing-missing", "{effect}");
        done(folder.path(), &format!("simulate --model m.toml --rig {rig} --from r.csv --seconds 5 -o s.csv --force"));
    }
}

/// A circuit of one's own, 2 kHz: what a record tells of it, with noise in what was measured.
fn circuit(folder: &Path) -> PathBuf {
    let model = "name = \"circuit\"\ncoordinates = [{ name = \"q\", space = \"R\" }]\ninputs = [\"u\"]\n[[equation]]\n\
                 balance = \"u\"\nterms = { L = \"q''\", R = \"q'\", S = \"q\", S3 = \"q^3\" }\n";
    std::fs::write(folder.join("model.toml"), model).unwrap();
    let channel = |name: &str| format!("[[channel]]\nname = \"{name}\"\nmeasures = \"{name}\"\nunit = \"V\"\n");
    let rig = format!(
        "name = \"circuit\"\nmodel = \"model.toml\"\nsample_rate_hz = 2000.0\n{}{}[plant]\nL = 1.0\nR = 1.0\nS = 400.0\nS3 = 200.0\n\
         initial = [0.0, 0.0]\nnoise = {{ q = 1e-3 }}\nsettle_s = 0.0\ninput.u = [{{ kind = \"random\", rms = 300.0, to_hz = 8.0 }}]\n",
        channel("q"),
        channel("u")
    );
    std::fs::write(folder.join("rig.toml"), rig).unwrap();
    folder.join("rig.toml")
}

/// A state that settles as fast as any that is followed: its time has no derivative there.
#[test]
fn a_shape_at_the_edge_of_what_is_followed_ends_in_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    let (at, rig) = (folder.path(), circuit(folder.path()));
    done(at, "simulate --rig rig.toml --effect relaxation@q=30,T_r=0.01 --seconds 20 --seed 1 -o r.parquet");
    let out = explained(at, &at.join("r.parquet"), &rig.display().to_string(), "");
    assert_eq!(names(&out)[0], "relaxation@q", "{}", out["reason"]);
    let power = out["residual_power"].as_array().unwrap();
    assert!(power[1].as_f64().unwrap() < power[0].as_f64().unwrap(), "{power:?}");
}

/// Noise of a measured input comes through the model, and is no effect.
#[test]
fn the_noise_of_an_input_is_not_something_that_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (at, rig) = (folder.path(), circuit(folder.path()));
    done(at, "simulate --rig rig.toml --seconds 20 --seed 2 -o quiet.csv");
    let text = std::fs::read_to_string(at.join("quiet.csv")).unwrap();
    let mut lines = text.lines();
    let head = lines.next().unwrap();
    let column = head.split(',').position(|name| name == "u").unwrap();
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    for (sigma, verdict) in [(0.0, "nothing-missing"), (1.5, "nothing-missing"), (15.0, "not-decidable")] {
        // Even noise of a golden-ratio sequence's fractions, whitened by a bit-mixing hash.
        let noise = |i: u64| {
            let mut z = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            12f64.sqrt() * sigma * ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5)
        };
        let mut noisy = format!("{head}\n");
        for (i, row) in rows.iter().enumerate() {
            let of =
                |(k, x): (usize, &f64)| if k == column { (x + noise(i as u64)).to_string() } else { x.to_string() };
            noisy += &row.iter().enumerate().map(of).collect::<Vec<_>>().join(",");
            noisy.push('\n');
        }
        std::fs::write(at.join("r.csv"), noisy).unwrap();
        let run = whirl(at, &format!("explain r.csv --rig {} --json out.json", rig.display()));
        let out = json(&at.join("out.json"));
        assert_eq!(out["verdict"], verdict, "{sigma}: {} {}", out["reason"], out["residual_power"]);
        assert_eq!(out["effects"].as_array().unwrap().len(), 0, "{run:?}");
        assert_eq!(
            out["reason"].as_str().unwrap().contains("Measure u with less noise"),
            sigma > 10.0,
            "{}",
            out["reason"]
        );
    }
}

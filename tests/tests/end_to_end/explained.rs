//! Explanations of simulated rigs: a hidden effect is named with its strength, nothing is named
//! where nothing is missing, and a locked record decides nothing.

use std::path::Path;

use whirl::explain::{Explanation, Reason, Settings, Undecidable, Verdict, explain};
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;
use whirl::rig::plant::Plant;
use whirl_tests::battery::{Case, Kind};
use whirl_tests::repository;

use super::program::{done, json, whirl};

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

/// The force across joint 1 rests on the mass of arm 1, which no equation of motion holds and the
/// rig file does not know: the record tells it with the friction.
#[test]
fn friction_under_a_load_that_rests_on_an_unknown_mass_is_named_with_the_mass() {
    let e = explained("chaotic.toml", &["load-dependent-friction@joint1=1e-4"], 50.0, 1);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), f.at.as_str(), f.unit.as_str()), ("load-dependent-friction", "joint1", "m"));
    assert!((f.value - 1e-4).abs() < 4.0 * f.std_error && f.std_error < 5e-7, "{} ± {}", f.value, f.std_error);
    let mass = f.parameters["mass"];
    assert!((mass / 0.1362 - 1.0).abs() < 0.02, "{mass} kg for 0.1362");
    // What is written, exported and simulated has that mass.
    let model = e.model.as_ref().unwrap();
    assert!(model.effects.iter().any(|e| e.parameters.get("mass") == Some(&mass)), "{:?}", model.effects);
}

/// Counts made by rounding are half a count off, which is nothing that the rig lacks.
#[test]
fn an_offset_of_half_a_count_is_told_as_how_counts_were_made() {
    let half = core::f64::consts::PI / 4096.0;
    let e = explained("chaotic.toml", &[&format!("zero-offset@encoder1={half}")], 30.0, 2);
    let f = e.effects.iter().find(|f| (f.id.as_str(), f.at.as_str()) == ("zero-offset", "encoder1")).unwrap();
    assert!((f.value - half).abs() < 4.0 * f.std_error, "{} ± {} for {half}", f.value, f.std_error);
    assert!(f.confirm.contains("half a count"), "{}", f.confirm);
}

/// A sensor that warms up.
#[test]
fn a_zero_that_drifts_is_named_with_how_far() {
    let e = explained("chaotic.toml", &["zero-drift@encoder2=0.01"], 40.0, 4);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), f.at.as_str(), f.unit.as_str()), ("zero-drift", "encoder2", "rad"));
    assert!((f.value - 0.01).abs() < 4.0 * f.std_error && f.std_error < 1e-4, "{} ± {}", f.value, f.std_error);
}

/// A spring whose torque jumps where the arm turns over: what the jump does is located.
#[test]
fn a_stiff_law_in_a_joint_that_whirls_leaves_nothing() {
    let e = explained("chaotic.toml", &["quintic-stiffness@joint2=3e-6"], 40.0, 3);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), f.at.as_str()), ("quintic-stiffness", "joint2"));
    assert!((f.value - 3e-6).abs() < 4.0 * f.std_error && f.std_error < 2e-9, "{} ± {}", f.value, f.std_error);
}

/// LuGre's friction without a peak is Dahl's, about whose motion alone their shapes are alike.
#[test]
fn of_a_law_and_the_one_that_refines_it_the_simpler_is_named() {
    let e = explained("chaotic.toml", &["dahl-friction@joint1=2e-4,d=0.02"], 40.0, 3);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), f.at.as_str()), ("dahl-friction", "joint1"));
    assert!((f.value - 2e-4).abs() < 4.0 * f.std_error, "{} ± {}", f.value, f.std_error);
    assert!((f.parameters["d"] / 0.02 - 1.0).abs() < 0.03, "{:?}", f.parameters);
}

#[test]
fn a_hidden_drag_is_named_with_its_strength_and_the_gap_closes() {
    let e = explained("chaotic.toml", &["quadratic-drag@arm2=2e-7"], 50.0, 1);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    assert_eq!(e.effects.len(), 1, "{:?}", e.effects);
    let f = &e.effects[0];
    assert_eq!((f.id.as_str(), f.at.as_str(), f.unit.as_str()), ("quadratic-drag", "arm2", "N m s²"));
    assert!((f.value - 2e-7).abs() < 5.0 * f.std_error && f.std_error < 2e-9, "{} ± {}", f.value, f.std_error);
    let steps = &e.gap.steps;
    assert!(steps[0].added.is_none() && steps[0].value > 3.0, "{steps:?}");
    assert!(steps[1].added.as_deref() == Some("quadratic-drag@arm2") && steps[1].value < 1.1, "{steps:?}");
    // With the effect in the model its parameters are those of a rig whose effect is known: within
    // their errors of the truth, and within what README promises of a record in which nothing is
    // hidden.
    let rig = whirl_tests::accuracy::chaotic_rig(5.0);
    let plant = Plant::of(&rig).unwrap();
    for p in e.parameters.iter().filter(|p| !p.name.contains('@') && !["B14", "B24"].contains(&p.name.as_str())) {
        let truth = plant.truth(&p.name, rig.omega()).unwrap();
        let allowed = if p.name == "C11" {
            0.03
        } else if p.name.starts_with('C') {
            0.005
        } else {
            0.002
        };
        assert!((p.value - truth).abs() < 4.0 * p.std_error, "{p:?}: true {truth}");
        assert!((p.value / truth - 1.0).abs() < allowed, "{p:?}: true {truth}");
    }
    // C2 stood in for the drag: it is told before and after.
    let before = e.parameters_before.iter().find(|p| p.name == "C2").unwrap();
    assert!(before.value > 1.05 * e.parameters.iter().find(|p| p.name == "C2").unwrap().value, "{before:?}");
    // Over the same seconds the new model stays with the record for longer than the old one.
    let p = e.prediction.as_ref().expect("a picture of the gap");
    let rms = |x: &[f64]| (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt();
    assert!(
        p.t.len() == p.measured.len() && p.after.len() == p.t.len() && rms(&p.before) > 2.0 * rms(&p.after),
        "{p:?}"
    );
    // The model with it also holds for longer, and its attractor is the record's.
    let [before, after] = e.gap.attractor[..] else { panic!("{:?}", e.gap.attractor) };
    assert!(after.prediction_horizon_s > 1.3 * before.prediction_horizon_s, "{before:?} {after:?}");
    assert!(after.section_p_value.is_some_and(|p| p > 0.01), "{after:?}");
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let e = explained("chaotic.toml", &[], 60.0, 2);
    assert_eq!(e.verdict, Verdict::NothingMissing, "{}", e.reason);
    assert!(e.effects.is_empty() && e.gap.steps.len() == 1 && e.gap.steps[0].value < 1.1);
}

#[test]
fn a_locked_record_decides_nothing() {
    let e = explained("seed.toml", &["quadratic-drag@arm2=2e-7"], 30.0, 1);
    assert_eq!(e.verdict, Verdict::NotDecidable, "{}", e.reason);
    assert!(e.effects.is_empty() && e.reason == Reason::Undecidable(Undecidable::Locked), "{}", e.reason);
}

/// A case of the battery.
fn case(kind: Kind, effect: &str, counts: u32, seconds: u32, seed: u64) -> Explanation {
    let effects = Some(effect.to_owned()).filter(|e| !e.is_empty()).into_iter().collect();
    Case { kind, effects, counts, seconds, seed }.explain()
}

/// The amplitude that is fitted without the harmonic is 5 % too small: the share is one of the
/// amplitude that is found with it.
#[test]
fn a_strong_harmonic_is_told_by_the_amplitude_that_is_found_with_it() {
    let e = case(Kind::Driven, "drive-harmonic-2@drive=3e-2", 1024, 60, 126);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), e.verdict), ("drive-harmonic-2", Verdict::Explained), "{}", e.reason);
    assert!((f.value - 0.03).abs() < 4.0 * f.std_error && f.std_error < 1e-4, "{} ± {}", f.value, f.std_error);
}

/// About the motion of a model without either the two are not told apart; about that with the
/// cubic one they are.
#[test]
fn a_spring_that_turns_over_is_no_cubic_one() {
    let e = case(Kind::Driven, "torsion-spring@joint1=6e-3", 1024, 120, 109);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), e.verdict), ("torsion-spring", Verdict::Explained), "{}", e.reason);
    assert!((f.value - 6e-3).abs() < 4.0 * f.std_error, "{} ± {}", f.value, f.std_error);
}

/// Both arms come to rest on the edge of a count, which is as far from the truth as a count's half
/// for as long as they rest: no force and no slip.
#[test]
fn what_comes_to_rest_between_two_counts_lacks_nothing() {
    let e = case(Kind::Free, "", 1024, 120, 177);
    assert_eq!(e.verdict, Verdict::NothingMissing, "{}", e.reason);
    assert!(!e.warnings.iter().any(|w| w.id == "count-slip"), "{:?}", e.warnings);
}

/// Both were named once: a force at one angle, which the scatter between windows told far too sure;
/// a tone, the best of thousands of frequencies.
#[test]
fn chance_has_no_name() {
    for (counts, seconds, seed) in [(4096, 120, 158), (1024, 60, 163)] {
        let e = case(Kind::Driven, "", counts, seconds, seed);
        assert_eq!(e.verdict, Verdict::NothingMissing, "seed {seed}: {} {:?}", e.reason, e.effects);
    }
}

#[test]
fn two_hidden_effects_are_both_named() {
    let e = explained("chaotic.toml", &["drive-harmonic-2@drive=0.01", "cogging@joint2=5e-5,n=8"], 50.0, 3);
    let mut names: Vec<String> = e.effects.iter().map(|f| format!("{}@{}", f.id, f.at)).collect();
    names.sort();
    assert_eq!(names, ["cogging@joint2", "drive-harmonic-2@drive"], "{:?}", e.effects);
    assert_eq!(e.effects.iter().find(|f| f.id == "cogging").unwrap().parameters["n"], 8.0);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    assert_eq!(e.gap.steps.len(), 3);
    assert!(e.gap.steps[2].value < 1.1, "{:?}", e.gap.steps);
}

#[test]
fn a_shape_that_has_no_name_is_unexplained_and_drawn() {
    let hidden = ["cogging@joint2=1e-4,n=3", "cogging@joint2=1e-4,n=5", "cogging@joint2=1e-4,n=7"];
    let e = explained("chaotic.toml", &hidden, 60.0, 4);
    assert_eq!(e.verdict, Verdict::Unexplained, "{} {:?}", e.reason, e.effects);
    let u = e.unknown.as_ref().expect("a shape");
    assert_eq!((u.at.as_str(), u.against.as_str(), u.unit.as_str()), ("joint2", "angle of joint2", "N m"));
    // The torque is −Σ A sin(n x) less the order that was named; the shape follows it within its
    // bands.
    let named: Vec<f64> =
        e.effects.iter().filter(|f| f.id == "cogging" && f.at == "joint2").map(|f| f.parameters["n"]).collect();
    let orders: Vec<f64> = [3.0, 5.0, 7.0].into_iter().filter(|n| !named.contains(n)).collect();
    let truth = |x: f64| orders.iter().map(|n| -1e-4 * (n * x).sin()).sum::<f64>();
    // Sixteen points are few for these orders, but where a point is clear of its band its sign is
    // the torque's.
    let clear: Vec<&[f64; 3]> =
        u.points.iter().filter(|p| p[1].abs() > p[2] && truth(p[0]).abs() > 5e-5 && p[2] > 0.0).collect();
    assert!(clear.len() >= 4, "{:?}", u.points);
    for [x, torque, band] in clear {
        assert!(torque * truth(*x) > 0.0, "{x}: {torque} ± {band}, true {}", truth(*x));
    }
    assert!(e.r#where.iter().any(|w| w.against == "angle of joint2"), "{:?}", e.r#where);
}

#[test]
fn a_model_with_its_effect_is_written_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let rig = repository("rigs/chaotic.toml");
    let rig = rig.display();
    done(here, &format!("simulate --rig {rig} --seconds 40 --seed 6 -o clean.parquet"));
    done(
        here,
        &format!("simulate --rig {rig} --effect quadratic-drag@arm2=2e-7 --seconds 40 --seed 7 -o drag.parquet"),
    );
    done(here, &format!("identify clean.parquet --rig {rig} -o clean.toml"));
    // The model of the clean rig misses the drag.
    done(
        here,
        &format!("explain drag.parquet --rig {rig} --model clean.toml -o drag.toml --json e.json --ledger l.json"),
    );
    let e = json(&here.join("e.json"));
    let steps = e["gap"]["steps"].as_array().unwrap();
    let (added, value): (Vec<_>, Vec<_>) = steps.iter().map(|s| (&s["added"], s["value"].as_f64().unwrap())).unzip();
    assert!(added[0].is_null() && added[1] == "refit" && added[2] == "quadratic-drag@arm2", "{steps:?}");
    assert!(value[0] > 3.0 && value[1] <= 1.05 * value[0] && value[2] < 1.1, "{steps:?}");
    let ledger = json(&here.join("l.json"));
    assert!(ledger["candidates"].as_array().unwrap().len() > 30 && ledger["result"]["verdict"] == "explained");
    // Nothing is missing from the model with it, refitted or not.
    done(here, &format!("explain drag.parquet --rig {rig} --model drag.toml --json again.json"));
    let again = json(&here.join("again.json"));
    assert_eq!(again["verdict"], "nothing-missing", "{}", again["reason"]);
    let first = again["gap"]["steps"][0]["value"].as_f64().unwrap();
    assert!(first < 1.1, "{first}");
    // A model of another rig.
    let other = whirl(here, &format!("explain drag.parquet --rig {rig} --model {rig}"));
    assert_eq!(other.status, 2, "{other:?}");
}

/// The built-in single pendulum, an effect in the joint, one of the drive and none: by name and by
/// value.
#[test]
fn what_a_single_pendulum_lacks_is_named() {
    let clean = explained("single-pendulum.toml", &[], 100.0, 1);
    assert_eq!((clean.verdict, clean.effects.len()), (Verdict::NothingMissing, 0), "{}", clean.reason);
    for (hidden, name, truth) in [
        ("quadratic-drag@arm1=3e-6", "quadratic-drag@arm1", 3e-6),
        ("drive-harmonic-2@drive=0.01", "drive-harmonic-2@drive", 0.01),
        ("imbalance@arm1=0.02", "imbalance@arm1", 0.02),
    ] {
        let e = explained("single-pendulum.toml", &[hidden], 100.0, 1);
        assert_eq!((e.verdict, e.effects.len()), (Verdict::Explained, 1), "{hidden}: {:?}", e.effects);
        let f = &e.effects[0];
        assert_eq!(format!("{}@{}", f.id, f.at), name);
        assert!((f.value / truth - 1.0).abs() < 0.01, "{hidden}: {} ± {}", f.value, f.std_error);
        assert!(e.gap.steps[0].value > 5.0 && e.gap.steps[1].value < 1.1, "{:?}", e.gap.steps);
        assert_eq!(e.model.unwrap().parameters[0].name, "c_r");
    }
}

/// A free double pendulum whose plant misses nothing but what is put in.
const FREE: &str = r#"
name = "free double pendulum"
model = "double-pendulum-free"
sample_rate_hz = 400.0
channel = [{ name = "phi1", measures = "phi1", unit = "rad" }, { name = "phi2", measures = "phi2", unit = "rad" }]
[known]
m2 = 0.1376
e2 = 0.11678
g = 9.8086
[nominal]
effects = ["viscous-friction@joint1", "viscous-friction@joint2"]
[plant]
m1 = 0.1
e1 = 0.1019
J_1 = 1.54e-3
l1 = 0.173
m2 = 0.1376
e2 = 0.11678
J_2 = 3.153e-3
g = 9.8086
"viscous-friction@joint1" = 2e-4
"viscous-friction@joint2" = 5e-6
initial = [1.6, 2.2, 0.0, 0.0]
noise = { phi1 = 1e-4, phi2 = 1e-4 }
"#;

/// Four effects, where the one found third (Stribeck's friction in joint 2, 2.66e-4 N m) stands in
/// for two: it gives way once the others are there.
#[test]
fn an_effect_that_stood_in_for_others_gives_way() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::write(here.join("rig.toml"), FREE).unwrap();
    let hidden = "--effect stribeck-friction@joint1=1e-3,v_s=2 --effect coulomb-friction@joint2=3e-4 \
                  --effect imbalance@arm1=0.002 --effect quadratic-drag@arm1=1e-5";
    done(here, &format!("simulate --rig rig.toml {hidden} --seconds 30 --seed 77 -o r.parquet"));
    done(here, "explain r.parquet --rig rig.toml --json e.json");
    let e = json(&here.join("e.json"));
    assert_eq!(e["verdict"], "explained", "{}", e["reason"]);
    let truth = [
        ("coulomb-friction@joint2", 3e-4),
        ("imbalance@arm1", 0.002),
        ("quadratic-drag@arm1", 1e-5),
        ("stribeck-friction@joint1", 1e-3),
    ];
    let effects = e["effects"].as_array().unwrap();
    assert_eq!(effects.len(), truth.len(), "{effects:?}");
    for (name, value) in truth {
        let of =
            |f: &&serde_json::Value| format!("{}@{}", f["id"].as_str().unwrap(), f["at"].as_str().unwrap()) == name;
        let found = effects.iter().find(of).unwrap_or_else(|| panic!("no {name}: {effects:?}"));
        let (x, error) = (found["value"].as_f64().unwrap(), found["std_error"].as_f64().unwrap());
        assert!((x - value).abs() < 4.0 * error && (x / value - 1.0).abs() < 0.01, "{name} {x} ± {error}");
    }
    // The steps tell what stands in the end, each once.
    let steps = e["gap"]["steps"].as_array().unwrap();
    let mut added: Vec<&str> = steps.iter().filter_map(|s| s["added"].as_str()).collect();
    added.sort_unstable();
    assert_eq!(added, truth.map(|t| t.0));
}

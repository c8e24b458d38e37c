//! A spring hidden between two masses that the model has side by side: named with its stiffness,
//! whatever the rig file knows of the masses, and not where there is none.

use std::path::Path;

use super::*;
use crate::record::formats::ReadOptions;

/// Two carts, the first on a hardening spring and pushed, derived from their energies.
const DERIVED: &str = r#"name = "two carts"
coordinates = { x1 = "length", x2 = "length" }
inputs = { force = "N" }
parameters = { m1 = "kg", m2 = "kg", k1 = "N/m", k2 = "N/m", n = "N/m^3" }
kinetic = "m1*x1'^2/2 + m2*x2'^2/2"
potential = "k1*x1^2/2 + n*x1^4/4 + k2*x2^2/2"
[[joint]]
name = "rail1"
moves = "x1"
[[joint]]
name = "rail2"
moves = "x2"
[[force]]
does_work_on = "x1"
value = "force"
[nominal]
effects = ["viscous-friction@rail1", "viscous-friction@rail2"]
"#;
/// The same written down, the second equation over its mass.
const WRITTEN: &str = r#"name = "two carts"
coordinates = [{ name = "x1", space = "R" }, { name = "x2", space = "R" }]
inputs = ["force"]
[[equation]]
balance = "force"
terms = { m = "x1''", c1 = "x1'", k1 = "x1", n = "x1^3" }
[[equation]]
balance = "-x2''"
terms = { c2 = "x2'", k2 = "x2" }
"#;
const DERIVED_PLANT: &str = "m1 = 1.0\nm2 = 0.7\nk1 = 40.0\nk2 = 30.0\nn = 60.0\n\
    \"viscous-friction@rail1\" = 0.4\n\"viscous-friction@rail2\" = 0.3\n";
const WRITTEN_PLANT: &str = "m = 1.0\nc1 = 0.4\nk1 = 40.0\nn = 60.0\nc2 = 0.4\nk2 = 43.0\n";

/// A rig of one of the models in a folder.
fn rig(folder: &Path, model: &str, known: &str, plant: &str) -> Rig {
    std::fs::write(folder.join("model.toml"), model).unwrap();
    let channel =
        |name: &str, unit: &str| format!("[[channel]]\nname = \"{name}\"\nmeasures = \"{name}\"\nunit = \"{unit}\"\n");
    let text = format!(
        "name = \"two carts\"\nmodel = \"model.toml\"\nsample_rate_hz = 200.0\n{}{}{}{known}[plant]\n{plant}\
         initial = [0.0, 0.5, 0.0, 0.0]\nnoise = {{ x1 = 1e-4, x2 = 1e-4 }}\nsettle_s = 0.0\n\
         input.force = [{{ kind = \"random\", rms = 15.0, to_hz = 4.0 }}]\n",
        channel("x1", "m"),
        channel("x2", "m"),
        channel("force", "N"),
    );
    Rig::parse(&text, &folder.join("rig.toml")).unwrap()
}

fn record(folder: &Path, rig: &Rig, effects: &[&str]) -> Record {
    let file = folder.join("r.parquet");
    let effects: Vec<String> = effects.iter().map(|e| (*e).to_owned()).collect();
    crate::simulate::record(rig, &effects, 25.0, 1, &file, &indicatif::ProgressBar::hidden()).unwrap();
    Record::read(&file, rig, &ReadOptions::default()).unwrap()
}

/// The spring alone is found, of this value and with this ratio of inertias; with the model that
/// was found nothing is missing.
fn is_found(record: &Record, rig: &Rig, value: f64, unit: &str, ratio: Option<f64>) {
    let of = |model| explain(std::slice::from_ref(record), rig, &Settings { model, ..Settings::default() }).unwrap();
    let e = of(None);
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    let [f] = &e.effects[..] else { panic!("{:?}", e.effects) };
    assert_eq!((f.id.as_str(), f.at.as_str(), f.unit.as_str()), ("coupling-stiffness", "x1-x2", unit));
    assert!((f.value - value).abs() < 3.0 * f.std_error, "{} ± {} for {value}", f.value, f.std_error);
    assert!(f.std_error < 1e-3 * value, "{}", f.std_error);
    let found = f.parameters.get("inertia_ratio").copied();
    assert!(found.zip(ratio).is_none_or(|(r, wanted)| (r / wanted - 1.0).abs() < 0.01), "{found:?} for {ratio:?}");
    assert_eq!(found.is_some(), ratio.is_some());
    let gap: Vec<f64> = e.gap.steps.iter().map(|s| s.value).collect();
    assert!(gap.len() == 2 && gap[0] > 3.0 && (gap[1] - 1.0).abs() < 0.1, "{gap:?}");
    let again = of(e.model.clone());
    assert_eq!((again.verdict, again.effects.len()), (Verdict::NothingMissing, 0), "{}", again.reason);
    assert!(again.gap.steps[0].value < 1.2, "{:?}", again.gap.steps);
}

#[test]
fn a_spring_between_two_masses_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let known = rig(folder.path(), DERIVED, "[known]\nm2 = 0.7\n", DERIVED_PLANT);
    let hidden = record(folder.path(), &known, &["coupling-stiffness@x1-x2=1"]);
    is_found(&hidden, &known, 1.0, "N/m", None);
    // Nothing tells the second mass.
    let open = rig(folder.path(), DERIVED, "", DERIVED_PLANT);
    is_found(&hidden, &open, 1.0 / 0.7, "N/m per kg of inertia of x2", Some(0.7));
    let clean = explain(&[record(folder.path(), &known, &[])], &known, &Settings::default()).unwrap();
    assert_eq!((clean.verdict, clean.effects.len()), (Verdict::NothingMissing, 0), "{}", clean.reason);
}

#[test]
fn a_spring_between_two_written_equations_is_named_with_the_ratio_of_their_inertias() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(folder.path(), WRITTEN, "", WRITTEN_PLANT);
    let hidden = record(folder.path(), &rig, &["coupling-stiffness@x1-x2=2,inertia_ratio=0.7"]);
    is_found(&hidden, &rig, 2.0, "s⁻²", Some(0.7));
    let clean = explain(&[record(folder.path(), &rig, &[])], &rig, &Settings::default()).unwrap();
    assert_eq!((clean.verdict, clean.effects.len()), (Verdict::NothingMissing, 0), "{}", clean.reason);
}

/// What there is no place for is said with what would be one.
#[test]
fn a_spring_where_there_is_no_pair_is_refused() {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs");
    let folder = tempfile::tempdir().unwrap();
    let written = rig(folder.path(), WRITTEN, "", WRITTEN_PLANT);
    let bodies = Rig::read(rigs.join("double-pendulum-from-bodies.toml")).unwrap();
    for (rig, effect, told) in [
        (&bodies, "coupling-stiffness@phi1-phi2=1", "a torsion-spring is this"),
        (&written, "coupling-stiffness@x2-x1=1", "one of x1-x2"),
        (&written, "coupling-stiffness@x1-x2=1", "VALUE,inertia_ratio="),
    ] {
        let file = folder.path().join("refused.parquet");
        let bar = indicatif::ProgressBar::hidden();
        let error = crate::simulate::record(rig, &[effect.to_owned()], 1.0, 1, &file, &bar).unwrap_err().to_string();
        assert!(error.contains(told) && error.contains("--effect"), "{effect}: {error}");
    }
}

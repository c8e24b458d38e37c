//! A spring hidden between two masses that the model has side by side: named with its stiffness,
//! whatever the rig file knows of the masses, and not where there is none; a tilt where a mass is
//! not known.

use std::path::Path;

use serde_json::Value;
use whirl_tests::repository;

use super::program::{done, json, whirl};

/// Two carts, the first on a hardening spring and pushed, derived from their energies.
const CARTS: &str = r#"name = "two carts"
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

/// Writes the model, and its rig with what is known.
fn rig(folder: &Path, name: &str, known: &str) {
    std::fs::write(folder.join("carts.toml"), CARTS).unwrap();
    let channel =
        |name: &str, unit: &str| format!("[[channel]]\nname = \"{name}\"\nmeasures = \"{name}\"\nunit = \"{unit}\"\n");
    let channels = channel("x1", "m") + &channel("x2", "m") + &channel("force", "N");
    let text = format!(
        "name = \"two carts\"\nmodel = \"carts.toml\"\nsample_rate_hz = 200.0\n{channels}{known}[plant]\n\
         m1 = 1.0\nm2 = 0.7\nk1 = 40.0\nk2 = 30.0\nn = 60.0\n\
         \"viscous-friction@rail1\" = 0.4\n\"viscous-friction@rail2\" = 0.3\n\
         initial = [0.0, 0.5, 0.0, 0.0]\nnoise = {{ x1 = 1e-4, x2 = 1e-4 }}\nsettle_s = 0.0\n\
         input.force = [{{ kind = \"random\", rms = 15.0, to_hz = 4.0 }}]\n"
    );
    std::fs::write(folder.join(name), text).unwrap();
}

#[test]
fn a_spring_between_two_masses_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig(at, "known.toml", "[known]\nm2 = 0.7\n");
    rig(at, "open.toml", "");
    done(at, "simulate --rig known.toml --effect coupling-stiffness@x1-x2=1 --seconds 25 --seed 1 -o r.parquet");
    // Where nothing tells the second mass, the spring is told over it, with the ratio of the two.
    for (rig, value, ratio) in [("known.toml", 1.0, None), ("open.toml", 1.0 / 0.7, Some(0.7))] {
        done(at, &format!("explain r.parquet --rig {rig} --json e.json"));
        let e = json(&at.join("e.json"));
        assert_eq!(e["verdict"], "explained", "{}", e["reason"]);
        assert_eq!(e["effects"].as_array().unwrap().len(), 1, "{}", e["effects"]);
        let f = &e["effects"][0];
        assert!(f["id"] == "coupling-stiffness" && f["at"] == "x1-x2", "{f}");
        let [found, error] = ["value", "std_error"].map(|key| f[key].as_f64().unwrap());
        assert!((found - value).abs() < 3.0 * error && error < 1e-3 * value, "{found} ± {error} for {value}");
        let open = f["parameters"]["inertia_ratio"].as_f64();
        assert_eq!(open.is_some(), ratio.is_some(), "{f}");
        assert!(open.zip(ratio).is_none_or(|(r, wanted)| (r / wanted - 1.0_f64).abs() < 0.01), "{f}");
    }
    done(at, "simulate --rig known.toml --seconds 25 --seed 1 -o clean.parquet");
    done(at, "explain clean.parquet --rig known.toml --json e.json");
    let e = json(&at.join("e.json"));
    assert_eq!(e["verdict"], "nothing-missing", "{}", e["reason"]);
}

/// What there is no place for is said with what would be one.
#[test]
fn a_spring_where_there_is_no_pair_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig(at, "open.toml", "");
    let bodies = super::own_systems::rig("double-pendulum-from-bodies.toml");
    for (rig, place, told) in
        [(bodies.as_str(), "phi1-phi2", "a torsion-spring is this"), ("open.toml", "x2-x1", "one of x1-x2")]
    {
        let run =
            whirl(at, &format!("simulate --rig {rig} --effect coupling-stiffness@{place}=1 --seconds 1 -o n.parquet"));
        assert!(run.status == 2 && run.stderr.contains(told) && run.stderr.contains("--effect"), "{run:?}");
    }
}

/// How a tilt of the table acts on the arm needs the pendulum's mass, of which the record alone
/// tells products. The tilt tells it: as a shape of the effect, with which a model is read again.
#[test]
fn a_tilt_beside_a_mass_that_is_open_is_named_with_what_fixes_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let shipped = std::fs::read_to_string(repository("rigs/rotary-pendulum.toml")).unwrap();
    let open = shipped.replace("k_t = 0.07\nm = 0.127\n\n[plant]", "k_t = 0.07\n\n[plant]");
    assert_ne!(open, shipped);
    std::fs::write(at.join("rig.toml"), open).unwrap();
    done(at, "simulate --rig rig.toml --effect frame-tilt@frame=0.008 --seconds 20 --seed 3 -o r.parquet");
    done(at, "explain r.parquet --rig rig.toml -o m.toml --json e.json");
    let e = json(&at.join("e.json"));
    let [f] = &e["effects"].as_array().unwrap()[..] else { panic!("{}", e["effects"]) };
    assert_eq!((f["id"].as_str(), e["verdict"].as_str()), (Some("frame-tilt"), Some("explained")), "{}", e["reason"]);
    let near = |value: &Value, error: &Value, truth: f64| {
        let (value, error) = (value.as_f64().unwrap(), error.as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * error && error < 0.01 * truth, "{value} ± {error}, true {truth}");
    };
    near(&f["value"], &f["std_error"], 0.008);
    near(&f["parameters"]["J_a"], &f["parameter_std_errors"]["J_a"], 2.1e-3);
    done(at, "explain r.parquet --rig rig.toml --model m.toml --most-effects 0 --json again.json");
    assert_eq!(json(&at.join("again.json"))["verdict"], "nothing-missing");
}

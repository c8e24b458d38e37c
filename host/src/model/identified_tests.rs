//! Identified models written and read again, and mistakes in them.

use super::*;

fn example() -> IdentifiedModel {
    let p = |name: &str, value, std_error| Parameter { name: name.into(), value, std_error, unit: "1".into() };
    IdentifiedModel {
        name: "a \"rig\"\nof two lines".into(),
        system: System::BuiltIn("double-pendulum".into()),
        method: "weak".into(),
        drive_frequency_hz: Some(5.0),
        nominal: vec!["coulomb-friction@joint1".into(), "viscous-friction@joint2".into()],
        parameters: vec![
            p("B21", 0.1 + 0.2, 2.1e-5),
            p("B11", -1.0 / 3.0, f64::INFINITY.recip()),
            p("a b", 1e300, 5e-324),
        ],
        effects: vec![AddedEffect {
            id: "quadratic-drag".into(),
            at: "arm2".into(),
            value: 2.0e-7,
            std_error: 5.0e-10,
            unit: "N m s²".into(),
            strengths: vec![0.0051, -1e-17],
            parameters: BTreeMap::from([("v_s".to_owned(), 0.5)]),
        }],
        found_with: BTreeMap::from([("l1".to_owned(), 0.0635), (RECORD_S.to_owned(), 120.0)]),
    }
}

#[test]
fn written_and_read_it_is_the_same_to_the_bit() {
    let m = example();
    let read = IdentifiedModel::parse(&m.to_toml()).unwrap();
    assert_eq!(read, m);
    assert_eq!(read.to_toml(), m.to_toml());
    for (a, b) in read.parameters.iter().zip(&m.parameters) {
        assert_eq!(a.value.to_bits(), b.value.to_bits());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.toml");
    m.write(&path).unwrap();
    assert_eq!(IdentifiedModel::read(&path).unwrap(), m);
}

#[test]
fn a_system_of_ones_own_keeps_its_equations_in_order() {
    let source = "name = \"positioning drive\"\nmethod = \"weak\"\nnominal = []\n\
        coordinates = [{ name = \"q\", space = \"R\" }]\ninputs = [\"force\"]\n\n[[equation]]\nbalance = \"force\"\n\
        terms = { M = \"q''\", F_v = \"q'\", A = \"1\" }\n\n[parameters]\nM = { value = 95.1, std_error = 0.1, unit = \"kg\" }\n";
    let m = IdentifiedModel::parse(source).unwrap();
    let System::Own(t) = &m.system else { panic!("{m:?}") };
    let terms = t["equation"][0]["terms"].as_table().unwrap();
    assert_eq!(terms.keys().collect::<Vec<_>>(), ["M", "F_v", "A"]);
    assert_eq!(IdentifiedModel::parse(&m.to_toml()).unwrap(), m);
    assert_eq!(IdentifiedModel::parse(&m.to_toml()).unwrap().to_toml(), m.to_toml());
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let good = example().to_toml();
    for (from, to, place, found) in [
        ("value = 1e300", "value = \"x\"", "parameters.a b.value", "x"),
        ("value = 1e300", "value = inf", "parameters.a b.value", "inf"),
        ("std_error = 2.1e-5", "std_error = -1.0", "parameters.B21.std_error", "-1"),
        ("model = \"double-pendulum\"", "", "model", "no model"),
        ("method = ", "methods = ", "method", "no method"),
        ("drive_frequency_hz = 5.0", "drive_frequency_hz = 0.0", "drive_frequency_hz", "0"),
        ("id = ", "idd = ", "effect 1, id", "no id"),
        ("strengths = [0.0051, ", "strengths = [true, ", "effect 1, strengths", "true"),
        ("name = ", "name = = ", "line 2", ""),
        ("format = 1", "format = 2", "format", "2"),
        ("nominal = [", "more = 1\nnominal = [", "more", "1"),
    ] {
        assert!(good.contains(from), "{from}");
        let error = IdentifiedModel::parse(&good.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(place) && error.contains(found), "{to}: {error}");
    }
    let error = IdentifiedModel::read(Path::new("/nowhere/model.toml")).unwrap_err();
    assert!(error.to_string().contains("/nowhere/model.toml"));
}

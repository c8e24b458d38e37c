//! What names and operations mean, and mistakes at their character.

use super::*;
use crate::model::model_file::parser::parse;

fn words() -> Words {
    Words {
        coordinates: vec!["q".into(), "p".into()],
        angles: vec![true, true],
        inputs: vec!["u".into()],
        parameters: vec!["k".into(), "l".into()],
        constants: vec![("N".into(), 50.0)],
        scalars: Vec::new(),
        on_line: false,
        filled: false,
        points: vec![("base".into(), vec![Polynomial::number(0.0), Polynomial::motion(Symbol::Input(0))])],
    }
}

#[test]
fn what_lies_on_a_line_is_not_wrapped() {
    let line = Words { on_line: true, ..words() };
    let read = |w: &Words, t: &str| parse(t, &Scoped(w, Scope::Motion)).unwrap_or_else(|m| panic!("{t}: {m:?}"));
    assert_eq!(read(&line, "wrap(q - u)^2"), read(&line, "(q - u)^2"));
    assert_ne!(read(&words(), "wrap(q - u)"), read(&words(), "q - u"));
}

#[test]
fn vectors_are_added_and_scaled() {
    let w = words();
    let read = |t: &str| parse(t, &Scoped(&w, Scope::Motion)).unwrap_or_else(|m| panic!("{t}: {m:?}"));
    assert_eq!(read("base + l*along(q)"), read("[l*sin(q), u - l*cos(q)]"));
    assert_eq!(read("across(-q)/2"), read("[0.5*cos(q), -sin(q)/2]"));
    assert_eq!(read("N*q' - 25*2*q'"), Value::Scalar(Polynomial::default()));
    let quantity = parse("atan2(k, l) + sqrt(k^2 + N)", &Scoped(&w, Scope::Parameters));
    assert!(quantity.is_ok(), "{quantity:?}");
}

#[test]
fn a_sum_of_angles_is_an_angle() {
    let w = words();
    let read = |t: &str| parse(t, &Scoped(&w, Scope::Motion)).unwrap_or_else(|m| panic!("{t}: {m:?}"));
    for (text, same) in [
        ("k*(p - q)", "-k*wrap(q - p)"),
        ("k*(3*p - 0.5*q)*q'", "0.5*k*wrap(6*p - q)*q'"),
        ("(p - q)^2/2", "wrap(q - p)^2/2"),
        ("(u + q - p)*k", "u*k + k*wrap(q - p)"),
        ("sin(2*(q - p))", "sin(2*q - 2*p)"),
    ] {
        assert_eq!(read(text), read(same), "{text}");
    }
    for text in ["k*(q + u)", "k*(2*p - 3*q)"] {
        let Value::Scalar(p) = read(text) else { panic!("{text}") };
        assert!(!p.any(&|a| matches!(a, Atom::Call(..))), "{text}: {p:?}");
    }
}

#[test]
fn mistakes_point_at_their_character() {
    let w = words();
    for (text, at, found) in [
        ("k*qq", 2..4, "\"qq\""),
        ("sin(k*q)", 0..3, "parameter k inside"),
        ("base + 1", 5..6, "number and a vector"),
        ("[1, 2] + [1, 2, 3]", 7..8, "2 and 3"),
        ("1/(k + q)", 1..2, "denominator"),
        ("q''", 0..3, "q''"),
        ("u'", 0..2, "input u"),
        ("cos(base)", 0..3, "vector in cos"),
        ("cos(q, p)", 0..3, "2 arguments"),
        ("[q]", 0..1, "1 components"),
        ("[q, p", 0..1, "without its \"]\""),
        ("q, p", 1..2, ","),
        ("along", 0..5, "along"),
        ("tua*q", 0..3, "tua"),
        ("base*base", 4..5, "two vectors"),
        ("q/0", 1..2, "division by 0"),
    ] {
        let m = parse(text, &Scoped(&w, Scope::Motion)).unwrap_err();
        assert_eq!(m.at, at, "{text}: {m:?}");
        assert!(m.found.contains(found) && !m.remedy.is_empty(), "{text}: {m:?}");
    }
    let m = parse("k*q", &Scoped(&w, Scope::Parameters)).unwrap_err();
    assert!(m.found.contains("\"q\""), "{m:?}");
}

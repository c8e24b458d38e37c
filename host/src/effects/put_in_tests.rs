//! Strengths from a value and parameters, whatever their names.

use super::*;
use crate::effects::entry::read;
use crate::model::model_file::toml_place::Source;

fn own(rest: &str) -> Entry {
    let head = "[[effect]]\nid = \"own\"\nat = \"joint\"\nstrengths = [\"a\", \"b\"]\nforce = \"-a*x - b*x^2\"\n";
    let source = Source { text: format!("{head}{rest}"), path: "e.toml".into() };
    read(&source).unwrap().remove(0)
}

fn strengths(entry: &Entry, text: &str) -> Result<Vec<f64>> {
    shaped(text, entry, &apart(text)?).map(|found| found.1)
}

#[test]
fn amplitude_and_angle_are_recognised_by_what_they_are() {
    let (value, angle) = (0.3_f64, 0.7_f64);
    let wanted = [value * angle.cos(), value * angle.sin()];
    for rest in [
        "value = \"sqrt(a^2 + b^2)\"\nalso = { psi = \"atan2(b, a)\" }",
        "value = \"(a*a + b*b)^0.5\"\nalso = { twice = \"2*a\", psi = \"atan2(b, a)\" }",
    ] {
        assert_eq!(strengths(&own(rest), "own@x=0.3,psi=0.7").unwrap(), wanted, "{rest}");
    }
    let listed = catalogue().iter().find(|e| e.id == "cogging").unwrap();
    assert_eq!(strengths(listed, "cogging@x=0.3,n=2,psi=0.7").unwrap(), wanted);
    assert_eq!(strengths(listed, "cogging@x=0.3,n=2").unwrap(), [value, 0.0]);
    let by_name = own("value = \"a\"\nalso = { sin = \"b\" }");
    assert_eq!(strengths(&by_name, "own@x=0.3,sin=0.7").unwrap(), [0.3, 0.7]);
}

/// An ellipse is no circle for all its root, and no angle is another's.
#[test]
fn what_is_no_amplitude_is_refused_and_not_taken_for_one() {
    let refused = |rest: &str, text: &str| strengths(&own(rest), text).unwrap_err().to_string();
    let told = refused("value = \"sqrt(a^2 + 3*b^2)\"\nalso = { psi = \"atan2(b, a)\" }", "own@x=0.3,psi=0.7");
    assert!(told.contains("\"sqrt(a^2 + 3*b^2)\", from which nothing tells a and b"), "{told}");
    assert!(told.contains("Give own another `value`"), "{told}");
    let product = "value = \"a*b\"\nalso = { a = \"a\", b = \"b\" }";
    assert_eq!(strengths(&own(product), "own@x=6,a=2,b=3").unwrap(), [2.0, 3.0]);
    assert!(refused(product, "own@x=7,a=2,b=3").contains("expected a*b = 6"));
    let told = refused("value = \"sqrt(a^2 + b^2)\"\nalso = { psi = \"atan2(a, b)\" }", "own@x=0.3,psi=0.7");
    assert!(told.contains("psi=0.7, where atan2(a, b) is"), "{told}");
}

#[test]
fn a_strength_that_is_positive_by_its_nature_is_not_taken_below_0() {
    let entry = own("sign = { a = \"+\" }");
    assert_eq!(strengths(&entry, "own@x=0.3").unwrap(), [0.3, 0.0]);
    let told = strengths(&entry, "own@x=-0.3").unwrap_err().to_string();
    assert!(told.contains("found a = -0.3, expected 0 or more: own says sign = { a = \"+\" }"), "{told}");
    assert_eq!(strengths(&own(""), "own@x=-0.3").unwrap(), [-0.3, 0.0]);
}

#[test]
fn a_shape_of_0_is_named_where_nothing_changes() {
    assert_eq!(changes_nothing(&vec![("d".to_owned(), 0.0)]), "nothing that it would change with d = 0");
    assert_eq!(changes_nothing(&vec![("d".to_owned(), 0.1)]), "nothing that it would change");
}

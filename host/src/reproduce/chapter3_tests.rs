//! The two methods beside each other.

use super::*;

#[test]
fn the_seeds_method_shows_the_seeds_weakness_and_the_weak_form_does_not() {
    let data = data::double().unwrap();
    let truth = data.truth("B21").unwrap();
    let error = |f: &Identification| (value(f, "B21").unwrap() / truth - 1.0).abs();
    assert!(error(optimised().unwrap()) > 0.05 && error(weak().unwrap()) < 1e-3);
}

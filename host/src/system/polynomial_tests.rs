//! Identities, values and bounds of polynomials.

use super::*;

fn q(i: usize) -> Polynomial {
    Polynomial::motion(Symbol::Coordinate(i))
}

fn at(a: &Atom) -> f64 {
    match a {
        Atom::Motion(Symbol::Coordinate(i)) => 0.7 + *i as f64,
        Atom::Parameter(k) => 2.5 - *k as f64,
        _ => f64::NAN,
    }
}

/// Identities between sines and cosines hold by themselves.
#[test]
fn identities_hold() {
    let (sin, cos) = (Polynomial::call(Function::Sin, q(0)), Polynomial::call(Function::Cos, q(0)));
    let one = sin.power(2).unwrap().plus(&cos.power(2).unwrap());
    assert_eq!(one.as_number(), Some(1.0));
    let (sin1, cos1) = (Polynomial::call(Function::Sin, q(1)), Polynomial::call(Function::Cos, q(1)));
    let difference = cos.times(&cos1).unwrap().plus(&sin.times(&sin1).unwrap());
    assert_eq!(difference, Polynomial::call(Function::Cos, q(1).minus(&q(0))));
    let double = sin.times(&cos).unwrap().scaled(2.0);
    assert_eq!(double, Polynomial::call(Function::Sin, q(0).scaled(2.0)));
}

/// Products, powers and functions against their values.
#[test]
fn values_are_those_of_the_operations() {
    let k = Polynomial::atom(Atom::Parameter(1));
    let a = Polynomial::call(Function::Sin, q(0)).plus(&k.scaled(2.0));
    let b = Polynomial::call(Function::Cos, q(1)).minus(&q(0));
    let (x, y) = (0.7_f64.sin() + 3.0, 1.7_f64.cos() - 0.7);
    for (p, expected) in [
        (a.times(&b).unwrap(), x * y),
        (a.power(3).unwrap().times(&b.power(2).unwrap()).unwrap(), x.powi(3) * y * y),
        (b.power(-2).unwrap(), y.powi(-2)),
        (q(1).scaled(2.0).power(-3).unwrap(), (3.4_f64).powi(-3)),
        (Polynomial::call(Function::Abs, b.scaled(-3.0)), (3.0 * y).abs()),
        (Polynomial::call(Function::Sign, q(0).scaled(-2.0)), -1.0),
        (Polynomial::call(Function::Sin, q(0)).power(5).unwrap(), 0.7_f64.sin().powi(5)),
    ] {
        assert!((p.value(&at) - expected).abs() < 1e-13 * (1.0 + expected.abs()), "{p:?} {expected}");
    }
    assert!(a.minus(&a).is_zero() && a.has_parameter() && !b.has_parameter());
    assert_eq!(a.by_parameters().len(), 2);
}

#[test]
fn what_grows_without_bound_is_refused() {
    let sum = (0..12).fold(Polynomial::default(), |p, i| p.plus(&q(i)));
    assert_eq!(sum.power(12), Err(TooLarge::Terms));
}

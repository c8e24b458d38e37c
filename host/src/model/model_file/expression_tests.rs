//! Derivatives against differences, and what folds.

use super::*;

/// Derivatives of every function and operation against central differences.
#[test]
fn derivatives_agree_with_differences() {
    let x = || symbol(Symbol::Coordinate(0));
    let y = || symbol(Symbol::Rate(0));
    let mut all: Vec<Node> = FUNCTIONS
        .iter()
        .filter(|f| f.1 != Function::Sign)
        .map(|f| call(f.1, add(multiply(x(), multiply(y(), number(0.2))), number(0.3))))
        .collect();
    all.push(divide(add(x(), number(2.0)), subtract(y(), multiply(x(), x()))));
    all.push(power(add(x(), number(1.0)), add(y(), x())));
    all.push(power(multiply(x(), y()), number(-3.0)));
    for e in &all {
        for by in [Symbol::Coordinate(0), Symbol::Rate(0)] {
            let at = |shift: f64| {
                e.value(&|s| {
                    let base = if s == Symbol::Coordinate(0) { 0.7 } else { 1.9 };
                    base + if s == by { shift } else { 0.0 }
                })
            };
            let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
            let got = e.derivative(by).expect("smooth").value(&|s| if s == Symbol::Coordinate(0) { 0.7 } else { 1.9 });
            assert!((got - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{e:?} {got} {expected}");
        }
    }
    assert!(call(Function::Sign, x()).derivative(Symbol::Coordinate(0)).is_none());
    assert_eq!(as_number(&call(Function::Sign, x()).derivative(Symbol::Rate(0)).unwrap()), Some(0.0));
}

#[test]
fn numbers_fold_and_join() {
    let x = symbol(Symbol::Coordinate(0));
    let e = multiply(number(2.0), multiply(x.clone(), number(3.0)));
    assert_eq!(e, multiply(number(6.0), x.clone()));
    assert_eq!(as_number(&multiply(number(0.0), x.clone())), Some(0.0));
    assert_eq!(subtract(x.clone(), number(0.0)), x);
    assert!((hat(6.2, 0.5, Some(6.0)) - 0.6).abs() < 1e-12);
}

/// What falls within a small velocity is no multiple of the sign, though it is nothing at large
/// ones; a tone at whole cycles of evenly spaced times is no constant.
#[test]
fn a_multiple_is_one_at_motions_of_every_size() {
    let v = || symbol(Symbol::Rate(0));
    let sign = || call(Function::Sign, v());
    let falls = |within: f64| {
        let u = divide(v(), number(within));
        multiply(call(Function::Exp, subtract(number(0.0), multiply(u.clone(), u))), sign())
    };
    for within in [0.003, 0.03, 0.06, 1.0] {
        assert_eq!(multiple(&falls(within), &sign()), None, "{within}");
    }
    let twice = multiple(&multiply(number(2.0), sign()), &sign()).unwrap();
    assert!((twice - 2.0).abs() < 1e-12, "{twice}");
    let tone = call(Function::Cos, multiply(number(core::f64::consts::TAU * 50.0), symbol(Symbol::Time)));
    assert_eq!(multiple(&tone, &number(1.0)), None);
    assert_eq!(multiple(&number(0.0), &number(0.0)), None);
}

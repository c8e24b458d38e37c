//! Derivatives of sums of products: partial ones, and the total one by time along any motion.
//!
//! d/dt = Σ_i q_i′ ∂/∂q_i + Σ_i q_i″ ∂/∂q_i′ + Ω ∂/∂τ + ∂/∂t; ∂(Π aⁿ) = Σ n aⁿ⁻¹ ∂a Π of the
//! others.

use super::polynomial::{Atom, Polynomial, TooLarge};
use crate::model::model_file::expression::{Function, Symbol};

/// Why there is no derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoDerivative {
    /// A sign jumps.
    Jumps,
    /// An input is differentiated, whose rate the record does not give.
    Input(usize),
    /// The result is too large.
    TooLarge,
}

impl From<TooLarge> for NoDerivative {
    fn from(_: TooLarge) -> Self {
        Self::TooLarge
    }
}

/// Partial derivative by an atom (a symbol of the motion or a parameter).
///
/// # Errors
/// A function that jumps.
pub fn partial(p: &Polynomial, by: &Atom) -> Result<Polynomial, NoDerivative> {
    let mut out = Polynomial::default();
    for (product, c) in p.terms() {
        for (i, (a, n)) in product.iter().enumerate() {
            let slope = of_atom(a, by)?;
            if slope.is_zero() {
                continue;
            }
            let mut rest = product.clone();
            if *n == 1 {
                rest.remove(i);
            } else {
                rest[i].1 -= 1;
            }
            out = out.plus(&Polynomial::product(rest, c * f64::from(*n)).times(&slope)?);
        }
    }
    Ok(out)
}

fn of_atom(a: &Atom, by: &Atom) -> Result<Polynomial, NoDerivative> {
    if a == by {
        return Ok(Polynomial::number(1.0));
    }
    let depends = |p: &Polynomial| p.any(&|x| x == by);
    Ok(match a {
        Atom::Parameter(_) | Atom::Motion(_) => Polynomial::default(),
        Atom::Call(_, p) if !depends(p) => Polynomial::default(),
        Atom::Call(f, p) => {
            let call = |f| Polynomial::call(f, p.clone());
            let outer = match f {
                Function::Sin => call(Function::Cos),
                Function::Cos => call(Function::Sin).scaled(-1.0),
                Function::Tan => call(Function::Cos).power(-2)?,
                Function::Sqrt => call(Function::Sqrt).power(-1)?.scaled(0.5),
                Function::Exp => call(Function::Exp),
                Function::Log => p.power(-1)?,
                Function::Abs => call(Function::Sign),
                Function::Tanh => Polynomial::number(1.0).minus(&call(Function::Tanh).power(2)?),
                Function::Wrap => Polynomial::number(1.0),
                Function::Sign => return Err(NoDerivative::Jumps),
            };
            outer.times(&partial(p, by)?)?
        }
        Atom::Sum(p) => partial(p, by)?,
        Atom::Atan2(y, x) => {
            let across = x.times(&partial(y, by)?)?.minus(&y.times(&partial(x, by)?)?);
            across.times(&x.power(2)?.plus(&y.power(2)?).power(-1)?)?
        }
        Atom::Power(p, n) => {
            let log = Polynomial::call(Function::Log, p.clone());
            let inner = partial(n, by)?.times(&log)?.plus(&n.times(&partial(p, by)?)?.times(&p.power(-1)?)?);
            Polynomial::atom(a.clone()).times(&inner)?
        }
    })
}

/// Total derivative by time; `omega` is dτ/dt, rad/s, `coordinates` their number.
///
/// # Errors
/// A function that jumps, or an input, whose rate is not there.
pub fn by_time(p: &Polynomial, coordinates: usize, omega: f64) -> Result<Polynomial, NoDerivative> {
    if let Some(k) = (0..64).find(|&k| p.moves(|s| s == Symbol::Input(k))) {
        return Err(NoDerivative::Input(k));
    }
    let mut out = Polynomial::default();
    let pairs = (0..coordinates)
        .flat_map(|i| [(Symbol::Coordinate(i), Symbol::Rate(i)), (Symbol::Rate(i), Symbol::Acceleration(i))]);
    for (of, rate) in pairs {
        if p.moves(|s| s == of) {
            out = out.plus(&partial(p, &Atom::Motion(of))?.times(&Polynomial::motion(rate))?);
        }
    }
    if p.moves(|s| s == Symbol::Tau) {
        out = out.plus(&partial(p, &Atom::Motion(Symbol::Tau))?.scaled(omega));
    }
    if p.moves(|s| s == Symbol::Time) {
        out = out.plus(&partial(p, &Atom::Motion(Symbol::Time))?);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::model_file::expression::FUNCTIONS;

    /// Every function and operation against central differences.
    #[test]
    fn partial_derivatives_agree_with_differences() {
        let x = Polynomial::motion(Symbol::Coordinate(0));
        let y = Polynomial::atom(Atom::Parameter(0));
        let inner = x.times(&y).unwrap().scaled(0.2).plus(&Polynomial::number(0.3));
        let mut all: Vec<Polynomial> =
            FUNCTIONS.iter().filter(|f| f.1 != Function::Sign).map(|f| Polynomial::call(f.1, inner.clone())).collect();
        all.push(x.times(&x).unwrap().plus(&y).power(-2).unwrap());
        all.push(Polynomial::atom(Atom::Atan2(inner.clone(), x.plus(&y))));
        all.push(Polynomial::atom(Atom::Power(inner.clone(), x.plus(&y))));
        all.push(Polynomial::call(Function::Sin, x.clone()).times(&Polynomial::call(Function::Cos, inner)).unwrap());
        for p in &all {
            for by in [Atom::Motion(Symbol::Coordinate(0)), Atom::Parameter(0)] {
                let at = |shift: f64| {
                    p.value(&|a| {
                        let base = if *a == Atom::Parameter(0) { 1.9 } else { 0.7 };
                        base + if *a == by { shift } else { 0.0 }
                    })
                };
                let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
                let got = partial(p, &by).unwrap().value(&|a| if *a == Atom::Parameter(0) { 1.9 } else { 0.7 });
                assert!((got - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{p:?} {got} {expected}");
            }
        }
    }

    #[test]
    fn time_derivatives_follow_a_motion() {
        // q = sin 1.3 t, τ = 2 t.
        let q = Polynomial::motion(Symbol::Coordinate(0));
        let p = Polynomial::call(Function::Cos, q.clone())
            .times(&Polynomial::motion(Symbol::Rate(0)))
            .unwrap()
            .times(&Polynomial::call(Function::Sin, Polynomial::motion(Symbol::Tau)))
            .unwrap();
        let along = |t: f64| {
            move |a: &Atom| match a {
                Atom::Motion(Symbol::Coordinate(_)) => (1.3 * t).sin(),
                Atom::Motion(Symbol::Rate(_)) => 1.3 * (1.3 * t).cos(),
                Atom::Motion(Symbol::Acceleration(_)) => -1.69 * (1.3 * t).sin(),
                _ => 2.0 * t,
            }
        };
        let rate = by_time(&p, 1, 2.0).unwrap();
        let h = 1e-5;
        let expected = (p.value(&along(0.4 + h)) - p.value(&along(0.4 - h))) / (2.0 * h);
        assert!((rate.value(&along(0.4)) - expected).abs() < 1e-9);
        assert_eq!(by_time(&Polynomial::motion(Symbol::Input(3)), 1, 1.0), Err(NoDerivative::Input(3)));
        let sign = Polynomial::call(Function::Sign, q);
        assert_eq!(by_time(&sign, 1, 1.0), Err(NoDerivative::Jumps));
    }
}

//! Integration by parts: a term of an equation as total derivatives of what angles, velocities and
//! inputs give.
//!
//! For a test function w that vanishes at both ends of a window, with f a function of coordinates,
//! inputs and phase, g = f q′ⁿ⁺¹/(n + 1):
//!
//! ∫ w q″ = ∫ w″ q, ∫ w f q′ⁿ q″ = −∫ w′ g − ∫ w ḟ q′ⁿ⁺¹/(n + 1), ḟ = Σ f_{q_k} q_k′ + Σ f_{u_k}
//! u_k′ + Ω f_τ.
//!
//! Also sign(q′) q″ = (|q′|)′ and |q′| q″ = (q′|q′|/2)′. What is linear in a coordinate, its
//! velocity or an input keeps the series as it was measured (no low-pass), since the test function
//! is one. Refused: an acceleration inside a function or a power, two of them multiplied, one
//! multiplied with another coordinate's velocity (except where two such products make up one
//! derivative), and one with a factor that jumps.

use super::expression::{
    Expression as E, Function, Node, Symbol, add, as_number, call, divide, multiply, number, power_whole, symbol,
};
use crate::model::weak::Order;

/// factor · dᵖ/dtᵖ of an expression without accelerations.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// p.
    pub order: Order,
    /// Factor.
    pub factor: f64,
    /// The expression.
    pub of: Node,
}

/// Most summands that an expression with accelerations may expand to.
const MOST: usize = 500;

/// One summand: a number times factors.
#[derive(Clone, Debug)]
struct Summand {
    number: f64,
    factors: Vec<Node>,
}

/// Sums out, numbers in front; products are multiplied out only where a factor holds an
/// acceleration.
fn summands(e: &Node) -> Result<Vec<Summand>, String> {
    let scaled = |mut list: Vec<Summand>, by: f64| {
        list.iter_mut().for_each(|s| s.number *= by);
        list
    };
    Ok(match &**e {
        E::Number(x) => vec![Summand { number: *x, factors: vec![] }],
        E::Add(a, b) => [summands(a)?, summands(b)?].concat(),
        E::Subtract(a, b) => [summands(a)?, scaled(summands(b)?, -1.0)].concat(),
        E::Multiply(a, b) if e.accelerates() => {
            let (a, b) = (summands(a)?, summands(b)?);
            if a.len() * b.len() > MOST {
                return Err(format!("a product that expands to {} summands", a.len() * b.len()));
            }
            a.iter()
                .flat_map(|x| {
                    b.iter().map(|y| Summand {
                        number: x.number * y.number,
                        factors: [x.factors.as_slice(), &y.factors].concat(),
                    })
                })
                .collect()
        }
        E::Multiply(..) => {
            let mut product = Summand { number: 1.0, factors: vec![] };
            flatten(e, &mut product);
            vec![product]
        }
        E::Divide(a, b) if as_number(b).is_some() => scaled(summands(a)?, 1.0 / as_number(b).unwrap_or(1.0)),
        E::Divide(a, b) if e.accelerates() => {
            if b.accelerates() {
                return Err("a division by an acceleration".to_owned());
            }
            let mut list = summands(a)?;
            list.iter_mut().for_each(|s| s.factors.push(divide(number(1.0), b.clone())));
            list
        }
        _ => vec![Summand { number: 1.0, factors: vec![e.clone()] }],
    })
}

/// Factors of a product, numbers in front.
fn flatten(e: &Node, into: &mut Summand) {
    match &**e {
        E::Multiply(a, b) => {
            flatten(a, into);
            flatten(b, into);
        }
        E::Number(x) => into.number *= x,
        _ => into.factors.push(e.clone()),
    }
}

fn is_rate(s: Symbol) -> bool {
    matches!(s, Symbol::Rate(_))
}

/// Splits an expression into pieces; `omega` is dτ/dt, rad/s, and `circle[i]` says whether
/// coordinate i lies on S1.
///
/// # Errors
/// What of it cannot be integrated.
pub fn pieces(e: &Node, omega: f64, circle: &[bool]) -> Result<Vec<Piece>, String> {
    split(e, omega, circle, false)
}

/// The same for a column of an effect: a function of accelerations (a joint's load) is a value, of
/// accelerations by differences of the smoothed rates. What effects add is weak, so that this costs
/// little.
///
/// # Errors
/// As [`pieces`].
pub fn pieces_of_effect(e: &Node, omega: f64, circle: &[bool]) -> Result<Vec<Piece>, String> {
    split(e, omega, circle, true)
}

fn split(e: &Node, omega: f64, circle: &[bool], functions: bool) -> Result<Vec<Piece>, String> {
    let mut out: Vec<Piece> = Vec::new();
    let mut values = number(0.0);
    let mut first = number(0.0);
    let mut put = |order: Order, factor: f64, of: Node| {
        match out.iter_mut().find(|p| p.order == order && p.of == of) {
            Some(p) => p.factor += factor,
            None => out.push(Piece { order, factor, of }),
        };
    };
    let mut list = summands(e)?;
    pair_up(&mut list, &mut first, &mut values, omega)?;
    for s in &list {
        let (fast, slow): (Vec<&Node>, Vec<&Node>) = s.factors.iter().partition(|f| f.accelerates());
        match fast[..] {
            [] => {
                let whole = s.factors.iter().fold(number(1.0), |p, f| multiply(p, f.clone()));
                match *whole {
                    E::Symbol(Symbol::Rate(i)) => put(Order::First, s.number, symbol(Symbol::Raw(i))),
                    E::Symbol(Symbol::Coordinate(i)) if !circle.get(i).is_some_and(|c| *c) => {
                        put(Order::Value, s.number, symbol(Symbol::Raw(i)));
                    }
                    E::Symbol(Symbol::Input(k)) => put(Order::Value, s.number, symbol(Symbol::RawInput(k))),
                    _ => values = add(values, multiply(number(s.number), whole)),
                }
            }
            [q] => {
                if functions && matches!(**q, E::Call(..)) {
                    let whole = s.factors.iter().fold(number(s.number), |p, f| multiply(p, f.clone()));
                    values = add(values, whole);
                    continue;
                }
                let E::Symbol(Symbol::Acceleration(i)) = **q else {
                    return Err(match **q {
                        E::Call(..) => "an acceleration inside a function",
                        _ => "a power of an acceleration",
                    }
                    .to_owned());
                };
                let (moving, still): (Vec<&Node>, Vec<&Node>) = slow.into_iter().partition(|f| f.any(&is_rate));
                let f = still.into_iter().fold(number(1.0), |p, f| multiply(p, f.clone()));
                if moving.is_empty() && as_number(&f).is_some() {
                    put(Order::Second, s.number * as_number(&f).unwrap_or(1.0), symbol(Symbol::Raw(i)));
                    continue;
                }
                // g with ∂g/∂q_i′ = the moving factors.
                let moved = antiderivative(&moving, i)?;
                let slope = slope(&f, omega)?;
                first = add(first, multiply(multiply(number(s.number), f), moved.clone()));
                values = add(values, multiply(number(-s.number), multiply(slope, moved)));
            }
            _ => return Err("a product of two accelerations".to_owned()),
        }
    }
    for (order, sum) in [(Order::First, first), (Order::Value, values)] {
        match as_number(&sum) {
            Some(x) if x == 0.0 || order != Order::Value => {}
            Some(x) => put(Order::Value, x, number(1.0)),
            None => put(order, 1.0, sum),
        }
    }
    out.retain(|p| p.factor != 0.0);
    Ok(out)
}

/// Takes out pairs f q_i″ q_j′ + f q_i′ q_j″ = f (q_i′ q_j′)′.
fn pair_up(list: &mut Vec<Summand>, first: &mut Node, values: &mut Node, omega: f64) -> Result<(), String> {
    let split = |s: &Summand| -> Option<(usize, usize, Vec<Node>)> {
        let mut rest = s.factors.clone();
        let a = rest.iter().position(|f| matches!(**f, E::Symbol(Symbol::Acceleration(_))))?;
        let E::Symbol(Symbol::Acceleration(i)) = *rest.remove(a) else { return None };
        let r = rest.iter().position(|f| matches!(**f, E::Symbol(Symbol::Rate(j)) if j != i))?;
        let E::Symbol(Symbol::Rate(j)) = *rest.remove(r) else { return None };
        (!rest.iter().any(|f| f.any(&is_rate) || f.accelerates())).then_some((i, j, rest))
    };
    let mut k = 0;
    while k < list.len() {
        let partner = split(&list[k]).and_then(|(i, j, rest)| {
            (k + 1..list.len())
                .find(|&m| {
                    list[m].number == list[k].number
                        && split(&list[m]).is_some_and(|(a, b, other)| (a, b) == (j, i) && other == rest)
                })
                .map(|m| (m, i, j, rest))
        });
        let Some((m, i, j, rest)) = partner else {
            k += 1;
            continue;
        };
        let f = rest.into_iter().fold(number(list[k].number), multiply);
        let product = multiply(symbol(Symbol::Rate(i)), symbol(Symbol::Rate(j)));
        *values = add(values.clone(), multiply(number(-1.0), multiply(slope(&f, omega)?, product.clone())));
        *first = add(first.clone(), multiply(f, product));
        list.remove(m);
        list.remove(k);
    }
    Ok(())
}

/// ∫ of the product of factors over the velocity of coordinate i.
fn antiderivative(moving: &[&Node], i: usize) -> Result<Node, String> {
    let own = |e: &Node| matches!(**e, E::Symbol(Symbol::Rate(j)) if j == i);
    let rate = symbol(Symbol::Rate(i));
    let mut power = 1;
    let mut special = None;
    for f in moving {
        match &***f {
            E::Symbol(_) if own(f) => power += 1,
            E::PowerWhole(a, n) if own(a) && *n > 0 => power += n,
            E::Call(g @ (Function::Sign | Function::Abs), a) if own(a) && special.is_none() => special = Some(*g),
            _ => {
                return Err(
                    "an acceleration multiplied with another coordinate's velocity, or with a function of its own"
                        .to_owned(),
                );
            }
        }
    }
    let n = f64::from(power);
    // With a sign or absolute value in front every power keeps it: (|v| vⁿ)′ = (n + 1) |v| vⁿ⁻¹ v′
    // and so on.
    Ok(match special {
        None => multiply(number(1.0 / n), power_whole(rate, power)),
        Some(Function::Sign) => {
            multiply(number(1.0 / n), multiply(call(Function::Abs, rate.clone()), power_whole(rate, power - 1)))
        }
        Some(_) => {
            multiply(number(1.0 / (n + 1.0)), multiply(call(Function::Abs, rate.clone()), power_whole(rate, power)))
        }
    })
}

/// df/dt of a function of coordinates, inputs and phase.
fn slope(f: &Node, omega: f64) -> Result<Node, String> {
    let mut symbols = Vec::new();
    gather(f, &mut symbols);
    let mut sum = number(0.0);
    for s in symbols {
        let speed = match s {
            Symbol::Coordinate(k) => symbol(Symbol::Rate(k)),
            Symbol::Input(k) => symbol(Symbol::InputRate(k)),
            Symbol::Tau => number(omega),
            Symbol::Time => number(1.0),
            _ => continue,
        };
        let by = f.derivative(s).ok_or("an acceleration multiplied with a function that jumps")?;
        sum = add(sum, multiply(by, speed));
    }
    Ok(sum)
}

/// Symbols of an expression, each once, in a fixed order.
pub fn gather(e: &Node, into: &mut Vec<Symbol>) {
    let seen = core::cell::RefCell::new(Vec::new());
    e.any(&|s| {
        if !seen.borrow().contains(&s) {
            seen.borrow_mut().push(s);
        }
        false
    });
    into.extend(seen.into_inner());
    into.sort_unstable();
    into.dedup();
}

#[cfg(test)]
mod tests {
    use super::super::parser::{Names, parse};
    use super::*;

    fn node(text: &str) -> Node {
        let names = Names { coordinates: vec!["q".into(), "p".into()], inputs: vec!["u".into()] };
        parse(text, &names).unwrap()
    }

    /// A smooth motion with its derivatives.
    fn motion(t: f64) -> impl Fn(Symbol) -> f64 {
        move |s| match s {
            Symbol::Coordinate(0) | Symbol::Raw(0) => (1.3 * t).sin() + 0.4 * t,
            Symbol::Rate(0) => 1.3 * (1.3 * t).cos() + 0.4,
            Symbol::Acceleration(0) => -1.69 * (1.3 * t).sin(),
            Symbol::Coordinate(_) | Symbol::Raw(_) => (0.7 * t).cos(),
            Symbol::Rate(_) | Symbol::ClearRate(_) => -0.7 * (0.7 * t).sin(),
            Symbol::Acceleration(_) => -0.49 * (0.7 * t).cos(),
            Symbol::Input(_) | Symbol::RawInput(_) => (2.1 * t).sin(),
            Symbol::InputRate(_) => 2.1 * (2.1 * t).cos(),
            Symbol::Tau | Symbol::Held(_) | Symbol::State(_) | Symbol::Memory(_) => 3.0 * t,
            Symbol::Time => t,
        }
    }

    /// The pieces, differentiated numerically, add up to the term itself.
    #[test]
    fn pieces_add_up_to_the_term() {
        for text in [
            "q''",
            "3*q'' - q'/2 + 2*u",
            "p''*cos(p - q) - p'^2*sin(p - q)",
            "q''*cos(q)*tau^2*u",
            "q'*q''",
            "q'^3*q''*exp(p)",
            "sign(q')*q''*p",
            "abs(q')*q''",
            "q'*p'' + p'*q''",
            "2*sin(q)*q'*p'' + 2*sin(q)*p'*q''",
            "(q'' + p'')*(1 + cos(q))/(2 + u)",
            "1 + q*p + q",
            "-(q''/3 - sin(tau))",
        ] {
            let e = node(text);
            let list = pieces(&e, 3.0, &[false, false]).unwrap_or_else(|m| panic!("{text}: {m}"));
            for t in [0.3, 1.1, 2.9] {
                let h = 1e-3;
                let sum: f64 = list
                    .iter()
                    .map(|p| {
                        let v = |t: f64| p.of.value(&motion(t));
                        p.factor
                            * match p.order {
                                Order::Value => v(t),
                                Order::First => {
                                    (8.0 * (v(t + h) - v(t - h)) - v(t + 2.0 * h) + v(t - 2.0 * h)) / (12.0 * h)
                                }
                                Order::Second => (v(t + h) - 2.0 * v(t) + v(t - h)) / (h * h),
                            }
                    })
                    .sum();
                let expected = e.value(&motion(t));
                assert!((sum - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{text} at {t}: {sum} {expected}");
            }
        }
    }

    #[test]
    fn what_cannot_be_integrated_is_said() {
        for (text, part) in [
            ("sign(q'')", "inside a function"),
            ("q''^2", "power"),
            ("q''*p''", "two accelerations"),
            ("q''*p'", "another coordinate's velocity"),
            ("q''*sign(q)", "jumps"),
            ("1/q''", "division"),
            ("q''*sin(q')", "function of its own"),
        ] {
            let m = pieces(&node(text), 1.0, &[false, false]).unwrap_err();
            assert!(m.contains(part), "{text}: {m}");
        }
    }

    /// A function of accelerations is a value where an effect brings it in, and only there.
    #[test]
    fn functions_of_accelerations_are_values_of_effects() {
        let e = node("2*sign(q')*sqrt(q''^2 + (p'' + 9)^2) + q''");
        let list = pieces_of_effect(&e, 1.0, &[false, false]).unwrap();
        assert_eq!(list.iter().map(|p| p.order).collect::<Vec<_>>(), [Order::Second, Order::Value]);
        assert!(list[1].of.accelerates() && pieces(&e, 1.0, &[false, false]).is_err());
        assert!(pieces_of_effect(&node("q''^2"), 1.0, &[false, false]).is_err());
    }

    #[test]
    fn linear_terms_keep_what_was_measured() {
        let p = pieces(&node("2*q' + u + q"), 1.0, &[false, true]).unwrap();
        assert_eq!(p.len(), 3);
        assert_eq!((p[0].order, p[0].factor, &p[0].of), (Order::First, 2.0, &symbol(Symbol::Raw(0))));
        assert!(p.iter().any(|x| x.of == symbol(Symbol::RawInput(0))));
        // On S1 the angle itself is wrapped, so it is no raw series.
        assert_eq!(pieces(&node("p"), 1.0, &[false, true]).unwrap()[0].of, symbol(Symbol::Coordinate(1)));
    }
}

//! A frame that gives way: `moves` at a frame displaces everything that it carries by s(t), a sum
//! of states that what moves on it drives by its momentum P(q, q′), kg m/s, and of laws of time:
//! what the frame did when the record began.
//!
//! The kinetic energy of what is carried is ½ Σ m |v + s′|², that of the momentum P·s′ beside the
//! system's own; since P is a total derivative, equation e gains (∂P/∂q_e′)·s″ and nothing else.
//! A frame of mass M with everything on it, stiffness M ω² and damping 2 ζ M ω obeys
//! (M s′ + P·n)′ = −M ω² s − 2 ζ M ω s′ along its direction n: with s = z/M and u = M s′ + P·n the
//! states have laws without accelerations, z′ = u − P·n and u′ = −ω² z − 2 ζ ω (u − P·n).
//!
//! P holds first moments of the system, of which motion shows the ratios to inertias. The states are
//! driven by P/D, D the first equation's inertia, at the values that are known when they are
//! followed, and stand beside D: what is open of the masses then is in the strength alone.

use super::columns::{Law, Part};
use super::entry::{Entry, Form};
use crate::model::model_file::expression::{Node, Symbol, add, as_number, multiply, number};
use crate::model::model_file::parser::Mistake;
use crate::system::derivative::{NoDerivative, by_time, partial};
use crate::system::language::SystemFile;
use crate::system::mechanism::{Mechanism, at};
use crate::system::polynomial::{Atom, Polynomial, Product};
use crate::system::words::{Value as Word, Words};

/// Words of a law: the momentum to the right and upward, and the time.
pub const WORDS: &[&str] = &["p_right", "p_up", "t"];

/// The unit vectors to the right and upward.
pub fn axes() -> Vec<(String, Vec<Polynomial>)> {
    let axis = |k: usize| (0..2).map(|i| Polynomial::number(f64::from(u8::from(i == k)))).collect();
    vec![("right".to_owned(), axis(0)), ("up".to_owned(), axis(1))]
}

/// Whether everything of a system is known that a frame would carry.
pub fn carries(file: &SystemFile) -> bool {
    file.momentum(1.0).is_some()
}

fn state(k: usize) -> Atom {
    Atom::Motion(Symbol::State(k))
}

/// Derivative by time along the laws of the states' rates.
fn rate(p: &Polynomial, rates: &[Polynomial], n: usize, omega: f64) -> Result<Polynomial, NoDerivative> {
    let mut out = by_time(p, n, omega)?;
    for (k, rate) in rates.iter().enumerate() {
        out = out.plus(&partial(p, &state(k))?.times(rate)?);
    }
    Ok(out)
}

/// A sum with its parameters at their values, over a number.
fn at_values(p: &Polynomial, parameters: &[f64], over: f64) -> Polynomial {
    let groups = p.by_motion().into_iter();
    groups.fold(Polynomial::default(), |sum, (motion, own)| {
        sum.plus(&Polynomial::product(motion, at(&own, parameters) / over))
    })
}

/// Additions to the left-hand sides; none where the momentum is not known, or moves nothing.
///
/// # Errors
/// A law that has no meaning there.
pub fn parts(
    entry: &Entry,
    form: &Form,
    mechanism: &Mechanism,
    parameters: &[f64],
    mut words: Words,
    omega: f64,
) -> Result<Option<Vec<Part>>, Mistake> {
    let Some((file, momentum)) = mechanism.file.as_deref().and_then(|f| Some((f, f.momentum(omega)?))) else {
        return Ok(None);
    };
    let Some((_, inertia)) = mechanism.scales.first() else { return Ok(None) };
    let over = at(inertia, parameters);
    words.points = axes();
    let driven_by = momentum.iter().map(|p| at_values(p, parameters, over));
    words.scalars.extend(WORDS.iter().map(|w| (*w).to_owned()).zip(driven_by));
    let rates = entry.rates(&words, form).map_err(|(_, m)| m)?;
    let Some(states) = entry.followed(&words, form)? else { return Ok(None) };
    let Word::Vector(law) = entry.law(&words, form)? else { return Ok(None) };
    let mut out = Vec::new();
    for (moved, momentum) in law.iter().zip(&momentum) {
        let n = file.coordinates.len();
        let second = rate(moved, &rates, n, omega).and_then(|v| rate(&v, &rates, n, omega));
        let Ok(second) = second else { return Ok(None) };
        for (k, _) in entry.strengths.iter().enumerate() {
            let Ok(of) = partial(&second, &Atom::Parameter(file.parameters.len() + k)) else { return Ok(None) };
            for (equation, (coordinate, _)) in mechanism.scales.iter().enumerate() {
                let lever = partial(momentum, &Atom::Motion(Symbol::Rate(*coordinate))).unwrap_or_default();
                for (motion, own) in lever.by_motion() {
                    let node = multiply(Polynomial::product(motion, 1.0).node(), of.node());
                    let Ok(front) = own.times(inertia) else { return Ok(None) };
                    out.extend(front.terms().map(|(product, factor)| Part {
                        strength: k,
                        equation,
                        product: product.clone(),
                        of: Law::Momentum(factor, node.clone()),
                        states: states.clone(),
                    }));
                }
            }
        }
    }
    let moves = out.iter().any(|p| !matches!(&p.of, Law::Momentum(_, of) if as_number(of) == Some(0.0)));
    Ok((moves && over > 0.0).then_some(out))
}

/// What of the equations' residuals `left` is the frame's to the right and upward:
/// Σ_e (∂P/∂q_e′)/D_e r_e, its acceleration times squares; none where the momentum is not known.
pub fn shaken(mechanism: &Mechanism, parameters: &[f64], omega: f64, left: &[Node]) -> Vec<Node> {
    let Some(momentum) = mechanism.file.as_deref().and_then(|f| f.momentum(omega)) else { return Vec::new() };
    let of = |component: &Polynomial| {
        let one = |((coordinate, inertia), r): (&(usize, Polynomial), &Node)| {
            let lever = partial(component, &Atom::Motion(Symbol::Rate(*coordinate))).unwrap_or_default();
            multiply(multiply(number(1.0 / at(inertia, parameters)), lever.node_at(parameters)), r.clone())
        };
        mechanism.scales.iter().zip(left).map(one).fold(number(0.0), add)
    };
    momentum.iter().map(of).collect()
}

/// Ratios N/D of what stands in front of the terms, each to the first: what must be fixed for the
/// strength to be one number. Products in front of one and the same term count together.
pub(super) fn ratios(parts: &[Part], mechanism: &Mechanism) -> Vec<(Polynomial, Polynomial)> {
    let mut fronts: Vec<(&Part, Polynomial)> = Vec::new();
    for part in parts {
        let Law::Momentum(factor, of) = &part.of else { continue };
        let own = Polynomial::product(part.product.clone(), *factor);
        let is_of = |p: &Part| matches!(&p.of, Law::Momentum(_, other) if other == of);
        let same =
            |p: &Part| (p.strength, p.equation, &p.states) == (part.strength, part.equation, &part.states) && is_of(p);
        match fronts.iter_mut().find(|f| same(f.0)) {
            Some(front) => front.1 = front.1.plus(&own),
            None => fronts.push((part, own)),
        }
    }
    let inertia = |p: &Part| mechanism.scales.get(p.equation).map(|s| &s.1);
    let (Some((first, front)), Some(file)) = (fronts.first(), mechanism.file.as_deref()) else { return Vec::new() };
    // What drives the states.
    let momentum = file.momentum(1.0).unwrap_or_default();
    let drives = momentum.iter().flat_map(Polynomial::by_motion).map(|(_, own)| Some((own, inertia(first)?.clone())));
    let ratio =
        |(p, own): &(&Part, Polynomial)| Some((own.times(inertia(first)?).ok()?, front.times(inertia(p)?).ok()?));
    let all = fronts[1..].iter().map(ratio).chain(drives).flatten();
    all.filter(|(n, d)| !is_number(n, d)).collect()
}

/// Whether N/D is the same whatever the parameters: rounding would make something of it.
fn is_number(n: &Polynomial, d: &Polynomial) -> bool {
    let mut ratios = n.terms().zip(d.terms()).map(|((p, x), (q, y))| (p == q).then_some(x / y));
    let Some(first) = ratios.next() else { return n.size() == d.size() };
    n.size() == d.size() && first.is_some() && ratios.all(|r| r == first)
}

/// What is wrong in a law or its states, what is expected and how to mend it: all are linear.
pub fn mistake(e: &Entry, rates: &[Polynomial], law: &[Polynomial]) -> Option<[String; 3]> {
    let moving = |product: &Product| {
        product
            .iter()
            .filter(|(a, _)| !matches!(a, Atom::Parameter(_)))
            .map(|(a, n)| (a.clone(), *n))
            .collect::<Vec<_>>()
    };
    let is_linear = |p: &Polynomial, wanted: &dyn Fn(Symbol) -> bool| {
        p.terms().all(|(product, _)| matches!(moving(product)[..], [(Atom::Motion(s), 1)] if wanted(s)))
    };
    let is_state = |s: Symbol| matches!(s, Symbol::State(_));
    // What the frame does by itself is a law of time beside them.
    let of_states = |p: &Polynomial| {
        let (with, without): (Vec<_>, Vec<_>) =
            p.terms().map(|(t, c)| Polynomial::product(t.clone(), c)).partition(|t| t.moves(is_state));
        with.iter().all(|t| is_linear(t, &is_state)) && without.iter().all(|t| !t.moves(|s| s != Symbol::Time))
    };
    if !law.iter().any(|p| p.moves(is_state)) || !law.iter().all(of_states) {
        let expected = "a displacement in which each term has one state as a factor".to_owned();
        return Some([format!("\"{}\"", e.law), expected, "Let states move the frame: \"A*z*right\"".to_owned()]);
    }
    let bent = rates.iter().position(|r| !is_linear(r, &|_| true))?;
    let (name, law) = &e.states[bent];
    let expected = format!("a sum of states and of {}, each times a number", WORDS[..2].join(", "));
    Some([format!("\"{law}\" for {name}"), expected, "States of a frame are linear in what drives them".to_owned()])
}

#[cfg(test)]
#[path = "on_a_frame_tests.rs"]
mod tests;

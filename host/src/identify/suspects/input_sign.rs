//! A measured input whose sign is reversed.
//!
//! Written equations with the input for their balance, Σ λ_j X_j = u, have every coefficient of
//! such an equation reversed: the inertia is negative, and friction brakes all the same beside it,
//! as the stiffness pulls back. Where one of these does not, the inertia itself is wrong. An
//! equation of first order has a friction for its leading term: one that is negative beside a
//! stiffness that is not lets the motion run away.
//! Of a system from bodies it is the input's own coefficient N/D, whose sign is that of N where its
//! parameters are known, or positive by their nature; D is an inertia.
//!
//! Limits: an input whose gain is not known may have either sign.

use super::arrow::{CLEAR, NamedCoefficient, feeds, inertia, stiffness_sign};
use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::{Equation, ModelFile};
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::system::mechanism::{Coefficient, Mechanism};
use crate::system::polynomial::Atom;
use crate::warning::Warning;
use crate::wording::format::{Z95, plus_minus};

/// An input and the coefficient that shows it.
struct Reversed<'a> {
    input: usize,
    by: &'a NamedCoefficient<'a>,
    /// What is wrong with it.
    wrong: &'static str,
    /// Whether the equation's stiffness has the right sign all the same: it is no input's then.
    alone: bool,
}

/// A warning where an input is reversed, or some equation's inertia is negative.
pub(super) fn reversed(own: &Rig, bound: &ObservedModel, known: &[NamedCoefficient<'_>]) -> Option<Warning> {
    let model = &bound.model;
    let written =
        || model.equations.iter().enumerate().find_map(|(e, eq)| of_equation(model, own.omega(), e, eq, known));
    let derived = || model.mechanism.as_deref().and_then(|m| of_mechanism(model, m, own, known));
    let Reversed { input, by, wrong, alone } = written().or_else(derived)?;
    let channel = &own.channel[*bound.inputs.get(input)?].name;
    let value = plus_minus(by.value, Z95 * by.std_error);
    let found = format!("{} = {value} {wrong}", by.name);
    let warning = if alone || feeds(model, own.omega(), known) {
        Warning::new(
            "negative-inertia",
            found,
            "Is a channel reversed, late or exchanged with another? If not, the equations miss something: run `whirl explain`",
        )
    } else {
        Warning::new(
            "sign-reversed",
            format!("{channel} acts in the wrong sense: {found}, and friction brakes all the same"),
            format!(
                "Negate the column {channel} (or that of what it moves); if it is meant so, negate it in the model file"
            ),
        )
        .with("channels", vec![channel.clone()])
    };
    Some(warning.invalidating().with("parameter", by.name).with("value", by.value).with("std_error", by.std_error))
}

fn is_negative(k: &NamedCoefficient<'_>) -> bool {
    k.value < -CLEAR * k.std_error
}

/// Of an equation with inputs for its balance, the only coefficient of its coordinate's highest
/// derivative.
fn of_equation<'a>(
    model: &ModelFile,
    omega: f64,
    e: usize,
    equation: &Equation,
    known: &'a [NamedCoefficient<'a>],
) -> Option<Reversed<'a>> {
    let input = (0..model.inputs.len()).find(|k| equation.balance.any(&|s| s == Symbol::Input(*k)))?;
    let own = || std::iter::once(e).chain(0..model.coordinates.len());
    let leads = |by: &dyn Fn(&Node) -> f64| {
        let mut terms = equation.terms.iter().filter(|t| by(&t.of) != 0.0);
        let (Some(only), None) = (terms.next(), terms.next()) else { return None };
        if by(&equation.balance) != 0.0 {
            return None;
        }
        known.iter().find(|k| k.name == only.name && is_negative(k))
    };
    let accelerated = own().find(|&i| equation.terms.iter().any(|t| inertia(model, omega, &t.of, i) != 0.0));
    if let Some(i) = accelerated {
        let by = leads(&|n| inertia(model, omega, n, i))?;
        let alone = stiffness_sign(equation, known, i).is_some_and(|sign| sign > 0.0);
        return Some(Reversed { input, by, wrong: "is negative, which no inertia is", alone });
    }
    // Of first order: the sign of a lone gain is the user's affair.
    let is_second = |n: &Node| n.any(&|s| matches!(s, Symbol::Acceleration(_)));
    if is_second(&equation.balance) || equation.terms.iter().any(|t| is_second(&t.of)) {
        return None;
    }
    let rate = |n: &Node, i: usize| n.derivative(Symbol::Rate(i)).map_or(0.0, |d| d.value(&|_| 0.0));
    let i = own().find(|&i| equation.terms.iter().any(|t| rate(&t.of, i) != 0.0))?;
    let by = leads(&|n| rate(n, i))?;
    stiffness_sign(equation, known, i).filter(|sign| *sign > 0.0)?;
    Some(Reversed { input, by, wrong: "is negative: the motion would run away of itself", alone: true })
}

/// Of a system from bodies, the coefficient of an input.
fn of_mechanism<'a>(
    model: &ModelFile,
    mechanism: &Mechanism,
    own: &Rig,
    known: &'a [NamedCoefficient<'a>],
) -> Option<Reversed<'a>> {
    let stated = mechanism.known(&own.known, own.says_gravity());
    let value = |k: usize| stated.get(mechanism.parameters[k].name.as_str()).copied().unwrap_or(1.0);
    let values: Vec<f64> = (0..mechanism.parameters.len()).map(value).collect();
    let has_sign = |k: usize| {
        let p = &mechanism.parameters[k];
        p.positive || stated.contains_key(p.name.as_str())
    };
    mechanism.coefficients.iter().find_map(|c| {
        let input = input_of(model, c)?;
        let open = |a: &Atom| matches!(a, Atom::Parameter(k) if !has_sign(*k));
        if c.numerator.size() != 1 || c.numerator.any(&open) {
            return None;
        }
        let by = known.iter().find(|k| k.name == c.name)?;
        let expected = mechanism.value(&c.name, &values)?;
        (by.value * expected < 0.0 && by.value.abs() > CLEAR * by.std_error).then_some(Reversed {
            input,
            by,
            wrong: "has another sign than what is known of the rig gives it",
            alone: false,
        })
    })
}

/// The input that is all of a coefficient's term but for parameters.
fn input_of(model: &ModelFile, c: &Coefficient) -> Option<usize> {
    let mut terms = model.equations.iter().flat_map(|e| &e.terms).filter(|t| t.name == c.name);
    let term = terms.next()?;
    (0..model.inputs.len()).find(|k| term.of.any(&|s| s == Symbol::Input(*k)))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn found(rig: &str, values: &[(&str, f64)]) -> Option<(&'static str, String)> {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(rig)).unwrap();
        let known: Vec<NamedCoefficient<'_>> =
            values.iter().map(|(name, value)| NamedCoefficient { name, value: *value, std_error: 0.05 }).collect();
        reversed(&rig, rig.bound.as_ref().unwrap(), &known).map(|w| (w.id, w.text))
    }

    #[test]
    fn written_equations_have_all_coefficients_reversed() {
        let duffing = |m: f64, c: f64| found("duffing.toml", &[("m", m), ("c", c), ("k", 40.0 * m), ("k3", 60.0 * m)]);
        assert_eq!(duffing(1.0, 0.4), None);
        // Not clear.
        assert_eq!(duffing(-0.2, -0.4), None);
        let (id, text) = duffing(-1.0, -0.4).unwrap();
        assert_eq!(id, "sign-reversed");
        assert!(text.contains("force acts in the wrong sense: m = ") && text.contains("no inertia"), "{text}");
        // A friction that feeds the motion tells it from a reversed input.
        assert_eq!(duffing(-1.0, 0.4).unwrap().0, "negative-inertia");
    }

    #[test]
    fn an_inertia_that_is_wrong_alone_is_no_inputs_sign() {
        let (id, text) = found("duffing.toml", &[("m", -1.0), ("c", -0.4), ("k", 40.0), ("k3", 60.0)]).unwrap();
        assert_eq!(id, "negative-inertia", "{text}");
    }

    /// T q' + k q = u.
    #[test]
    fn a_motion_of_first_order_does_not_run_away() {
        let text = "name = \"m\"\ncoordinates = [{ name = \"q\", space = \"R\" }]\ninputs = [\"u\"]\n[[equation]]\nbalance = \"u\"\nterms = { T = \"q'\", k = \"q\" }\n";
        let model = ModelFile::parse(text, Path::new("m.toml")).unwrap();
        let found = |t: f64, k: f64| {
            let known = [("T", t), ("k", k)].map(|(name, value)| NamedCoefficient { name, value, std_error: 0.01 });
            of_equation(&model, 1.0, 0, &model.equations[0], &known).map(|r| (r.by.name.to_owned(), r.alone))
        };
        assert_eq!(found(0.2, 0.8), None);
        assert_eq!(found(-0.2, 0.8), Some(("T".to_owned(), true)));
        // Nothing to hold it, not clear, or an input that counts the other way.
        assert_eq!(found(-0.2, 0.0), None);
        assert_eq!(found(-0.02, 0.8), None);
        assert_eq!(found(-0.2, -0.8), None);
    }

    #[test]
    fn bodies_have_the_inputs_own_coefficient_reversed() {
        let rotary = |gain: f64| found("rotary-pendulum.toml", &[("alpha_k_t", gain), ("theta_m_e_g", 46.0)]);
        assert_eq!(rotary(13.0), None);
        let (id, text) = rotary(-13.0).unwrap();
        assert_eq!(id, "sign-reversed");
        assert!(text.contains("current acts in the wrong sense: alpha_k_t = "), "{text}");
    }
}

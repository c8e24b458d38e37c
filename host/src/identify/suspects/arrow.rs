//! Whether a record runs backwards: every law of friction then gives energy to the motion, and
//! nothing else changes.
//!
//! q(−t) obeys the same equations with every term that is odd in the velocities reversed. F = Σ
//! λ_j X_j − Y; a term X_j of equation e takes energy from coordinate i where λ_j [X_j(v_i = 1) −
//! X_j(v_i = −1)] has the sign of i's inertia ∂F/∂q̈_i. Terms whose sense depends on the position
//! (van der Pol's) say nothing.

use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{Node, Symbol};

/// Standard errors from which a coefficient has a sign.
pub(super) const CLEAR: f64 = 5.0;

/// A named coefficient with its standard error.
pub(super) struct NamedCoefficient<'a> {
    pub name: &'a str,
    pub value: f64,
    pub std_error: f64,
}

/// Whether some friction clearly feeds the motion: a model that does cannot tell by its own motion
/// how well it fits.
pub(super) fn feeds(model: &ModelFile, omega: f64, known: &[NamedCoefficient<'_>]) -> bool {
    let value = |name: &str| known.iter().find(|k| k.name == name).map_or(0.0, |k| k.value);
    known.iter().any(|k| {
        k.value.abs() > CLEAR * k.std_error && sense(model, omega, &value, k.name).is_some_and(|s| s * k.value < 0.0)
    })
}

/// The frictions that feed the motion, if all that are known to have a sign do, and most of all
/// frictions are.
pub(super) fn reversed<'a>(model: &ModelFile, omega: f64, known: &[NamedCoefficient<'a>]) -> Option<Vec<&'a str>> {
    let value = |name: &str| known.iter().find(|k| k.name == name).map_or(0.0, |k| k.value);
    let (mut feeding, mut all) = (Vec::new(), 0_usize);
    for k in known {
        let Some(sense) = sense(model, omega, &value, k.name) else { continue };
        all += 1;
        if sense * k.value < -CLEAR * k.std_error {
            feeding.push(k.name);
        } else if sense * k.value > CLEAR * k.std_error {
            return None;
        }
    }
    (!feeding.is_empty() && 2 * feeding.len() > all).then_some(feeding)
}

/// Sign that a coefficient has where its term takes energy away; none for a term that is no
/// friction.
fn sense(model: &ModelFile, omega: f64, value: &dyn Fn(&str) -> f64, name: &str) -> Option<f64> {
    let mut found = None;
    for (e, equation) in model.equations.iter().enumerate() {
        for t in equation.terms.iter().filter(|t| t.name == name) {
            let inertia = |i: usize| {
                let by = |n: &Node| inertia(model, omega, n, i);
                equation.terms.iter().map(|t| value(&t.name) * by(&t.of)).sum::<f64>() - by(&equation.balance)
            };
            // The equation's own coordinate, or, where equations come in another order, the first
            // that it accelerates.
            let i = std::iter::once(e).chain(0..model.coordinates.len()).find(|&i| inertia(i) != 0.0)?;
            let sign = resists(&model.in_seconds(&t.of, omega), i)? * inertia(i).signum();
            if found.is_some_and(|f| f != sign) {
                return None;
            }
            found = Some(sign);
        }
    }
    found
}

/// ∂/∂q̈_i of an expression, at rest at 0.
pub(super) fn inertia(model: &ModelFile, omega: f64, of: &Node, i: usize) -> f64 {
    model.in_seconds(of, omega).derivative(Symbol::Acceleration(i)).map_or(0.0, |d| d.value(&|_| 0.0))
}

/// The sign of an expression that is odd in the velocities and has that sign for v_i > 0 wherever
/// the coordinates are.
fn resists(of: &Node, i: usize) -> Option<f64> {
    let mut found = None;
    for place in [0.3, -0.7, 1.9, -2.6] {
        for speed in [0.5, 8.0] {
            let at = |v: f64| {
                of.value(&|s| match s {
                    Symbol::Coordinate(k) | Symbol::Raw(k) => place + 0.1 * k as f64,
                    Symbol::Rate(k) | Symbol::ClearRate(k) | Symbol::Held(k) if k == i => v,
                    _ => 0.0,
                })
            };
            let (forward, backward) = (at(speed), at(-speed));
            if forward == 0.0 || !forward.is_finite() || (forward + backward).abs() > 1e-9 * forward.abs() {
                return None;
            }
            if found.is_some_and(|f: f64| f != forward.signum()) {
                return None;
            }
            found = Some(forward.signum());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: &str = r#"name = "m"
coordinates = [{ name = "q", space = "R" }, { name = "p", space = "S1" }]
[[equation]]
balance = "-q''"
terms = { c = "q' - p'", d = "sign(q')", k = "q", mu = "(1 - q^2)*q'" }
[[equation]]
balance = "-p''"
terms = { J = "q''*cos(p)", e = "p' - q'", g = "sin(p)*p'^2" }
"#;

    fn judged(values: [f64; 3]) -> Option<Vec<&'static str>> {
        let model = ModelFile::parse(MODEL, std::path::Path::new("m.toml")).unwrap();
        let names = ["c", "d", "e"];
        let mut known: Vec<NamedCoefficient<'static>> =
            names.iter().zip(values).map(|(name, value)| NamedCoefficient { name, value, std_error: 0.1 }).collect();
        known.push(NamedCoefficient { name: "mu", value: -5.0, std_error: 0.1 });
        known.push(NamedCoefficient { name: "J", value: 1.5, std_error: 0.1 });
        reversed(&model, 1.0, &known)
    }

    #[test]
    fn frictions_that_all_feed_the_motion_are_told_from_one_that_does() {
        assert_eq!(judged([-1.0, -2.0, -3.0]), Some(vec!["c", "d", "e"]));
        // One that is not known to have a sign does not speak against it; one that has the right
        // sign does.
        assert_eq!(judged([-1.0, -0.2, -3.0]), Some(vec!["c", "e"]));
        assert_eq!(judged([-1.0, 2.0, -3.0]), None);
        assert_eq!(judged([-1.0, -0.2, 0.1]), None);
        assert_eq!(judged([1.0, 2.0, 3.0]), None);
    }
}

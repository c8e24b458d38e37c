//! Whether a record runs backwards: every law of friction then gives energy to the motion, and
//! nothing else changes.
//!
//! q(−t) obeys the same equations with every term that is odd in the velocities reversed. F = Σ
//! λ_j X_j − Y; a term X_j of equation e takes energy from coordinate i where λ_j [X_j(v_i = 1) −
//! X_j(v_i = −1)] has the sign of what is even in the velocities: i's inertia ∂F/∂q̈_i and its
//! stiffness. An inertia that was fitted may itself be wrong, most of all one that hardly shows;
//! where the stiffness clearly has the other sign nothing is said. Terms whose sense depends on the
//! position (van der Pol's) say nothing.

use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::{Equation, ModelFile};

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
    known.iter().any(|k| {
        k.value.abs() > CLEAR * k.std_error && sense(model, omega, known, k.name).is_some_and(|s| s * k.value < 0.0)
    })
}

/// The frictions that feed the motion, if all that are known to have a sign do, and most of all
/// frictions are.
pub(super) fn reversed<'a>(model: &ModelFile, omega: f64, known: &[NamedCoefficient<'a>]) -> Option<Vec<&'a str>> {
    let (mut feeding, mut all) = (Vec::new(), 0_usize);
    for k in known {
        let Some(sense) = sense(model, omega, known, k.name) else { continue };
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
fn sense(model: &ModelFile, omega: f64, known: &[NamedCoefficient<'_>], name: &str) -> Option<f64> {
    let mut found = None;
    for (e, equation) in model.equations.iter().enumerate() {
        for t in equation.terms.iter().filter(|t| t.name == name) {
            // The equation's own coordinate, or, where equations come in another order, the first
            // that it accelerates.
            let moves = |i: &usize| Even::inertia(model, omega, equation, known, *i).value != 0.0;
            let i = std::iter::once(e).chain(0..model.coordinates.len()).find(moves)?;
            let sign = resists(&model.in_seconds(&t.of, omega), i)? * even_sign(model, omega, equation, known, i)?;
            if found.is_some_and(|f| f != sign) {
                return None;
            }
            found = Some(sign);
        }
    }
    found
}

/// What an equation has that is even in the velocities, with its standard error.
struct Even {
    value: f64,
    error: f64,
}

impl Even {
    /// Σ λ_j x_j − y of an equation's terms and balance, where `of` is what an expression adds.
    fn of(equation: &Equation, known: &[NamedCoefficient<'_>], of: &dyn Fn(&Node) -> f64) -> Self {
        let (mut value, mut variance) = (-of(&equation.balance), 0.0);
        for t in &equation.terms {
            let Some(k) = known.iter().find(|k| k.name == t.name) else { continue };
            let x = of(&t.of);
            value += k.value * x;
            variance += (k.std_error * x).powi(2);
        }
        Self { value, error: variance.sqrt() }
    }

    /// ∂F/∂q̈_i.
    fn inertia(model: &ModelFile, omega: f64, equation: &Equation, known: &[NamedCoefficient<'_>], i: usize) -> Self {
        Self::of(equation, known, &|n| inertia(model, omega, n, i))
    }

    /// Its sign, where that is clear.
    fn sign(&self) -> Option<f64> {
        (self.value != 0.0 && self.value.abs() > CLEAR * self.error).then(|| self.value.signum())
    }
}

/// The sign of an equation's inertia and stiffness for coordinate i; none where neither is clear,
/// or where the stiffness contradicts an inertia that was fitted. One that stands in the balance
/// cannot be wrong: a stiffness against it is an equilibrium that does not hold.
fn even_sign(
    model: &ModelFile,
    omega: f64,
    equation: &Equation,
    known: &[NamedCoefficient<'_>],
    i: usize,
) -> Option<f64> {
    let inertia = Even::inertia(model, omega, equation, known, i);
    let is_fitted = inertia.error > 0.0;
    match (inertia.sign(), stiffness_sign(equation, known, i)) {
        (Some(m), Some(k)) if is_fitted && m != k => None,
        (Some(m), _) => Some(m),
        (None, k) => k,
    }
}

/// The sign of the force with which an equation's terms pull coordinate i back, the others at 0;
/// none where it is not clear or not the same wherever the coordinate is (two wells).
pub(super) fn stiffness_sign(equation: &Equation, known: &[NamedCoefficient<'_>], i: usize) -> Option<f64> {
    // A drive's force or an input is not the system's own.
    let is_driven =
        |n: &Node| n.any(&|s| matches!(s, Symbol::Tau | Symbol::Time | Symbol::Input(_) | Symbol::RawInput(_)));
    let at = |n: &Node, place: f64| {
        n.value(&|s| match s {
            Symbol::Coordinate(k) | Symbol::Raw(k) if k == i => place,
            _ => 0.0,
        })
    };
    let mut found = None;
    for place in [1e-3, 0.3, 0.7, 1.9, 2.6] {
        let back = |n: &Node| if is_driven(n) { 0.0 } else { at(n, place) - at(n, -place) };
        let Some(sign) = Even::of(equation, known, &back).sign() else { continue };
        if found.is_some_and(|f| f != sign) {
            return None;
        }
        found = Some(sign);
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

    /// Of m q'' + c q' + k q = u, each known to that standard error.
    fn of_oscillator(m: f64, c: f64, k: f64) -> Option<Vec<&'static str>> {
        let text = MODEL.split("[[equation]]").next().unwrap().replace(", { name = \"p\", space = \"S1\" }", "");
        let text = format!(
            "{text}inputs = [\"u\"]\n[[equation]]\nbalance = \"u\"\nterms = {{ m = \"q''\", c = \"q'\", k = \"q\" }}\n"
        );
        let model = ModelFile::parse(&text, std::path::Path::new("m.toml")).unwrap();
        let known = [("m", m), ("c", c), ("k", k)];
        let known: Vec<NamedCoefficient<'static>> =
            known.map(|(name, value)| NamedCoefficient { name, value, std_error: 0.01 }).into();
        reversed(&model, 1.0, &known)
    }

    #[test]
    fn an_inertia_against_the_stiffness_accuses_nobody() {
        assert_eq!(of_oscillator(1.0, -0.2, 40.0), Some(vec!["c"]));
        assert_eq!(of_oscillator(1.0, 0.2, 40.0), None);
        // All reversed: an input's sign, no time that runs backwards.
        assert_eq!(of_oscillator(-1.0, -0.2, -40.0), None);
        // A right record of two time constants, the inertia all but nothing and of the wrong sign.
        assert_eq!(of_oscillator(-0.1, 2.0, 40.0), None);
        assert_eq!(of_oscillator(-0.1, -2.0, 40.0), None);
        // One that has no sign: the stiffness decides.
        assert_eq!(of_oscillator(-0.02, 2.0, 40.0), None);
        assert_eq!(of_oscillator(-0.02, -2.0, 40.0), Some(vec!["c"]));
    }
}

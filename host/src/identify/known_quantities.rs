//! Whether what is said to be known agrees with the record.
//!
//! Gravity fixes lengths: B21/B22 = l1 Ω²/g, B25/B22 = a Ω²/g, and B22 = g m2 e2/(J_o2 Ω²),
//! B12/B11 = g (m1 e1 + m2 l1)/(m2 e2 l1 Ω²). Where all quantities of such a relation are said to
//! be known, R = 1 tests them, R the relation's two sides divided. ln R over its standard error
//! (from the coefficients' covariance, widened by how much their own ties are missed) has Student's
//! t distribution over the jackknife's blocks. One wrong quantity q that stands in R with power n
//! would agree as q R^(−1/n); a time base off by κ changes every Ω² by κ⁻².
//!
//! Masses alone scale with each other: no motion shows one. What a body can be is known all the
//! same: its moment of inertia is at least that of its centroid's mass, and no material is denser
//! than osmium.
//!
//! Limits: relations in which two quantities are wrong name each of them by itself.

use std::collections::BTreeMap;

use nalgebra::DVector;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::judgement::{CHANCE, Coefficients};
use crate::rig::{GRAVITY, Rig};
use crate::system::library::Pendulum;
use crate::warning::Warning;
use crate::wording::format::{quantity, significant};

/// Warning where something that is said to be known does not agree with the record.
pub const CONTRADICTED: &str = "known-contradicted";
/// Density of the densest element, osmium, kg/m³.
const DENSEST: f64 = 22_590.0;
/// Length of a body along its axis, in radii, beyond which none is built that swings across it.
const LONGEST: f64 = 10.0;

/// Quantities that are not told as wrong: gravity is the last to be, and a product stands beside
/// its factors.
const HELD: [&str; 2] = ["g", "m2 l1"];

/// A quantity in a relation: name, unit, power.
type Power = (&'static str, &'static str, f64);

/// A relation that is 1 for the true quantities: Π q^n Π b^n Ω^(2 n).
struct Relation {
    quantities: &'static [Power],
    coefficients: &'static [(&'static str, f64)],
    /// Power of Ω².
    omega: f64,
    /// Whether it only may not be less than 1.
    at_least: bool,
}

const DOUBLE: &[Relation] = &[
    // l1 B22 Ω²/(g B21).
    Relation {
        quantities: &[("l1", "m", 1.0), ("g", "m/s²", -1.0)],
        coefficients: &[("B22", 1.0), ("B21", -1.0)],
        omega: 1.0,
        at_least: false,
    },
    // a B22 Ω²/(g B25).
    Relation {
        quantities: &[("a", "m", 1.0), ("g", "m/s²", -1.0)],
        coefficients: &[("B22", 1.0), ("B25", -1.0)],
        omega: 1.0,
        at_least: false,
    },
    // J_o2 B22 Ω²/(g m2 e2).
    Relation {
        quantities: &[("J_o2", "kg m²", 1.0), ("m2", "kg", -1.0), ("e2", "m", -1.0), ("g", "m/s²", -1.0)],
        coefficients: &[("B22", 1.0)],
        omega: 1.0,
        at_least: false,
    },
    // J_o1 B11/(m2 e2 l1).
    Relation {
        quantities: &[("J_o1", "kg m²", 1.0), ("m2", "kg", -1.0), ("e2", "m", -1.0), ("l1", "m", -1.0)],
        coefficients: &[("B11", 1.0)],
        omega: 0.0,
        at_least: false,
    },
    // J_o1 B11/(J_o2 B21).
    Relation {
        quantities: &[("J_o1", "kg m²", 1.0), ("J_o2", "kg m²", -1.0)],
        coefficients: &[("B11", 1.0), ("B21", -1.0)],
        omega: 0.0,
        at_least: false,
    },
    // (m1 e1 + m2 l1) g B11/(m2 e2 l1 B12 Ω²).
    Relation {
        quantities: &[("m1e1 + m2 l1", "kg m", 1.0), ("g", "m/s²", 1.0), ("e2", "m", -1.0), ("m2 l1", "kg m", -1.0)],
        coefficients: &[("B11", 1.0), ("B12", -1.0)],
        omega: -1.0,
        at_least: false,
    },
    // J_o2 = g m2 e2/(B22 Ω²) ≥ m2 e2².
    Relation {
        quantities: &[("g", "m/s²", 1.0), ("e2", "m", -1.0)],
        coefficients: &[("B22", -1.0)],
        omega: -1.0,
        at_least: true,
    },
    // J_o1 = m2 e2 l1/B11 ≥ m2 l1².
    Relation {
        quantities: &[("e2", "m", 1.0), ("l1", "m", -1.0)],
        coefficients: &[("B11", -1.0)],
        omega: 0.0,
        at_least: true,
    },
];

const SINGLE: &[Relation] = &[
    // J_o1 q_sin Ω²/(g m1e1).
    Relation {
        quantities: &[("J_o1", "kg m²", 1.0), ("m1e1", "kg m", -1.0), ("g", "m/s²", -1.0)],
        coefficients: &[("q_sin", 1.0)],
        omega: 1.0,
        at_least: false,
    },
    // J_o1 = g m1 e1/(q_sin Ω²) ≥ m1 e1².
    Relation {
        quantities: &[("g", "m/s²", 1.0), ("e1", "m", -1.0)],
        coefficients: &[("q_sin", -1.0)],
        omega: -1.0,
        at_least: true,
    },
];

/// A warning for every relation that the record contradicts. `spread`: by how much standard errors
/// are widened.
pub(super) fn contradicted(c: &Coefficients<'_>, rig: &Rig, spread: f64) -> Vec<Warning> {
    let mut known = rig.known.clone();
    known.entry("g".to_owned()).or_insert(GRAVITY);
    if let (Some(m), Some(e)) = (known.get("m1").copied(), known.get("e1").copied()) {
        known.entry("m1e1".to_owned()).or_insert(m * e);
    }
    if let (Some(m2), Some(l1)) = (known.get("m2").copied(), known.get("l1").copied()) {
        known.insert("m2 l1".to_owned(), m2 * l1);
        if let Some(first) = known.get("m1e1").copied() {
            known.insert("m1e1 + m2 l1".to_owned(), first + m2 * l1);
        }
    }
    let double = rig.pendulum() == Some(Pendulum::Double);
    let relations = if double { DOUBLE } else { SINGLE };
    let mut out: Vec<Warning> =
        relations.iter().filter_map(|r| r.contradiction(c, &known, rig.omega(), spread, rig.drive.is_some())).collect();
    let lever = if double { ["m2", "e2", "B22"] } else { ["m1", "e1", "q_sin"] };
    out.extend(too_dense(c, &known, rig.omega(), lever));
    out
}

/// A coefficient, or √(B_i3² + B_i4²), with its gradient.
pub(super) fn coefficient(c: &Coefficients<'_>, name: &str) -> Option<(f64, DVector<f64>)> {
    let mut gradient = DVector::zeros(c.values.len());
    if let Some((value, i)) = c.at(name) {
        gradient[i] = 1.0;
        return Some((value, gradient));
    }
    let row = name.strip_suffix('5')?;
    let ((x, i), (y, j)) = (c.at(&format!("{row}3"))?, c.at(&format!("{row}4"))?);
    let size = x.hypot(y);
    (gradient[i], gradient[j]) = (x / size, y / size);
    Some((size, gradient))
}

impl Relation {
    /// ln R and its standard error; none where a quantity is not known.
    fn logarithm(&self, c: &Coefficients<'_>, known: &BTreeMap<String, f64>, omega: f64) -> Option<(f64, f64)> {
        let mut sum = 2.0 * self.omega * omega.ln();
        for (name, _, power) in self.quantities {
            sum += power * known.get(*name)?.ln();
        }
        let mut gradient = DVector::zeros(c.values.len());
        for (name, power) in self.coefficients {
            let (value, slope) = coefficient(c, name)?;
            sum += power * value.ln();
            gradient += slope * (*power / value);
        }
        let error = c.variance(&gradient).sqrt();
        (sum.is_finite() && error.is_finite()).then_some((sum, error))
    }

    fn contradiction(
        &self,
        c: &Coefficients<'_>,
        known: &BTreeMap<String, f64>,
        omega: f64,
        spread: f64,
        driven: bool,
    ) -> Option<Warning> {
        let (missed, error) = self.logarithm(c, known, omega)?;
        if c.blocks < 3 || (self.at_least && missed >= 0.0) {
            return None;
        }
        let t = StudentsT::new(0.0, 1.0, (c.blocks - 1) as f64).ok()?;
        if 2.0 * t.sf(missed.abs() / (spread * error)) >= CHANCE {
            return None;
        }
        let agrees = |power: f64| (-missed / power).exp();
        let mut alternatives: Vec<String> = self
            .quantities
            .iter()
            .filter(|(name, ..)| !HELD.contains(name))
            .map(|(name, unit, power)| {
                let limit = match (self.at_least, *power > 0.0) {
                    (false, _) => "",
                    (true, true) => "at least ",
                    (true, false) => "at most ",
                };
                let [value, right] = named(known, name, agrees(*power));
                let name = name.split(' ').next().unwrap_or(name);
                format!("{name} = {limit}{} instead of {}", in_unit(right, unit), in_unit(value, unit))
            })
            .collect();
        // t measured κ times too long makes Ω² κ⁻² of what it is.
        let clock = (self.omega != 0.0 && !self.at_least).then(|| (-missed / (2.0 * self.omega)).exp());
        if let Some(factor) = clock {
            alternatives.push(time_base(factor, driven));
        }
        let said = self.quantities.iter().map(|q| q.0).filter(|n| !HELD.contains(n));
        let names: Vec<&str> = said.map(|n| n.split(' ').next().unwrap_or(n)).collect();
        let warning = Warning::new(
            CONTRADICTED,
            format!(
                "[known] {} {} with the record by {} %. One of these would agree: {}",
                names.join(", "),
                if names.len() == 1 { "disagrees" } else { "disagree" },
                significant(100.0 * missed.abs().exp_m1(), 2),
                alternatives.join("; or ")
            ),
            "Measure them again, check their units (metres, kilograms), and correct the rig file",
        )
        .invalidating();
        let values: serde_json::Map<String, serde_json::Value> = self
            .quantities
            .iter()
            .filter(|(name, ..)| !name.contains(' ') || name.contains('+'))
            .map(|(name, _, power)| {
                let [_, right] = named(known, name, agrees(*power));
                (name.split(' ').next().unwrap_or(name).to_owned(), right.into())
            })
            .chain(clock.map(|factor| ("time-base".to_owned(), factor.into())))
            .collect();
        Some(warning.with("would_agree", values))
    }
}

/// A clock by which a time is so many times what it was, and with it every rate its inverse.
pub(super) fn time_base(factor: f64, driven: bool) -> String {
    let rate = format!(" (or the drive's frequency by {})", significant(1.0 / factor, 4));
    let rate = if driven { rate.as_str() } else { "" };
    format!("the time base off by a factor of {}{rate}", significant(factor, 4))
}

/// Value of a quantity of a relation and the one that would agree, by a factor; of a sum its first
/// part, the other as it is known.
fn named(known: &BTreeMap<String, f64>, name: &str, factor: f64) -> [f64; 2] {
    let whole = known[name];
    match name.split_once(" + ") {
        Some((first, rest)) => [known[first], whole * factor - known[rest]],
        None => [whole, whole * factor],
    }
}

/// A value in its unit; at most four digits.
fn in_unit(value: f64, unit: &str) -> String {
    quantity(value, unit, 4)
}

/// A mass that no body so small can have: mass, lever, and the coefficient g S/(J Ω²) of an arm.
fn too_dense(
    c: &Coefficients<'_>,
    known: &BTreeMap<String, f64>,
    omega: f64,
    [mass, lever, gravity]: [&str; 3],
) -> Option<Warning> {
    let (m, e, g) = (*known.get(mass)?, *known.get(lever)?, *known.get("g")?);
    let (b, _) = c.at(gravity)?;
    // Radius of gyration about the centroid: J/m − e².
    let square = g * e / (b * omega * omega) - e * e;
    if !(square > 0.0 && m > 0.0) {
        return None;
    }
    // A cylinder of the densest metal, of this mass and radius of gyration.
    let radius = (2.0 * square).sqrt();
    let length = m / (core::f64::consts::PI * radius * radius * DENSEST);
    (length > LONGEST * radius).then(|| {
        Warning::new(
            CONTRADICTED,
            format!(
                "[known] {mass} = {} cannot swing as this record shows: about a radius of gyration of {} even a body of the densest metal would be {} thick",
                in_unit(m, "kg"),
                quantity(square.sqrt(), "m", 2),
                quantity(length, "m", 2)
            ),
            format!("Is {mass} in kilograms, {lever} in metres? Motion shows no mass by itself: weigh the arm and correct the rig file"),
        )
        .invalidating()
        .with("quantity", mass)
        .with("most", m * LONGEST * radius / length)
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::judgement::judge;
    use crate::identify::judgement::tests::identified;

    fn warned(known: &[(&str, f64)]) -> Vec<Warning> {
        let mut rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
        rig.known.extend(known.iter().map(|(n, v)| ((*n).to_owned(), *v)));
        let omega = rig.omega();
        // Gravity's coefficient that l1 = 63.5 mm asks for.
        let b22 = 9.81 * 1.68 / (0.0635 * omega * omega);
        let mut result = identified(&[
            ("B22", b22),
            ("B23", -0.110 * b22 / 0.0708),
            ("B24", 0.02 * b22 / 0.0708),
            ("C2", 0.0033 * 1.68 / 0.113),
        ]);
        judge(&mut result, &rig);
        result.warnings
    }

    #[test]
    fn what_is_known_is_held_against_gravity() {
        assert!(warned(&[]).is_empty(), "{:?}", warned(&[]));
        let two_per_cent = &warned(&[("l1", 0.0635 * 1.02)])[0];
        assert!(two_per_cent.invalidates && two_per_cent.id == "known-contradicted");
        assert!(two_per_cent.text.contains("63.50 mm"), "{}", two_per_cent.text);
        assert!((two_per_cent.details["would_agree"]["l1"].as_f64().unwrap() / 0.0635 - 1.0).abs() < 1e-9);
        assert!(warned(&[("l1", 63.5)])[0].text.contains("l1 = 63.50 mm instead of 63.50 m"));
        // B12 = 0.0708, B11 = 0.113: m1 e1 = m2 (e2 l1 B12 Ω²/(B11 g) − l1) = 4.3 g m.
        let right =
            0.04 * (0.0267 * 0.0635 * 0.0708 * (10.0 * core::f64::consts::PI).powi(2) / (0.113 * 9.81) - 0.0635);
        assert!(warned(&[("m1e1", right)]).is_empty(), "{:?}", warned(&[("m1e1", right)]));
        let heavy = &warned(&[("m1", 136.2), ("e1", 0.0127)])[0];
        assert!((heavy.details["would_agree"]["m1e1"].as_f64().unwrap() / right - 1.0).abs() < 1e-6, "{}", heavy.text);
        // Half a per mille is within what the coefficients are known to.
        assert!(warned(&[("l1", 0.0635 * 1.0005)]).is_empty());
        // Rates that are 1.6 times too high are 2.56 times in the length.
        assert!(warned(&[("l1", 0.0635 * 2.56)])[0].text.contains("factor of 0.625"));
    }

    #[test]
    fn bodies_must_be_possible() {
        let mass = &warned(&[("m2", 40.0)])[0];
        assert!(mass.text.contains("m2 = 40") && mass.invalidates, "{}", mass.text);
        assert!(warned(&[("m2", 0.08)]).is_empty());
        let lever = warned(&[("e2", 26.7)]);
        assert!(lever.iter().any(|w| w.text.contains("e2 = at most")), "{lever:?}");
    }
}

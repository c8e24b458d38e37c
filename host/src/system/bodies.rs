//! `[[body]]`: rigid bodies, their kinetic energy and their potential in gravity.
//!
//! An arm runs straight from a point O along the unit vector u (`angle` φ: u = \[sin φ, −cos φ\];
//! or `direction` in space); with mass m, first moment S = m e and inertia J about O: T = ½ m
//! v_O² + S v_O·u̇ + ½ J u̇·u̇, V = −g·(m O + S u). Any other body has T = ½ m v_C² + ½ J φ̇² with
//! its centroid C as a point and J about it, V = −m g·C.

use toml::de::DeTable;

use super::derivative::{NoDerivative, by_time};
use super::language::{Gravity, Placed, Reader};
use super::polynomial::{Atom, Polynomial};
use super::words::{Scope, Value as Word};
use crate::error::Result;
use crate::model::model_file::expression::Function;

/// A body.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// A straight arm.
    Arm {
        /// Name.
        name: String,
        /// The angle at which it hangs, where it turns in a plane.
        angle: Option<Polynomial>,
        /// Its end O.
        from: Vec<Polynomial>,
        /// Unit vector along it.
        along: Vec<Polynomial>,
        /// Mass.
        mass: Polynomial,
        /// Mass times distance of the centroid from the end.
        first_moment: Polynomial,
        /// Inertia about the end.
        inertia: Polynomial,
    },
    /// A body by its centroid.
    Free {
        /// Name.
        name: String,
        /// Centroid, where mass is.
        centroid: Option<Vec<Polynomial>>,
        /// Mass.
        mass: Polynomial,
        /// Angle and inertia about the centroid, where it turns.
        turns: Option<(Polynomial, Polynomial)>,
    },
}

impl Body {
    /// The angle by which it turns in the plane, where it does.
    pub fn angle(&self) -> Option<&Polynomial> {
        match self {
            Self::Arm { angle, .. } => angle.as_ref(),
            Self::Free { turns, .. } => turns.as_ref().map(|(angle, _)| angle),
        }
    }
}

/// Reads the bodies.
///
/// # Errors
/// Keys that are missing, unknown or do not go together.
pub fn read(r: &Reader<'_>, top: &DeTable<'_>) -> Result<Vec<Placed<Body>>> {
    let (mut out, mut names): (Vec<Placed<Body>>, Vec<String>) = (Vec::new(), Vec::new());
    let written = top.get("equation").is_some();
    for (table, at) in r.tables(top, "body")? {
        let known = ["name", "from", "angle", "direction", "mass", "centroid", "first_moment", "inertia"];
        r.source.known_keys(table, &known, "a body")?;
        let taken: Vec<&str> = names.iter().map(String::as_str).collect();
        let name = r.own_name(table, at, &taken)?;
        names.push(name.clone());
        let value =
            if table.get("from").is_some() { arm(r, table, at, name)? } else { free(r, table, at, name, written)? };
        out.push(Placed { value, at });
    }
    Ok(out)
}

fn scalar(r: &Reader<'_>, table: &DeTable<'_>, key: &str) -> Result<Option<Polynomial>> {
    let Some(v) = table.get(key) else { return Ok(None) };
    let value = r.scalar(v, Scope::Motion)?;
    let unit = match key {
        "mass" => "kg",
        "inertia" => "kg m^2",
        "first_moment" => "kg m",
        "centroid" => "m",
        _ => "1",
    };
    r.counted_in(v, &format!("the {key}"), unit)?;
    Ok(Some(value))
}

fn arm(r: &Reader<'_>, table: &DeTable<'_>, at: usize, name: String) -> Result<Body> {
    let bad = |key: &str, found: &str, expected: &str, remedy: &str| {
        let at = table.get(key).map_or(at, |v| v.span().start);
        Err(r.source.bad(at, found, expected).remedy(remedy))
    };
    let from = r.source.required(table, at..at, "from", "a point")?;
    r.counted_in(from, "the point", "m")?;
    let from = r.vector(from)?;
    let mut turned = None;
    let along = match (table.get("angle"), table.get("direction")) {
        (Some(_), None) => {
            let angle = scalar(r, table, "angle")?.unwrap_or_default();
            if from.len() != 2 {
                return bad(
                    "angle",
                    "an angle in space",
                    "direction",
                    "An angle is in a plane: write a unit vector as direction",
                );
            }
            if angle.has_parameter() {
                return bad(
                    "angle",
                    "a parameter in an angle",
                    "coordinates and constants",
                    "Give the parameter its number under constants",
                );
            }
            turned = Some(angle.clone());
            vec![Polynomial::call(Function::Sin, angle.clone()), Polynomial::call(Function::Cos, angle).scaled(-1.0)]
        }
        (None, Some(v)) => {
            let direction = r.vector(v)?;
            r.counted_in(v, "the direction", "1")?;
            direction
        }
        (Some(_), Some(_)) => return bad("direction", "an angle and a direction", "one of them", "Remove one"),
        (None, None) => {
            return bad(
                "from",
                "an arm without a direction",
                "angle = \"phi\", or direction = \"[…]\"",
                "Say where the arm points",
            );
        }
    };
    let mass = scalar(r, table, "mass")?;
    let first_moment = match (scalar(r, table, "centroid")?, scalar(r, table, "first_moment")?, &mass) {
        (Some(_), Some(_), _) => return bad("first_moment", "centroid and first_moment", "one of them", "Remove one"),
        (Some(e), None, Some(m)) => m.times(&e).unwrap_or_default(),
        (Some(_), None, None) => {
            return bad("centroid", "a centroid without a mass", "mass, or first_moment alone", "Add mass");
        }
        (None, Some(s), _) => s,
        (None, None, _) => Polynomial::default(),
    };
    let Some(inertia) = scalar(r, table, "inertia")? else {
        return bad(
            "from",
            "an arm without inertia",
            "inertia about its end `from`",
            "Add inertia, \"m*e^2\" for a point mass",
        );
    };
    Ok(Body::Arm { name, angle: turned, from, along, mass: mass.unwrap_or_default(), first_moment, inertia })
}

fn free(r: &Reader<'_>, table: &DeTable<'_>, at: usize, name: String, written: bool) -> Result<Body> {
    let bad = |key: &str, found: &str, expected: &str, remedy: &str| {
        let at = table.get(key).map_or(at, |v| v.span().start);
        Err(r.source.bad(at, found, expected).remedy(remedy))
    };
    for key in ["direction", "first_moment"] {
        if table.get(key).is_some() {
            return bad(key, &format!("{key} without from"), "from, the point where the arm begins", "Add from");
        }
    }
    let centroid = match table.get("centroid") {
        None => None,
        Some(v) => match r.value(v, Scope::Motion)? {
            Word::Vector(_) => {
                r.counted_in(v, "the centroid", "m")?;
                Some(r.vector(v)?)
            }
            Word::Scalar(_) => {
                return bad(
                    "centroid",
                    "a distance without from",
                    "a point, or from with the distance",
                    "Add from, or name a point",
                );
            }
        },
    };
    let mass = scalar(r, table, "mass")?;
    let turns = match (scalar(r, table, "angle")?, scalar(r, table, "inertia")?) {
        (Some(angle), Some(inertia)) => Some((angle, inertia)),
        (None, None) => None,
        // Beside written equations a body may be a name for an angle: a place of effects.
        (Some(angle), None) if written => Some((angle, Polynomial::default())),
        (Some(_), None) => {
            return bad("angle", "an angle without inertia", "both or none", "Add inertia about the centroid");
        }
        (None, Some(_)) => return bad("inertia", "an inertia without angle", "both or none", "Add angle"),
    };
    match (&mass, &centroid) {
        (Some(_), None) => return bad("mass", "a mass without centroid", "centroid, a point", "Say where the mass is"),
        (None, Some(_)) => return bad("centroid", "a centroid without mass", "mass", "Add mass"),
        (None, None) if turns.is_none() => {
            return bad(
                "name",
                "a body without mass and inertia",
                "mass with centroid, or inertia with angle",
                "Add them",
            );
        }
        _ => {}
    }
    Ok(Body::Free { name, centroid, mass: mass.unwrap_or_default(), turns })
}

fn dot(a: &[Polynomial], b: &[Polynomial]) -> core::result::Result<Polynomial, NoDerivative> {
    let mut sum = Polynomial::default();
    for (x, y) in a.iter().zip(b) {
        sum = sum.plus(&x.times(y)?);
    }
    Ok(sum)
}

impl Body {
    /// Kinetic and potential energy; `g` is the parameter of gravity's strength.
    ///
    /// # Errors
    /// A motion that jumps, or one by a measured input.
    pub fn energies(
        &self,
        coordinates: usize,
        omega: f64,
        gravity: Option<&Gravity>,
        g: &Polynomial,
    ) -> core::result::Result<(Polynomial, Polynomial), NoDerivative> {
        let velocity = |v: &[Polynomial]| -> core::result::Result<Vec<Polynomial>, NoDerivative> {
            v.iter().map(|x| by_time(x, coordinates, omega)).collect()
        };
        let pull = |n: usize| match gravity {
            None => vec![Polynomial::default(); n],
            Some(Gravity::Along(v)) => v.clone(),
            Some(Gravity::Down) => {
                (0..n).map(|i| if i + 1 == n { g.scaled(-1.0) } else { Polynomial::default() }).collect()
            }
        };
        match self {
            Self::Arm { from, along, mass, first_moment, inertia, .. } => {
                let (v, turn) = (velocity(from)?, velocity(along)?);
                let kinetic = mass
                    .times(&dot(&v, &v)?.scaled(0.5))?
                    .plus(&first_moment.times(&dot(&v, &turn)?)?)
                    .plus(&inertia.times(&dot(&turn, &turn)?.scaled(0.5))?);
                let pull = pull(from.len());
                let potential = mass.times(&dot(from, &pull)?)?.plus(&first_moment.times(&dot(along, &pull)?)?);
                Ok((kinetic, potential.scaled(-1.0)))
            }
            Self::Free { centroid, mass, turns, .. } => {
                let (mut kinetic, mut potential) = (Polynomial::default(), Polynomial::default());
                if let Some(c) = centroid {
                    let v = velocity(c)?;
                    kinetic = mass.times(&dot(&v, &v)?.scaled(0.5))?;
                    potential = mass.times(&dot(c, &pull(c.len()))?)?.scaled(-1.0);
                }
                if let Some((angle, inertia)) = turns {
                    let rate = by_time(angle, coordinates, omega)?;
                    kinetic = kinetic.plus(&inertia.times(&rate.times(&rate)?.scaled(0.5))?);
                }
                Ok((kinetic, potential))
            }
        }
    }

    /// Whether a parameter takes part in it.
    pub fn uses(&self, k: usize) -> bool {
        let has = |p: &Polynomial| p.any(&|a| *a == Atom::Parameter(k));
        match self {
            Self::Arm { from, along, mass, first_moment, inertia, .. } => {
                from.iter().chain(along).any(has) || has(mass) || has(first_moment) || has(inertia)
            }
            Self::Free { centroid, mass, turns, .. } => {
                centroid.iter().flatten().any(has) || has(mass) || turns.as_ref().is_some_and(|(a, j)| has(a) || has(j))
            }
        }
    }
}

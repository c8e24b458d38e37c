//! `[[joint]]`, and the nominal effects at joints: a torque T there adds T ∂moves/∂q_e to equation
//! e.
//!
//! viscous-friction −c v, coulomb-friction −τ_c sign v, constant-force Q, with v the rate of
//! `moves`. Each has one strength, a parameter of the system named `ID@JOINT`.

use toml::de::DeTable;

use super::derivative::{NoDerivative, by_time};
use super::language::{Placed, Reader, SystemFile};
use super::polynomial::Polynomial;
use super::reactions::Carried;
use super::words::Scope;
use crate::error::Result;
use crate::model::model_file::expression::{Function, Symbol};
use crate::model::model_file::units::Unit;

/// Effects that a nominal model may have: id, and the unit of its strength over that of a force
/// along the joint's motion.
pub const EFFECTS: [(&str, &str); 3] = [("viscous-friction", "s"), ("coulomb-friction", "1"), ("constant-force", "1")];

/// A joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// The point where it is.
    pub at: Option<String>,
    /// The coordinate across it.
    pub moves: Placed<Polynomial>,
    /// The bodies that hang on it; see [`super::reactions`].
    pub carries: Vec<Carried>,
}

/// Reads the joints.
///
/// # Errors
/// Keys that are missing or unknown, a point that there is not, a joint that nothing moves.
pub fn read(r: &Reader<'_>, top: &DeTable<'_>) -> Result<Vec<Joint>> {
    let mut out: Vec<Joint> = Vec::new();
    for (table, start) in r.tables(top, "joint")? {
        r.source.known_keys(table, &["name", "moves", "at"], "a joint")?;
        let taken: Vec<&str> = out.iter().map(|j| j.name.as_str()).collect();
        let name = r.own_name(table, start, &taken)?;
        let v = r.source.required(table, start..start, "moves", "the coordinate across it, such as \"phi2 - phi1\"")?;
        let moves = r.scalar(v, Scope::Motion)?;
        if moves.has_parameter() || !moves.moves(|s| matches!(s, Symbol::Coordinate(_))) {
            return Err(r
                .source
                .bad(
                    v.span().start,
                    format!("a joint that moves {}", crate::model::model_file::toml_place::described(v.get_ref())),
                    "coordinates, without parameters",
                )
                .remedy("A gear's ratio is a number under constants"));
        }
        let at = match table.get("at") {
            None => None,
            Some(p) => {
                let text = r.source.text(p, "the name of a point")?;
                if !r.words.points.iter().any(|(n, _)| n == text) {
                    let known: Vec<&str> = r.words.points.iter().map(|p| p.0.as_str()).collect();
                    return Err(r
                        .source
                        .bad(p.span().start, format!("the point \"{text}\""), format!("one of {}", known.join(", ")))
                        .remedy("Name a point under points"));
                }
                Some(text.to_owned())
            }
        };
        out.push(Joint { name, at, moves: Placed { value: moves, at: r.source.inside(v, 0) }, carries: Vec::new() });
    }
    Ok(out)
}

/// A nominal effect at its joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Nominal {
    /// Name of its strength, `ID@JOINT`.
    pub name: String,
    /// Which of [`EFFECTS`].
    effect: usize,
    /// Which joint.
    joint: usize,
}

impl Nominal {
    /// Finds `ID@JOINT`; what was found and expected otherwise.
    ///
    /// # Errors
    /// An effect or a joint that there is not.
    pub fn find(file: &SystemFile, text: &str) -> core::result::Result<Self, (String, String)> {
        let ids: Vec<&str> = EFFECTS.iter().map(|e| e.0).collect();
        let joints: Vec<&str> = file.joints.iter().map(|j| j.name.as_str()).collect();
        let (id, place) = text
            .split_once('@')
            .ok_or_else(|| (format!("\"{text}\""), "ID@JOINT, such as \"viscous-friction@pivot\"".to_owned()))?;
        let effect = EFFECTS.iter().position(|e| e.0 == id).ok_or_else(|| {
            (format!("the nominal effect \"{id}\""), format!("one of {}, at a joint", ids.join(", ")))
        })?;
        let joint = joints.iter().position(|j| *j == place).ok_or_else(|| {
            let expected = if joints.is_empty() {
                "a [[joint]] of this name".to_owned()
            } else {
                format!("one of {}", joints.join(", "))
            };
            (format!("the joint \"{place}\""), expected)
        })?;
        Ok(Self { name: text.to_owned(), effect, joint })
    }

    /// What it multiplies: torque or force over its strength.
    ///
    /// # Errors
    /// A joint whose motion has no rate.
    pub fn column(&self, file: &SystemFile, omega: f64) -> core::result::Result<Polynomial, NoDerivative> {
        let rate = by_time(&file.joints[self.joint].moves.value, file.coordinates.len(), omega)?;
        Ok(match EFFECTS[self.effect].0 {
            "viscous-friction" => rate.scaled(-1.0),
            "coulomb-friction" => Polynomial::call(Function::Sign, rate).scaled(-1.0),
            _ => Polynomial::number(1.0),
        })
    }

    /// The displacement that it works along, and where that stands.
    pub fn moves<'a>(&self, file: &'a SystemFile) -> &'a Placed<Polynomial> {
        &file.joints[self.joint].moves
    }

    /// Unit of its strength.
    pub fn unit(&self, file: &SystemFile) -> Unit {
        let moves = &self.moves(file).value;
        let slides =
            (0..file.coordinates.len()).any(|k| !file.counts_radians(k) && moves.moves(|s| s == Symbol::Coordinate(k)));
        let text = match (slides, EFFECTS[self.effect].1) {
            (false, "s") => "N m s",
            (false, _) => "N m",
            (true, "s") => "N s/m",
            (true, _) => "N",
        };
        Unit::parse(text).unwrap_or_default()
    }
}

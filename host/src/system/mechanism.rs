//! What a model file's coefficients are made of, where it was derived from a system file: each is
//! N(p)/D(p), sums of products of the parameters p over those of the equation's own inertia; and
//! the quantities that are reported of p.

use std::collections::BTreeMap;
use std::sync::Arc;

use toml::de::DeTable;

use super::language::{Parameter, Placed, Reader, SystemFile};
use super::polynomial::{Atom, Polynomial};
use super::sensors::Sensor;
use super::words::Scope;
use crate::error::Result;
use crate::model::model_file::units::Unit;

/// A coefficient.
#[derive(Clone, Debug, PartialEq)]
pub struct Coefficient {
    /// Its name in the model file.
    pub name: String,
    /// N.
    pub numerator: Polynomial,
    /// D.
    pub denominator: Polynomial,
}

/// A quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Name.
    pub name: String,
    /// Its value by the parameters.
    pub value: Polynomial,
    /// Unit, printed.
    pub unit: Unit,
}

/// A parameter's name and unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Name; `ID@JOINT` for the strength of a nominal effect.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Whether it is positive by its nature: a mass, an inertia, gravity.
    pub positive: bool,
}

/// A system's parameters behind its coefficients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mechanism {
    /// Parameters of the file, then strengths of nominal effects.
    pub parameters: Vec<Named>,
    /// Coefficients of the derived equations; those of written equations are not among them.
    pub coefficients: Vec<Coefficient>,
    /// Quantities.
    pub quantities: Vec<Quantity>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// The coordinate of each derived equation and what it was divided by: its inertia.
    pub scales: Vec<(usize, Polynomial)>,
    /// What the equations were derived from.
    pub file: Option<Arc<SystemFile>>,
    /// Whether the file itself names g, so that it is known only if the rig file says so.
    pub own_gravity: bool,
    /// Pairs of coordinates of written equations, the ratio of whose inertias these leave open.
    pub apart: Vec<(usize, usize)>,
}

impl Mechanism {
    /// Names that the rig file's `[known]` may hold.
    pub fn known_names(&self) -> Vec<&str> {
        self.parameters.iter().map(|p| p.name.as_str()).chain(self.quantities.iter().map(|q| q.name.as_str())).collect()
    }

    /// Parameters that take part in the equations.
    pub fn takes_part(&self, k: usize) -> bool {
        let has = |p: &Polynomial| p.any(&|a| *a == Atom::Parameter(k));
        self.coefficients.iter().any(|c| has(&c.numerator) || has(&c.denominator))
    }

    /// A coefficient's value.
    pub fn value(&self, coefficient: &str, parameters: &[f64]) -> Option<f64> {
        let c = self.coefficients.iter().find(|c| c.name == coefficient)?;
        Some(at(&c.numerator, parameters) / at(&c.denominator, parameters))
    }

    /// What is known of a rig: its `[known]`, with g only where it was said or the file does not
    /// name it as a parameter.
    pub fn known<'a>(&self, known: &'a BTreeMap<String, f64>, said: bool) -> BTreeMap<&'a str, f64> {
        known.iter().filter(|(k, _)| *k != "g" || said || !self.own_gravity).map(|(k, v)| (k.as_str(), *v)).collect()
    }
}

/// Value of a sum of products of parameters.
pub fn at(p: &Polynomial, parameters: &[f64]) -> f64 {
    p.value(&|a| match a {
        Atom::Parameter(k) => parameters.get(*k).copied().unwrap_or(f64::NAN),
        _ => f64::NAN,
    })
}

/// Reads `[quantities]`.
///
/// # Errors
/// A name that is taken, an expression of something else than parameters.
pub fn quantities(r: &Reader<'_>, top: &DeTable<'_>) -> Result<Vec<Quantity>> {
    let mut out: Vec<Quantity> = Vec::new();
    for (name, at, value) in r.table(top, "quantities", "[quantities] with mass = \"M + m\"")? {
        r.new_name(at, name)?;
        let p = r.scalar(value, Scope::Parameters)?;
        if !p.has_parameter() {
            return Err(r
                .source
                .bad(value.span().start, format!("the quantity {name}, which is a number"), "parameters in it")
                .remedy("Declare numbers under constants"));
        }
        let unit = r.measured(value, Scope::Parameters)?.into_iter().next().map(|m| m.unit).unwrap_or_default();
        out.push(Quantity { name: name.to_owned(), unit, value: p });
    }
    Ok(out)
}

/// A declared parameter that nothing uses.
pub fn unused(parameters: &[Parameter], uses: impl Fn(usize) -> bool) -> Option<Placed<&str>> {
    parameters
        .iter()
        .enumerate()
        .find(|(k, p)| p.declared.is_some() && !uses(*k))
        .map(|(_, p)| Placed { value: p.name.as_str(), at: p.declared.unwrap_or(0) })
}

//! Effects that change how bodies move or what gravity does to them: terms in several equations, how
//! much of each being products of parameters. Where identification leaves these open, one of them is
//! a shape of the effect: its value tells the others.

use super::columns::{Law, Part};
use crate::system::mechanism::{Mechanism, at};
use crate::system::polynomial::Polynomial;

/// How much each part adds beside the first of its strength: quotients N/D of parameters.
pub fn ratios(parts: &[Part], mechanism: &Mechanism) -> Vec<(Polynomial, Polynomial)> {
    let of = |p: &Part| Some((Polynomial::product(p.product.clone(), 1.0), &mechanism.scales.get(p.equation)?.1));
    let beside = |p: &Part| {
        let (first, own) = (of(parts.iter().find(|q| q.strength == p.strength)?)?, of(p)?);
        Some((own.0.times(first.1).ok()?, own.1.times(&first.0).ok()?))
    };
    parts.iter().filter_map(beside).collect()
}

/// Parts at values of the parameters, which they keep.
pub fn at_values(parts: &[Part], mechanism: &Mechanism, values: &[f64]) -> Vec<Part> {
    let given = |p: &Part| {
        let (_, inertia) = mechanism.scales.get(p.equation)?;
        let factor = at(&Polynomial::product(p.product.clone(), 1.0), values) / at(inertia, values);
        Some(Part { of: Law::Given(factor, p.of.at(values)), ..p.clone() })
    };
    parts.iter().filter_map(given).collect()
}

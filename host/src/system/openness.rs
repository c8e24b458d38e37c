//! Which functions of a system's parameters coefficients and what is known fix, and which stay
//! open.

use nalgebra::{DMatrix, DVector};

use super::open_directions::is_open;
use super::polynomial::{Atom, Polynomial};
use super::row::Row;

/// What a fit of the parameters leaves open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Openness {
    /// Parameters that were sought.
    pub(super) free: Vec<usize>,
    /// Parameters that were neither sought nor known: nothing depends on them.
    pub(super) never: Vec<usize>,
    /// Directions of the sought ones that nothing fixes, in unknowns whose columns have unit norm.
    pub(super) directions: DMatrix<f64>,
    /// What a step of such an unknown is of each sought parameter.
    pub(super) stretches: Vec<f64>,
    /// All parameters.
    pub(super) parameters: Vec<f64>,
}

impl Openness {
    /// Whether N/D, sums of products of parameters, is left open.
    pub fn is_open(&self, numerator: &Polynomial, denominator: &Polynomial) -> bool {
        let never = |a: &Atom| matches!(a, Atom::Parameter(k) if self.never.contains(k));
        if numerator.any(&never) || denominator.any(&never) {
            return true;
        }
        let Some(row) = Row::new(numerator, denominator, &self.free) else { return true };
        let gradient = row.gradient(&self.parameters);
        let scaled = gradient.iter().zip(&self.stretches).map(|(x, s)| x * s);
        is_open(&self.directions, &DVector::from_iterator(gradient.len(), scaled))
    }
}

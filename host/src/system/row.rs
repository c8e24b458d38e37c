//! A coefficient or a quantity as a function of the parameters that are sought.

use super::derivative::partial;
use super::mechanism::at;
use super::polynomial::{Atom, Polynomial};

/// A function of the parameters with its derivatives by the free ones.
pub(super) struct Row {
    numerator: Polynomial,
    denominator: Polynomial,
    slopes: Vec<(Polynomial, Polynomial)>,
}

impl Row {
    pub(super) fn new(numerator: &Polynomial, denominator: &Polynomial, free: &[usize]) -> Option<Self> {
        let slope = |k: &usize| {
            let by = Atom::Parameter(*k);
            Some((partial(numerator, &by).ok()?, partial(denominator, &by).ok()?))
        };
        Some(Self {
            numerator: numerator.clone(),
            denominator: denominator.clone(),
            slopes: free.iter().map(slope).collect::<Option<_>>()?,
        })
    }

    pub(super) fn value(&self, p: &[f64]) -> f64 {
        at(&self.numerator, p) / at(&self.denominator, p)
    }

    pub(super) fn gradient(&self, p: &[f64]) -> Vec<f64> {
        let (n, d) = (at(&self.numerator, p), at(&self.denominator, p));
        self.slopes.iter().map(|(a, b)| (at(a, p) * d - n * at(b, p)) / (d * d)).collect()
    }
}

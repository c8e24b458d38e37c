//! Which products of parameters a record can tell apart: columns of an equation at random states,
//! by a rank-revealing QR.
//!
//! A column that is a sum of earlier ones joins its product to theirs (M. Gautier, "Numerical
//! calculation of the base inertial parameters of robots", J. Robotic Systems 8, 1991). Columns are
//! taken in an order of preference and not by size, so that the coefficients stay readable:
//! modified Gram–Schmidt, twice ("twice is enough", Parlett 1980). Accelerations are states of
//! their own here, so that Lagrangians that differ by a total derivative give the same columns, and
//! no identity between sines has to be known.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::lagrange::Column;
use super::polynomial::{Atom, Polynomial, Product};
use crate::model::model_file::expression::Symbol;

/// Share of a column's norm below which what is left of it is rounding: conditions of these columns
/// are below 1e4.
const DEPENDENT: f64 = 1e-9;
/// Seed of the random states.
const SEED: u64 = 1991;

/// A coefficient of an equation: the products that share one expression.
#[derive(Clone, Debug, PartialEq)]
pub struct Base {
    /// The product whose expression it keeps.
    pub product: Product,
    /// Σ factor × product, its own included.
    pub sum: Polynomial,
    /// Expression of the motion.
    pub of: Polynomial,
}

/// A random state: values of the motion's symbols.
fn state(random: &mut ChaCha8Rng, symbols: &[Symbol]) -> Vec<f64> {
    symbols
        .iter()
        .map(|s| {
            let x: f64 = random.random_range(-1.0..1.0);
            match s {
                Symbol::Rate(_) | Symbol::Acceleration(_) | Symbol::InputRate(_) => 5.0 * x,
                _ => 3.0 * x,
            }
        })
        .collect()
}

/// Symbols of the motion in some columns, each once.
fn symbols(columns: &[Column]) -> Vec<Symbol> {
    let mut out = std::collections::BTreeSet::new();
    for c in columns {
        let seen = core::cell::RefCell::new(&mut out);
        c.of.any(&|a| {
            if let Atom::Motion(s) = a {
                seen.borrow_mut().insert(*s);
            }
            false
        });
    }
    out.into_iter().collect()
}

/// A number that is a simple fraction but for rounding.
fn clean(x: f64) -> f64 {
    let fraction = (x * 720.0).round() / 720.0;
    if (x - fraction).abs() < 1e-9 * (1.0 + x.abs()) { fraction } else { x }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Columns collected to coefficients; `columns` in the order in which they are preferred.
pub fn collect(columns: &[Column]) -> Vec<Base> {
    let symbols = symbols(columns);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let states: Vec<Vec<f64>> = (0..60 + 4 * columns.len()).map(|_| state(&mut random, &symbols)).collect();
    let values = |p: &Polynomial| -> Vec<f64> {
        states
            .iter()
            .map(|x| {
                p.value(&|a| match a {
                    Atom::Motion(s) => symbols.binary_search(s).map_or(0.0, |i| x[i]),
                    _ => 0.0,
                })
            })
            .collect()
    };
    let (mut kept, mut orthogonal, mut triangle): (Vec<Base>, Vec<Vec<f64>>, Vec<Vec<f64>>) = Default::default();
    for c in columns {
        let mut left = values(&c.of);
        let norm = dot(&left, &left).sqrt();
        if !norm.is_finite() || norm == 0.0 {
            // Nothing can be told of it here; the equation's own checks will.
            if norm != 0.0 {
                kept.push(Base {
                    product: c.product.clone(),
                    sum: Polynomial::product(c.product.clone(), 1.0),
                    of: c.of.clone(),
                });
                orthogonal.push(vec![0.0; states.len()]);
                triangle.push(unit(triangle.len()));
            }
            continue;
        }
        let mut along = vec![0.0; orthogonal.len()];
        for _ in 0..2 {
            for (h, q) in along.iter_mut().zip(&orthogonal) {
                let share = dot(&left, q);
                *h += share;
                left.iter_mut().zip(q).for_each(|(x, y)| *x -= share * y);
            }
        }
        let rest = dot(&left, &left).sqrt();
        if rest > DEPENDENT * norm {
            left.iter_mut().for_each(|x| *x /= rest);
            along.push(rest);
            orthogonal.push(left);
            triangle.push(along);
            let sum = Polynomial::product(c.product.clone(), 1.0);
            kept.push(Base { product: c.product.clone(), sum, of: c.of.clone() });
            continue;
        }
        // R x = Qᵀ a, from the last row up.
        for k in (0..along.len()).rev() {
            let x = along[k] / triangle[k][k];
            (0..k).for_each(|j| along[j] -= x * triangle[k][j]);
            if x.abs() > 1e-8 {
                kept[k].sum = kept[k].sum.plus(&Polynomial::product(c.product.clone(), clean(x)));
            }
        }
    }
    kept
}

/// A column of a triangle with a one at its end.
fn unit(before: usize) -> Vec<f64> {
    let mut out = vec![0.0; before];
    out.push(1.0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::model_file::expression::Function;

    /// a sin q + b cos q + c (2 sin q − 3 cos q): c joins both; d sin(q + 1) as well, whatever
    /// identity that is.
    #[test]
    fn dependent_columns_join() {
        let q = || Polynomial::motion(Symbol::Coordinate(0));
        let (sin, cos) = (Polynomial::call(Function::Sin, q()), Polynomial::call(Function::Cos, q()));
        let column = |k: usize, of: Polynomial| Column {
            product: vec![(Atom::Parameter(k), 1)],
            of,
            inertia: Polynomial::default(),
        };
        let shifted = Polynomial::call(Function::Sin, q().plus(&Polynomial::number(1.0)));
        let base = collect(&[
            column(0, sin.clone()),
            column(1, cos.clone()),
            column(2, sin.scaled(2.0).minus(&cos.scaled(3.0))),
            column(3, shifted),
            column(4, Polynomial::motion(Symbol::Rate(0))),
        ]);
        assert_eq!(base.len(), 3);
        let at = |a: &Atom| if let Atom::Parameter(k) = a { [1.0, 10.0, 100.0, 1000.0, 0.0][*k] } else { 0.0 };
        assert!((base[0].sum.value(&at) - (1.0 + 200.0 + 1000.0 * 1.0_f64.cos())).abs() < 1e-9);
        assert!((base[1].sum.value(&at) - (10.0 - 300.0 + 1000.0 * 1.0_f64.sin())).abs() < 1e-9);
        assert_eq!(base[0].sum.size(), 3);
    }
}

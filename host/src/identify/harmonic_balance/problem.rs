//! The least-squares problem of all orbits: known and unknown coefficients, fits, energy balance,
//! covariances.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Unsolvable;
use super::equations::{Equations, Term};
use super::orbit::Orbit;
use super::rows::{self, Expanded, Rows};
use super::settings::Settings;
use super::solve::{self, EquationFit};
use crate::identify::energy_balance;
use crate::identify::jackknife::widening;

/// Most blocks of the jackknife.
const MOST_BLOCKS: usize = 100;

/// Moves known columns of an orbit's rows to the target.
fn move_known(rows: &Rows, known: &[Option<f64>]) -> Rows {
    let p = rows.columns;
    let mut out =
        Rows { ids: rows.ids.clone(), values: Vec::new(), columns: known.iter().filter(|k| k.is_none()).count() };
    for r in 0..rows.len() {
        let row = rows.row(r);
        out.values.extend((0..p).filter(|j| known[*j].is_none()).map(|j| row[j]));
        out.values.push(row[p] - (0..p).filter_map(|j| Some(known[j]? * row[j])).sum::<f64>());
    }
    out
}

/// A coefficient that is sought: a term of an equation.
#[derive(Clone, Copy)]
pub struct Unknown {
    pub equation: usize,
    pub term: usize,
}

/// The coefficients of the equations: those that are known, and the unknown ones in the order in
/// which they are solved for.
pub struct Unknowns<'a> {
    pub equations: &'a Equations,
    /// Values of those that are known, equation by equation.
    pub known: Vec<Vec<Option<f64>>>,
    pub list: Vec<Unknown>,
}

impl<'a> Unknowns<'a> {
    pub fn new(equations: &'a Equations, settings: &Settings) -> Self {
        let known_of = |terms: &Vec<Term>| terms.iter().map(|t| settings.known.get(&t.name).copied()).collect();
        let known: Vec<Vec<Option<f64>>> = equations.terms.iter().map(known_of).collect();
        let of = |equation: usize, k: &[Option<f64>]| -> Vec<Unknown> {
            (0..k.len()).filter(|term| k[*term].is_none()).map(|term| Unknown { equation, term }).collect()
        };
        let list = known.iter().enumerate().flat_map(|(e, k)| of(e, k)).collect();
        Self { equations, known, list }
    }

    /// The first unknown of an equation.
    fn first_of(&self, equation: usize) -> usize {
        self.list.iter().filter(|u| u.equation < equation).count()
    }

    pub fn term(&self, unknown: usize) -> &Term {
        let Unknown { equation, term } = self.list[unknown];
        &self.equations.terms[equation][term]
    }

    /// All coefficients, equation by equation, from the unknown ones.
    fn with_known(&self, found: &[DVector<f64>]) -> Vec<Vec<f64>> {
        let all = |(known, found): (&Vec<Option<f64>>, &DVector<f64>)| {
            let mut free = found.iter();
            known.iter().map(|k| k.unwrap_or_else(|| free.next().copied().unwrap_or(0.0))).collect()
        };
        self.known.iter().zip(found).map(all).collect()
    }
}

/// The least-squares problem of all orbits.
pub struct Problem<'a> {
    pub unknowns: Unknowns<'a>,
    pub settings: &'a Settings,
    /// What each orbit gives.
    pub expanded: Vec<Expanded>,
    /// Rows of each equation, known coefficients moved to the target.
    pub rows: Vec<Rows>,
    /// Blocks of orbits that are left out together.
    pub blocks: usize,
}

impl<'a> Problem<'a> {
    pub fn new(
        orbits: &[Orbit],
        equations: &'a Equations,
        settings: &'a Settings,
    ) -> core::result::Result<Self, Unsolvable> {
        let expanded: Vec<Expanded> =
            orbits.par_iter().enumerate().map(|(i, o)| rows::expand(i, o, equations, settings)).collect();
        let unknowns = Unknowns::new(equations, settings);
        let mut all = Vec::new();
        for (e, known) in unknowns.known.iter().enumerate() {
            let mut rows = Rows::default();
            expanded.iter().for_each(|x| rows.append(move_known(&x.rows[e], known)));
            if rows.values.iter().any(|x| !x.is_finite()) {
                return Err(Unsolvable::NotFinite);
            }
            all.push(rows);
        }
        Ok(Self { unknowns, settings, expanded, rows: all, blocks: orbits.len().min(MOST_BLOCKS) })
    }

    pub fn block(&self, orbit: usize) -> usize {
        orbit * self.blocks / self.expanded.len().max(1)
    }

    /// Each equation by itself.
    pub fn fits(&self) -> core::result::Result<Vec<EquationFit>, Unsolvable> {
        let fit = |(e, rows): (usize, &Rows)| {
            solve::fit(rows, self.settings.optimisation.as_ref(), &|_| true)
                .map_err(|c| Unsolvable::Coefficient(self.unknowns.term(self.unknowns.first_of(e) + c).name.clone()))
        };
        self.rows.iter().enumerate().map(fit).collect()
    }

    /// The unknowns from the fitted ones, dampings by the energy balance over the orbits that are
    /// left. None where that has no solution.
    pub fn with_energy_balance(&self, fitted: &[DVector<f64>], left_out: Option<usize>) -> Option<DVector<f64>> {
        let full = self.unknowns.with_known(fitted);
        let used: Vec<&Expanded> = self
            .expanded
            .iter()
            .enumerate()
            .filter(|(i, _)| Some(self.block(*i)) != left_out)
            .map(|(_, x)| x)
            .collect();
        let is_known = |name: &str| self.settings.known.contains_key(name);
        let equations = self.unknowns.equations;
        let full = energy_balance::dampings(equations, &used, &full, &is_known, self.settings.energy_balance)?;
        let list = &self.unknowns.list;
        Some(DVector::from_iterator(list.len(), list.iter().map(|u| full[u.equation][u.term])))
    }

    /// Rows as if independent: the sandwich N⁻¹ (Σ e² a aᵀ) N⁻¹ n/(n − p), and σ² N⁻¹ as metric.
    pub fn of_independent_rows(&self, fits: &[EquationFit]) -> (DMatrix<f64>, DMatrix<f64>) {
        let size = self.unknowns.list.len();
        let (mut sandwich, mut metric) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        for (e, (rows, fit)) in self.rows.iter().zip(fits).enumerate() {
            let p = rows.columns;
            let mut meat = DMatrix::zeros(p, p);
            let (mut square, mut used) = (0.0, 0.0);
            for r in (0..rows.len()).filter(|r| fit.kept[*r]) {
                let row = rows.row(r);
                let residual = solve::residual(row, &fit.coefficients).1;
                let a = DVector::from_row_slice(&row[..p]);
                meat += &a * a.transpose() * (residual * residual);
                square += residual * residual;
                used += 1.0;
            }
            let freedom = f64::max(used - p as f64, 1.0);
            let first = self.unknowns.first_of(e);
            let at = (first, first);
            sandwich.view_mut(at, (p, p)).copy_from(&(&fit.inverse * meat * &fit.inverse * (used / freedom)));
            // A fit without any residual still needs a metric that can be inverted.
            let variance = f64::max(square / freedom, f64::MIN_POSITIVE.sqrt());
            metric.view_mut(at, (p, p)).copy_from(&(&fit.inverse * variance));
        }
        (sandwich, metric)
    }

    /// Covariance from leaving out one block of orbits at a time, the energy balance included. None
    /// where an orbit is one without which nothing can be solved: it says nothing about the spread.
    pub fn jackknife(&self, fits: &[EquationFit], values: &DVector<f64>) -> Option<DMatrix<f64>> {
        let block = |orbit: usize| self.block(orbit);
        let change = |g: usize| {
            let without = |(rows, fit): (&Rows, &EquationFit)| solve::without(rows, &fit.kept, &block, g);
            let fitted: Option<Vec<DVector<f64>>> = self.rows.iter().zip(fits).map(without).collect();
            self.with_energy_balance(&fitted?, Some(g)).map(|x| x - values)
        };
        let changes: Vec<DVector<f64>> = (0..self.blocks).into_par_iter().map(change).collect::<Option<_>>()?;
        let (size, freedom) = (values.len(), (self.blocks - 1) as f64);
        // As many blocks as there are give Student's interval, not a normal one.
        let wider = widening(self.blocks);
        let sum = changes.iter().fold(DMatrix::zeros(size, size), |sum, d| sum + d * d.transpose());
        Some(sum * (freedom / self.blocks as f64 * wider * wider))
    }
}

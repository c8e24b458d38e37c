//! The seed's own method: every term is expanded in the sub-harmonics of an orbit, and equal
//! sub-harmonics are equated (2.15), (3.17) to (3.20), stacked over orbits, and solved by least
//! squares.
//!
//! *Orbits* are extracted unstable periodic orbits (`--method upo`) or long pieces of nT
//! (`--method frequency`). The choices of sections 3 and 4 are [`settings::Settings`]. What the
//! seed's method cannot do is left in it: the jump where an orbit does not close is an error that
//! no standard error shows, since it is alike in all orbits. The weak form has no jump.
//!
//! *Standard errors* are those of the delete-one-orbit jackknife (blocks of pieces where there are
//! more than a hundred), the second step of the energy balance included, rows dropped by the
//! optimisation staying dropped. With fewer than four orbits: the sandwich over rows.
//!
//! | file | concern |
//! |---|---|
//! | `settings` | choices |
//! | `orbits` | orbits and pieces from a record |
//! | `orbit`, `fourier` | one orbit: its series and derivatives |
//! | `equations`, `own` | the systems as sums of products of factors |
//! | `rows` | sub-harmonics of an orbit, chosen and equated |
//! | `solve` | least squares, optimisation, judgement on orbits left out |
//! | `account` | what is told beside the parameters |

pub mod account;
pub mod equations;
pub mod fourier;
pub mod orbit;
pub mod orbits;
pub mod own;
pub mod rows;
pub mod settings;
pub mod solve;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::built_in::WrittenRig;
use super::prepared::keep_steady_drive;
use super::stretches::{self, Stretch};
use super::system::System;
use super::{built_in, energy_balance};
use crate::error::{BadInput, Result};
use crate::record::Record;
use crate::rig::Rig;
use crate::warning::Warning;
use account::{Account, EquationAccount};
use equations::{Equations, Term};
use orbit::Orbit;
use rows::{Expanded, Rows};
use settings::{EnergyBalance, Orbits, Settings};
use solve::EquationFit;

pub use account::identification;

/// Most blocks of the jackknife.
const MOST_BLOCKS: usize = 100;
/// Fewest orbits for a jackknife.
const FEWEST_ORBITS: usize = 4;

/// Coefficients with covariance, before they are put into words.
#[derive(Clone, Debug)]
pub struct Balance {
    /// Names of the unknowns, equation by equation.
    pub names: Vec<String>,
    /// Units.
    pub units: Vec<&'static str>,
    /// Values.
    pub values: DVector<f64>,
    /// Covariance.
    pub covariance: DMatrix<f64>,
    /// Covariance that independent residuals would give.
    pub metric: DMatrix<f64>,
    /// Dampings as the harmonic balance had them, where the energy balance replaced them.
    pub before_energy_balance: Vec<(String, f64)>,
    /// Whether an energy balance was asked for and could not be done.
    pub energy_balance_failed: bool,
    /// Fits, equation by equation.
    pub fits: Vec<EquationFit>,
    /// Their rows (known coefficients moved to the target).
    pub rows: Vec<Rows>,
    /// Blocks of the jackknife; 0 where rows were taken as independent.
    pub blocks: usize,
}

/// The equations of a system.
pub fn equations(system: &System, settings: &Settings) -> Equations {
    match system {
        System::Single(dampings) => equations::single_pendulum(dampings, settings.basis),
        System::Double(dampings) => equations::double_pendulum(dampings),
    }
}

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

/// Why a balance could not be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unsolvable {
    /// Nothing determines this coefficient.
    Coefficient(String),
    /// A value is not finite.
    NotFinite,
}

impl Unsolvable {
    /// As an error that says what to do.
    fn error(&self) -> BadInput {
        match self {
            Self::Coefficient(name) => BadInput::new(
                format!("nothing in these orbits that determines {name}"),
                "motion in which every term of the equations takes part",
            )
            .remedy("More orbits or longer pieces, more sub-harmonics, fewer unknowns (--known-coefficient, --basis)"),
            Self::NotFinite => {
                BadInput::new("a value too large to compute with", "angles in the unit that the rig file names")
            }
        }
    }
}

/// A coefficient that is sought: a term of an equation.
#[derive(Clone, Copy)]
struct Unknown {
    equation: usize,
    term: usize,
}

/// The coefficients of the equations: those that are known, and the unknown ones in the order in
/// which they are solved for.
struct Unknowns<'a> {
    equations: &'a Equations,
    /// Values of those that are known, equation by equation.
    known: Vec<Vec<Option<f64>>>,
    list: Vec<Unknown>,
}

impl<'a> Unknowns<'a> {
    fn new(equations: &'a Equations, settings: &Settings) -> Self {
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

    fn term(&self, unknown: usize) -> &Term {
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
struct Problem<'a> {
    unknowns: Unknowns<'a>,
    settings: &'a Settings,
    /// What each orbit gives.
    expanded: Vec<Expanded>,
    /// Rows of each equation, known coefficients moved to the target.
    rows: Vec<Rows>,
    /// Blocks of orbits that are left out together.
    blocks: usize,
}

impl<'a> Problem<'a> {
    fn new(
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

    fn block(&self, orbit: usize) -> usize {
        orbit * self.blocks / self.expanded.len().max(1)
    }

    /// Each equation by itself.
    fn fits(&self) -> core::result::Result<Vec<EquationFit>, Unsolvable> {
        let fit = |(e, rows): (usize, &Rows)| {
            solve::fit(rows, self.settings.optimisation.as_ref(), &|_| true)
                .map_err(|c| Unsolvable::Coefficient(self.unknowns.term(self.unknowns.first_of(e) + c).name.clone()))
        };
        self.rows.iter().enumerate().map(fit).collect()
    }

    /// The unknowns from the fitted ones, dampings by the energy balance over the orbits that are
    /// left. None where that has no solution.
    fn with_energy_balance(&self, fitted: &[DVector<f64>], left_out: Option<usize>) -> Option<DVector<f64>> {
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
    fn of_independent_rows(&self, fits: &[EquationFit]) -> (DMatrix<f64>, DMatrix<f64>) {
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
    fn jackknife(&self, fits: &[EquationFit], values: &DVector<f64>) -> Option<DMatrix<f64>> {
        let block = |orbit: usize| self.block(orbit);
        let change = |g: usize| {
            let without = |(rows, fit): (&Rows, &EquationFit)| solve::without(rows, &fit.kept, &block, g);
            let fitted: Option<Vec<DVector<f64>>> = self.rows.iter().zip(fits).map(without).collect();
            self.with_energy_balance(&fitted?, Some(g)).map(|x| x - values)
        };
        let changes: Vec<DVector<f64>> = (0..self.blocks).into_par_iter().map(change).collect::<Option<_>>()?;
        let (size, freedom) = (values.len(), (self.blocks - 1) as f64);
        // As many blocks as there are give Student's interval, not a normal one.
        let wider = StudentsT::new(0.0, 1.0, freedom).map_or(1.0, |t| t.inverse_cdf(0.975) / 1.959_964);
        let sum = changes.iter().fold(DMatrix::zeros(size, size), |sum, d| sum + d * d.transpose());
        Some(sum * (freedom / self.blocks as f64 * wider * wider))
    }
}

/// Expands orbits and solves; the heart of the method, without files.
///
/// # Errors
/// A coefficient that nothing determines, values that are not finite.
pub fn balance(
    orbits: &[Orbit],
    equations: &Equations,
    settings: &Settings,
) -> core::result::Result<Balance, Unsolvable> {
    let problem = Problem::new(orbits, equations, settings)?;
    let fits = problem.fits()?;
    let plain: Vec<DVector<f64>> = fits.iter().map(|f| f.coefficients.clone()).collect();
    let unknowns = &problem.unknowns;
    let size = unknowns.list.len();
    let stacked = DVector::from_iterator(size, plain.iter().flat_map(|c| c.iter().copied()));
    let balanced = problem.with_energy_balance(&plain, None);
    let energy_balance_failed = balanced.is_none();
    let values = balanced.unwrap_or_else(|| stacked.clone());
    let before_energy_balance = if settings.energy_balance == EnergyBalance::None || energy_balance_failed {
        Vec::new()
    } else {
        let dampings = (0..size).filter(|i| unknowns.term(*i).role == equations::Role::Damping);
        dampings.map(|i| (unknowns.term(i).name.clone(), stacked[i])).collect()
    };
    let (mut covariance, metric) = problem.of_independent_rows(&fits);
    let mut blocks = 0;
    if orbits.len() >= FEWEST_ORBITS
        && !energy_balance_failed
        && let Some(found) = problem.jackknife(&fits, &values)
    {
        (covariance, blocks) = (found, problem.blocks);
    }
    Ok(Balance {
        names: (0..size).map(|i| unknowns.term(i).name.clone()).collect(),
        units: (0..size).map(|i| unknowns.term(i).unit).collect(),
        values,
        covariance,
        metric,
        before_energy_balance,
        energy_balance_failed,
        fits,
        rows: problem.rows,
        blocks,
    })
}

/// Identifies a driven system by harmonic balance: a built-in one, or a model file of one or two
/// coordinates without inputs.
///
/// # Errors
/// A system without a drive, settings out of range, a record that holds no orbit or no piece, a
/// coefficient that nothing determines.
pub fn identify(records: &[Record], rig: &Rig, settings: &Settings) -> Result<super::Identification> {
    settings.validate()?;
    if rig.bound.is_some() && settings.energy_balance != EnergyBalance::None {
        return Err(BadInput::new(
            "an energy balance for a model file",
            "none: which of its terms are dampings is not known",
        )
        .at("--energy-balance")
        .remedy("Leave --energy-balance out"));
    }
    let own = built_in::written(rig)?;
    let bound = built_in::bound(&own)?;
    let equations = if rig.bound.is_some() || !bound.inputs.is_empty() {
        own::equations(&bound.model, rig.omega())?
    } else {
        equations(&System::of(rig)?, settings)
    };
    let Some(drive) = rig.drive else {
        return Err(BadInput::new("no [drive]", "a driven system: orbits repeat with the drive")
            .in_file(&rig.path)
            .at("drive")
            .remedy("Use --method weak, which needs none"));
    };
    if let Some(name) = settings.known.keys().find(|k| !equations.terms.iter().flatten().any(|t| t.name == **k)) {
        let names: Vec<&str> = equations.terms.iter().flatten().map(|t| t.name.as_str()).collect();
        return Err(
            BadInput::new(format!("\"{name}\""), format!("one of {}", names.join(", "))).at("--known-coefficient")
        );
    }
    let mut warnings: Vec<Warning> = records.iter().flat_map(|r| r.warnings.clone()).collect();
    let (records, restarted) = super::boots::of_known_zero(records);
    let records = &*records;
    warnings.extend(restarted);
    let mut parts = Vec::new();
    for record in records {
        parts.extend(stretches::of(record, &own, bound)?);
    }
    let mut record_of = vec![0; parts.len()];
    keep_steady_drive(records, &mut parts, &mut record_of, &mut warnings)?;
    let period = rig.sample_rate_hz / drive.frequency_hz;
    let found = orbits::find(&parts, &bound.shown, &bound.model.circle(), period, &settings.orbits);
    let file = records.first().map(|r| r.path.clone()).unwrap_or_default();
    if found.orbits.is_empty() {
        let longest = parts.iter().map(Stretch::len).max().unwrap_or(0) as f64 / period;
        return Err(no_orbit(&settings.orbits, longest).in_file(file));
    }
    let solved = balance(&found.orbits, &equations, settings).map_err(|e| e.error().in_file(&file))?;
    let equation_accounts: Vec<EquationAccount> = solved
        .rows
        .iter()
        .zip(&solved.fits)
        .map(|(rows, fit)| EquationAccount {
            trail: fit.trail.clone(),
            held_out: settings.optimisation.and_then(|o| solve::held_out(rows, found.orbits.len(), &o)),
        })
        .collect();
    let account = Account::new(settings, &found, rig, &equations, &solved, equation_accounts);
    Ok(identification(WrittenRig { rig, own: &own, bound }, records, settings, solved, account, warnings))
}

fn no_orbit(sought: &Orbits, longest_periods: f64) -> BadInput {
    let (expected, remedy) = match sought {
        Orbits::Pieces { periods } => (
            format!("at least {periods} drive periods unbroken"),
            "Record longer, or choose shorter pieces with --piece-periods",
        ),
        Orbits::Unstable { tolerance, .. } => (
            format!("an orbit that closes to {} %", 100.0 * tolerance),
            "Raise --tolerance or --longest-period, record longer, or use --method frequency, which needs no orbit that closes",
        ),
    };
    BadInput::new(format!("no such orbit in {longest_periods:.1} drive periods"), expected).remedy(remedy)
}

#[cfg(test)]
mod tests;

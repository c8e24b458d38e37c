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
//! | `problem` | the least squares of all orbits, covariances |
//! | `solve` | least squares, optimisation, judgement on orbits left out |
//! | `account` | what is told beside the parameters |

pub mod account;
pub mod equations;
pub mod fourier;
pub mod orbit;
pub mod orbits;
pub mod own;
mod problem;
pub mod rows;
pub mod settings;
pub mod solve;

use nalgebra::{DMatrix, DVector};

use super::built_in;
use super::built_in::WrittenRig;
use super::prepared::keep_steady_drive;
use super::stretches::{self, Stretch};
use super::system::System;
use crate::error::{BadInput, Result};
use crate::record::Record;
use crate::rig::Rig;
use crate::system::library::Pendulum;
use crate::warning::Warning;
use account::{Account, EquationAccount};
use equations::Equations;
use orbit::Orbit;
use problem::Problem;
use rows::Rows;
use settings::{EnergyBalance, Orbits, Settings};
use solve::EquationFit;

pub use account::identification;

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
    match system.pendulum {
        Pendulum::Single => equations::single_pendulum(&system.coefficients(), settings.basis),
        Pendulum::Double => equations::double_pendulum(&system.dampings),
    }
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

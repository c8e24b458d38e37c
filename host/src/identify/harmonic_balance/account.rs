//! What a harmonic balance tells: the contract's result, and beside it the orbits, the trail of the
//! optimisation, the unknown functions with their bands, the dampings before and after the energy
//! balance.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use serde::Serialize;

use super::equations::Equations;
use super::orbits::Found;
use super::settings::{Orbits, Settings};
use super::solve::{HeldOut, Trail, residual};
use super::{Balance, Orbit};
use crate::identify::built_in::WrittenRig;
use crate::identify::regression::MOST_DOTS;
use crate::identify::units::units_of;
use crate::identify::{Details, Identification, RecordUse, Residuals, built_in, identifiability};
use crate::record::Record;
use crate::rig::Rig;
use crate::system::ties::Identified;
use crate::warning::Warning;

/// Points at which an unknown function is given.
const POINTS: usize = 65;

/// One orbit that was used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OrbitUse {
    /// Period or length, drive periods.
    pub periods: usize,
    /// Start, s.
    pub start_s: f64,
    /// How far it is from closing, share of the span (0 for a piece).
    pub closing_error: f64,
}

/// One equation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EquationAccount {
    /// What the optimisation did.
    pub trail: Trail,
    /// How well orbits that were left out are predicted.
    pub held_out: Option<HeldOut>,
}

/// An unknown function, identified.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Function {
    /// n (with cos τ), p (with sin τ) or q.
    pub name: &'static str,
    /// Angle, rad.
    pub angle: Vec<f64>,
    /// Value.
    pub value: Vec<f64>,
    /// Standard error at each angle by itself.
    pub std_error: Vec<f64>,
}

/// What is told beside the parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Account {
    /// Choices.
    pub settings: Settings,
    /// Orbits.
    pub orbits: Vec<OrbitUse>,
    /// Delay T_d, samples, where orbits were extracted.
    pub delay: Option<usize>,
    /// Closing stretches before merging.
    pub recurrences: usize,
    /// Cut-off of the low-pass, Hz.
    pub cut_off_hz: Option<f64>,
    /// Equations.
    pub equations: Vec<EquationAccount>,
    /// Unknown functions.
    pub functions: Vec<Function>,
    /// Dampings of the harmonic balance, before the energy balance.
    pub before_energy_balance: Vec<(String, f64)>,
}

impl Account {
    /// Puts it together.
    pub fn new(
        settings: &Settings,
        found: &Found,
        rig: &Rig,
        equations: &Equations,
        balance: &Balance,
        accounts: Vec<EquationAccount>,
    ) -> Self {
        let of = |o: &Orbit| OrbitUse { periods: o.periods, start_s: o.start_s, closing_error: o.closing_error };
        Self {
            settings: settings.clone(),
            orbits: found.orbits.iter().map(of).collect(),
            delay: found.delay,
            recurrences: found.recurrences,
            cut_off_hz: settings.low_pass.map(|share| share * rig.sample_rate_hz),
            equations: accounts,
            functions: functions(equations, balance),
            before_energy_balance: balance.before_energy_balance.clone(),
        }
    }
}

/// Unknown functions over the circle, Σ λ_i φ_i(x), with the standard error √(φᵀ C φ) at each x.
pub fn functions(equations: &Equations, balance: &Balance) -> Vec<Function> {
    let angle: Vec<f64> = (0..POINTS).map(|i| -PI + TAU * i as f64 / (POINTS - 1) as f64).collect();
    equations
        .functions
        .iter()
        .map(|(name, places)| {
            // A coefficient that was taken as known has no place among the unknowns.
            let index: Vec<Option<usize>> = places
                .iter()
                .map(|(e, j)| balance.names.iter().position(|n| *n == equations.terms[*e][*j].name))
                .collect();
            let (mut value, mut std_error) = (Vec::new(), Vec::new());
            for x in &angle {
                let phi: Vec<(usize, f64)> =
                    index.iter().zip(&equations.basis).filter_map(|(i, b)| Some(((*i)?, b(*x)))).collect();
                value.push(phi.iter().map(|(i, f)| f * balance.values[*i]).sum());
                let variance: f64 =
                    phi.iter().flat_map(|a| phi.iter().map(move |b| a.1 * b.1 * balance.covariance[(a.0, b.0)])).sum();
                std_error.push(variance.max(0.0).sqrt());
            }
            Function { name, angle: angle.clone(), value, std_error }
        })
        .collect()
}

/// Residuals by frequency, in bins of a twentieth of the drive frequency, and dots of figure 3.14.
fn residuals(balance: &Balance, drive_hz: f64) -> Vec<Residuals> {
    const BINS: f64 = 20.0;
    balance
        .rows
        .iter()
        .zip(&balance.fits)
        .map(|(rows, fit)| {
            let mut sums: Vec<(f64, f64)> = Vec::new();
            let mut dots = Vec::new();
            let used: Vec<usize> = (0..rows.len()).filter(|r| fit.kept[*r]).collect();
            let stride = used.len().div_ceil(MOST_DOTS).max(1);
            for (i, r) in used.iter().enumerate() {
                let (predicted, e) = residual(rows.row(*r), &fit.coefficients);
                let id = rows.ids[*r];
                let bin = (BINS * id.subharmonic as f64 / id.periods.max(1) as f64).round() as usize;
                if sums.len() <= bin {
                    sums.resize(bin + 1, (0.0, 0.0));
                }
                sums[bin].0 += e * e;
                sums[bin].1 += 1.0;
                if i.is_multiple_of(stride) {
                    dots.push((bin, predicted, -e));
                }
            }
            let rms = sums.iter().map(|(s, n)| if *n > 0.0 { (s / n).sqrt() } else { 0.0 }).collect();
            Residuals { frequency_step_hz: drive_hz / BINS, rms, dots }
        })
        .collect()
}

/// The contract's result in the rig's own terms.
pub fn identification(
    written: WrittenRig<'_>,
    records: &[Record],
    settings: &Settings,
    balance: Balance,
    account: Account,
    mut warnings: Vec<Warning>,
) -> Identification {
    let WrittenRig { rig, own, bound } = written;
    let Balance { names, values, covariance, .. } = &balance;
    let groups = identifiability::groups_not_separable(names, values, covariance);
    let written = bound
        .model
        .equations
        .iter()
        .flat_map(|e| &e.terms)
        .zip(units_of(&bound.model, own, bound).into_iter().flatten());
    let written: BTreeMap<&str, String> = written.map(|(t, unit)| (t.name.as_str(), unit)).collect();
    // A function series has more terms than the equations that are written out.
    let unit = |n: &String| written.get(n.as_str()).cloned().unwrap_or_else(|| "1".to_owned());
    let units: Vec<String> = names.iter().map(unit).collect();
    let identified = Identified { names, values, covariance, metric: &balance.metric };
    let (parameters, ties_misfit) = built_in::parameters(rig, &identified, &units, &mut warnings);
    let not_reached: Vec<String> = balance
        .fits
        .iter()
        .enumerate()
        .filter(|(_, f)| settings.optimisation.is_some() && !f.trail.reached)
        .map(|(e, f)| format!("ε of equation {} is still {:.1} %", e + 1, 100.0 * f.error))
        .collect();
    if !not_reached.is_empty() {
        warnings.push(Warning::new(
            "optimisation-ended",
            format!("{} after dropping all that could be dropped", not_reached.join(", ")),
            "Use orbits that close better (a smaller --tolerance, a longer record), --differentiation five-point, or another set of sub-harmonics",
        ));
    }
    if balance.energy_balance_failed {
        warnings.push(Warning::new(
            "no-energy-balance",
            "these orbits do not determine the dampings by their energy".to_owned(),
            "The harmonic balance's dampings stand; use more orbits than there are dampings",
        ));
    }
    if balance.blocks == 0 {
        warnings.push(Warning::new(
            "few-orbits",
            format!("{} orbits are too few to measure how results scatter between them", account.orbits.len()),
            "Standard errors take rows as independent; record longer or raise --tolerance",
        ));
    }
    let drive_hz = rig.drive.map_or(1.0, |d| d.frequency_hz);
    let periods = account.orbits.iter().map(|o| o.periods).max().unwrap_or(1) as f64;
    let cut_off = account.cut_off_hz.unwrap_or(0.5 * rig.sample_rate_hz);
    let used: usize = balance.fits.iter().map(|f| f.kept.iter().filter(|k| **k).count()).sum();
    let all: usize = balance.fits.iter().map(|f| f.kept.len()).sum();
    let top = balance.rows.iter().flat_map(|r| &r.ids).map(|i| i.subharmonic as f64 / i.periods as f64);
    Identification {
        model: bound.model.name.clone(),
        method: match settings.orbits {
            Orbits::Unstable { .. } => "upo",
            Orbits::Pieces { .. } => "frequency",
        }
        .to_owned(),
        identification_error: balance.fits.iter().map(|f| f.error).collect(),
        equations_used: used,
        equations_dropped: all - used,
        groups_not_separable: groups,
        record: RecordUse::of(records),
        correlation: identifiability::correlation(covariance),
        correlation_names: names.clone(),
        details: Details {
            window_s: periods / drive_hz,
            windows: account.orbits.len(),
            max_frequency_hz: top.fold(0.0, f64::max) * drive_hz,
            pass_hz: cut_off,
            stop_hz: cut_off,
            sign_pass_hz: cut_off,
            noise_rad: vec![0.0; bound.sensors.len()],
            condition: balance.fits.iter().map(|f| f.condition).collect(),
            jackknife_blocks: balance.blocks,
            ties_misfit,
            ..Details::default()
        },
        warnings,
        residuals: residuals(&balance, drive_hz),
        parameters,
        balance: Some(account),
        ..Identification::default()
    }
}

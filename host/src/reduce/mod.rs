//! Reduced-order models: a record of many coordinates into few, with an equation that predicts, and the range in which it may be trusted.
//!
//! | file | what |
//! |---|---|
//! | [`proper_orthogonal_decomposition`], [`streaming`], [`circular`], [`channel_faults`] | modes and their energies |
//! | [`release_fit`] | frequency and harmonics of a release, from displacements |
//! | [`added_constraint`] | the seed's models: major coordinate alone, added constraint, types I and II |
//! | [`polar`] | the action–angle model |
//! | [`forced_response`] | its forced, damped response in closed form, with folds |
//! | [`systems`], [`normal_mode`], [`harmonic_balance`] | full systems whose equations are known, their normal mode by shooting and their forced response by continuation, for comparison |
//!
//! Every unbroken stretch of a record is a release. Angles that whirl are decomposed on the circle.

pub mod added_constraint;
pub mod channel_faults;
pub mod circular;
pub mod decay;
pub mod eigen;
pub mod forced_response;
pub mod gram;
pub mod harmonic_balance;
pub mod integrate;
mod judge;
pub mod model;
pub mod normal_mode;
pub mod polar;
pub mod proper_orthogonal_decomposition;
pub mod release_fit;
pub mod releases;
pub mod streaming;
pub mod systems;

use serde::Serialize;

use self::channel_faults::ChannelFault;
pub use self::model::{Error, FrequencyEnergy, Model};
pub use self::releases::Release;
use crate::error::{BadInput, Result};
use crate::record::Record;
use crate::rig::Rig;
use crate::warning::Warning;

/// How the minor coordinates follow the major one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Constraint {
    /// They are zero: the major coordinate's equation alone (5.14).
    None,
    /// Polynomial constraint, nonlinearity in the major coordinate (5.19).
    Type1,
    /// Polynomial constraint, nonlinearity in both (5.20).
    Type2,
    /// Periodic motions parametrised by amplitude and phase.
    Polar,
}

/// How to reduce.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReduceSettings {
    /// Modes to keep; as many as hold 99.9 % of the energy where none is given.
    pub modes: Option<usize>,
    /// Constraint; polar where the releases are close to periodic, otherwise none.
    pub constraint: Option<Constraint>,
    /// Share of the energy to keep, 0 to 1 (0.999 where none is given).
    pub energy: Option<f64>,
    /// Masses of the channels, for mass-weighted modes.
    pub masses: Option<Vec<f64>>,
}

/// The result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reduction {
    /// Shares of the energy, largest first.
    pub energy: Vec<f64>,
    /// Modes in that order, one entry a coordinate (their real parts on the circle).
    pub modes: Vec<Vec<f64>>,
    /// Modes kept.
    pub kept: usize,
    /// Constraint of the model.
    pub constraint: Constraint,
    /// The model; none where the record does not allow one.
    pub model: Option<Model>,
    /// Frequency in Hz against energy, full and reduced.
    pub frequency_energy: FrequencyEnergy,
    /// How far the model is from the record and from the full system.
    pub error: Error,
    /// Imaginary parts of the modes, on the circle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub modes_imaginary: Option<Vec<Vec<f64>>>,
    /// Coordinates, in the order of a mode's entries.
    pub coordinates: Vec<String>,
    /// Their unit each.
    pub units: Vec<String>,
    /// Dead channels and copies.
    pub channel_faults: Vec<ChannelFault>,
    /// Number of modes above rounding.
    pub rank: usize,
    /// Releases.
    pub releases: Vec<Release>,
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// What the figures show.
    #[serde(skip)]
    pub plots: model::Plots,
}

/// Reduces records.
///
/// # Errors
/// Settings out of range, records without samples, and a constraint asked for that the record does not allow.
pub fn reduce(records: &[Record], rig: &Rig, settings: &ReduceSettings) -> Result<Reduction> {
    let gathered = releases::gather(records, rig)?;
    let n = gathered.names.len();
    check(settings, n)?;
    let mut warnings = gathered.warnings.clone();
    let faults = channel_faults::find(&gathered.whole().iter().map(Vec::as_slice).collect::<Vec<_>>());
    warnings.extend(faults.iter().map(|f| fault_warning(f, &gathered.names)));
    let masses = settings.masses.as_deref();
    let share = settings.energy.unwrap_or(proper_orthogonal_decomposition::KEPT_ENERGY);
    if gathered.whirling {
        return Ok(on_circle(&gathered, faults, warnings, settings, share));
    }
    let mut sums = streaming::Accumulator::new(n);
    for release in &gathered.releases {
        sums.add(&release.iter().map(Vec::as_slice).collect::<Vec<_>>());
    }
    if sums.count() <= n as u64 {
        warnings.push(Warning::new(
            "few-samples",
            format!("{} samples of {n} channels: at most {} modes can be told apart", sums.count(), sums.count() - 1),
            "Record longer",
        ));
    }
    let pod = sums.finish(masses);
    if pod.rank() == 0 {
        return Err(BadInput::new("channels that never change", "a record of motion")
            .in_file(&records[0].path)
            .remedy("Check the sensors; nothing moves in this record"));
    }
    let kept = settings.modes.unwrap_or_else(|| pod.holding(share)).min(pod.rank());
    model::build(&gathered, pod, kept, faults, warnings, rig, settings)
}

fn check(settings: &ReduceSettings, n: usize) -> Result<()> {
    if let Some(m) = settings.modes
        && !(1..=n).contains(&m)
    {
        return Err(BadInput::new(m.to_string(), format!("1 to {n}, the number of channels")).at("--modes"));
    }
    if let Some(e) = settings.energy
        && !(e > 0.0 && e <= 1.0)
    {
        return Err(BadInput::new(e.to_string(), "a share above 0 and up to 1").at("--energy"));
    }
    if let Some(m) = &settings.masses {
        if m.len() != n {
            let found = format!("{} masses", m.len());
            return Err(BadInput::new(found, format!("{n}, one for each channel of the rig file")).at("--masses"));
        }
        if let Some(bad) = m.iter().find(|m| !(m.is_finite() && **m > 0.0)) {
            return Err(BadInput::new(bad.to_string(), "masses above 0").at("--masses"));
        }
    }
    Ok(())
}

fn fault_warning(fault: &ChannelFault, names: &[String]) -> Warning {
    match fault {
        ChannelFault::Dead { channel, value } => Warning::new(
            "dead-channel",
            format!("{} never changes (it shows {value})", names[*channel]),
            "It takes no part in any mode; check its sensor",
        ),
        ChannelFault::Copy { channel, of, identical } => Warning::new(
            "copied-channel",
            format!(
                "{} repeats {}{}",
                names[*channel],
                names[*of],
                if *identical { ", bit by bit" } else { " up to a factor and an offset" }
            ),
            "Its motion counts twice in the energies and the rank is lower by one; leave one of them out of the rig file",
        ),
    }
}

fn on_circle(
    gathered: &releases::Gathered,
    faults: Vec<ChannelFault>,
    mut warnings: Vec<Warning>,
    settings: &ReduceSettings,
    share: f64,
) -> Reduction {
    let whole = gathered.whole();
    let pod = circular::decompose(&whole.iter().map(Vec::as_slice).collect::<Vec<_>>());
    let mut sum = 0.0;
    let holding = pod.energy.iter().take_while(|e| {
        let before = sum;
        sum += **e;
        before < share
    });
    let kept = settings.modes.unwrap_or(holding.count()).min(pod.energy.len());
    if settings.constraint.is_some_and(|c| c != Constraint::None) {
        warnings.push(Warning::new(
            "whirling",
            "an angle turns over and over: modes are given on the circle, z = exp(iφ), without a constraint",
            "A constraint needs releases that swing about rest",
        ));
    }
    Reduction {
        rank: pod.energy.iter().filter(|e| **e > 1e-12).count(),
        energy: pod.energy,
        modes: pod.real,
        kept,
        constraint: Constraint::None,
        model: None,
        frequency_energy: FrequencyEnergy::default(),
        error: Error::default(),
        modes_imaginary: Some(pod.imaginary),
        coordinates: gathered.names.clone(),
        units: gathered.units.clone(),
        channel_faults: faults,
        releases: Vec::new(),
        warnings,
        plots: model::Plots::default(),
    }
}

#[cfg(test)]
mod tests;

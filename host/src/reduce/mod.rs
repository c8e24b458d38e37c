//! Reduced-order models: a record of many coordinates into few, with an equation that predicts, and
//! the range in which it may be trusted.
//!
//! | file | what |
//! |---|---|
//! | [`proper_orthogonal_decomposition`], [`streaming`], [`circular`], [`channel_faults`] | modes and their energies |
//! | [`long`] | the same of records too long for memory |
//! | [`gram`], [`eigen`] | the matrices behind them |
//! | [`release_fit`] | frequency and harmonics of a release, from displacements |
//! | [`added_constraint`] | the seed's models: major coordinate alone, added constraint, types I and II |
//! | [`polar`] | the action–angle model |
//! | [`standard_error`] | its standard errors |
//! | [`forced_response`], [`forced`], [`damping`] | its forced, damped response in closed form, with folds and stability; damping from decays |
//! | [`systems`], [`normal_mode`], [`harmonic_balance`] | full systems whose equations are known, their normal mode by shooting and their forced response by continuation, for comparison |
//!
//! Every unbroken stretch of a record is a release. Angles that whirl are decomposed on the circle.

pub mod added_constraint;
pub mod channel_faults;
pub mod circular;
pub mod damping;
pub mod decay;
pub mod eigen;
pub mod forced;
pub mod forced_response;
pub mod gram;
pub mod harmonic_balance;
pub mod integrate;
mod judge;
pub mod long;
pub mod model;
pub mod normal_mode;
pub mod polar;
pub mod proper_orthogonal_decomposition;
pub mod release_fit;
pub mod releases;
pub mod standard_error;
pub mod streaming;
pub mod systems;

use serde::Serialize;

use self::channel_faults::ChannelFault;
pub use self::forced::{Force, Forced};
pub use self::model::{Error, FrequencyEnergy, Model};
use self::proper_orthogonal_decomposition::Pod;
pub use self::releases::Release;
pub use self::standard_error::AmplitudePoint;
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
    /// A force, for the forced and damped response of the polar model.
    pub force: Option<Force>,
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
    /// Frequency against amplitude of the polar model, with standard errors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub frequency_amplitude: Vec<AmplitudePoint>,
    /// The forced, damped response, where one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forced: Option<Forced>,
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
    /// Samples.
    pub samples: u64,
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
/// Settings out of range, records without samples, and a constraint asked for that the record does
/// not allow.
pub fn reduce(records: &[Record], rig: &Rig, settings: &ReduceSettings) -> Result<Reduction> {
    let gathered = releases::gather(records, rig)?;
    let n = gathered.names.len();
    check(settings, n)?;
    let mut warnings = gathered.warnings.clone();
    let faults = channel_faults::find(&gathered.whole().iter().map(Vec::as_slice).collect::<Vec<_>>());
    warnings.extend(faults.iter().map(|f| fault_warning(f, &gathered.names)));
    let samples = gathered.releases.iter().map(|r| r[0].len() as u64).sum();
    let frame = Frame { names: gathered.names.clone(), units: gathered.units.clone(), faults, warnings, samples };
    if gathered.whirling && settings.force.is_some() {
        return Err(forced_needs_polar());
    }
    if gathered.whirling {
        let whole = gathered.whole();
        let pod = circular::decompose(&whole.iter().map(Vec::as_slice).collect::<Vec<_>>());
        return Ok(on_circle(frame, pod, settings));
    }
    let mut sums = streaming::Accumulator::new(n);
    for release in &gathered.releases {
        sums.add(&release.iter().map(Vec::as_slice).collect::<Vec<_>>());
    }
    let (pod, kept, frame) = decomposed(sums, frame, settings, &records[0].path)?;
    model::build(&gathered, pod, kept, frame, rig, settings)
}

/// What a result has whatever comes of its decomposition.
struct Frame {
    names: Vec<String>,
    units: Vec<String>,
    faults: Vec<ChannelFault>,
    warnings: Vec<Warning>,
    samples: u64,
}

/// The decomposition of what was accumulated, and how many modes are kept; an error where nothing
/// moves.
fn decomposed(
    sums: streaming::Accumulator,
    mut frame: Frame,
    settings: &ReduceSettings,
    file: &std::path::Path,
) -> Result<(Pod, usize, Frame)> {
    let n = frame.names.len();
    if sums.count() <= n as u64 {
        frame.warnings.push(Warning::new(
            "few-samples",
            format!("{} samples of {n} channels: at most {} modes can be told apart", sums.count(), sums.count() - 1),
            "Record longer",
        ));
    }
    if !sums.covariance().iter().all(|v| v.is_finite()) {
        return Err(BadInput::new("values whose squares are beyond 1e308", "values of a size that can be squared")
            .in_file(file)
            .remedy("Choose another unit, or mend the values"));
    }
    let pod = sums.finish(settings.masses.as_deref());
    if pod.rank() == 0 {
        return Err(BadInput::new("channels that never change", "a record of motion")
            .in_file(file)
            .remedy("Check the sensors; nothing moves in this record"));
    }
    let share = settings.energy.unwrap_or(proper_orthogonal_decomposition::KEPT_ENERGY);
    let kept = settings.modes.unwrap_or_else(|| pod.holding(share)).min(pod.rank());
    Ok((pod, kept, frame))
}

/// A result of modes alone.
fn without_model(frame: Frame, pod: Pod, kept: usize) -> Reduction {
    Reduction {
        rank: pod.rank(),
        energy: pod.energy,
        modes: pod.modes,
        kept,
        constraint: Constraint::None,
        model: None,
        frequency_energy: FrequencyEnergy::default(),
        frequency_amplitude: Vec::new(),
        forced: None,
        error: Error::default(),
        modes_imaginary: None,
        coordinates: frame.names,
        units: frame.units,
        channel_faults: frame.faults,
        samples: frame.samples,
        releases: Vec::new(),
        warnings: frame.warnings,
        plots: model::Plots::default(),
    }
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
    if let Some(force) = &settings.force {
        forced::check(force, n)?;
        if settings.constraint.is_some_and(|c| c != Constraint::Polar) {
            return Err(forced_needs_polar());
        }
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

/// The error for a force without a polar model.
fn forced_needs_polar() -> BadInput {
    BadInput::new("no polar model", "free swings or decays of different amplitudes, reduced by --constraint polar")
        .at("--force")
        .remedy("Record releases on one mode, at least two of different amplitude")
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

fn on_circle(mut frame: Frame, pod: circular::CircularPod, settings: &ReduceSettings) -> Reduction {
    let share = settings.energy.unwrap_or(proper_orthogonal_decomposition::KEPT_ENERGY);
    let mut sum = 0.0;
    let holding = pod.energy.iter().take_while(|e| {
        let before = sum;
        sum += **e;
        before < share
    });
    let kept = settings.modes.unwrap_or(holding.count()).min(pod.energy.len());
    if settings.constraint.is_some_and(|c| c != Constraint::None) {
        frame.warnings.push(Warning::new(
            "whirling",
            "an angle turns over and over: modes are given on the circle, z = exp(iφ), without a constraint",
            "A constraint needs releases that swing about rest",
        ));
    }
    let rank = pod.energy.iter().filter(|e| **e > 1e-12).count();
    let plain = Pod { mean: Vec::new(), values: Vec::new(), energy: pod.energy, modes: pod.real };
    Reduction { rank, modes_imaginary: Some(pod.imaginary), ..without_model(frame, plain, kept) }
}

#[cfg(test)]
mod tests;

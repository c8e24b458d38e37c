//! Whether an identified model moves as the measured system does.
//!
//! It works on every system that can be integrated: built-in ones with the effects that `explain`
//! found, and model files, measured inputs included.
//!
//! Chaos forbids comparing two histories, so the model makes a record of its own ([`twin`]: same
//! sensors, rate, drive), and what characterises the motion is compared side by side, found by the
//! same algorithms in both: prediction horizons ([`horizon`]), Poincaré sections with an energy
//! distance and its permutation test ([`energy_distance`]), largest exponent, correlation
//! dimension, catalogue of periodic orbits (those of the record refined on the model), natural
//! frequencies (3.34) against a free vibration.
//!
//! The model fails its validation where one of these [`Check`]s fails:
//! - `prediction-horizon`: the median horizon on the record is less than 65 % of the median on the
//!   model's own record (half, with fewer than 30 starts);
//! - `poincare-section`: the sections differ with a probability by chance below 1 % (over all
//!   phases together);
//! - `lyapunov-exponent`, `correlation-dimension`: the two records' values differ by more than
//!   three standard errors and by more than a third;
//! - `natural-frequencies` (with a free vibration): one differs by more than 10 %.

pub mod card;
mod checks;
mod diagram;
pub mod energy_distance;
pub mod horizon;
pub mod moving;
pub mod natural_frequencies;
pub mod presentation;
pub mod sections;
pub mod starts;
pub mod twin;

use core::f64::consts::TAU;

use indicatif::ProgressBar;
use serde::Serialize;

use self::horizon::Horizon;
use self::moving::Moving;
use self::natural_frequencies::NaturalFrequencies;
use self::sections::SectionComparison;
use self::starts::{Course, Starts};
use crate::error::{BadInput, Result};
use crate::identify::Settings as IdentifySettings;
use crate::identify::stretches::{self, Stretch};
use crate::identify::track::{Along, Track};
use crate::identify::{self, Prepared};
use crate::inspect::{InspectSettings, Inspection, inspect};
use crate::model::flow::{Flow, Outside};
use crate::model::identified::{IdentifiedModel, System};
use crate::phase_space::bifurcation::Column;
use crate::phase_space::model_exponent;
use crate::phase_space::orbit_refinement::RefinedOrbit;
use crate::phase_space::survey::{Lyapunov, PhaseSpace};
use crate::record::Record;
use crate::rig::{Rig, as_own};
use crate::warning::Warning;

/// Longest record that the model makes, samples.
const MOST_SAMPLES: usize = 120_000;
/// Orbits of the record that are refined on the model.
const MOST_ORBITS: usize = 12;

/// Stages that a progress bar shows beside the starts.
const STAGES: u64 = 4;

/// Choices.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Angle by which a prediction may be off, degrees. Default 30.
    pub tolerance_deg: f64,
    /// Most starts of predictions. Default 60.
    pub starts: usize,
    /// Seed of the permutation test and of the model's own sensors' noise. Default 1.
    pub seed: u64,
    /// Parameter of a bifurcation diagram (`drive`: all of the base's motion), lowest and highest
    /// factor on its identified value.
    pub bifurcation: Option<(String, f64, f64)>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { tolerance_deg: 30.0, starts: 60, seed: 1, bifurcation: None }
    }
}

/// Outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// No check failed.
    Passed,
    /// A check failed.
    Failed,
}

/// One comparison that can fail.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Name.
    pub name: &'static str,
    /// Whether record and model agree.
    pub passed: bool,
    /// What was compared, with the numbers.
    pub message: String,
}

/// Horizons on the record and on the model's own record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HorizonComparison {
    /// Angle by which a prediction may be off, degrees.
    pub tolerance_deg: f64,
    /// Length of the stretch to which initial states are fitted, s.
    pub fit_s: f64,
    /// Longest prediction, s.
    pub longest_s: f64,
    /// On the measured record.
    pub measured: Horizon,
    /// On the model's own record.
    pub simulated: Horizon,
    /// Medians in Lyapunov times of the model (measured, simulated); none where the model is not
    /// chaotic.
    pub median_lyapunov_times: Option<[f64; 2]>,
}

/// A value in both records.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// In the measured record.
    pub measured: f64,
    /// Its standard error.
    pub measured_std_error: f64,
    /// In the model's own record.
    pub simulated: f64,
    /// Its standard error.
    pub simulated_std_error: f64,
}

impl Pair {
    /// Difference in standard errors.
    pub fn deviation(&self) -> f64 {
        (self.measured - self.simulated).abs() / self.measured_std_error.hypot(self.simulated_std_error)
    }
}

/// The largest exponent, 1/s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ExponentComparison {
    /// From the model's variational equations.
    pub model: f64,
    /// Its standard error.
    pub model_std_error: f64,
    /// From the two records.
    pub records: Option<Pair>,
}

/// An orbit of the record, and what became of it on the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OrbitComparison {
    /// Period, drive periods.
    pub period: usize,
    /// Time at which its best closing stretch starts, s.
    pub start_s: f64,
    /// Closing error in the record, share of the span.
    pub closing: f64,
    /// The model's orbit; none where Newton's method found none near it.
    pub refined: Option<RefinedOrbit>,
}

/// Periodic orbits side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Orbits {
    /// Tolerance of the extraction, share of the span.
    pub tolerance: f64,
    /// Distinct orbits of each period 1, 2, … in the measured record.
    pub measured: Vec<usize>,
    /// The same in the model's own.
    pub simulated: Vec<usize>,
    /// The record's best closing ones, refined on the model.
    pub refined: Vec<OrbitComparison>,
}

/// A bifurcation diagram of the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bifurcation {
    /// Parameter, `drive` for all of the base's motion.
    pub parameter: String,
    /// Factor on its identified value, column by column.
    pub factor: Vec<f64>,
    /// Section of each.
    pub columns: Vec<Column>,
}

/// A validation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// Whether any check failed.
    pub verdict: Verdict,
    /// The checks that could be made.
    pub checks: Vec<Check>,
    /// The model's name.
    pub model: String,
    /// How it was identified.
    pub method: String,
    /// Length of the record that the model made, s.
    pub simulated_s: f64,
    /// Prediction horizons.
    pub horizon: HorizonComparison,
    /// Poincaré sections (driven, not periodic).
    pub sections: Vec<SectionComparison>,
    /// Largest exponent (driven).
    pub lyapunov: Option<ExponentComparison>,
    /// Correlation dimension.
    pub correlation_dimension: Option<Pair>,
    /// Periodic orbits (driven).
    pub orbits: Option<Orbits>,
    /// Natural frequencies.
    pub natural_frequencies: Option<NaturalFrequencies>,
    /// Bifurcation diagram, where one was asked for.
    pub bifurcation: Option<Bifurcation>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// What a validation may be given beside records and model.
#[derive(Clone, Copy, Default)]
pub struct Beside<'a> {
    /// A free vibration of the same arms (read with the rig file's channels).
    pub free: Option<&'a Record>,
    /// The inspection of the record with the longest unbroken stretch, where there is one already.
    pub inspection: Option<&'a Inspection>,
    /// What is told of the progress.
    pub progress: Option<&'a ProgressBar>,
}

/// Validates a model on records of its rig.
///
/// # Errors
/// A model of another system or drive, records shorter than one window, settings out of range, a
/// model whose solution ceases to exist.
pub fn validate(
    records: &[Record],
    rig: &Rig,
    model: &IdentifiedModel,
    beside: Beside<'_>,
    settings: &Settings,
) -> Result<Validation> {
    if !(settings.tolerance_deg > 0.0 && settings.tolerance_deg <= 180.0) {
        return Err(
            BadInput::new(settings.tolerance_deg.to_string(), "an angle above 0, at most 180").at("--tolerance-deg")
        );
    }
    if !(4..=10_000).contains(&settings.starts) {
        return Err(BadInput::new(settings.starts.to_string(), "4 to 10000").at("--starts"));
    }
    let coordinates;
    let bound = if let Some(bound) = &rig.bound {
        bound
    } else {
        coordinates = as_own::coordinates(rig)?;
        coordinates
            .bound
            .as_ref()
            .ok_or_else(|| BadInput::new("a rig without channels", "channels that measure angles"))?
    };
    let circle = bound.model.circle();
    let omega = rig.drive.map_or(0.0, |d| TAU * d.frequency_hz);
    let course = |stretches: &[Stretch]| -> Vec<Along> { stretches.iter().map(|s| Along::new(s, omega)).collect() };
    let prepared = identify::prepare(records, rig, bound, &IdentifySettings::default())?;
    let equations = Moving::of(model, rig, prepared.stretches.first().map_or(0.0, |s| s.start_s))?;
    let mut warnings = prepared.warnings.clone();
    if !equations.left_out.is_empty() {
        warnings.push(Warning::new(
            "effects-left-out",
            format!("{} change what is recorded, not the motion", equations.left_out.join(", ")),
            "They are not in the simulated record; the prediction horizon feels them",
        ));
    }
    let parameters = &equations.parameters;
    let (stretches, noise) = (&prepared.stretches, &prepared.sensors);
    let along = course(stretches);
    let track = Track::new(stretches, &along, rig, bound, noise);
    let measured_course = Course { stretches, track: &track };
    let period_s = period_s(rig, &prepared);
    let starts = Starts::new(&equations, measured_course, circle.clone(), (period_s, omega), settings);
    let unable = || {
        BadInput::new("no solution of the model that follows the record's start", "a model identified on this record")
            .at("--model")
            .remedy("Identify the model anew")
    };
    // The model's own record.
    let (longest, stretch) = stretches.iter().enumerate().max_by_key(|(_, s)| s.len()).ok_or_else(unable)?;
    let state = starts.first_state(measured_course, longest, parameters).ok_or_else(unable)?;
    let all: usize = if bound.inputs.is_empty() { stretches.iter().map(Stretch::len).sum() } else { stretch.len() };
    let count = all.min(MOST_SAMPLES);
    let like = records.iter().max_by_key(|r| r.longest_segment()).ok_or_else(unable)?;
    let at = |t: f64, out: &mut [f64]| track.inputs(t, out);
    let outside = starts.outside(measured_course, longest, &at).ok_or_else(unable)?;
    let own = twin::record(
        (&*equations.dynamics, parameters, starts.step_s),
        like,
        (stretch, bound),
        &state,
        outside,
        count,
        noise,
        settings.seed,
    )
    .ok_or_else(|| {
        BadInput::new("a solution that runs away", "a model whose motion stays finite")
            .at("--model")
            .remedy("Its parameters are not those of a rig at rest or in motion: identify the model anew")
    })?;
    let own_stretches = stretches::of(&own, rig, bound)?;
    let own_along = course(&own_stretches);
    let own_track = Track::new(&own_stretches, &own_along, rig, bound, noise);
    let own_course = Course { stretches: &own_stretches, track: &own_track };

    let hidden = ProgressBar::hidden();
    let bar = beside.progress.unwrap_or(&hidden);
    // Two inspections, the exponent and the orbits, beside the starts.
    bar.inc_length(STAGES);
    let horizon = starts.compare(measured_course, own_course, parameters, bar);
    let choice = InspectSettings::default();
    let simulated = inspect(&own, rig, &choice)?;
    bar.inc(1);
    let inspected = if beside.inspection.is_none() { Some(inspect(like, rig, &choice)?) } else { None };
    bar.inc(1);
    let measured = beside.inspection.or(inspected.as_ref()).ok_or_else(unable)?;
    let spaces = (&measured.phase_space, &simulated.phase_space);
    let sections = sections::compare(spaces.0, spaces.1, settings.seed);
    let lyapunov = rig.drive.and_then(|d| {
        let period_s = 1.0 / d.frequency_hz;
        let (of, start_s) = (&*equations.dynamics, stretch.start_s);
        let flow = Flow::new(of, parameters, Outside::drive(start_s, stretch.tau(0), omega), starts.step_s);
        let found = model_exponent::of_model(&flow, of, &mut state.clone(), start_s, period_s, 100, 3000)?;
        Some(ExponentComparison {
            model: found.per_interval / period_s,
            model_std_error: found.std_error / period_s,
            records: exponents(spaces.0.lyapunov.as_ref(), spaces.1.lyapunov.as_ref()),
        })
    });
    bar.inc(1);
    let orbits = starts.orbits(spaces, measured_course, parameters, MOST_ORBITS);
    bar.inc(1);
    let natural_frequencies = natural(model, rig, beside.free)?;
    let mut out = Validation {
        verdict: Verdict::Passed,
        checks: Vec::new(),
        model: model.name.clone(),
        method: model.method.clone(),
        simulated_s: count as f64 * stretch.step_s,
        horizon,
        sections,
        lyapunov,
        correlation_dimension: dimensions(spaces.0, spaces.1),
        orbits,
        natural_frequencies,
        bifurcation: diagram::diagram(&equations, settings, (stretch.tau(0), omega), (&state, &circle), starts.step_s)?,
        warnings,
    };
    if let Some(l) = &out.lyapunov
        && l.model > 3.0 * l.model_std_error
        && l.model > 0.0
    {
        let h = &out.horizon;
        out.horizon.median_lyapunov_times = Some([h.measured.median() * l.model, h.simulated.median() * l.model]);
    }
    out.checks = checks::checks(&out);
    if out.checks.iter().any(|c| !c.passed) {
        out.verdict = Verdict::Failed;
    }
    Ok(out)
}

/// What stands for the drive's period in a free pendulum, s.
const FREE_PERIOD_S: f64 = 0.2;
/// Fewest samples of a period.
const FEWEST_SAMPLES: f64 = 8.0;

/// The drive's period; in a free system of a user's own that of the highest frequency that the weak
/// form takes into account.
pub(crate) fn period_s(rig: &Rig, prepared: &Prepared) -> f64 {
    let windows = &prepared.geometry.windows;
    match (rig.drive, &rig.bound) {
        (Some(d), _) => 1.0 / d.frequency_hz,
        (None, None) => FREE_PERIOD_S,
        (None, Some(_)) => (windows.length_s / windows.frequencies as f64).max(FEWEST_SAMPLES / rig.sample_rate_hz),
    }
}

fn exponents(measured: Option<&Lyapunov>, simulated: Option<&Lyapunov>) -> Option<Pair> {
    let (a, b) = (measured?, simulated?);
    Some(Pair {
        measured: a.per_second,
        measured_std_error: a.std_error,
        simulated: b.per_second,
        simulated_std_error: b.std_error,
    })
}

fn dimensions(measured: &PhaseSpace, simulated: &PhaseSpace) -> Option<Pair> {
    let (a, b) = (measured.correlation_dimension.as_ref()?, simulated.correlation_dimension.as_ref()?);
    Some(Pair {
        measured: a.dimension?,
        measured_std_error: a.std_error,
        simulated: b.dimension?,
        simulated_std_error: b.std_error,
    })
}

fn natural(model: &IdentifiedModel, rig: &Rig, free: Option<&Record>) -> Result<Option<NaturalFrequencies>> {
    if !matches!(&model.system, System::BuiltIn(id) if id == "double-pendulum") {
        return match free {
            None => Ok(None),
            Some(record) => Err(BadInput::new(
                "a free vibration",
                "none: natural frequencies are known of the built-in double pendulum",
            )
            .in_file(&record.path)
            .at("--free")
            .remedy("Leave --free out")),
        };
    }
    let b = |n: &str| model.parameter(n).map(|p| p.value);
    let of_model = match (b("B11"), b("B12"), b("B21"), b("B22")) {
        (Some(b11), Some(b12), Some(b21), Some(b22)) => natural_frequencies::of_model(b11, b12, b21, b22, rig.omega()),
        _ => None,
    };
    let Some(model_hz) = of_model else { return Ok(None) };
    let measured =
        free.map(|record| natural_frequencies::of_record(record, &Rig { drive: None, ..rig.clone() })).transpose()?;
    Ok(Some(NaturalFrequencies { model_hz, measured_hz: measured.map(|m| m.0), resolution_hz: measured.map(|m| m.1) }))
}

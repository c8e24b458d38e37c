//! Whether an identified model moves as the measured system does.
//!
//! It works on every system that can be integrated: built-in ones with the effects that `explain`
//! found, and model files, measured inputs included.
//!
//! Two histories of a chaotic motion part, so the model makes a record of its own ([`twin`]: same
//! sensors, rate, drive), and what characterises the motion is compared side by side, found by the
//! same algorithms in both: prediction horizons ([`horizon`]), Poincaré sections, the record's
//! beside those of several records of the model ([`energy_distance`]), largest exponent, correlation
//! dimension, catalogue of periodic orbits (those of the record refined on the model), natural
//! frequencies (3.34) against a free vibration.
//!
//! The model fails its validation where one of these [`Check`]s fails:
//! - `prediction-horizon`: the median horizon on the record is less than 65 % of the median on the
//!   model's own record (half, with fewer than 30 starts);
//! - `prediction-error`: predictions over twice the fit, or to their end where those of the model's
//!   own record are followed so far, miss the record by more than twice what they miss that, in
//!   units of the sensors' noise (rms, median of the starts);
//! - `poincare-section`: the sections differ with a probability by chance below 1 % (over all
//!   phases together);
//! - `lyapunov-exponent`, `correlation-dimension`: the two records' values differ by more than
//!   three standard errors and by more than a third;
//! - `natural-frequencies` (with a free vibration): one differs by more than 10 %.

pub mod card;
mod checks;
pub mod comparisons;
mod diagram;
pub mod energy_distance;
pub mod horizon;
pub mod identified_equations;
pub mod natural_frequencies;
pub mod presentation;
pub mod result;
pub mod sections;
pub mod twin;

use core::f64::consts::TAU;

use indicatif::ProgressBar;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

use self::comparisons::{Beginning, Comparisons};
use self::identified_equations::IdentifiedEquations;
pub use self::result::{
    Bifurcation, Check, ExponentComparison, HorizonComparison, OrbitComparison, Orbits, Pair, Validation, Verdict,
};
use self::twin::Twin;
use crate::error::{BadInput, Result};
use crate::identify;
use crate::identify::Settings as IdentifySettings;
use crate::identify::stretches::{self, Stretch};
use crate::identify::track::{ExogenousInputs, Track};
use crate::inspect::{InspectSettings, Inspection, motion, motion_of};
use crate::model::identified::IdentifiedModel;
use crate::motion::starts::{MOST_STARTS, Pace, RecordTrack, period_s};
use crate::phase_space::poincare_section::Section;
use crate::phase_space::survey;
use crate::record::Record;
use crate::rig::{Rig, as_own};
use crate::wording::format::in_seconds;

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
    /// Seed of the noise in the records that the model makes. Default 1.
    pub seed: u64,
    /// Length of the windows by which a record is made ready, s; by default that of `identify`.
    pub window_s: Option<f64>,
    /// Parameter of a bifurcation diagram (`drive`: all of the base's motion), lowest and highest
    /// factor on its identified value.
    pub bifurcation: Option<(String, f64, f64)>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { tolerance_deg: 30.0, starts: MOST_STARTS, seed: 1, window_s: None, bifurcation: None }
    }
}

impl Settings {
    fn check(&self) -> Result<()> {
        if !(self.tolerance_deg > 0.0 && self.tolerance_deg <= 180.0) {
            let found = self.tolerance_deg.to_string();
            return Err(BadInput::new(found, "an angle above 0, at most 180").at("--tolerance-deg"));
        }
        if !(4..=10_000).contains(&self.starts) {
            return Err(BadInput::new(self.starts.to_string(), "4 to 10000").at("--starts"));
        }
        Ok(())
    }
}

/// What a validation may be given beside records and model.
#[derive(Clone, Copy, Default)]
pub struct Supplements<'a> {
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
    supplements: Supplements<'_>,
    settings: &Settings,
) -> Result<Validation> {
    settings.check()?;
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
    let omega = rig.drive.map_or(0.0, |d| TAU * d.frequency_hz);
    let course = |stretches: &[Stretch]| -> Vec<ExogenousInputs> {
        stretches.iter().map(|s| ExogenousInputs::new(s, omega)).collect()
    };
    let windows = IdentifySettings { window_s: settings.window_s, ..IdentifySettings::default() };
    let prepared = identify::prepare(records, rig, bound, &windows)?;
    let (stretches, noise) = (&prepared.stretches, &prepared.sensors);
    let equations = IdentifiedEquations::of(model, rig, stretches.first().map_or(0.0, |s| s.start_s))?;
    let mut warnings = prepared.warnings.clone();
    warnings.extend(equations.warning_of_what_is_left_out());
    let exogenous = course(stretches);
    let track = Track::new(stretches, &exogenous, rig, bound, noise);
    let measured = RecordTrack { stretches, track: &track };
    let pace = Pace { period_s: period_s(rig, &prepared), omega };
    let comparisons = Comparisons::new(&equations, measured, (rig, bound), pace, settings);

    let begin = comparisons.longest_stretch(measured).ok_or_else(unable)?;
    let like = records.iter().max_by_key(|r| r.longest_segment()).ok_or_else(unable)?;
    let twin = Twin { like, bound, noise, seed: settings.seed };
    let own = own_record(&comparisons, measured, &begin, &twin)?;
    let own_stretches = stretches::of(&own, rig, bound)?;
    let own_exogenous = course(&own_stretches);
    let own_track = Track::new(&own_stretches, &own_exogenous, rig, bound, noise);
    let simulated = RecordTrack { stretches: &own_stretches, track: &own_track };

    let hidden = ProgressBar::hidden();
    let bar = supplements.progress.unwrap_or(&hidden);
    // Two inspections, the exponent and the orbits, beside the starts.
    bar.inc_length(STAGES);
    let horizon = comparisons.compare(measured, simulated, bar);
    let choice = InspectSettings::default();
    let of_own = motion_of(&own, rig, &choice)?;
    bar.inc(1);
    let inspected = if supplements.inspection.is_none() { Some(motion_of(like, rig, &choice)?) } else { None };
    bar.inc(1);
    let of_record = supplements.inspection.or(inspected.as_ref()).ok_or_else(unable)?;
    let spaces = (&of_record.phase_space, &of_own.phase_space);
    let others = other_sections(&comparisons, measured, &begin, &twin, &of_own);
    let sections = sections::compare(spaces.0, spaces.1, &others, &of_record.coordinates);
    let records_exponents = Pair::of_exponents(spaces.0.lyapunov.as_ref(), spaces.1.lyapunov.as_ref());
    let lyapunov = comparisons.exponent(begin.stretch, &begin.state, records_exponents);
    bar.inc(1);
    let orbits = comparisons.orbits(spaces.0, spaces.1, measured, MOST_ORBITS);
    bar.inc(1);
    let natural_frequencies = natural_frequencies::compare(model, rig, supplements.free)?;
    let mut out = Validation {
        verdict: Verdict::Passed,
        checks: Vec::new(),
        model: model.name.clone(),
        method: model.method.clone(),
        simulated_s: own.segments.iter().map(|s| s.len()).sum::<usize>() as f64 * begin.stretch.step_s,
        horizon,
        sections,
        lyapunov,
        correlation_dimension: Pair::of_dimensions(spaces.0, spaces.1),
        orbits,
        natural_frequencies,
        bifurcation: diagram::diagram(&comparisons, begin.stretch.tau(0), &begin.state)?,
        warnings,
    };
    out.horizon.median_lyapunov_times = out.horizon.lyapunov_times(out.lyapunov.as_ref());
    out.checks = checks::checks(&out);
    if out.checks.is_empty() {
        return Err(nothing_begins(out.horizon.fit_s).in_file(&like.path));
    }
    if out.checks.iter().any(|c| !c.passed) {
        out.verdict = Verdict::Failed;
    }
    Ok(out)
}

/// Where no part of a record has room for a prediction, and nothing could be checked.
fn nothing_begins(fit_s: f64) -> BadInput {
    let expected = format!("one longer than twice the {} over which a state is fitted", in_seconds(fit_s));
    BadInput::new("no stretch in which a prediction begins", expected)
        .remedy("Record longer, or several times, or give a shorter window with --window-s")
}

fn unable() -> BadInput {
    BadInput::new("no solution of the model that follows the record's start", "a model identified on this record")
        .at("--model")
        .remedy("Identify the model anew")
}

/// Sections of further records of the model, each from a state that the sensors' noise does not tell
/// from the first one's: in chaos they part. None without a drive, or where one runs away.
fn other_sections(
    comparisons: &Comparisons<'_>,
    measured: RecordTrack<'_>,
    begin: &Beginning<'_>,
    twin: &Twin<'_>,
    of_own: &Inspection,
) -> Vec<Vec<Section>> {
    let (Some(drive), step_s) = (comparisons.drive(), begin.stretch.step_s) else { return Vec::new() };
    // Few: the cast cuts the fraction.
    let most = (energy_distance::MOST_PERIODS / (drive.frequency_hz * step_s)).ceil() as usize + 1;
    let has_inputs = !twin.bound.inputs.is_empty();
    let count = if has_inputs { most.min(begin.stretch.len()) } else { most }.min(MOST_SAMPLES);
    let noise = twin.noise.sigma.iter().copied().fold(f64::INFINITY, f64::min);
    let at = |t: f64, out: &mut [f64]| measured.track.inputs(t, out);
    let of = |k: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(k);
        let n = begin.state.len() / 2;
        let size = |i: usize| if i < n { noise } else { noise * drive.frequency_hz };
        let moved = begin.state.iter().enumerate().map(|(i, x)| x + size(i) * rng.random_range(-1.0..1.0));
        let begin = Beginning { state: moved.collect(), ..*begin };
        let outside = comparisons.outside(measured, begin.index, &at)?;
        let twin = Twin { seed: k, ..*twin };
        let record = twin.record(&comparisons.starts, &begin, outside, count)?;
        let (motions, choices) = (motion::motions(&record), InspectSettings::default().phase_space);
        Some(survey::sections(&record, &motions, &of_own.coordinates, Some(drive.frequency_hz), &choices))
    };
    let seeds = 1..energy_distance::RECORDS as u64;
    let all: Option<Vec<_>> = seeds.into_par_iter().map(|k| of(twin.seed.wrapping_add(k))).collect();
    all.unwrap_or_default()
}

/// The record that the model makes itself from the beginning of the longest stretch on: as long as
/// all stretches together, or as its inputs last.
fn own_record(
    comparisons: &Comparisons<'_>,
    measured: RecordTrack<'_>,
    begin: &Beginning<'_>,
    twin: &Twin<'_>,
) -> Result<Record> {
    let has_inputs = !twin.bound.inputs.is_empty();
    let all = if has_inputs { begin.stretch.len() } else { measured.stretches.iter().map(Stretch::len).sum() };
    let at = |t: f64, out: &mut [f64]| measured.track.inputs(t, out);
    let outside = comparisons.outside(measured, begin.index, &at).ok_or_else(unable)?;
    twin.record(&comparisons.starts, begin, outside, all.min(MOST_SAMPLES)).ok_or_else(|| {
        BadInput::new("a solution that runs away", "a model whose motion stays finite")
            .at("--model")
            .remedy("Its parameters are not those of a rig at rest or in motion: identify the model anew")
    })
}

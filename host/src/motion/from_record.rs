//! Where a simulation begins in a record: the state fitted to its samples, the drive's phase, the
//! measured inputs from there on.
//!
//! The state is the one from which the model follows the first two drive periods best (for a free
//! system, what stands for them: [`period_s`]), sensors weighed by their noise. What
//! effects add to sensors and inputs is taken off the whole stretch first ([`OfTheRecord`]), as an
//! explanation does: a sensor that is late shows the first state after it.

use super::starts::{MOST_STARTS, Pace, RecordTrack, Starts, period_s};
use super::{Acts, Motion};
use crate::error::{BadInput, Result};
use crate::identify::Settings as IdentifySettings;
use crate::identify::prepare;
use crate::identify::stretches::Stretch;
use crate::identify::taken_off::OfTheRecord;
use crate::identify::track::{ExogenousInputs, Track};
use crate::record::Record;
use crate::wording::format::instant;

/// Where a simulation begins.
pub struct Begin {
    /// Time, s.
    pub time: f64,
    /// Phase of the drive there, rad.
    pub tau: f64,
    /// Coordinates, then rates a second.
    pub state: Vec<f64>,
    /// Inputs from there on; none where the system has none, or where they are 0.
    pub inputs: Option<ExogenousInputs>,
    /// Length of the record from there on, s.
    pub left_s: f64,
    /// Spacing of the samples, s.
    pub step_s: f64,
}

/// The beginning at time `start_s` of a record, or at its first sample.
///
/// # Errors
/// A time that is in no stretch of it, a record that is too short, a motion that the model does not
/// follow.
pub fn begin(motion: &Motion, record: &Record, start_s: Option<f64>) -> Result<Begin> {
    let prepared = prepare(std::slice::from_ref(record), &motion.rig, &motion.bound, &IdentifySettings::default())?;
    let stretches = &prepared.stretches;
    let at = start_s.or(stretches.first().map(|s| s.start_s)).unwrap_or(0.0);
    let within = |s: &&Stretch| at >= s.start_s - 0.5 * s.step_s && at < s.time(s.len());
    let Some(stretch) = stretches.iter().find(within) else {
        let span =
            |s: &Stretch| format!("{} to {} s", instant(s.start_s, s.step_s), instant(s.time(s.len()), s.step_s));
        let spans: Vec<String> = stretches.iter().take(4).map(span).collect();
        return Err(BadInput::new(format!("{at} s"), format!("a time of the record, {}", spans.join(", ")))
            .in_file(&record.path)
            .at("--start")
            .remedy("Choose a time at which there are samples"));
    };
    // Half a step before the first sample at worst, and bounded by its length.
    let first = ((at - stretch.start_s) / stretch.step_s - 1e-6).ceil().max(0.0) as usize;
    let first = first.min(stretch.len().saturating_sub(1));
    let part = [of_the_record(motion).taken_off(stretch, &motion.bound).part(first, stretch.len())];
    let measured: Vec<f64> = part[0].coordinates.iter().map(|x| x[0]).collect();
    let omega = motion.omega().unwrap_or(0.0);
    let exogenous = [ExogenousInputs::new(&part[0], omega)];
    let track = Track::new(&part, &exogenous, &motion.rig, &motion.bound, &prepared.sensors);
    let followed = RecordTrack { stretches: &part, track: &track };
    let (equations, parameters) = motion.equations()?;
    let pace = Pace { period_s: period_s(&motion.rig, &prepared), omega };
    let starts = Starts::new(&equations, &parameters, followed, pace, MOST_STARTS);
    let mut state = starts.first_state(followed, 0).ok_or_else(|| {
        BadInput::new(
            format!("no solution of the model that follows the record from t = {at} s"),
            "a motion of this model",
        )
        .in_file(&record.path)
        .remedy("Begin elsewhere with --start, or give the model that was identified on this record")
    })?;
    // Pieces lose their whole turns.
    for (k, _) in motion.file.circle().into_iter().enumerate().filter(|c| c.1) {
        let turns = (measured[k] - state[k]) / core::f64::consts::TAU;
        state[k] += core::f64::consts::TAU * turns.round();
    }
    let [part] = &part;
    let inputs = (!part.inputs.is_empty()).then(|| ExogenousInputs::new(part, omega));
    let (time, tau) = (part.start_s, if omega == 0.0 { 0.0 } else { part.tau(0) });
    Ok(Begin { time, tau, state, inputs, left_s: part.len() as f64 * part.step_s, step_s: part.step_s })
}

/// What effects add to sensors and inputs. What runs ahead in the phase stands in the equations.
fn of_the_record(motion: &Motion) -> OfTheRecord {
    let mut out = OfTheRecord::default();
    for e in &motion.effects {
        match &e.acts {
            Acts::Sensor(k, laws) => out.sensor(*k, laws.iter().cloned()),
            Acts::Input(k, laws) => out.input(*k, laws.iter().cloned()),
            Acts::Motion(_) | Acts::Drive(_) => {}
        }
    }
    out
}

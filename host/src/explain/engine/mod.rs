//! Explanations for any system of bodies or written equations: every effect of the catalogue at
//! every joint, pair of coordinates, arm, encoder, at its drive and frame.
//!
//! The equations without dampings and the nominal dampings, tied over the equations, are fitted by
//! shooting (`shooting`), by the weak form where the model follows no window; every candidate is
//! added in turn and judged on blocks that were not fitted (`crate::explain::decision`); the best
//! is added until nothing more is supported. Effects of sensors and of the drive's phase are taken
//! off the record, which is then read again.
//!
//! | file | what |
//! |---|---|
//! | `setting` | the record, its sensors, the system |
//! | `candidates` | effects at their places, their columns |
//! | `memory` | effects with states of their own |
//! | `offered` | candidates beside a state of the model |
//! | `state` | coefficients and what was added |
//! | `run`, `search`, `chosen` | from the first fit to the verdict, effect by effect |
//! | `expected` | what a record that the model makes would tell |
//! | `exchange` | one effect in the place of another |
//! | `design` | columns over all windows of the weak form |
//! | `shooting` | columns of trajectories |
//! | `frames` | frequencies at which the frame gives way |
//! | `moved_forms` | shape parameters between those of the grid |
//! | `evidence` | one fit and one choice over either |
//! | `simulation` | free runs beyond what was fitted |
//! | `last_fit` | coefficients by simulations as long as tell the most |
//! | `given` | a model to start from or to predict with |
//! | `prediction` | the gap, free runs |
//! | `compared` | the gap as one picture |
//! | `forecast`, `attractor` | the last 30 %, how long predictions hold, Poincaré sections |
//! | `power` | what noise alone leaves, what sensors alone feign |
//! | `residual`, `residual_map` | where what is left sits |
//! | `axes` | coordinates that it is looked at against |
//! | `changed` | what changed in the middle of a record |
//! | `outliers` | samples that stand alone |
//! | `patched`, `pieces` | a shape put together from several effects |
//! | `relaxation` | how far inertias go from round to round |
//! | `dying` | motions that are over |
//! | `tell`, `units` | values, units, the model |
//! | `tones` | frequencies of what runs in the laboratory's time |
//! | `unknown` | the shape of what has no name |

pub mod attractor;
mod axes;
mod candidates;
mod cautions;
pub mod changed;
mod chosen;
pub mod compared;
pub mod design;
mod dying;
mod evidence;
mod exchange;
pub mod expected;
mod followed_on;
mod forecast;
mod frames;
mod free_run;
pub mod given;
mod last_fit;
mod memory;
mod moved_forms;
mod offered;
pub mod outliers;
mod patched;
mod pieces;
mod power;
mod prediction;
mod relaxation;
mod residual;
pub mod residual_map;
mod run;
mod search;
mod setting;
mod shooting;
pub mod simulation;
mod state;
mod tell;
mod tones;
mod traces;
pub(super) mod units;
pub mod unknown;

use self::evidence::Outcome;
use self::run::Run;
use self::setting::{Begun, Lines, Physical, Setting};
use self::shooting::Coloured;
use self::state::{Chosen, State};
use super::decidability::{FEWEST_BLOCKS, Length, WORST_CONDITION, locked, too_few};
use super::explanation::Explanation;
use super::{MOST_WINDOWS, Reason, Settings, Undecidable, ranking};
use crate::error::Result;
use crate::identify::Identification;
use crate::identify::remeasured::Sensors;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::steps;

/// An explanation, or the sensors' noise with which it is to be made again.
enum Attempt {
    Done(Option<Box<Explanation>>),
    Quieter(Sensors),
    /// Of which sensors it is coloured.
    Coloured(Sensors, Vec<Coloured>),
}

/// Most attempts: once more where the model leaves less than was taken for the noise, once more
/// where that is coloured.
const ATTEMPTS: usize = 3;

/// Explains records of a rig; none where effects find no place in its equations.
///
/// # Errors
/// As [`crate::identify::identify`].
pub fn explain(
    records: &[Record],
    rig: &Rig,
    whole: &ObservedModel,
    settings: &Settings,
) -> Result<Option<Explanation>> {
    let (mut sensors, mut told) = (None, Vec::new());
    // What is told is in units of the noise: once more from the beginning where the model found
    // leaves less than was taken for it, or what it leaves is noise that was not seen.
    for k in 1..=ATTEMPTS {
        let last = k == ATTEMPTS || !told.is_empty();
        match attempt(records, rig, whole, settings, sensors, last)? {
            Attempt::Done(result) => {
                return Ok(result.map(|mut r| {
                    r.warnings.extend(units::coloured(rig, whole, &told));
                    *r
                }));
            }
            Attempt::Quieter(found) => sensors = Some(found),
            Attempt::Coloured(found, of) => (sensors, told) = (Some(found), of),
        }
    }
    Ok(None)
}

/// One attempt, with the sensors' noise if it is known better than by their spectra; the last
/// stands whatever it leaves.
fn attempt(
    records: &[Record],
    rig: &Rig,
    whole: &ObservedModel,
    settings: &Settings,
    sensors: Option<Sensors>,
    last: bool,
) -> Result<Attempt> {
    let Some(Begun { mut setting, first, physical, warnings }) =
        Setting::begin(records, rig, whole, MOST_WINDOWS, &settings.weak)?
    else {
        return Ok(Attempt::Done(None));
    };
    if let Some(sensors) = sensors {
        setting.sensors = sensors;
    }
    let Some(mut state) = start(&setting, &first, physical) else { return Ok(Attempt::Done(None)) };
    let horizon_s = units::horizon(rig, settings, &setting.raw, setting.geometry.period_s)?;
    setting.room = (horizon_s * rig.sample_rate_hz).round() as usize + 1;
    let mut result = Explanation::new(horizon_s, warnings);
    result.warnings.extend(units::unknown(rig, whole));
    if let Some(model) = &settings.model {
        given::take(&setting, &mut state, model)?;
    }
    // Some are held back of every fit, which is none of fewer: whether the model follows the record
    // is not known then.
    let (most, block_s) = shooting::most_blocks(&setting, &state);
    if setting.rig.drive.is_none() && most < ranking::FOLDS {
        result.reason = Reason::Undecidable(few(&setting, records, most, block_s));
        return Ok(Attempt::Done(Some(Box::new(result))));
    }
    let given = settings.model.is_some().then(|| state.clone());
    steps::tell("following the record with the model as it is");
    if !settled(&mut setting, &mut state) {
        result.reason = Reason::Undecidable(Undecidable::Unfollowed);
        return Ok(Attempt::Done(Some(Box::new(result))));
    }
    // Whole windows of the balance of forces, from which everything starts, may be fewer: those of
    // trajectories are shorter.
    let (blocks, window_s) = whole_windows(&setting, &state);
    if blocks < ranking::FOLDS {
        result.reason = Reason::Undecidable(few(&setting, records, blocks, window_s));
        return Ok(Attempt::Done(Some(Box::new(result))));
    }
    let undecidable = undecidable(&setting, records, &first, blocks, window_s);
    let mut run = Run::new(setting, state, result, window_s, settings);
    if let Some(given) = given {
        let fitted = core::mem::replace(&mut run.told.state, given);
        run.as_given();
        run.told.state = fitted;
    }
    let outcome = run.search(undecidable.is_some(), settings)?;
    let quieter = || shooting::quieter(&run.setting, &run.told.state);
    if let Some(sensors) = (!last && outcome.evidence.is_shooting()).then(quieter).flatten() {
        return Ok(Attempt::Quieter(sensors));
    }
    let outcome = run.without_pieces(outcome);
    run.tell_twins(&outcome);
    let noise =
        (!last && outcome.evidence.is_shooting()).then(|| shooting::coloured(&run.setting, &run.told.state)).flatten();
    steps::tell("measuring what is left");
    let result = run.finish(&outcome, &first, undecidable)?;
    Ok(match noise.filter(|_| matches!(result.reason, Reason::Excess { shape: None, .. })) {
        Some((sensors, of)) => Attempt::Coloured(sensors, of),
        None => Attempt::Done(Some(Box::new(result))),
    })
}

/// The model before anything is added, fitted in windows as long as can be followed; where there is
/// none the balance of forces is left. False where that cannot hold it.
fn settled(setting: &mut Setting<'_>, state: &mut State) -> bool {
    let mut settled = shooting::settle(setting, state);
    if settled.is_none() && setting.blocks < shooting::BLOCKS {
        // A short record that is not followed as a whole.
        setting.blocks = shooting::BLOCKS;
        settled = shooting::settle(setting, state);
    }
    if let Some(sensors) = settled.as_ref().and_then(|_| shooting::quieter(setting, state)) {
        setting.sensors = sensors;
        settled = shooting::settle(setting, state);
    }
    let mut steps = shooting::Steps::default();
    while let (Some(_), Some(points)) = (&settled, steps.next(setting, state)) {
        let before = (setting.points, state.clone());
        setting.points = points;
        let Some(finer) = shooting::settle(setting, state) else {
            (setting.points, *state) = before;
            break;
        };
        settled = Some(finer);
    }
    if let Some((x, covariance)) = settled {
        // The paths go with these coefficients: from others a chaotic window may be led astray.
        state.take(setting, &x);
        state.renew(setting, &x, &covariance);
        return true;
    }
    // What no window can be followed in is left to the balance of forces.
    setting.shooting = false;
    setting.own.names.len() <= setting.model().coefficients().len()
}

/// The state before anything is added; none where a nominal damping is not in the catalogue.
fn start(setting: &Setting<'_>, first: &Identification, physical: Physical) -> Option<State> {
    let file = setting.file()?;
    let of_file: Vec<String> = file.nominal.iter().map(|n| n.value.clone()).collect();
    // Written equations hold their dampings as terms.
    let names = setting.rig.nominal.as_ref().filter(|_| !setting.is_written()).unwrap_or(&of_file);
    let all = setting.candidates_of(&physical, &Lines::default(), &|name| names.iter().any(|n| n == name));
    let chosen: Vec<Chosen> = names
        .iter()
        .map(|n| {
            let candidate = all.iter().find(|c| c.name(setting) == *n)?.clone();
            Some(Chosen { strengths: vec![0.0; candidate.strengths()], candidate })
        })
        .collect::<Option<_>>()?;
    let value = |n: &String| first.parameter(n).map_or(0.0, |p| p.value);
    Some(State {
        values: setting.own.names.iter().map(value).collect(),
        physical,
        dampings: chosen.len(),
        nominal: chosen.len(),
        chosen,
        stretches: setting.raw.clone(),
        gains: vec![1.0; setting.bound.sensors.len()],
        relaxation: relaxation::Relaxation::default(),
        moved_in_vain: Vec::new(),
        followed: None,
    })
}

/// Whole windows in the record, or what is held out of them, and their length, s.
fn whole_windows(setting: &Setting<'_>, state: &State) -> (usize, f64) {
    if let (true, Some(followed)) = (setting.shooting, &state.followed) {
        let (count, length_s) = followed.blocks(setting);
        let step_s = setting.raw.first().map_or(1.0, |s| s.step_s);
        // Predictions are made within the shortest block of a window that is cut.
        return (count, (length_s / step_s + 1e-6).floor() * step_s);
    }
    let window_s = setting.geometry.windows.length_s;
    (setting.raw.iter().map(|s| (s.len() as f64 * s.step_s / window_s) as usize).sum(), window_s)
}

/// What the records have of the motion.
fn length(setting: &Setting<'_>, records: &[Record]) -> Length {
    Length::of(records, setting.raw.iter().map(|s| s.len() as f64 * s.step_s).sum())
}

/// So many windows are too few.
fn few(setting: &Setting<'_>, records: &[Record], blocks: usize, window_s: f64) -> Undecidable {
    let length = (!dying::is_over(setting, blocks)).then(|| length(setting, records));
    too_few(blocks, window_s, !setting.shooting, length)
}

/// Why this record cannot decide, if it cannot.
fn undecidable(
    setting: &Setting<'_>,
    records: &[Record],
    first: &Identification,
    blocks: usize,
    window_s: f64,
) -> Option<Undecidable> {
    if !records.is_empty() && records.iter().all(|r| locked(r, setting.rig)) {
        return Some(Undecidable::Locked);
    }
    if blocks < FEWEST_BLOCKS {
        // Whole windows of the balance of forces are long; trajectories would do with shorter ones.
        return Some(few(setting, records, blocks, window_s));
    }
    // Rows of the weak form are judged equation by equation; written equations may hold what is
    // hardly separable on purpose.
    let rows = !setting.shooting && !setting.is_written();
    (rows && first.details.condition.iter().any(|k| *k > WORST_CONDITION)).then_some(Undecidable::Poor)
}

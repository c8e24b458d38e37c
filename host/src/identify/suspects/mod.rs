//! Suspects that the equations show: what undone makes the record fit them.
//!
//! A channel exchanged, reversed, relative, scaled, in another unit, late or on a clock of its
//! own, a drive of another frequency or direction, time reversed: each leaves a residual far above
//! the sensors' noise, as a missing effect does. It is told from one by undoing it (`undo`):
//! where the equations, refitted, then leave (nearly) nothing (`scene`, `find`), the mistake
//! is named. What leaves the residual as it is shows in the coefficients: friction that feeds the
//! motion (`arrow`), a drive in another direction (`direction`).
//!
//! Limits: one mistake at a time; the first `WINDOWS` windows are looked at, of the length that an
//! identification of the record has; what the equations cannot tell stays silent (the scale of a
//! linear system's channel, both signs of a symmetric pendulum reversed, a delay of a single
//! channel, which is another phase of the drive).

mod arrow;
mod direction;
mod find;
mod hypotheses;
mod input_sign;
mod scan;
mod scene;
mod tell;
mod undo;

use indicatif::ProgressBar;

use crate::error::BadInput;
use crate::identify::geometry::drive_window_s;
use crate::identify::prepared::{Geometry, prepare_moving};
use crate::identify::{Identification, Settings, built_in};
use crate::inspect::standing_line;
use crate::record::Record;
use crate::rig::{Direction, Drive, Rig};
use crate::warning::Warning;
use arrow::NamedCoefficient;
use scene::Scene;

pub(crate) use hypotheses::COUNTS;
pub use scan::drive_frequencies;
pub(super) use tell::explains;

/// Most windows that are looked at.
const WINDOWS: usize = 64;
/// Windows on which everything is tried.
const FEW: usize = 12;
/// Hops beyond them: a window is two long, the low-pass reaches over the rest.
const REACH: usize = 4;
/// Most samples of a free system's records that tell how its motion is: the rest of a day tells
/// nothing else, and takes its memory.
const MOST_SAMPLES: f64 = 300_000.0;
/// Share of the test frequencies of a free motion on which readings compare, and fewest of them.
const LOWER: f64 = 0.5;
const FEWEST_FREQUENCIES: f64 = 8.0;
/// Standard errors within which a lag is none: beyond by chance once in fifteen thousand.
const CLEAR: f64 = 4.0;
/// ln of residual over noise power from which something is looked for: clean records of the
/// shipped rigs stay below half of it.
const CLEAN: f64 = 0.4;
/// Relative difference between the stated frequency or rate and the device's or the record's own,
/// from which it is told: coefficients go with the square of the frequency, and are known to some
/// 1e-4.
const PHASE: f64 = 1e-4;
pub(crate) const RATE: f64 = 1e-3;

fn no_equations(rig: &Rig) -> BadInput {
    BadInput::new(format!("\"{}\"", rig.model), "a system with equations").in_file(&rig.path).at("model")
}

/// How well the equations of a rig fit the beginning of a record, as the mean of ln(residual/noise
/// power) (0: as well as the sensors allow); none where they cannot be fitted. Of two readings of
/// one record it speaks for the lower.
pub fn misfit(record: &Record, rig: &Rig, on: &Footing) -> Option<f64> {
    let scene = Scene::in_windows(core::slice::from_ref(record), rig, &on.settings).ok()?.first(WINDOWS);
    scene.misfit().map(|m| m.log).filter(|m| m.is_finite())
}

/// Windows, test functions and low-pass on which readings of one record compare: those that its
/// motion alone asks for. A drive's own follow from its frequency, and a misfit over short windows
/// of fast test functions, in which noise is most, says nothing beside one over long ones.
#[derive(Clone, Debug)]
pub struct Footing {
    settings: Settings,
}

impl Footing {
    /// Highest test frequency, Hz.
    pub fn top_hz(&self) -> Option<f64> {
        self.settings.max_frequency_hz
    }

    /// That of a record, whatever drives it; none where it has no equations or is too short.
    pub fn of(record: &Record, rig: &Rig) -> Option<Self> {
        let own = built_in::written(rig).ok()?;
        let bound = own.bound.clone()?;
        let all = core::slice::from_ref(record);
        let free = Rig { drive: None, ..own.into_owned() };
        let Geometry { windows, .. } = prepare_moving(all, &free, &bound, &Settings::default()).ok()?.geometry;
        // The upper half of what a free motion shows is mostly noise, which a mean over frequencies
        // takes as a good fit; and a low-pass as wide brings it into products at all of them.
        let top_hz = (LOWER * windows.frequencies as f64 / windows.length_s)
            .max(FEWEST_FREQUENCIES / windows.length_s)
            .min(record.sample_rate_hz / 8.0);
        let asked =
            Settings { window_s: Some(windows.length_s), max_frequency_hz: Some(top_hz), ..Settings::default() };
        let drive = Drive { direction: Direction::Vertical, frequency_hz: top_hz, amplitude_m: None };
        let driven = Rig { drive: Some(drive), ..free };
        let Geometry { kernels, .. } = prepare_moving(all, &driven, &bound, &asked).ok()?.geometry;
        Some(Self { settings: Settings { pass_hz: Some(kernels.full.pass_hz), ..asked } })
    }
}

/// Suspects of records of a rig; none where the rig's equations cannot be identified from them.
pub fn examine(records: &[Record], rig: &Rig) -> Vec<Warning> {
    // Equations say nothing of a record that is at fault itself: a dead channel would be told as
    // another scale.
    if records.iter().flat_map(|r| &r.warnings).any(|w| w.invalidates) {
        return Vec::new();
    }
    let mut out = stated(records, rig);
    if out.iter().any(|w| w.invalidates) {
        return out;
    }
    let Some(scene) = first_windows(records, rig, WINDOWS) else { return out };
    let Some(base) = scene.misfit() else { return out };
    let names = scene.names();
    let values = base.coefficients.iter().flat_map(|c| c.iter());
    let known: Vec<NamedCoefficient<'_>> = names
        .iter()
        .zip(values.zip(&base.std_errors))
        .map(|(name, (value, std_error))| NamedCoefficient { name, value: *value, std_error: *std_error })
        .collect();
    out.extend(by_coefficients(&scene.rig, &known));
    if base.log > CLEAN {
        out.extend(records.first().and_then(|r| standing_line::not_stated(r, rig)));
    }
    if !out.iter().any(|w| w.invalidates)
        && base.log > CLEAN
        && let Some(found) = find::find(&scene, &base)
        && !is_stated(&scene, &found)
        && find::is_whole(&scene, &found)
    {
        out.push(tell::tell(&scene, &base, &found));
    }
    out
}

/// Blocks of the weak form below which its residuals' scatter is known too little for what is far
/// off to be told (Student's t at [`super::judgement`]'s chance is 9.7 standard errors for twelve, 49
/// for five): multiple shooting has more of them.
const FEW_BLOCKS: usize = 12;

/// What the rig file takes as known, or states of the drive's amplitude, against what the first
/// part of a record shows; nothing where that cannot be identified.
pub fn known(record: &Record, rig: &Rig) -> Vec<Warning> {
    if rig.known.is_empty() && rig.drive.is_none_or(|d| d.amplitude_m.is_none()) {
        return Vec::new();
    }
    let all = core::slice::from_ref(record);
    let Some(scene) = first_windows(all, rig, WINDOWS) else { return Vec::new() };
    let part = beginning(all, seconds_of(WINDOWS, scene.geometry.windows.hop_s));
    let Ok(mut found) = super::weak_form(&part, rig, &super::Settings::default()) else { return Vec::new() };
    if found.details.jackknife_blocks < FEW_BLOCKS {
        let shot = super::best::best(all, rig, &Settings::default(), &Default::default(), &ProgressBar::hidden());
        found = shot.unwrap_or(found);
    }
    let amplitude = super::stated_amplitude::contradicted(&part, rig, &found);
    let contradicted = found.warnings.into_iter().filter(|w| w.id == super::known_quantities::CONTRADICTED);
    contradicted.chain(amplitude).collect()
}

/// Whether it says what the rig file does: the number of counts that it has, to which a scale is so
/// near, or a lag that may be none.
fn is_stated(scene: &Scene, found: &find::Finding) -> bool {
    match &found.undo {
        undo::Undo::Scale(list, factor) => {
            let channels = hypotheses::channels(scene);
            let stated = |i: &usize| channels[*i].counts_per_turn.map(f64::from);
            list.iter().all(|i| stated(i).is_some_and(|n| (factor * n).round() == n))
        }
        undo::Undo::Lag { delay_s, drift, .. } => {
            let may_be_none = |(x, error): (&f64, &f64)| x.abs() <= CLEAR * error;
            !found.errors.is_empty() && [*delay_s, *drift].iter().zip(&found.errors).all(may_be_none)
        }
        _ => false,
    }
}

/// The same after an identification: the record is looked at again only where the residual or a
/// coefficient calls for it.
pub fn after(records: &[Record], rig: &Rig, result: &Identification) -> Vec<Warning> {
    let known: Vec<NamedCoefficient<'_>> = result
        .parameters
        .iter()
        .map(|p| NamedCoefficient { name: &p.name, value: p.value, std_error: p.std_error })
        .collect();
    let fits = result.within_bound() && result.details.residual_over_noise.is_some_and(|ratio| ratio.ln() < CLEAN);
    let plausible = |own: Rig| {
        let feeds = own.bound.as_ref().is_some_and(|b| arrow::feeds(&b.model, own.omega(), &known));
        let input = own.bound.as_ref().and_then(|b| input_sign::reversed(&own, b, &known));
        !feeds && input.is_none() && direction::other(&own, &known).is_none()
    };
    if fits && super::built_in::written(rig).is_ok_and(|own| plausible(own.into_owned())) {
        return stated(records, rig);
    }
    let mut out = examine(records, rig);
    if !out.iter().any(|w| w.invalidates)
        && let Ok(own) = super::built_in::written(rig)
        && let Some(bound) = &own.bound
    {
        // A few windows say less than all of them.
        out.extend(input_sign::reversed(&own, bound, &known));
    }
    out
}

/// What coefficients say without any residual.
fn by_coefficients(own: &Rig, known: &[NamedCoefficient<'_>]) -> Vec<Warning> {
    let Some(bound) = &own.bound else { return Vec::new() };
    let mut out = Vec::new();
    if let Some(names) = arrow::reversed(&bound.model, own.omega(), known) {
        let (who, verb) = (names.join(", "), if names.len() == 1 { "feeds" } else { "all feed" });
        out.push(
            Warning::new(
                "time-reversed",
                format!("the record runs backwards in time: its friction ({who}) {verb} the motion instead of taking energy"),
                "Put the rows in the order in which they were taken; if they are, a friction's sign or a term of the model is wrong",
            )
            .with("parameters", names)
            .invalidating(),
        );
    }
    if out.is_empty() {
        out.extend(input_sign::reversed(own, bound, known));
    }
    out.extend(direction::other(own, known));
    out
}

/// What the rig file says against what the record itself does, without equations.
fn stated(records: &[Record], rig: &Rig) -> Vec<Warning> {
    let mut out = Vec::new();
    let measured = records.iter().find_map(crate::inspect::drive_check::phase_frequency).filter(|f| *f > 0.0);
    if let (Some(drive), Some(value)) = (rig.drive, measured)
        && (value / drive.frequency_hz - 1.0).abs() > PHASE
    {
        out.push(
            Warning::new(
                "drive-frequency",
                format!("the device drove at {value:.5} Hz, the rig file says {} Hz", drive.frequency_hz),
                format!("Set drive.frequency_hz = {value:.5} in the rig file"),
            )
            .with("stated_hz", drive.frequency_hz)
            .with("value_hz", value)
            .invalidating(),
        );
    }
    if let Some(record) = records.iter().find(|r| (r.sample_rate_hz / rig.sample_rate_hz - 1.0).abs() > RATE) {
        out.push(
            Warning::new(
                "rate-differs",
                format!(
                    "the record is sampled at {:.6} Hz, the rig file says {:.6} Hz",
                    record.sample_rate_hz, rig.sample_rate_hz
                ),
                "The record's own times are used; correct sample_rate_hz in the rig file, or the times",
            )
            .with("stated_hz", rig.sample_rate_hz)
            .with("value_hz", record.sample_rate_hz),
        );
    }
    out.extend(direction::impossible(rig));
    out
}

/// The first windows of records, as long as an identification's. A drive fixes their length, so
/// that no more of the records than these is made ready; that of a free system follows from its
/// motion, and the whole record tells it: seconds would be one or two swings of a slow pendulum.
fn first_windows(records: &[Record], rig: &Rig, windows: usize) -> Option<Scene> {
    let scene = match rig.drive {
        Some(drive) => Scene::new(&beginning(records, seconds_of(windows, 0.5 * drive_window_s(drive))), rig),
        None => Scene::new(&beginning(records, MOST_SAMPLES / rig.sample_rate_hz), rig),
    };
    scene.ok().map(|s| s.first(windows))
}

/// Seconds that hold so many windows, each `hop_s` after the one before, and the low-pass's reach.
fn seconds_of(windows: usize, hop_s: f64) -> f64 {
    (windows + REACH) as f64 * hop_s
}

/// The first seconds of records.
fn beginning(records: &[Record], seconds: f64) -> Vec<Record> {
    let mut left = seconds;
    let mut out = Vec::new();
    for record in records {
        let mut segments = Vec::new();
        for s in &record.segments {
            let n = ((left / s.step_s).max(0.0) as usize).min(s.len());
            if n == 0 {
                break;
            }
            left -= n as f64 * s.step_s;
            segments.push(s.rows(0..n));
        }
        if segments.is_empty() {
            break;
        }
        out.push(Record {
            path: record.path.clone(),
            sample_rate_hz: record.sample_rate_hz,
            channels: record.channels.clone(),
            segments,
            losses: record.losses.clone(),
            ..Record::default()
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::record::{Column, Segment};

    /// φ̈ = −φ̇ c − b sin φ for 2000 s, with a period of ten where it swings little, 20 samples a
    /// second and noise of 0.03 rad; a slower pendulum has the same samples at other times.
    fn free_pendulum(rig: &Rig, slower: f64, friction: f64) -> Record {
        let (b, step) = ((core::f64::consts::TAU / 10.0).powi(2), 0.05);
        let rate = |[q, v]: [f64; 2]| [v, -friction * v - b * q.sin()];
        let along = |[q, v]: [f64; 2], [dq, dv]: [f64; 2], h: f64| [q + h * dq, v + h * dv];
        let mut state = [1.4, 0.0];
        let mut seed = 7_u32;
        let mut noise = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.1 * (f64::from(seed >> 8) / f64::from(1 << 24) - 0.5)
        };
        let shown = (0..40_000).map(|_| {
            let now = state[0] + noise();
            let k1 = rate(state);
            let k2 = rate(along(state, k1, 0.5 * step));
            let k3 = rate(along(state, k2, 0.5 * step));
            let k4 = rate(along(state, k3, step));
            let sum = |i: usize| (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0;
            state = along(state, [sum(0), sum(1)], step);
            now
        });
        let segment = Segment::new(0.0, slower * step, vec![Column::Values(shown.collect())]);
        Record { sample_rate_hz: 1.0 / segment.step_s, ..Record::of("r.csv", rig, vec![segment]) }
    }

    fn rig(slower: f64) -> Rig {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs");
        let mut rig = Rig::read(folder.join("measured-single-pendulum-viscous.toml")).unwrap();
        rig.sample_rate_hz = 20.0 / slower;
        rig
    }

    /// A friction so faint that one or two swings do not tell its sign.
    const FAINT: f64 = 3e-4;

    #[test]
    fn a_slow_pendulum_is_looked_at_over_windows_of_its_own() {
        for slower in [1.0, 10.0] {
            let rig = rig(slower);
            let mut record = free_pendulum(&rig, slower, FAINT);
            assert_eq!(examine(core::slice::from_ref(&record), &rig), []);
            let on = Footing::of(&record, &rig).unwrap();
            let log = misfit(&record, &rig, &on).unwrap();
            assert!(log.abs() < CLEAN, "{slower}: {log}");
            if let Column::Values(shown) = &mut record.segments[0].columns[0] {
                shown.reverse();
            }
            let told = examine(core::slice::from_ref(&record), &rig);
            assert_eq!(told.iter().map(|w| w.id).collect::<Vec<_>>(), ["time-reversed"], "{slower}");
            // 34 windows of 4 s do not show it.
            assert_eq!(examine(&beginning(core::slice::from_ref(&record), 136.0), &rig), [], "{slower}");
        }
    }

    #[test]
    fn records_beyond_the_first_windows_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let model = std::fs::read_to_string(repository.join("models/viscous-pendulum.toml")).unwrap();
        let own = model.replace("terms = { ", "terms = { offset = { of = \"1\", each = \"record\" }, ");
        std::fs::write(folder.path().join("own.toml"), own).unwrap();
        let text = "name = \"p\"\nmodel = \"own.toml\"\nsample_rate_hz = 20.0\n[[channel]]\nname = \"phi1\"\nmeasures = \"phi1\"\nunit = \"rad\"\n";
        let file = folder.path().join("rig.toml");
        std::fs::write(&file, text).unwrap();
        let rig = Rig::read(&file).unwrap();
        let records = [free_pendulum(&rig, 1.0, FAINT), free_pendulum(&rig, 1.0, FAINT)];
        let scene = first_windows(&records, &rig, FEW).unwrap();
        assert!(scene.names().iter().any(|n| n == "offset"), "{:?}", scene.names());
        assert!(scene.misfit().unwrap().log.abs() < CLEAN);
    }
}

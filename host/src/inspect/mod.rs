//! What a record holds, before anything is identified from it: rates, losses, ranges, noise,
//! spectra, the drive's line, whether it repeats. Everything comes from the displacements alone.
//!
//! Embedding, Lyapunov exponents and the like are `phase_space`'s, run from here.

pub mod coordinate;
pub mod drive_check;
pub mod motion;
pub mod periodicity;
pub mod plots;
pub mod standing_line;
pub mod strongest;
pub mod summary;
pub mod text;

use serde::Serialize;

use crate::error::{BadInput, Result};
use crate::identify::boots;
use crate::identify::prepared::broken_by;
use crate::model::MODELS;
use crate::phase_space::survey::{self, PhaseSpace};
use crate::record::Record;
use crate::reduce::systems::SYSTEMS;
use crate::rig::Rig;
use crate::suspects::slipped;
use crate::warning::Warning;
use crate::wording::format::{in_seconds, shortest};
use coordinate::Coordinate;
use drive_check::DriveCheck;
use periodicity::{Kind, Periodicity};
use plots::Plots;
use summary::RecordSummary;

/// Choices of an inspection.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InspectSettings {
    /// Window that one unbroken stretch must hold, drive periods (driven systems). Default 20.
    pub window_periods: f64,
    /// The same for free systems, samples. Default 64.
    pub window_free: f64,
    /// Tolerance of the search for a period, fraction of the span. Default 0.02.
    pub period_tolerance: f64,
    /// Length of the beginning that plots show sample by sample, drive periods. Default 20.
    pub start_periods: f64,
    /// The same for free systems, s. Default 8.
    pub start_free_s: f64,
    /// Choices of the phase space's part.
    pub phase_space: survey::Settings,
}

impl Default for InspectSettings {
    fn default() -> Self {
        Self {
            window_periods: 20.0,
            window_free: 64.0,
            period_tolerance: 0.02,
            start_periods: 20.0,
            start_free_s: 8.0,
            phase_space: survey::Settings::default(),
        }
    }
}

impl InspectSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the field, its value and what it may be.
    pub fn validate(&self) -> Result<()> {
        self.phase_space.validate()?;
        for (name, value, least, most) in [
            ("window_periods", self.window_periods, 1.0, 1e6),
            ("window_free", self.window_free, 16.0, 1e9),
            ("period_tolerance", self.period_tolerance, 1e-6, 0.5),
            ("start_periods", self.start_periods, 1.0, 1e6),
            ("start_free_s", self.start_free_s, 1e-6, 1e6),
        ] {
            if !(value >= least && value <= most) {
                return Err(BadInput::new(value.to_string(), format!("a value from {least} to {most}")).at(name));
            }
        }
        Ok(())
    }
}

/// Result of [`inspect`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// Rates, lengths, losses, timing.
    pub record: RecordSummary,
    /// Measured coordinates in the channels' order, then derived absolute angles.
    pub coordinates: Vec<Coordinate>,
    /// The rig file's drive against the record; none for a free system.
    pub drive: Option<DriveCheck>,
    /// Whether the record repeats.
    pub periodicity: Periodicity,
    /// What was noticed, the reader's warnings first.
    pub warnings: Vec<Warning>,
    /// Delays, dimensions, sections, exponent, periodic orbits.
    pub phase_space: PhaseSpace,
    /// Points for figures, in the coordinates' order.
    pub plots: Vec<Plots>,
}

/// Inspects a record, and holds it against the equations of its rig.
///
/// # Errors
/// As [`motion_of`].
pub fn inspect(record: &Record, rig: &Rig, settings: &InspectSettings) -> Result<Inspection> {
    let mut out = motion_of(record, rig, settings)?;
    let kept = boots::of_known_zero(std::slice::from_ref(record)).0;
    against_equations(&mut out.warnings, &kept[0], rig);
    Ok(out)
}

/// Warnings of what the equations of a rig show in its record.
fn against_equations(warnings: &mut Vec<Warning>, record: &Record, rig: &Rig) {
    for suspect in crate::identify::suspects::examine(std::slice::from_ref(record), rig) {
        // What the equations say of the drive or the rate is sharper than a line of a spectrum.
        warnings.retain(|w| w.id != suspect.id);
        warnings.push(suspect);
    }
    // A mistake of the rig file would be told as quantities that are wrong.
    if !warnings.iter().any(|w| w.invalidates) {
        warnings.extend(crate::identify::suspects::known(record, rig));
    }
    if !warnings.iter().any(|w| w.invalidates)
        && let Some(mended) = crate::identify::slips::taken_back(std::slice::from_ref(record), rig)
    {
        warnings.retain(|w| w.id != slipped::ID);
        warnings.extend(mended.into_iter().flat_map(|r| r.warnings).filter(|w| w.id == slipped::ID));
    }
    if !warnings.iter().any(|w| w.invalidates) {
        warnings.extend(crate::identify::stopped::standing(std::slice::from_ref(record), rig));
    }
}

/// Describes the motion of a record.
///
/// # Errors
/// A record whose longest unbroken stretch is shorter than 20 drive periods (64 samples when free),
/// whose columns do not fit its channels, or that holds numbers that are not finite.
pub fn motion_of(record: &Record, rig: &Rig, settings: &InspectSettings) -> Result<Inspection> {
    settings.validate()?;
    let rate = record.sample_rate_hz;
    check(record)?;
    // What stands behind a restart may count from another zero.
    let (whole, (kept, restarted)) = (record, boots::of_known_zero(std::slice::from_ref(record)));
    let record = &kept[0];
    // Columns of which no system is known are inspected as they stand.
    if rig.bound.is_none() && !rig.model.is_empty() {
        known_model(rig)?;
    }
    let drive_hz = rig.drive.map(|d| d.frequency_hz);
    let (longest, longest_len) =
        record.segments.iter().map(|s| s.len()).enumerate().max_by_key(|(i, n)| (*n, usize::MAX - i)).unwrap_or((0, 0));
    let of_drive = |f: f64| {
        let (periods, window_s) = (settings.window_periods, settings.window_periods / f);
        let name = format!(" ({}: {periods} drive periods of {} s)", in_seconds(window_s), shortest(1.0 / f));
        ((window_s * rate).round(), name)
    };
    let (needed, window) = drive_hz.map_or_else(|| (settings.window_free, String::new()), of_drive);
    if (longest_len as f64) < needed {
        let place = if record.segments.len() > 1 { "longest unbroken stretch" } else { "length" };
        return Err(BadInput::new(
            format!(
                "{longest_len} {} ({} at {} Hz){}",
                if longest_len == 1 { "sample" } else { "samples" },
                in_seconds(longest_len as f64 / rate),
                shortest(rate),
                broken_by(record.losses.nan_rows)
            ),
            format!("at least {needed:.0} samples{window}"),
        )
        .in_file(&record.path)
        .at(place)
        .remedy(if record.losses.nan_rows > 0 {
            "Find out why the sensor gives no number there; --resample bridges short gaps. Otherwise record longer"
        } else {
            "Record longer without a break, or check the rig file's sample_rate_hz and drive.frequency_hz"
        }));
    }

    let motions = motion::motions(record);
    let periodicity =
        periodicity::periodicity(&motions, longest, drive_hz.map(|f| rate / f), rate, settings.period_tolerance);
    // A chaotic spectrum has bumps near every fraction; a locked one has lines at those of its
    // period.
    let denominator = periodicity.period.map_or(4, |k| k.max(4) as u32);
    let inputs = rig.inputs();
    let coordinates: Vec<Coordinate> = motions
        .iter()
        .enumerate()
        .map(|(i, m)| {
            let channel = record.channels.get(i);
            let name = channel.map(|c| c.name.as_str());
            Coordinate {
                input: channel.is_some() && inputs.contains(&i),
                counts: channel.is_some_and(|c| motion::counts(c, m)),
                ..coordinate::describe(m, name, rate, drive_hz, denominator)
            }
        })
        .collect();
    let steady = rig.drive.filter(|_| !drive_check::glides(record));
    let drive = steady.map(|d| drive_check::of(record, &motions, longest, rate, &d));
    let start_s = drive_hz.map_or(settings.start_free_s, |f| settings.start_periods / f);
    let plots = motions.iter().zip(&coordinates).map(|(m, c)| plots::plots(record, m, c, drive_hz, start_s)).collect();
    let summary = summary::summarise(whole, rig);
    let mut warnings = record.warnings.clone();
    warnings.extend(restarted);
    warnings.extend(notices(&summary, &coordinates, drive.as_ref(), &periodicity));
    warnings.extend(standing_line::not_stated(record, rig));
    let repeats = matches!(periodicity.kind, Kind::Periodic | Kind::LocksLater | Kind::AtRest);
    let (phase_space, noticed) =
        survey::survey(record, &motions, &coordinates, drive_hz, repeats, &settings.phase_space);
    warnings.extend(noticed);
    Ok(Inspection { record: summary, coordinates, drive, periodicity, warnings, phase_space, plots })
}

/// Refuses a name that is no model's: of systems with equations, or of those that are reduced.
fn known_model(rig: &Rig) -> Result<()> {
    let mut known = MODELS.iter().map(|m| m.0).chain(SYSTEMS.iter().map(|s| s.id));
    if known.any(|id| id == rig.model) {
        return Ok(());
    }
    Err(rig.no_such_model())
}

/// A record built by a program rather than by a reader may be inconsistent: told, not trusted.
fn check(record: &Record) -> Result<()> {
    let bad = |place: String, found: String, expected: &str| {
        Err(BadInput::new(found, expected).in_file(&record.path).at(place))
    };
    let rate = record.sample_rate_hz;
    if !(rate.is_finite() && rate > 0.0) {
        return bad("sampling rate".to_owned(), format!("{} Hz", shortest(rate)), "a rate above 0");
    }
    for (s, segment) in record.segments.iter().enumerate() {
        if segment.columns.len() != record.channels.len() {
            let expected = format!("{} (one for each channel)", record.channels.len());
            return bad(format!("segment {}", s + 1), format!("{} columns", segment.columns.len()), &expected);
        }
        if !(segment.start_s.is_finite() && segment.step_s > 0.0) {
            let found = format!("start {} s, step {} s", segment.start_s, segment.step_s);
            return bad(format!("segment {}", s + 1), found, "a finite start and a step above 0");
        }
        for (column, channel) in segment.columns.iter().zip(&record.channels) {
            let place = || format!("segment {}, column {}", s + 1, channel.name);
            if column.len() != segment.len() {
                return bad(place(), format!("{} samples", column.len()), &format!("{}", segment.len()));
            }
            if let crate::record::Column::Values(v) = column
                && let Some(i) = v.iter().position(|v| !v.is_finite())
            {
                return bad(format!("{}, sample {i}", place()), v[i].to_string(), "a finite number");
            }
        }
    }
    Ok(())
}

/// Warnings that follow from the results.
fn notices(
    summary: &RecordSummary,
    coordinates: &[Coordinate],
    drive: Option<&DriveCheck>,
    periodicity: &Periodicity,
) -> Vec<Warning> {
    let mut out = Vec::new();
    if summary.rate_deviation.abs() > 1e-3 {
        out.push(Warning::new(
            "rate-differs",
            format!(
                "the record is sampled at {:.6} Hz, the rig file says {:.6} Hz",
                summary.sample_rate_hz, summary.stated_rate_hz
            ),
            "Correct sample_rate_hz in the rig file",
        ));
    }
    if let Some(d) = drive {
        match (d.agrees, d.phase_hz, d.other_hz) {
            (Some(false), Some(phase), _) => out.push(Warning::new(
                "drive-frequency",
                format!("the device's phase turns at {phase:.5} Hz, the rig file says {:.5} Hz", d.stated_hz),
                "Correct drive.frequency_hz in the rig file",
            )),
            (Some(false), None, Some(other)) => out.push(Warning::new(
                "drive-frequency",
                format!("no line at the drive's {:.4} Hz; the record's clearest line is at {other:.4} Hz", d.stated_hz),
                "Check drive.frequency_hz and sample_rate_hz in the rig file",
            )),
            (None, ..) if periodicity.kind != Kind::AtRest => out.push(Warning::new(
                "drive-not-seen",
                format!("no clear line at the drive's {:.4} Hz, nor elsewhere", d.stated_hz),
                "Check that the shaker ran; record longer to see a weak line",
            )),
            _ => {}
        }
    }
    let locked = |k: Option<usize>| match k {
        Some(1) => "every drive period".to_owned(),
        k => format!("every {} drive periods", k.unwrap_or(0)),
    };
    match periodicity.kind {
        Kind::Periodic => out.push(Warning::new(
            "locked",
            format!("the record repeats {}: it holds one orbit", locked(periodicity.period)),
            "Change the drive's amplitude or frequency until the motion repeats no more, or record transients",
        )),
        Kind::LocksLater => out.push(Warning::new(
            "locks-later",
            format!(
                "the record repeats {} from {} after the start of its longest stretch",
                locked(periodicity.period),
                in_seconds(periodicity.locked_after_s.unwrap_or(0.0))
            ),
            "Use the part before, or change the drive until the motion never repeats",
        )),
        Kind::AtRest => out.push(Warning::new(
            "at-rest",
            "nothing moves by more than a few quantisation steps",
            "Check sensors, wiring and drive",
        )),
        Kind::ChaoticOrTransient | Kind::Free => {}
    }
    for c in coordinates.iter().filter(|c| c.channel.is_some()) {
        // An input's resolution says nothing of what a good sensor of it shows.
        if c.counts && !c.input && c.step > 0.0 && c.noise > 2.0 * c.quantisation_noise {
            out.push(Warning::new(
                "noisy-channel",
                format!(
                    "{}: noise {:.2e} {} is {:.1} times that of its quantisation",
                    c.name,
                    c.noise,
                    c.unit,
                    c.noise / c.quantisation_noise
                ),
                "Check shielding, the filter of what reads it and the coupling of the sensor",
            ));
        }
        if periodicity.kind != Kind::AtRest && c.greatest - c.least <= 6.0 * c.step {
            out.push(Warning::new(
                "still-channel",
                format!("{} does not move", c.name),
                "Check that its sensor is connected and that the rig file names the right column",
            ));
        }
    }
    out
}

#[cfg(test)]
mod tests;

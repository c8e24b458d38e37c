//! The device's own estimates: as they come from the wire, in a file beside the record
//! (`REC.estimates.jsonl`, a JSON object a line), and in words.
//!
//! They are of the double pendulum with the default dampings on a vertical drive. Where the rig
//! file describes another system they are not taken.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use whirl_shared::frame::regression::{EquationEstimate, Estimate, Unknown};
use whirl_shared::regressor::{NAMES, UNKNOWNS1};
use whirl_shared::waveform::exact_frequency;

use crate::error::{BadInput, Result};
use crate::model::double_pendulum::DEFAULT_DAMPINGS;
use crate::model::parameter::Parameter;
use crate::record::sealed_line::seal;
use crate::rig::measures::BASE;
use crate::rig::{Direction, Rig};
use crate::system::library::Pendulum;
use crate::wording::format::{Z95, plus_minus};

/// Whether an estimate can be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// All parameters are known.
    Known,
    /// Too few windows yet.
    TooFewWindows,
    /// The motion does not determine the parameters.
    NotIdentifiable,
}

/// An estimate of the device.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DeviceEstimate {
    /// Tick of its newest window's last sample, on the record's line.
    pub tick: i64,
    /// That tick's time, s.
    pub t: f64,
    /// Length of a window, s.
    pub window_s: f64,
    /// Windows since the last gap or change of the drive.
    pub windows: u32,
    /// What a window counts for after the next one.
    pub forgetting: f64,
    /// Frequency of the drive, Hz.
    pub drive_frequency_hz: f64,
    /// Commanded amplitude, m.
    pub amplitude_m: f64,
    /// Whether there are parameters.
    pub status: Status,
    /// Why there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Parameters with standard errors, where they are known.
    pub parameters: Vec<Parameter>,
    /// Condition of each equation's rows, 1 or more, where they are known.
    pub condition: Vec<f64>,
    /// rms of each equation's residuals, non-dimensional.
    pub residual_rms: Vec<f64>,
}

/// Unknowns of an equation, or why there are none.
fn equation<const P: usize>(
    estimate: &EquationEstimate<[Unknown; P]>,
    names: &[&'static str],
) -> std::result::Result<(Vec<Parameter>, f64, f64), (Status, String)> {
    match estimate {
        EquationEstimate::Known { unknowns, condition, residual_rms } => {
            let parameters: Vec<Parameter> = unknowns
                .iter()
                .zip(names)
                .map(|(u, name)| Parameter {
                    name: (*name).to_owned(),
                    value: f64::from(f32::from(u.value)),
                    std_error: f64::from(f32::from(u.std_error)),
                    unit: "1".to_owned(),
                })
                .collect();
            let (condition, rms) = (f64::from(f32::from(*condition)), f64::from(f32::from(*residual_rms)));
            let finite = parameters.iter().all(|p| p.value.is_finite() && p.std_error.is_finite());
            if finite && condition.is_finite() && rms.is_finite() {
                Ok((parameters, condition, rms))
            } else {
                Err((Status::NotIdentifiable, "the device sent a number that is none".to_owned()))
            }
        }
        EquationEstimate::TooFewWindows => Err((Status::TooFewWindows, "too few windows yet".to_owned())),
        EquationEstimate::Undetermined(i) => {
            let name = names.get(usize::from(*i)).copied().unwrap_or("a parameter");
            Err((Status::NotIdentifiable, format!("the motion does not determine {name}")))
        }
        EquationEstimate::Repeating => {
            Err((Status::NotIdentifiable, "the motion repeats itself, locked to the drive".to_owned()))
        }
    }
}

impl DeviceEstimate {
    /// From the wire; `tick` on the record's line.
    pub(super) fn new(estimate: &Estimate, tick: i64, sample_rate_hz: f64) -> Self {
        let (names1, names2) = NAMES.split_at(UNKNOWNS1);
        let both = (equation(&estimate.first, names1), equation(&estimate.second, names2));
        let (status, reason, parameters, condition, residual_rms) = match both {
            (Ok((mut parameters, c1, r1)), Ok((second, c2, r2))) => {
                parameters.extend(second);
                (Status::Known, None, parameters, vec![c1, c2], vec![r1, r2])
            }
            (Err((status, reason)), _) | (_, Err((status, reason))) => {
                (status, Some(reason), Vec::new(), Vec::new(), Vec::new())
            }
        };
        // Rates are far below 2³² mHz, as the recorder has checked.
        let millihertz = (sample_rate_hz * 1e3).round() as u32;
        Self {
            tick,
            t: tick as f64 / sample_rate_hz,
            window_s: f64::from(estimate.window_ticks) / sample_rate_hz,
            windows: estimate.windows,
            forgetting: f64::from(estimate.forget_per_mille) * 1e-3,
            drive_frequency_hz: exact_frequency(estimate.phase_increment, millihertz),
            amplitude_m: f64::from(estimate.amplitude_nanometre) * 1e-9,
            status,
            reason,
            parameters,
            condition,
            residual_rms,
        }
    }

    /// In a few words, for a progress line.
    pub fn brief(&self) -> String {
        match self.parameters.iter().find(|p| p.name == "B21") {
            Some(p) => format!("device: B21 {} (95 %)", plus_minus(p.value, Z95 * p.std_error)),
            None => match self.status {
                Status::TooFewWindows => "device: too few windows yet".to_owned(),
                _ => "device: not identifiable".to_owned(),
            },
        }
    }

    /// In lines, for the answer.
    pub fn human(&self) -> String {
        if let Some(reason) = &self.reason {
            let what = if self.status == Status::TooFewWindows { "none yet" } else { "not identifiable" };
            return format!("the device's own estimate at {:.1} s: {what} ({reason})\n", self.t);
        }
        let condition: Vec<String> = self.condition.iter().map(|c| format!("{c:.2}")).collect();
        let mut text = format!(
            "the device's own estimate at {:.1} s (windows of {:.3} s, each forgotten by {} after the next; condition {}; ± is 95 %):\n",
            self.t,
            self.window_s,
            self.forgetting,
            condition.join(", ")
        );
        for p in &self.parameters {
            text.push_str(&format!("  {:<7} {}\n", p.name, plus_minus(p.value, Z95 * p.std_error)));
        }
        text
    }
}

/// Why the device's identification is of no use for a rig; none where it is.
pub(crate) fn unfit(rig: &Rig) -> Option<BadInput> {
    let bad = |found: String, expected: &str, at: &str| Some(BadInput::new(found, expected).in_file(&rig.path).at(at));
    if rig.pendulum() != Some(Pendulum::Double) {
        return bad(format!("\"{}\"", rig.model), "\"double-pendulum\", which the device identifies", "model");
    }
    match rig.drive {
        None => return bad("no [drive]".to_owned(), "a driven rig: the device's windows are drive periods", "drive"),
        Some(d) if d.direction == Direction::Horizontal => {
            return bad("\"horizontal\"".to_owned(), "\"vertical\"", "drive.direction");
        }
        Some(_) => {}
    }
    if let Some(nominal) = &rig.nominal
        && nominal != DEFAULT_DAMPINGS
    {
        return bad(format!("{nominal:?}"), &format!("{DEFAULT_DAMPINGS:?}, as the device has it"), "nominal.effects");
    }
    let measures: Vec<&str> = rig.channel.iter().map(|c| c.measures.as_str()).filter(|m| *m != BASE).collect();
    if !matches!(measures[..], ["theta1" | "phi1", "theta2"]) {
        return bad(format!("{measures:?}"), "theta1 (or phi1), then theta2", "channel");
    }
    None
}

/// The file of estimates beside a record.
pub fn path_of(record: &Path) -> PathBuf {
    let mut name = record.as_os_str().to_owned();
    name.push(".estimates.jsonl");
    name.into()
}

/// Estimates of a record, written as they come; memory holds the last one.
pub(super) struct Estimates {
    path: PathBuf,
    file: Option<File>,
    pub(super) count: u64,
    pub(super) last: Option<DeviceEstimate>,
}

impl Estimates {
    /// None yet.
    pub(super) fn new(record: &Path) -> Self {
        Self { path: path_of(record), file: None, count: 0, last: None }
    }

    /// Removes the estimates of an earlier record of that name.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub(super) fn begin(&self) -> Result<()> {
        match std::fs::remove_file(&self.path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(BadInput::io(&self.path, &e)),
            _ => Ok(()),
        }
    }

    /// Takes one.
    ///
    /// # Errors
    /// A full disk.
    pub(super) fn push(&mut self, estimate: DeviceEstimate) -> Result<()> {
        let io = |e: std::io::Error| BadInput::io(&self.path, &e).remedy("Free space on the disk");
        let mut line = serde_json::to_string(&estimate).map_err(|e| BadInput::new(e.to_string(), ""))?;
        line = seal(&line) + "\n";
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(File::create(&self.path).map_err(io)?),
        };
        file.write_all(line.as_bytes()).map_err(io)?;
        self.count += 1;
        self.last = Some(estimate);
        Ok(())
    }

    /// The file, where there is one.
    pub(super) fn file(&self) -> Option<PathBuf> {
        (self.count > 0).then(|| self.path.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::sealed_line::{Opened, open};
    use whirl_shared::frame::regression::Binary32;

    fn known<const P: usize>(value: f32) -> EquationEstimate<[Unknown; P]> {
        let unknown = Unknown { value: value.into(), std_error: 0.25f32.into() };
        EquationEstimate::Known { unknowns: [unknown; P], condition: 1.5f32.into(), residual_rms: 0.5f32.into() }
    }

    fn estimate(first: EquationEstimate<[Unknown; 6]>, second: EquationEstimate<[Unknown; 5]>) -> DeviceEstimate {
        let wire = Estimate {
            tick: 7,
            window_ticks: 2_000,
            windows: 12,
            forget_per_mille: 900,
            phase_increment: 42_949_673,
            amplitude_nanometre: 15_525_000,
            first,
            second,
        };
        DeviceEstimate::new(&wire, 5_000, 500.0)
    }

    #[test]
    fn numbers_and_their_absence_are_told() {
        let e = estimate(known(0.5), known(2.0));
        assert_eq!(
            (e.status, e.parameters.len(), e.t, e.window_s, e.amplitude_m),
            (Status::Known, 11, 10.0, 4.0, 0.015_525)
        );
        assert!((e.drive_frequency_hz - 5.0).abs() < 1e-7);
        assert!(e.human().contains("B21") && e.brief().contains("B21"), "{}", e.human());
        let locked = estimate(EquationEstimate::Repeating, EquationEstimate::Repeating);
        assert_eq!((locked.status, locked.parameters.len()), (Status::NotIdentifiable, 0));
        assert!(locked.human().contains("not identifiable") && locked.brief().contains("not identifiable"));
        let open = estimate(known(1.0), EquationEstimate::Undetermined(4));
        assert!(open.parameters.is_empty() && open.human().contains("C2"), "{}", open.human());
        assert!(estimate(EquationEstimate::Undetermined(200), known(1.0)).human().contains("a parameter"));
        let early = estimate(EquationEstimate::TooFewWindows, EquationEstimate::TooFewWindows);
        assert_eq!(early.status, Status::TooFewWindows);
        // What is no number is no estimate.
        let mut unknowns = [Unknown { value: 1.0f32.into(), std_error: 1.0f32.into() }; 6];
        unknowns[3].value = Binary32(f32::NAN.to_le_bytes());
        let bad = EquationEstimate::Known { unknowns, condition: 1.0f32.into(), residual_rms: 1.0f32.into() };
        assert_eq!(estimate(bad, known(1.0)).status, Status::NotIdentifiable);
    }

    #[test]
    fn they_are_written_a_line_each_and_earlier_ones_go() {
        let dir = tempfile::tempdir().unwrap();
        let record = dir.path().join("r.parquet");
        std::fs::write(path_of(&record), "old").unwrap();
        let mut estimates = Estimates::new(&record);
        estimates.begin().unwrap();
        estimates.begin().unwrap();
        assert!(!path_of(&record).exists() && estimates.file().is_none());
        estimates.push(estimate(known(0.5), known(2.0))).unwrap();
        estimates.push(estimate(EquationEstimate::Repeating, EquationEstimate::Repeating)).unwrap();
        let text = std::fs::read_to_string(estimates.file().unwrap()).unwrap();
        let lines: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!((lines.len(), &lines[0]["parameters"][6]["name"]), (2, &serde_json::json!("B21")));
        assert!(text.lines().all(|l| matches!(open(l), Opened::Right(_))));
        assert_eq!((&lines[1]["status"], estimates.count), (&serde_json::json!("not-identifiable"), 2));
    }
}

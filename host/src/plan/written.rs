//! A plan's file, as `whirl capture --plan` reads it.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Setting;
use super::goals::{Precise, Tell};
use super::moved::rig_at;
use crate::error::{BadInput, Result};
use crate::files;
use crate::rig::checks::typed;
use crate::rig::{LONGEST_S, Rig};

/// Most runs of a file (by hand).
const MOST_RUNS: usize = 100;

/// One record of a plan.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Frequency of the drive, Hz.
    pub frequency_hz: Option<f64>,
    /// Amplitude of the base, m.
    pub amplitude_m: Option<f64>,
    /// The same in units of that of the model.
    pub amplitude_factor: Option<f64>,
    /// Coordinates from which a free system is let go.
    pub pose: Option<Vec<f64>>,
    /// Length of the record, s.
    pub seconds: f64,
    /// Whether it is expected to reach every goal.
    #[serde(default)]
    pub decides: bool,
    /// Expected share of chaotic motion.
    pub chaotic: Option<f64>,
    /// Expected standard errors.
    #[serde(default)]
    pub std_errors: BTreeMap<String, f64>,
}

/// A plan's file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// Version of these keys.
    pub format: u32,
    /// Name of the rig.
    pub rig: String,
    /// Effects to tell from one another.
    #[serde(default)]
    pub tell: Vec<String>,
    /// Wanted intervals, `NAME=X%`.
    #[serde(default)]
    pub precise: Vec<String>,
    /// Seed of the plan.
    #[serde(default)]
    pub seed: u64,
    /// Records, in their order.
    #[serde(default)]
    pub run: Vec<Run>,
}

impl PlanFile {
    /// Reads and checks a plan.
    ///
    /// # Errors
    /// Names the file, the key, the value and what was expected.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a plan", "Name a plan that `whirl plan -o` wrote")?;
        let bad = |found: String, expected: &str, at: &str| {
            let remedy = "Make the plan again with `whirl plan -o`, or correct it (docs/plan.md)";
            BadInput::new(found, expected).in_file(path).at(at.to_owned()).remedy(remedy)
        };
        let out: Self = typed(&text, path, ["a plan", "docs/plan.md"])?;
        if out.format != 1 {
            return Err(bad(out.format.to_string(), "1", "format"));
        }
        if out.run.is_empty() || out.run.len() > MOST_RUNS {
            return Err(bad(format!("{} runs", out.run.len()), &format!("1 to {MOST_RUNS} runs, [[run]]"), "run"));
        }
        for text in &out.tell {
            // A size is for the plan; what a record shows has its own.
            if !Tell::parse(text).is_ok_and(|t| t.size.is_none()) {
                return Err(bad(format!("\"{text}\""), "ID@PLACE, such as eccentricity@encoder1", "tell"));
            }
        }
        for text in &out.precise {
            if Precise::parse(text).is_err() {
                return Err(bad(format!("\"{text}\""), "NAME=X%, such as C11=0.5%", "precise"));
            }
        }
        for run in &out.run {
            if !(run.seconds > 0.0 && run.seconds <= LONGEST_S) {
                let expected = format!("seconds above 0, at most {LONGEST_S}");
                return Err(bad(run.seconds.to_string(), &expected, "run.seconds"));
            }
            for (key, value) in run.of_drive() {
                if let Some(x) = value.filter(|x| !(*x > 0.0 && x.is_finite())) {
                    return Err(bad(x.to_string(), "a number above 0", key));
                }
            }
            if let Some(x) = run.pose.iter().flatten().find(|x| !x.is_finite()) {
                return Err(bad(x.to_string(), "numbers", "run.pose"));
            }
        }
        Ok(out)
    }
}

impl Run {
    /// What it sets of a drive, by its place in the file.
    fn of_drive(&self) -> [(&'static str, Option<f64>); 3] {
        [
            ("run.frequency_hz", self.frequency_hz),
            ("run.amplitude_m", self.amplitude_m),
            ("run.amplitude_factor", self.amplitude_factor),
        ]
    }

    /// Its setting.
    pub fn setting(&self) -> Setting {
        Setting {
            frequency_hz: self.frequency_hz,
            amplitude_factor: self.amplitude_factor,
            amplitude_m: self.amplitude_m,
            pose: self.pose.clone(),
        }
    }

    /// The rig, set to it.
    ///
    /// # Errors
    /// A drive whose amplitude is not known in m, or that the rig does not have; a frequency that
    /// the samples do not resolve.
    pub fn rig(&self, rig: &Rig) -> Result<Rig> {
        let set = self.of_drive().into_iter().find_map(|(key, value)| Some((key, value?)));
        if let Some((key, value)) = set.filter(|_| rig.drive.is_none()) {
            return Err(BadInput::new(value.to_string(), "a rig with [drive]")
                .at(key)
                .remedy("Leave it out, or add [drive] to the rig file"));
        }
        if rig.drive.is_some() && self.amplitude_m.is_none() {
            return Err(BadInput::new("a run without amplitude_m", "the amplitude of the base in m")
                .at("--plan")
                .remedy("Write amplitude_m into the plan's [[run]]"));
        }
        let remedy = "Correct it in the plan's [[run]]";
        rig_at(rig, &self.setting()).map_err(|e| if e.remedy.is_empty() { e.remedy(remedy) } else { e })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_checked_key_by_key() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            PlanFile::read(&path).map_err(|e| e.to_string())
        };
        let good = "format = 1\nrig = \"x\"\n[[run]]\nfrequency_hz = 5.0\namplitude_m = 0.01\nseconds = 60.0\n";
        assert_eq!(read(good).unwrap().run[0].seconds, 60.0);
        for (was, is, place) in [
            ("format = 1", "format = 2", "format"),
            ("seconds = 60.0", "seconds = nan", "run.seconds"),
            ("seconds = 60.0", "minutes = 1.0", "minutes"),
            ("seconds = 60.0", "seconds = 1e6", "at most 86400"),
            ("0.01", "-0.01", "run.amplitude_m"),
            ("seconds", "amplitude_factor = 0.0\nseconds", "run.amplitude_factor"),
            ("seconds", "amplitude_factor = nan\nseconds", "run.amplitude_factor"),
            ("[[run]]", "[[runs]]", "runs"),
            ("[[run]]", "precise = [\"C11=0.5\"]\n[[run]]", "precise: found \"C11=0.5\", expected NAME=X%"),
            ("[[run]]", "tell = [\"play\"]\n[[run]]", "tell: found \"play\", expected ID@PLACE"),
            ("[[run]]", "tell = [\"play@joint1=0.1\"]\n[[run]]", "tell: found"),
        ] {
            let said = read(&good.replace(was, is)).unwrap_err();
            assert!(said.contains(place) && said.contains("plan.toml"), "{said}");
        }
        let none = read("format = 1\nrig = \"x\"\n").unwrap_err();
        assert!(none.contains("found 0 runs, expected 1 to 100 runs"), "{none}");
        let goals = "tell = [\"play@joint1\"]\nprecise = [\"C11=0.5%\"]\n[[run]]";
        assert_eq!(read(&good.replace("[[run]]", goals)).unwrap().precise, ["C11=0.5%"]);
    }

    #[test]
    fn a_rig_without_a_drive_takes_no_setting_of_one() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml")).unwrap();
        let free = Rig { drive: None, ..rig };
        let run: Run = toml::from_str("seconds = 60.0\nfrequency_hz = 4.0\n").unwrap();
        assert_eq!(run.rig(&free).unwrap_err().place.as_deref(), Some("run.frequency_hz"));
    }
}

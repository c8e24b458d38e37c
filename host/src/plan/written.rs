//! A plan's file, as `whirl capture --plan` reads it.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Setting;
use super::moved::rig_at;
use crate::error::{BadInput, Result};
use crate::files;
use crate::rig::Rig;

/// Most runs of a file.
const MOST_RUNS: usize = 100;
/// Longest run, s (a day).
const LONGEST_S: f64 = 86_400.0;

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
        let out: Self =
            toml::from_str(&text).map_err(|e| bad(e.to_string(), "a plan, as `whirl plan -o` writes it", "plan"))?;
        if out.format != 1 {
            return Err(bad(out.format.to_string(), "1", "format"));
        }
        if out.run.is_empty() || out.run.len() > MOST_RUNS {
            return Err(bad(format!("{} runs", out.run.len()), "1 to 100 runs, [[run]]", "run"));
        }
        for run in &out.run {
            if !(run.seconds > 0.0 && run.seconds <= LONGEST_S) {
                return Err(bad(run.seconds.to_string(), "seconds above 0, at most 86400", "run.seconds"));
            }
            for (key, value) in [("run.frequency_hz", run.frequency_hz), ("run.amplitude_m", run.amplitude_m)] {
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
    /// A drive whose amplitude is not known in m, a frequency that the samples do not resolve.
    pub fn rig(&self, rig: &Rig) -> Result<Rig> {
        if rig.drive.is_some() && self.amplitude_m.is_none() {
            return Err(BadInput::new("a run without amplitude_m", "the amplitude of the base in m")
                .at("--plan")
                .remedy("Write amplitude_m into the plan's [[run]]"));
        }
        rig_at(rig, &self.setting())
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
            ("0.01", "-0.01", "run.amplitude_m"),
            ("[[run]]", "[[runs]]", "runs"),
        ] {
            let said = read(&good.replace(was, is)).unwrap_err();
            assert!(said.contains(place) && said.contains("plan.toml"), "{said}");
        }
        assert!(read("format = 1\nrig = \"x\"\n").unwrap_err().contains("0 runs"));
    }
}

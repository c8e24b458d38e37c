//! What the next experiment shall tell, and what it may do.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::effects::catalogue;
use crate::error::{BadInput, Result};
use crate::files;
use crate::model::identified::{AddedEffect, IdentifiedModel};
use crate::rig::Rig;
use crate::rig::checks::typed;

/// A parameter's wanted interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Precise {
    /// The parameter.
    pub name: String,
    /// Half of its 95 % interval over its value.
    pub share: f64,
}

impl Precise {
    /// `NAME=X%`.
    ///
    /// # Errors
    /// The text, and what was expected.
    pub fn parse(text: &str) -> core::result::Result<Self, String> {
        let parts = || {
            let (name, percent) = text.split_once('=')?;
            let share = percent.trim().strip_suffix('%')?.trim().parse::<f64>().ok()? / 100.0;
            let good = !name.trim().is_empty() && share > 0.0 && share < 1.0;
            good.then(|| Self { name: name.trim().to_owned(), share })
        };
        parts().ok_or_else(|| format!("\"{text}\" is not NAME=X%, such as C11=0.5%"))
    }
}

/// An effect that is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Tell {
    /// `ID@PLACE`.
    pub name: String,
    /// Its size in its own unit, where the model does not have it.
    pub size: Option<f64>,
}

impl Tell {
    /// `ID@PLACE` or `ID@PLACE=VALUE`.
    ///
    /// # Errors
    /// The text, and what was expected.
    pub fn parse(text: &str) -> core::result::Result<Self, String> {
        let (name, size) = match text.split_once('=') {
            Some((name, size)) => (name.trim(), Some(size.trim().parse::<f64>().unwrap_or(f64::NAN))),
            None => (text.trim(), None),
        };
        let placed = name.split_once('@').is_some_and(|(id, at)| !id.is_empty() && !at.is_empty());
        if !placed || size.is_some_and(|x| !(x.is_finite() && x != 0.0)) {
            return Err(format!("\"{text}\" is not ID@PLACE or ID@PLACE=VALUE, such as eccentricity@encoder1=0.002"));
        }
        Ok(Self { name: name.to_owned(), size })
    }
}

/// What an experiment shall tell.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Goals {
    /// Effects to be told from one another, `ID@PLACE`.
    pub tell: Vec<String>,
    /// Parameters and their intervals.
    pub precise: Vec<Precise>,
}

/// What the rig may be set to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Drive frequencies, Hz.
    pub frequency_hz: Option<[f64; 2]>,
    /// Amplitudes of the base, m.
    pub amplitude_m: Option<[f64; 2]>,
    /// The same in units of the amplitude at which the model was identified.
    pub amplitude_factor: Option<[f64; 2]>,
    /// Greatest acceleration of the base, m/s².
    pub acceleration_m_s2: Option<f64>,
    /// Longest record, s.
    pub seconds: Option<f64>,
}

impl Limits {
    /// Reads a limits file.
    ///
    /// # Errors
    /// Names the file, the key, the value and what was expected.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a limits file", "Name a file with lines such as frequency_hz = [2.0, 8.0]")?;
        let out: Self = typed(&text, path, ["a limits file", "docs/plan.md"])?;
        let ranges = [
            ("frequency_hz", out.frequency_hz),
            ("amplitude_m", out.amplitude_m),
            ("amplitude_factor", out.amplitude_factor),
        ];
        for (key, range) in ranges {
            if let Some([low, high]) = range.filter(|[l, h]| !(*l > 0.0 && l <= h && h.is_finite())) {
                return Err(BadInput::new(format!("[{low}, {high}]"), "two numbers above 0, the lower first")
                    .in_file(path)
                    .at(key)
                    .remedy("Correct the limits file"));
            }
        }
        for (key, value) in [("acceleration_m_s2", out.acceleration_m_s2), ("seconds", out.seconds)] {
            if let Some(x) = value.filter(|x| !(*x > 0.0 && x.is_finite())) {
                return Err(BadInput::new(x.to_string(), "a number above 0")
                    .in_file(path)
                    .at(key)
                    .remedy("Correct the limits file"));
            }
        }
        Ok(out)
    }
}

/// Refuses goals that the model does not have.
pub(super) fn check(settings: &super::Settings<'_>, model: &IdentifiedModel, rig: &Rig) -> Result<()> {
    let goals = &settings.goals;
    let names: Vec<String> = model.effects.iter().map(AddedEffect::name).collect();
    let id = |name: &str| name.split('@').next().unwrap_or_default().to_owned();
    let known = |name: &String| {
        names.contains(name) || catalogue().iter().chain(rig.effects.iter().map(|e| &**e)).any(|e| e.id == id(name))
    };
    if let Some(unknown) = goals.tell.iter().find(|t| !known(t)) {
        return Err(BadInput::new(format!("\"{}\"", id(unknown)), "an effect of `whirl list effects`")
            .at("--tell")
            .remedy("Correct its name: ID@PLACE, such as quadratic-drag@arm2"));
    }
    let sized = settings.sizes.iter().any(|t| t.size.is_some());
    if !goals.tell.is_empty() && !sized && !goals.tell.iter().any(|t| names.contains(t)) {
        let has = if names.is_empty() { "no effect".to_owned() } else { names.join(", ") };
        let found = format!("{} for a model with {has}", goals.tell.join(","));
        return Err(BadInput::new(found, "an effect that the model has, or one with its size")
            .at("--tell")
            .remedy("Give the model that `whirl explain -o` wrote, or the size that it would have: ID@PLACE=VALUE"));
    }
    if let Some(p) = goals.precise.iter().find(|p| model.parameter(&p.name).is_none()) {
        let all: Vec<&str> = model.parameters.iter().map(|p| p.name.as_str()).collect();
        return Err(BadInput::new(format!("\"{}\"", p.name), format!("a parameter of the model: {}", all.join(", ")))
            .at("--precise"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_a_name_and_a_share() {
        assert_eq!(Precise::parse("C11=0.5%").unwrap(), Precise { name: "C11".into(), share: 0.005 });
        for bad in ["C11", "C11=0.5", "=1%", "C11=0%", "C11=100%", "C11=nan%"] {
            assert!(Precise::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn an_effect_is_a_name_at_a_place() {
        let found = Tell::parse("cogging@joint1=-2e-4").unwrap();
        assert_eq!((found.name.as_str(), found.size), ("cogging@joint1", Some(-2e-4)));
        assert_eq!(Tell::parse("cogging@joint1").unwrap().size, None);
        for bad in ["cogging", "@joint1", "cogging@", "cogging@joint1=", "cogging@joint1=0", "cogging@joint1=nan"] {
            assert!(Tell::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn limits_are_checked() {
        let file = |text: &str| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("limits.toml");
            std::fs::write(&path, text).unwrap();
            Limits::read(&path).map_err(|e| e.to_string())
        };
        assert_eq!(file("frequency_hz = [2.0, 8.0]\nseconds = 300.0\n").unwrap().seconds, Some(300.0));
        for (bad, place) in [
            ("frequency_hz = [8.0, 2.0]", "frequency_hz"),
            ("amplitude_m = [0.0, 1.0]", "amplitude_m"),
            ("seconds = nan", "seconds"),
            ("speed = 3", "speed"),
        ] {
            let said = file(bad).unwrap_err();
            assert!(said.contains(place) && said.contains("limits.toml"), "{said}");
        }
        // One line in this program's words, not the parser's picture of the file.
        let said = file("seconds = 3\nspeed = 3").unwrap_err();
        assert!(said.contains("line 2, column 1: found the key \"speed\"") && !said.contains("TOML parse"), "{said}");
        let said = file("frequency_hz = 3.0").unwrap_err();
        assert!(said.contains("limits.toml: line 1, column 16: ") && said.contains("docs/plan.md"), "{said}");
    }
}

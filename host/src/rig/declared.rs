//! Units that a model declares for what channels measure, against the units of the channels.
//!
//! A system file says of each coordinate and input what it is counted in, and a coordinate on the
//! circle is an angle in any file. A channel in another unit of the same kind is scaled; one of
//! another kind (mm for an angle, mA for a force in N) would be taken for what it is not. The unit
//! `1` and a declaration of `1` leave open what is measured, and so does a unit in a declaration
//! that no channel can have.

use std::path::Path;

use super::{Channel, Rig, UNITS};
use crate::error::{BadInput, Result};
use crate::model::model_file::units::Unit;
use crate::model::model_file::{ModelFile, Space};

/// What a coordinate or an input is counted in.
#[derive(Clone, Debug, PartialEq)]
pub struct Declared {
    /// In words: `a length`, `an angle`, `N`.
    pub words: String,
    /// In base units.
    unit: Unit,
}

impl Declared {
    /// An angle.
    pub fn angle() -> Self {
        Self { words: "an angle".to_owned(), unit: Unit::default() }
    }

    /// As a system file writes it; none where that leaves it open.
    fn of(text: &str) -> Option<Self> {
        match text {
            "angle" | "rad" => return Some(Self::angle()),
            "length" => return Some(Self { words: "a length".to_owned(), unit: Unit::parse("m")? }),
            _ => {}
        }
        let unit = Unit::parse(text)?.in_base_units().filter(|u| *u != Unit::default())?;
        Some(Self { words: text.to_owned(), unit })
    }

    /// Whether values in a channel's unit are something else.
    pub fn contradicts(&self, channel_unit: &str) -> bool {
        let si = Channel::new("", channel_unit).si_unit().to_owned();
        channel_unit != "1" && Unit::of_channel(&si).in_base_units().is_some_and(|u| u != self.unit)
    }

    /// Units of channels that fit, for messages.
    pub fn fitting(&self) -> String {
        UNITS.iter().filter(|u| !self.contradicts(u)).copied().collect::<Vec<_>>().join(", ")
    }
}

/// What a model's coordinates are counted in, then its inputs; none where the model leaves it open.
pub fn of_model(model: &ModelFile) -> (Vec<Option<Declared>>, Vec<Option<Declared>>) {
    let file = model.mechanism.as_ref().and_then(|m| m.file.as_deref());
    let coordinate = |(k, c): (usize, &crate::model::model_file::Coordinate)| {
        let said = file.and_then(|f| f.coordinates.get(k)).and_then(|(_, unit)| Declared::of(unit));
        said.or_else(|| (c.space == Space::Circle).then(Declared::angle))
    };
    let input = |k: usize| file.and_then(|f| f.input_units.get(k)).and_then(|u| Declared::of(&u.to_string()));
    (model.coordinates.iter().enumerate().map(coordinate).collect(), (0..model.inputs.len()).map(input).collect())
}

/// Refuses a channel whose unit is of another kind than what it measures.
///
/// # Errors
/// Names channel, both units and those that fit.
pub fn check(rig: &Rig, channel: usize, what: &str, declared: &Declared, model: &Path) -> Result<()> {
    let Some(c) = rig.channel.get(channel).filter(|c| declared.contradicts(&c.unit)) else { return Ok(()) };
    Err(BadInput::new(
        format!("\"{}\"", c.unit),
        format!("a unit of {what}, which is {} in {}: {}", declared.words, model.display(), declared.fitting()),
    )
    .in_file(&rig.path)
    .at(format!("channel {} (\"{}\"), unit", channel + 1, c.name))
    .remedy(
        "Correct the unit or what the channel measures; gain leads from what the column holds to the unit, and unit \"1\" leaves it open",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(model: &str, channels: [(&str, &str); 3]) -> Result<Rig> {
        let parts = channels.iter().filter(|c| !c.0.is_empty()).map(|(measures, unit)| {
            let turn = if *unit == "count" { "counts_per_turn = 4096\n" } else { "" };
            format!("[[channel]]\nname = \"c {measures}\"\nmeasures = \"{measures}\"\nunit = \"{unit}\"\n{turn}")
        });
        let text = format!("name = \"r\"\nmodel = \"{model}\"\nsample_rate_hz = 100.0\n{}", parts.collect::<String>());
        Rig::of_text(&text, Path::new("rig.toml"), &Default::default(), &mut |_| Ok(None))
    }

    #[test]
    fn a_unit_of_another_kind_is_refused_and_one_of_the_kind_is_scaled() {
        for units in [["m", "rad", "N"], ["mm", "deg", "mN"], ["um", "count", "kN"], ["1", "1", "1"]] {
            let channels = [("x", units[0]), ("theta", units[1]), ("force", units[2])];
            assert!(rig("cart-pendulum", channels).is_ok(), "{units:?}: {:?}", rig("cart-pendulum", channels).err());
        }
        for (units, part) in [
            (["deg", "rad", "N"], "channel 1 (\"c x\"), unit: found \"deg\", expected a unit of x, which is a length"),
            (["m", "mm", "N"], "unit: found \"mm\", expected a unit of theta, which is an angle in"),
            (["m", "rad", "A"], "channel 3 (\"c force\"), unit: found \"A\", expected a unit of force, which is N in"),
            (["m", "rad", "N m"], "N, mN, kN, 1. Correct the unit"),
        ] {
            let channels = [("x", units[0]), ("theta", units[1]), ("force", units[2])];
            let e = rig("cart-pendulum", channels).unwrap_err().to_string();
            assert!(e.starts_with("rig.toml: ") && e.contains(part), "{e}");
        }
        // A pulley's encoder shows a length by a number that is no pure one.
        assert!(rig("cart-pendulum", [("40*x", "count"), ("theta", "rad"), ("force", "N")]).is_ok());
        let e = rig("single-pendulum", [("theta1", "m"), ("", ""), ("", "")]).unwrap_err().to_string();
        assert!(e.contains("found \"m\", expected a unit of theta1, which is an angle in single-pendulum"), "{e}");
    }

    #[test]
    fn units_are_compared_by_what_they_are_made_of() {
        let fits = |declared: &str, unit: &str| Declared::of(declared).is_none_or(|d| !d.contradicts(unit));
        for (declared, unit) in
            [("kg m/s^2", "N"), ("kN", "mN"), ("J", "N m"), ("m/s^2", "m/s2"), ("1", "N"), ("bar", "N"), ("rad", "deg")]
        {
            assert!(fits(declared, unit), "{declared} {unit}");
        }
        for (declared, unit) in [("N", "N m"), ("m", "m/s"), ("A", "V"), ("rad", "mm"), ("angle", "N")] {
            assert!(!fits(declared, unit), "{declared} {unit}");
        }
    }
}

//! Units and horizon in which an explanation is told.

use super::shooting::Coloured;
use crate::error::{BadInput, Result};
use crate::explain::Settings;
use crate::explain::explanation::InUnit;
use crate::identify::shooting::FEWEST_SAMPLES;
use crate::identify::stretches::Stretch;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::warning::Warning;
use crate::wording::format::quantity;
use crate::wording::limits;

/// Horizon of the gap without a drive, s, and how many periods of the motion it may be at least and
/// at most (by hand): the first is that of the measured pendulums' published figures; over a
/// twentieth of a period, as over 0.8 s of a ship that rolls in 11, no force shows, and what is
/// missing would be refused for bringing predictions no nearer.
const FREE_S: f64 = 0.2;
const FREE_PERIODS: [f64; 2] = [0.125, 20.0];
/// Most of a stretch that it takes without a drive: the gap is a mean over several.
const MOST_OF_STRETCH: f64 = 0.1;

/// Horizon of the gap where none is asked for: a drive's period; 0.2 s without one, within an
/// eighth and twenty of the motion's periods where these are known.
pub fn default_horizon(rig: &Rig, period_s: Option<f64>) -> f64 {
    let period_s = period_s.filter(|t| t.is_finite() && *t > 0.0);
    let free = || period_s.map_or(FREE_S, |t| FREE_S.clamp(FREE_PERIODS[0] * t, FREE_PERIODS[1] * t));
    rig.drive.map_or_else(free, |d| 1.0 / d.frequency_hz)
}

/// Horizon of the gap: that which is asked for, or the default; sixteen samples at least.
pub fn horizon(rig: &Rig, settings: &Settings, stretches: &[Stretch], period_s: f64) -> Result<f64> {
    // An initial state is fitted to them, as to those of a piece.
    let fewest = FEWEST_SAMPLES as f64;
    let step = 1.0 / rig.sample_rate_hz;
    let longest = stretches.iter().map(|s| s.len() as f64 * s.step_s).fold(0.0, f64::max);
    let default = default_horizon(rig, Some(period_s));
    let default = if rig.drive.is_some() { default } else { default.min(MOST_OF_STRETCH * longest) };
    let least = fewest * step;
    let Some(asked) = settings.horizon_s else { return Ok(default.max(least)) };
    limits::within(asked, least, longest).ok_or_else(|| {
        BadInput::new(asked.to_string(), format!("seconds from {}", limits::range(least, longest))).at("--horizon")
    })
}

/// SI unit of a coordinate.
pub fn si_unit(rig: &Rig, bound: &ObservedModel, coordinate: usize) -> String {
    let row = (0..bound.sensors.len()).find(|&r| bound.shown[(r, coordinate)] != 0.0).unwrap_or(0);
    rig.channel[bound.sensors[row]].si_unit().to_owned()
}

/// Whether each coordinate is a length or an angle.
pub fn moves(rig: &Rig, bound: &ObservedModel) -> Vec<bool> {
    (0..bound.model.coordinates.len()).map(|k| matches!(si_unit(rig, bound, k).as_str(), "rad" | "m")).collect()
}

/// Whether two coordinates have one unit, so that their difference is something.
pub fn alike(rig: &Rig, bound: &ObservedModel, i: usize, j: usize) -> bool {
    si_unit(rig, bound, i) == si_unit(rig, bound, j)
}

/// What is not looked for where the rig file leaves a coordinate's unit open.
pub fn unknown(rig: &Rig, bound: &ObservedModel) -> Option<Warning> {
    let open = |k: &usize| si_unit(rig, bound, *k) == "1";
    let names: Vec<&str> =
        (0..bound.model.coordinates.len()).filter(open).map(|k| bound.model.coordinates[k].name.as_str()).collect();
    (!names.is_empty()).then(|| {
        Warning::new(
            "unit-unknown",
            format!("The unit of {} is left open: dry friction and drag were not looked for", names.join(", ")),
            "If it is an angle or a length, say so in the rig file's channel (unit = \"rad\", \"deg\", \"m\", \"mm\" …)",
        )
    })
}

/// What is told of sensors whose noise is coloured.
pub fn coloured(rig: &Rig, bound: &ObservedModel, all: &[Coloured]) -> Vec<Warning> {
    let one = |c: &Coloured| {
        let channel = &rig.channel[bound.sensors[c.sensor]];
        let in_channel = |sigma: f64| quantity(sigma / channel.scale(), &channel.unit, 3);
        Warning::new(
            "smoothed",
            format!(
                "{} has noise of {} below {} and hardly any above ({}): the record was smoothed, or its sensor is slow",
                channel.name,
                in_channel(c.sigma),
                quantity(c.corner_hz, "Hz", 2),
                in_channel(c.before)
            ),
            "What the model leaves is taken for the noise. Give the record as the sensor showed it: intervals are then \
             right, and fainter effects show",
        )
        .with("channel", channel.name.clone())
        .with("value", c.sigma / channel.scale())
        .with("corner_hz", c.corner_hz)
    };
    all.iter().map(one).collect()
}

/// What is told of a sum over coordinates of different units.
const MIXED: &str = "mixed units";

/// The unit in which simulation errors are told: degrees where everything is an angle.
pub struct Unit {
    /// Its name.
    pub name: String,
    /// How many of it an SI unit is.
    pub factor: f64,
}

impl Unit {
    /// For a rig.
    pub fn of(rig: &Rig, bound: &ObservedModel) -> Self {
        let units: Vec<String> = (0..bound.model.coordinates.len()).map(|k| si_unit(rig, bound, k)).collect();
        match units.first() {
            Some(first) if units.iter().all(|u| u == first) => Self::named(first),
            _ => Self { name: MIXED.to_owned(), factor: 1.0 },
        }
    }

    /// For what one sensor shows: its own unit, whatever the others have.
    pub fn of_sensor(rig: &Rig, bound: &ObservedModel, sensor: usize) -> Self {
        Self::named(rig.channel[bound.sensors[sensor]].si_unit())
    }

    /// For an SI unit.
    fn named(unit: &str) -> Self {
        match unit {
            "rad" => Self { name: "deg".to_owned(), factor: 180.0 / core::f64::consts::PI },
            other => Self { name: other.to_owned(), factor: 1.0 },
        }
    }
}

impl Unit {
    /// One noise floor, the rms noise of the sensors; none where they have no unit in common.
    pub fn noise(&self, sigma: &[f64]) -> Option<InUnit> {
        let rms = (sigma.iter().map(|s| s * s).sum::<f64>() / sigma.len() as f64).sqrt() * self.factor;
        let unit = if self.name == "deg" { "°".to_owned() } else { self.name.clone() };
        (self.name != MIXED && rms.is_finite() && rms > 0.0).then_some(InUnit { value: rms, unit })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::signal::angles::Phase;

    #[test]
    fn a_horizon_is_taken_as_it_is_printed() {
        let mut rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/duffing.toml")).unwrap();
        (rig.sample_rate_hz, rig.drive) = (29.960_081_16, None);
        let stretch = Stretch {
            start_s: 0.0,
            step_s: 1.0 / rig.sample_rate_hz,
            coordinates: vec![vec![0.0; 626]],
            inputs: Vec::new(),
            phase: Phase::Clock(1.0),
            amplitude_nm: None,
            history: None,
            base: None,
        };
        let of = |h: f64| {
            let settings = Settings { horizon_s: Some(h), ..Settings::default() };
            horizon(&rig, &settings, std::slice::from_ref(&stretch), 2.5)
        };
        let least = 16.0 / rig.sample_rate_hz;
        assert_eq!((of(0.534), of(2.0)), (Ok(least), Ok(2.0)));
        let refused = of(0.5).unwrap_err().to_string();
        assert!(refused.contains("expected seconds from 0.535 to 20.8"), "{refused}");
    }

    #[test]
    fn what_is_recorded_in_parts_of_a_unit_is_told_in_it() {
        let mut rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/duffing.toml")).unwrap();
        let bound = rig.bound.clone().unwrap();
        for (unit, told) in [("mm", "m"), ("mV", "V"), ("mN", "N"), ("kN", "N"), ("deg", "deg")] {
            rig.channel[bound.sensors[0]].unit = unit.to_owned();
            assert_eq!(Unit::of(&rig, &bound).name, told, "{unit}");
        }
    }

    #[test]
    fn what_one_sensor_shows_is_told_in_its_own_unit() {
        let mut rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/duffing.toml")).unwrap();
        let bound = rig.bound.clone().unwrap();
        for (unit, told, factor) in [("rad", "deg", 180.0 / core::f64::consts::PI), ("mm", "m", 1.0)] {
            rig.channel[bound.sensors[0]].unit = unit.to_owned();
            let found = Unit::of_sensor(&rig, &bound, 0);
            assert_eq!((found.name.as_str(), found.factor), (told, factor));
        }
    }
}

//! How far predictions miss: the gap and its steps, forecasts.

use core::fmt::{self, Display, Formatter};

use serde::{Serialize, Serializer};

use super::decidability::EXPLAINED_GAP;
use super::engine::attractor::Attractor;
use crate::wording::format::{quantity, significant};
use crate::wording::names;

/// One step of the gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// What was added; none for the nominal model.
    pub added: Option<String>,
    /// The gap.
    pub value: f64,
}

impl Step {
    /// The model that it is of, an effect that was added behind a word.
    pub fn told(&self, word: &str) -> String {
        match self.added.as_deref() {
            None => "the model as it was".to_owned(),
            Some("refit") => "refitted to this record".to_owned(),
            Some(added) => format!("{word} {}", names::effect(added)),
        }
    }

    /// Whether its value is a number.
    pub(super) fn is_finite(&self) -> bool {
        self.value.is_finite()
    }
}

/// The gap at a longer horizon, an array in JSON.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtHorizon {
    /// Horizon, s.
    pub horizon_s: f64,
    /// Before anything was added.
    pub before: f64,
    /// After.
    pub after: f64,
}

impl Serialize for AtHorizon {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        self.numbers().serialize(to)
    }
}

impl AtHorizon {
    /// Horizon, gap before, gap after.
    pub fn numbers(&self) -> [f64; 3] {
        [self.horizon_s, self.before, self.after]
    }
}

/// The gap before and after each step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// `noise floors`.
    pub unit: &'static str,
    /// 1.
    pub floor: f64,
    /// One noise floor in the sensors' own unit, where they share one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor_in: Option<InUnit>,
    /// How much the record itself moves over the same windows, about its mean, in `unit`:
    /// predictions that miss by more diverged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<f64>,
    /// Horizon, s.
    pub horizon_s: f64,
    /// The steps.
    pub steps: Vec<Step>,
    /// The same at longer horizons: horizon in s, gap before, gap after.
    pub horizons: Vec<AtHorizon>,
    /// Prediction horizon and Poincaré section before and, where effects were added, after.
    pub attractor: Vec<Attractor>,
    /// Predictions of the record's last 30 % by models fitted to the first 70 %.
    pub forecasts: Vec<Forecast>,
}

/// A value with its unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InUnit {
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

impl InUnit {
    /// The sensors' noise, where it is one noise floor.
    fn noise(&self) -> String {
        format!("the sensors' noise is {}", quantity(self.value, &self.unit, 3))
    }
}

/// How far predictions miss, in the unit in which that says something.
#[derive(Clone, Debug, PartialEq)]
pub enum Miss {
    /// In noise floors.
    Floors(f64),
    /// In the sensors' own unit: noise floors are so many that they tell nothing.
    Own {
        /// In the unit of `floor`.
        value: f64,
        /// One noise floor.
        floor: InUnit,
    },
    /// By more than the record itself moves.
    Diverged,
}

impl Miss {
    /// The number alone, with its unit where it is not that of all gaps.
    pub(super) fn number(&self) -> String {
        match self {
            Self::Floors(value) => significant(*value, 3),
            Self::Own { value, floor } => quantity(*value, &floor.unit, 3),
            Self::Diverged => "no prediction: the fit diverged".to_owned(),
        }
    }
}

impl Display for Miss {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.number())?;
        match self {
            Self::Floors(_) => f.write_str(" noise floors"),
            Self::Own { floor, .. } => write!(f, " ({})", floor.noise()),
            Self::Diverged => Ok(()),
        }
    }
}

/// How many times nearer predictions come where that is told of the gap's own horizon (by hand).
const CLEARLY: f64 = 2.0;

/// Noise floors up to which a gap is told in them.
const MANY_FLOORS: f64 = 100.0;

impl Gap {
    /// Whether predictions that miss by `value` say less than the record's mean would. Where
    /// nothing is known of the motion, whether it is a number at all.
    pub(super) fn diverged(&self, value: f64) -> bool {
        let most = self.motion.map_or(f64::MAX, |m| m.max(EXPLAINED_GAP));
        value.is_nan() || value > most
    }

    /// What the noise is, in the sensors' unit.
    pub(super) fn noise(&self) -> String {
        self.floor_in.as_ref().map_or_else(String::new, InUnit::noise)
    }

    /// The gap before and after at the horizon at which the change shows most, where at the gap's own
    /// it is less than [`CLEARLY`]: what adds up slowly is no more than the noise over a short one.
    pub(super) fn telling(&self) -> Option<AtHorizon> {
        let [first, last] = [self.steps.first()?, self.steps.last()?].map(|s| s.value);
        let own = AtHorizon { horizon_s: self.horizon_s, before: first, after: last };
        let ratio = |h: &AtHorizon| h.before / h.after;
        let longer = self.horizons.iter().filter(|h| ratio(h).is_finite() && !self.diverged(h.before));
        let best = longer.max_by(|a, b| ratio(a).total_cmp(&ratio(b))).filter(|h| ratio(h) > ratio(&own));
        Some(*best.filter(|_| ratio(&own) < CLEARLY).unwrap_or(&own))
    }

    /// How far predictions with this gap miss.
    pub fn miss(&self, value: f64) -> Miss {
        self.miss_beside(value, value)
    }

    /// The same beside another gap, in a unit in which both say something.
    pub(super) fn miss_beside(&self, value: f64, other: f64) -> Miss {
        let is_many = value.max(other) > MANY_FLOORS && !self.diverged(other);
        match &self.floor_in {
            _ if self.diverged(value) => Miss::Diverged,
            Some(floor) if is_many || value > MANY_FLOORS => {
                Miss::Own { value: value * floor.value, floor: floor.clone() }
            }
            _ => Miss::Floors(value),
        }
    }
}

/// Rms error of predictions over a horizon on the record's last 30 %, after fitting the first 70 %;
/// initial states are fitted to each window.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Forecast {
    /// Horizon, s.
    pub horizon_s: f64,
    /// Unit of the values.
    pub unit: String,
    /// The same steps as the gap's.
    pub steps: Vec<Step>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_at_a_longer_horizon_is_an_array() {
        let gap = AtHorizon { horizon_s: 0.4, before: 5.5, after: f64::NAN };
        assert_eq!(serde_json::to_string(&gap).unwrap(), "[0.4,5.5,null]");
    }

    #[test]
    fn a_step_says_of_which_model_it_is() {
        let told = |added: Option<&str>| Step { added: added.map(str::to_owned), value: 1.0 }.told("with");
        assert_eq!(told(None), "the model as it was");
        assert_eq!(told(Some("refit")), "refitted to this record");
        assert_eq!(told(Some("quadratic-drag@arm2")), "with quadratic drag on arm 2");
    }
}

//! How far predictions miss: the gap and its steps, forecasts.

use serde::Serialize;

use super::decidability::EXPLAINED_GAP;
use super::engine::attractor::Attractor;
use crate::report::format::{quantity, significant};

/// One step of the gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// What was added; none for the nominal model.
    pub added: Option<String>,
    /// The gap.
    pub value: f64,
}

impl Step {
    /// Whether its value is a number.
    pub(super) fn is_finite(&self) -> bool {
        self.value.is_finite()
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
    pub horizons: Vec<(f64, f64, f64)>,
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
        self.floor_in.as_ref().map_or_else(String::new, |floor| {
            format!("the sensors' noise is {}", quantity(floor.value, &floor.unit, 3))
        })
    }

    /// A value in words: in noise floors, or, where these are so many that they tell nothing, in
    /// the sensors' own unit.
    pub fn told(&self, value: f64) -> String {
        if self.diverged(value) {
            return "no prediction: the fit diverged".to_owned();
        }
        match &self.floor_in {
            Some(floor) if value > MANY_FLOORS => {
                format!("{} ({})", quantity(value * floor.value, &floor.unit, 3), self.noise())
            }
            _ => format!("{} noise floors", significant(value, 3)),
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

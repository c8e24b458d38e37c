//! What an explanation says: verdict, effects, gap, places, parameters.

use std::collections::BTreeMap;

use serde::Serialize;

use super::residual_map;
use crate::identify::Parameter;
use crate::warning::Warning;

/// The verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The nominal model leaves nothing but the sensors' noise, and no effect improves it.
    NothingMissing,
    /// With the named effects nothing but noise is left.
    Explained,
    /// A disagreement above the noise is left that no named effect accounts for.
    Unexplained,
    /// This record could not show most effects.
    NotDecidable,
}

/// An effect that was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Effect.
    pub id: String,
    /// Place.
    pub at: String,
    /// Value.
    pub value: f64,
    /// Standard error.
    pub std_error: f64,
    /// Unit of both.
    pub unit: String,
    /// What it adds.
    pub equation: String,
    /// Parameters beyond the value.
    pub parameters: BTreeMap<String, f64>,
    /// Effects that held-out data do not tell from it, `ID@PLACE`.
    pub indistinguishable_from: Vec<String>,
    /// Probability of so large a strength by chance.
    pub p_value: f64,
    /// Share of the held-out weighted residual power that it took away.
    pub held_out_gain: f64,
    /// The next best candidate and its share, for the audit.
    pub runner_up: Option<(String, f64)>,
    /// The laboratory test that would confirm it.
    pub confirm: String,
}

/// One step of the gap.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// What was added; none for the nominal model.
    pub added: Option<String>,
    /// The gap.
    pub value: f64,
}

/// The gap before and after each step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// `noise floors`.
    pub unit: &'static str,
    /// 1.
    pub floor: f64,
    /// Horizon, s.
    pub horizon_s: f64,
    /// The steps.
    pub steps: Vec<Step>,
    /// The same at longer horizons: horizon in s, gap before, gap after.
    pub horizons: Vec<(f64, f64, f64)>,
}

/// A candidate's score in the first step, for the ranking's figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranked {
    /// `ID@PLACE`.
    pub name: String,
    /// Share of the held-out weighted residual power that it takes away.
    pub gain: f64,
    /// Probability by chance.
    pub p_value: f64,
    /// Step in which it was judged.
    pub step: usize,
}

/// Result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// Verdict.
    pub verdict: Verdict,
    /// Why.
    pub reason: String,
    /// Effects in the order in which they were added.
    pub effects: Vec<Found>,
    /// The gap.
    pub gap: Gap,
    /// Where the disagreement sits.
    pub r#where: Vec<residual_map::Where>,
    /// Parameters of the model with its effects.
    pub parameters: Vec<Parameter>,
    /// Ratio of residual to noise power in the rows, before and after.
    pub residual_power: [f64; 2],
    /// Best candidates of each step.
    pub ranking: Vec<Ranked>,
    /// Residual maps, for the figures.
    pub maps: Vec<residual_map::Map>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

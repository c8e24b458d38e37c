//! What an explanation says: verdict, effects, places, parameters; [`super::gap`] has the gap.

use std::collections::BTreeMap;

use serde::Serialize;

use super::engine::compared::Compared;
use super::engine::outliers::Outlier;
use super::engine::residual_map;
use super::engine::unknown::Unknown;
pub use super::gap::{AtHorizon, Forecast, Gap, InUnit, Step};
use super::reason::{Criterion, Reason};
use crate::identify::Parameter;
use crate::model::identified::{AddedEffect, IdentifiedModel};
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
    /// Standard errors of those of them that were fitted.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub parameter_std_errors: BTreeMap<String, f64>,
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
    /// Strengths as they enter the equations.
    #[serde(skip)]
    pub strengths: Vec<f64>,
}

impl Found {
    /// `ID@PLACE`.
    pub fn name(&self) -> String {
        format!("{}@{}", self.id, self.at)
    }

    /// As a model's file holds it.
    pub(super) fn added(&self) -> AddedEffect {
        AddedEffect {
            id: self.id.clone(),
            at: self.at.clone(),
            value: self.value,
            std_error: self.std_error,
            unit: self.unit.clone(),
            strengths: self.strengths.clone(),
            parameters: self.parameters.clone(),
        }
    }

    /// An effect at a place of which nothing else is known yet.
    pub(super) fn empty(id: &str, at: &str, unit: String) -> Self {
        Self {
            id: id.to_owned(),
            at: at.to_owned(),
            value: 0.0,
            std_error: 0.0,
            unit,
            equation: String::new(),
            parameters: BTreeMap::new(),
            parameter_std_errors: BTreeMap::new(),
            indistinguishable_from: Vec::new(),
            p_value: 1.0,
            held_out_gain: 0.0,
            runner_up: None,
            confirm: String::new(),
            strengths: Vec::new(),
        }
    }
}

/// How the numbers came about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Details {
    /// Samples used.
    pub samples: usize,
    /// Length of a window, s.
    pub window_s: f64,
    /// Length of the pieces by whose simulation the coefficients were fitted in the end, s; none
    /// where they are those of the windows.
    pub simulated_s: Option<f64>,
    /// Highest frequency of the test functions, Hz.
    pub max_frequency_hz: f64,
    /// Pass band of the low-pass, Hz.
    pub pass_hz: f64,
    /// Standard deviation of each sensor's noise, in SI units: rad for angles, m for positions.
    pub noise_rad: Vec<f64>,
    /// Probability of naming anything where nothing is missing.
    pub family_wise: f64,
    /// Folds of the cross-validation.
    pub folds: usize,
}

/// A candidate's score in a step, for the ranking's figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranked {
    /// `ID@PLACE`.
    pub name: String,
    /// Share of the held-out weighted residual power that it takes away.
    pub gain: f64,
    /// That gain over its standard error between blocks.
    pub deviations: f64,
    /// Probability by chance.
    pub p_value: f64,
    /// Step in which it was judged.
    pub step: usize,
}

/// How it is told that chance may have made what a candidate takes off.
pub(super) const BY_CHANCE: &str = "by chance with probability";

/// A candidate that was close and is not in the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refused {
    /// Effect.
    pub id: String,
    /// Place.
    pub at: String,
    /// Why it is not.
    pub why: String,
}

impl Refused {
    /// For `ID@PLACE`.
    pub(super) fn new(name: &str, why: String) -> Self {
        let (id, at) = name.split_once('@').unwrap_or((name, ""));
        Self { id: id.to_owned(), at: at.to_owned(), why }
    }

    /// Whether chance may have made what it takes off.
    pub(super) fn is_by_chance(&self) -> bool {
        self.why.starts_with(BY_CHANCE)
    }

    /// `ID@PLACE`; the effect alone where it has no place.
    pub fn name(&self) -> String {
        if self.at.is_empty() { self.id.clone() } else { format!("{}@{}", self.id, self.at) }
    }
}

/// The strength of an effect from which on it would have shown in 95 of 100 such records.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Limit {
    /// Effect.
    pub id: String,
    /// Place.
    pub at: String,
    /// Value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
}

impl Limit {
    /// `ID@PLACE`.
    pub(super) fn name(&self) -> String {
        format!("{}@{}", self.id, self.at)
    }
}

/// The number that made a verdict: of those that were compared with a limit the one that is largest
/// beside it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecidedBy {
    /// What was compared.
    pub what: Criterion,
    /// Its value.
    pub value: f64,
    /// The limit: above it something is left.
    pub limit: f64,
}

/// Result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// Verdict.
    pub verdict: Verdict,
    /// Why.
    pub reason: Reason,
    /// The number behind the verdict; none where nothing could be decided.
    pub decided_by: Option<DecidedBy>,
    /// Effects in the order in which they were added.
    pub effects: Vec<Found>,
    /// The gap.
    pub gap: Gap,
    /// Where what is left sits.
    pub r#where: Vec<residual_map::Where>,
    /// Where the model disagreed before any effect was added.
    pub where_before: Vec<residual_map::Where>,
    /// Parameters of the model with its effects.
    pub parameters: Vec<Parameter>,
    /// Parameters of the fitted model before any effect was added.
    pub parameters_before: Vec<Parameter>,
    /// What was measured over some seconds, and what the models before and after predict of them.
    pub prediction: Option<Compared>,
    /// Ratio of residual to noise power in the rows, before and after; left out where there is
    /// none.
    #[serde(skip_serializing_if = "has_nan")]
    pub residual_power: [f64; 2],
    /// Every candidate of each step in its best form, the likeliest first.
    pub ranking: Vec<Ranked>,
    /// Candidates that were close in the last step, or were taken and given up, and why.
    pub refused: Vec<Refused>,
    /// Detection limits of effects of one form, where nothing but noise is left: how large each
    /// would have to be to show in 95 of 100 such records, under its own name or one that is hardly
    /// told from it.
    pub detection_limits: Vec<Limit>,
    /// Residual maps, for the figures.
    pub maps: Vec<residual_map::Map>,
    /// The same maps before any effect was added; empty where none was.
    pub maps_before: Vec<residual_map::Map>,
    /// Shape of what is left, where it has no name.
    pub unknown: Option<Unknown>,
    /// Errors of free runs; empty under a drive.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub simulation: Vec<super::engine::simulation::Simulation>,
    /// How the numbers came about.
    pub details: Details,
    /// Effects of the model that was given, refitted.
    #[serde(skip)]
    pub given: Vec<AddedEffect>,
    /// The model with its effects, for its file.
    #[serde(skip)]
    pub model: Option<IdentifiedModel>,
    /// Samples that stand alone far from what the model says, where something is left unexplained.
    #[serde(skip)]
    pub outliers: Vec<Outlier>,
    /// Whether slips of single counts show in what the first model leaves; none where it was not
    /// looked for.
    #[serde(skip)]
    pub slips_show: Option<bool>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

fn has_nan(of: &[f64; 2]) -> bool {
    of.iter().any(|x| !x.is_finite())
}

impl Explanation {
    /// Whether the last fit diverged; what is not a number is then left out, so that nothing of it
    /// is told.
    pub(super) fn settle(&mut self) -> bool {
        let diverged = self.gap.steps.last().is_none_or(|s| self.gap.diverged(s.value));
        let (all, gap) = (self.gap.steps.len(), self.gap.clone());
        self.gap.steps.retain(|s| !gap.diverged(s.value) && s.is_finite());
        if !diverged && self.gap.steps.len() < all {
            self.warnings.push(Warning::new(
                "diverged",
                "predictions by the model before it was fitted miss by more than the record itself moves",
                "They are left out of the gap",
            ));
        }
        self.gap.horizons.retain(|h| h.numbers().iter().all(|x| x.is_finite()));
        self.gap.attractor.retain(|a| a.prediction_horizon_s.is_finite());
        self.gap.forecasts.iter_mut().for_each(|f| f.steps.retain(Step::is_finite));
        self.simulation.iter_mut().for_each(|s| s.steps.retain(Step::is_finite));
        diverged
    }

    /// What was measured step by step: the gap, forecasts, free runs.
    pub(super) fn steps(&mut self) -> impl Iterator<Item = &mut Vec<Step>> {
        let forecasts = self.gap.forecasts.iter_mut().map(|f| &mut f.steps);
        forecasts.chain([&mut self.gap.steps]).chain(self.simulation.iter_mut().map(|s| &mut s.steps))
    }

    /// Tells what was refused, each reason once: one effect may be refused in several forms.
    pub(super) fn refuse(&mut self, all: impl IntoIterator<Item = Refused>) {
        for one in all {
            if !self.refused.contains(&one) {
                self.refused.push(one);
            }
        }
    }

    /// Takes the step of an effect out that is gone.
    pub(super) fn forget(&mut self, gone: &str) {
        self.steps().for_each(|steps| steps.retain(|s| s.added.as_deref() != Some(gone)));
    }

    /// Nothing known yet.
    pub(super) fn new(horizon_s: f64, warnings: Vec<Warning>) -> Self {
        let gap = Gap {
            unit: "noise floors",
            floor: 1.0,
            floor_in: None,
            motion: None,
            horizon_s,
            steps: Vec::new(),
            horizons: Vec::new(),
            attractor: Vec::new(),
            forecasts: Vec::new(),
        };
        Self {
            verdict: Verdict::NotDecidable,
            reason: Reason::Unjudged,
            decided_by: None,
            effects: Vec::new(),
            gap,
            r#where: Vec::new(),
            where_before: Vec::new(),
            parameters: Vec::new(),
            parameters_before: Vec::new(),
            prediction: None,
            residual_power: [f64::NAN; 2],
            ranking: Vec::new(),
            refused: Vec::new(),
            detection_limits: Vec::new(),
            maps: Vec::new(),
            maps_before: Vec::new(),
            unknown: None,
            simulation: Vec::new(),
            details: Details::default(),
            given: Vec::new(),
            model: None,
            outliers: Vec::new(),
            slips_show: None,
            warnings,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(motion: f64, values: &[f64]) -> Explanation {
        let mut out = Explanation::new(0.2, Vec::new());
        out.gap.motion = Some(motion);
        out.gap.floor_in = Some(InUnit { value: 1e-7, unit: "m".to_owned() });
        out.gap.steps = values.iter().map(|v| Step { added: None, value: *v }).collect();
        out
    }

    #[test]
    fn what_misses_by_more_than_the_record_moves_diverged() {
        for (last, diverged) in [(1.2, false), (900.0, false), (1e46, true), (f64::NAN, true), (f64::INFINITY, true)] {
            let mut e = with(1000.0, &[5.0, last]);
            assert_eq!(e.settle(), diverged, "{last}");
            let text = serde_json::to_string(&e).unwrap();
            assert!(
                !text.contains("null,\"value\":null") && !text.contains("e46") && !text.contains("residual_power"),
                "{text}"
            );
        }
        // A record at rest: its motion is noise, and so is what predictions miss.
        assert!(!with(1.0, &[1.1]).settle());
        assert!(with(1000.0, &[]).settle());
    }

    #[test]
    fn many_noise_floors_are_told_in_the_sensors_unit() {
        let e = with(1e6, &[]);
        assert_eq!(e.gap.miss(3.25).to_string(), "3.25 noise floors");
        assert_eq!(e.gap.miss(91_000.0).to_string(), "9.10 mm (the sensors' noise is 100 nm)");
        assert!(e.gap.miss(f64::NAN).to_string().contains("diverged"));
    }
}

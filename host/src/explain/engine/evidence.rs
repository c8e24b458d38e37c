//! What candidates are judged by: windows of linearised shooting; rows of the weak form where the
//! model follows none. One fit and one choice over either.

use nalgebra::{DMatrix, DVector};

use super::candidates::{Candidate, Column};
use super::design::Design;
use super::exchange::MISSES;
use super::power::{Power, Repeats};
use super::prediction::Range;
use super::relaxation::Relaxation;
use super::setting::Setting;
use super::shooting::blocks::Blocks;
use super::shooting::{Followed, Ground};
use super::state::State;
use super::{design, memory, moved_forms, power, shooting};
use crate::error::{BadInput, Result};
use crate::explain::decision;
use crate::explain::ranking::{self, FOLDS, Fit, Weights};
use crate::identify::jackknife::widening;
use crate::steps;
use crate::wording::names;

/// Share of what is left above the sensors' noise that a candidate must take away in shooting: less
/// is as good as nothing where a model misses more than noise (by hand).
const LEAST_SHARE: f64 = 0.01;

/// Standard errors between windows at which a gain counts (by hand).
const LEAST_DEVIATIONS: f64 = 2.0;

/// Difference of two sums of squares in units of the noise's, d², that the noise makes of itself: of
/// predictions d standard errors apart they differ by d² ± 2d, which is one standard error at 4.
const LEAST_APART: f64 = 4.0;

/// Most rounds of shooting after something has joined, and the share of what is left by which it
/// falls while it still does (by hand).
const MOST_ROUNDS: usize = 12;
const STILL_FALLS: f64 = 0.005;

/// Columns of the model's own, of what was chosen, then of every candidate.
pub enum Evidence {
    /// Of the weak form, with their weights.
    Weak(Design, Weights),
    /// Of trajectories.
    Shooting(Blocks),
}

/// The last round: columns of the model and of the candidates, and the fit of the model's own.
pub struct Outcome {
    pub candidates: Vec<Candidate>,
    pub evidence: Evidence,
    pub own: Vec<usize>,
    pub fit: Fit,
}

impl decision::Evidence for Blocks {
    fn fit(&self, columns: &[usize]) -> Option<Fit> {
        Blocks::fit(self, columns)
    }

    fn fit_of_either_sign(&self, columns: &[usize], d: usize) -> Option<Fit> {
        Blocks::fit_of_either_sign(self, columns, d)
    }

    fn least_p(&self, columns: &[usize], d: usize) -> Option<f64> {
        self.p_of_even_noise(columns, d)
    }

    fn rescored(&self, _own: &[usize], _most: usize, _scores: &[(f64, (usize, usize))]) -> Option<Vec<f64>> {
        None
    }

    fn least_gain(&self, total: f64) -> f64 {
        LEAST_SHARE * (total - self.noise()).max(0.0)
    }

    fn least_deviations(&self) -> f64 {
        LEAST_DEVIATIONS
    }

    fn is_above_noise(&self, gain: f64, total: f64) -> bool {
        let deviations = (gain / LEAST_APART).max(0.0).sqrt();
        self.are_parts && total <= MISSES * self.noise() && deviations > LEAST_DEVIATIONS
    }

    fn least_apart(&self) -> f64 {
        LEAST_APART
    }
}

impl Evidence {
    /// Whether strengths of a candidate are those that a record without it shows as well: in rows
    /// that hold the sensors' noise in products. Shooting predicts what the sensors show.
    pub fn feigned(
        &self,
        setting: &Setting<'_>,
        state: &State,
        x: &DVector<f64>,
        candidate: &Candidate,
        fit: &Fit,
    ) -> bool {
        match self {
            Self::Weak(design, weights) => power::feigned(setting, state, design, weights, x, candidate, fit),
            Self::Shooting(_) => false,
        }
    }

    /// Whether trajectories are judged.
    pub fn is_shooting(&self) -> bool {
        matches!(self, Self::Shooting(_))
    }

    /// Fits of the same rows with each of some groups of columns of no effect behind the model's
    /// own, with a ridge on the group's.
    pub fn with_groups(
        &self,
        setting: &Setting<'_>,
        state: &State,
        own: usize,
        groups: &[Vec<Column>],
        ridge: f64,
    ) -> Vec<Option<Fit>> {
        let ridges = |count: usize| [vec![0.0; own], vec![ridge; count]].concat();
        match self {
            Self::Weak(_, weights) => {
                let one = |group: &Vec<Column>| {
                    let design = design::with_columns(setting, state, &state.stretches, &[], group).ok()?;
                    let all: Vec<usize> = (0..own + group.len()).collect();
                    ranking::fit_ridge(&design, &all, weights, &ridges(group.len()))
                };
                groups.iter().map(one).collect()
            }
            Self::Shooting(_) => {
                let blocks = shooting::evidence(setting, state, &[], false, groups);
                let mut at = own;
                let one = |group: &Vec<Column>| {
                    let all: Vec<usize> = (0..own).chain(at..at + group.len()).collect();
                    at += group.len();
                    blocks.as_ref()?.fit_ridge(&all, &ridges(group.len()))
                };
                groups.iter().map(one).collect()
            }
        }
    }
}

impl Outcome {
    /// The covariance that is told.
    pub fn covariance(&self) -> DMatrix<f64> {
        match &self.evidence {
            Evidence::Shooting(blocks) => blocks.covariance(&self.own, &self.fit),
            Evidence::Weak(..) => &self.fit.covariance * widening(self.fit.blocks).powi(2),
        }
    }

    /// What the coefficients of the training windows, `fit.train`, were not fitted to.
    pub fn held_out(&self, setting: &Setting<'_>) -> Vec<Range> {
        match &self.evidence {
            Evidence::Weak(design, _) => design.held_out(setting),
            Evidence::Shooting(blocks) => blocks.places.iter().step_by(FOLDS).copied().collect(),
        }
    }

    /// Held-out sum of squares of shooting, in units that do not change from one step to the next;
    /// none for the weak form.
    pub fn left(&self) -> Option<f64> {
        match &self.evidence {
            Evidence::Weak(..) => None,
            Evidence::Shooting(blocks) => blocks.held_out(&self.own),
        }
    }

    /// Whether another state with columns of no effect behind its own predicts what was not fitted
    /// as well.
    pub fn is_matched(&self, setting: &Setting<'_>, other: &State, behind: &[Column]) -> bool {
        let all: Vec<usize> = (0..other.own_columns() + behind.len()).collect();
        match &self.evidence {
            Evidence::Weak(_, weights) => {
                let design = design::with_columns(setting, other, &other.stretches, &[], behind).ok();
                let fit = design.and_then(|d| ranking::fit(&d, &all, weights));
                fit.is_some_and(|free| ranking::gain(&self.fit.held_out, &free.held_out).0 >= 0.0)
            }
            Evidence::Shooting(_) => {
                let behind = [behind.to_vec()];
                let free = shooting::evidence(setting, other, &[], false, &behind).and_then(|b| b.held_out(&all));
                free.zip(self.left()).is_some_and(|(free, named)| free <= named)
            }
        }
    }

    /// Coefficients from windows of shooting that end before a sample of a stretch, and from all
    /// other stretches.
    pub fn until(&self, stretch: usize, sample: usize) -> Option<DVector<f64>> {
        match &self.evidence {
            Evidence::Weak(..) => None,
            Evidence::Shooting(blocks) => blocks.of_some(&self.own, |r| r.stretch != stretch || r.end <= sample),
        }
    }

    /// Coefficients from what lies before a sample of a stretch, the first `share` of the record.
    pub fn before(&self, stretch: usize, sample: usize, share: f64) -> Option<DVector<f64>> {
        match &self.evidence {
            Evidence::Weak(design, weights) => {
                let end = (share * design.windows.len() as f64) as usize;
                ranking::fit_some(design, &self.own, weights, |k| k + 2 <= end)
            }
            Evidence::Shooting(blocks) => blocks.of_some(&self.own, |r| (r.stretch, r.end) <= (stretch, sample)),
        }
    }

    /// Ratio of what is left to what the sensors' noise gives: over the long horizon, or in the
    /// rows of the weak form.
    ///
    /// # Errors
    /// As [`design::residual`].
    pub fn power(&self, setting: &Setting<'_>, state: &State) -> Result<f64> {
        match &self.evidence {
            Evidence::Weak(..) => Ok(self.rows(setting, state, &Repeats::of(setting, state)?)?.ratio),
            Evidence::Shooting(_) => {
                let all = self.powers();
                Ok(all.iter().sum::<f64>() / all.len().max(1) as f64)
            }
        }
    }

    /// The same in every window of shooting.
    pub fn powers(&self) -> Vec<f64> {
        match &self.evidence {
            Evidence::Weak(..) => Vec::new(),
            Evidence::Shooting(blocks) => blocks.misfits(&self.fit.all).iter().map(|w| w[0]).collect(),
        }
    }

    /// What is left in the rows of the weak form, by frequency.
    ///
    /// # Errors
    /// An effect that the weak form cannot hold.
    pub fn rows(&self, setting: &Setting<'_>, state: &State, repeats: &Repeats) -> Result<Power> {
        let x = &self.fit.all;
        if let Evidence::Weak(design, _) = &self.evidence {
            return power::power(setting, state, repeats, design, &self.own, x);
        }
        let design = design::build(setting, state, &state.stretches, &[])?;
        power::power(setting, state, repeats, &design, &self.own, x)
    }
}

fn singular() -> BadInput {
    BadInput::new(
        "too little motion, or too few windows, to fit the model and hold some back",
        "motion in which every term takes part",
    )
    .remedy("Record more of it: several releases of a motion that dies away, a longer record of another, with a larger amplitude or a higher sampling rate; `whirl inspect` shows what each channel does")
}

/// Fits everything chosen, renews what rests on the coefficients, and builds the candidates'
/// columns behind its own.
///
/// # Errors
/// Columns that the record does not determine.
pub fn refit(setting: &Setting<'_>, state: &mut State, candidates: Vec<Candidate>) -> Result<Outcome> {
    // The first rounds settle weights, linearised effects and forms; the last carries the
    // candidates' columns as well.
    // Trajectories are followed on while a rotation moves.
    let settles = |c: &Candidate| c.is_refined() || (!setting.shooting && c.turned_by().is_some());
    let rounds = if state.chosen.iter().any(|k| settles(&k.candidate)) { 4 } else { 2 };
    state.relaxation = Relaxation::default();
    tell_step(setting, state, candidates.len());
    if setting.shooting {
        by_shooting(setting, state, candidates, rounds)
    } else {
        by_rows(setting, state, candidates, rounds)
    }
}

/// Says what is fitted, for whoever waits.
fn tell_step(setting: &Setting<'_>, state: &State, forms: usize) {
    let found = state.chosen.iter().skip(state.nominal).map(|k| names::effect(&k.candidate.name(setting)));
    let found: Vec<String> = found.collect();
    let model = if found.is_empty() { "the model as it is".to_owned() } else { names::listed(&found) };
    let tried = if forms > 0 { format!(", and beside it {forms} forms of effects") } else { String::new() };
    steps::tell(format!("fitting {model}{tried}"));
}

fn by_rows(setting: &Setting<'_>, state: &mut State, candidates: Vec<Candidate>, rounds: usize) -> Result<Outcome> {
    let mut weights: Option<Weights> = None;
    for _ in 1..rounds {
        let own: Vec<usize> = (0..state.own_columns()).collect();
        let design = design::build(setting, state, &state.stretches, &[])?;
        let used = weights.clone().unwrap_or_else(|| ranking::equal_weights(&design));
        let fit = ranking::fit(&design, &own, &used).ok_or_else(singular)?;
        // Weights from an unweighted fit are rough: once more.
        let w = ranking::weights(&design, &own, &fit.all);
        let fit = ranking::fit(&design, &own, &w).ok_or_else(singular)?;
        weights = Some(ranking::weights(&design, &own, &fit.all));
        state.take(setting, &fit.all);
        let _ = state.renew(setting, &fit.all, &fit.covariance);
    }
    let own: Vec<usize> = (0..state.own_columns()).collect();
    let further: Vec<&Candidate> = candidates.iter().collect();
    let design = design::build(setting, state, &state.stretches, &further)?;
    let used = weights.unwrap_or_else(|| ranking::equal_weights(&design));
    let fit = ranking::fit(&design, &own, &used).ok_or_else(singular)?;
    let weights = ranking::weights(&design, &own, &fit.all);
    let fit = ranking::fit(&design, &own, &weights).ok_or_else(singular)?;
    Ok(Outcome { candidates, evidence: Evidence::Weak(design, weights), own, fit })
}

fn by_shooting(
    setting: &Setting<'_>,
    state: &mut State,
    mut candidates: Vec<Candidate>,
    rounds: usize,
) -> Result<Outcome> {
    // What has just joined may move the path far: once more than the weak form, and on while less
    // and less is left.
    let mut left = f64::INFINITY;
    for round in 0..MOST_ROUNDS {
        let (x, covariance) = shooting::settle(setting, state).ok_or_else(singular)?;
        state.take(setting, &x);
        let is_short = state.renew(setting, &x, &covariance);
        let now = state.followed.as_ref().map_or(f64::NAN, Followed::left);
        let falls = now < (1.0 - STILL_FALLS) * left;
        if round + 1 >= rounds && !falls && !is_short && !state.still_moves(&x, &covariance) {
            break;
        }
        // Rounds that go to and fro end as well.
        left = left.min(now);
    }
    let own: Vec<usize> = (0..state.own_columns()).collect();
    let further: Vec<&Candidate> = candidates.iter().collect();
    let ground = Ground::new(setting, state).ok_or_else(singular)?;
    let mut blocks = ground.evidence(&further, false, &[]).ok_or_else(singular)?;
    let fit = blocks.fit(&own).ok_or_else(singular)?;
    moved_forms::add(&ground, setting, state, &mut candidates, &mut blocks);
    memory::keep(setting, state, &candidates);
    Ok(Outcome { candidates, evidence: Evidence::Shooting(blocks), own, fit })
}

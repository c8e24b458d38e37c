//! From the first fit to the verdict: what is measured after each step, and what is told at the
//! end.

use nalgebra::{DMatrix, DVector};

use super::last_fit::LastFit;
use super::power::Repeats;
use super::prediction::{Predictions, Range};
use super::residual_map::{Map, Where};
use super::setting::Setting;
use super::simulation::OfWindows;
use super::state::State;
use super::{
    Outcome, attractor, cautions, compared, forecast, given, last_fit, outliers, patched, prediction, residual,
    shooting, simulation, tell, traces, units, unknown,
};
use crate::error::Result;
use crate::explain::decidability::{EXPLAINED_GAP, Left, OwnGap};
use crate::explain::explanation::{AtHorizon, Details, Explanation, Found, Step, Verdict};
use crate::explain::ranking::{self, FOLDS};
use crate::explain::{Settings, Undecidable, decidability, decision};
use crate::identify::Identification;
use crate::identify::stretches::Stretch;
use crate::statistics::one_more;

/// Step of integration as a share of the shortest horizon: 1e-8 of a smooth motion with a method of
/// fifth order.
const STEP: f64 = 0.01;
/// Longer horizons of the gap, in units of the shortest.
const LONGER: [f64; 3] = [2.0, 4.0, 8.0];

/// Why an effect goes that was found in windows.
const NOT_BORNE_OUT: &str =
    "by simulations of longer pieces, which tell more than windows, its value is within two standard errors of nothing";

/// Records of the model's own in which the gap is measured where inputs are noisy (by hand).
const NOISY_RECORDS: usize = 8;

/// An explanation that is being made.
pub struct Run<'a> {
    /// The record and the system.
    pub setting: Setting<'a>,
    /// What was found so far.
    pub told: Told,
}

/// What is told so far, and the model that it is told of.
#[derive(Clone)]
pub struct Told {
    /// The model so far.
    pub state: State,
    /// What is told.
    pub result: Explanation,
    /// Horizon of the gap, and the longest over which it is measured: a window, s.
    horizons: (f64, f64),
    /// What the coefficients that predictions are made with were not fitted to.
    held_out: Vec<Range>,
    /// The gap at longer horizons before anything was added.
    before: Vec<(f64, f64)>,
    /// The model before anything was added.
    first: Option<First>,
}

/// Coefficients and their covariance.
type Fit = (DVector<f64>, DMatrix<f64>);

/// The fitted model before anything was added.
#[derive(Clone)]
struct First {
    state: State,
    /// What all windows tell.
    windows: OfWindows,
    /// Coefficients of the windows that predictions are made without.
    train: DVector<f64>,
    /// What it leaves in every window of shooting.
    powers: Vec<f64>,
    /// Whether simulations foretell no worse than windows.
    foretells: bool,
}

impl<'a> Run<'a> {
    /// Before anything was fitted; blocks are of `window_s`.
    pub fn new(
        setting: Setting<'a>,
        state: State,
        mut result: Explanation,
        window_s: f64,
        settings: &Settings,
    ) -> Self {
        let horizon_s = result.gap.horizon_s.min(window_s);
        result.gap.horizon_s = horizon_s;
        result.gap.motion = state.on_track(&setting, |t| prediction::motion(t, horizon_s));
        result.gap.floor_in = units::Unit::of(setting.rig, setting.whole).noise(&setting.sensors.sigma);
        result.gap.forecasts = forecast::open(&setting, settings, horizon_s);
        result.simulation = simulation::open(&setting);
        result.details = Details {
            samples: setting.raw.iter().map(Stretch::len).sum(),
            window_s: state.followed.as_ref().filter(|_| setting.shooting).map_or(window_s, |f| f.windows(&setting).1),
            simulated_s: None,
            max_frequency_hz: setting.geometry.windows.frequencies as f64 / setting.geometry.windows.length_s,
            pass_hz: setting.geometry.kernels.full.pass_hz,
            noise_rad: setting.sensors.sigma.clone(),
            family_wise: decision::FAMILY_WISE,
            folds: ranking::FOLDS,
        };
        let horizons = (horizon_s, window_s);
        let told = Told { state, result, horizons, held_out: Vec::new(), before: Vec::new(), first: None };
        Self { setting, told }
    }

    /// A search for the step would follow every jump of a law; an instant off by half of this
    /// changes nothing that sensors see. Where a period has few samples, the step between the
    /// points at which columns are integrated.
    fn step_s(&self) -> Option<f64> {
        let shortest = self.setting.rig.drive.map_or(self.told.horizons.0, |d| 1.0 / d.frequency_hz);
        self.setting.raw.first().map(|s| (s.step_s / self.setting.points as f64).min(STEP * shortest))
    }

    /// The gap of the model with coefficients `x` at a horizon.
    fn gap_at(&self, x: &DVector<f64>, horizon_s: f64) -> f64 {
        let Some(moving) = self.told.state.motion(&self.setting, x) else { return f64::NAN };
        let model = moving.model(self.step_s());
        self.told.state.on_track(&self.setting, |track| model.gap(track, horizon_s, &self.told.held_out))
    }

    /// The gap at every horizon that it was measured over, in records that the model itself makes:
    /// counts that stand while the motion is slow are no white noise, and one more than the noise
    /// says is nothing then; noise of measured inputs adds up differently in every record. Only where
    /// a gap is more than a right model's by noise.
    fn gaps_of_itself(&self, x: &DVector<f64>) -> Vec<OwnGap> {
        let last = self.told.result.gap.steps.last().map(|s| (self.told.horizons.0, s.value));
        let all: Vec<(f64, f64)> =
            last.into_iter().chain(self.told.result.gap.horizons.iter().map(|h| (h.horizon_s, h.after))).collect();
        let Some(followed) = self.told.state.followed.as_ref().filter(|_| all.iter().any(|g| g.1 > EXPLAINED_GAP))
        else {
            return Vec::new();
        };
        let Some(moving) = self.told.state.motion(&self.setting, x) else { return Vec::new() };
        let model = moving.model(self.step_s());
        let made = |repeat| State {
            stretches: shooting::remade_record(&self.setting, &self.told.state, followed, repeat),
            ..self.told.state.clone()
        };
        let is_noisy = self.setting.sensors.inputs.iter().any(|l| l.sigma() > 0.0);
        let count = if is_noisy { NOISY_RECORDS } else { shooting::RECORDS };
        let records: Vec<State> = (0..count).map(made).collect();
        let of = |(horizon_s, _): (f64, f64)| {
            let gap = |r: &State| r.on_track(&self.setting, |track| model.gap(track, horizon_s, &self.told.held_out));
            let gaps: Vec<f64> = records.iter().map(gap).collect();
            let most = if is_noisy { one_more(&gaps) } else { 0.0 };
            OwnGap { horizon_s, mean: gaps.iter().sum::<f64>() / gaps.len() as f64, most }
        };
        all.into_iter().map(of).collect()
    }

    /// The gap of the model where it was not fitted.
    pub fn gap(&mut self, outcome: &Outcome) -> f64 {
        self.told.held_out = outcome.held_out(&self.setting);
        self.gap_at(&outcome.fit.train, self.told.horizons.0)
    }

    /// The same at longer horizons.
    fn longer(&self, x: &DVector<f64>) -> Vec<(f64, f64)> {
        let all = LONGER.iter().map(|f| f * self.told.horizons.0).filter(|h| *h <= self.told.horizons.1);
        all.map(|h| (h, self.gap_at(x, h))).collect()
    }

    fn predictions(&self) -> Predictions<'_> {
        let Told { horizons: (horizon_s, longest_s), held_out, .. } = &self.told;
        Predictions { horizon_s: *horizon_s, longest_s: *longest_s, held_out, step_s: self.step_s() }
    }

    /// Free runs: [`simulation::measure`].
    fn simulate(&mut self, outcome: &Outcome, added: Option<String>) -> bool {
        simulation::measure(&self.setting, &self.told.state, outcome, added, &mut self.told.result.simulation)
    }

    fn attractor(&mut self, outcome: &Outcome) {
        // Fitted to the windows that are not held out.
        let covariance = outcome.covariance() * (FOLDS as f64 / (FOLDS - 1) as f64);
        let fit = (&outcome.fit.train, &covariance);
        let found = attractor::measure(&self.setting, &self.told.state, fit, self.predictions());
        self.told.result.gap.attractor.extend(found);
    }

    /// Measures a model that was given as it is.
    pub fn as_given(&mut self) {
        let x = given::coefficients(&self.told.state);
        // It was not fitted to any of this record.
        let raw = self.setting.raw.iter().enumerate();
        self.told.held_out = raw.map(|(stretch, s)| Range { stretch, begin: 0, end: s.len() }).collect();
        let value = self.gap_at(&x, self.told.horizons.0);
        self.told.result.gap.steps.push(Step { added: None, value });
        self.forecast(None, Some(&x));
    }

    fn forecast(&mut self, added: Option<&String>, x: Option<&DVector<f64>>) {
        let mut all = core::mem::take(&mut self.told.result.gap.forecasts);
        forecast::measure(&self.setting, &self.told.state, x, added, self.predictions(), &mut all);
        self.told.result.gap.forecasts = all;
    }

    /// Where model and record disagree: maps, and the clearest places.
    fn places(&self, outcome: &Outcome) -> (Vec<Map>, Vec<Where>) {
        let (setting, state) = (&self.setting, &self.told.state);
        let Ok(repeats) = Repeats::of(setting, state) else { return (Vec::new(), Vec::new()) };
        // What the rows cannot hold has no map against frequency.
        let rows = outcome.rows(setting, state, &repeats).ok();
        residual::maps(setting, state, &outcome.fit.all, &repeats, rows.as_ref())
    }

    /// Measures the model after a step, of which the gap is known.
    ///
    /// # Errors
    /// Columns that the weak form cannot hold.
    pub fn push(&mut self, added: Option<String>, gap: f64, outcome: &Outcome) -> Result<()> {
        self.told.result.gap.steps.push(Step { added: added.clone(), value: gap });
        let x = forecast::fitted(&self.told.state, outcome);
        self.forecast(added.as_ref(), x.as_ref());
        self.told.result.residual_power[1] = outcome.power(&self.setting, &self.told.state)?;
        if self.told.result.effects.is_empty() {
            self.told.result.residual_power[0] = self.told.result.residual_power[1];
            (self.told.result.maps, self.told.result.r#where) = self.places(outcome);
            let (state, train, powers) = (self.told.state.clone(), outcome.fit.train.clone(), outcome.powers());
            let windows = OfWindows::new(outcome);
            self.told.before = self.longer(&outcome.fit.train);
            self.attractor(outcome);
            let foretells = self.simulate(outcome, added);
            self.told.first = Some(First { windows, state, train, powers, foretells });
            let follows = outcome.evidence.is_shooting();
            let shown = follows.then(|| shooting::shows_slips(&self.setting, &self.told.state)).flatten();
            let before = self.told.result.slips_show;
            self.told.result.slips_show = shown.map(|s| s || before == Some(true));
        }
        Ok(())
    }

    /// Tells the last step as it is in other windows than before.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub fn tell_again(&mut self, outcome: &Outcome) -> Result<()> {
        let Some(followed) = &self.told.state.followed else { return Ok(()) };
        let window_s = followed.windows(&self.setting).1;
        self.told.horizons.1 = followed.blocks(&self.setting).1;
        self.told.result.details.window_s = window_s;
        if !self.told.result.effects.is_empty() {
            return self.tell_last(outcome);
        }
        let added = self.told.result.gap.steps.last().and_then(|s| s.added.clone());
        self.told.result.steps().for_each(|steps| drop(steps.pop()));
        self.told.result.gap.attractor.clear();
        let gap = self.gap(outcome);
        self.push(added, gap, outcome)
    }

    /// Goes back to the model before anything was added; false where there is none.
    pub fn begin_again(&mut self) -> bool {
        let Some(first) = &self.told.first else { return false };
        self.told.state = first.state.clone();
        let result = &mut self.told.result;
        (result.effects, result.ranking, result.refused) = (Vec::new(), Vec::new(), Vec::new());
        result.steps().for_each(|steps| steps.truncate(1));
        true
    }

    /// Measures the last step once more.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub fn tell_last(&mut self, outcome: &Outcome) -> Result<()> {
        let value = self.gap(outcome);
        let last = self.told.result.gap.steps.pop().and_then(|s| s.added);
        self.told.result.gap.steps.push(Step { added: last.clone(), value });
        self.told.result.gap.forecasts.iter_mut().for_each(|f| drop(f.steps.pop()));
        let x = forecast::fitted(&self.told.state, outcome);
        self.forecast(last.as_ref(), x.as_ref());
        self.told.result.residual_power[1] = outcome.power(&self.setting, &self.told.state)?;
        Ok(())
    }

    /// Coefficients with their covariance as they are told, and the length of the pieces that they are
    /// simulated over, s, where they are.
    fn last_fit(&self, state: &State, windows: OfWindows, foretells: bool) -> (Fit, Option<f64>) {
        let last = last_fit::last_fit(&self.setting, state, &windows, foretells);
        let piece_s = last.as_ref().map(|l| l.piece_s);
        (last.map_or((windows.x, windows.covariance), LastFit::fitted), piece_s)
    }

    /// What the first model has beside the last one with coefficients `x`: its parameters, and
    /// predictions of the same seconds by both.
    fn compare(&mut self, identified: &Identification, x: &DVector<f64>, last: &Fit) {
        let Some(First { state, windows, train, foretells, .. }) = self.told.first.take() else { return };
        let mut told = Explanation::new(self.told.horizons.0, Vec::new());
        let none = self.told.result.effects.is_empty();
        let fit = if none { last.clone() } else { self.last_fit(&state, windows, foretells).0 };
        tell::parameters(&self.setting, &state, (&fit.0, &fit.1), identified, &mut told);
        self.told.result.parameters_before = told.parameters;
        let after = (!none).then_some((&self.told.state, x));
        let holds_s = self.told.result.gap.attractor.last().map(|a| a.prediction_horizon_s);
        let (before, how) = ((&state, &train), self.predictions());
        self.told.result.prediction = compared::compare(&self.setting, before, after, how, holds_s);
    }

    /// Takes windows that are not followed even in the model's own records out of the power of what
    /// is left, before and after: their number.
    fn leave_out(&mut self, outcome: &Outcome, follows: &[bool]) -> usize {
        let out = follows.iter().filter(|f| !**f).count();
        let kept = (follows.len() - out).max(1) as f64;
        let over = |powers: &[f64]| {
            let all = powers.iter().zip(follows).filter(|p| *p.1).map(|p| *p.0);
            (powers.len() == follows.len()).then(|| all.sum::<f64>() / kept)
        };
        let Some(after) = over(&outcome.powers()).filter(|_| out > 0) else { return 0 };
        // The first model's windows may be others.
        let before = self.told.first.as_ref().and_then(|f| over(&f.powers));
        self.told.result.residual_power = [before.unwrap_or(self.told.result.residual_power[0]), after];
        out
    }

    /// Names of the measured inputs in which noise shows.
    fn noisy_inputs(&self) -> Vec<String> {
        let named = self.setting.model().inputs.iter().zip(&self.setting.sensors.inputs);
        named.filter(|n| n.1.sigma() > 0.0).map(|n| n.0.clone()).collect()
    }

    /// The verdict, and everything that is told of the last model.
    ///
    /// # Errors
    /// As [`Run::push`]; a model file that cannot be read.
    pub fn finish(
        mut self,
        outcome: &Outcome,
        first: &Identification,
        undecidable: Option<Undecidable>,
    ) -> Result<Explanation> {
        let (x, found) = (&outcome.fit.train, self.told.clone());
        self.told.held_out = outcome.held_out(&self.setting);
        let none = self.told.result.effects.is_empty();
        let after = if none { self.told.before.clone() } else { self.longer(x) };
        let both = self.told.before.iter().zip(&after);
        let of = |(b, a): (&(f64, f64), &(f64, f64))| AtHorizon { horizon_s: b.0, before: b.1, after: a.1 };
        self.told.result.gap.horizons = both.map(of).collect();
        let mut foretells = self.told.first.as_ref().is_some_and(|f| f.foretells);
        if !none {
            self.attractor(outcome);
            let after = self.places(outcome);
            self.told.result.maps_before = core::mem::replace(&mut self.told.result.maps, after.0);
            self.told.result.where_before = core::mem::replace(&mut self.told.result.r#where, after.1);
            let added = self.told.result.effects.last().map(Found::name);
            foretells = self.simulate(outcome, added);
        }
        let by_shooting = outcome.evidence.is_shooting();
        let remade = by_shooting.then(|| shooting::remade(&self.setting, &self.told.state)).flatten();
        let left_out = remade.as_ref().map_or(0, |r| self.leave_out(outcome, &r.follows));
        let (last, simulated_s) = self.last_fit(&self.told.state, OfWindows::new(outcome), foretells);
        let nothing = || traces::not_borne_out(&self.setting, &self.told.state, (&last.0, &last.1));
        if let Some(k) = simulated_s.and_then(|_| nothing()) {
            let told = core::mem::replace(&mut self.told, found);
            if let Some((without, _)) = self.taken_away(k, NOT_BORNE_OUT.to_owned())? {
                return self.finish(&without, first, undecidable);
            }
            self.told = told;
        }
        self.told.result.details.simulated_s = simulated_s;
        self.compare(first, x, &last);
        let gaps = self.gaps_of_itself(x);
        let noisy = if remade.as_ref().is_some_and(|r| r.of_inputs) { self.noisy_inputs() } else { Vec::new() };
        let Self { setting, told: Told { state, mut result, .. } } = self;
        tell::parameters(&setting, &state, (&last.0, &last.1), first, &mut result);
        result.warnings.extend(cautions::at_bounds(&state, &result));
        let shape = (by_shooting && undecidable.is_none()).then(|| unknown::shape(&setting, &state, outcome)).flatten();
        let rest = Left {
            patched: patched::patched(&setting, &state, outcome),
            shape: shape.as_ref().filter(|s| s.is_clear).map(|s| (s.unknown.clone(), s.deviations)),
            remade: remade.map(|r| (r.mean, r.error)),
            left_out,
            gaps,
            noisy,
            whole: if by_shooting { simulation::left_of_whole(&setting, &state, outcome) } else { None },
        };
        let most = rest.most_power();
        decidability::decide(&mut result, undecidable, rest);
        let settled = matches!(result.verdict, Verdict::Explained | Verdict::NothingMissing);
        if by_shooting && settled && result.slips_show != Some(false) {
            // The model before lacked something, which may look like slips; what is left is noise now.
            result.slips_show = shooting::shows_slips(&setting, &state);
        }
        super::changed::tell_in(&mut result, &setting, &state, outcome, most);
        if result.verdict == Verdict::Unexplained {
            let shape = if by_shooting { shape } else { unknown::shape(&setting, &state, outcome) };
            result.unknown = shape.map(|s| s.unknown);
            result.outliers = outliers::find(&setting, &state);
        }
        if result.verdict != Verdict::NotDecidable {
            result.model = Some(tell::model(&setting, &state, &result)?);
        }
        Ok(result)
    }
}

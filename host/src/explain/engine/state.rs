//! The model while effects are added to it: coefficients, effects with their strengths, and the
//! record with sensor effects taken off.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::candidates::Candidate;
use super::prediction::Model;
use super::relaxation::Relaxation;
use super::setting::{Physical, Setting};
use super::shooting::Followed;
use crate::identify::remeasured::Sensors;
use crate::identify::stretches::Stretch;
use crate::identify::taken_off::OfTheRecord;
use crate::identify::track::{ExogenousInputs, Track};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::{Expression, Node, Symbol, symbol};

/// Additions to the left-hand sides: equation, name of the strength, expression in seconds.
type Terms = Vec<(usize, String, Node)>;

/// Share of its standard error by which an increment may move, and is settled.
const SMALL_INCREMENT: f64 = 0.3;

/// Decay of a state within a sample up to which Dormand and Prince's step follows it: it is stable
/// up to 3.3.
const FASTEST: f64 = 2.0;

/// An effect in the model.
#[derive(Clone)]
pub struct Chosen {
    /// The effect.
    pub candidate: Candidate,
    /// Its strengths.
    pub strengths: Vec<f64>,
}

impl Chosen {
    /// A candidate that joins the model with strengths of zero, in its refined form where it has
    /// one.
    pub fn new(setting: &Setting<'_>, candidate: Candidate, physical: &Physical) -> Self {
        let candidate = candidate.refined(setting, physical);
        Self { strengths: vec![0.0; candidate.strengths()], candidate }
    }

    /// Its strengths by a fit whose columns of them begin at `at`: those of an effect that is
    /// applied to the data are increments there.
    pub fn values(&self, x: &DVector<f64>, at: usize) -> Vec<f64> {
        let is_applied = self.candidate.is_applied();
        let of = |(i, s): (usize, &f64)| x[at + i] + if is_applied { *s } else { 0.0 };
        self.strengths.iter().enumerate().map(of).collect()
    }

    /// Where strengths are shares of the drive's amplitude, and that is known better now: the same
    /// effect as shares of the new one. An amplitude found before the effect was in the model is
    /// off by what it made of it (5 % for a second harmonic of 3 %).
    fn with_size_of(&mut self, setting: &Setting<'_>, before: &Physical, now: &Physical) {
        let Some(ratio) = self.candidate.size_ratio(setting, before, now) else { return };
        if let Some(candidate) = self.candidate.at(setting, self.candidate.form.clone(), now) {
            self.candidate = candidate;
            self.strengths.iter_mut().for_each(|s| *s *= ratio);
        }
    }

    /// Renews what is turned near its angle β, which moved by δ and has a standard error; whether
    /// what that changes in the rotation, ½ β δ, is more than a share of it.
    fn turn(&mut self, setting: &Setting<'_>, physical: &Physical, std_error: f64) -> bool {
        let Some(before) = self.candidate.turned_by() else { return false };
        self.candidate = self.candidate.about(setting, &self.strengths, physical);
        let now = self.candidate.turned_by().unwrap_or(before);
        0.5 * (now * (now - before)).abs() > SMALL_INCREMENT * std_error
    }
}

/// A model that moves.
pub struct Moving {
    /// Its equations.
    pub equations: EquationsOfMotion,
    /// Values of their parameters.
    pub parameters: Vec<f64>,
    /// Numbers of the states of effects that they follow themselves.
    pub hidden: Vec<usize>,
}

impl Moving {
    /// As one that predicts; the step of integration is sought where none is given.
    pub fn model(&self, step_s: Option<f64>) -> Model<'_> {
        Model { motion: &self.equations, parameters: &self.parameters, step_s }
    }
}

/// Coefficients and what was computed with them.
#[derive(Clone)]
pub struct State {
    /// Coefficients of the equations without dampings, in the order of [`super::setting::Own`].
    pub values: Vec<f64>,
    /// Parameters of the system behind them.
    pub physical: Physical,
    /// Nominal dampings, then effects of a given model, then effects added.
    pub chosen: Vec<Chosen>,
    /// How many of `chosen` are nominal dampings.
    pub dampings: usize,
    /// How many of `chosen` were there before anything was added.
    pub nominal: usize,
    /// The record with sensor effects found so far taken off.
    pub stretches: Vec<Stretch>,
    /// What that makes of each sensor's noise ([`OfTheRecord::gains`]).
    pub gains: Vec<f64>,
    /// The motion that shooting is linearised about.
    pub followed: Option<Followed>,
    /// How far the system's parameters go from round to round of a fit.
    pub relaxation: Relaxation,
    /// Effects, `ID@PLACE`, whose forms are those of the grid: what they were moved to was something
    /// else.
    pub moved_in_vain: Vec<String>,
}

impl State {
    /// Columns of the equations and of everything chosen, which come first.
    pub fn own_columns(&self) -> usize {
        self.values.len() + self.chosen.iter().map(|k| k.strengths.len()).sum::<usize>()
    }

    /// Effects rest on the system's parameters: renews these, and forms that are refined; whether
    /// any moved by more than a share of its standard error, or less far than it should.
    pub fn renew(&mut self, setting: &Setting<'_>, x: &DVector<f64>, covariance: &DMatrix<f64>) -> bool {
        let n = self.values.len();
        let own = (x.rows(0, n).into_owned(), covariance.view((0, 0), (n, n)).into_owned());
        let mut is_short = false;
        if let Some(mut physical) = setting.physical(&own.0, &own.1, &self.physical) {
            // What written equations stand for follows from their coefficients alone.
            if setting.shooting && !setting.is_written() {
                let most = self.relaxation.relax(&self.physical.values, &mut physical.values, &physical.errors);
                is_short = most > SMALL_INCREMENT;
            }
            for k in &mut self.chosen {
                k.with_size_of(setting, &self.physical, &physical);
            }
            self.physical = physical;
        }
        let mut at = n;
        for k in &mut self.chosen {
            is_short |= k.turn(setting, &self.physical, covariance[(at, at)].max(0.0).sqrt());
            at += k.strengths.len();
            let steps = k.candidate.steps(&k.strengths);
            if k.candidate.is_refined() && !steps.is_empty() {
                // A Gauss–Newton step of the form's parameters.
                let moved = k.candidate.moved(setting, &steps, &self.physical);
                is_short |= moved.is_short_of(&k.candidate, &steps);
                k.candidate = moved;
                k.strengths[k.candidate.entry.strengths.len()..].fill(0.0);
            }
        }
        is_short
    }

    /// Takes coefficients over: the equations' own, then strengths; those of effects that are
    /// applied to the data are increments.
    pub fn take(&mut self, setting: &Setting<'_>, x: &DVector<f64>) {
        let n = self.values.len();
        self.values = x.rows(0, n).iter().copied().collect();
        let mut at = n;
        let mut applied = false;
        for k in &mut self.chosen {
            applied |= k.candidate.is_applied();
            k.strengths = k.values(x, at);
            at += k.strengths.len();
        }
        if applied {
            self.take_off(setting);
        }
    }

    /// Reads the record again with the sensor effects so far taken off.
    pub fn take_off(&mut self, setting: &Setting<'_>) {
        let all = self.of_the_record();
        self.stretches = setting.raw.iter().map(|s| all.taken_off(s, &setting.bound)).collect();
        self.gains = all.gains(&setting.raw, &setting.bound, &setting.sensors.sigma);
    }

    /// The sensors that show the record as it is read now.
    pub fn sensors(&self, setting: &Setting<'_>) -> Sensors {
        let mut out = setting.sensors.clone();
        for (k, gain) in self.gains.iter().enumerate() {
            out.sigma[k] *= gain;
            out.count[k] = out.count[k].map(|q| q * gain);
        }
        out
    }

    /// Whether what is taken off the record moved by more than a share of its standard error: its
    /// columns hold to first order only.
    pub fn still_moves(&self, x: &DVector<f64>, covariance: &DMatrix<f64>) -> bool {
        let mut at = self.values.len();
        self.chosen.iter().any(|k| {
            let own = at..at + k.strengths.len();
            at = own.end;
            k.candidate.is_applied()
                && own.into_iter().any(|i| x[i].abs() > SMALL_INCREMENT * covariance[(i, i)].max(0.0).sqrt())
        })
    }

    /// What the effects so far change of the record.
    fn of_the_record(&self) -> OfTheRecord {
        let mut all = OfTheRecord::default();
        for k in &self.chosen {
            let with_strengths =
                |laws: &[Node]| laws.iter().cloned().zip(k.strengths.iter().copied()).collect::<Vec<_>>();
            if let Some((sensor, laws)) = k.candidate.reads() {
                all.sensor(sensor, with_strengths(laws));
            }
            if let Some((input, laws)) = k.candidate.records() {
                all.input(input, with_strengths(laws));
            }
            if let Some(laws) = k.candidate.advances() {
                all.phase(with_strengths(laws));
            }
        }
        all
    }

    /// The model's equations of motion at the coefficients `x` (the equations' own, then strengths)
    /// of the first record, which take the states of effects from it.
    pub fn motion(&self, setting: &Setting<'_>, x: &DVector<f64>) -> Option<Moving> {
        self.motion_of(setting, x, 0)
    }

    /// The same of any record.
    pub fn motion_of(&self, setting: &Setting<'_>, x: &DVector<f64>, record: usize) -> Option<Moving> {
        self.moving(setting, x, record, None)
    }

    /// The same of any record for a free run, which follows the states of effects with its own
    /// motion.
    pub fn free_motion_of(&self, setting: &Setting<'_>, x: &DVector<f64>, record: usize) -> Option<Moving> {
        self.moving(setting, x, record, Some(&|_| true))
    }

    /// The same for shooting, whose paths move the states of effects with them; those that are
    /// beside them, by which shapes are refined, are the record's.
    pub fn followed_motion_of(&self, setting: &Setting<'_>, x: &DVector<f64>, record: usize) -> Option<Moving> {
        let own = self.own_states();
        self.moving(setting, x, record, Some(&|k| own.contains(&k)))
    }

    fn moving(
        &self,
        setting: &Setting<'_>,
        x: &DVector<f64>,
        record: usize,
        hides: Option<&dyn Fn(usize) -> bool>,
    ) -> Option<Moving> {
        let (mut terms, strengths) = self.terms(setting, x);
        if let Some(hides) = hides {
            let own = |s: Symbol| match s {
                Symbol::Memory(k) if hides(k) => {
                    setting.laws.law(k).map_or_else(|| symbol(s), |(m, j)| Arc::new(Expression::Memory(m, j)))
                }
                other => symbol(other),
            };
            terms.iter_mut().for_each(|(_, _, of)| *of = of.replace(&own));
        }
        let equations = EquationsOfMotion::with_columns(setting.model(), setting.rig.omega(), &terms).ok()?;
        let parameters = self.parameters(setting, x, record, &equations, &strengths);
        let hidden = equations.hidden().iter().map(|(m, j)| setting.laws.number(m, *j)).collect();
        Some(Moving { equations, parameters, hidden })
    }

    /// Values of an equation's coefficients: the record's own, then strengths.
    fn parameters(
        &self,
        setting: &Setting<'_>,
        x: &DVector<f64>,
        record: usize,
        motion: &EquationsOfMotion,
        strengths: &[(String, f64)],
    ) -> Vec<f64> {
        let own = setting.model().coefficients();
        let of_record = setting.own.coefficients(&x.as_slice()[..self.values.len()], record);
        let value = |name: &String| {
            own.iter()
                .position(|n| n == name)
                .map(|i| of_record[i])
                .or_else(|| strengths.iter().find(|s| s.0 == *name).map(|s| s.1))
        };
        motion.coefficients().iter().map(|n| value(n).unwrap_or(0.0)).collect()
    }

    /// What everything chosen adds to the equations, and the strengths by name.
    fn terms(&self, setting: &Setting<'_>, x: &DVector<f64>) -> (Terms, Vec<(String, f64)>) {
        let n = self.values.len();
        // Inertias follow from the coefficients that stand here, not from those of the last round.
        let by = DVector::from_fn(n, |i, _| x[i] - self.values[i]);
        let physical = self.physical.moved(&by);
        let is_moved = physical.values != self.physical.values;
        let mut terms: Terms = Vec::new();
        let mut strengths: Vec<(String, f64)> = Vec::new();
        let mut at = n;
        for (index, k) in self.chosen.iter().enumerate() {
            let mut columns = k.candidate.columns_at(setting, self, &physical);
            // An inertia that stays open is the unit of what acts there, and is not moved.
            if is_moved && columns.iter().flatten().any(|c| physical.is_open(c.0)) {
                for (here, there) in columns.iter_mut().zip(k.candidate.columns(setting, self)) {
                    let both = here.iter_mut().zip(there).filter(|(h, _)| physical.is_open(h.0));
                    both.for_each(|(here, there)| *here = there);
                }
            }
            for (j, column) in columns.into_iter().enumerate() {
                // What is applied to the data is not in the equations.
                if !k.candidate.is_applied() {
                    let name = format!("{index} {j}");
                    terms.extend(column.into_iter().map(|(e, of)| (e, name.clone(), of)));
                    strengths.push((name, x[at]));
                }
                at += 1;
            }
        }
        (terms, strengths)
    }

    /// Numbers of the states of everything chosen in its own form, but of those that settle so fast
    /// that an explicit step loses them; these hardly deviate from the record's.
    fn own_states(&self) -> Vec<usize> {
        let is_slow = |k: &usize| {
            let of = |s: &Stretch| s.history.as_ref().is_some_and(|h| h.is_slow(*k, FASTEST));
            self.stretches.iter().all(of)
        };
        self.chosen.iter().flat_map(|k| k.candidate.own_states()).filter(is_slow).collect()
    }

    /// Sample of a stretch from which no state of an effect depends on how it was when the stretch
    /// began.
    pub fn forgets(&self, stretch: &Stretch) -> usize {
        let own = self.chosen.iter().flat_map(|k| k.candidate.own_states());
        own.filter_map(|k| Some(stretch.history.as_ref()?.forgets(k))).max().unwrap_or(0)
    }

    /// Numbers of the states that [`State::followed_motion_of`] takes from the record, sorted.
    pub fn beside(&self) -> Vec<usize> {
        let own = self.own_states();
        self.remembered().into_iter().filter(|k| !own.contains(k)).collect()
    }

    /// Numbers of the states of everything chosen, sorted: those that [`State::motion`] takes from
    /// the record.
    pub fn remembered(&self) -> Vec<usize> {
        let all = self.chosen.iter().flat_map(|k| k.candidate.remembered());
        let mut out: Vec<usize> = all.collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// Stretches that one model predicts: all, or those of the first record where others have
    /// coefficients of their own.
    fn predicted(&self, setting: &Setting<'_>) -> &[Stretch] {
        let is_one = setting.own.names.len() == setting.model().coefficients().len();
        let first = setting.record_of.iter().take_while(|r| **r == 0).count();
        &self.stretches[..if is_one { self.stretches.len() } else { first.min(self.stretches.len()) }]
    }

    /// The record as pieces without what acts on them: for its sensors and their noise alone.
    pub fn undriven_track<'a>(&'a self, setting: &'a Setting<'_>) -> Track<'a> {
        Track::new(self.predicted(setting), &[], setting.rig, &setting.bound, &self.sensors(setting))
    }

    /// Calls with the record as pieces for predictions.
    pub fn on_track<T>(&self, setting: &Setting<'_>, then: impl FnOnce(&Track<'_>) -> T) -> T {
        let omega = setting.rig.drive.map_or(0.0, |_| setting.rig.omega());
        let numbers = self.remembered();
        let exogenous: Vec<ExogenousInputs> =
            self.predicted(setting).iter().map(|s| ExogenousInputs::remembering(s, omega, &numbers)).collect();
        let settled = self.followed.as_ref().and_then(|f| f.settled(setting));
        let known = |stretch, sample| settled.as_ref()?.at(stretch, sample);
        let track =
            Track::new(self.predicted(setting), &exogenous, setting.rig, &setting.bound, &self.sensors(setting));
        then(&track.knowing(&known))
    }

    /// The same for equations that follow some states of effects themselves:
    /// [`State::free_motion_of`].
    pub fn on_free_track<T>(
        &self,
        setting: &Setting<'_>,
        numbers: Vec<usize>,
        then: impl FnOnce(&Track<'_>) -> T,
    ) -> T {
        let omega = setting.rig.drive.map_or(0.0, |_| setting.rig.omega());
        let stretches = self.predicted(setting);
        let exogenous: Vec<ExogenousInputs> = stretches.iter().map(|s| ExogenousInputs::new(s, omega)).collect();
        then(&Track::new(stretches, &exogenous, setting.rig, &setting.bound, &self.sensors(setting)).hiding(numbers))
    }
}

//! The record while columns are fitted to it: windows linearised about their paths.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::DVector;
use rayon::prelude::*;

use super::super::candidates::{Candidate, Column};
use super::super::setting::Setting;
use super::super::state::{Moving, State};
use super::blocks::{Blocks, Part};
use super::by_inertia;
use super::cut::{Cut, blocks_of};
use super::forcing::{Additions, Forcing};
use super::gram::Layout;
use super::linear::{Linear, Measured};
use super::normal::Normal;
use super::path::{FEWEST_SAMPLES, Path, Window};
use super::window_inputs::WindowInputs;
use crate::identify::track::{ExogenousInputs, Track};
use crate::model::flow::abreast::VectorField;
use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::tape::{Registers, Tape};

/// Windows of the short horizon in one of the long (by hand).
const SHORT: usize = 12;
/// Share of the windows that may be left out because they begin before states of effects are known
/// (by hand).
const MOST_UNKNOWN: f64 = 0.2;
/// Movement of an angle, rad, beyond which a linearisation says nothing.
const FARTHEST_RAD: f64 = 0.7;

/// The record while columns are fitted to it.
pub struct Course<'a> {
    /// The system.
    pub setting: &'a Setting<'a>,
    /// The model so far.
    pub state: &'a State,
    between: Vec<ExogenousInputs>,
    /// What the sensors showed, by stretch and sensor.
    shown: Vec<Vec<Vec<f64>>>,
    weights: Vec<Vec<f64>>,
    sigma: Vec<f64>,
    omega: f64,
    /// Points to a sample.
    points: usize,
    /// Sample of each stretch from which states of effects are known.
    begins: Vec<usize>,
}

/// What is fitted to every window.
struct Fitted<'a> {
    list: &'a List<'a>,
    layout: Arc<Layout>,
    /// Everything that has a column, for each record.
    records: Vec<Forcing>,
}

/// One window at one linearisation.
pub struct Solved {
    /// The model's flow.
    pub linear: Linear,
    /// What is fitted to it.
    pub columns: Columns,
}

/// What is fitted to a window.
pub struct Columns {
    /// Accelerations by every column.
    pub alpha: Vec<f64>,
    /// Normal equations with the initial state.
    pub normal: Normal,
    /// Of each block.
    parts: Vec<Vec<Part>>,
}

/// What is fitted: the model's own columns and what was chosen, at coefficients `x` (increments are
/// zero), then others.
pub struct List<'a> {
    /// Coefficients.
    pub x: Vec<f64>,
    /// Candidates.
    pub further: &'a [&'a Candidate],
    /// Groups of columns of no effect.
    pub behind: &'a [Vec<Column>],
    /// Whether candidates are fitted together.
    pub together: bool,
}

impl List<'_> {
    /// Which columns are fitted together.
    fn layout(&self) -> Arc<Layout> {
        let mut sizes: Vec<usize> = self.further.iter().map(|c| c.strengths()).collect();
        sizes.extend(self.behind.iter().map(Vec::len));
        if self.together {
            sizes = vec![sizes.iter().sum()];
        }
        Layout::new(self.x.len(), &sizes)
    }
}

impl<'a> Course<'a> {
    /// For the state's stretches.
    pub fn new(setting: &'a Setting<'a>, state: &'a State) -> Self {
        let omega = setting.rig.drive.map_or(0.0, |_| setting.rig.omega());
        let numbers = state.beside();
        let between = state.stretches.iter().map(|s| ExogenousInputs::remembering(s, omega, &numbers)).collect();
        let shown = state.stretches.iter().map(|s| s.sensors(&setting.bound)).collect();
        let Track { sensors: weights, sigma, .. } = state.undriven_track(setting);
        let begins = state.stretches.iter().map(|s| state.forgets(s)).collect();
        Self { setting, state, between, shown, weights, sigma, omega, points: setting.points, begins }
    }

    /// The same with so many points to a sample.
    #[must_use]
    pub fn with_points(self, points: usize) -> Self {
        Self { points, ..self }
    }

    /// The same where sensors showed something else, by stretch and sensor.
    #[must_use]
    pub fn showing(self, shown: Vec<Vec<Vec<f64>>>) -> Self {
        Self { shown, ..self }
    }

    /// Mean square of what the sensors showed about its mean, over the noise's.
    pub fn motion_power(&self) -> f64 {
        let of = |k: usize| {
            let all = || self.shown.iter().flat_map(|s| &s[k]);
            let count = all().count().max(1) as f64;
            let mean = all().sum::<f64>() / count;
            all().map(|x| (x - mean).powi(2)).sum::<f64>() / (count * self.sigma[k].powi(2))
        };
        (0..self.sigma.len()).map(of).sum::<f64>() / self.sigma.len().max(1) as f64
    }

    fn window_inputs(&self, path: &Path, w: &Window) -> WindowInputs<'_> {
        WindowInputs {
            stretch: &self.state.stretches[w.stretch],
            between: &self.between[w.stretch],
            first: path.first + w.first,
            omega: self.omega,
            points: self.points * path.fineness(w),
        }
    }

    /// Columns of a list for every record.
    fn fitted<'l>(&self, list: &'l List<'l>) -> Option<Fitted<'l>> {
        let (setting, state) = (self.setting, self.state);
        let model = setting.model();
        let own = setting.own.names.len();
        let all = state.chosen.iter().map(|k| &k.candidate).chain(list.further.iter().copied());
        let mut parts: Vec<Column> = all.flat_map(|c| c.columns(setting, state)).collect();
        parts.extend(list.behind.iter().flatten().cloned());
        let count = own + parts.len();
        let shared: Additions = parts
            .into_iter()
            .enumerate()
            .flat_map(|(k, column)| column.into_iter().map(move |(e, of)| (own + k, e, of)))
            .collect();
        let chosen: usize = state.chosen.iter().map(|k| k.strengths.len()).sum();
        let moved: Vec<(usize, f64, Node)> = shared
            .iter()
            .filter(|(c, _, _)| *c < own + chosen)
            .map(|(c, e, of)| (*e, list.x[*c], of.clone()))
            .collect();
        let places = model.term_places();
        let by_inertia = by_inertia::additions(setting, state, &list.x);
        let records = setting
            .own
            .of_record
            .iter()
            .map(|columns| {
                let coefficients: Vec<f64> = columns.iter().map(|c| list.x[*c]).collect();
                let mut additions: Additions = Vec::new();
                for (e, equation) in model.equations.iter().enumerate() {
                    for (term, &k) in equation.terms.iter().zip(&places[e]) {
                        additions.push((*columns.get(k)?, e, model.in_seconds(&term.of, setting.rig.omega())));
                    }
                }
                additions.extend(by_inertia.iter().map(|(k, e, of)| (columns[*k], *e, of.clone())));
                additions.extend(shared.iter().cloned());
                Some(Forcing::new(model, setting.rig.omega(), &coefficients, &moved, count, &additions))
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Fitted { list, layout: list.layout(), records })
    }

    /// What the sensors showed over a window, and what columns of sensors add there.
    pub fn measured(&self, path: &Path, w: &Window, states: &[f64], list: &List<'_>) -> Measured<'_> {
        let first = path.first + w.first;
        let sensors = self.weights.len();
        let mut values = vec![0.0; w.count * sensors];
        for (s, shown) in self.shown[w.stretch].iter().enumerate() {
            for i in 0..w.count {
                values[i * sensors + s] = shown[first + i];
            }
        }
        let exogenous = self.window_inputs(path, w);
        let n = self.weights.first().map_or(0, Vec::len);
        let mut laws = Vec::new();
        let mut at = self.setting.own.names.len();
        for c in self.state.chosen.iter().map(|k| &k.candidate).chain(list.further.iter().copied()) {
            if let Some((sensor, of)) = c.reads() {
                let mixed = |from: usize| -> Vec<f64> {
                    let weights = &self.weights[sensor];
                    let of = |i: usize| weights.iter().enumerate().map(|(j, w)| w * states[2 * n * i + from + j]).sum();
                    (0..w.count).map(of).collect()
                };
                let tape = Tape::new(of);
                let series: Vec<Vec<f64>> = tape
                    .symbols()
                    .iter()
                    .map(|s| match s {
                        Symbol::Coordinate(_) | Symbol::Raw(_) => mixed(0),
                        Symbol::Rate(_) | Symbol::ClearRate(_) => mixed(n),
                        _ => (0..w.count).map(|i| exogenous.time(i * exogenous.points)).collect(),
                    })
                    .collect();
                let columns: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
                laws.extend(tape.run(&columns, w.count).into_iter().enumerate().map(|(k, v)| (at + k, sensor, v)));
            }
            at += c.strengths();
        }
        Measured { values, shown: &self.weights, sigma: &self.sigma, laws }
    }

    /// The model's flow about every window's path at the coefficients `x`, whatever is fitted to it.
    pub fn linear(&self, paths: &[Path], all: &[Window], x: &[f64]) -> Option<Vec<Option<Linear>>> {
        let x = DVector::from_column_slice(x);
        let motion = |record: usize| self.state.followed_motion_of(self.setting, &x, record);
        let motions = (0..self.setting.own.of_record.len()).map(motion).collect::<Option<Vec<_>>>()?;
        let of = |w: &Window| {
            let Moving { equations: motion, parameters, hidden } = motions.get(self.record_of(w))?;
            let field = VectorField { motion, parameters };
            Linear::new(
                paths[w.stretch].of(w, self.setting.circle.len()),
                &self.window_inputs(&paths[w.stretch], w),
                field,
                hidden,
            )
        };
        Some(all.par_iter().map(of).collect())
    }

    fn record_of(&self, w: &Window) -> usize {
        self.setting.record_of.get(w.stretch).copied().unwrap_or(0)
    }

    /// A window about which the model's flow is linear; none where columns have no value there.
    /// Accelerations by its columns are kept if it is to be moved: with every candidate's columns
    /// that would be much.
    fn solve(
        &self,
        path: &Path,
        (w, blocks): (&Window, usize),
        fitted: &Fitted<'_>,
        linear: &Linear,
        moves: bool,
    ) -> Option<Columns> {
        let n = self.setting.circle.len();
        let Fitted { list, layout, records } = fitted;
        let forcing = records.get(self.record_of(w))?;
        let states = path.of(w, n);
        let exogenous = self.window_inputs(path, w);
        let driven = forcing.on(&linear.points, &linear.accelerations, &exogenous);
        let measured = self.measured(path, w, states, list);
        let block = w.count / blocks;
        let is_cut = block / SHORT >= FEWEST_SAMPLES;
        // Segments of a block that is not cut are for its digits alone.
        let segment = if is_cut { block / SHORT } else { (block / SHORT).max(FEWEST_SAMPLES) };
        let cut = Cut { blocks, segment };
        let mut registers = Registers::default();
        let mut alpha = Vec::new();
        let (normal, all) = if moves {
            alpha = driven.all()?;
            let size = alpha.len() / (linear.points.len() / (2 * n));
            let from = |points: Range<usize>, to: &mut Vec<f64>| {
                to.clear();
                to.extend_from_slice(&alpha[points.start * size..points.end * size]);
                Some(())
            };
            linear.normal(states, from, layout, &measured, cut)?
        } else {
            let from = |points, to: &mut Vec<f64>| driven.between(points, &mut registers, to);
            linear.normal(states, from, layout, &measured, cut)?
        };
        let solved = if blocks > 1 { Some(normal.solved()?) } else { None };
        let parts = all.iter().map(|b| self.parts(b, &normal, solved.as_ref(), is_cut)).collect::<Option<_>>()?;
        Some(Columns { alpha, normal, parts })
    }

    /// All windows linearised in which states of effects are known.
    pub fn solved(&self, paths: &[Path], all: &[Window], list: &List<'_>) -> Option<Vec<Option<Solved>>> {
        let (fitted, linear, blocks) =
            (self.fitted(list)?, self.linear(paths, all, &list.x)?, blocks_of(self.setting, all));
        let of = |((w, linear), known): ((&Window, Option<Linear>), bool)| {
            let linear = linear.filter(|_| known)?;
            let columns = self.solve(&paths[w.stretch], (w, blocks), &fitted, &linear, true)?;
            Some(Solved { columns, linear })
        };
        Some(all.par_iter().zip(linear).zip(self.known(paths, all)).map(of).collect())
    }

    /// Which windows lie where states of effects are known; all where that would leave too few.
    pub fn known(&self, paths: &[Path], all: &[Window]) -> Vec<bool> {
        let known: Vec<bool> = all.iter().map(|w| paths[w.stretch].first + w.first >= self.begins[w.stretch]).collect();
        let unknown = known.iter().filter(|k| !**k).count();
        if unknown as f64 > MOST_UNKNOWN * all.len() as f64 { vec![true; all.len()] } else { known }
    }

    /// Gram matrices of all windows about which the model is `linear`, without what they were made
    /// of: with every candidate's columns that would be much.
    pub fn reduced(
        &self,
        paths: &[Path],
        all: &[Window],
        linear: &[Option<Linear>],
        list: &List<'_>,
        signs: Vec<f64>,
    ) -> Option<Blocks> {
        let (fitted, blocks) = (self.fitted(list)?, blocks_of(self.setting, all));
        let of = |(w, linear): (&Window, &Option<Linear>)| {
            Some(self.solve(&paths[w.stretch], (w, blocks), &fitted, linear.as_ref()?, false)?.parts)
        };
        let found: Vec<Option<Vec<Vec<Part>>>> = all.par_iter().zip(linear).map(of).collect();
        let kept = found.into_iter().zip(self.places(paths, all)).filter_map(|(parts, places)| Some((parts?, places)));
        let (parts, places): (Vec<_>, Vec<_>) = kept.unzip();
        let mut out = Blocks::new(parts.concat(), signs, list.x.clone());
        out.places = places.concat();
        out.are_parts = blocks > 1;
        Some(out)
    }

    /// Accelerations by every column along the windows about which the model is `linear`: at each
    /// point n rows of the columns.
    pub fn forced(
        &self,
        paths: &[Path],
        all: &[Window],
        linear: &[Option<Linear>],
        list: &List<'_>,
    ) -> Option<Vec<Option<Vec<f64>>>> {
        let fitted = self.fitted(list)?;
        let of = |(w, linear): (&Window, &Option<Linear>)| {
            let (linear, exogenous) = (linear.as_ref()?, self.window_inputs(&paths[w.stretch], w));
            fitted.records.get(self.record_of(w))?.on(&linear.points, &linear.accelerations, &exogenous).all()
        };
        Some(all.par_iter().zip(linear).map(of).collect())
    }

    /// Rows of a window less the states that were eliminated.
    pub(super) fn freedom(&self, normal: &Normal) -> f64 {
        normal.rows as f64 - 2.0 * self.setting.circle.len() as f64
    }

    /// Blocks of the windows that have a solution at coefficients `x`, and the window of each.
    pub fn blocks(&self, solved: &[Option<Solved>], signs: Vec<f64>, x: &[f64]) -> (Blocks, Vec<usize>) {
        let own = |(k, s): (usize, &Option<Solved>)| {
            let parts = s.as_ref().map(|s| s.columns.parts.clone()).unwrap_or_default();
            parts.into_iter().map(move |p| (p, k)).collect::<Vec<_>>()
        };
        let (parts, of) = solved.iter().enumerate().flat_map(own).unzip();
        let mut out = Blocks::new(parts, signs, x.to_vec());
        out.are_parts = solved.iter().flatten().any(|s| s.columns.parts.len() > 1);
        (out, of)
    }

    /// Whether a moved path is one that the linearisation can mean.
    pub fn is_near(&self, before: &[f64], after: &[f64]) -> bool {
        let n = self.setting.circle.len();
        after.iter().all(|x| x.is_finite())
            && (0..n).filter(|k| self.setting.circle[*k]).all(|k| {
                let pairs = before.iter().skip(k).step_by(2 * n).zip(after.iter().skip(k).step_by(2 * n));
                pairs.into_iter().all(|(a, b)| (a - b).abs() < FARTHEST_RAD)
            })
    }
}

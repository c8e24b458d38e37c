//! Multiple shooting, linearised about the measured motion: residuals of trajectories for everything that a model may be missing.
//!
//! Each window of the record has an initial state of its own, which is eliminated; what is lacking is weighed as predictions miss it: a force
//! that acts against the motion adds up over a window, where in the balance of forces it is a small share beside those that do not. No
//! solution is searched for: the model is linearised about the smoothed record, solved, and linearised again about its own motion until that stands
//! still ([`linear`]). Windows grow to their length in three stages; those in which the motion does not come to rest are left out, by that and never by their misfit.
//!
//! Each window is predicted over two horizons, its own length and a twelfth of it, with a weight for either: what adds up slowly shows in the long one, what is fast in the
//! short one, where little of what else is lacking has added up.
//!
//! Windows are as long as leaves [`BLOCKS`] of them, and ten periods of the motion at most (under measured inputs, whose windows of the weak form are those of
//! transients, twenty of these).
//!
//! | file | what |
//! |---|---|
//! | [`path`] | the motion that is linearised about, windows |
//! | [`along`] | phase, time, inputs along a window |
//! | [`forcing`] | accelerations by every column |
//! | [`linear`] | a window's normal equations |
//! | [`blocks`] | least squares over windows |
//! | [`signs`] | coefficients that keep their sign |

mod along;
pub mod blocks;
mod forcing;
mod linear;
mod path;
pub mod signs;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use self::along::Along;
use self::blocks::{Blocks, Part};
use self::forcing::{Additions, Forcing};
use self::linear::{Linear, Measured, Normal};
pub use self::path::Path;
use self::path::{FEWEST_SAMPLES, Window, windows};
use super::candidates::{Candidate, Column};
use super::setting::Setting;
use super::state::State;
use crate::identify::general::track;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::tape::Tape;

/// Windows that a record should give.
const BLOCKS: f64 = 20.0;
/// Longest window under measured inputs, in windows of the weak form.
const TRANSIENTS: f64 = 20.0;
/// Windows of the short horizon in one of the long.
const SHORT: usize = 12;
/// Most samples that are followed.
const MOST_SAMPLES: usize = 60_000;
/// Parts of the full length in which windows grow, and most linearisations at each.
const STAGES: [f64; 3] = [0.25, 0.5, 1.0];
const PASSES: [usize; 3] = [2, 2, 5];
/// Movement of the path, in the sensors' noise or as a share of what is left, below which it stands still.
const STILL: f64 = 0.15;
/// Movement of an angle, rad, beyond which a linearisation says nothing.
const FARTHEST_RAD: f64 = 0.7;
/// Share of the windows that may be left out.
const MOST_LOST: f64 = 0.3;
/// Turn of the low-pass's highest frequency between two points, rad: columns are integrated to (0.4)²/12, 1 % of what is fastest. Most points to a sample.
const MOST_TURN: f64 = 0.4;
const MOST_POINTS: f64 = 16.0;

/// Paths, and the windows that they are followed in.
#[derive(Clone, Debug)]
pub struct Followed {
    paths: Vec<Path>,
    /// Samples of a window; none before it was found.
    length: Option<usize>,
    /// Windows of the last fit.
    count: usize,
}

impl Followed {
    /// How many windows, and the length of one, s.
    pub fn windows(&self, setting: &Setting<'_>) -> (usize, f64) {
        let step_s = setting.raw.first().map_or(0.0, |s| s.step_s);
        (self.count, self.length.map_or(0.0, |l| l as f64 * step_s))
    }
}

/// The record while columns are fitted to it.
struct Course<'a> {
    setting: &'a Setting<'a>,
    state: &'a State,
    between: Vec<track::Along>,
    /// What the sensors showed, by stretch and sensor.
    shown: Vec<Vec<Vec<f64>>>,
    weights: Vec<Vec<f64>>,
    sigma: Vec<f64>,
    omega: f64,
}

/// Everything that has a column, for one record.
struct Columns {
    motion: EquationsOfMotion,
    parameters: Vec<f64>,
    forcing: Forcing,
}

/// One window at one linearisation.
struct Solved {
    linear: Linear,
    alpha: Vec<f64>,
    normal: Normal,
    parts: Vec<Part>,
}

/// What is fitted: the model's own columns and what was chosen, at coefficients `x` (increments are zero), then others.
struct List<'a> {
    x: Vec<f64>,
    further: &'a [&'a Candidate],
    behind: &'a [Column],
}

impl<'a> Course<'a> {
    fn new(setting: &'a Setting<'a>, state: &'a State) -> Self {
        let omega = setting.rig.drive.map_or(0.0, |_| setting.rig.omega());
        let between = state.stretches.iter().map(|s| track::Along::new(s, omega)).collect();
        let shown = state.stretches.iter().map(|s| s.sensors(&setting.bound)).collect();
        let (weights, sigma) = state.on_track(setting, |t| (t.sensors.clone(), t.sigma.clone()));
        Self { setting, state, between, shown, weights, sigma, omega }
    }

    fn along(&self, path: &Path, w: &Window) -> Along<'_> {
        Along {
            stretch: &self.state.stretches[w.stretch],
            between: &self.between[w.stretch],
            first: path.first + w.first,
            omega: self.omega,
            points: self.points(),
        }
    }

    /// Columns of a list for every record.
    fn columns(&self, list: &List<'_>) -> Option<(usize, Vec<Columns>)> {
        let (setting, state) = (self.setting, self.state);
        let model = setting.model();
        let own = setting.own.names.len();
        let all = state.chosen.iter().map(|k| &k.candidate).chain(list.further.iter().copied());
        let mut parts: Vec<Column> = all.flat_map(|c| c.columns(setting, state)).collect();
        parts.extend_from_slice(list.behind);
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
        let x = DVector::from_column_slice(&list.x);
        let places = model.term_places();
        let records = setting
            .own
            .of_record
            .iter()
            .enumerate()
            .map(|(record, columns)| {
                let coefficients: Vec<f64> = columns.iter().map(|c| list.x[*c]).collect();
                let mut additions: Additions = Vec::new();
                for (e, equation) in model.equations.iter().enumerate() {
                    for (term, &k) in equation.terms.iter().zip(&places[e]) {
                        additions.push((*columns.get(k)?, e, model.in_seconds(&term.of, setting.rig.omega())));
                    }
                }
                additions.extend(shared.iter().cloned());
                let (motion, parameters) = state.motion_of(setting, &x, record)?;
                let forcing = Forcing::new(model, setting.rig.omega(), &coefficients, &moved, (count, &additions));
                Some(Columns { motion, parameters, forcing })
            })
            .collect::<Option<Vec<_>>>()?;
        Some((count, records))
    }

    /// What the sensors showed over a window, and what columns of sensors add there.
    fn measured(&self, path: &Path, w: &Window, states: &[f64], list: &List<'_>) -> Measured<'_> {
        let first = path.first + w.first;
        let sensors = self.weights.len();
        let mut values = vec![0.0; w.count * sensors];
        for (s, shown) in self.shown[w.stretch].iter().enumerate() {
            for i in 0..w.count {
                values[i * sensors + s] = shown[first + i];
            }
        }
        let along = self.along(path, w);
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
                        _ => (0..w.count).map(|i| along.time(i * along.points)).collect(),
                    })
                    .collect();
                let columns: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
                laws.extend(tape.run(&columns, w.count).into_iter().enumerate().map(|(k, v)| (at + k, sensor, v)));
            }
            at += c.strengths();
        }
        Measured { values, shown: &self.weights, sigma: &self.sigma, laws }
    }

    /// Points to a sample: so many that what the low-pass lets through turns by little between two.
    fn points(&self) -> usize {
        let spacing = self.state.stretches.first().map_or(1.0, |s| s.step_s);
        let turn = core::f64::consts::TAU * self.setting.geometry.kernels.full.pass_hz * spacing;
        (turn / MOST_TURN).ceil().clamp(1.0, MOST_POINTS) as usize
    }

    /// A window linearised; none where that is not possible.
    fn solve(&self, path: &Path, w: &Window, list: &List<'_>, (count, records): (usize, &[Columns])) -> Option<Solved> {
        let n = self.setting.circle.len();
        let record = self.setting.record_of.get(w.stretch).copied().unwrap_or(0);
        let columns = records.get(record)?;
        let states = &path.states[2 * n * w.first..2 * n * (w.first + w.count)];
        let along = self.along(path, w);
        let motion = (&columns.motion, &columns.parameters[..]);
        let linear = Linear::new(states, &along, motion)?;
        let alpha = columns.forcing.along(&linear.points, &along, motion)?;
        let measured = self.measured(path, w, states, list);
        let normal = linear.normal(states, &alpha, count, &measured, (0, w.count));
        let gram = normal.reduced(&normal.at(&list.x))?;
        let mut parts = vec![Part { gram, freedom: self.freedom(&normal) }];
        let short = w.count / SHORT;
        if short >= FEWEST_SAMPLES {
            let mut sum: Option<Part> = None;
            for k in 0..w.count / short {
                let normal = linear.normal(states, &alpha, count, &measured, (k * short, (k + 1) * short));
                let gram = normal.reduced(&normal.at(&list.x))?;
                let freedom = self.freedom(&normal);
                sum = Some(match sum {
                    Some(part) => Part { gram: part.gram + gram, freedom: part.freedom + freedom },
                    None => Part { gram, freedom },
                });
            }
            parts.extend(sum);
        }
        Some(Solved { linear, alpha, normal, parts })
    }

    /// All windows linearised.
    fn solved(&self, paths: &[Path], all: &[Window], list: &List<'_>) -> Option<Vec<Option<Solved>>> {
        let (count, records) = self.columns(list)?;
        Some(all.par_iter().map(|w| self.solve(&paths[w.stretch], w, list, (count, &records))).collect())
    }

    /// Gram matrices of all windows, without what they were made of: with every candidate's columns that would be much.
    fn reduced(&self, paths: &[Path], all: &[Window], list: &List<'_>, signs: Vec<f64>) -> Option<Blocks> {
        let (count, records) = self.columns(list)?;
        let of = |w: &Window| Some(self.solve(&paths[w.stretch], w, list, (count, &records))?.parts);
        let found: Vec<Option<Vec<Part>>> = all.par_iter().map(of).collect();
        Some(Blocks::new(found.into_iter().flatten().collect(), signs))
    }

    /// Rows of a window less the states that were eliminated.
    fn freedom(&self, normal: &Normal) -> f64 {
        normal.rows as f64 - 2.0 * self.setting.circle.len() as f64
    }

    /// Blocks of the windows that have a solution, and their numbers.
    fn blocks(&self, solved: &[Option<Solved>], signs: Vec<f64>) -> (Blocks, Vec<usize>) {
        let kept: Vec<usize> = (0..solved.len()).filter(|&k| solved[k].is_some()).collect();
        let windows = solved.iter().flatten().map(|s| s.parts.clone()).collect();
        (Blocks::new(windows, signs), kept)
    }

    /// Whether a moved path is one that the linearisation can mean.
    fn is_near(&self, before: &[f64], after: &[f64]) -> bool {
        let n = self.setting.circle.len();
        after.iter().all(|x| x.is_finite())
            && (0..n).filter(|k| self.setting.circle[*k]).all(|k| {
                let pairs = before.iter().skip(k).step_by(2 * n).zip(after.iter().skip(k).step_by(2 * n));
                pairs.into_iter().all(|(a, b)| (a - b).abs() < FARTHEST_RAD)
            })
    }
}

/// Signs of all columns.
fn signs_of(setting: &Setting<'_>, state: &State, further: &[&Candidate], behind: usize) -> Vec<f64> {
    let mut out = setting.signs.clone();
    for c in state.chosen.iter().map(|k| &k.candidate).chain(further.iter().copied()) {
        out.extend(signs::of(c));
    }
    out.resize(out.len() + behind, 0.0);
    out
}

/// Coefficients of the model's own columns and of what was chosen; zero for what is found as an increment.
fn present(state: &State) -> Vec<f64> {
    super::given::coefficients(state).iter().copied().collect()
}

/// Longest window, samples.
fn longest(setting: &Setting<'_>, lengths: &[usize]) -> usize {
    let step_s = setting.raw.first().map_or(1.0, |s| s.step_s);
    let whole: usize = lengths.iter().sum();
    let own = setting.geometry.windows.length_s / step_s;
    let most = if setting.bound.inputs.is_empty() { own } else { TRANSIENTS * own };
    let wished = (whole as f64 / BLOCKS).min(most) as usize;
    wished.max(2 * FEWEST_SAMPLES).min(lengths.iter().copied().max().unwrap_or(0))
}

/// Fits the model's own columns and what was chosen from the state's coefficients on, moving the paths with them; none where most windows cannot be followed.
pub fn settle(setting: &Setting<'_>, state: &mut State) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let n = setting.circle.len();
    let mut followed = state.followed.take().unwrap_or_else(|| Followed {
        paths: state.stretches.iter().map(|s| Path::smoothed(s, &setting.geometry.kernels)).collect(),
        length: None,
        count: 0,
    });
    let lengths: Vec<usize> = followed.paths.iter().map(|p| p.len(n)).collect();
    let stages: Vec<(usize, usize)> = match followed.length {
        Some(length) => vec![(length, PASSES[2])],
        None => {
            let full = longest(setting, &lengths);
            let of = |(share, passes): (f64, usize)| ((share * full as f64) as usize, passes);
            STAGES.into_iter().zip(PASSES).map(of).filter(|s| s.0 >= 2 * FEWEST_SAMPLES).collect()
        }
    };
    let mut x = present(state);
    let own: Vec<usize> = (0..x.len()).collect();
    let signs = signs_of(setting, state, &[], 0);
    let mut last = None;
    for (length, passes) in stages {
        let course = Course::new(setting, state);
        let (mut trial, mut moved) = (followed.clone(), x.clone());
        let Some(fit) = stage(&course, &mut trial, &mut moved, (length, passes), &own, &signs) else { break };
        trial.length = Some(length);
        (followed, x, last) = (trial, moved, Some(fit));
    }
    let (covariance, count) = last?;
    followed.count = count;
    state.followed = Some(followed);
    Some((DVector::from_vec(x), covariance))
}

/// Linearises and solves until paths stand still; the covariance, and how many windows were followed.
fn stage(
    course: &Course<'_>,
    followed: &mut Followed,
    x: &mut Vec<f64>,
    (length, passes): (usize, usize),
    own: &[usize],
    signs: &[f64],
) -> Option<(DMatrix<f64>, usize)> {
    let n = course.setting.circle.len();
    let lengths: Vec<usize> = followed.paths.iter().map(|p| p.len(n)).collect();
    let all = windows(&lengths, length, MOST_SAMPLES);
    let applied: Vec<bool> = is_applied(course.state, own.len());
    let mut out = None;
    for _ in 0..passes {
        // What is found as an increment was taken off the record after the last linearisation, not here.
        let list = List { x: x.clone(), further: &[], behind: &[] };
        let solved = course.solved(&followed.paths, &all, &list)?;
        let (mut blocks, kept) = course.blocks(&solved, signs.to_vec());
        if (kept.len() as f64) < (1.0 - MOST_LOST) * all.len() as f64 {
            return None;
        }
        let fit = blocks.fit(own)?;
        blocks.weigh(&blocks.misfits(&fit.all));
        let fit = blocks.fit(own)?;
        let misfits = blocks.misfits(&fit.all);
        let step = DVector::from_iterator(own.len(), own.iter().map(|&c| fit.all[c] - x[c]));
        let (mut greatest, mut near) = (0.0_f64, 0);
        for &k in &kept {
            let (w, Some(s)) = (&all[k], &solved[k]) else { continue };
            let path = &mut followed.paths[w.stretch];
            let range = 2 * n * w.first..2 * n * (w.first + w.count);
            let states = path.states[range.clone()].to_vec();
            let measured = course.measured(path, w, &states, &list);
            let Some(start) = s.normal.start(&step) else { continue };
            let (after, moved) = s.linear.moved(&states, &s.alpha, (&start, &step), &measured);
            if course.is_near(&states, &after) {
                path.states[range].copy_from_slice(&after);
                greatest = greatest.max(moved);
                near += 1;
            }
        }
        if (f64::from(near)) < (1.0 - MOST_LOST) * all.len() as f64 {
            return None;
        }
        let left = (misfits.iter().map(|w| w[0]).sum::<f64>() / misfits.len() as f64).sqrt();
        for (c, (to, from)) in x.iter_mut().zip(fit.all.iter()).enumerate() {
            *to = if applied[c] { *to } else { *from };
        }
        out = Some((fit, kept.len()));
        if greatest < STILL * left.max(1.0) {
            break;
        }
    }
    let (fit, count) = out?;
    *x = fit.all.iter().copied().collect();
    Some((fit.covariance, count))
}

/// Which of the own columns are found as increments.
fn is_applied(state: &State, count: usize) -> Vec<bool> {
    let mut out = vec![false; state.values.len()];
    for k in &state.chosen {
        out.extend(std::iter::repeat_n(k.candidate.is_applied(), k.strengths.len()));
    }
    out.resize(count, false);
    out
}

/// Gram matrices of the own columns, of further candidates and of columns of no effect, about the settled paths.
pub fn evidence(setting: &Setting<'_>, state: &State, further: &[&Candidate], behind: &[Column]) -> Option<Blocks> {
    let followed = state.followed.as_ref()?;
    let n = setting.circle.len();
    let lengths: Vec<usize> = followed.paths.iter().map(|p| p.len(n)).collect();
    let all = windows(&lengths, followed.length?, MOST_SAMPLES);
    let course = Course::new(setting, state);
    let list = List { x: present(state), further, behind };
    let mut blocks = course.reduced(&followed.paths, &all, &list, signs_of(setting, state, further, behind.len()))?;
    let own: Vec<usize> = (0..list.x.len()).collect();
    let fit = blocks.fit(&own)?;
    blocks.weigh(&blocks.misfits(&fit.all));
    blocks.still = is_applied(state, own.len());
    Some(blocks)
}

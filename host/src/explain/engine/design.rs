//! Columns of the equations and of everything that they may be missing, over all windows of the
//! weak form.
//!
//! Each coefficient of an equation is a column in that equation; an effect's column stands in all
//! equations that it acts on. A column of what a sensor shows is the derivative of the residual by
//! its strength, taken by a small correction of the record.

use rayon::prelude::*;

use super::candidates::Candidate;
use super::prediction::Range;
use super::setting::Setting;
use super::state::State;
use crate::error::Result;
use crate::explain::ranking::FOLDS;
use crate::identify::series::System;
use crate::identify::stretches::Stretch;
use crate::identify::taken_off::{OfTheRecord, small_step};
use crate::identify::windows::{WindowRows, frequency_of_row, row_count, rows_of};
use crate::model::model_file::expression::Node;
use crate::model::model_file::weak_form::{Column, WeakForm};

/// All columns over all windows.
pub struct Design {
    /// Number of columns; a row is that many values and then the target.
    pub columns: usize,
    /// Rows of a window: those of the first equation, then those of the next.
    pub rows: usize,
    /// Frequencies above zero.
    pub frequencies: usize,
    /// Windows in order of time.
    pub windows: Vec<Window>,
}

/// Rows of one window.
pub struct Window {
    /// Unbroken stretch.
    pub run: usize,
    /// Number within the stretch; consecutive ones overlap by half.
    pub index: usize,
    /// `rows` × (`columns` + 1) values.
    pub values: Vec<f64>,
}

impl Window {
    /// Block of one window's length: even windows are one, odd ones lie in two.
    pub fn blocks(&self) -> (usize, usize) {
        (self.run + self.index / 2, self.run + self.index.div_ceil(2))
    }
}

impl Design {
    /// Number of equations.
    pub fn equations(&self) -> usize {
        self.rows / row_count(self.frequencies)
    }

    /// What windows of every fold but the first leave out.
    pub fn held_out(&self, setting: &Setting<'_>) -> Vec<Range> {
        let (windows, reach) = (&setting.geometry.windows, setting.geometry.kernels.full.reach());
        let of = |w: &Window| {
            // Short against the stretch; rounded as windows are placed.
            let samples = |s: f64| (s / setting.raw[w.run].step_s).round() as usize;
            let begin = reach + samples(w.index as f64 * windows.hop_s);
            Range { stretch: w.run, begin, end: begin + samples(windows.length_s) }
        };
        self.windows.iter().filter(|w| w.index % 2 == 0 && w.blocks().0 % FOLDS == 0).map(of).collect()
    }

    /// Equation and frequency of a row.
    pub fn place_of_row(&self, row: usize) -> (usize, usize) {
        let n = row_count(self.frequencies);
        (row / n, frequency_of_row(row % n))
    }
}

/// For each equation the global column of each of its terms.
type Map = Vec<Vec<usize>>;

/// The weak form with further columns, and which columns these are in the windows of each record.
fn weak_of(setting: &Setting<'_>, further: &[Vec<(usize, Node)>]) -> Result<(WeakForm, Vec<Map>)> {
    let model = setting.model();
    let at = setting.own.names.len();
    let mut behind: Map = vec![Vec::new(); model.equations.len()];
    let mut extra: Vec<Vec<Column>> = vec![Vec::new(); model.equations.len()];
    for (k, column) in further.iter().enumerate() {
        for (e, of) in column {
            extra[*e].push(Column { name: k.to_string(), of: of.clone() });
            behind[*e].push(at + k);
        }
    }
    let of = |columns: &Vec<usize>| -> Map {
        let terms = model.term_places().into_iter().zip(&behind);
        terms.map(|(own, behind)| own.iter().map(|&i| columns[i]).chain(behind.iter().copied()).collect()).collect()
    };
    let maps = setting.own.of_record.iter().map(of).collect();
    Ok((WeakForm::new(model, setting.rig.omega(), &extra)?, maps))
}

/// The columns of a window.
fn map_of<'a>(setting: &Setting<'_>, maps: &'a [Map], window: &WindowRows) -> &'a Map {
    let record = setting.record_of.get(window.run).copied().unwrap_or(0);
    &maps[record.min(maps.len() - 1)]
}

fn rows(setting: &Setting<'_>, stretches: &[Stretch], weak: &WeakForm) -> Vec<WindowRows> {
    let system = System { stretches, weak, kernels: &setting.geometry.kernels, circle: &setting.circle };
    rows_of(&system, &weak.equations, &setting.geometry.kernels, &setting.geometry.windows)
}

/// Spreads the equations' own columns over the global ones.
fn spread(rows: &WindowRows, map: &Map, columns: usize, frequencies: usize) -> Vec<f64> {
    let n = row_count(frequencies);
    let mut out = vec![0.0; map.len() * n * (columns + 1)];
    for (i, map) in map.iter().enumerate() {
        let width = map.len() + 1;
        for r in 0..n {
            let from = &rows.equations[i][r * width..(r + 1) * width];
            let to = &mut out[(i * n + r) * (columns + 1)..(i * n + r + 1) * (columns + 1)];
            map.iter().zip(from).for_each(|(&c, x)| to[c] += *x);
            to[columns] = from[width - 1];
        }
    }
    out
}

/// Columns of the equations, of what was chosen, then of each further candidate.
///
/// # Errors
/// An effect that the weak form cannot hold.
pub fn build(setting: &Setting<'_>, state: &State, stretches: &[Stretch], further: &[&Candidate]) -> Result<Design> {
    with_columns(setting, state, stretches, further, &[])
}

/// The same with columns of no effect behind them.
///
/// # Errors
/// As [`build`].
pub fn with_columns(
    setting: &Setting<'_>,
    state: &State,
    stretches: &[Stretch],
    further: &[&Candidate],
    behind: &[Vec<(usize, Node)>],
) -> Result<Design> {
    let all: Vec<&Candidate> = state.chosen.iter().map(|k| &k.candidate).chain(further.iter().copied()).collect();
    let mut parts: Vec<Vec<(usize, Node)>> = all.iter().flat_map(|c| c.columns(setting, state)).collect();
    parts.extend_from_slice(behind);
    let own = state.values.len();
    let columns = own + parts.len();
    let (weak, maps) = weak_of(setting, &parts)?;
    let frequencies = setting.geometry.windows.frequencies;
    let found = rows(setting, stretches, &weak);
    let mut windows: Vec<Window> = found
        .par_iter()
        .map(|w| {
            let values = spread(w, map_of(setting, &maps, w), columns, frequencies);
            Window { run: w.run, index: w.index, values }
        })
        .collect();
    drop(found);
    let count = setting.model().equations.len() * row_count(frequencies);
    let mut at = own;
    let mut plain: Option<Vec<Vec<f64>>> = None;
    for c in all {
        if let Some((sensor, laws)) = c.reads() {
            for (k, law) in laws.iter().enumerate() {
                let step = small_step(stretches, &setting.bound, sensor, law);
                let reference = match &plain {
                    Some(r) => r,
                    None => plain.insert(residual(setting, state, stretches)?),
                };
                let mut of = OfTheRecord::default();
                of.sensor(sensor, [(law.clone(), step)]);
                let moved: Vec<Stretch> = stretches.iter().map(|s| of.taken_off(s, &setting.bound)).collect();
                let changed = residual(setting, state, &moved)?;
                for (window, (a, b)) in windows.iter_mut().zip(reference.iter().zip(&changed)) {
                    for r in 0..count {
                        window.values[r * (columns + 1) + at + k] = -(b[r] - a[r]) / step;
                    }
                }
            }
        }
        at += c.strengths();
    }
    Ok(Design { columns, rows: count, frequencies, windows })
}

/// Residuals Y − Xλ of every window's rows at the state's coefficients.
///
/// # Errors
/// As [`build`].
pub fn residual(setting: &Setting<'_>, state: &State, stretches: &[Stretch]) -> Result<Vec<Vec<f64>>> {
    let (mut parts, mut lambda) = (Vec::new(), state.values.clone());
    for k in state.chosen.iter().filter(|k| !k.candidate.is_applied()) {
        parts.extend(k.candidate.columns(setting, state));
        lambda.extend(&k.strengths);
    }
    let (weak, maps) = weak_of(setting, &parts)?;
    let n = row_count(setting.geometry.windows.frequencies);
    let found = rows(setting, stretches, &weak);
    Ok(found
        .iter()
        .map(|w| {
            let map = map_of(setting, &maps, w);
            let mut out = Vec::with_capacity(map.len() * n);
            for (map, rows) in map.iter().zip(&w.equations) {
                let width = map.len() + 1;
                for row in rows.chunks_exact(width) {
                    out.push(row[width - 1] - map.iter().zip(row).map(|(&c, x)| lambda[c] * x).sum::<f64>());
                }
            }
            out
        })
        .collect())
}

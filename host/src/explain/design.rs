//! Columns of a model and of everything that it may be missing, over all windows of the weak form.
//!
//! Columns are global: B_11 …, B_21 … act in one equation each; an effect's column acts in both with physically consistent coupling. A force's column
//! is ∫ w f. A sensor effect changes the measurement: its column is the derivative of the residual with respect to its strength,
//! taken by applying a small correction to the angles.

use rayon::prelude::*;

use super::effects::{Action, Context, SensorLaw, Variant};
use crate::identify::Geometry;
use crate::identify::windows::{self, WindowRows, frequency_of_row, row_count};
use crate::model::double_pendulum::weak_model;
use crate::model::weak::{Order, Series, Term, WeakModel};
use crate::signal::angles::AngleSegment;

/// All columns over all windows.
pub struct Design {
    /// Number of columns; a row is that many values and then the target.
    pub columns: usize,
    /// Rows of a window: those of the first equation, then those of the second.
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

    /// Equation and frequency of a row.
    pub fn place_of_row(&self, row: usize) -> (usize, usize) {
        let n = row_count(self.frequencies);
        (row / n, frequency_of_row(row % n))
    }
}

/// Number of B coefficients of one equation.
pub fn base_terms(driven: bool) -> usize {
    if driven { 4 } else { 2 }
}

/// The weak model of the B terms and some force columns, and which global column each term of each equation is.
fn model_of(c: &Context, forces: &[[Option<Series>; 2]]) -> (WeakModel, [Vec<usize>; 2]) {
    let mut model = weak_model(c.omega, c.driven, &[]);
    let n = base_terms(c.driven);
    let mut map = [(0..n).collect::<Vec<_>>(), (n..2 * n).collect()];
    for (j, pair) in forces.iter().enumerate() {
        for (i, series) in pair.iter().enumerate() {
            if let Some(series) = series {
                let series = series.clone();
                let part = model.part(&format!("f{j}e{i}"), move |s| series(s), Order::Value, 1.0);
                model.equations[i].terms.push(Term { name: String::new(), unit: "", parts: vec![part] });
                map[i].push(2 * n + j);
            }
        }
    }
    (model, map)
}

/// Spreads an equation's own columns over the global ones.
fn spread(rows: &WindowRows, map: &[Vec<usize>; 2], columns: usize, frequencies: usize) -> Vec<f64> {
    let n = row_count(frequencies);
    let mut out = vec![0.0; 2 * n * (columns + 1)];
    for (i, map) in map.iter().enumerate() {
        let width = map.len() + 1;
        for r in 0..n {
            let from = &rows.equations[i][r * width..(r + 1) * width];
            let to = &mut out[(i * n + r) * (columns + 1)..(i * n + r + 1) * (columns + 1)];
            map.iter().zip(from).for_each(|(&c, x)| to[c] = *x);
            to[columns] = from[width - 1];
        }
    }
    out
}

/// Builds the columns: B terms, then the columns of each variant in turn. `lambda` are present coefficients of the B terms and of the first
/// `lambda.len() − 2·base` columns of force variants, for the derivatives with respect to sensor effects.
pub fn build(
    c: &Context,
    segments: &[AngleSegment],
    geometry: &Geometry,
    variants: &[&Variant],
    model: &[(&Variant, Vec<f64>)],
    base: &[f64],
) -> Design {
    let forces: Vec<[Option<Series>; 2]> = variants
        .iter()
        .flat_map(|v| match &v.action {
            Action::Force(f) => f.clone(),
            Action::Runaway(f) => vec![f.clone()],
            // A place is kept for the sensors' columns.
            Action::Sensor(s) => vec![[None, None]; s.len()],
        })
        .collect();
    let frequencies = geometry.windows.frequencies;
    let columns = 2 * base_terms(c.driven) + forces.len();
    let (weak, map) = model_of(c, &forces);
    let rows = windows::rows(segments, &weak, &geometry.kernels, &geometry.windows);
    let mut windows: Vec<Window> = rows
        .par_iter()
        .map(|w| Window { run: w.run, index: w.index, values: spread(w, &map, columns, frequencies) })
        .collect();
    drop(rows);
    let count = 2 * row_count(frequencies);
    let mut at = 2 * base_terms(c.driven);
    let mut plain: Option<Vec<Vec<f64>>> = None;
    for v in variants {
        if let Action::Sensor(laws) = &v.action {
            for (k, law) in laws.iter().enumerate() {
                let reference = plain.get_or_insert_with(|| residual(c, segments, geometry, model, base));
                let step = small_step(segments, law);
                let moved: Vec<AngleSegment> = segments.iter().map(|s| correct(s, law, step)).collect();
                let changed = residual(c, &moved, geometry, model, base);
                for (window, (a, b)) in windows.iter_mut().zip(reference.iter().zip(&changed)) {
                    for r in 0..count {
                        window.values[r * (columns + 1) + at + k] = -(b[r] - a[r]) / step;
                    }
                }
            }
        }
        at += v.action.len();
    }
    Design { columns, rows: count, frequencies, windows }
}

/// Residuals Y − Xλ of every window's rows for given coefficients.
pub fn residual(
    c: &Context,
    segments: &[AngleSegment],
    geometry: &Geometry,
    model: &[(&Variant, Vec<f64>)],
    base: &[f64],
) -> Vec<Vec<f64>> {
    let mut forces = Vec::new();
    let mut lambda = base.to_vec();
    for (v, k) in model {
        if let Action::Force(f) = &v.action {
            forces.extend(f.iter().cloned());
            lambda.extend(k);
        }
    }
    let (weak, map) = model_of(c, &forces);
    let n = row_count(geometry.windows.frequencies);
    windows::rows(segments, &weak, &geometry.kernels, &geometry.windows)
        .iter()
        .map(|w| {
            (0..2)
                .flat_map(|i| {
                    let width = map[i].len() + 1;
                    let (map, lambda) = (&map, &lambda);
                    (0..n).map(move |r| {
                        let row = &w.equations[i][r * width..(r + 1) * width];
                        row[width - 1] - map[i].iter().zip(row).map(|(&c, x)| lambda[c] * x).sum::<f64>()
                    })
                })
                .collect()
        })
        .collect()
}

/// A strength that moves no angle by more than 1e-4 rad.
fn small_step(segments: &[AngleSegment], law: &SensorLaw) -> f64 {
    let mut greatest = 1e-9_f64;
    for s in segments {
        let sensors = s.sensors();
        for i in (0..s.len()).step_by(17) {
            let d = law([sensors[0][i], sensors[1][i]], rates(&sensors, i, s.step_s), s.time(i));
            greatest = greatest.max(d[0].abs()).max(d[1].abs());
        }
    }
    1e-4 / greatest
}

/// Rates of the sensors' angles over ± 6 samples, rad/s.
fn rates(sensors: &[Vec<f64>; 2], i: usize, step_s: f64) -> [f64; 2] {
    let (a, b) = (i.saturating_sub(6), (i + 6).min(sensors[0].len() - 1));
    if b == a {
        return [0.0; 2];
    }
    [0, 1].map(|k: usize| (sensors[k][b] - sensors[k][a]) / ((b - a) as f64 * step_s))
}

/// The segment with a sensor effect of some strength taken off its angles.
pub fn correct(segment: &AngleSegment, law: &SensorLaw, strength: f64) -> AngleSegment {
    let mut out = segment.clone();
    let sensors = segment.sensors();
    for i in 0..segment.len() {
        let d = law([sensors[0][i], sensors[1][i]], rates(&sensors, i, segment.step_s), segment.time(i));
        out.phi[0][i] -= strength * d[0];
        out.phi[1][i] -= strength * (d[1] + if segment.relative { d[0] } else { 0.0 });
    }
    out
}

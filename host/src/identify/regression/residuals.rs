//! What solutions leave of the rows, e = X λ − y: by frequency, as the error ε = ‖e‖∞/‖q̂‖∞ (q̂ = X
//! λ), from window to window.
//!
//! Residuals and predictions are in the unit of their equation's right-hand side; ε and
//! correlations have none.

use nalgebra::DVector;
use rayon::prelude::*;

use crate::identify::windows::{WindowRows, frequency_of_row};

/// Residuals of one window's rows.
fn residuals(rows: &[f64], coefficients: &DVector<f64>) -> impl Iterator<Item = (f64, f64)> {
    let p = coefficients.len();
    rows.chunks_exact(p + 1).map(move |row| {
        let predicted: f64 = row[..p].iter().zip(coefficients.iter()).map(|(a, b)| a * b).sum();
        (predicted, row[p] - predicted)
    })
}

/// Root of the mean weighted square residual of a row, all equations together; `coefficients` of
/// all equations, concatenated.
pub(crate) fn weighted_rms(
    windows: &[WindowRows],
    terms: &[usize],
    weights: &[Vec<f64>],
    coefficients: &DVector<f64>,
) -> f64 {
    let (mut sum, mut count, mut from) = (0.0, 0_usize, 0);
    for (e, &p) in terms.iter().enumerate() {
        let own = coefficients.rows(from, p).into_owned();
        for window in windows {
            for (r, (_, x)) in residuals(&window.equations[e], &own).enumerate() {
                sum += weights[e][frequency_of_row(r)] * x * x;
                count += 1;
            }
        }
        from += p;
    }
    (sum / count.max(1) as f64).sqrt()
}

/// What repeats of motions that obey the equations leave.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Left {
    /// Root of the mean weighted square over all repeats.
    pub rms: f64,
    /// Mean square of each repeat.
    pub squares: Vec<f64>,
    /// ε of each equation.
    pub error: Vec<f64>,
}

/// What the rows of `measured` motions leave beside those of the motions as they are (`plain`; none
/// for solutions, which leave nothing by themselves). Rows are in the same order in all;
/// `coefficients` of all equations, concatenated.
pub(crate) fn noise_alone(
    plain: Option<&[WindowRows]>,
    measured: &[Vec<WindowRows>],
    terms: &[usize],
    weights: &[Vec<f64>],
    coefficients: &DVector<f64>,
) -> Left {
    let mut squares = vec![0.0; measured.len()];
    let (mut count, mut from) = (0_usize, 0);
    let mut error = Vec::with_capacity(terms.len());
    for (e, &p) in terms.iter().enumerate() {
        let own = coefficients.rows(from, p).into_owned();
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for (square, rows) in squares.iter_mut().zip(measured) {
            for (k, window) in rows.iter().enumerate() {
                let before: Option<Vec<f64>> =
                    plain.and_then(|p| p.get(k)).map(|w| residuals(&w.equations[e], &own).map(|r| r.1).collect());
                for (r, (predicted, after)) in residuals(&window.equations[e], &own).enumerate() {
                    let left = after - before.as_ref().map_or(0.0, |b| b[r]);
                    *square += weights[e][frequency_of_row(r)] * left * left;
                    count += 1;
                    (worst, largest) = (worst.max(left.abs()), largest.max(predicted.abs()));
                }
            }
        }
        error.push(if largest > 0.0 { worst / largest } else { 0.0 });
        from += p;
    }
    let repeats = measured.len().max(1) as f64;
    squares.iter_mut().for_each(|s| *s *= repeats / count.max(1) as f64);
    Left { rms: (squares.iter().sum::<f64>() / repeats).sqrt(), squares, error }
}

/// Rms residual at each frequency, pooled with its two neighbours on either side so that few
/// windows suffice.
pub(super) fn rms_by_frequency(
    windows: &[WindowRows],
    e: usize,
    solution: &DVector<f64>,
    frequencies: usize,
) -> Vec<f64> {
    // Parts of a fixed size, added in their order: the same on any number of threads.
    let parts: Vec<Vec<f64>> = windows
        .par_chunks(64)
        .map(|part| {
            let mut sum = vec![0.0; frequencies + 1];
            for window in part {
                for (r, (_, residual)) in residuals(&window.equations[e], solution).enumerate() {
                    // The single row of m = 0 counts as two, like the others.
                    sum[frequency_of_row(r)] += residual * residual * if r == 0 { 2.0 } else { 1.0 };
                }
            }
            sum
        })
        .collect();
    let sum: Vec<f64> = (0..=frequencies).map(|m| parts.iter().map(|p| p[m]).sum()).collect();
    (0..=frequencies)
        .map(|m| {
            let near = &sum[m.saturating_sub(2)..=(m + 2).min(frequencies)];
            (near.iter().sum::<f64>() / (2 * near.len() * windows.len()) as f64).sqrt()
        })
        .collect()
}

/// x·y, in eight sums side by side.
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((xs, rest_x), (ys, rest_y)) = (x.as_chunks::<8>(), y.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (x, y) in xs.iter().zip(ys) {
        sums.iter_mut().zip(x.iter().zip(y)).for_each(|(sum, (x, y))| *sum += x * y);
    }
    sums.iter().sum::<f64>() + rest_x.iter().zip(rest_y).map(|(x, y)| x * y).sum::<f64>()
}

/// Greatest mean correlation, over 31 lags from `least` windows on (2 by default), of weighted
/// residuals.
pub(super) fn repetition(
    windows: &[WindowRows],
    coefficients: &[DVector<f64>],
    weights: &[Vec<f64>],
    least: usize,
) -> f64 {
    let rows: Vec<Vec<f64>> = windows
        .par_iter()
        .map(|w| {
            coefficients
                .iter()
                .enumerate()
                .flat_map(|(e, c)| {
                    residuals(&w.equations[e], c)
                        .enumerate()
                        .map(|(r, (_, x))| x * weights[e][frequency_of_row(r)].sqrt())
                        .collect::<Vec<_>>()
                })
                .collect()
        })
        .collect();
    let squares: Vec<f64> = rows.iter().map(|r| dot(r, r)).collect();
    let of_lag = |lag: usize| {
        let (mut product, mut power, mut pairs) = (0.0, 0.0, 0_usize);
        for i in 0..windows.len() - lag {
            let (a, b) = (&windows[i], &windows[i + lag]);
            if a.run != b.run || b.index != a.index + lag {
                continue;
            }
            pairs += 1;
            product += dot(&rows[i], &rows[i + lag]);
            power += 0.5 * (squares[i] + squares[i + lag]);
        }
        // A handful of pairs correlates by chance.
        if pairs >= 4 && power > 0.0 { product / power } else { 0.0 }
    };
    let last = (least + 30).min(windows.len().saturating_sub(1));
    (least..=last).into_par_iter().map(of_lag).reduce(|| 0.0, f64::max)
}

/// ε = ‖e‖∞/‖q̂‖∞ of one equation with given coefficients.
pub fn identification_error(windows: &[WindowRows], e: usize, coefficients: &DVector<f64>) -> f64 {
    let (worst, largest) = windows
        .par_iter()
        .map(|window| {
            residuals(&window.equations[e], coefficients)
                .fold((0.0_f64, 0.0_f64), |(worst, largest), (predicted, residual)| {
                    (worst.max(residual.abs()), largest.max(predicted.abs()))
                })
        })
        .reduce(|| (0.0, 0.0), |a, b| (a.0.max(b.0), a.1.max(b.1)));
    if largest > 0.0 { worst / largest } else { f64::INFINITY }
}

/// Most dots of an equation's figure.
pub const MOST_DOTS: usize = 2000;

/// Rms residual at each frequency with given coefficients, and the dots of figure 3.14.
pub fn frequency_dots(
    windows: &[WindowRows],
    e: usize,
    coefficients: &DVector<f64>,
    frequencies: usize,
) -> (Vec<f64>, Vec<(usize, f64, f64)>) {
    (rms_by_frequency(windows, e, coefficients, frequencies), residual_dots(windows, e, coefficients))
}

/// Dots of figure 3.14: (frequency index, prediction, residual) of one equation, at most
/// [`MOST_DOTS`] of them by a fixed stride.
pub fn residual_dots(windows: &[WindowRows], e: usize, coefficients: &DVector<f64>) -> Vec<(usize, f64, f64)> {
    let each = row_count_of(windows, e, coefficients.len());
    let stride = (each * windows.len()).div_ceil(MOST_DOTS).max(1);
    let width = coefficients.len() + 1;
    (0..each * windows.len())
        .step_by(stride)
        .flat_map(|k| {
            let (window, row) = (k / each, k % each);
            let rows = &windows[window].equations[e][row * width..(row + 1) * width];
            residuals(rows, coefficients).map(move |(predicted, residual)| (frequency_of_row(row), predicted, residual))
        })
        .collect()
}

/// Rows of one window of an equation with `p` coefficients; all windows have as many.
fn row_count_of(windows: &[WindowRows], e: usize, p: usize) -> usize {
    windows.first().map_or(0, |w| w.equations[e].len() / (p + 1))
}

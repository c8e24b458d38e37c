//! Weighted least squares over the rows of many windows, with a covariance that holds for correlated residuals.
//!
//! *Weights.* The sensors' noise enters a row through ∫ ẅ φ and grows with frequency. Each frequency m is weighted by
//! 1/s_m², s_m² the mean square residual of its rows over all windows (two rounds, starting from equal weights).
//!
//! *Covariance.* Rows of one window share the same noise and neighbouring windows overlap, so residuals are taken as
//! independent only between blocks of consecutive windows. The covariance is the delete-one-block jackknife
//! C = (G−1)/G Σ_g (λ₍₋g₎ − λ)(λ₍₋g₎ − λ)ᵀ over all equations at once (Efron and Stein 1981; for clustered regression it is
//! the CR3 estimator of Bell and McCaffrey 2002, valid with few clusters). Standard errors are stretched by
//! t₀.₉₇₅(G−1)/1.96, so that ± 1.96 of them is a 95 % interval.
//!
//! *Repeating records.* On a periodic orbit the quantisation error repeats from window to window and does not average out.
//! The greatest mean correlation ρ of weighted residuals between windows that do not overlap measures it. Where ρ > 0.2,
//! ρ times the covariance that a single window would give is added (and what [`super::noise_bias`] finds), C₁ = (N/n)⁻¹ · 2.63, N the normal matrix over n windows and
//! 2.63 = Σ corr² of sin⁴ rows at neighbouring frequencies.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::windows::{WindowRows, frequency_of_row, row_count};

/// Σ corr² over the rows of one window: sin⁴ rows at neighbouring frequencies are not independent.
const ROW_DEPENDENCE: f64 = 2.63;
/// Correlation of residuals between windows from which a record counts as repeating.
const REPEATING: f64 = 0.2;
/// Least eigenvalue (pivot) of normal equations, relative to the greatest, below which columns depend on each other.
const DEPENDENT: f64 = 1e-13;
/// Fewest blocks for a jackknife.
const FEWEST_BLOCKS: usize = 6;

/// Solution of all equations.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Coefficients, equation by equation.
    pub coefficients: Vec<DVector<f64>>,
    /// Joint covariance over the concatenated coefficients.
    pub covariance: DMatrix<f64>,
    /// Covariance that independent residuals with the weights' variances would give: less true than `covariance` but free of its
    /// scatter, so the better metric for combining coefficients.
    pub metric: DMatrix<f64>,
    /// Weighted, column-scaled condition number of each equation's normal matrix (square root of the ratio of eigenvalues).
    pub condition: Vec<f64>,
    /// ε = ‖e‖∞/‖q̂‖∞ of each equation.
    pub error: Vec<f64>,
    /// Rms residual at each frequency, equation by equation.
    pub residual_rms: Vec<Vec<f64>>,
    /// Greatest mean correlation of residuals between windows that do not overlap.
    pub repetition: f64,
    /// Whether that correlation marks the record as repeating.
    pub repeating: bool,
    /// Blocks of the jackknife (0: too few windows, rows taken as independent).
    pub blocks: usize,
    /// Weight of each frequency, equation by equation.
    pub weights: Vec<Vec<f64>>,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsolvable {
    /// A column (equation, column) vanishes or depends on the others.
    Dependent {
        /// Equation.
        equation: usize,
        /// Column with the largest share in the dependence.
        column: usize,
    },
    /// A row is not a finite number.
    NotFinite,
}

struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

/// Columns, the target among them, that one product of eight by eight holds.
const FEW: usize = 8;

/// Σ w x xᵀ over rows x of at most [`FEW`] entries.
struct FewColumns<'a> {
    rows: &'a [f64],
    weights: &'a [f64],
    width: usize,
}

impl NullaryFnOnce for FewColumns<'_> {
    type Output = [[f64; FEW]; FEW];

    #[inline(always)]
    fn call(self) -> Self::Output {
        let mut sums = [[0.0; FEW]; FEW];
        let mut row = [0.0; FEW];
        for (r, from) in self.rows.chunks_exact(self.width).enumerate() {
            row.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
            let w = self.weights[frequency_of_row(r)];
            for i in 0..FEW {
                let wi = w * row[i];
                for j in 0..FEW {
                    sums[i][j] += wi * row[j];
                }
            }
        }
        sums
    }
}

impl Normal {
    fn zeros(p: usize) -> Self {
        Self { matrix: DMatrix::zeros(p, p), right: DVector::zeros(p) }
    }

    /// Adds the weighted rows of a window, to the upper triangle only.
    fn add(&mut self, rows: &[f64], weights: &[f64]) {
        let p = self.right.len();
        if p < FEW {
            let sums = Arch::new().dispatch(FewColumns { rows, weights, width: p + 1 });
            for j in 0..p {
                (0..=j).for_each(|i| self.matrix[(i, j)] += sums[i][j]);
                self.right[j] += sums[j][p];
            }
            return;
        }
        let (matrix, right) = (self.matrix.as_mut_slice(), self.right.as_mut_slice());
        for (r, row) in rows.chunks_exact(p + 1).enumerate() {
            let w = weights[frequency_of_row(r)];
            for i in 0..p {
                let wi = w * row[i];
                let column = &mut matrix[i * p..i * p + i + 1];
                column.iter_mut().zip(row).for_each(|(m, x)| *m += wi * x);
                right[i] += wi * row[p];
            }
        }
    }

    fn complete(mut self) -> Self {
        self.matrix.fill_lower_triangle_with_upper_triangle();
        self
    }

    fn sum<'a>(parts: impl Iterator<Item = &'a Self>, p: usize) -> Self {
        parts.fold(Self::zeros(p), |mut total, part| {
            total.matrix += &part.matrix;
            total.right += &part.right;
            total
        })
    }

    /// One over the roots of the diagonal, by which the matrix is scaled to unit diagonal; the column that vanishes, if one does.
    fn scale(&self) -> Result<DVector<f64>, usize> {
        let diagonal = self.matrix.diagonal();
        match diagonal.iter().position(|d| d.is_nan() || *d <= 0.0) {
            Some(column) => Err(column),
            None => Ok(diagonal.map(|d| 1.0 / d.sqrt())),
        }
    }

    /// The solution alone, by Cholesky's factors, several times faster than [`Normal::solve`]; none where the columns depend on each other.
    fn solution(&self) -> Option<DVector<f64>> {
        let p = self.right.len();
        let scale = self.scale().ok()?;
        let factors = DMatrix::from_fn(p, p, |i, j| self.matrix[(i, j)] * scale[i] * scale[j]).cholesky()?;
        // The square of a factor's diagonal is what a column has beside those before it.
        if factors.l_dirty().diagonal().iter().any(|d| d.is_nan() || d * d <= DEPENDENT) {
            return None;
        }
        Some(factors.solve(&self.right.component_mul(&scale)).component_mul(&scale))
    }

    /// Solution and condition number; the matrix is scaled to unit diagonal first.
    fn solve(&self) -> Result<(DVector<f64>, DMatrix<f64>, f64), usize> {
        let p = self.right.len();
        let scale = self.scale()?;
        let scaled = DMatrix::from_fn(p, p, |i, j| self.matrix[(i, j)] * scale[i] * scale[j]);
        let eigen = SymmetricEigen::new(scaled);
        let (least, greatest) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        if least.is_nan() || least <= DEPENDENT * greatest {
            let k = eigen.eigenvalues.imin();
            return Err(eigen.eigenvectors.column(k).iamax());
        }
        let inverse_eigen = DMatrix::from_diagonal(&eigen.eigenvalues.map(|x| 1.0 / x));
        let inverse = &eigen.eigenvectors * inverse_eigen * eigen.eigenvectors.transpose();
        let inverse = DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
        let solution = &inverse * &self.right;
        Ok((solution, inverse, (greatest / least).sqrt()))
    }
}

/// Residuals of one window's rows.
fn residuals(rows: &[f64], coefficients: &DVector<f64>) -> impl Iterator<Item = (f64, f64)> {
    let p = coefficients.len();
    rows.chunks_exact(p + 1).map(move |row| {
        let predicted: f64 = row[..p].iter().zip(coefficients.iter()).map(|(a, b)| a * b).sum();
        (predicted, row[p] - predicted)
    })
}

/// Solves all equations; `terms[e]` is the number of coefficients of equation e.
///
/// # Errors
/// Where a column vanishes or depends on others, or a row is not finite.
pub fn solve(windows: &[WindowRows], terms: &[usize], frequencies: usize) -> Result<Solution, Unsolvable> {
    solve_with(windows, terms, frequencies, &Options::default())
}

/// Departures from the defaults of [`solve`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// Weights of each equation and frequency, instead of those from the residuals; empty for an equation that has none.
    pub weights: Option<&'a [Vec<f64>]>,
    /// Windows that a block of the jackknife spans at least (a twelfth of all at most).
    pub block: usize,
}

/// As [`solve`], with weights given beforehand or longer blocks.
///
/// # Errors
/// As [`solve`].
pub fn solve_with(
    windows: &[WindowRows],
    terms: &[usize],
    frequencies: usize,
    options: &Options<'_>,
) -> Result<Solution, Unsolvable> {
    if windows.iter().any(|w| w.equations.iter().flatten().any(|x| !x.is_finite())) {
        return Err(Unsolvable::NotFinite);
    }
    let n = windows.len();
    let block_len = 2.max(n.div_ceil(200)).max(options.block.min(n / 12));
    let blocks: Vec<&[WindowRows]> = windows.chunks(block_len).collect();
    let total: usize = terms.iter().sum();
    let mut coefficients = Vec::new();
    let mut condition = Vec::new();
    let mut error = Vec::new();
    let mut residual_rms = Vec::new();
    let mut weights_of = Vec::new();
    let mut single = DMatrix::zeros(total, total);
    let mut left_out: Vec<DVector<f64>> = vec![DVector::zeros(total); blocks.len()];
    let mut offset = 0;
    for (e, &p) in terms.iter().enumerate() {
        let dependent = |column| Unsolvable::Dependent { equation: e, column };
        let given = options.weights.and_then(|w| w.get(e)).filter(|w| w.len() == frequencies + 1);
        let mut weights = given.cloned().unwrap_or_else(|| vec![1.0; frequencies + 1]);
        let mut rms = vec![0.0; frequencies + 1];
        for round in 0..3 {
            let parts: Vec<Normal> = blocks
                .par_iter()
                .map(|block| {
                    let mut part = Normal::zeros(p);
                    block.iter().for_each(|w| part.add(&w.equations[e], &weights));
                    part.complete()
                })
                .collect();
            let whole = Normal::sum(parts.iter(), p);
            let (solution, inverse, kappa) = whole.solve().map_err(dependent)?;
            if round == 2 {
                parts.par_iter().zip(&mut left_out).for_each(|(part, left_out)| {
                    let rest = Normal { matrix: &whole.matrix - &part.matrix, right: &whole.right - &part.right };
                    // A block without which nothing can be solved says nothing about the spread.
                    let without = if blocks.len() > 1 { rest.solution() } else { None };
                    let change = without.map_or_else(|| DVector::zeros(p), |x| x - &solution);
                    left_out.rows_mut(offset, p).copy_from(&change);
                });
                single.view_mut((offset, offset), (p, p)).copy_from(&(inverse * (n as f64 * ROW_DEPENDENCE)));
                error.push(identification_error(windows, e, &solution));
                coefficients.push(solution);
                condition.push(kappa);
            } else {
                rms = rms_by_frequency(windows, e, &solution, frequencies);
                let level = rms.iter().fold(0.0_f64, |m, x| m.max(*x));
                if given.is_none() {
                    weights = rms.iter().map(|s| 1.0 / s.max(1e-9 * level).max(f64::MIN_POSITIVE).powi(2)).collect();
                }
            }
        }
        residual_rms.push(rms);
        weights_of.push(weights);
        offset += p;
    }
    let repetition = repetition(windows, &coefficients, &weights_of, options.block.max(2));
    let repeating = repetition > REPEATING;
    let g = blocks.len();
    let mut covariance = if g >= FEWEST_BLOCKS {
        let freedom = (g - 1) as f64;
        let stretch = StudentsT::new(0.0, 1.0, freedom).map_or(1.0, |t| t.inverse_cdf(0.975) / 1.959_964);
        let sum = left_out.iter().fold(DMatrix::zeros(total, total), |sum, d| sum + d * d.transpose());
        sum * (freedom / g as f64 * stretch * stretch)
    } else {
        &single / n as f64
    };
    if repeating {
        covariance += &single * repetition;
    }
    let blocks = if g >= FEWEST_BLOCKS { g } else { 0 };
    Ok(Solution {
        coefficients,
        covariance,
        metric: &single / n as f64,
        condition,
        error,
        residual_rms,
        repetition,
        repeating,
        blocks,
        weights: weights_of,
    })
}

/// Coefficients of all equations for given weights, without a covariance.
///
/// # Errors
/// As [`solve`].
pub fn solve_weighted<'a>(
    windows: impl Iterator<Item = &'a WindowRows> + Clone,
    terms: &[usize],
    weights: &[Vec<f64>],
) -> Result<Vec<DVector<f64>>, Unsolvable> {
    terms
        .iter()
        .enumerate()
        .map(|(e, &p)| {
            let mut normal = Normal::zeros(p);
            windows.clone().for_each(|w| normal.add(&w.equations[e], &weights[e]));
            normal.complete().solve().map(|s| s.0).map_err(|column| Unsolvable::Dependent { equation: e, column })
        })
        .collect()
}

/// Normal equations of windows that belong to runs, so that runs can be left out of a solution.
pub(crate) struct RunSums {
    /// Run by run, equation by equation.
    runs: Vec<Vec<Normal>>,
}

impl RunSums {
    /// Sums over each of `runs` runs (a window's `run` says which it is in) with given weights.
    pub(crate) fn new(windows: &[WindowRows], runs: usize, terms: &[usize], weights: &[Vec<f64>]) -> Self {
        let mut sums: Vec<Vec<Normal>> = (0..runs).map(|_| terms.iter().map(|p| Normal::zeros(*p)).collect()).collect();
        for window in windows {
            if let Some(sums) = sums.get_mut(window.run) {
                sums.iter_mut().enumerate().for_each(|(e, sum)| sum.add(&window.equations[e], &weights[e]));
            }
        }
        Self { runs: sums.into_iter().map(|run| run.into_iter().map(Normal::complete).collect()).collect() }
    }

    /// Coefficients of all equations, concatenated, from all runs but one (or from all). None where the rest does not determine them.
    pub(crate) fn solve(&self, without: Option<usize>) -> Option<DVector<f64>> {
        let equations = self.runs.first()?.len();
        let mut out = Vec::new();
        for e in 0..equations {
            let kept = self.runs.iter().enumerate().filter(|(g, _)| Some(*g) != without).map(|(_, run)| &run[e]);
            let p = self.runs[0][e].right.len();
            out.extend(Normal::sum(kept, p).solution()?.iter());
        }
        Some(DVector::from_vec(out))
    }
}

/// Root of the mean weighted square residual of a row, all equations together; `coefficients` of all equations, concatenated.
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

/// Root of the mean weighted square of what the rows of `measured` motions leave beside those of the motions as they are, and the ε of each
/// equation that this gives. Rows are in the same order in all; `coefficients` of all equations, concatenated.
pub(crate) fn noise_alone(
    plain: &[WindowRows],
    measured: &[Vec<WindowRows>],
    terms: &[usize],
    weights: &[Vec<f64>],
    coefficients: &DVector<f64>,
) -> (f64, Vec<f64>) {
    let (mut sum, mut count, mut from) = (0.0, 0_usize, 0);
    let mut errors = Vec::with_capacity(terms.len());
    for (e, &p) in terms.iter().enumerate() {
        let own = coefficients.rows(from, p).into_owned();
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for (was, window) in measured.iter().flat_map(|rows| plain.iter().zip(rows)) {
            let pairs = residuals(&was.equations[e], &own).zip(residuals(&window.equations[e], &own));
            for (r, ((_, before), (predicted, after))) in pairs.enumerate() {
                let left = after - before;
                sum += weights[e][frequency_of_row(r)] * left * left;
                count += 1;
                (worst, largest) = (worst.max(left.abs()), largest.max(predicted.abs()));
            }
        }
        errors.push(if largest > 0.0 { worst / largest } else { 0.0 });
        from += p;
    }
    ((sum / count.max(1) as f64).sqrt(), errors)
}

/// Rms residual at each frequency, pooled with its two neighbours on either side so that few windows suffice.
fn rms_by_frequency(windows: &[WindowRows], e: usize, solution: &DVector<f64>, frequencies: usize) -> Vec<f64> {
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

/// Greatest mean correlation, over 31 lags from `least` windows on (2 by default), of weighted residuals.
fn repetition(windows: &[WindowRows], coefficients: &[DVector<f64>], weights: &[Vec<f64>], least: usize) -> f64 {
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

/// Rows that a solution used.
pub fn rows_used(windows: &[WindowRows], equations: usize, frequencies: usize) -> usize {
    windows.len() * equations * row_count(frequencies)
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

/// Rms residual at each frequency with given coefficients, and the dots of figure 3.14.
pub fn frequency_dots(
    windows: &[WindowRows],
    e: usize,
    coefficients: &DVector<f64>,
    frequencies: usize,
    most: usize,
) -> (Vec<f64>, Vec<(usize, f64, f64)>) {
    (rms_by_frequency(windows, e, coefficients, frequencies), residual_dots(windows, e, coefficients, most))
}

/// Dots of figure 3.14: (frequency index, prediction, residual) of one equation, at most `most` of them by a fixed stride.
pub fn residual_dots(
    windows: &[WindowRows],
    e: usize,
    coefficients: &DVector<f64>,
    most: usize,
) -> Vec<(usize, f64, f64)> {
    let each = row_count_of(windows, e, coefficients.len());
    let stride = (each * windows.len()).div_ceil(most.max(1)).max(1);
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Windows of random columns whose target has noise that grows with frequency and is shared inside a window.
    fn windows(seed: u64, n: usize, frequencies: usize, truth: &[f64]) -> Vec<WindowRows> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let p = truth.len();
        (0..n)
            .map(|index| {
                let shared: f64 = rng.random_range(-1.0..1.0);
                let mut rows = Vec::new();
                for r in 0..row_count(frequencies) {
                    let columns: Vec<f64> = (0..p).map(|_| rng.random_range(-1.0..1.0)).collect();
                    let noise = rng.random_range(-1.0..1.0) + shared;
                    let clean: f64 = columns.iter().zip(truth).map(|(a, b)| a * b).sum();
                    rows.extend(&columns);
                    rows.push(clean + noise * 0.01 * (1.0 + frequency_of_row(r) as f64));
                }
                WindowRows { start_s: index as f64, index, run: 0, equations: vec![rows] }
            })
            .collect()
    }

    #[test]
    fn intervals_cover_the_truth_though_rows_share_their_noise() {
        let truth = [1.0, -2.0, 0.5];
        let (mut inside, mut count) = (0, 0);
        for seed in 0..300 {
            let s = solve(&windows(seed, 40, 10, &truth), &[3], 10).unwrap();
            for (i, t) in truth.iter().enumerate() {
                count += 1;
                inside += usize::from((s.coefficients[0][i] - t).abs() < 1.96 * s.covariance[(i, i)].sqrt());
            }
        }
        let share = f64::from(inside as u32) / f64::from(count);
        assert!((0.92..=0.99).contains(&share), "{share}");
    }

    #[test]
    fn a_column_of_zeros_is_named() {
        let mut w = windows(1, 20, 4, &[1.0, 2.0]);
        for window in &mut w {
            window.equations[0].chunks_exact_mut(3).for_each(|row| row[1] = 0.0);
        }
        assert_eq!(solve(&w, &[2], 4).unwrap_err(), Unsolvable::Dependent { equation: 0, column: 1 });
    }

    #[test]
    fn windows_that_repeat_are_recognised_and_widen_the_interval() {
        let one = windows(1, 1, 10, &[1.0, 2.0]).remove(0);
        let repeated: Vec<WindowRows> = (0..40).map(|index| WindowRows { index, ..one.clone() }).collect();
        let s = solve(&repeated, &[2], 10).unwrap();
        assert!(s.repeating && s.repetition > 0.99);
        let alone = solve(&windows(3, 40, 10, &[1.0, 2.0]), &[2], 10).unwrap();
        assert!(!alone.repeating, "{}", alone.repetition);
        assert!(s.covariance[(0, 0)] > 5.0 * alone.covariance[(0, 0)]);
    }
}

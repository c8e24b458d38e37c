//! XᵀX for tall X, and a product of two matrices, at the speed of the processor, the same to the
//! last digit on any number of threads.
//!
//! The product is cut into fixed tasks: pairs of blocks of columns (the lower triangle only,
//! mirrored afterwards), and, where there are few of these, stretches of rows, whose parts are
//! summed in their order. Threads only choose who does a task. Each is one of faer's products,
//! which uses the widest vector instructions that the processor has, found at run time; nalgebra's,
//! through matrixmultiply, stops at 256 bits and cannot leave out half of a symmetric result.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Columns in a block.
const COLUMNS: usize = 256;
/// Least number of tasks, as long as each has [`ROWS`].
const TASKS: usize = 16;
/// Least number of rows in a stretch.
const ROWS: usize = 1024;

/// XᵀX (n × n) of X (m × n).
pub fn gram(x: &DMatrix<f64>) -> DMatrix<f64> {
    let (m, n) = x.shape();
    let starts: Vec<usize> = (0..n).step_by(COLUMNS).collect();
    let pairs: Vec<(usize, usize)> =
        starts.iter().flat_map(|&i| starts.iter().filter(move |&&j| j <= i).map(move |&j| (i, j))).collect();
    let stretches = TASKS.div_ceil(pairs.len().max(1)).min(m / ROWS).max(1);
    let cut = |k: usize| k * m / stretches;
    let tasks: Vec<(usize, usize, usize)> =
        pairs.iter().flat_map(|&(i, j)| (0..stretches).map(move |k| (i, j, k))).collect();
    let whole = view(x);
    let parts: Vec<DMatrix<f64>> = tasks
        .par_iter()
        .map(|&(i, j, k)| {
            let of = |c: usize| whole.subrows(cut(k), cut(k + 1) - cut(k)).subcols(c, COLUMNS.min(n - c));
            if i == j { square(of(i)) } else { mixed(of(i), of(j)) }
        })
        .collect();
    let mut out = DMatrix::zeros(n, n);
    for (&(i, j, _), part) in tasks.iter().zip(&parts) {
        let mut block = out.view_mut((i, j), part.shape());
        block += part;
    }
    mirrored(out)
}

/// Most columns that [`gram_of`] takes.
pub const FEW: usize = COLUMNS;

/// XᵀX of a matrix of m rows and at most [`FEW`] columns that is made while it is multiplied:
/// `fill(column, first row, to)` writes rows of a column. It is never there as a whole, so that a
/// record is centred within the nearest caches.
pub fn gram_of(m: usize, n: usize, fill: impl Fn(usize, usize, &mut [f64]) + Sync) -> DMatrix<f64> {
    // As many stretches as make threads busy, whatever m; each is made and multiplied some rows at
    // a time, in one room.
    let stretches = TASKS.min(m.div_ceil(ROWS));
    let parts: Vec<DMatrix<f64>> = (0..stretches)
        .into_par_iter()
        .map(|k| {
            let (start, end) = (k * m / stretches, (k + 1) * m / stretches);
            let most = (end - start).div_ceil((end - start).div_ceil(ROWS));
            let mut room = vec![0.0; most * n];
            let mut sum = DMatrix::zeros(n, n);
            for first in (start..end).step_by(most) {
                let rows = most.min(end - first);
                let piece = &mut room[..rows * n];
                piece.chunks_exact_mut(rows).enumerate().for_each(|(column, to)| fill(column, first, to));
                sum += square(MatRef::from_column_major_slice(piece, rows, n));
            }
            sum
        })
        .collect();
    mirrored(parts.iter().fold(DMatrix::zeros(n, n), |sum, part| sum + part))
}

/// The lower triangle of XᵀX.
fn square(x: MatRef<'_, f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(x.ncols(), x.ncols());
    triangular::matmul(
        view_mut(&mut out),
        BlockStructure::TriangularLower,
        Accum::Replace,
        x.transpose(),
        BlockStructure::Rectangular,
        x,
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
    out
}

/// XᵀY.
fn mixed(x: MatRef<'_, f64>, y: MatRef<'_, f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(x.ncols(), y.ncols());
    matmul(view_mut(&mut out), Accum::Replace, x.transpose(), y, 1.0, Par::Seq);
    out
}

/// A symmetric matrix from its lower triangle.
fn mirrored(mut out: DMatrix<f64>) -> DMatrix<f64> {
    out.fill_upper_triangle_with_lower_triangle();
    out
}

/// A B, by blocks of B's columns.
pub fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(a.nrows(), b.ncols());
    if out.is_empty() {
        return out;
    }
    let (left, right) = (view(a), view(b));
    let rows = a.nrows();
    out.as_mut_slice().par_chunks_mut(rows * COLUMNS).enumerate().for_each(|(k, part)| {
        let columns = part.len() / rows;
        let to = MatMut::from_column_major_slice_mut(part, rows, columns);
        matmul(to, Accum::Replace, left, right.subcols(k * COLUMNS, columns), 1.0, Par::Seq);
    });
    out
}

/// A matrix as faer sees it.
pub(super) fn view(x: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(x.as_slice(), x.nrows(), x.ncols())
}

fn view_mut(x: &mut DMatrix<f64>) -> MatMut<'_, f64> {
    let (rows, columns) = x.shape();
    MatMut::from_column_major_slice_mut(x.as_mut_slice(), rows, columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_make_the_whole_product() {
        // Several blocks of columns; few columns and several stretches of rows; fewer rows than
        // columns; nothing.
        for (m, n) in [(90, 600), (5000, 7), (3, 40), (0, 4), (4, 0)] {
            let x = DMatrix::from_fn(m, n, |i, j| ((i * 31 + j * 17) % 23) as f64 - 11.0);
            assert!((gram(&x) - x.tr_mul(&x)).iter().all(|d| d.abs() < 1e-9), "{m} × {n}");
            let b = DMatrix::from_fn(n, 300, |i, j| ((i * 7 + j * 13) % 19) as f64 - 9.0);
            assert!((product(&x, &b) - &x * &b).iter().all(|d| d.abs() < 1e-9), "{m} × {n}");
        }
    }

    #[test]
    fn a_matrix_made_piece_by_piece_has_the_same_product() {
        for (m, n) in [(50_001, 7), (5000, 7), (1024, 3), (1, 2), (0, 4), (9, 0)] {
            let x = DMatrix::from_fn(m, n, |i, j| ((i * 31 + j * 17) % 23) as f64 - 11.0);
            let found = gram_of(m, n, |column, first, to| {
                to.copy_from_slice(&x.column(column).as_slice()[first..first + to.len()]);
            });
            assert!((found - x.tr_mul(&x)).iter().all(|d| d.abs() < 1e-9), "{m} × {n}");
        }
    }

    #[test]
    fn the_number_of_threads_changes_no_digit() {
        let x = DMatrix::from_fn(9000, 30, |i, j| ((i * (j + 3)) as f64 * 0.37).sin());
        let on =
            |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| gram(&x));
        assert_eq!(on(1), on(3));
    }
}

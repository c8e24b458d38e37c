//! Normal equations N λ = r with N = Σ w x xᵀ and r = Σ w x y over weighted rows (x, y): summed,
//! scaled to a unit diagonal, solved.
//!
//! N is solved by its eigenvalues, which tell the condition number and the column with the largest
//! part in a dependence, or, where only the solution is wanted, by Cholesky's factors. Units are
//! those of the rows.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use pulp::{Arch, NullaryFnOnce};

use crate::identify::windows::frequency_of_row;

/// Least eigenvalue (pivot) of normal equations, relative to the greatest, below which columns
/// depend on each other.
const DEPENDENT: f64 = 1e-13;
/// Columns, the target among them, that one product of eight by eight holds.
const FEW: usize = 8;

pub(super) struct Normal {
    pub(super) matrix: DMatrix<f64>,
    pub(super) right: DVector<f64>,
}

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
    pub(super) fn zeros(p: usize) -> Self {
        Self { matrix: DMatrix::zeros(p, p), right: DVector::zeros(p) }
    }

    /// Adds the weighted rows of a window, to the upper triangle only.
    pub(super) fn add(&mut self, rows: &[f64], weights: &[f64]) {
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

    pub(super) fn complete(mut self) -> Self {
        self.matrix.fill_lower_triangle_with_upper_triangle();
        self
    }

    pub(super) fn sum<'a>(parts: impl Iterator<Item = &'a Self>, p: usize) -> Self {
        parts.fold(Self::zeros(p), |mut total, part| {
            total.matrix += &part.matrix;
            total.right += &part.right;
            total
        })
    }

    /// One over the roots of the diagonal, by which the matrix is scaled to unit diagonal; the
    /// column that vanishes, if one does.
    fn scale(&self) -> Result<DVector<f64>, usize> {
        let diagonal = self.matrix.diagonal();
        match diagonal.iter().position(|d| d.is_nan() || *d <= 0.0) {
            Some(column) => Err(column),
            None => Ok(diagonal.map(|d| 1.0 / d.sqrt())),
        }
    }

    /// The solution alone, by Cholesky's factors, several times faster than [`Normal::solve`]; none
    /// where the columns depend on each other.
    pub(super) fn solution(&self) -> Option<DVector<f64>> {
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
    pub(super) fn solve(&self) -> Result<(DVector<f64>, DMatrix<f64>, f64), usize> {
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

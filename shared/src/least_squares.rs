//! Recursive least squares in square-root form, of fixed size, with forgetting, on nalgebra.
//!
//! For rows a·x ≈ b the upper triangle R and the vector z with RᵀR = Σ γ aᵀa, Rᵀz = Σ γ aᵀb are
//! kept, and the sum of squares ρ² of the residuals. A row is rotated in by P Givens rotations;
//! forgetting by λ multiplies R, z and ρ by √λ. The normal matrix is never formed: what `f32` can
//! hold of a condition number is not halved. Solution by back substitution; covariance s² R⁻¹R⁻ᵀ.
//!
//! The condition that is told is that of the triangle with its columns scaled to unit length, in
//! the Frobenius norm, over P: κ = ‖R̂‖‖R̂⁻¹‖/P = √(Σ vᵢ/P), vᵢ the variance inflation of unknown
//! i. It is 1 where the columns are orthogonal, and the 2-norm's condition number lies between κ
//! and P κ.
//!
//! (Golub and Van Loan, *Matrix Computations*, 5.1.8 and 6.5.) No allocation; P(P + 3)/2 rotations'
//! worth of arithmetic a row. Products of whole matrices are not used: for these nalgebra takes
//! other instructions on a host than on a device, and the results are to have the same bits.

use nalgebra::linalg::givens::GivensRotation;
use nalgebra::{ArrayStorage, RealField, SMatrix, SVector, Vector2, convert};

/// An estimate with its standard errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate<T, const P: usize> {
    /// Unknowns.
    pub values: [T; P],
    /// Standard errors, for residuals that are independent.
    pub std_errors: [T; P],
    /// rms of the residuals, in units of the rows.
    pub residual_rms: T,
    /// κ, 1 or more.
    pub condition: T,
}

/// Why there is no estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoEstimate {
    /// Fewer rows than unknowns, and one.
    TooFewRows,
    /// An unknown that the rows do not determine, by its index.
    NotIdentifiable(usize),
    /// The motion repeats itself: new rows say what earlier ones said. (Not found here, but by who
    /// makes the rows.)
    Repeating,
}

/// Rows seen so far.
#[derive(Clone, Debug)]
pub struct LeastSquares<T: RealField + Copy, const P: usize> {
    r: SMatrix<T, P, P>,
    z: SVector<T, P>,
    /// ρ².
    residual: T,
    /// Σ of the columns' squares, against which a pivot is judged.
    scale: SVector<T, P>,
    /// Σ γ: what is left of the number of rows.
    weight: T,
}

impl<T: RealField + Copy, const P: usize> Default for LeastSquares<T, P> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: RealField + Copy, const P: usize> LeastSquares<T, P> {
    /// No rows.
    #[must_use]
    pub fn new() -> Self {
        Self::of_zero(T::zero())
    }

    /// No rows, for constants, which cannot ask for the type's zero.
    #[must_use]
    pub const fn of_zero(zero: T) -> Self {
        let vector = SVector::from_array_storage(ArrayStorage([[zero; P]]));
        let r = SMatrix::from_array_storage(ArrayStorage([[zero; P]; P]));
        Self { r, z: vector, residual: zero, scale: vector, weight: zero }
    }

    /// Takes a row. Rows with a number that is not finite are left out.
    pub fn push(&mut self, row: [T; P], target: T) {
        if !target.is_finite() || row.iter().any(|x| !x.is_finite()) {
            return;
        }
        self.scale.iter_mut().zip(row).for_each(|(scale, x)| *scale += x * x);
        self.weight += T::one();
        // The triangle's row on top, the new row below, and beside them their right-hand sides.
        let mut pair = SMatrix::<T, 2, P>::zeros();
        pair.row_mut(1).copy_from_slice(&row);
        let mut right = Vector2::new(T::zero(), target);
        for i in 0..P {
            let Some((rotation, length)) = GivensRotation::cancel_y(&Vector2::new(self.r[(i, i)], pair[(1, i)])) else {
                continue;
            };
            self.r[(i, i)] = length;
            for j in i + 1..P {
                pair[(0, j)] = self.r[(i, j)];
            }
            rotation.rotate(&mut pair.columns_mut(i + 1, P - i - 1));
            for j in i + 1..P {
                self.r[(i, j)] = pair[(0, j)];
            }
            right.x = self.z[i];
            rotation.rotate(&mut right);
            self.z[i] = right.x;
        }
        self.residual += right.y * right.y;
    }

    /// Everything seen so far counts λ times as much; λ is held to [0, 1].
    pub fn forget(&mut self, lambda: T) {
        let lambda = lambda.max(T::zero()).min(T::one());
        let root = lambda.sqrt();
        self.r *= root;
        self.z *= root;
        self.scale *= lambda;
        self.residual *= lambda;
        self.weight *= lambda;
    }

    /// Rows, each counted by what is left of it.
    #[must_use]
    pub fn rows(&self) -> T {
        self.weight
    }

    /// The estimate. An unknown is not identifiable where what is left of its column, once the
    /// columns before it are taken out, is below `tolerance` times the column (1e-3 is fit for
    /// `f32`).
    ///
    /// # Errors
    /// [`NoEstimate`].
    pub fn solve(&self, tolerance: T) -> Result<Estimate<T, P>, NoEstimate> {
        let unknowns: T = convert(P as f64);
        let freedom = self.weight - unknowns;
        if freedom < T::one() {
            return Err(NoEstimate::TooFewRows);
        }
        // Also where it is not a number.
        let kept = |i: usize| self.r[(i, i)].abs() > tolerance * self.scale[i].sqrt();
        if let Some(i) = (0..P).find(|&i| !kept(i)) {
            return Err(NoEstimate::NotIdentifiable(i));
        }
        let mut inverse = SMatrix::<T, P, P>::identity();
        let mut values = self.z;
        // No pivot is zero.
        if !self.r.solve_upper_triangular_mut(&mut inverse) || !self.r.solve_upper_triangular_mut(&mut values) {
            return Err(NoEstimate::NotIdentifiable(0));
        }
        // Variances are s² times the sums of squares of the inverse's rows.
        let mut squares = SVector::<T, P>::zeros();
        for column in 0..P {
            for row in 0..=column {
                squares[row] += inverse[(row, column)] * inverse[(row, column)];
            }
        }
        let variance = self.residual / freedom;
        let inflation = squares.iter().zip(self.scale.iter()).fold(T::zero(), |sum, (s, scale)| sum + *s * *scale);
        Ok(Estimate {
            values: values.into(),
            std_errors: squares.map(|s| (s * variance).sqrt()).into(),
            residual_rms: (self.residual / self.weight).sqrt(),
            condition: (inflation / unknowns).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    const TRUTH: [f64; 4] = [1.5, -0.25, 0.003, 40.0];

    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| f64::from(rng.next_u32()) / 4_294_967_296.0).sum::<f64>() - 6.0
    }

    fn row(rng: &mut ChaCha8Rng, noise: f64) -> ([f64; 4], f64) {
        let common = normal(rng);
        // Two nearly parallel columns, one small one.
        let row = [common, common + 0.05 * normal(rng), 30.0 * normal(rng), 0.01 * normal(rng)];
        let target = row.iter().zip(TRUTH).map(|(a, x)| a * x).sum::<f64>() + noise * normal(rng);
        (row, target)
    }

    #[test]
    fn exact_rows_give_exact_unknowns_in_either_precision() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut wide, mut narrow) = (LeastSquares::<f64, 4>::new(), LeastSquares::<f32, 4>::new());
        for _ in 0..500 {
            let (row, target) = row(&mut rng, 0.0);
            wide.push(row, target);
            narrow.push(row.map(|x| x as f32), target as f32);
        }
        let (wide, narrow) = (wide.solve(1e-9).unwrap(), narrow.solve(1e-3).unwrap());
        for i in 0..4 {
            assert!((wide.values[i] / TRUTH[i] - 1.0).abs() < 1e-10, "{wide:?}");
            assert!((f64::from(narrow.values[i]) / TRUTH[i] - 1.0).abs() < 2e-3, "{narrow:?}");
        }
    }

    #[test]
    fn the_triangle_is_that_of_a_qr_decomposition() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut fit = LeastSquares::<f64, 4>::new();
        let mut all = nalgebra::SMatrix::<f64, 50, 4>::zeros();
        let mut targets = nalgebra::SVector::<f64, 50>::zeros();
        for i in 0..50 {
            let (row, target) = row(&mut rng, 0.3);
            fit.push(row, target);
            all.row_mut(i).copy_from_slice(&row);
            targets[i] = target;
        }
        let found = fit.solve(1e-9).unwrap();
        // Householder's R, but for the rows' signs.
        let r = all.qr().r();
        for (found, expected) in fit.r.iter().zip(r.iter()) {
            assert!((found.abs() - expected.abs()).abs() < 1e-11 * r.norm(), "{found} {expected}");
        }
        // Values, errors and condition from the normal equations.
        let inverse = (all.transpose() * all).try_inverse().unwrap();
        let values = inverse * all.transpose() * targets;
        let variance = (all * values - targets).norm_squared() / 46.0;
        let mut inflation = 0.0;
        for i in 0..4 {
            assert!((found.values[i] / values[i] - 1.0).abs() < 1e-8, "{found:?}");
            assert!((found.std_errors[i] / (variance * inverse[(i, i)]).sqrt() - 1.0).abs() < 1e-8, "{found:?}");
            inflation += inverse[(i, i)] * all.column(i).norm_squared();
        }
        assert!((found.condition / (inflation / 4.0).sqrt() - 1.0).abs() < 1e-8 && found.condition > 5.0, "{found:?}");
        // Orthogonal columns.
        let mut fit = LeastSquares::<f32, 2>::new();
        for n in 0..40_u8 {
            let x = if n % 2 == 0 { [3.0, 0.0] } else { [0.0, 0.01] };
            fit.push(x, 1.0);
        }
        assert!((fit.solve(1e-3).unwrap().condition - 1.0).abs() < 1e-6);
    }

    #[test]
    fn standard_errors_cover_the_truth() {
        let mut inside = [0; 4];
        for seed in 0..400 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut fit = LeastSquares::<f64, 4>::new();
            for _ in 0..60 {
                let (row, target) = row(&mut rng, 0.3);
                fit.push(row, target);
            }
            let fit = fit.solve(1e-9).unwrap();
            for i in 0..4 {
                inside[i] += usize::from((fit.values[i] - TRUTH[i]).abs() < 2.0 * fit.std_errors[i]);
            }
        }
        // 95 % of 400, within three standard deviations.
        assert!(inside.iter().all(|n| (367..=393).contains(n)), "{inside:?}");
    }

    #[test]
    fn forgetting_follows_a_change() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut fit = LeastSquares::<f64, 1>::new();
        for block in 0..40 {
            fit.forget(0.7);
            let truth = if block < 20 { 1.0 } else { 1.05 };
            for _ in 0..20 {
                let x = normal(&mut rng);
                fit.push([x], truth * x + 0.01 * normal(&mut rng));
            }
        }
        let estimate = fit.solve(1e-9).unwrap();
        assert!((estimate.values[0] - 1.05).abs() < 3.0 * estimate.std_errors[0] + 1e-3, "{estimate:?}");
        assert!((fit.rows() - 20.0 / 0.3).abs() < 1.0);
    }

    #[test]
    fn what_cannot_be_known_is_said() {
        let mut fit = LeastSquares::<f32, 2>::new();
        assert_eq!(fit.solve(1e-3).unwrap_err(), NoEstimate::TooFewRows);
        for n in 0..50_u8 {
            let x = f32::from(n);
            fit.push([x, 2.0 * x], 3.0 * x);
        }
        assert_eq!(fit.solve(1e-3).unwrap_err(), NoEstimate::NotIdentifiable(1));
        fit.push([f32::NAN, 0.0], 1.0);
        fit.push([1.0, 0.0], f32::INFINITY);
        assert_eq!(fit.rows(), 50.0);
        // A column of zeros.
        let mut fit = LeastSquares::<f32, 1>::new();
        (0..9).for_each(|_| fit.push([0.0], 1.0));
        assert_eq!(fit.solve(1e-3).unwrap_err(), NoEstimate::NotIdentifiable(0));
    }
}

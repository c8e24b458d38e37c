//! Recursive least squares in square-root form, of fixed size, with forgetting.
//!
//! For rows a·x ≈ b the upper triangle R and the vector z with RᵀR = Σ γ aᵀa, Rᵀz = Σ γ aᵀb are kept, and the sum of squares ρ² of
//! the residuals. A row is rotated in by P Givens rotations; forgetting by λ multiplies R, z and ρ by √λ. The normal matrix is never
//! formed: what `f32` can hold of a condition number is not halved. Solution by back substitution; covariance s² R⁻¹R⁻ᵀ.
//!
//! (Golub and Van Loan, *Matrix Computations*, 5.1.8 and 6.5.) Arrays of fixed size, no allocation; P(P + 3)/2 rotations' worth of
//! arithmetic a row.

use crate::real::Real;

/// An estimate with its standard errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate<T, const P: usize> {
    /// Unknowns.
    pub values: [T; P],
    /// Standard errors, for residuals that are independent.
    pub std_errors: [T; P],
    /// rms of the residuals, in units of the rows.
    pub residual_rms: T,
}

/// Why there is no estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoEstimate {
    /// Fewer rows than unknowns, and one.
    TooFewRows,
    /// An unknown that the rows do not determine, by its index.
    NotIdentifiable(usize),
    /// The motion repeats itself: new rows say what earlier ones said. (Not found here, but by who makes the rows.)
    Repeating,
}

/// Rows seen so far.
#[derive(Clone, Debug)]
pub struct LeastSquares<T: Real, const P: usize> {
    r: [[T; P]; P],
    z: [T; P],
    /// ρ².
    residual: T,
    /// Σ of the columns' squares, against which a pivot is judged.
    scale: [T; P],
    /// Σ γ: what is left of the number of rows.
    weight: T,
}

impl<T: Real, const P: usize> Default for LeastSquares<T, P> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const P: usize> LeastSquares<T, P> {
    /// No rows.
    #[must_use]
    pub fn new() -> Self {
        let zero = T::zero();
        Self { r: [[zero; P]; P], z: [zero; P], residual: zero, scale: [zero; P], weight: zero }
    }

    /// Takes a row. Rows with a number that is not finite are left out.
    pub fn push(&mut self, mut row: [T; P], mut target: T) {
        if !target.is_finite() || row.iter().any(|x| !x.is_finite()) {
            return;
        }
        for (scale, x) in self.scale.iter_mut().zip(row) {
            *scale = *scale + x * x;
        }
        self.weight = self.weight + T::one();
        for i in 0..P {
            if row[i] == T::zero() {
                continue;
            }
            // Not hypot: what that gives depends on the platform's library.
            let length = (self.r[i][i] * self.r[i][i] + row[i] * row[i]).sqrt();
            if length <= T::zero() {
                continue;
            }
            let (cos, sin) = (self.r[i][i] / length, row[i] / length);
            for j in i..P {
                let (above, below) = (self.r[i][j], row[j]);
                self.r[i][j] = cos * above + sin * below;
                row[j] = cos * below - sin * above;
            }
            let (above, below) = (self.z[i], target);
            self.z[i] = cos * above + sin * below;
            target = cos * below - sin * above;
        }
        self.residual = self.residual + target * target;
    }

    /// Everything seen so far counts λ times as much; λ is held to [0, 1].
    pub fn forget(&mut self, lambda: T) {
        let lambda = lambda.max(T::zero()).min(T::one());
        let root = lambda.sqrt();
        self.r.iter_mut().flatten().chain(&mut self.z).for_each(|x| *x = *x * root);
        self.scale.iter_mut().for_each(|x| *x = *x * lambda);
        self.residual = self.residual * lambda;
        self.weight = self.weight * lambda;
    }

    /// Rows, each counted by what is left of it.
    #[must_use]
    pub fn rows(&self) -> T {
        self.weight
    }

    /// The estimate. An unknown is not identifiable where what is left of its column, once the columns before it are taken out,
    /// is below `tolerance` times the column (1e-3 is fit for `f32`).
    ///
    /// # Errors
    /// [`NoEstimate`].
    pub fn solve(&self, tolerance: T) -> Result<Estimate<T, P>, NoEstimate> {
        let zero = T::zero();
        let freedom = self.weight - T::from_i64(P as i64);
        if freedom < T::one() {
            return Err(NoEstimate::TooFewRows);
        }
        let lost = |i: &usize| self.r[*i][*i].is_nan() || self.r[*i][*i].abs() <= tolerance * self.scale[*i].sqrt();
        if let Some(i) = (0..P).find(lost) {
            return Err(NoEstimate::NotIdentifiable(i));
        }
        let mut values = [zero; P];
        for i in (0..P).rev() {
            let known = (i + 1..P).fold(zero, |sum, j| sum + self.r[i][j] * values[j]);
            values[i] = (self.z[i] - known) / self.r[i][i];
        }
        // R⁻¹, column by column: variances are the sums of squares of its rows.
        let mut squares = [zero; P];
        for column in 0..P {
            let mut x = [zero; P];
            for i in (0..=column).rev() {
                let one = if i == column { T::one() } else { zero };
                let known = (i + 1..=column).fold(zero, |sum, j| sum + self.r[i][j] * x[j]);
                x[i] = (one - known) / self.r[i][i];
                squares[i] = squares[i] + x[i] * x[i];
            }
        }
        let variance = self.residual / freedom;
        Ok(Estimate {
            values,
            std_errors: squares.map(|s| (s * variance).sqrt()),
            residual_rms: (self.residual / self.weight).sqrt(),
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

//! A window's rows from its harmonic sums: integrals against the test functions, weighted.

use super::{Regressor, SERIES, UNKNOWNS1, UNKNOWNS2};
use crate::real::Real;

/// Rows of both equations at one m: unknowns' columns, then the target (minus F(φ_i′)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<T> {
    /// First equation.
    pub first: ([T; UNKNOWNS1], T),
    /// Second equation.
    pub second: ([T; UNKNOWNS2], T),
}

/// Weights of both equations' rows at m/m₀.
#[must_use]
pub fn weights<T: Real>(relative_frequency: T) -> [T; 2] {
    let square = relative_frequency * relative_frequency;
    let cube = square * relative_frequency;
    [T::one() / (T::one() + T::from_f64(1.5) * cube), T::one() / (T::one() + square)]
}

impl<T: Real, const B: usize> Regressor<T, B> {
    /// The rows of the last complete window at m, from the real and from the imaginary part (which
    /// is zero at m = 0); `None` beyond [`Self::FREQUENCIES`] or before there is a window.
    #[must_use]
    pub fn rows_at(&self, m: usize) -> Option<[Row<T>; 2]> {
        if self.halves < 2 || m > Self::FREQUENCIES {
            return None;
        }
        let all: [[[T; 2]; 2]; SERIES] = core::array::from_fn(|series| self.integrals(series, m));
        let weights = self.weights(m);
        let times = [self.factors.time, self.factors.time * self.factors.time];
        Some([0, 1].map(|part| {
            let v = |series: usize| all[series][0][part];
            let f = |series: usize| all[series][1][part];
            let damping = (v(1) - v(0)) * times[0];
            let first = [(f(3) - v(4)) * times[1], v(5), v(7), v(8), v(11), -damping];
            let second = [(f(2) + v(4)) * times[1], v(6), v(9), v(10), damping];
            Row {
                first: (first.map(|x| x * weights[0]), -f(0) * times[1] * weights[0]),
                second: (second.map(|x| x * weights[1]), -f(1) * times[1] * weights[1]),
            }
        }))
    }

    fn weights(&self, m: usize) -> [T; 2] {
        weights(T::from_i32(m as i32) * self.factors.periods)
    }

    /// The targets of both equations at m, real and imaginary part, without the rest of the rows.
    #[must_use]
    pub fn targets_at(&self, m: usize) -> Option<[[T; 2]; 2]> {
        if self.halves < 2 || m > Self::FREQUENCIES {
            return None;
        }
        let second = self.factors.time * self.factors.time;
        let weights = self.weights(m);
        let [[_, f1], [_, f2]] = [self.integrals(0, m), self.integrals(1, m)];
        Some([0, 1].map(|part| [-f1[part] * second * weights[0], -f2[part] * second * weights[1]]))
    }

    /// V and F of a series at m: real and imaginary part of each.
    fn integrals(&self, series: usize, m: usize) -> [[T; 2]; 2] {
        let mut sums = [[T::zero(); 2]; 2];
        for (k, a) in self.factors.values.into_iter().enumerate() {
            let n = m as i32 + k as i32 - 2;
            let [re, im] = match usize::try_from(n.unsigned_abs()).unwrap_or(usize::MAX).checked_sub(1) {
                None => [self.window.plain[series], T::zero()],
                // Of a real series.
                Some(j) => match self.window.sums[series].get(j) {
                    Some([re, im]) if n < 0 => [*re, -*im],
                    Some(sum) => *sum,
                    None => continue,
                },
            };
            // −w′: 2πin/L a_n e^{−2πinu}.
            let slope = self.factors.slope * T::from_i32(n);
            let (re, im) = (a * re, a * im);
            sums[0] = [sums[0][0] + re, sums[0][1] + im];
            sums[1] = [sums[1][0] - slope * im, sums[1][1] + slope * re];
        }
        sums
    }
}

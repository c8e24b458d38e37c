//! The lowest bins of discrete Fourier transforms of many windows.
//!
//! S(k) = Σ_j x_j e^{−2πijk/N}, k = 0 … K − 1, with K far below N: a product with the matrix of
//! cosines and sines takes fewer operations than a fast transform of all N bins, and runs at the
//! speed of a matrix product. A window is two halves, S(k) = P₁(k) + (−1)ᵏ P₂(k), P(k) = Σ_{j <
//! N/2} x_j e^{−2πijk/N}, and windows that overlap by half share theirs. About N/4 cosines are even
//! and sines odd for even k, and the other way round for odd k, so that a half is folded before it
//! is multiplied: P(k) = x_0 + Σ_{0 < j ≤ N/4} (x_j ± x_{N/2−j}) e^{…}, + for the cosines of even
//! and the sines of odd k. Where many bins are wanted, or N is long, a fast transform (realfft) is
//! used.

use core::f64::consts::TAU;
use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::{Arch, NullaryFnOnce};
use realfft::num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};

/// Bins up to which the matrix is the faster way.
const MOST_BINS: usize = 128;
/// Largest matrix, entries.
const LARGEST: usize = 1 << 20;

/// Longest window that is looked for, samples: more than a record may have rows.
const LONGEST: f64 = (1_u64 << 28) as f64;

/// The even number nearest to `target` that is a multiple of 4 and a product of 2, 3 and 5: fast by
/// either way (the window's length is free). A window beyond every record, or of no length in
/// numbers, is as long as a quarter of what can be counted: none fits.
pub fn good_length(target: f64) -> usize {
    if target.is_nan() || target > LONGEST {
        return usize::MAX / 4;
    }
    let centre = (target.round() as usize).max(16);
    (0..centre)
        .flat_map(|d| [centre - d, centre + d])
        .find(|&n| n.is_multiple_of(4) && n >= 16 && is_smooth(n))
        .unwrap_or(centre)
}

/// Whether a length has no prime factor above 5.
fn is_smooth(mut n: usize) -> bool {
    for p in [2, 3, 5] {
        while n > 0 && n.is_multiple_of(p) {
            n /= p;
        }
    }
    n == 1
}

/// Transforms of one length.
pub struct Transforms {
    length: usize,
    bins: usize,
    way: Algorithm,
}

enum Algorithm {
    Matrix(Matrices),
    Fast(Arc<dyn RealToComplex<f64>>),
}

/// A column of N/4 + 1 entries for each bin.
struct Matrices {
    /// Cosines of even and sines of odd bins, for what is folded with a plus; cosines of odd and
    /// sines of even bins, for the minus.
    folded: [Vec<f64>; 2],
    /// Transform of a half whose samples are all 1.
    ones: Vec<Complex64>,
}

/// Room to work in.
#[derive(Default)]
pub struct Work {
    starts: Vec<usize>,
    folded: [Vec<f64>; 2],
    sums: [Vec<f64>; 2],
    input: Vec<f64>,
    output: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl Transforms {
    /// Transforms of `length` samples (a multiple of 4) up to bin `bins` − 1.
    pub fn new(length: usize, bins: usize) -> Self {
        let bins = bins.min(length / 2 + 1);
        let matrix = length.is_multiple_of(4) && bins <= MOST_BINS && length * bins / 2 <= LARGEST;
        let way = if matrix { Algorithm::Matrix(Matrices::new(length, bins)) } else { Self::fast(length) };
        Self { length, bins, way }
    }

    /// K.
    pub fn bins(&self) -> usize {
        self.bins
    }

    fn fast(length: usize) -> Algorithm {
        Algorithm::Fast(RealFftPlanner::<f64>::new().plan_fft_forward(length))
    }

    /// Bins 0 … K − 1 of windows of the planned length: for each group of signals and each of its
    /// windows' first samples (rising), signal after signal.
    pub fn apply(&self, groups: &[(&[Vec<f64>], &[usize])], work: &mut Work, out: &mut Vec<Complex64>) {
        out.clear();
        match &self.way {
            Algorithm::Matrix(matrices) => self.by_matrix(matrices, groups, work, out),
            Algorithm::Fast(fft) => {
                let Work { input, output, scratch, .. } = work;
                input.resize(self.length, 0.0);
                output.resize(self.length / 2 + 1, Complex64::default());
                scratch.resize(fft.get_scratch_len(), Complex64::default());
                let windows = groups.iter().flat_map(|(signals, starts)| {
                    starts.iter().flat_map(move |start| signals.iter().map(move |x| &x[*start..start + self.length]))
                });
                for x in windows {
                    // A whirling angle is large: what matters is its change.
                    let offset = x[0];
                    input.iter_mut().zip(x).for_each(|(y, x)| *y = x - offset);
                    let done = fft.process_with_scratch(input, output, scratch);
                    debug_assert!(done.is_ok(), "lengths are the planner's own");
                    let first = out.len();
                    out.extend_from_slice(&output[..self.bins]);
                    out[first] += offset * self.length as f64;
                }
            }
        }
    }

    fn by_matrix(
        &self,
        matrices: &Matrices,
        groups: &[(&[Vec<f64>], &[usize])],
        work: &mut Work,
        out: &mut Vec<Complex64>,
    ) {
        let (half, rows) = (self.length / 2, self.length / 4 + 1);
        let Work { starts: halves, folded, sums, .. } = work;
        // The halves of all windows, group after group: one that two windows share once.
        halves.clear();
        let mut ends = Vec::with_capacity(groups.len());
        for (_, starts) in groups {
            let from = halves.len();
            halves.extend(starts.iter().flat_map(|s| [*s, s + half]));
            halves[from..].sort_unstable();
            let mut kept = from;
            for k in from..halves.len() {
                if kept == from || halves[kept - 1] != halves[k] {
                    halves[kept] = halves[k];
                    kept += 1;
                }
            }
            halves.truncate(kept);
            ends.push((from, kept));
        }
        let count: usize = groups.iter().zip(&ends).map(|((signals, _), (from, to))| signals.len() * (to - from)).sum();
        folded.iter_mut().for_each(|f| f.resize(rows * count, 0.0));
        let [plus, minus] = folded;
        let arch = Arch::new();
        let mut columns = plus.chunks_exact_mut(rows).zip(minus.chunks_exact_mut(rows));
        for ((signals, _), (from, to)) in groups.iter().zip(&ends) {
            for start in &halves[*from..*to] {
                for (x, (plus, minus)) in signals.iter().zip(&mut columns) {
                    arch.dispatch(Fold { x: &x[*start..start + half], plus, minus });
                }
            }
        }
        for ((matrix, folded), sums) in matrices.folded.iter().zip(folded.iter()).zip(sums.iter_mut()) {
            sums.resize(self.bins * count, 0.0);
            let left = MatRef::from_column_major_slice(matrix, rows, self.bins).transpose();
            let right = MatRef::from_column_major_slice(folded, rows, count);
            let to = MatMut::from_column_major_slice_mut(sums, self.bins, count);
            matmul(to, Accum::Replace, left, right, 1.0, Par::Seq);
        }
        let even = self.bins.div_ceil(2);
        let [plus, minus] = sums;
        let mut column = 0;
        for ((signals, starts), (from, to)) in groups.iter().zip(&ends) {
            let place = |start: usize| halves[*from..*to].partition_point(|s| *s < start);
            for start in *starts {
                let (first, second) = (place(*start), place(start + half));
                for (i, x) in signals.iter().enumerate() {
                    let own = |half: usize| {
                        let at = (column + half * signals.len() + i) * self.bins;
                        (&plus[at..at + self.bins], &minus[at..at + self.bins])
                    };
                    let ((p1, m1), (p2, m2)) = (own(first), own(second));
                    // Each half was taken relative to its own first sample.
                    let step = x[start + half] - x[*start];
                    let at = out.len();
                    out.extend((0..self.bins).map(|k| {
                        // Even bins' cosines and odd bins' sines stand first.
                        let (a, b) = (k / 2, even + k / 2);
                        let (one, two) = if k % 2 == 0 {
                            (
                                Complex64::new(p1[a], -m1[self.bins - even + k / 2]),
                                Complex64::new(p2[a], -m2[self.bins - even + k / 2]),
                            )
                        } else {
                            (Complex64::new(m1[a], -p1[b]), Complex64::new(m2[a], -p2[b]))
                        };
                        let two = two + step * matrices.ones[k];
                        if k % 2 == 0 { one + two } else { one - two }
                    }));
                    out[at] += x[*start] * self.length as f64;
                }
            }
            column += (to - from) * signals.len();
        }
    }
}

/// Folds half a window about its middle, relative to its first sample; see the head of this file.
struct Fold<'a> {
    x: &'a [f64],
    plus: &'a mut [f64],
    minus: &'a mut [f64],
}

impl NullaryFnOnce for Fold<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { x, plus, minus } = self;
        let middle = x.len() / 2;
        // A whirling angle is large: what matters is its change.
        let offset = x[0];
        (plus[0], minus[0]) = (0.0, 0.0);
        let inner = plus[1..middle].iter_mut().zip(&mut minus[1..middle]);
        for ((plus, minus), (a, b)) in inner.zip(x[1..middle].iter().zip(x[middle + 1..].iter().rev())) {
            let (a, b) = (a - offset, b - offset);
            (*plus, *minus) = (a + b, a - b);
        }
        // The middle is its own mirror image: it stands once, in the sums where its factor is
        // not 0.
        (plus[middle], minus[middle]) = (x[middle] - offset, 0.0);
    }
}

impl Matrices {
    fn new(length: usize, bins: usize) -> Self {
        let quarter = length / 4;
        let turn = |f: fn(f64) -> f64| -> Vec<f64> { (0..length).map(|j| f(TAU * j as f64 / length as f64)).collect() };
        let (cos, sin) = (turn(f64::cos), turn(f64::sin));
        let table = |first: usize, values: &[f64]| -> Vec<f64> {
            // The phase modulo a turn, exactly.
            (first..bins).step_by(2).flat_map(|k| (0..=quarter).map(move |j| values[(j * k) % length])).collect()
        };
        let folded = [[table(0, &cos), table(1, &sin)].concat(), [table(1, &cos), table(0, &sin)].concat()];
        let ones = (0..bins)
            .map(|k| match k {
                0 => Complex64::new(length as f64 / 2.0, 0.0),
                k if k % 2 == 0 => Complex64::default(),
                // 2/(1 − e^{−2πik/N}) = 1 − i cot(πk/N).
                k => Complex64::new(1.0, -1.0 / (0.5 * TAU * k as f64 / length as f64).tan()),
            })
            .collect();
        Self { folded, ones }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_give_the_naive_sum() {
        for (length, bins) in [(240, 17), (240, 16), (16, 9), (16, 1), (2000, 43)] {
            let x: Vec<f64> =
                (0..2 * length).map(|j| 1e3 + 0.2 * j as f64 + (0.37 * (j * j % 97) as f64).sin()).collect();
            let y: Vec<f64> = x.iter().rev().map(|x| (0.1 * x).cos()).collect();
            let plan = Transforms::new(length, bins);
            assert!(matches!(plan.way, Algorithm::Matrix(_)));
            let fast = Transforms { way: Transforms::fast(length), ..Transforms::new(length, bins) };
            for plan in [plan, fast] {
                let mut out = Vec::new();
                let signals = [x.clone(), y.clone()];
                // Windows that share a half, and one that does not; a group by itself.
                let starts = [0, length / 2, length / 2 + 7];
                plan.apply(&[(&signals, &starts), (&signals[1..], &[3])], &mut Work::default(), &mut out);
                assert_eq!(out.len(), 7 * bins);
                let windows = starts.iter().flat_map(|s| signals.iter().map(move |x| &x[*s..s + length]));
                for (s, signal) in windows.chain([&y[3..3 + length]]).enumerate() {
                    for k in 0..bins {
                        let naive: Complex64 = signal
                            .iter()
                            .enumerate()
                            .map(|(j, x)| Complex64::from_polar(*x, -TAU * ((j * k) % length) as f64 / length as f64))
                            .sum();
                        let error = (out[s * bins + k] - naive).norm();
                        assert!(error < 1e-11 * (1.0 + signal[0].abs()) * length as f64, "{length} {k}: {error:e}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_would_be_a_large_matrix_is_a_fast_transform() {
        assert!(matches!(Transforms::new(8_000_000, 43).way, Algorithm::Fast(_)));
        assert!(matches!(Transforms::new(2000, 403).way, Algorithm::Fast(_)));
    }

    #[test]
    fn good_lengths_are_near() {
        assert_eq!((good_length(2000.0), good_length(1923.08), good_length(3.0)), (2000, 1920, 16));
    }
}

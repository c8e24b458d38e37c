//! Sums of multiples over many numbers at once, compiled for each kind of vectors that processors
//! have (pulp). Nothing is fused: the same bytes everywhere.

use pulp::{Arch, NullaryFnOnce};

struct Scaled<'a>(&'a mut [f64], f64, &'a [f64]);

impl NullaryFnOnce for Scaled<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(to, f, of) = self;
        to.iter_mut().zip(of).for_each(|(t, x)| *t += f * x);
    }
}

/// t += f x.
pub fn add_scaled(to: &mut [f64], f: f64, of: &[f64]) {
    Arch::new().dispatch(Scaled(to, f, of));
}

/// Numbers that are summed at once by [`combine`].
const LANES: usize = 32;

struct Combined<'a, 'b>(&'a mut [f64], &'a [(f64, &'b [f64])]);

impl NullaryFnOnce for Combined<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(to, terms) = self;
        let whole = to.len() / LANES * LANES;
        let (blocks, rest) = to.as_chunks_mut::<LANES>();
        for (from, block) in blocks.iter_mut().enumerate() {
            let mut sums = [0.0; LANES];
            for (f, of) in terms {
                let Some(of) = of[from * LANES..].first_chunk::<LANES>() else { continue };
                sums.iter_mut().zip(of).for_each(|(t, x)| *t += f * x);
            }
            *block = sums;
        }
        rest.fill(0.0);
        for (f, of) in terms {
            rest.iter_mut().zip(&of[whole..]).for_each(|(t, x)| *t += f * x);
        }
    }
}

/// t = Σ f x, all of one length.
pub fn combine(to: &mut [f64], terms: &[(f64, &[f64])]) {
    Arch::new().dispatch(Combined(to, terms));
}

struct Matrices<'a, const LANES: usize> {
    to: &'a mut [[f64; LANES]],
    a: &'a [[f64; LANES]],
    b: &'a [[f64; LANES]],
    inner: usize,
    sides: usize,
}

impl<const LANES: usize> NullaryFnOnce for Matrices<'_, LANES> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { to, a, b, inner, sides } = self;
        for (row, a) in to.chunks_exact_mut(sides).zip(a.chunks_exact(inner)) {
            for (s, to) in row.iter_mut().enumerate() {
                let mut sum = *to;
                for (a, b) in a.iter().zip(b.iter().skip(s).step_by(sides)) {
                    sum.iter_mut().zip(a.iter().zip(b)).for_each(|(t, (a, b))| *t += a * b);
                }
                *to = sum;
            }
        }
    }
}

/// T += A B for as many matrices side by side as there are lanes, `inner` columns of A, `sides` of
/// B, row after row, each entry in all lanes.
pub fn add_matrix_products<const LANES: usize>(to: &mut [f64], a: &[f64], b: &[f64], inner: usize, sides: usize) {
    let (to, a, b) = (to.as_chunks_mut().0, a.as_chunks().0, b.as_chunks().0);
    Arch::new().dispatch(Matrices::<LANES> { to, a, b, inner, sides });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Products of the matrices one by one, on top of what was there; sums of multiples number by
    /// number, with and without a rest.
    #[test]
    fn sums_are_those_of_single_numbers() {
        let numbers = |n: usize, k: f64| (0..n).map(|i| (k * i as f64).sin()).collect::<Vec<f64>>();
        let (a, b, begin) = (numbers(6 * 8, 0.7), numbers(12 * 8, 0.3), numbers(8 * 8, 1.1));
        let mut to = begin.clone();
        add_matrix_products::<8>(&mut to, &a, &b, 3, 4);
        for (k, t) in to.iter().enumerate() {
            let (entry, lane) = (k / 8, k % 8);
            let (i, s) = (entry / 4, entry % 4);
            let sum = (0..3).fold(begin[k], |sum, j| sum + a[(i * 3 + j) * 8 + lane] * b[(j * 4 + s) * 8 + lane]);
            assert_eq!(*t, sum);
        }
        let (x, y) = (numbers(75, 0.9), numbers(75, 0.2));
        let mut out = vec![f64::NAN; 75];
        combine(&mut out, &[(0.5, &x), (-3.0, &y)]);
        assert!(out.iter().zip(x.iter().zip(&y)).all(|(o, (x, y))| *o == 0.5 * x + -3.0 * y));
    }
}

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

struct Products<'a>(&'a mut [f64], &'a [f64], &'a [f64]);

impl NullaryFnOnce for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(to, a, b) = self;
        to.iter_mut().zip(a.iter().zip(b)).for_each(|(t, (a, b))| *t += a * b);
    }
}

/// t += a b.
pub fn add_products(to: &mut [f64], a: &[f64], b: &[f64]) {
    Arch::new().dispatch(Products(to, a, b));
}

/// Numbers that are summed at once by [`combine`].
const LANES: usize = 32;

struct Combined<'a, 'b>(&'a mut [f64], &'a [(f64, &'b [f64])]);

impl NullaryFnOnce for Combined<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(to, terms) = self;
        let mut from = 0;
        for block in to.chunks_mut(LANES) {
            let mut sums = [0.0; LANES];
            let count = block.len();
            let sums = &mut sums[..count];
            for (f, of) in terms {
                sums.iter_mut().zip(&of[from..from + count]).for_each(|(t, x)| *t += f * x);
            }
            block.copy_from_slice(sums);
            from += LANES;
        }
    }
}

/// t = Σ f x.
pub fn combine(to: &mut [f64], terms: &[(f64, &[f64])]) {
    Arch::new().dispatch(Combined(to, terms));
}

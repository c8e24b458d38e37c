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

struct Two<'a>(&'a mut [f64], (f64, &'a [f64]), (f64, &'a [f64]));

impl NullaryFnOnce for Two<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(to, (p, a), (q, b)) = self;
        to.iter_mut().zip(a.iter().zip(b)).for_each(|(t, (a, b))| *t += p * a + q * b);
    }
}

/// t += p a + q b.
pub fn add_two(to: &mut [f64], a: (f64, &[f64]), b: (f64, &[f64])) {
    Arch::new().dispatch(Two(to, a, b));
}

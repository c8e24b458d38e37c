//! Scalar series made ready for phase-space statistics: on the circle or on the line, in single
//! precision, dithered.
//!
//! An angle is kept in turns, wrapped to [0, 1); a number is kept as (x − min)/(max − min), in [0,
//! 1]. The distance of two values is min(|d|, P − |d|) with P = 1 for an angle (the arc between
//! them) and P = ∞ for a number (plain difference).
//!
//! Quantised values coincide, which makes nearest neighbours meaningless (distance 0) and trees
//! slow. Each value is therefore moved by a uniform amount within ± half a quantisation step, from
//! a seeded generator: the same every time. What is smaller than a step is then noise by
//! construction, as it is in the record.
//!
//! Stretches lie one behind the other; [`Observable::stretches`] says where each ends, so that no
//! delay vector and no pair straddles a gap. Limits: 2³² − 1 samples; resolution 6e-8 of a turn or
//! of the span.

use std::f64::consts::TAU;
use std::ops::Range;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A series of one coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Observable {
    /// Values: turns in [0, 1) or share of the span.
    pub values: Vec<f32>,
    /// Unbroken stretches, in order, as ranges of `values`.
    pub stretches: Vec<Range<usize>>,
    /// 1 on the circle, ∞ on the line.
    pub period: f32,
    /// Radians a turn, or the span in the coordinate's unit: what a distance of 1 stands for.
    pub unit: f64,
}

/// Distance of two values; `period` 1 on the circle, ∞ on the line.
#[inline(always)]
pub fn distance(a: f32, b: f32, period: f32) -> f32 {
    let d = (a - b).abs();
    let round = period - d;
    if d < round { d } else { round }
}

impl Observable {
    /// Angles in radians (wrapped or not). `step`: quantisation step, rad, 0 for none. Values that
    /// are not finite are taken as 0: records have been checked before.
    pub fn angle(stretches: &[&[f64]], step: f64, seed: u64) -> Self {
        Self::build(stretches, step / TAU, seed, 1.0, TAU, |x| x / TAU)
    }

    /// Numbers on the line; `step` in their unit.
    pub fn number(stretches: &[&[f64]], step: f64, seed: u64) -> Self {
        let (low, high) = stretches
            .iter()
            .flat_map(|s| s.iter())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let span = if high > low { high - low } else { 1.0 };
        Self::build(stretches, step / span, seed, f32::INFINITY, span, |x| (x - low) / span)
    }

    fn build(stretches: &[&[f64]], step: f64, seed: u64, period: f32, unit: f64, scale: impl Fn(f64) -> f64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let mut values = Vec::with_capacity(stretches.iter().map(|s| s.len()).sum());
        let mut ranges = Vec::with_capacity(stretches.len());
        for x in stretches {
            let from = values.len();
            values.extend(x.iter().map(|x| {
                let dither =
                    if step > 0.0 { (f64::from(generator.next_u32()) + 0.5) / 4_294_967_296.0 - 0.5 } else { 0.0 };
                let v = scale(*x) + step * dither;
                let v = if v.is_finite() { v } else { 0.0 };
                if period.is_finite() {
                    // Rounding to single precision may give 1 itself.
                    let turn = (v - v.floor()) as f32;
                    if turn < 1.0 { turn } else { 0.0 }
                } else {
                    v as f32
                }
            }));
            ranges.push(from..values.len());
        }
        Self { values, stretches: ranges, period, unit }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_go_the_shorter_way_round() {
        let o = Observable::angle(&[&[0.1, -0.1, 3.0, TAU * 5.0 + 0.1]], 0.0, 0);
        let d = |i: usize, j: usize| f64::from(distance(o.values[i], o.values[j], o.period)) * o.unit;
        assert!((d(0, 1) - 0.2).abs() < 1e-6 && d(0, 3) < 1e-5);
        assert!((d(1, 2) - 3.1).abs() < 1e-5, "{}", d(1, 2));
        let o = Observable::number(&[&[-2.0, 6.0]], 0.0, 0);
        assert_eq!((o.values.clone(), o.unit), (vec![0.0, 1.0], 8.0));
        assert_eq!(distance(o.values[0], o.values[1], o.period), 1.0);
    }

    #[test]
    fn dither_stays_within_half_a_step_and_is_the_same_every_time() {
        let step = TAU / 64.0;
        let counts: Vec<f64> = (0..5000).map(|i| (f64::from(i % 64) + 0.5) * step).collect();
        let a = Observable::angle(&[&counts], step, 7);
        assert_eq!(a, Observable::angle(&[&counts], step, 7));
        assert_ne!(a, Observable::angle(&[&counts], step, 8));
        let mut sum = 0.0;
        for (v, c) in a.values.iter().zip(&counts) {
            let moved = f64::from(*v) * TAU - c;
            assert!(moved.abs() <= 0.5 * step * 1.0001);
            sum += moved * moved;
        }
        // Uniform: variance step²/12.
        assert!((sum / 5000.0 / (step * step / 12.0) - 1.0).abs() < 0.05);
        assert!(a.values.iter().all(|v| (0.0..1.0).contains(v)));
    }
}

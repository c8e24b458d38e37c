//! What effects add to what is recorded of a sensor or of an input, put on and taken off.
//!
//! With x what ought to be shown, f_k the laws of all effects on it and s_k their strengths, it
//! shows y(t) = z(t − d), z = x + Σ_k s_k f_k(x, ẋ). A law that is a number times the rate alone is
//! no addition but part of the delay d, which shifts the series as one that is band-limited
//! ([`BandLimited`]). z is inverted by x ← z − Σ_k s_k f_k(x, ẋ) from x = z on: where the additions'
//! slope by x is at most g, gⁿ of them is left after n times, until that is nothing.

use crate::model::model_file::expression::{Expression, Node, Symbol, as_number, number, symbol};
use crate::signal::band_limited::BandLimited;
use crate::signal::differences::{rate, rates};

/// Samples to either side over which the rate of what is measured is taken: counts are coarse.
const REACH: usize = 6;
/// Most times that laws are inverted, and the movement, as a share of the greatest value, at which
/// they are: far below a count.
const MOST_INVERSIONS: usize = 40;
const STANDS_STILL: f64 = 1e-9;

/// A series at even times.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Its values.
    pub values: &'a [f64],
    /// Time of the first, s.
    pub start_s: f64,
    /// Spacing, s.
    pub step_s: f64,
}

impl Samples<'_> {
    fn time(&self, i: usize) -> f64 {
        self.start_s + i as f64 * self.step_s
    }

    /// The series as it was `by_s` before.
    fn delayed(&self, by_s: f64) -> Vec<f64> {
        let between = BandLimited::new(self.values, self.start_s, self.step_s);
        (0..self.values.len()).map(|i| between.value(self.time(i) - by_s)).collect()
    }
}

/// A law for x and its rate ([`Symbol::Coordinate`] and [`Symbol::Rate`] 0), with its strength.
pub type Addition = (Node, f64);

/// k where a law is k v: a sensor that is late.
fn slope(law: &Node) -> Option<f64> {
    let at_rest = law.replace(&|s| if s == Symbol::Rate(0) { number(0.0) } else { symbol(s) });
    let slope = law.derivative(Symbol::Rate(0)).and_then(|d| as_number(&d))?;
    (as_number(&at_rest) == Some(0.0)).then_some(slope)
}

/// Time by which laws delay, s, and those that are no delay.
pub fn delay(laws: &[Addition]) -> (f64, Vec<Addition>) {
    let (mut ahead_s, mut other) = (0.0, Vec::new());
    for (law, strength) in laws.iter().filter(|l| l.1 != 0.0) {
        match slope(law) {
            Some(k) => ahead_s += k * strength,
            None => other.push((law.clone(), *strength)),
        }
    }
    (-ahead_s, other)
}

/// What a law adds to the value x at sample i.
fn added(law: &Node, x: f64, v: impl Fn() -> f64, time: f64) -> f64 {
    law.value(&|symbol| match symbol {
        Symbol::Coordinate(_) => x,
        Symbol::Rate(_) => v(),
        _ => time,
    })
}

/// What is shown of what ought to be. `known`: its rates, where they are better known than by its
/// differences.
pub fn put_on(own: &Samples<'_>, known: Option<&[f64]>, laws: &[Addition]) -> Vec<f64> {
    let (delay_s, other) = delay(laws);
    let mut out = own.values.to_vec();
    if !other.is_empty() {
        let by_differences = if known.is_none() { rates(own.values, own.step_s) } else { Vec::new() };
        let v = known.unwrap_or(&by_differences);
        for (i, x) in out.iter_mut().enumerate() {
            *x += other.iter().map(|(law, s)| s * added(law, *x, || v[i], own.time(i))).sum::<f64>();
        }
    }
    if delay_s == 0.0 { out } else { Samples { values: &out, ..*own }.delayed(delay_s) }
}

/// What ought to be shown, from what is.
pub fn taken_off(seen: &Samples<'_>, laws: &[Addition]) -> Vec<f64> {
    let (delay_s, other) = delay(laws);
    let seen_at = if delay_s == 0.0 { seen.values.to_vec() } else { seen.delayed(-delay_s) };
    if other.is_empty() {
        return seen_at;
    }
    let mut out = seen_at.clone();
    let moves = other.iter().all(|(law, _)| matches!(**law, Expression::Number(_)));
    let still = STANDS_STILL * seen_at.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let mut last = f64::INFINITY;
    for _ in 0..if moves { 1 } else { MOST_INVERSIONS } {
        let before = out.clone();
        for (i, x) in out.iter_mut().enumerate() {
            let v = || rate(&before, i, REACH, seen.step_s);
            *x = seen_at[i] - other.iter().map(|(law, s)| s * added(law, before[i], v, seen.time(i))).sum::<f64>();
        }
        let moved = out.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // A law as steep as what is shown has no inverse to be found so.
        if moved <= still || moved >= last {
            break;
        }
        last = moved;
    }
    out
}

/// The greatest size of what a law adds to every 17th sample of what is shown.
pub fn greatest(shown: &Samples<'_>, law: &Node) -> f64 {
    let of = |i: usize| added(law, shown.values[i], || rate(shown.values, i, REACH, shown.step_s), shown.time(i)).abs();
    (0..shown.values.len()).step_by(17).map(of).fold(0.0, f64::max)
}

#[cfg(test)]
#[path = "on_a_record_tests.rs"]
mod tests;

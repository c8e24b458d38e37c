//! The record read again with an effect of its sensors, of its inputs or of its drive's phase taken
//! off.

use core::f64::consts::TAU;

use crate::identify::stretches::{Stretch, mixed};
use crate::model::model_file::expression::{Expression, Node, Symbol, as_number, number, symbol};
use crate::rig::measures::ObservedModel;
use crate::signal::angles::Phase;
use crate::signal::band_limited::BandLimited;

/// Samples to either side over which a sensor's rate is taken.
const REACH: usize = 6;
/// Times that a law is inverted: each leaves a share of the effect's own slope, far below a count.
const INVERSIONS: usize = 3;

/// k where a law is k v: a sensor that is late.
pub fn delay(law: &Node) -> Option<f64> {
    let at_rest = law.replace(&|s| if s == Symbol::Rate(0) { number(0.0) } else { symbol(s) });
    let slope = law.derivative(Symbol::Rate(0)).and_then(|d| as_number(&d))?;
    (as_number(&at_rest) == Some(0.0)).then_some(slope)
}

/// Rate of a sensor over ± [`REACH`] samples.
fn rate(x: &[f64], i: usize, step_s: f64) -> f64 {
    let (a, b) = (i.saturating_sub(REACH), (i + REACH).min(x.len() - 1));
    if b > a { (x[b] - x[a]) / ((b - a) as f64 * step_s) } else { 0.0 }
}

/// A stretch with what a sensor shows freed of `strength` times a law's addition.
pub fn sensor(s: &Stretch, bound: &ObservedModel, sensor: usize, law: &Node, strength: f64) -> Stretch {
    if strength == 0.0 || s.is_empty() {
        return s.clone();
    }
    let mut shown = s.sensors(bound);
    shown[sensor] = freed(s, &shown[sensor], law, strength);
    Stretch { coordinates: mixed(&bound.coordinates, &shown), ..s.clone() }
}

/// A stretch with what is recorded of an input freed of `strength` times a law's addition.
pub fn input(s: &Stretch, input: usize, law: &Node, strength: f64) -> Stretch {
    let mut out = s.clone();
    if strength != 0.0 && !s.is_empty() {
        out.inputs[input] = freed(s, &s.inputs[input], law, strength);
    }
    out
}

/// A series of a stretch freed of `strength` times a law's addition.
fn freed(s: &Stretch, seen: &[f64], law: &Node, strength: f64) -> Vec<f64> {
    if let Some(k) = delay(law) {
        let between = BandLimited::new(seen, s.start_s, s.step_s);
        return (0..seen.len()).map(|i| between.value(s.time(i) - k * strength)).collect();
    }
    let mut out = seen.to_vec();
    let moves = matches!(**law, Expression::Number(_));
    for _ in 0..if moves { 1 } else { INVERSIONS } {
        let before = out.clone();
        for (i, x) in out.iter_mut().enumerate() {
            let added = law.value(&|symbol| match symbol {
                Symbol::Coordinate(_) => before[i],
                Symbol::Rate(_) => rate(&before, i, s.step_s),
                _ => s.time(i),
            });
            *x = seen[i] - strength * added;
        }
    }
    out
}

/// A strength that moves what a sensor shows by 1e-4 rad at most.
pub fn small_step(stretches: &[Stretch], bound: &ObservedModel, sensor: usize, law: &Node) -> f64 {
    let mut greatest = 1e-9_f64;
    for s in stretches {
        let shown = s.sensors(bound);
        let x = &shown[sensor];
        for i in (0..x.len()).step_by(17) {
            let added = law.value(&|symbol| match symbol {
                Symbol::Coordinate(_) => x[i],
                Symbol::Rate(_) => rate(x, i, s.step_s),
                _ => s.time(i),
            });
            greatest = greatest.max(added.abs());
        }
    }
    1e-4 / greatest
}

/// A stretch whose drive runs ahead of its recorded phase by `strength` times a law of time.
pub fn phase(s: &Stretch, law: &Node, strength: f64) -> Stretch {
    if strength == 0.0 {
        return s.clone();
    }
    let turns = (0..s.len())
        .map(|i| {
            let tau = s.tau(i) + strength * law.value(&|_| s.time(i));
            // The fraction of a turn in units of 2⁻³²: below 2³² by construction, the cast cuts
            // nothing but the last whole turn.
            ((tau / TAU).rem_euclid(1.0) * 4_294_967_296.0) as u32
        })
        .collect();
    Stretch { phase: Phase::Device(turns), ..s.clone() }
}

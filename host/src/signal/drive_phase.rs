//! Sine and cosine of the drive's phase along a record, by turning: the phase grows by the same
//! amount from sample to sample, so that sin(τ + kδ) = sin τ cos kδ + cos τ sin kδ needs one sine
//! and cosine a block.

use core::f64::consts::TAU;

use super::angles::{AngleSegment, Phase};
use super::sin_cos::sin_cos;

/// Samples of a block at most: rounding does not build up beyond 1e-15.
const BLOCK: usize = 64;

/// Turns by k δ, k = 0 … 63, kept from block to block.
pub struct Turn {
    step: f64,
    sin: [f64; BLOCK],
    cos: [f64; BLOCK],
}

impl Default for Turn {
    fn default() -> Self {
        Self { step: 0.0, sin: [0.0; BLOCK], cos: [1.0; BLOCK] }
    }
}

impl Turn {
    /// sin τ and cos τ of a segment's drive at samples first … last, at most 64 of them.
    pub fn drive(&mut self, segment: &AngleSegment, (first, last): (usize, usize), sin: &mut [f64], cos: &mut [f64]) {
        let n = last - first;
        let Some(step) = even_step(segment, first, last) else {
            let mut tau = [0.0; BLOCK];
            tau.iter_mut().zip(first..last).for_each(|(tau, k)| *tau = segment.tau(k));
            sin_cos(&tau[..n], &mut sin[..n], &mut cos[..n]);
            return;
        };
        if step.to_bits() != self.step.to_bits() {
            for k in 0..BLOCK {
                (self.sin[k], self.cos[k]) = (k as f64 * step).sin_cos();
            }
            self.step = step;
        }
        let (s, c) = segment.tau(first).sin_cos();
        for (((sin, cos), a), b) in sin[..n].iter_mut().zip(&mut cos[..n]).zip(&self.sin).zip(&self.cos) {
            (*sin, *cos) = (s * b + c * a, c * b - s * a);
        }
    }
}

/// The phase's growth a sample, rad, where it is the same over these samples (the device adds up
/// whole numbers).
fn even_step(segment: &AngleSegment, first: usize, last: usize) -> Option<f64> {
    if last > segment.len() || last - first > BLOCK {
        return None;
    }
    Some(match &segment.phase {
        Phase::Clock(omega) => omega * segment.step_s,
        Phase::Device(turns) => {
            let turns = &turns[first..last];
            let [a, b, ..] = *turns else { return None };
            let step = b.wrapping_sub(a);
            if turns.windows(2).any(|w| w[1].wrapping_sub(w[0]) != step) {
                return None;
            }
            f64::from(step.cast_signed()) * (TAU / 4_294_967_296.0)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_gives_the_sine_and_cosine() {
        let mut segment = AngleSegment {
            start_s: 700.0,
            step_s: 2e-3,
            phi: [vec![0.0; 300], vec![0.0; 300]],
            phase: Phase::Clock(31.7),
            relative: false,
            count_rad: [None; 2],
        };
        let even: Vec<u32> = (0..300u32).map(|k| 4_000_000_000_u32.wrapping_add(k.wrapping_mul(43_000_111))).collect();
        let mut jumps = even.clone();
        jumps[130..].iter_mut().for_each(|t| *t = t.wrapping_add(99));
        for phase in [Phase::Clock(31.7), Phase::Device(even), Phase::Device(jumps)] {
            segment.phase = phase;
            let mut turn = Turn::default();
            for first in (0..300).step_by(BLOCK) {
                let last = (first + BLOCK).min(300);
                let (mut sin, mut cos) = ([0.0; BLOCK], [0.0; BLOCK]);
                turn.drive(&segment, (first, last), &mut sin, &mut cos);
                for k in first..last {
                    let (s, c) = segment.tau(k).sin_cos();
                    assert!((sin[k - first] - s).abs() < 1e-11 && (cos[k - first] - c).abs() < 1e-11, "{k}");
                }
            }
        }
    }
}

//! Where a channel may have a break: samples whose d-th difference stands far out of those around
//! it.
//!
//! Differences annihilate slow motion: a spike of S makes C(d, ⌊d/2⌋) S of the d-th difference, a
//! slip C(d−1, ⌊(d−1)/2⌋) S, and the quantisation of a count (white, q²/12) C(2d, d)^½ q/√12. The
//! order d = 2 to 6 is the one in which a slip stands out most of the record's own median. The
//! scale is local: the greatest of the medians of three blocks of [`BLOCK`] samples, not below the
//! quantisation's share nor a quarter of the record's own. This is a sieve; what passes it is
//! judged by [`super::breaks`].
//!
//! Cost: about 5 ns a sample.

use super::trace::Trace;
use crate::statistics::median;

/// Samples of a block.
pub const BLOCK: usize = 256;
/// Every so many of a block's differences make its median.
const STRIDE: usize = 8;
/// Standard deviations from which a difference is looked at: a thousandth of a sample in 670 000 of
/// Gaussian noise.
const LIMIT: f64 = 6.0;
/// Standard deviation of Gaussian noise over the median of its size.
const SIGMA: f64 = 1.4826;
/// Greatest order.
const HIGHEST: usize = 6;

/// Central binomial coefficients: of a slip (order d − 1) and the noise (C(2d, d)), for d = 0 to 6.
const SLIP: [f64; HIGHEST + 1] = [0.0, 1.0, 1.0, 2.0, 3.0, 6.0, 10.0];
const NOISE: [f64; HIGHEST + 1] = [1.0, 2.0, 6.0, 20.0, 70.0, 252.0, 924.0];

/// Samples that may hold a break: from `from` to before `to` of stretch `stretch`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suspect {
    pub stretch: usize,
    pub from: usize,
    pub to: usize,
    /// Its greatest difference over the local scale.
    pub size: f64,
}

/// Differences of order d in place; the last d are of no use.
fn difference(x: &mut [f64], order: usize) {
    for _ in 0..order {
        for i in 0..x.len() - 1 {
            x[i] = x[i + 1] - x[i];
        }
    }
}

/// The order in which a slip stands out most.
pub fn order(trace: &Trace<'_>) -> usize {
    let total = trace.len();
    let stride = (total / 64).max(BLOCK);
    let mut best = (0.0, 2);
    let mut x = [0.0; 32];
    for d in 2..=HIGHEST {
        let mut sizes = Vec::new();
        for s in &trace.stretches {
            let mut at = 0;
            while at + x.len() <= s.len() {
                s.copy(at, &mut x);
                difference(&mut x, d);
                sizes.extend(x[..x.len() - d].iter().map(|v| v.abs()));
                at += stride;
            }
        }
        let floor = trace.quantum * (NOISE[d] / 12.0).sqrt();
        let ratio = SLIP[d] / (SIGMA * median(&mut sizes)).max(floor).max(f64::MIN_POSITIVE);
        if ratio > best.0 {
            best = (ratio, d);
        }
    }
    best.1
}

/// All suspects of a channel, in order.
pub fn screen(trace: &Trace<'_>) -> Vec<Suspect> {
    let d = order(trace);
    let mut blocks: Vec<Vec<(f64, f64)>> = Vec::with_capacity(trace.stretches.len());
    let (mut x, mut few) = ([0.0; BLOCK + HIGHEST], [0.0; BLOCK / STRIDE]);
    for s in &trace.stretches {
        let n = s.len().saturating_sub(d);
        let mut of = Vec::with_capacity(n / BLOCK + 1);
        let mut at = 0;
        while at < n {
            let count = BLOCK.min(n - at);
            s.copy(at, &mut x[..count + d]);
            difference(&mut x[..count + d], d);
            let largest = x[..count].iter().fold(0.0_f64, |m, v| if v.abs() > m { v.abs() } else { m });
            let mut filled = 0;
            for v in x[..count].iter().step_by(STRIDE) {
                few[filled] = v.abs();
                filled += 1;
            }
            of.push((median(&mut few[..filled]), largest));
            at += count;
        }
        blocks.push(of);
    }
    let mut medians: Vec<f64> = blocks.iter().flatten().map(|b| b.0).collect();
    let floor = (trace.quantum * (NOISE[d] / 12.0).sqrt()).max(0.25 * SIGMA * median(&mut medians));
    let mut found: Vec<Suspect> = Vec::new();
    for (k, (s, of)) in trace.stretches.iter().zip(&blocks).enumerate() {
        for (b, block) in of.iter().enumerate() {
            let near = &of[b.saturating_sub(1)..(b + 2).min(of.len())];
            let scale = (SIGMA * near.iter().map(|n| n.0).fold(0.0, f64::max)).max(floor);
            if block.1 <= LIMIT * scale || scale == 0.0 {
                continue;
            }
            let (at, count) = (b * BLOCK, BLOCK.min(s.len() - d - b * BLOCK));
            s.copy(at, &mut x[..count + d]);
            difference(&mut x[..count + d], d);
            for (i, v) in x[..count].iter().enumerate().filter(|(_, v)| v.abs() > LIMIT * scale) {
                let (from, size) = (at + i, v.abs() / scale);
                match found.last_mut() {
                    Some(last) if last.stretch == k && from <= last.to => {
                        last.to = from + d + 1;
                        last.size = last.size.max(size);
                    }
                    _ => found.push(Suspect { stretch: k, from, to: from + d + 1, size }),
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::trace::Samples;
    use super::*;

    pub fn motion(n: usize) -> Vec<i32> {
        (0..n).map(|i| (400.0 * (0.03 * i as f64).sin() + 150.0 * (0.11 * i as f64).cos()) as i32).collect()
    }

    #[test]
    fn a_spike_and_a_slip_pass_the_sieve_and_nothing_else_does() {
        let mut x = motion(40_000);
        assert_eq!(screen(&Trace::new(vec![Samples::Counts(&x)])), []);
        x[12_000] += 30;
        x[30_000..].iter_mut().for_each(|c| *c += 8);
        let found = screen(&Trace::new(vec![Samples::Counts(&x)]));
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].from <= 12_000 && found[0].to > 12_000, "{found:?}");
        assert!(found[1].from < 30_000 && found[1].to > 30_000, "{found:?}");
    }

    #[test]
    fn short_and_constant_stretches_have_no_suspect() {
        for n in [0, 1, 3, 7, 300] {
            let x = vec![5; n];
            assert_eq!(screen(&Trace::new(vec![Samples::Counts(&x)])), []);
        }
    }
}

//! Runs in which a channel that has noise goes along a straight line: values that were filled in.
//!
//! The second difference of a line is zero but for rounding, at most [`ULPS`] ulps of the greatest
//! value and two steps of values that were printed with so many digits. Noise does not stop: where
//! it is [`CLEAR`] times that on either side of a run, each second difference within it has a chance
//! of less than a quarter to be so small, so that [`FEWEST`] in a row are 10⁻¹⁰. A motion of
//! constant speed, free or in steps, is as noisy as any other and is not taken for one; nor is a
//! smooth curve, for what is beside the run must be rough: its sixth differences exceed its fourth
//! (by 3.6 where the noise is white; of a motion that is followed they are smaller). Constants are
//! [`super::frozen`]'s: a sensor with steps stands still where a motion turns round.
//!
//! Limits: fewer than [`FEWEST`] samples; counts, whose steps hide the line; records without noise,
//! and those whose noise a filter made smooth.

use super::trace::{Samples, Trace};
use crate::statistics::median;

/// Fewest second differences in a row.
pub const FEWEST: usize = 16;
/// Rounding of a second difference, ulps of the values: one and a half for each of the four terms
/// that an interpolation computes, and the difference's own.
const ULPS: f64 = 8.0;
/// Median fourth difference beside a run over the rounding within.
const CLEAR: f64 = 8.0;
/// Samples beside a run that tell its noise.
const BESIDE: usize = 32;
/// Samples next to a run that are passed over: differences across its ends.
const JOINT: usize = 1;

/// All runs (stretch, first sample, last + 1).
pub fn lines(trace: &Trace<'_>) -> Vec<(usize, usize, usize)> {
    let mut found = Vec::new();
    for (stretch, s) in trace.stretches.iter().enumerate() {
        let Samples::Values(x) = s else { continue };
        // Terms of an interpolation are as large as the channel where it passes zero.
        let size = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let rounding = ULPS * f64::EPSILON * size + 2.0 * trace.quantum.max(printed(x, size));
        let straight = |w: &[f64]| (w[0] - 2.0 * w[1] + w[2]).abs() <= rounding;
        let mut from = 0;
        for run in x.windows(3).collect::<Vec<_>>().chunk_by(|a, b| straight(a) == straight(b)) {
            let to = from + run.len();
            let slopes = (x[to + 1] - x[from]).abs() > rounding;
            if run.len() >= FEWEST && slopes && straight(run[0]) && noisy_beside(x, from, to + 2, rounding) {
                found.push((stretch, from, to + 2));
            }
            from = to;
        }
    }
    found
}

/// Step of values that were printed with so many decimals; 0 where they were not rounded.
fn printed(x: &[f64], size: f64) -> f64 {
    let mut decimals = 0;
    for v in x {
        // Of more digits than a number holds nothing is said.
        loop {
            let scale = 10f64.powi(decimals);
            if ULPS * f64::EPSILON * size * scale > 0.01 {
                return 0.0;
            }
            if (v * scale - (v * scale).round()).abs() <= ULPS * f64::EPSILON * size * scale {
                break;
            }
            decimals += 1;
        }
    }
    10f64.powi(-decimals)
}

/// Whether there is noise on either side of a run; an end of the stretch says nothing.
fn noisy_beside(x: &[f64], from: usize, to: usize, rounding: f64) -> bool {
    let before = from.checked_sub(BESIDE + JOINT).map(|a| &x[a..a + BESIDE]);
    let behind = x.get(to + JOINT..to + JOINT + BESIDE);
    let ends = (from == 0, to == x.len());
    let rough = |side: Option<&[f64]>, end: bool| side.map_or(end, |side| noisy(side, rounding));
    ends != (true, true) && rough(before, ends.0) && rough(behind, ends.1)
}

/// Whether what the samples leave of a smooth motion is noise above rounding.
fn noisy(x: &[f64], rounding: f64) -> bool {
    let of = |order: usize| {
        let mut d = x.to_vec();
        for _ in 0..order {
            d = d.windows(2).map(|w| w[1] - w[0]).collect();
        }
        d.iter_mut().for_each(|v| *v = v.abs());
        median(&mut d)
    };
    let (fourth, sixth) = (of(4), of(6));
    sixth > fourth && fourth > CLEAR * rounding
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(x: &[f64]) -> Vec<(usize, usize, usize)> {
        lines(&Trace::new(vec![Samples::Values(x)]))
    }

    /// Noise from −1 to 1.
    fn noise(i: usize) -> f64 {
        (43_758.545 * (12.9898 * i as f64).sin()).fract()
    }

    fn fill(x: &mut [f64], from: usize, to: usize) {
        let (a, b) = (x[from], x[to]);
        (from..to).for_each(|i| x[i] = a + (b - a) * (i - from) as f64 / (to - from) as f64);
    }

    #[test]
    fn what_was_filled_in_is_found_and_a_true_motion_is_not() {
        let motions: [&dyn Fn(f64) -> f64; 6] = [
            // Not around zero, and through it.
            &|t| 0.3 * (7.0 * t).sin() + 5.0,
            &|t| 0.3 * (7.0 * t + 1.0).sin(),
            // Constant speed, rest, and free flight between impacts.
            &|t| 2.0 * t,
            &|_| 0.125,
            &|t| 0.4 * (0.7 * t).fract().min((-0.7 * t).fract() + 1.0),
            // A drive that speeds up, cruises and brakes, over and over.
            &|t| {
                (0..4)
                    .map(|k| (t - f64::from(k)).clamp(0.0, 0.6).powi(2) + (t - f64::from(k) - 0.6).clamp(0.0, 0.3))
                    .sum()
            },
        ];
        for (k, motion) in motions.iter().enumerate() {
            for level in [0.0, 1e-6, 1e-3] {
                let clean: Vec<f64> = (0..4000).map(|i| motion(i as f64 * 1e-3) + level * noise(i)).collect();
                assert_eq!(of(&clean), [], "{k} {level}");
                for printed in [false, true] {
                    let print = |x: &mut [f64]| x.iter_mut().for_each(|v| *v = (*v * 1e6).round() * 1e-6);
                    let mut x = clean.clone();
                    if printed {
                        print(&mut x);
                        assert_eq!(of(&x), [], "{k} {level}");
                    }
                    fill(&mut x, 2000, 2300);
                    if printed {
                        print(&mut x);
                    }
                    // What rounding hides is not told, nor where there is no noise.
                    let hidden = level == 0.0 || printed && level < 1e-3;
                    let right =
                        |&(_, from, to): &(usize, usize, usize)| from.abs_diff(2000) < 2 && to.abs_diff(2301) < 2;
                    let found = of(&x);
                    assert!(
                        found.iter().all(right) && found.len() == usize::from(!hidden),
                        "{k} {level} {printed}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn steps_of_a_sensor_are_no_lines() {
        // An encoder in radians, fast and slow, and one that moves by whole steps.
        for speed in [0.002, 0.05, 1.0, 7.3] {
            let q = core::f64::consts::TAU / 1024.0;
            let x: Vec<f64> =
                (0..4000).map(|i| q * (speed * i as f64 + 3.0 * (0.01 * i as f64).sin()).floor()).collect();
            assert_eq!(of(&x), [], "{speed}");
        }
        // One whose steps were made finer, by lines of three and of four samples in turn, stands still
        // where the motion turns round.
        let step = |k: usize| core::f64::consts::TAU / 1024.0 * (75.0 * (0.02 * k as f64).sin()).round();
        let finer = |k: usize| {
            let n = 3 + k % 2;
            (0..n).map(move |i| step(k) + (step(k + 1) - step(k)) * i as f64 / n as f64)
        };
        let x: Vec<f64> = (0..1000).flat_map(finer).collect();
        assert_eq!(of(&x), []);
    }
}

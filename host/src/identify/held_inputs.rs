//! Measured inputs that are held from one change to the next, as an output of a converter is: u(t) =
//! u_k from the sample at which u_k first stands to the next.
//!
//! Between samples everything else takes inputs as band-limited; of one that jumps the samples alone
//! would act half a sample early. What acts within the band is s(t) = Σ_j u_j ∫ h(t − t′) dt′ over
//! the time from sample j to the next, h the low-pass that samples stand for
//! ([`crate::signal::band_limited`]); its samples take the place of those recorded. What jumps beyond
//! the band moves a mass by (Δ/π)² of a jump's acceleration at most.
//!
//! An input is held where nearly all that it changes by are jumps that stand alone, each with hardly
//! any change on both sides: neither a slow signal in the steps of a coarse converter nor a fast one
//! is, and noise on what is held is no jump. One that changes at every sample is taken for held where
//! the equations fit it half a sample early ([`taken_as_held`]).

use crate::record::{Column, Record};
use crate::rig::Rig;
use crate::signal::band_limited::{REACH, kernel};
use crate::warning::Warning;
use crate::wording::format::{plus_minus, significant};

/// Change over the input's rms from which it is a jump, share of the squares of all changes that jumps
/// have, and share of the jumps that stand alone (by hand: random steps change by 1.4 rms, a wave cut
/// into 20 steps by 0.07).
const JUMP: f64 = 0.1;
const BY_JUMPS: f64 = 0.99;
const ALONE: f64 = 0.9;
/// Parts of a sample over which the low-pass is integrated (Simpson).
const PARTS: usize = 16;

/// Whether an input, in all its stretches, is held between changes.
pub fn is_held<'a>(stretches: impl Iterator<Item = &'a [f64]> + Clone) -> bool {
    let count = stretches.clone().map(<[f64]>::len).sum::<usize>().max(1) as f64;
    let mean = stretches.clone().flatten().sum::<f64>() / count;
    let rms = (stretches.clone().flatten().map(|u| (u - mean).powi(2)).sum::<f64>() / count).sqrt();
    let (mut all, mut by_jumps, mut jumps, mut alone) = (0.0_f64, 0.0, 0.0_f64, 0.0);
    for u in stretches {
        let change = |i: usize| u.get(i).zip(u.get(i.wrapping_sub(1))).map_or(0.0, |(b, a)| b - a);
        let is_jump = |i: usize| change(i).abs() > JUMP * rms;
        for i in 1..u.len() {
            all += change(i).powi(2);
            if is_jump(i) {
                by_jumps += change(i).powi(2);
                jumps += 1.0;
                alone += f64::from(u8::from(!is_jump(i - 1) && !is_jump(i + 1)));
            }
        }
    }
    jumps > 0.0 && by_jumps >= BY_JUMPS * all && alone >= ALONE * jumps
}

/// Samples of what acts within the band where an input is held.
pub fn acting(u: &[f64]) -> Vec<f64> {
    let reach = REACH as i64;
    let part = |n: i64, i: usize| kernel(n as f64 - 1.0 + i as f64 / PARTS as f64);
    let weight = |i: usize| match i {
        0 | PARTS => 1.0,
        i if i % 2 == 1 => 4.0,
        _ => 2.0,
    };
    // Of the value that stood n samples ago.
    let integral = |n: i64| (0..=PARTS).map(|i| weight(i) * part(n, i)).sum::<f64>();
    let weights: Vec<f64> = (1 - reach..=reach).map(integral).collect();
    let sum: f64 = weights.iter().sum();
    let last = u.len() as i64 - 1;
    let at = |k: i64| {
        let of = |(n, w): (i64, &f64)| w * u[(k - n).clamp(0, last) as usize];
        (1 - reach..=reach).zip(&weights).map(of).sum::<f64>() / sum
    };
    (0..u.len() as i64).map(at).collect()
}

/// Samples within which an input that is early by half a sample is taken for held.
pub const HALF: f64 = 0.05;
/// Id of the warning that an input was taken for held.
const INPUT_HELD: &str = "input-held";

/// Whether a suspect is an input that is early by half a sample.
fn is_half_early(w: &Warning, rig: &Rig) -> Option<usize> {
    let input = w.details.get("channel")?.as_str()?;
    let samples = w.details.get("samples")?.as_f64()?;
    let channel = rig.channel.iter().position(|c| c.name == input)?;
    let is_input = rig.bound.as_ref().is_some_and(|b| b.inputs.contains(&channel) && b.base.is_none());
    (w.id == "channel-delay" && is_input && (samples + 0.5).abs() < HALF).then_some(channel)
}

/// Records in which an input acts as held from each sample to the next, and the warning that says
/// so, where suspects say that it is half a sample early.
pub fn taken_as_held(records: &[Record], rig: &Rig, suspects: &[Warning]) -> Option<(Vec<Record>, Warning)> {
    let (suspect, channel) = suspects.iter().find_map(|w| Some((w, is_half_early(w, rig)?)))?;
    let mut out = records.to_vec();
    for column in out.iter_mut().flat_map(|r| &mut r.segments).filter_map(|s| s.columns.get_mut(channel)) {
        let Column::Values(values) = column else { return None };
        *values = acting(values);
    }
    let of = |key: &str| suspect.details.get(key).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
    let name = &rig.channel[channel].name;
    let text = format!(
        "{name} is taken as an output that is held from each sample to the next: as a continuous signal it would be early by {} ms, {} of a sample",
        plus_minus(1e3 * of("value_s").abs(), 1e3 * crate::wording::format::Z95 * of("std_error_s")),
        significant(of("samples").abs(), 3)
    );
    let advice = "If it is no such output, shift its column by half a sample in the file";
    Some((out, Warning::new(INPUT_HELD, text, advice).with("channel", name.as_str())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::band_limited::BandLimited;

    fn held(levels: &[f64], each: usize) -> Vec<f64> {
        levels.iter().flat_map(|u| std::iter::repeat_n(*u, each)).collect()
    }

    #[test]
    fn steps_are_held_and_a_wave_in_steps_is_none() {
        let of = |u: &[f64]| is_held(std::iter::once(u));
        let levels: Vec<f64> = (0..40).map(|i| (7.3 * f64::from(i)).sin()).collect();
        assert!(of(&held(&levels, 5)));
        assert!(of(&held(&[0.0, 1.0], 50)));
        let noisy: Vec<f64> = held(&levels, 5).iter().zip(0..).map(|(u, i)| u + 1e-3 * f64::from(i * i % 7)).collect();
        assert!(of(&noisy));
        // Held at every sample: no change stands alone.
        assert!(!of(&levels));
        let wave =
            |steps: f64| -> Vec<f64> { (0..4000).map(|i| (steps * (0.01 * f64::from(i)).sin()).round()).collect() };
        assert!(!of(&wave(20.0)) && !of(&vec![1.0; 50]) && !of(&[]));
        // Blows of a hammer.
        let blow = |i: usize| if i % 100 < 6 { (std::f64::consts::PI * (i % 100) as f64 / 6.0).sin() } else { 0.0 };
        assert!(!of(&(0..1000).map(blow).collect::<Vec<f64>>()));
    }

    /// A mass under a force in steps: the second integral of what acts is that of the steps.
    #[test]
    fn a_mass_goes_where_the_steps_take_it() {
        let step = 0.005;
        let levels: Vec<f64> = (0..40).map(|i| (7.3 * f64::from(i)).sin()).collect();
        let u = held(&levels, 10);
        let between = BandLimited::new(&acting(&u), 0.0, step);
        let fine = 64;
        let (h, count) = (step / f64::from(fine), u.len() * fine as usize);
        let (mut x, mut v, mut truth, mut rate) = (0.0, 0.0, 0.0, 0.0);
        let mut worst = 0.0_f64;
        for i in 0..count {
            let (exact, acts) = (u[i / fine as usize], between.value((i as f64 + 0.5) * h));
            (truth, rate) = (truth + h * rate + 0.5 * h * h * exact, rate + h * exact);
            (x, v) = (x + h * v + 0.5 * h * h * acts, v + h * acts);
            worst = worst.max((v - rate).abs());
        }
        // What is beyond the band swings about a jump: the low-pass's step has 0.105 samples more or less
        // than a jump of one, and these go up to 0.97.
        assert!(worst < 0.12 * step, "{worst}");
        // No drift but that of what lies beyond the ends.
        assert!((x - truth).abs() < 0.02 * step, "{x} {truth}");
    }
}

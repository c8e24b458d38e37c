//! Frequencies above the low-pass at which a force may run in the laboratory's time (mains, a fan),
//! from what trajectories leave.
//!
//! Far above the motion's own frequencies a force A cos 2πft that accelerates what sensor s shows
//! by g_s(t) A cos 2πft moves it by −g_s A cos 2πft/(2πf)² at once. With r_s what trajectories leave
//! of it, in units of its noise,
//!
//! P(f) = |Σ_t Σ_s r_s g_s e^{2πift}|² / (½ Σ_t Σ_s g_s²)
//!
//! is χ² of two degrees of freedom, times what noise has there: one transform of the product r g
//! for each place. It finds a force whose lever swings with the motion, which has no line in r.

use core::f64::consts::{LN_2, TAU};

use super::candidates::Candidate;
use super::setting::Setting;
use super::shooting::Ground;
use super::shooting::left_over::LeftOver;
use super::state::State;
use crate::effects::entry::Entry;
use crate::signal::spectrum::fast_length;

/// Highest frequency, in units of the rate: above it a sample cannot tell it from one below half
/// the rate.
const HIGHEST: f64 = 0.48;
/// Points of the transform to one over the record.
const FINE: usize = 4;
/// Independent frequencies to either side of which the median is what noise has.
const AROUND: usize = 64;
/// Most frequencies that are returned, and the probability of returning any by chance.
const MOST_LINES: usize = 3;
const BY_CHANCE: f64 = 1e-3;
/// Longest series that is transformed, samples: gaps between stretches are part of it.
const LONGEST: usize = 1 << 22;

/// What is left times what a force moves, sample for sample along a record, and ½ Σ g².
struct Product {
    series: Vec<f64>,
    squares: f64,
}

/// The product for the k-th candidate, whose two columns are of a tone at `f` Hz: together they
/// give the lever of a tone of any frequency.
fn product(state: &State, all: &[LeftOver], k: usize, f: f64) -> Option<Product> {
    let origin = all.iter().map(|w| state.stretches[w.stretch].time(w.first)).fold(f64::INFINITY, f64::min);
    let mut out = Product { series: Vec::new(), squares: 0.0 };
    for w in all {
        let stretch = &state.stretches[w.stretch];
        let start = ((stretch.time(w.first) - origin) / stretch.step_s).round();
        let count = w.left.first().map_or(0, Vec::len);
        if !(0.0..(LONGEST - count.min(LONGEST)) as f64).contains(&start) {
            return None;
        }
        let start = start as usize;
        if out.series.len() < start + count {
            out.series.resize(start + count, 0.0);
        }
        for i in 0..count {
            let (sin, cos) = (TAU * f * stretch.time(w.first + i)).sin_cos();
            for (s, left) in w.left.iter().enumerate() {
                let lever = w.pushed[2 * k][s][i] * cos + w.pushed[2 * k + 1][s][i] * sin;
                out.series[start + i] += left[i] * lever;
                out.squares += 0.5 * lever * lever;
            }
        }
    }
    (out.squares > 0.0).then_some(out)
}

/// Peaks of a product's spectrum above a frequency, Hz: frequency and χ² of two degrees of freedom.
fn peaks(of: &Product, rate_hz: f64, above_hz: f64) -> Vec<(f64, f64)> {
    let length = fast_length(FINE * of.series.len());
    let mut input = of.series.clone();
    input.resize(length, 0.0);
    let plan = realfft::RealFftPlanner::new().plan_fft_forward(length);
    let mut spectrum = plan.make_output_vec();
    if plan.process(&mut input, &mut spectrum).is_err() {
        return Vec::new();
    }
    let power: Vec<f64> = spectrum.iter().map(|z| z.norm_sqr() / of.squares).collect();
    let spacing = rate_hz / length as f64;
    let (first, end) = ((above_hz / spacing) as usize + 1, (HIGHEST * rate_hz / spacing) as usize);
    let mut out = Vec::new();
    for m in first.max(1)..end.min(power.len().saturating_sub(1)) {
        if power[m] < power[m - 1] || power[m] < power[m + 1] {
            continue;
        }
        let around = (m.saturating_sub(FINE * AROUND)..(m + FINE * AROUND).min(power.len())).step_by(FINE);
        let mut near: Vec<f64> = around.map(|k| power[k]).collect();
        near.sort_by(f64::total_cmp);
        // Of χ² of two degrees of freedom the median is 2 ln 2. Noise that is less than even is not
        // taken for a level.
        let level = (near[near.len() / 2] / (2.0 * LN_2)).max(1.0);
        out.push((m as f64 * spacing, power[m] / level));
    }
    out
}

/// Candidates at frequencies above the low-pass that stand out, and among how many independent
/// ones. `of` gives the candidates of tones at some frequencies.
pub fn candidates(
    setting: &Setting<'_>,
    state: &State,
    of: &dyn Fn(Vec<f64>) -> Vec<Candidate>,
    looks: &dyn Fn(&Entry) -> bool,
) -> (Vec<Candidate>, f64) {
    let none = (Vec::new(), 1.0);
    let pass_hz = setting.geometry.kernels.full.pass_hz;
    // Columns at one frequency, any, give the levers of all.
    let probes: Vec<Candidate> = of(vec![pass_hz]).into_iter().filter(|c| looks(&c.entry)).collect();
    let further: Vec<&Candidate> = probes.iter().collect();
    let Some(ground) = Ground::new(setting, state).filter(|_| !probes.is_empty()) else { return none };
    let Some(all) = ground.left_over(&further) else { return none };
    let Some(step_s) = state.stretches.first().map(|s| s.step_s) else { return none };
    let found: Vec<Product> = (0..probes.len()).filter_map(|k| product(state, &all, k, pass_hz)).collect();
    let longest = found.iter().map(|p| p.series.len()).max().unwrap_or(0);
    let span_s = longest as f64 * step_s;
    let tests = (HIGHEST / step_s - pass_hz).max(0.0) * span_s * found.len() as f64;
    let mut all: Vec<(f64, f64)> = found.iter().flat_map(|p| peaks(p, 1.0 / step_s, pass_hz)).collect();
    all.retain(|p| p.1 > 2.0 * (tests.max(1.0) / BY_CHANCE).ln());
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut lines: Vec<f64> = Vec::new();
    for (f, _) in all {
        if lines.len() < MOST_LINES && lines.iter().all(|l| (l - f).abs() * span_s > 2.0) {
            lines.push(f);
        }
    }
    if lines.is_empty() { none } else { (of(lines), tests.max(1.0)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A tone whose lever swings about zero has no line in what is left; in the product it has.
    #[test]
    fn a_tone_with_a_lever_that_swings_stands_out_and_noise_does_not() {
        let (rate, f) = (500.0, 88.7);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let of = |size: f64, rng: &mut ChaCha8Rng| {
            let mut out = Product { series: Vec::new(), squares: 0.0 };
            for i in 0..20_000 {
                let t = f64::from(i) / rate;
                let lever = (7.1 * t + 2.0 * (3.3 * t).sin()).sin();
                let noise: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum();
                out.series.push(lever * (noise + size * lever * (TAU * f * t - 0.4).cos()));
                out.squares += 0.5 * lever * lever;
            }
            out
        };
        let greatest = |p: &Product| peaks(p, rate, 20.0).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        let limit = 2.0 * (0.48 * 20_000.0 / BY_CHANCE).ln();
        let (found, score) = greatest(&of(0.1, &mut rng));
        assert!((found - f).abs() < 0.02 && score > limit, "{found} {score}");
        for _ in 0..20 {
            let (at, score) = greatest(&of(0.0, &mut rng));
            assert!(score < limit, "{at} {score}");
        }
    }
}

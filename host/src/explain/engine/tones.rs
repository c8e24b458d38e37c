//! Frequencies at which a force in the laboratory's time may be missing (an imbalance, mains, a
//! fan), from trajectories: where motion is chaotic the residual of forces hides it in noise, which
//! grows with frequency squared.
//!
//! With λ(t) what is left of a window pulls on the accelerations at every instant
//! ([`super::shooting::adjoint`]) and g(t) those by a force of one, the products with columns of
//! cos 2πft and sin 2πft are the parts of
//!
//! P(f) = |Σ_t λ(t)ᵀ g(t) e^{2πift}|²,
//!
//! over all windows: one transform for each place holds every frequency. It finds a force whose
//! lever swings with the motion, which has no line in what is left. Columns change over 1/L in
//! frequency, L a window's length, and a force stands out over one by the record's length: in units
//! of half the mean around, which the median gives, P is χ² of two degrees of freedom where there
//! is nothing. What stands out is tried like any other candidate.

use core::f64::consts::{LN_2, TAU};

use super::candidates::Candidate;
use super::evidence::{Evidence, Outcome};
use super::setting::{Lines, Setting};
use super::shooting::Ground;
use super::shooting::adjoint::Pulled;
use super::state::State;
use crate::effects::entry::Entry;
use crate::signal::spectrum::fast_length;

/// Lowest frequency, in units of one over a window: what is slower is much like what an initial
/// state does.
const LOWEST: f64 = 0.5;
/// Highest frequency, in units of the rate: above it a sample cannot tell it from one below half
/// the rate.
const HIGHEST: f64 = 0.48;
/// Points of the transform to one over the record.
const FINE: usize = 4;
/// Fewest and most independent frequencies to either side of which the median is what noise has.
const AROUND: [usize; 2] = [16, 64];
/// Most frequencies that are returned.
const MOST_LINES: usize = 3;
/// Probability of returning any by chance.
const BY_CHANCE: f64 = 1e-3;
/// Longest series that is transformed, points: gaps between stretches are part of it.
const LONGEST: usize = 1 << 22;

/// λᵀ g along the record, point for point, for the candidate whose two columns are of a tone at `f`
/// Hz: together they give the lever of a tone of any frequency.
fn along(state: &State, all: &[Pulled], k: usize, f: f64, spacing_s: f64, each: usize) -> Option<Vec<f64>> {
    let begin = |w: &Pulled| state.stretches[w.stretch].time(w.first);
    let origin = all.iter().map(begin).fold(f64::INFINITY, f64::min);
    let mut out = Vec::new();
    for w in all {
        let own_s = state.stretches[w.stretch].step_s / each as f64;
        for (i, (c, s)) in w.products[2 * k].iter().zip(&w.products[2 * k + 1]).enumerate() {
            let t = begin(w) + i as f64 * own_s;
            let at = ((t - origin) / spacing_s).round();
            if !(0.0..LONGEST as f64).contains(&at) {
                return None;
            }
            let at = at as usize;
            if out.len() <= at {
                out.resize(at + 1, 0.0);
            }
            let (sin, cos) = (TAU * f * t).sin_cos();
            out[at] += c * cos + s * sin;
        }
    }
    out.iter().any(|x| *x != 0.0).then_some(out)
}

/// Peaks of a series' spectrum between two frequencies, Hz: frequency and χ² of two degrees of
/// freedom. `around` independent frequencies to either side tell what noise has.
fn peaks(of: &[f64], rate_hz: f64, [lowest_hz, highest_hz]: [f64; 2], around: usize) -> Vec<(f64, f64)> {
    let length = fast_length(FINE * of.len());
    let mut input = of.to_vec();
    input.resize(length, 0.0);
    let plan = realfft::RealFftPlanner::new().plan_fft_forward(length);
    let mut spectrum = plan.make_output_vec();
    if plan.process(&mut input, &mut spectrum).is_err() {
        return Vec::new();
    }
    let power: Vec<f64> = spectrum.iter().map(|z| z.norm_sqr()).collect();
    let spacing = rate_hz / length as f64;
    let (first, end) = ((lowest_hz / spacing).ceil() as usize, (highest_hz / spacing) as usize);
    let mut out = Vec::new();
    for m in first.max(1)..end.min(power.len().saturating_sub(1)) {
        if power[m] < power[m - 1] || power[m] < power[m + 1] {
            continue;
        }
        let near = (m.saturating_sub(FINE * around)..(m + FINE * around).min(power.len())).step_by(FINE);
        let mut near: Vec<f64> = near.map(|k| power[k]).collect();
        near.sort_by(f64::total_cmp);
        // Of χ² of two degrees of freedom the median is 2 ln 2.
        let level = near[near.len() / 2] / (2.0 * LN_2);
        out.push((m as f64 * spacing, power[m] / level.max(f64::MIN_POSITIVE)));
    }
    out
}

/// Candidates at frequencies that stand out of what is left, and among how many independent ones;
/// none where rows of the weak form are judged.
pub fn candidates(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> (Vec<Candidate>, f64) {
    let none = (Vec::new(), 1.0);
    let (Evidence::Shooting(_), Some(followed)) = (&outcome.evidence, &state.followed) else { return none };
    let looks = |e: &Entry| e.shapes.iter().any(|s| s.of_lines) && e.strengths.len() == 2;
    let ids: Vec<&str> = setting.entries.iter().filter(|e| looks(e)).map(|e| e.id.as_str()).collect();
    let is_wanted = |name: &str| name.split_once('@').is_some_and(|(id, _)| ids.contains(&id));
    let of = |lines: Vec<f64>| {
        let lines = Lines { of_forces: lines, ..Lines::default() };
        let mut all = setting.candidates_of(&state.physical, &lines, &is_wanted);
        all.retain(|c| looks(&c.entry));
        all
    };
    // Columns at one frequency, any, give the levers of all.
    let probe_hz = setting.geometry.kernels.full.pass_hz;
    let probes = of(vec![probe_hz]);
    let further: Vec<&Candidate> = probes.iter().collect();
    let Some(ground) = Ground::new(setting, state).filter(|_| !probes.is_empty()) else { return none };
    let (Some(all), Some(stretch)) = (ground.pulled(&further), state.stretches.first()) else { return none };
    let (count, window_s) = followed.windows(setting);
    let range_hz = [LOWEST / window_s, HIGHEST / stretch.step_s];
    let spacing_s = stretch.step_s / setting.points as f64;
    let series = |k: usize| along(state, &all, k, probe_hz, spacing_s, setting.points);
    let found: Vec<Vec<f64>> = (0..probes.len()).filter_map(series).collect();
    let span_s = found.iter().map(Vec::len).max().unwrap_or(0) as f64 * spacing_s;
    let tests = ((range_hz[1] - range_hz[0]).max(0.0) * span_s * found.len() as f64).max(1.0);
    let around = (count / 2).clamp(AROUND[0], AROUND[1]);
    let mut all: Vec<(f64, f64)> = found.iter().flat_map(|p| peaks(p, spacing_s.recip(), range_hz, around)).collect();
    all.retain(|p| p.1 > 2.0 * (tests / BY_CHANCE).ln());
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut lines: Vec<f64> = Vec::new();
    for (f, _) in all {
        if lines.len() < MOST_LINES && lines.iter().all(|l| (l - f).abs() * span_s > 2.0) {
            lines.push(f);
        }
    }
    if lines.is_empty() { none } else { (of(lines), tests) }
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
        let of = |size: f64, rng: &mut ChaCha8Rng| -> Vec<f64> {
            let at = |i: i32| {
                let t = f64::from(i) / rate;
                let lever = (7.1 * t + 2.0 * (3.3 * t).sin()).sin();
                let noise: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum();
                lever * (noise + size * lever * (TAU * f * t - 0.4).cos())
            };
            (0..20_000).map(at).collect()
        };
        let greatest =
            |p: &[f64]| peaks(p, rate, [20.0, 0.48 * rate], 64).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        let limit = 2.0 * (0.48 * 20_000.0 / BY_CHANCE).ln();
        let (found, score) = greatest(&of(0.1, &mut rng));
        assert!((found - f).abs() < 0.02 && score > limit, "{found} {score}");
        for _ in 0..20 {
            let (at, score) = greatest(&of(0.0, &mut rng));
            assert!(score < limit, "{at} {score}");
        }
    }
}

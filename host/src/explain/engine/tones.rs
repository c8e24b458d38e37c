//! Frequencies at which a force in the laboratory's time may be missing, from trajectories: where
//! motion is chaotic the residual of forces hides it in noise, which grows with frequency squared.
//!
//! An effect that looks at lines has two strengths, of cos 2πft and sin 2πft. Its columns over
//! windows of length L hold frequencies within 1/2L of theirs; one at f + δ turns from window to
//! window. With g_w = g_c + i g_s the products of both columns with what is left in window w and
//! G_w their squares,
//!
//! s(f + δ) = |Σ_w g_w e^{2πiδ t_w}|² / (½ Σ_w G_w)
//!
//! is χ² of two degrees of freedom where there is nothing (times the power of what is left): a
//! periodogram of trajectories instead of forces. What stands out is tried like any other
//! candidate.

use core::f64::consts::TAU;

use super::candidates::Candidate;
use super::evidence::{Evidence, Outcome};
use super::prediction::Range;
use super::setting::{Lines, Setting};
use super::state::State;
use super::{fast_tones, shooting};
use crate::effects::entry::Entry;

/// Spacing of the columns' frequencies and of the search between them, in units of one over a
/// window and over the record.
const COLUMNS: f64 = 0.5;
const FINE: f64 = 0.25;
/// Most frequencies of columns, and most that are returned.
const MOST_COLUMNS: f64 = 160.0;
const MOST_LINES: usize = 3;
/// Probability of returning any by chance.
const BY_CHANCE: f64 = 1e-3;

/// A frequency, Hz, and its score.
type Peak = (f64, f64);

/// What an effect of two strengths at a place and frequency shows.
fn best_near(at_hz: f64, scores: &[([f64; 3], f64)], spacing_hz: f64, fine_hz: f64) -> Peak {
    let squares = 0.5 * scores.iter().map(|(g, _)| g[2]).sum::<f64>();
    let steps = (0.5 * spacing_hz / fine_hz).ceil() as i32; // a few hundred
    let of = |k: i32| {
        let by_hz = f64::from(k) * fine_hz;
        let turned = scores.iter().map(|([c, s, _], t)| {
            let (sin, cos) = (TAU * by_hz * t).sin_cos();
            (c * cos - s * sin, c * sin + s * cos)
        });
        let (re, im) = turned.fold((0.0, 0.0), |sum, z| (sum.0 + z.0, sum.1 + z.1));
        (at_hz + by_hz, (re * re + im * im) / squares.max(f64::MIN_POSITIVE))
    };
    (-steps..=steps).map(of).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((at_hz, 0.0))
}

/// Candidates at frequencies that stand out of what is left, and among how many independent ones;
/// none where rows of the weak form are judged.
pub fn candidates(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> (Vec<Candidate>, f64) {
    let none = (Vec::new(), 1.0);
    let (Evidence::Shooting(_), Some(followed)) = (&outcome.evidence, &state.followed) else { return none };
    let looks = |e: &Entry| e.shapes.iter().any(|s| s.of_lines) && e.strengths.len() == 2;
    let ids: Vec<&str> = setting.entries.iter().filter(|e| looks(e)).map(|e| e.id.as_str()).collect();
    let is_wanted = |name: &str| name.split_once('@').is_some_and(|(id, _)| ids.contains(&id));
    let (_, window_s) = followed.windows(setting);
    let spacing_hz = COLUMNS / window_s;
    // Few: the cast cuts the fraction.
    let count = (setting.geometry.kernels.full.pass_hz / spacing_hz).min(MOST_COLUMNS) as usize;
    let grid: Vec<f64> = (1..=count).map(|k| k as f64 * spacing_hz).collect();
    let of = |lines: Vec<f64>| {
        let lines = Lines { of_forces: lines, ..Lines::default() };
        let mut all = setting.candidates_of(&state.physical, &lines, &is_wanted);
        all.retain(|c| looks(&c.entry));
        all
    };
    let all = of(grid);
    let further: Vec<&Candidate> = all.iter().collect();
    let Some(blocks) = shooting::evidence(setting, state, &further, false, &[]) else { return none };
    let time = |r: &Range| state.stretches[r.stretch].time((r.begin + r.end) / 2);
    let times: Vec<f64> = blocks.places.iter().map(time).collect();
    let span_s = times.iter().fold(0.0_f64, |m, t| m.max((t - times[0]).abs())) + window_s;
    let left = blocks.misfits(&outcome.fit.all).iter().map(|w| w[0]).sum::<f64>() / times.len().max(1) as f64;
    let tests = (all.len() as f64 * spacing_hz * span_s / FINE).max(1.0);
    let least = 2.0 * (tests / BY_CHANCE).ln() * left.max(1.0);
    let mut at = outcome.own.len();
    let mut peaks: Vec<Peak> = Vec::new();
    for candidate in &all {
        let scores: Vec<([f64; 3], f64)> =
            blocks.scores(&outcome.fit.all, [at, at + 1]).into_iter().zip(times.iter().copied()).collect();
        at += candidate.strengths();
        let Some((_, f)) = candidate.form.first() else { continue };
        peaks.push(best_near(*f, &scores, spacing_hz, FINE / span_s));
    }
    peaks.retain(|p| p.1 > least);
    peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut lines: Vec<f64> = Vec::new();
    for (f, _) in peaks {
        if lines.len() < MOST_LINES && lines.iter().all(|l| (l - f).abs() * span_s > 2.0) {
            lines.push(f);
        }
    }
    if lines.is_empty() {
        return fast_tones::candidates(setting, state, &of, &looks);
    }
    (of(lines), (tests * FINE).max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tone of 3.217 Hz in windows of 2 s at columns of 3.25 Hz: found to a share of one over the
    /// record, with the score that its strength has.
    #[test]
    fn a_tone_between_columns_is_found_by_its_turning() {
        let (f, at, psi) = (3.217, 3.25, 0.7);
        let scores: Vec<([f64; 3], f64)> = (0..30)
            .map(|w| {
                let t = 1.0 + 2.0 * f64::from(w);
                // C = A cos φ, S = −A sin φ, φ = 2π(f − f_c) t − ψ, by columns whose squares are 50
                // each.
                let phi = TAU * (f - at) * t - psi;
                ([0.4 * 50.0 * phi.cos(), -0.4 * 50.0 * phi.sin(), 100.0], t)
            })
            .collect();
        let (found, score) = best_near(at, &scores, 0.25, 0.25 / 60.0);
        assert!((found - f).abs() < 0.25 / 60.0, "{found}");
        let expected = 0.16 * 30.0 * 50.0;
        assert!((score / expected - 1.0).abs() < 0.1, "{score} {expected}");
    }
}

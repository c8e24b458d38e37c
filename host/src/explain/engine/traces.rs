//! Effects that are nothing beside the others: their strengths are within standard errors of none.

use super::candidates::Candidate;
use super::evidence::Outcome;
use super::setting::Setting;
use super::state::{Chosen, State};
use super::tell;
use crate::explain::ranking::Fit;

/// Standard errors from nothing at which a name stands: of ten records of Duffing's oscillator with
/// nothing hidden one had a tone below it, 0.035 ± 0.019 N (docs/explain/how-often-right.md).
const CLEAR: f64 = 2.0;
/// The same of a frequency, the best of N independent ones: √(2 ln N) by noise alone, N some
/// thousand (one of the 151 clean records of the battery had such a tone).
const CLEAR_OF_MANY: f64 = 4.0;

/// Whether an effect is the best of the frequencies that were looked at.
pub fn is_of_many(candidate: &Candidate) -> bool {
    candidate.entry.shapes.iter().any(|s| s.of_lines)
}

/// The effect that is furthest from being anything, if one is within [`CLEAR`] standard errors of
/// nothing.
pub fn without_trace(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<usize> {
    let mut at = state.values.len();
    let mut weakest: Option<(usize, f64)> = None;
    for (k, chosen) in state.chosen.iter().enumerate() {
        // What is found as an increment has its strength in the state.
        let applied = if chosen.candidate.is_applied() { 1.0 } else { 0.0 };
        let errors = errors_at_shape(&outcome.fit, at, chosen.candidate.entry.strengths.len(), chosen.strengths.len());
        let clear = errors.iter().enumerate().map(|(i, error)| {
            (outcome.fit.all[at + i] + applied * chosen.strengths[i]).abs() / error.max(f64::MIN_POSITIVE)
        });
        // Nor does a name stand whose value is within them.
        let clear = clear.fold(0.0, f64::max).min(value_over_error(setting, state, outcome, at, chosen));
        at += chosen.strengths.len();
        // The best of many frequencies is that far from nothing by noise alone.
        let clear = if is_of_many(&chosen.candidate) { clear * CLEAR / CLEAR_OF_MANY } else { clear };
        if k >= state.nominal && clear < CLEAR && weakest.is_none_or(|w| clear < w.1) {
            weakest = Some((k, clear));
        }
    }
    weakest.map(|w| w.0).filter(|_| setting.shooting)
}

/// The value that is told of an effect, whose columns begin at `at`, over its standard error.
fn value_over_error(setting: &Setting<'_>, state: &State, outcome: &Outcome, at: usize, chosen: &Chosen) -> f64 {
    let d = chosen.strengths.len();
    let applied = if chosen.candidate.is_applied() { 1.0 } else { 0.0 };
    let values: Vec<f64> = (0..d).map(|i| outcome.fit.all[at + i] + applied * chosen.strengths[i]).collect();
    let covariance = outcome.fit.covariance.view((at, at), (d, d)).into_owned();
    let (told, _) = tell::value(setting, &state.physical, &chosen.candidate, &values, &covariance);
    // Held at nothing by its sign it has no error either.
    if told.value == 0.0 {
        return 0.0;
    }
    let ratio = (told.value / told.std_error).abs();
    if ratio.is_nan() { f64::INFINITY } else { ratio }
}

/// Standard errors of an effect's strengths, the first of its columns from `at` on, with its shape
/// held: at a strength of nothing there is no shape.
fn errors_at_shape(fit: &Fit, at: usize, strengths: usize, columns: usize) -> Vec<f64> {
    let own = fit.covariance.view((at, at), (strengths, strengths)).into_owned();
    let by = fit.covariance.view((at, at + strengths), (strengths, columns - strengths)).into_owned();
    let shape = fit.covariance.view((at + strengths, at + strengths), (columns - strengths, columns - strengths));
    let held = match shape.into_owned().try_inverse() {
        Some(inverse) => &own - &by * inverse * by.transpose(),
        None => own.clone(),
    };
    (0..strengths).map(|i| held[(i, i)].max(0.0).sqrt()).collect()
}

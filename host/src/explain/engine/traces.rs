//! Effects that are nothing beside the others: their strengths are no further from none than the
//! best of all forms that are tried would be by chance.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Normal};

use super::candidates::Candidate;
use super::evidence::Outcome;
use super::setting::Setting;
use super::state::{Chosen, State};
use super::tell;
use crate::explain::decision::OF_A_FAMILY;

/// Frequencies that a tone is the best of, where they were not counted (by hand).
const FREQUENCIES: f64 = 1000.0;

/// Standard errors from nothing of a value that is told (95 %).
const BORNE_OUT: f64 = 2.0;

/// Standard errors from nothing at which a name stands, the best of so many forms: that at which it
/// is taken, 2 (1 − Φ(z)) N = [`OF_A_FAMILY`]. What came in while others were missing, and is less
/// beside them, would not come in now.
fn clear_of(forms: f64) -> f64 {
    let tail = 0.5 * OF_A_FAMILY / forms.max(1.0);
    Normal::new(0.0, 1.0).map_or(f64::INFINITY, |n| -n.inverse_cdf(tail))
}

/// Whether an effect is the best of the frequencies that were looked at.
pub fn is_of_many(candidate: &Candidate) -> bool {
    candidate.entry.shapes.iter().any(|s| s.of_lines)
}

/// The effect that is furthest from being anything, if one is within the standard errors that
/// chance gives the best of all forms; their number.
pub fn without_trace(setting: &Setting<'_>, state: &State, outcome: &Outcome) -> Option<(usize, f64)> {
    let forms = outcome.candidates.len() as f64;
    // The errors that are told.
    let fit = (&outcome.fit.all, &outcome.covariance());
    let limit = |c: &Candidate| clear_of(if is_of_many(c) { forms.max(FREQUENCIES) } else { forms });
    weakest(setting, state, fit, &limit).filter(|_| setting.shooting)
}

/// The same by a fit that tells more than that by which effects were found: of a name that stands
/// the value that is told is no nothing.
pub fn not_borne_out(setting: &Setting<'_>, state: &State, fit: (&DVector<f64>, &DMatrix<f64>)) -> Option<usize> {
    weakest(setting, state, fit, &|_| BORNE_OUT).map(|w| w.0)
}

/// The effect that is furthest from a limit of standard errors among those within it; the limit.
fn weakest(
    setting: &Setting<'_>,
    state: &State,
    (all, covariance): (&DVector<f64>, &DMatrix<f64>),
    limit: &dyn Fn(&Candidate) -> f64,
) -> Option<(usize, f64)> {
    let mut at = state.values.len();
    let mut weakest: Option<(usize, f64, f64)> = None;
    for (k, chosen) in state.chosen.iter().enumerate() {
        let errors = errors_at_shape(covariance, at, chosen.candidate.entry.strengths.len(), chosen.strengths.len());
        let values = chosen.values(all, at);
        let clear = errors.iter().zip(values).map(|(error, x)| x.abs() / error.max(f64::MIN_POSITIVE));
        // Nor does a name stand whose value is within them.
        let value = value_over_error(setting, state, (all, covariance), at, chosen);
        let clear = clear.fold(0.0, f64::max).min(value);
        at += chosen.strengths.len();
        let limit = limit(&chosen.candidate);
        let clear = clear / limit;
        if k >= state.nominal && clear < 1.0 && weakest.is_none_or(|w| clear < w.1) {
            weakest = Some((k, clear, limit));
        }
    }
    weakest.map(|w| (w.0, w.2))
}

/// The value that is told of an effect, whose columns begin at `at`, over its standard error.
fn value_over_error(
    setting: &Setting<'_>,
    state: &State,
    (all, covariance): (&DVector<f64>, &DMatrix<f64>),
    at: usize,
    chosen: &Chosen,
) -> f64 {
    let d = chosen.strengths.len();
    let values = chosen.values(all, at);
    let covariance = covariance.view((at, at), (d, d)).into_owned();
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
fn errors_at_shape(covariance: &DMatrix<f64>, at: usize, strengths: usize, columns: usize) -> Vec<f64> {
    let own = covariance.view((at, at), (strengths, strengths)).into_owned();
    let by = covariance.view((at, at + strengths), (strengths, columns - strengths)).into_owned();
    let shape = covariance.view((at + strengths, at + strengths), (columns - strengths, columns - strengths));
    let held = match shape.into_owned().try_inverse() {
        Some(inverse) => &own - &by * inverse * by.transpose(),
        None => own.clone(),
    };
    (0..strengths).map(|i| held[(i, i)].max(0.0).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a per cent over all forms, on both sides.
    #[test]
    fn the_more_forms_are_tried_the_clearer_a_name_must_be() {
        for (forms, errors) in [(1.0, 2.807), (100.0, 4.056), (1000.0, 4.565)] {
            assert!((clear_of(forms) - errors).abs() < 2e-3, "{forms}: {}", clear_of(forms));
        }
        assert_eq!(clear_of(0.0), clear_of(1.0));
    }
}

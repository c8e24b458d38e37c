//! The comparisons that a validation can fail on. See the head of [`super`] for when each does.

use super::{Check, Pair, Validation, natural_frequencies};
use crate::statistics::Z95;
use crate::wording::format::{in_seconds, significant};

/// Times the noise from which a prediction ran away.
const RAN_AWAY: f64 = 1e6;
/// Standard errors by which two invariants may differ.
const STANDARD_ERRORS: f64 = 3.0;
/// Share of the larger by which they must differ as well: two records of one rig (120 s, 1024
/// counts) gave dimensions of 4.16 and 3.18, which the estimator's own standard error, taken within
/// one record, does not show.
const CLEARLY_DIFFERENT: f64 = 1.0 / 3.0;
/// Probability by chance below which sections count as different.
const SECTIONS_DIFFER: f64 = 0.01;
/// Share of the model's own median horizon that the record's must reach, and with fewer starts than
/// [`MANY_STARTS`], whose medians scatter more.
const HORIZON_SHARE: [f64; 2] = [0.65, 0.5];
/// Times that predictions may miss the record by what they miss the model's own (by hand: a gap of
/// 1.3 is what explanations take for noise).
const ERROR_RATIO: f64 = 2.0;
/// Starts from which medians are known to about a tenth.
const MANY_STARTS: usize = 30;

/// Every check that can be made.
pub(super) fn checks(v: &Validation) -> Vec<Check> {
    let mut out = Vec::new();
    let mut check = |name, passed, message| out.push(Check { name, passed, message });
    let (measured, simulated) = (v.horizon.measured.median(), v.horizon.simulated.median());
    let few = v.horizon.measured.seconds.len().min(v.horizon.simulated.seconds.len()) < MANY_STARTS;
    let share = HORIZON_SHARE[usize::from(few)];
    // Predictions that all last to the record's end say nothing against the model.
    let unended = 2 * v.horizon.measured.unended >= v.horizon.measured.seconds.len();
    if !v.horizon.measured.seconds.is_empty() {
        check(
            "prediction-horizon",
            unended || measured >= share * simulated,
            format!(
                "median {} on the record, {} on the model's own{}",
                in_seconds(measured),
                in_seconds(simulated),
                if unended && measured < share * simulated {
                    ": most last to the record's end".to_owned()
                } else {
                    format!(", of which at least {:.0} % is asked for", 100.0 * share)
                }
            ),
        );
    }
    // Where a record of the model's own is followed to its end nothing but the noise is in the way. One
    // that is missed by more there is of a motion in which errors grow, those of parameters as well,
    // which its own record does not have.
    let lasts = 2 * v.horizon.simulated.unended >= v.horizon.simulated.seconds.len();
    let whole = lasts && v.horizon.simulated.error[1] <= ERROR_RATIO;
    let [measured, simulated] = [&v.horizon.measured, &v.horizon.simulated].map(|h| h.error[usize::from(whole)]);
    if measured.is_finite() && simulated.is_finite() {
        let over =
            if whole { "to their end".to_owned() } else { format!("over {} s", significant(2.0 * v.horizon.fit_s, 3)) };
        check(
            "prediction-error",
            measured <= ERROR_RATIO * simulated.max(1.0),
            format!(
                "predictions miss the record {over} by {} times its sensors' noise, the model's own by {}; up to {ERROR_RATIO} times that is taken",
                times(measured),
                times(simulated)
            ),
        );
    }
    let tests: Vec<f64> = v.sections.iter().filter_map(|s| s.test.map(|t| t.p_value)).collect();
    if let Some(least) = tests.iter().copied().reduce(f64::min) {
        let p = (least * tests.len() as f64).min(1.0);
        check(
            "poincare-section",
            p >= SECTIONS_DIFFER,
            format!(
                "sections as different as these come by chance with probability {p:.3} (the least of {} phases\u{2019} probabilities, times their number)",
                tests.len()
            ),
        );
    }
    let pair = |p: &Pair, unit: &str| {
        format!(
            "{:.3} ± {:.3}{unit} in the record, {:.3} ± {:.3}{unit} in the model's own: {:.1} standard errors{}",
            p.measured,
            Z95 * p.measured_std_error,
            p.simulated,
            Z95 * p.simulated_std_error,
            p.deviation(),
            match (p.deviation() <= STANDARD_ERRORS, agree(p)) {
                (false, true) => ", but within a third of each other, as two records of one rig can be",
                (false, false) => ", and more than a third apart",
                _ => "",
            }
        )
    };
    if let Some(p) = v.lyapunov.and_then(|l| l.records) {
        check("lyapunov-exponent", agree(&p), pair(&p, " /s"));
    }
    if let Some(p) = &v.correlation_dimension {
        check("correlation-dimension", agree(p), pair(p, ""));
    }
    if let Some((f, measured)) = v.natural_frequencies.as_ref().and_then(|f| Some((f, f.measured_hz?))) {
        let agrees = f.model_hz.iter().zip(measured).all(|(a, b)| (a / b - 1.0).abs() <= natural_frequencies::AGREES);
        let [a, b] = f.model_hz;
        check(
            "natural-frequencies",
            agrees,
            format!(
                "{a:.3} and {b:.3} Hz in the model, {:.3} and {:.3} Hz in the free vibration",
                measured[0], measured[1]
            ),
        );
    }
    out
}

/// Whether an invariant's two values may be those of one system.
fn agree(p: &Pair) -> bool {
    let larger = p.measured.abs().max(p.simulated.abs());
    p.deviation() <= STANDARD_ERRORS || (p.measured - p.simulated).abs() <= CLEARLY_DIFFERENT * larger
}

/// How many times something is the noise; a motion that ran away has no number that says more.
fn times(x: f64) -> String {
    if x > RAN_AWAY { "more than a million".to_owned() } else { significant(x, 3) }
}

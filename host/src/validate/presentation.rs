//! A validation in a few lines for a terminal.

use std::fmt::Write;

use super::{Validation, Verdict};
use crate::wording::format::{Z95, fixed, plus_minus, significant};

/// The answer for people.
pub fn human(v: &Validation) -> String {
    let mut out = String::new();
    let mut line = |text: String| {
        let _ = writeln!(out, "{text}");
    };
    line(format!(
        "{} (identified by {}): validation {}",
        v.model,
        crate::identify::presentation::method_name(&v.method),
        if v.verdict == Verdict::Passed { "passed" } else { "FAILED" }
    ));
    let h = &v.horizon;
    let times = h.median_lyapunov_times.map_or_else(String::new, |[m, s]| {
        format!(" = {} and {} Lyapunov times", significant(m, 2), significant(s, 2))
    });
    line(format!(
        "  prediction within {}: median {}{} s on the record, {} s on the model's own{times} ({} starts, fitted over {} s)",
        h.within,
        if 2 * h.measured.unended > h.measured.seconds.len() { "at least " } else { "" },
        significant(h.measured.median(), 3),
        significant(h.simulated.median(), 3),
        h.measured.seconds.len(),
        significant(h.fit_s, 3)
    ));
    for s in &v.sections {
        if let Some(t) = &s.test {
            line(format!(
                "  section at τ = {}: mean energy distance {} from those of the model's own records, one of which is as far from the others with probability {}",
                fixed(s.tau, 3),
                significant(t.distance, 2),
                significant(t.p_value, 2)
            ));
        }
    }
    // What the records' own exponents, dimensions and frequencies are, the checks below say.
    if let Some(l) = &v.lyapunov {
        line(format!("  largest exponent {} /s by the model", plus_minus(l.model, Z95 * l.model_std_error)));
    }
    if let Some(o) = &v.orbits {
        line(format!(
            "  periodic orbits: {} in the record, {} in the model's own; of the record's best {}, {} are orbits of the model",
            o.measured.iter().sum::<usize>(),
            o.simulated.iter().sum::<usize>(),
            o.refined.len(),
            o.refined.iter().filter(|r| r.refined.is_some()).count()
        ));
    }
    if let Some(f) = v.natural_frequencies.as_ref().filter(|f| f.measured_hz.is_none()) {
        let [a, b] = f.model_hz;
        line(format!("  natural frequencies {} and {} Hz in the model", significant(a, 4), significant(b, 4)));
    }
    for c in &v.checks {
        // What failed stands whole on the card.
        line(match c.passed {
            true => format!("  passed: {}: {}", c.name, c.message),
            false => format!("  FAILED: {} (above)", c.name),
        });
    }
    out
}

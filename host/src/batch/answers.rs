//! The cells of an identification, an explanation and a validation, under the names that their JSON
//! has.

use std::fmt::Write;

use super::row::{Row, of_parameter};
use crate::explain::{Explanation, Found, Verdict};
use crate::identify::{Identification, Parameter};
use crate::validate::{Pair, Validation, Verdict as Validated};

/// Values, standard errors and units.
fn parameters(row: &mut Row, parameters: &[Parameter]) {
    let mut units = String::new();
    for p in parameters {
        let column = of_parameter(&p.name);
        row.number(&column, p.value);
        row.number(&format!("{column}_std_error"), p.std_error);
        let between = if units.is_empty() { "" } else { "; " };
        // Writing into a string cannot fail.
        let _ = write!(units, "{between}{column} {}", p.unit);
    }
    row.text("units", units);
}

/// Of an identification.
pub fn identification(row: &mut Row, result: &Identification) {
    let verdict = match (result.within_bound(), result.warnings.iter().any(|w| w.invalidates)) {
        (false, _) => "beyond-error-bound",
        (true, true) => "cannot-stand",
        (true, false) => "identified",
    };
    row.text("verdict", verdict);
    row.text("model", &result.model);
    row.text("method", &result.method);
    row.text("not_by_shooting", result.not_by_shooting.as_deref().unwrap_or(""));
    // What was used; rows of the device have no samples that could be counted elsewhere.
    row.integer("samples", result.record.samples);
    row.integer("lost", result.record.lost);
    row.integer("segments", result.record.segments);
    row.integer("equations_used", result.equations_used);
    row.integer("equations_dropped", result.equations_dropped);
    row.number("identification_error", result.identification_error.iter().copied().fold(f64::NAN, f64::max));
    let groups: Vec<String> = result.groups_not_separable.iter().map(|g| g.join(", ")).collect();
    row.text("groups_not_separable", groups.join("; "));
    parameters(row, &result.parameters);
}

fn effect(row: &mut Row, number: usize, found: &Found) {
    let column = |rest: &str| format!("effect{number}_{rest}");
    row.text(&column("id"), &found.id);
    row.text(&column("at"), &found.at);
    row.number(&column("value"), found.value);
    row.number(&column("std_error"), found.std_error);
    row.text(&column("unit"), &found.unit);
    let beyond: Vec<String> = found.parameters.iter().map(|(name, value)| format!("{name}={value:?}")).collect();
    row.text(&column("parameters"), beyond.join("; "));
    row.text(&column("indistinguishable_from"), found.indistinguishable_from.join("+"));
}

/// Of an explanation.
pub fn explanation(row: &mut Row, result: &Explanation) {
    row.text(
        "verdict",
        match result.verdict {
            Verdict::NothingMissing => "nothing-missing",
            Verdict::Explained => "explained",
            Verdict::Unexplained => "unexplained",
            Verdict::NotDecidable => "not-decidable",
        },
    );
    row.text("reason", result.reason.to_string());
    let names: Vec<String> = result.effects.iter().map(Found::name).collect();
    row.text("effects", names.join("+"));
    if let Some(by) = &result.decided_by {
        row.text("decided_by", by.what.to_string());
        row.number("decided_by_value", by.value);
        row.number("decided_by_limit", by.limit);
    }
    if let (Some(first), Some(last)) = (result.gap.steps.first(), result.gap.steps.last()) {
        row.text("gap_unit", result.gap.unit);
        row.number("gap_horizon_s", result.gap.horizon_s);
        row.number("gap_before", first.value);
        row.number("gap_after", last.value);
    }
    row.number("residual_power_before", result.residual_power[0]);
    row.number("residual_power_after", result.residual_power[1]);
    parameters(row, &result.parameters);
    result.effects.iter().enumerate().for_each(|(i, found)| effect(row, i + 1, found));
}

fn pair(row: &mut Row, name: &str, of: &Pair) {
    row.number(&format!("{name}_measured"), of.measured);
    row.number(&format!("{name}_measured_std_error"), of.measured_std_error);
    row.number(&format!("{name}_simulated"), of.simulated);
    row.number(&format!("{name}_simulated_std_error"), of.simulated_std_error);
}

/// Of a validation.
pub fn validation(row: &mut Row, result: &Validation) {
    row.text("verdict", if result.verdict == Validated::Passed { "passed" } else { "failed" });
    row.text("model", &result.model);
    row.text("method", &result.method);
    let checks = |passed: bool| -> String {
        let names: Vec<&str> = result.checks.iter().filter(|c| c.passed == passed).map(|c| c.name).collect();
        names.join("+")
    };
    row.text("checks_passed", checks(true));
    row.text("checks_failed", checks(false));
    row.number("simulated_s", result.simulated_s);
    row.number("horizon_measured_s", result.horizon.measured.median());
    row.number("horizon_simulated_s", result.horizon.simulated.median());
    let tests = result.sections.iter().filter_map(|s| s.test.as_ref());
    row.number("section_p_value", tests.map(|t| t.p_value).fold(f64::NAN, f64::min));
    if let Some(exponent) = &result.lyapunov {
        row.number("lyapunov_model", exponent.model);
        row.number("lyapunov_model_std_error", exponent.model_std_error);
        if let Some(of) = &exponent.records {
            pair(row, "lyapunov", of);
        }
    }
    if let Some(of) = &result.correlation_dimension {
        pair(row, "correlation_dimension", of);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::row::Cell;

    #[test]
    fn an_identification_becomes_cells() {
        let p =
            |name: &str, std_error: f64| Parameter { name: name.into(), value: 2.0, std_error, unit: "s⁻²".into() };
        let result = Identification {
            parameters: vec![p("B11", 0.5), p("lost", f64::NAN)],
            identification_error: vec![0.02, 0.3],
            groups_not_separable: vec![vec!["B11".into(), "B12".into()], vec!["C2".into()]],
            ..Identification::default()
        };
        let mut row = Row::default();
        identification(&mut row, &result);
        assert_eq!(row.text_of("verdict"), "beyond-error-bound");
        assert_eq!(row.text_of("units"), "B11 s⁻²; parameter_lost s⁻²");
        assert_eq!(row.text_of("groups_not_separable"), "B11, B12; C2");
        assert_eq!(row.get("B11_std_error"), Some(&Cell::Number(0.5)));
        assert_eq!(row.get("parameter_lost"), Some(&Cell::Number(2.0)));
        assert_eq!(row.get("parameter_lost_std_error"), None);
        assert_eq!(row.get("identification_error"), Some(&Cell::Number(0.3)));
    }
}

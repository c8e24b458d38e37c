//! An identification as report sections print it.

use super::Identification;
use crate::report::figures::residuals::EquationResiduals;
use crate::report::sections::parameters::{Parameter, ParameterTable};
use crate::report::sections::residuals::ResidualSet;
use crate::wording::format::{percent, significant};

/// χ² over its degrees of freedom above which coefficients contradict each other: by chance below
/// 10⁻⁴ for four degrees of freedom.
const TOO_LARGE: f64 = 6.0;

/// A method in words.
pub fn method_name(method: &str) -> &str {
    match method {
        "weak" => "the weak form",
        "shooting" => "multiple shooting",
        "explain" => "`whirl explain`",
        "frequency" => "harmonic balance of long pieces",
        "upo" => "harmonic balance of extracted orbits",
        other => other,
    }
}

/// The identification error, and what the sensors' noise explains of it.
pub fn error(result: &Identification) -> String {
    let list = |of: &[f64]| of.iter().map(|e| percent(*e, 2)).collect::<Vec<_>>().join(", ");
    let expected = &result.details.expected_error;
    format!(
        "the equations balance to {} of their largest term{}{}",
        list(&result.identification_error),
        if expected.is_empty() {
            String::new()
        } else {
            format!("; what this record's sensors leave is {}", list(expected))
        },
        if result.within_bound() { String::new() } else { format!(" (up to {} is taken)", bounds(result)) }
    )
}

/// The bounds of the identification error, one where all equations have the same.
pub fn bounds(result: &Identification) -> String {
    let mut all: Vec<String> = result.error_bounds().iter().map(|b| percent(*b, 2)).collect();
    all.dedup();
    all.join(", ")
}

/// The parameter table; `truth` gives a parameter's true value where a simulation knows it.
pub fn table(result: &Identification, heading: &str, truth: &dyn Fn(&str) -> Option<f64>) -> ParameterTable {
    let d = &result.details;
    let errors_from = if d.jackknife_blocks > 0 {
        format!("jackknife over {} blocks", d.jackknife_blocks)
    } else {
        "independent rows assumed, since there are too few windows or orbits for a jackknife".to_owned()
    };
    let mut notes = vec![match &result.balance {
        Some(account) => format!(
            "Harmonic balance of {} orbits or pieces, sub-harmonics up to {:.2} Hz, {}. {} of {} rows used. Standard errors: {errors_from}; ± is \
             1.96 of them. They do not show the jump where an orbit fails to close, which is alike in all orbits.",
            account.orbits.len(),
            d.max_frequency_hz,
            account.cut_off_hz.map_or("no low-pass".to_owned(), |f| format!("factors low-passed at {f:.0} Hz")),
            result.equations_used,
            result.equations_used + result.equations_dropped
        ),
        None => format!(
            "Weak form over {} windows of {} s with test frequencies up to {} Hz; signals smoothed up to {} Hz (signs of velocities: \
         {} Hz). Standard errors: {}; ± is 1.96 of them.",
            d.windows,
            significant(d.window_s, 3),
            significant(d.max_frequency_hz, 3),
            significant(d.pass_hz, 3),
            significant(d.sign_pass_hz, 3),
            errors_from
        ),
    }];
    if let Some(s) = &result.shooting {
        let list = |x: &[f64]| x.iter().map(|v| significant(*v, 3)).collect::<Vec<_>>().join(", ");
        notes[0] = format!(
            "Multiple shooting over {} pieces of {} s (levels {} s), step of integration {} ms, {} rounds, started from the weak form. Residuals are {} times \
             the sensors' noise. Standard errors: {}; ± is 1.96 of them.",
            s.pieces,
            s.levels_s.last().map_or_else(String::new, |l| significant(*l, 3)),
            list(&s.levels_s),
            significant(1e3 * s.step_s, 3),
            s.rounds,
            list(&s.noise_ratio),
            if d.jackknife_blocks > 0 {
                format!("jackknife over {} blocks of pieces", d.jackknife_blocks)
            } else {
                "white noise assumed, since there are too few pieces for a jackknife".to_owned()
            }
        );
    }
    notes.push(format!(
        "Identification error, largest residual over largest value, equation by equation: {}.",
        error(result)
    ));
    if let Some((misfit, freedom)) = d.ties_misfit {
        // A warning has its own number, of intervals that hold for correlated residuals.
        let told = result.warnings.iter().any(|w| w.id == "tie-violated");
        let number = format!(" (χ² = {}, expected {freedom})", significant(misfit, 4));
        notes.push(format!(
            "{}{}: arms with moments of inertia J_o1 and J_o2 have B11/B21 = J_o2/J_o1 = C12/C2 and B12/B15 = B22/B25.",
            if misfit > TOO_LARGE * freedom as f64 {
                "The coefficients contradict each other, so that the equations miss something; run `whirl explain`"
            } else {
                "The coefficients agree with each other"
            },
            if told { "" } else { &number }
        ));
    }
    ParameterTable {
        heading: heading.to_owned(),
        parameters: result
            .parameters
            .iter()
            .map(|p| Parameter {
                name: p.name.clone(),
                value: p.value,
                std_error: p.std_error,
                unit: p.unit.clone(),
                truth: truth(&p.name),
            })
            .collect(),
        notes,
    }
}

/// Residuals against predictions, as in figure 3.14.
pub fn residuals(result: &Identification) -> ResidualSet {
    ResidualSet {
        equations: result
            .residuals
            .iter()
            .enumerate()
            .map(|(i, r)| EquationResiduals {
                title: format!("equation {}", i + 1),
                symbol: format!("q_{{{}}}", i + 1),
                unit: "s".to_owned(),
                predicted: r.dots.iter().map(|d| d.1).collect(),
                // The dots hold measured minus predicted; the figure shows A λ − q.
                residual: r.dots.iter().map(|d| -d.2).collect(),
                error: result.identification_error[i],
            })
            .collect(),
    }
}

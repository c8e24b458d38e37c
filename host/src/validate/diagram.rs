//! A bifurcation diagram of the identified model over a factor on one of its parameters.

use super::Bifurcation;
use super::comparisons::Comparisons;
use crate::error::{BadInput, Result};
use crate::model::flow::Outside;
use crate::phase_space::bifurcation;

/// Values of a bifurcation diagram's parameter.
const BIFURCATION_VALUES: usize = 240;

/// The diagram, where one was asked for, from a state at the drive's phase `tau` on.
///
/// # Errors
/// A free system, a parameter that there is not, a range that is none.
pub(super) fn diagram(of: &Comparisons<'_>, tau: f64, state: &[f64]) -> Result<Option<Bifurcation>> {
    let Comparisons { starts, equations, circle, settings, .. } = of;
    let (omega, step_s) = (starts.pace.omega, starts.step_s);
    let Some((parameter, low, high)) = &settings.bifurcation else { return Ok(None) };
    let names = &equations.names;
    let bad = |found: String, expected: String| Err(BadInput::new(found, expected).at("--bifurcation"));
    if omega <= 0.0 {
        return bad(
            "a free system".to_owned(),
            "a driven one: a diagram shows the section once a drive period".to_owned(),
        );
    }
    if !(low.is_finite() && high.is_finite() && low < high) {
        return bad(format!("{low}:{high}"), "two factors, the lower first".to_owned());
    }
    let which: Vec<usize> = (0..names.len())
        .filter(|i| if parameter == "drive" { equations.of_drive[*i] } else { names[*i] == *parameter })
        .collect();
    if which.is_empty() {
        return bad(format!("\"{parameter}\""), format!("drive, or one of {}", names.join(", ")));
    }
    let factor: Vec<f64> =
        (0..BIFURCATION_VALUES).map(|i| low + (high - low) * i as f64 / (BIFURCATION_VALUES - 1) as f64).collect();
    let sets: Vec<Vec<f64>> = factor
        .iter()
        .map(|f| {
            let mut p = equations.parameters.clone();
            which.iter().for_each(|i| p[*i] *= f);
            p
        })
        .collect();
    let choice = bifurcation::Settings { settle: 200, keep: 60, step_s };
    let columns =
        bifurcation::bifurcation(&*equations.dynamics, &sets, Outside::drive(0.0, tau, omega), state, circle, &choice);
    Ok(Some(Bifurcation { parameter: parameter.clone(), factor, columns, of: of.labels() }))
}

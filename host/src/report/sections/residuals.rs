//! Residuals against predictions, with the identification error ε = ‖e‖∞/‖q̂‖∞ of each equation.

use serde::Serialize;

use crate::report::figures::residuals::{EquationResiduals, residuals};
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::percent;

/// Residuals of an identification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ResidualSet {
    /// The equations.
    pub equations: Vec<EquationResiduals>,
}

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "residuals", title: "Residuals", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for set in results.all::<ResidualSet>().filter(|s| !s.equations.is_empty()) {
        let caption = "Residual against prediction; the dots are sub-harmonics of a window.";
        body.figure(&residuals(caption, &set.equations));
        let row = |e: &EquationResiduals| vec![Html::text(&e.title), Html::text(&percent(e.error, 3))];
        let rows: Vec<Vec<Html>> = set.equations.iter().map(row).collect();
        body.table(
            &[
                (Html::text(""), Align::Left),
                (Html("ε = ‖<i>e</i>‖<sub>∞</sub> / ‖<i>q̂</i>‖<sub>∞</sub>".to_owned()), Align::Right),
            ],
            &rows,
        );
    }
    (body != Html::new()).then_some(body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_told_beside_the_dots() {
        let mut results = Results::new();
        results.add(ResidualSet {
            equations: vec![EquationResiduals {
                title: "equation 2".into(),
                symbol: "q_{2}".into(),
                predicted: vec![1.0, -2.0],
                residual: vec![0.1, 0.2],
                error: 0.094,
                ..EquationResiduals::default()
            }],
        });
        let html = render(&results).unwrap().0;
        assert!(html.contains("9.40\u{a0}%") && html.contains("<svg") && html.contains("sub-harmonics"), "{html}");
    }
}

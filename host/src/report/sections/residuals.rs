//! Residuals against predictions, with the identification error ε = ‖e‖∞/‖q̂‖∞ of each equation.

use serde::Serialize;

use crate::report::figures::residuals::{Residuals, residuals};
use crate::report::format::{count, percent};
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};

/// One equation's residuals as an identification returns them.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct EquationResiduals {
    /// Title, such as `equation 1`.
    pub title: String,
    /// Symbol of the predicted quantity, `q_{1}` (`_{…}` is a subscript).
    pub symbol: String,
    /// Unit; empty or `1` for none.
    pub unit: String,
    /// Predictions A λ.
    pub predicted: Vec<f64>,
    /// Residuals A λ − q.
    pub residual: Vec<f64>,
    /// Whether each was used; all were where this is empty.
    pub used: Vec<bool>,
    /// ε.
    pub error: f64,
}

/// Residuals of an identification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ResidualSet {
    /// Heading; may be empty.
    pub heading: String,
    /// What one dot is, in the plural: `sub-harmonics`, `windows`.
    pub dots: String,
    /// The equations.
    pub equations: Vec<EquationResiduals>,
}

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "residuals", title: "Residuals", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for set in results.all::<ResidualSet>().filter(|s| !s.equations.is_empty()) {
        if !set.heading.is_empty() {
            body.heading(&set.heading);
        }
        let panels: Vec<Residuals> = set
            .equations
            .iter()
            .map(|e| Residuals {
                title: e.title.clone(),
                symbol: e.symbol.clone(),
                unit: e.unit.clone(),
                predicted: e.predicted.clone(),
                residual: e.residual.clone(),
                used: e.used.clone(),
            })
            .collect();
        let caption = format!("Residual against prediction; the dots are {}.", set.dots);
        body.figure(&residuals(&caption, &panels));
        let rows: Vec<Vec<Html>> = set
            .equations
            .iter()
            .map(|e| {
                let dropped = e.used.iter().filter(|u| !**u).count();
                let text = |s: String| Html::text(&s);
                let used = count((e.predicted.len() - dropped.min(e.predicted.len())) as u64);
                vec![Html::text(&e.title), text(used), text(count(dropped as u64)), text(percent(e.error, 3))]
            })
            .collect();
        let head = |t: &str, a| (Html::text(t), a);
        body.table(
            &[
                head("", Align::Left),
                head("used", Align::Right),
                head("dropped", Align::Right),
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
    fn error_and_dropped_equations_are_told() {
        let mut results = Results::new();
        results.add(ResidualSet {
            heading: String::new(),
            dots: "sub-harmonics".into(),
            equations: vec![EquationResiduals {
                title: "equation 2".into(),
                symbol: "q_{2}".into(),
                predicted: vec![1.0, -2.0],
                residual: vec![0.1, 0.2],
                used: vec![true, false],
                error: 0.094,
                ..EquationResiduals::default()
            }],
        });
        let html = render(&results).unwrap().0;
        assert!(html.contains("9.40 %") && html.contains("<svg") && html.contains("sub-harmonics"), "{html}");
    }
}

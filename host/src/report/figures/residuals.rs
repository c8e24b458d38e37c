//! Residual against prediction, one dot an equation (a sub-harmonic, a window): the dissertation's
//! figures 3.14 and 3.15.

use serde::Serialize;

use super::Figure;
use super::axis::Axis;
use super::canvas::{Panel, Rule, Series, Shape};
use super::scatter::scatter;

/// One equation's residuals.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct EquationResiduals {
    /// Title of the panel, such as `equation 1`.
    pub title: String,
    /// Symbol of the predicted quantity, `q_{1}` (`_{…}` is a subscript).
    pub symbol: String,
    /// Unit of both; empty or `1` for none.
    pub unit: String,
    /// Predictions q̂ = A λ.
    pub predicted: Vec<f64>,
    /// Residuals e = A λ − q.
    pub residual: Vec<f64>,
    /// ε = ‖e‖∞/‖q̂‖∞ over all that was used, not these dots alone.
    pub error: f64,
}

/// Draws one panel for each equation, two in a row.
pub fn residuals(caption: &str, equations: &[EquationResiduals]) -> Figure {
    let panels: Vec<Panel> = equations
        .iter()
        .map(|e| {
            let unit = if e.unit.is_empty() || e.unit == "1" { String::new() } else { format!(" / {}", e.unit) };
            let x = Axis::linear(format!("predicted {}{unit}", e.symbol));
            let mut panel = Panel::new(e.title.clone(), x, Axis::linear(format!("residual{unit}")));
            let dots = Series::new("", Shape::BigDots, e.predicted.clone(), e.residual.clone());
            panel.series.push(dots.colour(0));
            panel.rules.push(Rule { vertical: false, at: 0.0, label: String::new() });
            panel
        })
        .collect();
    let columns = if equations.len() > 1 { 2 } else { 1 };
    scatter(caption, columns, 280.0, &panels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_equation_has_its_panel() {
        let of = |k: u32| EquationResiduals {
            title: format!("equation {k}"),
            predicted: vec![1.0, 2.0, 3.0],
            residual: vec![0.1, -0.1, 0.9],
            ..EquationResiduals::default()
        };
        let figure = residuals("figure 3.14", &[of(1), of(2)]);
        assert!(figure.svg.contains("equation 1") && figure.svg.contains("equation 2"), "{}", figure.svg);
        assert!(figure.csv.contains("3,0.9"), "{}", figure.csv);
    }
}

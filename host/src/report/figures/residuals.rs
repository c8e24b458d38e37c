//! Residual against prediction, one dot an equation (a sub-harmonic, a window): the dissertation's
//! figures 3.14 and 3.15.

use super::Figure;
use super::axis::Axis;
use super::canvas::{Panel, Rule, Series, Shape};
use super::scatter::scatter;

/// One equation's residuals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Residuals {
    /// Title of the panel, such as `equation 1`.
    pub title: String,
    /// Symbol of the predicted quantity, `q_{1}`.
    pub symbol: String,
    /// Unit of both; empty or `1` for none.
    pub unit: String,
    /// Predictions q̂ = A λ.
    pub predicted: Vec<f64>,
    /// Residuals e = A λ − q.
    pub residual: Vec<f64>,
    /// Whether each was used in the fit; all were where this is empty.
    pub used: Vec<bool>,
}

/// Draws one panel for each equation, two in a row.
pub fn residuals(caption: &str, equations: &[Residuals]) -> Figure {
    let dropped = equations.iter().any(|e| e.used.iter().any(|u| !u));
    let panels: Vec<Panel> = equations
        .iter()
        .map(|e| {
            let unit = if e.unit.is_empty() || e.unit == "1" { String::new() } else { format!(" / {}", e.unit) };
            let x = Axis::linear(format!("predicted {}{unit}", e.symbol));
            let mut panel = Panel::new(e.title.clone(), x, Axis::linear(format!("residual{unit}")));
            let pick = |used: bool| -> (Vec<f64>, Vec<f64>) {
                let all = e.predicted.iter().zip(&e.residual).enumerate();
                all.filter(|(i, _)| e.used.get(*i).copied().unwrap_or(true) == used).map(|(_, (p, r))| (*p, *r)).unzip()
            };
            let (x, y) = pick(true);
            panel.series.push(Series::new(if dropped { "used" } else { "" }, Shape::BigDots, x, y).colour(0));
            if dropped {
                let (x, y) = pick(false);
                panel.series.push(Series::new("dropped", Shape::BigDots, x, y).colour(1));
            }
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
    fn used_and_dropped_are_told_apart() {
        let e = Residuals {
            title: "equation 2".into(),
            symbol: "q_{2}".into(),
            predicted: vec![1.0, 2.0, 3.0],
            residual: vec![0.1, -0.1, 0.9],
            used: vec![true, true, false],
            ..Residuals::default()
        };
        let figure = residuals("figure 3.14", &[e]);
        assert_eq!(figure.rows, 2);
        assert!(figure.svg.contains("dropped") && figure.csv.contains("3,0.9"));
    }
}

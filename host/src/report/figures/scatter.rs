//! Scatter and orbits: phase portraits, Poincaré sections.

use super::Figure;
use super::canvas::{Layout, Panel, Series, Shape};
use super::decimate;

/// Most points of one series.
pub const MOST: usize = 4000;

/// Draws panels side by side, `columns` in a row; long series of dots are thinned to every k-th
/// point (lines are not: give them points enough to be smooth, and no more).
pub fn scatter(caption: &str, columns: usize, height: f64, panels: &[Panel]) -> Figure {
    let thin = |s: &Series| {
        if matches!(s.shape, Shape::Line | Shape::Thin) {
            return s.clone();
        }
        let pick = |v: &[f64]| decimate::stride(v.len(), MOST).map(|i| v[i]).collect::<Vec<f64>>();
        Series { x: pick(&s.x), y: pick(&s.y), low: pick(&s.low), high: pick(&s.high), ..s.clone() }
    };
    let thin: Vec<Panel> =
        panels.iter().map(|p| Panel { series: p.series.iter().map(thin).collect(), ..p.clone() }).collect();
    Figure::draw(caption, &Layout { columns, height, ..Layout::default() }, &thin)
}

#[cfg(test)]
mod tests {
    use super::super::axis::Axis;
    use super::*;

    #[test]
    fn long_scatters_stay_small() {
        let x: Vec<f64> = (0..200_000).map(|i| (f64::from(i) * 0.7).sin()).collect();
        let y: Vec<f64> = (0..200_000).map(|i| (f64::from(i) * 1.1).cos()).collect();
        let mut panel = Panel::new("", Axis::angle("θ / rad"), Axis::linear("ω / (rad/s)"));
        panel.series.push(Series::new("", Shape::Dots, x, y));
        let figure = scatter("many", 2, 300.0, &[panel]);
        assert!(figure.rows <= MOST && figure.svg.len() < 60_000, "{} {}", figure.rows, figure.svg.len());
    }
}

//! Frequency response: magnitude on logarithmic axes above phase.

use super::Figure;
use super::axis::Axis;
use super::canvas::{Panel, Series, Shape};
use super::lines::lines;

/// One response.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// Name in the legend.
    pub name: String,
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// Magnitudes.
    pub magnitude: Vec<f64>,
    /// Phases, rad.
    pub phase: Vec<f64>,
    /// Measured points (dots) rather than a model (line).
    pub measured: bool,
}

/// Draws magnitude and phase; `label`: quantity and unit of the magnitude.
pub fn response(caption: &str, label: &str, responses: &[Response]) -> Figure {
    let frequency = || Axis::log("frequency / Hz");
    let mut magnitude = Panel::new("", frequency(), Axis::log(label));
    let mut phase = Panel::new("", frequency(), Axis::angle("phase / rad"));
    magnitude.shares_x = true;
    for r in responses {
        let shape = if r.measured { Shape::Dots } else { Shape::Line };
        let wrapped = r.phase.iter().map(|p| crate::signal::angles::wrap(*p)).collect();
        magnitude.series.push(Series::new(r.name.clone(), shape, r.frequency_hz.clone(), r.magnitude.clone()));
        phase.series.push(Series::new(r.name.clone(), Shape::Dots, r.frequency_hz.clone(), wrapped));
    }
    lines(caption, 190.0, &[magnitude, phase])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_panels_hold_the_response() {
        let f: Vec<f64> = (1..200).map(|i| 0.1 * f64::from(i)).collect();
        let magnitude = f.iter().map(|f| 1.0 / (1.0 - (f / 5.0).powi(2)).abs().max(0.01)).collect();
        let phase = f.iter().map(|f| if *f > 5.0 { -3.0 } else { 0.0 }).collect();
        let r = Response { name: "model".into(), frequency_hz: f, magnitude, phase, measured: false };
        let figure = response("receptance", "|x/F| / (m/N)", &[r]);
        assert_eq!(figure.rows, 199);
        assert!(figure.svg.contains("frequency / Hz") && figure.svg.contains("π/2"));
    }
}

//! Panels that several chapters' figures share.

use std::f64::consts::{PI, TAU};

use super::chapter3::DELAY;
use crate::identify::Identification;
use crate::identify::harmonic_balance::account::Function;
use crate::identify::harmonic_balance::orbit::{MARGIN, Orbit};
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};
use crate::statistics::Z95;

/// To [−π, π).
pub fn wrapped(x: f64) -> f64 {
    (x + PI).rem_euclid(TAU) - PI
}

/// A wrapped angle against another, as dots; at most some thousand.
pub fn portrait(title: &str, labels: [&str; 2], x: impl Iterator<Item = f64>, y: impl Iterator<Item = f64>) -> Panel {
    let mut panel = Panel::new(title, Axis::angle(labels[0]), Axis::angle(labels[1]));
    panel.series.push(Series::new("", Shape::Dots, x.map(wrapped).collect(), y.map(wrapped).collect()));
    panel
}

/// Every value and the one `delay` samples later.
pub fn delayed(x: &[f64], delay: usize) -> (Vec<f64>, Vec<f64>) {
    let n = x.len().saturating_sub(delay);
    (x[..n].to_vec(), x[x.len() - n..].to_vec())
}

/// The three views of an orbit of the double pendulum that figures 3.3 to 3.10 show: θ1–θ1(t + dt),
/// θ1–θ2, θ2–θ2(t + dt).
pub fn views(theta1: &[f64], theta2: &[f64]) -> Vec<Panel> {
    let ((a, b), (c, d)) = (delayed(theta1, DELAY), delayed(theta2, DELAY));
    vec![
        portrait("(a)", ["θ_{1}(t) / rad", "θ_{1}(t + dt) / rad"], a.into_iter(), b.into_iter()),
        portrait("(b)", ["θ_{1}(t) / rad", "θ_{2}(t) / rad"], theta1.iter().copied(), theta2.iter().copied()),
        portrait("(c)", ["θ_{2}(t) / rad", "θ_{2}(t + dt) / rad"], c.into_iter(), d.into_iter()),
    ]
}

/// The samples of an orbit: θ1 and θ2 = φ2 − φ1.
pub fn angles(orbit: &Orbit) -> [Vec<f64>; 2] {
    let n = orbit.len();
    let part = |c: usize| &orbit.phi[c][MARGIN..MARGIN + n];
    [part(0).to_vec(), part(1).iter().zip(part(0)).map(|(b, a)| b - a).collect()]
}

/// A curve over sample numbers.
pub fn curve(title: &str, label: &str, y: Vec<f64>) -> Panel {
    let mut panel = Panel::new(title, Axis::linear("sample k"), Axis::linear(label));
    panel.series.push(Series::new("", Shape::Thin, (0..y.len()).map(|i| i as f64).collect(), y));
    panel
}

/// An identified function with its band, the true one, and the nodes.
pub fn function(f: &Function, truth: impl Fn(f64) -> f64, nodes: usize) -> Panel {
    let mut panel = Panel::new("", Axis::angle("θ / rad"), Axis::linear(format!("{}(θ)", f.name)));
    let true_values = f.angle.iter().map(|x| truth(*x)).collect();
    panel.series.push(Series::new("true", Shape::Line, f.angle.clone(), true_values).colour(1));
    let stride = (f.angle.len() - 1).checked_div(nodes).unwrap_or(4);
    let at: Vec<usize> = (0..f.angle.len()).step_by(stride.max(1)).collect();
    let pick = |g: &dyn Fn(usize) -> f64| at.iter().map(|i| g(*i)).collect::<Vec<f64>>();
    panel.series.push(Series::new("", Shape::Thin, f.angle.clone(), f.value.clone()).colour(0));
    let mut dots =
        Series::new("identified, 95 % interval", Shape::Intervals, pick(&|i| f.angle[i]), pick(&|i| f.value[i]));
    dots.low = pick(&|i| f.value[i] - Z95 * f.std_error[i]);
    dots.high = pick(&|i| f.value[i] + Z95 * f.std_error[i]);
    panel.series.push(dots.colour(0));
    panel
}

/// Residuals of equation `e` against predictions, as figures 3.14, 3.15 and 4.5 show them.
pub fn residuals(title: &str, found: &Identification, e: usize) -> Panel {
    let mut panel = Panel::new(title, Axis::linear(format!("predicted q_{{{}}}", e + 1)), Axis::linear("residual e"));
    if let Some(r) = found.residuals.get(e) {
        let (x, y): (Vec<f64>, Vec<f64>) = r.dots.iter().map(|d| (d.1, -d.2)).unzip();
        panel.series.push(Series::new("one sub-harmonic each", Shape::BigDots, x, y));
    }
    panel
}

//! The forced, damped response of the polar model in closed form, with its folds.
//!
//! M ẍ + c M ẋ + ∂V/∂x = F b cos Ωt, answered by x(a, Ωt − δ), the free motion's shape. Averaging
//! the Lagrangian over the phase (Whitham) and balancing the power gives sin δ = 2cΩ T2/(F bᵀX_1),
//! Ω² = ω² − F bᵀX_1′ cos δ/T2′, T2 = ⟨x_φᵀ M x_φ⟩, a prime d/da, ω the free frequency at a. The
//! second is Ω ≈ ω ∓ ½F d(bᵀX_1)/dI cos δ to first order (I = ωT2). On the branch below ω, cos δ >
//! 0; both meet at the greatest amplitude, sin δ = 1. Folds are where Ω turns along the curve.
//! Errors are of second order in the damping ratio.

use serde::Serialize;

use super::polar::Polar;
use super::systems::Mechanical;

/// Points on each branch.
const POINTS: usize = 200;

/// What drives and damps the system.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Forcing {
    /// F: with `shape` the force on each coordinate, in the unit of mass × coordinate/s².
    pub amplitude: f64,
    /// b.
    pub shape: Vec<f64>,
    /// c, 1/s, proportional to mass.
    pub damping: f64,
}

/// A point of the response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Angular frequency of the force.
    pub omega: f64,
    /// First harmonic of the major coordinate.
    pub amplitude: f64,
    /// Lag δ of the motion behind the force, rad.
    pub lag: f64,
}

/// The response curve.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ForcedResponse {
    /// From the branch below the backbone over the greatest amplitude to the one above.
    pub curve: Vec<Point>,
    /// Where the frequency turns, in the order of the curve: the upper fold of a hardening mode
    /// first.
    pub folds: Vec<Point>,
}

/// One amplitude: sin δ (above 1 where the force cannot hold it up) and both frequencies.
fn at(
    polar: &Polar,
    system: Option<&dyn Mechanical>,
    masses: Option<&[f64]>,
    f: &Forcing,
    a: f64,
    side: f64,
) -> Option<Point> {
    let averages = polar.averages(system, masses, a)?;
    let push = |x: &[Vec<f64>]| x.get(1).map_or(0.0, |x| x.iter().zip(&f.shape).map(|(x, b)| x * b).sum::<f64>());
    let (along, slope) = (f.amplitude * push(&polar.harmonics(a)), f.amplitude * push(&polar.slopes(a)));
    let mut omega = averages.omega_squared.sqrt();
    // Ω stands on both sides; it changes by parts in a thousand.
    for _ in 0..100 {
        let sine = 2.0 * f.damping * omega * averages.inertia / along;
        if !sine.is_finite() || sine.abs() > 1.0 + 1e-12 {
            return None;
        }
        let cosine = side * (1.0 - sine.min(1.0).powi(2)).max(0.0).sqrt();
        let square = averages.omega_squared - slope * cosine / averages.inertia_slope;
        // Beyond half and twice the frequency the averages say nothing.
        if !(square > 0.25 * averages.omega_squared && square < 4.0 * averages.omega_squared) {
            return None;
        }
        let next = square.sqrt();
        let moved = (next / omega - 1.0).abs();
        omega = next;
        if moved < 1e-14 {
            return Some(Point { omega, amplitude: a, lag: sine.min(1.0).atan2(cosine) });
        }
    }
    None
}

/// The response within the model's range of amplitudes; none of it where even the least amplitude
/// cannot be held.
///
/// `system` where the equations are known, otherwise the interpolated frequency and `masses` (1
/// where none are given).
pub fn response(
    polar: &Polar,
    system: Option<&dyn Mechanical>,
    masses: Option<&[f64]>,
    forcing: &Forcing,
) -> ForcedResponse {
    let point = |a: f64, side: f64| at(polar, system, masses, forcing, a, side);
    let both = |a: f64| point(a, 1.0).is_some() && point(a, -1.0).is_some();
    // Far from resonance one mode does not answer alone; the amplitudes from where it does to where
    // the force cannot hold them.
    let scale = |i: usize| polar.range[1] * 10.0_f64.powf(3.0 * (i as f64 / POINTS as f64 - 1.0));
    let grid: Vec<f64> = (0..=POINTS).map(scale).filter(|a| *a >= polar.range[0]).collect();
    let Some(first) = grid.iter().position(|a| both(*a)) else { return ForcedResponse::default() };
    let last = (first..grid.len()).take_while(|i| both(grid[*i])).last().unwrap_or(first);
    let (least, mut high) = (grid[first], grid[last]);
    if let Some(&beyond) = grid.get(last + 1) {
        let mut above = beyond;
        for _ in 0..60 {
            let middle = 0.5 * (high + above);
            if both(middle) { high = middle } else { above = middle }
        }
    }
    // a = a_max (1 − u²): smooth over the top, u from −1 (below the backbone) to 1 (above).
    let most = (1.0 - least / high).sqrt();
    let on = |u: f64| point(high * (1.0 - u * u), if u < 0.0 { 1.0 } else { -1.0 });
    let curve: Vec<(f64, Point)> = (0..=2 * POINTS)
        .filter_map(|i| {
            let u = most * (i as f64 / POINTS as f64 - 1.0);
            Some((u, on(u)?))
        })
        .collect();
    let mut folds = Vec::new();
    for w in curve.windows(3) {
        let (before, after) = (w[1].1.omega - w[0].1.omega, w[2].1.omega - w[1].1.omega);
        // At the end of the range both branches stop apart: that is no fold.
        if before * after >= 0.0 || (w[0].0 < 0.0 && w[2].0 > 0.0 && high >= polar.range[1]) {
            continue;
        }
        if let Some(fold) = turn(&on, w[0].0, w[2].0, before.signum()) {
            folds.push(fold);
        }
    }
    ForcedResponse { curve: curve.into_iter().map(|(_, p)| p).collect(), folds }
}

/// The extremum of Ω between two points, by golden section.
fn turn(on: &impl Fn(f64) -> Option<Point>, mut low: f64, mut high: f64, sign: f64) -> Option<Point> {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (left, right) = (high - golden * (high - low), low + golden * (high - low));
        if sign * on(left)?.omega > sign * on(right)?.omega { high = right } else { low = left }
    }
    on(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::super::polar::{self, Node};
    use super::*;

    /// A linear oscillator's response is known: amplitude F/√((1 − Ω²)² + c²Ω²), no fold.
    #[test]
    fn a_linear_oscillators_response_is_the_known_one() {
        let node = |a: f64| Node {
            amplitude: a,
            omega: 1.0,
            error: 1e-9,
            shape: vec![vec![0.0], vec![1.0]],
            spread: vec![0.0],
        };
        let model = polar::model(&[node(0.5), node(1.0), node(4.0)], &[1.0], None).unwrap();
        let forcing = Forcing { amplitude: 0.05, shape: vec![1.0], damping: 0.02 };
        let response = response(&model, None, None, &forcing);
        assert!(response.folds.is_empty() && response.curve.len() > 100, "{:?}", response.folds);
        for p in &response.curve {
            let want = 0.05 / ((1.0 - p.omega.powi(2)).powi(2) + (0.02 * p.omega).powi(2)).sqrt();
            assert!((p.amplitude / want - 1.0).abs() < 1e-9, "{p:?} {want}");
        }
    }
}

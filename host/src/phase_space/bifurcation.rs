//! Bifurcation diagram: the Poincaré section of a model over a parameter.
//!
//! For each value the solution starts from the same state, runs `settle` drive periods that are not
//! shown, and then gives its coordinates once a period, at the phase at which it started. A
//! period-k orbit is k points, chaos a cloud. A free system has no such section.

use core::f64::consts::TAU;

use rayon::prelude::*;
use serde::Serialize;

use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Outside, Work};
use crate::model::model_file::equations_of_motion::wrapped;

/// Choices.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Drive periods that are not shown.
    pub settle: usize,
    /// Drive periods shown.
    pub keep: usize,
    /// Longest step of integration, s.
    pub step_s: f64,
}

/// One value of the parameter: a point (q wrapped where it is an angle, then q̇) for each period;
/// empty where the equations have no solution.
pub type Column = Vec<Vec<f64>>;

/// Sections for each set of parameters, from `state` at the time and phase of `outside`. `angles`:
/// which coordinates are wrapped to [−π, π). The columns are computed in parallel and do not depend
/// on each other.
pub fn bifurcation<D: Dynamics + ?Sized>(
    dynamics: &D,
    sets: &[Vec<f64>],
    outside: Outside<'_>,
    state: &[f64],
    angles: &[bool],
    settings: &Settings,
) -> Vec<Column> {
    if outside.omega <= 0.0 || outside.inputs.is_some() {
        return vec![Column::new(); sets.len()];
    }
    let period = TAU / outside.omega;
    let (start, tau) = (outside.origin, outside.tau);
    sets.par_iter()
        .map_init(
            || Work::plain(dynamics),
            |work, parameters| {
                let flow =
                    Flow::new(dynamics, parameters, Outside::drive(start, tau, period.recip() * TAU), settings.step_s);
                work.set(state);
                let mut out = Column::new();
                for i in 0..settings.settle + settings.keep {
                    if !flow.carry(work, start + i as f64 * period, period) {
                        return Column::new();
                    }
                    if i >= settings.settle {
                        let wrap = |(i, x): (usize, &f64)| match angles.get(i) {
                            Some(true) => wrapped(*x),
                            _ => *x,
                        };
                        out.push(work.state().iter().enumerate().map(wrap).collect());
                    }
                }
                out
            },
        )
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::dynamics::Here;

    /// The horizontally driven pendulum of (2.1): θ″ = −c θ′ − w sin θ + f sin τ cos θ at Ω = 1.
    struct Pendulum;

    impl Dynamics for Pendulum {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            1
        }
        fn acceleration_held(&self, Here { parameters: p, q, v, at, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = -0.036 * v[0] - 1.44 * q[0].sin() + p[0] * at.tau.sin() * q[0].cos();
            true
        }
    }

    #[test]
    fn a_weakly_driven_pendulum_is_one_point_and_the_seeds_is_a_cloud() {
        let settings = Settings { settle: 150, keep: 40, step_s: 0.05 };
        let sets = [vec![0.05], vec![1.52]];
        let found = bifurcation(&Pendulum, &sets, Outside::drive(0.0, 0.0, 1.0), &[0.1, 0.0], &[true], &settings);
        let spread = |c: &Column| {
            let x: Vec<f64> = c.iter().map(|p| p[0]).collect();
            x.iter().copied().fold(f64::NEG_INFINITY, f64::max) - x.iter().copied().fold(f64::INFINITY, f64::min)
        };
        assert_eq!((found[0].len(), found[1].len()), (40, 40));
        assert!(spread(&found[0]) < 0.02 && spread(&found[1]) > 2.0, "{} {}", spread(&found[0]), spread(&found[1]));
        assert!(found[1].iter().all(|p| p[0].abs() <= core::f64::consts::PI));
        // A free system has no section.
        let free = bifurcation(&Pendulum, &sets, Outside::drive(0.0, 0.0, 0.0), &[0.1, 0.0], &[true], &settings);
        assert!(free.iter().all(Vec::is_empty));
    }
}

//! Largest Lyapunov exponent of a model: the mean growth of a tangent vector (Benettin, Galgani,
//! Giorgilli and Strelcyn 1980).
//!
//! The variational equations carry a vector along the solution; after each interval it has grown by
//! a factor g and is made a unit vector again: λ = ⟨ln g⟩ an interval. Standard error: from the
//! means of `BLOCKS` blocks of intervals.
//!
//! Limits: a solution that leaves the attractor of the record (a model that locks where the rig is
//! chaotic) has its own exponent, and that is what is given.

use serde::Serialize;

use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Work};

/// Blocks of the standard error.
const BLOCKS: usize = 20;

/// Exponent of a model or map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Exponent {
    /// Exponent, an interval.
    pub per_interval: f64,
    /// Its standard error.
    pub std_error: f64,
    /// Intervals averaged.
    pub intervals: usize,
}

/// The exponent of a motion that `advance` carries on by one interval, tangent vector and all.
/// `settle` intervals are not counted. None where `advance` gives up, the vector vanishes or there
/// are fewer than two intervals a block.
pub fn largest_exponent(
    mut advance: impl FnMut(&mut [f64]) -> bool,
    vector: &mut [f64],
    settle: usize,
    intervals: usize,
) -> Option<Exponent> {
    let mut logs = Vec::with_capacity(intervals);
    for i in 0..settle + intervals {
        if !advance(vector) {
            return None;
        }
        let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 0.0) {
            return None;
        }
        vector.iter_mut().for_each(|x| *x /= norm);
        if i >= settle {
            logs.push(norm.ln());
        }
    }
    let size = intervals / BLOCKS;
    if size < 2 {
        return None;
    }
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    let blocks: Vec<f64> = logs.chunks_exact(size).map(|b| b.iter().sum::<f64>() / size as f64).collect();
    let n = blocks.len() as f64;
    let average = blocks.iter().sum::<f64>() / n;
    let variance = blocks.iter().map(|b| (b - average).powi(2)).sum::<f64>() / (n - 1.0) / n;
    Some(Exponent { per_interval: mean, std_error: variance.sqrt(), intervals })
}

/// The exponent of a system from a state on: `intervals` of `interval_s` after `settle` that are
/// not counted. The state (q, v) is where it ends.
pub fn of_model<D: Dynamics + ?Sized>(
    flow: &Flow<'_, D>,
    dynamics: &D,
    state: &mut [f64],
    start_s: f64,
    interval_s: f64,
    settle: usize,
    intervals: usize,
) -> Option<Exponent> {
    let n = dynamics.degrees_of_freedom();
    let mut work = Work::tangent(dynamics);
    work.set(state);
    // Rates are of the size of angles times the angular frequency: measured in those, the vector's
    // growth evens out sooner.
    let mut vector: Vec<f64> = (0..2 * n).map(|i| 1.0 / (1.0 + i as f64)).collect();
    let mut at = 0;
    let found = largest_exponent(
        |vector| {
            work.derivatives_mut().copy_from_slice(vector);
            let good = flow.carry(&mut work, start_s + at as f64 * interval_s, interval_s);
            vector.copy_from_slice(work.derivatives());
            at += 1;
            good
        },
        &mut vector,
        settle,
        intervals,
    );
    state.copy_from_slice(work.state());
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::dynamics::Here;
    use crate::model::flow::Outside;

    #[test]
    fn henon_0_419_a_step() {
        let mut x = (0.1, 0.1);
        let found = largest_exponent(
            |v| {
                let grown = [-2.8 * x.0 * v[0] + v[1], 0.3 * v[0]];
                v.copy_from_slice(&grown);
                x = (1.0 - 1.4 * x.0 * x.0 + x.1, 0.3 * x.0);
                true
            },
            &mut [1.0, 0.5],
            100,
            60_000,
        )
        .unwrap();
        assert!((found.per_interval - 0.4192).abs() < 0.004 && found.std_error < 0.003, "{found:?}");
    }

    #[test]
    fn lorenz_0_906_a_second() {
        let rates = |x: &[f64; 6]| {
            let [a, b, c, d, e, f] = *x;
            [
                10.0 * (b - a),
                a * (28.0 - c) - b,
                a * b - 8.0 / 3.0 * c,
                10.0 * (e - d),
                d * (28.0 - c) - a * f - e,
                d * b + a * e - 8.0 / 3.0 * f,
            ]
        };
        let dt = 0.01;
        let mut state = [1.0, 1.0, 20.0];
        let found = largest_exponent(
            |v| {
                let mut x = [state[0], state[1], state[2], v[0], v[1], v[2]];
                for _ in 0..10 {
                    let at = |k: &[f64; 6], f: f64| -> [f64; 6] { core::array::from_fn(|i| x[i] + f * dt * k[i]) };
                    let k1 = rates(&x);
                    let k2 = rates(&at(&k1, 0.5));
                    let k3 = rates(&at(&k2, 0.5));
                    let k4 = rates(&at(&k3, 1.0));
                    x = core::array::from_fn(|i| x[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
                }
                state.copy_from_slice(&x[..3]);
                v.copy_from_slice(&x[3..]);
                true
            },
            &mut [1.0, 0.0, 0.0],
            100,
            20_000,
        )
        .unwrap();
        let (rate, error) = (found.per_interval / 0.1, found.std_error / 0.1);
        assert!((rate - 0.906).abs() < 0.02 && error < 0.015, "{rate} {error}");
    }

    /// q̈ = a q − b q̇: exponents are the roots of s² + b s − a.
    struct Saddle;

    impl Dynamics for Saddle {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            2
        }
        fn acceleration_held(&self, Here { parameters: p, q, v, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = p[0] * q[0] - p[1] * v[0];
            true
        }
    }

    #[test]
    fn a_linear_system_has_its_eigenvalue() {
        let flow = Flow::new(&Saddle, &[3.0, 0.5], Outside::drive(0.0, 0.0, 0.0), 0.02);
        let found = of_model(&flow, &Saddle, &mut [0.0, 0.0], 0.0, 0.5, 20, 100).unwrap();
        let exact = -0.25 + (0.0625_f64 + 3.0).sqrt();
        assert!((found.per_interval / 0.5 - exact).abs() < 1e-4 && found.std_error < 1e-6, "{found:?}");
        assert!(of_model(&flow, &Saddle, &mut [0.0, 0.0], 0.0, 0.5, 0, 30).is_none());
    }
}

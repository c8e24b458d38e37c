//! An extracted orbit made exactly periodic on a model: Newton's method on all its drive periods at
//! once.
//!
//! Unknown are the states x_0 … x_{k−1} at the k starts of the drive periods. With Φ the solution
//! over one period, Φ(x_j) − x_{j+1} = 0 and Φ(x_{k−1}) − x_0 − 2π·turns = 0; the derivatives of Φ
//! are the variational equations'. Following all periods at once (multiple shooting) keeps an
//! orbit's instability from spoiling the equations. Its Floquet multipliers are the eigenvalues of
//! the product of the periods' derivatives: the orbit is unstable where one is larger than 1 in
//! size.
//!
//! Limits: Newton's method goes to an orbit near the guess or nowhere; an orbit along which a
//! joint's velocity grazes zero has no derivative there.

use core::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::model::dynamics::Dynamics;
use crate::model::flow::{Flow, Work};

/// Most rounds.
const MOST_ROUNDS: usize = 40;
/// Size of the closing error, rad (and rad/s over the drive's angular frequency), at which an orbit
/// counts as periodic.
const CLOSED: f64 = 1e-9;

/// A periodic orbit of a model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RefinedOrbit {
    /// Period, drive periods.
    pub period: usize,
    /// Whole turns of each coordinate over the orbit; none for one that is no angle.
    pub turns: Vec<Option<i64>>,
    /// State (q, q̇) at its start.
    pub state: Vec<f64>,
    /// Closing error that is left.
    pub closing: f64,
    /// Floquet multipliers, real and imaginary part, largest first.
    pub multipliers: Vec<[f64; 2]>,
    /// Largest distance that a coordinate moved from the guess, at the starts of the periods.
    pub moved: f64,
    /// Rounds taken.
    pub rounds: usize,
}

/// Refines an orbit. `guess`: a state (q, q̇) at the start of each of its drive periods; `start_s`:
/// time of the first; `angles`: which coordinates are angles. None where Newton's method finds no
/// orbit.
pub fn refine<D: Dynamics + ?Sized>(
    flow: &Flow<'_, D>,
    dynamics: &D,
    angles: &[bool],
    guess: &[Vec<f64>],
    start_s: f64,
    period_s: f64,
) -> Option<RefinedOrbit> {
    let (n, k) = (dynamics.degrees_of_freedom(), guess.len());
    let size = 2 * n;
    if k == 0 || guess.iter().any(|g| g.len() != size) {
        return None;
    }
    let mut work = Work::by_state(dynamics);
    // Rates count in units of the drive's angular frequency.
    let rate = TAU / period_s;
    let weigh = |i: usize| if i < n { 1.0 } else { 1.0 / rate };
    let mut turns: Option<Vec<f64>> = None;
    let mut evaluate = |x: &DVector<f64>| -> Option<(DVector<f64>, Vec<DMatrix<f64>>)> {
        let mut left = DVector::zeros(size * k);
        let mut maps = Vec::with_capacity(k);
        for j in 0..k {
            work.set(&x.as_slice()[j * size..(j + 1) * size]);
            if !flow.carry(&mut work, start_s + j as f64 * period_s, period_s) {
                return None;
            }
            maps.push(DMatrix::from_row_slice(size, size, work.derivatives()));
            let next = (j + 1) % k * size;
            for i in 0..size {
                let mut d = work.state()[i] - x[next + i];
                if j + 1 == k && i < n {
                    let whole = turns.get_or_insert_with(|| vec![f64::NAN; n]);
                    if whole[i].is_nan() {
                        whole[i] = if angles[i] { (d / TAU).round() } else { 0.0 };
                    }
                    d -= TAU * whole[i];
                }
                left[j * size + i] = d;
            }
        }
        left.iter().all(|d| d.is_finite()).then_some((left, maps))
    };
    let closing =
        |left: &DVector<f64>| left.iter().enumerate().map(|(i, d)| (d * weigh(i % size)).abs()).fold(0.0, f64::max);
    let mut x = DVector::from_iterator(size * k, guess.iter().flatten().copied());
    let start = x.clone();
    let (mut left, mut maps) = evaluate(&x)?;
    let mut rounds = 0;
    while closing(&left) > CLOSED && rounds < MOST_ROUNDS {
        let mut jacobian = DMatrix::zeros(size * k, size * k);
        for (j, map) in maps.iter().enumerate() {
            let mut own = jacobian.view_mut((j * size, j * size), (size, size));
            own += map;
            let mut next = jacobian.view_mut((j * size, (j + 1) % k * size), (size, size));
            next -= DMatrix::<f64>::identity(size, size);
        }
        let step = jacobian.lu().solve(&left)?;
        let mut share = 1.0;
        let found = loop {
            let trial = &x - &step * share;
            match evaluate(&trial) {
                Some((new, m)) if closing(&new) < closing(&left) => break Some((trial, new, m)),
                _ if share > 1e-3 => share *= 0.5,
                _ => break None,
            }
        };
        let Some((trial, new, m)) = found else { break };
        (x, left, maps) = (trial, new, m);
        rounds += 1;
    }
    let closing = closing(&left);
    if closing > 1e3 * CLOSED {
        return None;
    }
    let product = maps.iter().fold(DMatrix::identity(size, size), |p, m| m * p);
    let mut multipliers: Vec<[f64; 2]> = product.complex_eigenvalues().iter().map(|z| [z.re, z.im]).collect();
    multipliers.sort_by(|a, b| b[0].hypot(b[1]).total_cmp(&a[0].hypot(a[1])));
    let moved = (0..size * k).filter(|i| i % size < n).map(|i| (x[i] - start[i]).abs()).fold(0.0, f64::max);
    let turns = turns.unwrap_or_default();
    Some(RefinedOrbit {
        period: k,
        turns: (0..n).map(|i| angles[i].then(|| turns.get(i).map_or(0, |t| *t as i64))).collect(),
        state: x.as_slice()[..size].to_vec(),
        closing,
        multipliers,
        moved,
        rounds,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::dynamics::Here;
    use crate::model::flow::Outside;

    /// q̈ = a q + F cos τ: the periodic solution is q = −F cos τ/(1 + a) at Ω = 1, with multipliers
    /// exp(± 2π √a).
    struct Forced;

    impl Dynamics for Forced {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            2
        }
        fn acceleration_held(&self, Here { parameters: p, q, at, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = p[0] * q[0] + p[1] * at.tau.cos();
            true
        }
    }

    #[test]
    fn an_unstable_forced_orbit_is_found_with_its_multipliers() {
        let p = [0.04, 1.5];
        let flow = Flow::new(&Forced, &p, Outside::drive(0.0, 0.0, 1.0), 0.02);
        let exact = -1.5 / 1.04;
        let found =
            refine(&flow, &Forced, &[false], &[vec![exact + 0.1, 0.05], vec![exact - 0.2, 0.0]], 0.0, TAU).unwrap();
        assert!((found.state[0] - exact).abs() < 1e-7 && found.state[1].abs() < 1e-7, "{found:?}");
        let growth = (0.2 * 2.0 * TAU).exp();
        assert!((found.multipliers[0][0] / growth - 1.0).abs() < 1e-4, "{found:?}");
        assert!((found.multipliers[1][0] * growth - 1.0).abs() < 1e-3 && found.turns == [None]);
    }

    /// A pendulum that a torque turns once a period: θ̈ = −c (θ̇ − 1) − sin θ · s.
    struct Turning;

    impl Dynamics for Turning {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            0
        }
        fn acceleration_held(&self, Here { q, v, at, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = 0.3 * (1.0 - v[0]) + 0.2 * (at.tau - q[0]).sin();
            true
        }
    }

    #[test]
    fn a_whirling_orbit_closes_up_to_its_turns() {
        let flow = Flow::new(&Turning, &[], Outside::drive(0.0, 0.0, 1.0), 0.05);
        let found = refine(&flow, &Turning, &[true], &[vec![0.2, 0.9]], 0.0, TAU).unwrap();
        assert_eq!(found.turns, [Some(1)]);
        assert!(found.state[0].abs() < 1e-7 && (found.state[1] - 1.0).abs() < 1e-7, "{found:?}");
        assert!(found.multipliers[0][0].hypot(found.multipliers[0][1]) < 1.0);
        assert!(refine(&flow, &Turning, &[true], &[], 0.0, TAU).is_none());
    }
}

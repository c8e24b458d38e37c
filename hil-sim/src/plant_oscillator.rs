//! Free and forced oscillators of several degrees of freedom: what the systems of `plant_two_mass`,
//! `plant_mass_pendulum`, `plant_chain` and `plant_beam` have in common, and how a record of one is
//! taken.
//!
//! A state holds the coordinates first, then their velocities. Times and lengths are in the plant's
//! own units, SI or dimensionless, as its file says.

use crate::integrator::{IntegrationError, Integrator, Tolerance};

/// An oscillator with N = 2 × (degrees of freedom) states.
pub trait Oscillator<const N: usize> {
    /// Time derivative of the state at time t.
    fn rate(&self, t: f64, state: &[f64; N]) -> [f64; N];

    /// Kinetic plus potential energy, zero at rest.
    fn energy(&self, state: &[f64; N]) -> f64;
}

/// Samples of an oscillator, the initial state first: `count` states, `step` apart, local error
/// 1e-11 relative to `size`, the state's greatest entry at the start.
///
/// # Errors
/// A state that leaves the finite numbers.
pub fn record<const N: usize>(
    plant: &impl Oscillator<N>,
    start: [f64; N],
    step: f64,
    count: usize,
) -> Result<Vec<[f64; N]>, IntegrationError> {
    let size = start.iter().fold(1e-6_f64, |s, v| s.max(v.abs()));
    let mut integrator = Integrator::new(Tolerance { absolute: [1e-11 * size; N], relative: [1e-11; N] });
    let mut states = Vec::with_capacity(count.min(1 << 24));
    let mut state = start;
    for i in 0..count {
        states.push(state);
        if i + 1 < count {
            let t = i as f64 * step;
            state = integrator.advance(|t, y| plant.rate(t, y), t, t + step, &state)?;
        }
    }
    Ok(states)
}

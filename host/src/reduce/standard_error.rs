//! Standard errors of the polar model: of its frequency at an amplitude, at an energy, and of its
//! coefficients.
//!
//! Every release's frequency and harmonics have standard errors from what their fit leaves
//! ([`super::release_fit`], [`super::decay`]). They are drawn anew, normally distributed and
//! seeded, `DRAWS` times; the model is made again of each draw with the scales, degrees and
//! harmonics that were chosen, and the spread of its answers is their standard error. Where more
//! releases than coefficients tell the frequency and scatter more about it than their own errors
//! allow, these are raised to what the scatter says (Birge).
//!
//! This is what the noise does. What the form of the model costs is told apart, by the releases
//! left out (`error.left_out`).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::f64::consts::TAU;

use super::polar::{self, Node, Polar};
use super::systems::Mechanical;

/// Draws.
const DRAWS: usize = 100;
/// Amplitudes at which the curve is told.
const POINTS: usize = 13;

/// The frequency at one amplitude.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AmplitudePoint {
    /// First harmonic of the major coordinate.
    pub amplitude: f64,
    /// Energy at rest.
    pub energy: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Standard error of the frequency at this amplitude, Hz.
    pub std_error_hz: f64,
    /// Standard error of the frequency at this energy, Hz: the energy too follows from the
    /// releases.
    pub std_error_at_energy_hz: f64,
}

/// What is found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StandardErrors {
    /// The curve, from the least to the greatest amplitude of the releases.
    pub curve: Vec<AmplitudePoint>,
    /// Standard errors of the coefficients of ω².
    pub omega_squared: Vec<f64>,
}

/// How a model is asked: as it is used in the result.
#[derive(Clone, Copy)]
pub struct Evaluation<'a> {
    /// The system, where its equations are known.
    pub system: Option<&'a dyn Mechanical>,
    /// Masses of the channels.
    pub masses: Option<&'a [f64]>,
    /// The linear mode (ω, X_1/a), where the model was made with it.
    pub linear: Option<&'a (f64, Vec<f64>)>,
    /// Whether the variational frequency is corrected by what it misses at the nodes.
    pub corrected: bool,
    /// Nodes between the releases from the equations, which noise does not move.
    pub between: &'a [Node],
}

impl Evaluation<'_> {
    /// Angular frequency and energy at these (rising) amplitudes; none where a model has no
    /// frequency.
    fn answers(&self, polar: &Polar, nodes: &[Node], amplitudes: &[f64]) -> Option<Vec<(f64, f64)>> {
        let correction = self.system.filter(|_| self.corrected).map(|s| polar.correction(s, nodes)).unwrap_or_default();
        let omega = |a: f64| match self.system {
            Some(system) if self.corrected => polar.corrected_by(system, &correction, a),
            Some(system) => polar.variational_omega(system, a),
            None => Some(polar.omega(a)).filter(|w| *w > 0.0),
        };
        let energy = match self.system {
            Some(system) => amplitudes.iter().map(|a| system.potential(&polar.displacement(*a, 0.0))).collect(),
            None => polar.energies(amplitudes, self.masses),
        };
        amplitudes.iter().zip(energy).map(|(a, e)| Some((omega(*a)?, e))).collect()
    }
}

/// Standard errors of a model made of these nodes. Nothing where the model has no frequency
/// somewhere in its range.
pub fn of(polar: &Polar, nodes: &[Node], how: Evaluation<'_>) -> StandardErrors {
    let amplitudes = nodes.iter().map(|n| n.amplitude);
    let (low, high) = (amplitudes.clone().fold(f64::INFINITY, f64::min), amplitudes.fold(0.0, f64::max));
    if !(low > 0.0 && high > low) {
        return StandardErrors::default();
    }
    let grid: Vec<f64> = (0..POINTS).map(|i| low * (high / low).powf(i as f64 / (POINTS - 1) as f64)).collect();
    let with_between =
        |nodes: &[Node]| if how.between.is_empty() { nodes.to_vec() } else { polar::weighed(nodes, how.between) };
    let Some(found) = how.answers(polar, &with_between(nodes), &grid) else { return StandardErrors::default() };
    // With nodes from the equations ω² is not a fit to the releases alone.
    let raised = if how.between.is_empty() { birge(polar, nodes) } else { 1.0 };
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut at_amplitude, mut at_energy) = (vec![0.0; POINTS], vec![0.0; POINTS]);
    let mut coefficients = vec![0.0; polar.omega_squared.len()];
    let mut drawn = 0.0;
    for _ in 0..DRAWS {
        let moved: Vec<Node> = nodes.iter().map(|n| draw(n, &polar.major, raised, &mut random)).collect();
        let all = with_between(&moved);
        let Some(model) = polar::again(polar, &all, how.linear.cloned()) else { continue };
        let Some(answers) = how.answers(&model, &all, &grid) else { continue };
        drawn += 1.0;
        for i in 0..POINTS {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(POINTS - 1));
            let slope = (found[b].0 - found[a].0) / (found[b].1 - found[a].1);
            let omega = answers[i].0 - found[i].0;
            at_amplitude[i] += omega * omega;
            at_energy[i] += (omega - slope * (answers[i].1 - found[i].1)).powi(2);
        }
        for (sum, (now, was)) in coefficients.iter_mut().zip(model.omega_squared.iter().zip(&polar.omega_squared)) {
            *sum += (now - was) * (now - was);
        }
    }
    if drawn < 0.5 * DRAWS as f64 {
        return StandardErrors::default();
    }
    let root = |sum: f64| (sum / drawn).sqrt();
    let point = |i: usize| AmplitudePoint {
        amplitude: grid[i],
        energy: found[i].1,
        frequency_hz: found[i].0 / TAU,
        std_error_hz: root(at_amplitude[i]) / TAU,
        std_error_at_energy_hz: root(at_energy[i]) / TAU,
    };
    StandardErrors {
        curve: (0..POINTS).map(point).collect(),
        omega_squared: coefficients.into_iter().map(root).collect(),
    }
}

/// By how much the nodes scatter more about ω(a) than their errors allow, at least 1.
fn birge(polar: &Polar, nodes: &[Node]) -> f64 {
    let free = nodes.len() as f64 - polar.omega_squared.len() as f64;
    if free < 1.0 {
        return 1.0;
    }
    let chi: f64 = nodes
        .iter()
        .filter(|n| n.error > 0.0)
        .map(|n| ((n.omega / polar.omega(n.amplitude) - 1.0) / n.error).powi(2))
        .sum();
    (chi / free).sqrt().max(1.0)
}

/// A node with its noise drawn anew.
fn draw(node: &Node, major: &[f64], raised: f64, random: &mut ChaCha8Rng) -> Node {
    // Box and Muller.
    let mut normal = || {
        let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random_range(0.0..TAU));
        (-2.0 * u.ln()).sqrt() * v.cos()
    };
    let omega = node.omega * (1.0 + raised * node.error * normal());
    let mut shape = node.shape.clone();
    for x in shape.iter_mut().skip(1) {
        for (x, spread) in x.iter_mut().zip(&node.spread) {
            *x = *x * node.amplitude + spread * normal();
        }
    }
    let amplitude: f64 = shape.get(1).map_or(node.amplitude, |x| x.iter().zip(major).map(|(x, p)| x * p).sum());
    shape.iter_mut().skip(1).flatten().for_each(|x| *x /= amplitude);
    Node { amplitude, omega, shape, ..node.clone() }
}

#[cfg(test)]
mod tests {
    use super::super::release_fit;
    use super::*;

    /// A motion of two channels whose family is known: ω² = 1 + 0.4 s, X_3 = 0.02 s a, s = ln(1 +
    /// a²).
    fn record(a: f64, seed: u64) -> Vec<Vec<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let s = (a * a).ln_1p();
        let omega = (1.0 + 0.4 * s).sqrt();
        let from: f64 = random.random_range(0.0..TAU);
        (0..2)
            .map(|c| {
                (0..500)
                    .map(|i| {
                        let phi = from + omega * f64::from(i) * 0.2;
                        let (u, v): (f64, f64) =
                            (random.random_range(f64::MIN_POSITIVE..1.0), random.random_range(0.0..TAU));
                        let noise = 0.02 * (-2.0 * u.ln()).sqrt() * v.cos();
                        [0.8, 0.6][c] * a * (phi.cos() + 0.02 * s * (3.0 * phi).cos()) + noise
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn intervals_hold_the_true_frequency_in_about_95_of_100_draws() {
        let major = [0.8, 0.6];
        let (mut held, mut all) = ([0, 0], 0);
        for seed in 0..60 {
            let nodes: Vec<Node> = [0.5, 0.8, 1.2, 1.7, 2.3]
                .iter()
                .enumerate()
                .map(|(i, a)| {
                    let x = record(*a, 10 * seed + i as u64);
                    Node::of(&release_fit::fit(&[&x[0], &x[1]], 0.2, &major).unwrap(), &major)
                })
                .collect();
            let model = polar::model(&nodes, &major, None).unwrap();
            let how = Evaluation { system: None, masses: None, linear: None, corrected: false, between: &[] };
            let errors = of(&model, &nodes, how);
            assert_eq!((errors.curve.len(), errors.omega_squared.len()), (POINTS, model.omega_squared.len()));
            // Within the range, where the form costs nothing.
            for p in &errors.curve {
                let truth = |a: f64| (1.0 + 0.4 * (a * a).ln_1p()).sqrt() / TAU;
                held[0] += i32::from((p.frequency_hz - truth(p.amplitude)).abs() < 1.96 * p.std_error_hz);
                assert!(p.std_error_hz > 1e-6 && p.std_error_hz < 1e-2 && p.std_error_at_energy_hz > 0.0);
                all += 1;
            }
            held[1] += i32::from(errors.curve.windows(2).all(|w| w[0].energy < w[1].energy));
        }
        let share = f64::from(held[0]) / f64::from(all);
        assert!((0.9..0.99).contains(&share) && held[1] == 60, "{share}");
    }
}

use core::f64::consts::TAU;

use super::*;
use crate::identify::shooting::track::{Geometry, MeasuredStretch, cut};
use crate::identify::shooting::zeros::Zeros;
use crate::model::dynamics::{Here, Linearisation};
use crate::model::flow::{Flow, Outside, Work};

/// q̈ = −c q̇ + a q − b q³ + F cos τ: Duffing's oscillator between two wells, chaotic at these
/// parameters and Ω = 1 rad/s.
struct Duffing;
const TRUTH: [f64; 4] = [0.25, 1.0, 1.0, 0.4];

impl Dynamics for Duffing {
    fn degrees_of_freedom(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        4
    }
    fn acceleration_held(&self, Here { parameters: p, q, v, at, .. }: Here<'_>, out: &mut [f64]) -> bool {
        out[0] = -p[0] * v[0] + p[1] * q[0] - p[2] * q[0].powi(3) + p[3] * at.tau.cos();
        out[0].is_finite()
    }
    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        let Here { parameters: p, q, v, at, .. } = here;
        let cube = q[0].powi(3);
        let partials = [p[1] - 3.0 * p[2] * q[0] * q[0], -p[0], -v[0], q[0], -cube, at.tau.cos()];
        out.partials.copy_from_slice(&partials);
        self.acceleration_held(here, out.acceleration)
    }
}

const SPACING: f64 = TAU / 50.0;
const STEP: f64 = 0.01;

/// Values of a simulated record of so many drive periods, in steps of [`STEP`].
fn record(periods: usize, start: f64) -> Vec<f64> {
    let flow = Flow::new(&Duffing, &TRUTH, Outside::drive(0.0, 0.0, 1.0), 0.02);
    let mut work = Work::plain(&Duffing);
    work.set(&[start, 0.0]);
    assert!(flow.carry(&mut work, 0.0, 20.0 * TAU));
    let mut out = Vec::new();
    assert!(flow.samples(&mut work, 0.0, SPACING, periods * 50, |_, q| out.push(((q[0] / STEP).floor() + 0.5) * STEP)));
    out
}

fn shoot(values: &[f64], start: &[f64], bounds: &Bounds) -> Result<Outcome, Failure> {
    shoot_in(values, start, bounds, &[50, 100, 200])
}

/// In pieces whose lengths grow like this.
fn shoot_in(values: &[f64], start: &[f64], bounds: &Bounds, levels: &[usize]) -> Result<Outcome, Failure> {
    let stretch =
        MeasuredStretch { start_s: 0.0, sensors: vec![values.to_vec()], tau: Box::new(|i| i as f64 * SPACING) };
    let sensors = [vec![1.0]];
    let geometry = Geometry { sensors: &sensors, angles: &[false], spacing_s: SPACING, guess: 5 };
    let (pieces, guesses) = cut(&[stretch], &geometry, levels[levels.len() - 1], levels[0]).unwrap();
    let problem = Problem {
        dynamics: &Duffing,
        sensors: &sensors,
        sigma: &[STEP / 12f64.sqrt()],
        spacing_s: SPACING,
        step_s: TAU,
        omega: 1.0,
        inputs: None,
        zeros: Zeros::default(),
    };
    let levels = Levels { samples: levels, most_left: None };
    run(problem, pieces, guesses, start, bounds, levels, &mut || {})
}

/// q̈ = −c q̇ − k q.
struct Swing;

impl Dynamics for Swing {
    fn degrees_of_freedom(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        2
    }
    fn acceleration_held(&self, Here { parameters: p, q, v, .. }: Here<'_>, out: &mut [f64]) -> bool {
        out[0] = -p[0] * v[0] - p[1] * q[0];
        out[0].is_finite()
    }
    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        let Here { parameters: p, q, v, .. } = here;
        out.partials.copy_from_slice(&[-p[1], -p[0], -v[0], -q[0]]);
        self.acceleration_held(here, out.acceleration)
    }
}

/// A step that leaves a thirtieth of the noise damps a swing of 160 periods by 1.3 standard errors
/// of its damping. The noise alternates, so that it tells nothing of either parameter.
#[test]
fn steps_of_integration_do_not_show_in_parameters() {
    let (c, sigma): (f64, f64) = (0.005, 3e-3);
    let rate = (1.0 - 0.25 * c * c).sqrt();
    let at = |i: usize| i as f64 * SPACING;
    let solution = |t: f64| (-0.5 * c * t).exp() * (rate * t).cos();
    let values = (0..8000).map(|i| solution(at(i)) + if i % 2 == 0 { sigma } else { -sigma }).collect();
    let stretch = MeasuredStretch { start_s: 0.0, sensors: vec![values], tau: Box::new(at) };
    let sensors = [vec![1.0]];
    let geometry = Geometry { sensors: &sensors, angles: &[false], spacing_s: SPACING, guess: 5 };
    let (pieces, guesses) = cut(&[stretch], &geometry, 8000, 8000).unwrap();
    let problem = Problem {
        dynamics: &Swing,
        sensors: &sensors,
        sigma: &[sigma],
        spacing_s: SPACING,
        step_s: TAU,
        omega: 0.0,
        inputs: None,
        zeros: Zeros::default(),
    };
    let bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; 2];
    let levels = Levels { samples: &[8000], most_left: None };
    let found = run(problem, pieces, guesses, &[1.1 * c, 1.0001], &bounds, levels, &mut || {}).unwrap();
    for (k, truth) in [c, 1.0].into_iter().enumerate() {
        let (error, deviation) = (found.fit.parameters[k] - truth, found.covariance.bound[(k, k)].sqrt());
        assert!(error.abs() < 0.2 * deviation, "{k}: {error} {deviation}");
    }
}

fn open() -> Bounds {
    vec![[f64::NEG_INFINITY, f64::INFINITY]; 4]
}

const START: [f64; 4] = [0.22, 1.05, 0.97, 0.41];

#[test]
fn parameters_are_found_within_their_standard_errors_which_are_those_of_the_bound() {
    let (mut within, mut all) = (0, 0);
    let mut over_bound = [0.0; 4];
    let seeds = 8;
    for seed in 0..seeds {
        let found = shoot(&record(100, 0.3 + 0.01 * f64::from(seed)), &START, &open()).unwrap();
        assert!(found.fit.converged && found.lost == 0);
        assert!((found.noise_ratio[0] - 1.0).abs() < 0.05, "{:?}", found.noise_ratio);
        for k in 0..4 {
            let error = found.fit.parameters[k] - TRUTH[k];
            let deviation = found.covariance.estimate[(k, k)].sqrt();
            assert!(error.abs() < 5.0 * deviation, "{k}: {error} {deviation}");
            all += 1;
            within += u32::from(error.abs() < 1.96 * deviation);
            over_bound[k] += error * error / found.covariance.bound[(k, k)] / f64::from(seeds);
        }
    }
    assert!(within * 100 >= all * 85, "{within} of {all}");
    assert!(over_bound.iter().all(|o| o.sqrt() < 1.8), "{over_bound:?}");
}

#[test]
fn a_parameter_stays_within_its_bounds() {
    let mut bounds = open();
    bounds[0] = [0.0, 0.2];
    let found = shoot(&record(60, 0.3), &START, &bounds).unwrap();
    assert_eq!((found.fit.parameters[0], found.fit.held[0]), (0.2, true));
    assert!(found.fit.held[1..].iter().all(|h| !h) && found.covariance.estimate[(0, 0)] == 0.0);
    assert!((found.fit.parameters[3] - 0.4).abs() < 0.1);
}

#[test]
fn a_piece_with_a_jump_is_left_out_and_counted() {
    let mut values = record(80, 0.3);
    values[500..].iter_mut().for_each(|v| *v += 1.0);
    values[600..].iter_mut().for_each(|v| *v -= 1.0);
    let found = shoot(&values, &START, &open()).unwrap();
    assert_eq!(found.lost, 1);
    for k in 0..4 {
        let deviation = found.covariance.estimate[(k, k)].sqrt();
        assert!((found.fit.parameters[k] - TRUTH[k]).abs() < 5.0 * deviation, "{k}: {:?}", found.fit.parameters);
    }
}

/// Chaos grows over the noise in 32 periods, whatever state a piece begins with.
#[test]
fn pieces_that_are_too_long_tell_the_length_that_was_followed() {
    let values = record(200, 0.3);
    assert_eq!(shoot_in(&values, &START, &open(), &[50, 1600, 3200]).err(), Some(Failure::TooLong(50)));
    assert!(shoot_in(&values, &START, &open(), &[50]).is_ok());
}

#[test]
fn parameters_without_a_solution_and_threads_are_dealt_with() {
    let values = record(40, 0.3);
    assert_eq!(shoot(&values, &[f64::NAN; 4], &open()).err(), Some(Failure::NothingFollows));
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let [a, b] = [one, three].map(|pool| pool.install(|| shoot(&values, &START, &open()).unwrap().fit.parameters));
    assert_eq!(a, b);
}

//! What the device's own identification makes of a simulated rig, against the truth.

use std::f64::consts::TAU;

use whirl_firmware::Settings;
use whirl_firmware::estimate::{Estimator, Outcome};
use whirl_hil_sim::{Effect, Parameters, Simulation, SimulationSettings};
use whirl_shared::least_squares::NoEstimate;
use whirl_shared::regressor::NAMES;

const INCREMENT: u32 = 42_949_673; // 5 Hz at 500 Hz
const CHAOTIC_M: f64 = 0.015_525;

/// Every window's outcome.
fn outcomes(
    amplitude_m: f64,
    effects: &[&str],
    settle_s: f64,
    seed: u64,
    forget_per_mille: u16,
    seconds: f64,
) -> Vec<Outcome> {
    let mut settings = SimulationSettings {
        seed: Some(seed),
        settle_s,
        record_s: seconds,
        effects: effects.iter().map(|text| Effect::parse(text).unwrap()).collect(),
        ..SimulationSettings::default()
    };
    settings.drive.as_mut().unwrap().amplitude_m = amplitude_m;
    let mut simulation = Simulation::new(&settings).unwrap();
    let mut estimator = Estimator::new(&Settings { forget_per_mille, ..Settings::default() }).unwrap();
    (0..(500.0 * seconds) as u32)
        .filter_map(|tick| {
            let sample = simulation.next_sample().unwrap();
            estimator.sample(tick, sample.counts, sample.phase, INCREMENT, 15_525_000)
        })
        .collect()
}

/// Parameters by their definitions (3.4).
fn truth(amplitude_m: f64) -> [f64; 11] {
    let p = Parameters::PRINTED;
    let omega = TAU * 5.0;
    let (h, s1, s2) = (p.m2 * p.e2 * p.l1, p.m1 * p.e1 + p.m2 * p.l1, p.m2 * p.e2);
    let (o1, o2) = (p.j_o1, p.j_o2);
    let square = omega * omega;
    [
        h / o1,
        p.g * s1 / (o1 * square),
        -amplitude_m * s1 / o1,
        0.0,
        p.tau_c1 / (o1 * square),
        p.c_r2 / (o1 * omega),
        h / o2,
        p.g * s2 / (o2 * square),
        -amplitude_m * s2 / o2,
        0.0,
        p.c_r2 / (o2 * omega),
    ]
}

/// Values and standard errors of both equations; none where one says that it cannot be known.
fn estimates(outcome: &Outcome) -> Option<Vec<(f64, f64)>> {
    let (first, second) = (outcome.first.ok()?, outcome.second.ok()?);
    let values = first.values.into_iter().chain(second.values);
    let errors = first.std_errors.into_iter().chain(second.std_errors);
    Some(values.zip(errors).map(|(value, error)| (f64::from(value), f64::from(error))).collect())
}

#[test]
fn parameters_and_their_errors_are_right() {
    let truth = truth(CHAOTIC_M);
    let (mut inside, mut all) = (0, 0);
    for seed in 1..=20 {
        let outcomes = outcomes(CHAOTIC_M, &[], 20.0, seed, 1_000, 40.0);
        // One every ten periods, from the twentieth on; the last samples are the slope's.
        assert_eq!(outcomes.len(), 18);
        let last = outcomes.last().unwrap();
        for ((name, (value, error)), truth) in NAMES.iter().zip(estimates(last).unwrap()).zip(truth) {
            if seed == 1 {
                println!("{name} {value:.5} ± {error:.5}, true {truth:.5}");
            }
            all += 1;
            inside += usize::from((value - truth).abs() < 2.0 * error);
            // To 0.2 % of the greatest of its kind, friction to 1 %.
            let scale = if name.starts_with('C') { 0.01 * truth.abs() } else { 0.002 * truth.abs().max(0.1) };
            assert!((value - truth).abs() < scale, "seed {seed} {name}: {value} ± {error}, true {truth}");
        }
    }
    println!("within two standard errors: {inside} of {all}");
    assert!((90..=99).contains(&(inside * 100 / all)), "{inside} of {all}");
}

#[test]
fn a_parameter_that_drifts_is_followed() {
    let outcomes = outcomes(CHAOTIC_M, &["amplitude-drift@drive=0.05"], 20.0, 2, 800, 120.0);
    let truth = truth(CHAOTIC_M);
    let at = |outcome: &Outcome| estimates(outcome).unwrap()[8].0 / truth[8];
    let (early, late) = (at(&outcomes[4]), at(outcomes.last().unwrap()));
    println!("B23 over its nominal value: {early:.4} after {} s, {late:.4} at the end", outcomes[4].window.tick / 500);
    assert!((late / early - 1.0 - 0.045).abs() < 0.012, "{early} {late}");
    // The others stay.
    let b21 = estimates(outcomes.last().unwrap()).unwrap()[6].0;
    assert!((b21 / truth[6] - 1.0).abs() < 0.01, "{b21}");
}

#[test]
fn a_locked_rig_is_said_not_to_be_identifiable() {
    // The printed amplitude: arm 2 turns once a period.
    let outcomes = outcomes(0.0115, &[], 200.0, 1, 900, 30.0);
    assert!(outcomes.len() > 10);
    for outcome in &outcomes {
        assert!(outcome.first.is_err() && outcome.second.is_err(), "{outcome:?}");
    }
    assert_eq!(outcomes.last().unwrap().first, Err(NoEstimate::Repeating));
}

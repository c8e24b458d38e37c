//! The device's own estimate against the host's weak form, on the same windows of the same
//! simulated records.

use whirl::identify::regression::Solution;
use whirl::identify::series::System;
use whirl::identify::windows::WindowRows;
use whirl::identify::{Settings as IdentifySettings, built_in, prepare, regression, windows};
use whirl::model::model_file::weak_form::WeakForm;
use whirl::record::{Column, Record, Segment};
use whirl::rig::Rig;
use whirl_firmware::Settings;
use whirl_firmware::estimate::{Estimator, HARMONICS, Outcome};
use whirl_hil_sim::{Simulation, SimulationSettings};
use whirl_shared::regressor::{NAMES, Regressor};

/// 5 Hz at 500 Hz.
const INCREMENT: u32 = 42_949_673;
const DELAY: usize = Regressor::<f32, HARMONICS>::DELAY as usize;
const SECONDS: f64 = 50.0;
/// Windows that are compared.
const WINDOWS: usize = 20;

fn chaotic_rig() -> Rig {
    Rig::read(whirl_tests::repository("rigs/chaotic.toml")).unwrap()
}

/// Counts and phases of the chaotic rig.
fn simulated(seed: u64) -> (Vec<[i32; 2]>, Vec<u32>) {
    let mut settings = SimulationSettings { seed: Some(seed), settle_s: 20.0, record_s: SECONDS, ..Default::default() };
    settings.drive.as_mut().unwrap().amplitude_m = 0.015_525;
    let mut simulation = Simulation::new(&settings).unwrap();
    (0..(SECONDS * 500.0) as u32).map(|_| simulation.next_sample().unwrap()).map(|s| (s.counts, s.phase)).unzip()
}

fn record(rig: &Rig, counts: &[[i32; 2]], phase: &[u32]) -> Record {
    let column = |i: usize| Column::Counts(counts.iter().map(|c| c[i]).collect());
    let segment = Segment::new(0.0, 0.002, vec![column(0), column(1)]);
    Record::of("simulated", rig, vec![Segment { phase: Some(phase.to_vec()), ..segment }])
}

/// The host's rows of every window, the terms of its equations, and the sample at which the first
/// window begins.
struct Host {
    rows: Vec<WindowRows>,
    terms: Vec<usize>,
    frequencies: usize,
    names: Vec<String>,
    first_sample: usize,
}

impl Host {
    fn new(rig: &Rig, counts: &[[i32; 2]], phase: &[u32]) -> Self {
        let own = built_in::written(rig).unwrap();
        let bound = built_in::bound(&own).unwrap();
        let prepared = prepare(&[record(rig, counts, phase)], &own, bound, &IdentifySettings::default()).unwrap();
        let geometry = &prepared.geometry;
        let weak = WeakForm::new(&bound.model, rig.omega(), &[]).unwrap();
        let (kernels, circle) = (&geometry.kernels, bound.model.circle());
        let system = System { stretches: &prepared.stretches, weak: &weak, kernels, circle: &circle };
        let rows = windows::rows_of(&system, &weak.equations, kernels, &geometry.windows);
        let terms = weak.equations.iter().map(|e| e.terms.len()).collect();
        let names = weak.equations.iter().flat_map(|e| e.terms.iter().map(|t| t.name.clone())).collect();
        let first_sample = geometry.kernels.reach();
        Self { rows, terms, frequencies: geometry.windows.frequencies, names, first_sample }
    }

    fn solve(&self, windows: std::ops::Range<usize>) -> Solution {
        regression::solve(&self.rows[windows], &self.terms, self.frequencies).unwrap()
    }

    /// Values in the device's order, for given weights of the frequencies.
    fn values(&self, windows: std::ops::Range<usize>, weights: &[Vec<f64>]) -> Vec<f64> {
        let solved = regression::solve_weighted(self.rows[windows].iter(), &self.terms, weights).unwrap();
        let values: Vec<f64> = solved.iter().flat_map(|c| c.iter().copied()).collect();
        NAMES.iter().map(|name| values[self.names.iter().position(|n| n == name).unwrap()]).collect()
    }
}

/// The device's outcomes, its first window beginning at a sample of the record.
fn device(counts: &[[i32; 2]], phase: &[u32], first_sample: usize, forget_per_mille: u16) -> Vec<Outcome> {
    let mut estimator = Estimator::new(&Settings { forget_per_mille, ..Settings::default() }).unwrap();
    (first_sample - DELAY..counts.len())
        .filter_map(|t| estimator.sample(t as u32, counts[t], phase[t], INCREMENT, 15_525_000))
        .collect()
}

/// (device − host)/the device's standard error, of all parameters.
fn deviations(outcome: &Outcome, host: &[f64]) -> Vec<f64> {
    let (first, second) = (outcome.first.unwrap(), outcome.second.unwrap());
    let values = first.values.into_iter().chain(second.values);
    let errors = first.std_errors.into_iter().chain(second.std_errors);
    values.zip(errors).zip(host).map(|((v, e), h)| (f64::from(v) - h) / f64::from(e)).collect()
}

#[test]
fn over_twenty_windows_it_agrees_with_the_host_within_its_standard_error() {
    let rig = chaotic_rig();
    for seed in 1..=5 {
        let (counts, phase) = simulated(seed);
        let host = Host::new(&rig, &counts, &phase);
        let outcomes = device(&counts, &phase, host.first_sample, 1_000);
        let mut worst = 0.0_f64;
        for n in 4..=WINDOWS {
            let outcome = &outcomes[n - 1];
            assert_eq!(outcome.window.number as usize, n);
            // The same window: from the same sample to the same.
            assert_eq!(outcome.window.tick as usize + 1, host.first_sample + 1_000 * (n + 1));
            let solution = host.solve(0..n);
            let deviations = deviations(outcome, &host.values(0..n, &solution.weights));
            worst = deviations.iter().fold(0.0, |w, d| d.abs().max(w));
            if n == WINDOWS || n == 4 {
                println!("seed {seed}, {n} windows: {deviations:5.2?}");
            }
        }
        assert!(worst <= 1.0, "seed {seed}: {worst}");
    }
}

#[test]
fn each_of_twenty_windows_alone_gives_what_it_gives_the_host() {
    let rig = chaotic_rig();
    let (mut within, mut all, mut worst, mut squares) = (0, 0, 0.0_f64, 0.0);
    for seed in 1..=5 {
        let (counts, phase) = simulated(seed);
        let host = Host::new(&rig, &counts, &phase);
        let outcomes = device(&counts, &phase, host.first_sample, 0);
        // A single window does not tell how the residuals grow with frequency: the weights are
        // those of the record.
        let weights = host.solve(0..host.rows.len()).weights;
        for n in (0..outcomes.len()).skip(3).take(WINDOWS) {
            for d in deviations(&outcomes[n], &host.values(n..n + 1, &weights)) {
                all += 1;
                within += usize::from(d.abs() <= 1.0);
                squares += d * d;
                worst = worst.max(d.abs());
            }
        }
    }
    let rms = (squares / all as f64).sqrt();
    println!("within one standard error {within} of {all}, rms {rms:.3}, worst {worst:.2}");
    assert_eq!(all, 5 * WINDOWS * NAMES.len());
    // What is left is the difference of the low-passes, most of all where a velocity changes sign.
    assert!(100 * within >= 98 * all && rms < 0.4 && worst < 2.0, "{within} of {all}, rms {rms}, worst {worst}");
}

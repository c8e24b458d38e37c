//! Every shipped model file: simulated by its rig's `[plant]`, identified, and compared with it.

use std::path::PathBuf;

use super::super::{Identification, Settings, identify};
use crate::model::model_file::simulation;
use crate::record::{ReadOptions, Record};
use crate::rig::Rig;

fn rig(name: &str) -> Rig {
    Rig::read(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(name)).unwrap()
}

fn simulated(rig: &Rig, seconds: f64, seed: u64) -> Record {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.parquet");
    simulation::record(rig, rig.bound.as_ref().unwrap(), &[], seconds, seed, &path).unwrap();
    Record::read(&path, rig, &ReadOptions::default()).unwrap()
}

fn truth(rig: &Rig, name: &str) -> f64 {
    let table: toml::Table = toml::from_str(&rig.text).unwrap();
    let v = &table["plant"][name];
    v.as_float().or_else(|| v.as_integer().map(|i| i as f64)).unwrap()
}

/// Each coefficient within four standard errors, no standard error above a share of the value
/// (unless that is near zero), most within 1.96 over all seeds.
fn recovered_of(name: &str, seconds: f64, share: f64, seeds: &[u64]) -> Identification {
    let rig = rig(name);
    let (mut inside, mut count, mut last) = (0, 0, None);
    for seed in seeds {
        let result = identify(&[simulated(&rig, seconds, *seed)], &rig, &Settings::default()).unwrap();
        assert_eq!(result.model, rig.bound.as_ref().unwrap().model.name);
        for p in &result.parameters {
            let true_value = truth(&rig, &p.name);
            // Cubes of a signal that reaches half the Nyquist frequency pass the low-pass to about
            // a thousandth.
            let band = if name == "silverbox.toml" { 1e-3 * true_value.abs() } else { 0.0 };
            let z = (p.value - true_value) / p.std_error.max(0.25 * band);
            assert!(z.abs() < 4.0, "{name}: {} = {} ± {}, true {true_value}: {z:.1} σ", p.name, p.value, p.std_error);
            if true_value != 0.0 {
                let relative = p.std_error / true_value.abs();
                assert!(relative < share, "{name}: {} ± {:.2} %", p.name, 100.0 * relative);
            }
            inside += usize::from(z.abs() < 1.96);
            count += 1;
        }
        last = Some(result);
    }
    assert!(inside * 4 >= count * 3, "{name}: {inside} of {count}");
    last.unwrap()
}

fn recovered(name: &str, seconds: f64, share: f64) -> Identification {
    recovered_of(name, seconds, share, &[1])
}

#[test]
fn pendulums_are_recovered() {
    recovered("measured-single-pendulum.toml", 30.0, 0.3);
    recovered("double-pendulum-model-file.toml", 40.0, 0.01);
    recovered("measured-triple-pendulum.toml", 40.0, 0.3);
}

#[test]
fn coupled_and_conservative_systems_are_recovered() {
    recovered("cart-pendulum.toml", 60.0, 0.05);
    recovered("two-mass-model-file.toml", 400.0, 0.01);
    recovered("mass-pendulum-model-file.toml", 60.0, 0.01);
    recovered("van-der-pol.toml", 60.0, 0.02);
}

/// Random, impulsive and periodic excitation of one oscillator, identified from its measured input.
#[test]
fn every_kind_of_excitation_identifies_the_oscillator() {
    for name in ["duffing.toml", "duffing-periodic.toml", "duffing-impulses.toml"] {
        recovered(name, 60.0, 0.05);
    }
}

#[test]
fn benchmarks_are_recovered_when_simulated() {
    recovered("emps.toml", 20.0, 0.05);
    // Errors of its stiffnesses go together: one record says little of how often they are inside.
    recovered_of("silverbox.toml", 20.0, 0.2, &[1, 2, 3, 4]);
}

//! How often 95 % intervals hold the truth, over seeded records of the chaotic rig.

use std::ops::RangeInclusive;

use indicatif::ProgressBar;
use rayon::prelude::*;
use whirl::identify::{Identification, Settings, identify, shooting};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl::rig::plant::Plant;

use crate::accuracy::INDEPENDENT;
use crate::repository;

/// A method of identification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Weak form.
    Weak,
    /// Multiple shooting.
    Shooting,
}

/// One parameter over all seeds.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Name.
    pub name: &'static str,
    /// Records.
    pub records: usize,
    /// Of which the 95 % interval holds the truth.
    pub within: usize,
    /// Mean of error over standard error.
    pub mean: f64,
    /// Root mean square of error over standard error.
    pub rms: f64,
    /// Root mean square error, relative (B14, B24: to B15, B25).
    pub relative: f64,
    /// Root mean square error over the Cramér–Rao bound (shooting; NaN otherwise).
    pub over_bound: f64,
}

impl Tally {
    /// Share of records whose interval holds the truth.
    pub fn share(&self) -> f64 {
        self.within as f64 / self.records.max(1) as f64
    }
}

/// `rigs/chaotic.toml` with encoders of another resolution.
///
/// # Panics
/// If the shipped rig file is not what it was.
pub fn rig(counts_per_turn: u32) -> Rig {
    let path = repository("rigs/chaotic.toml");
    let text = std::fs::read_to_string(&path).expect("the shipped rig file");
    assert!(text.contains("counts_per_turn = 4096"));
    let text = text.replace("counts_per_turn = 4096", &format!("counts_per_turn = {counts_per_turn}"));
    Rig::parse(&text, &path).expect("a rig file")
}

/// Simulates one record and identifies it by each method.
///
/// # Panics
/// If any of this fails.
pub fn identified(rig: &Rig, seed: u64, seconds: f64, methods: &[Method]) -> Vec<Identification> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("record.parquet");
    whirl::simulate::record(rig, &[], seconds, seed, &path, &ProgressBar::hidden()).expect("a simulated record");
    let records = [Record::read(&path, rig, &ReadOptions::default()).expect("a record")];
    let settings = Settings::default();
    methods
        .iter()
        .map(|m| match m {
            Method::Weak => identify(&records, rig, &settings).expect("an identification"),
            Method::Shooting => {
                let choices = shooting::Settings::default();
                shooting::identify(&records, rig, &settings, &choices, &ProgressBar::hidden())
                    .expect("an identification")
            }
        })
        .collect()
}

/// Every parameter over the seeds, method by method. Runs on all threads.
///
/// # Panics
/// If a record cannot be simulated or identified.
pub fn tally(counts: u32, seconds: f64, seeds: RangeInclusive<u64>, methods: &[Method]) -> Vec<Vec<Tally>> {
    let rig = rig(counts);
    let plant = Plant::of(&rig).expect("a plant");
    let truth = |name: &str| plant.truth(name, rig.omega()).expect("a coefficient");
    let all: Vec<Vec<Identification>> =
        seeds.collect::<Vec<u64>>().into_par_iter().map(|seed| identified(&rig, seed, seconds, methods)).collect();
    (0..methods.len())
        .map(|m| {
            INDEPENDENT
                .iter()
                .map(|name| {
                    let scale = match *name {
                        "B14" => truth("B15"),
                        "B24" => truth("B25"),
                        _ => truth(name).abs(),
                    };
                    let mut t = Tally {
                        name,
                        records: all.len(),
                        within: 0,
                        mean: 0.0,
                        rms: 0.0,
                        relative: 0.0,
                        over_bound: 0.0,
                    };
                    for found in all.iter().map(|a| &a[m]) {
                        let p = found.parameter(name).expect("an identified coefficient");
                        let error = p.value - truth(name);
                        let z = error / p.std_error;
                        t.within += usize::from(z.abs() <= 1.96);
                        t.mean += z / all.len() as f64;
                        t.rms += z * z / all.len() as f64;
                        t.relative += (error / scale).powi(2) / all.len() as f64;
                        let bound = found.shooting.as_ref().and_then(|s| {
                            let i = found.correlation_names.iter().position(|n| n == name)?;
                            s.cramer_rao.get(i).copied()
                        });
                        t.over_bound += (error / bound.unwrap_or(f64::NAN)).powi(2) / all.len() as f64;
                    }
                    (t.rms, t.relative, t.over_bound) = (t.rms.sqrt(), t.relative.sqrt(), t.over_bound.sqrt());
                    t
                })
                .collect()
        })
        .collect()
}

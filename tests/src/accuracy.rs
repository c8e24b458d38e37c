//! The accuracy of the whole line on records whose truth is known: simulated, written, read,
//! identified, compared.

use indicatif::ProgressBar;
use rayon::prelude::*;
use whirl::identify::{Identification, Settings, identify};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl::rig::plant::Plant;

use crate::repository;

/// Coefficients that are estimated on their own (B15 and B25 follow from B13, B14 and B23, B24):
/// those whose standard errors are compared.
pub const INDEPENDENT: [&str; 11] = ["B11", "B12", "B13", "B14", "B21", "B22", "B23", "B24", "C11", "C12", "C2"];
/// Every coefficient of the double pendulum, in the order of the report.
pub const ALL: [&str; 13] = ["B11", "B12", "B13", "B14", "B15", "B21", "B22", "B23", "B24", "B25", "C11", "C12", "C2"];

/// One identified coefficient beside its true value.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Drive frequency, Hz.
    pub frequency_hz: f64,
    /// Seed of the rig's initial state.
    pub seed: u64,
    /// Name.
    pub name: &'static str,
    /// Identified value.
    pub value: f64,
    /// True value.
    pub truth: f64,
    /// Standard error.
    pub std_error: f64,
    /// What the error is divided by: the truth's size, or, for B14 and B24, which are 0 here, that
    /// of B15 and B25.
    pub scale: f64,
}

impl Comparison {
    /// Error relative to the truth.
    pub fn relative(&self) -> f64 {
        (self.value - self.truth).abs() / self.scale
    }

    /// Error in standard errors.
    pub fn deviations(&self) -> f64 {
        (self.value - self.truth).abs() / self.std_error
    }

    /// The relative error that issue and README allow: 0.2 % for every B, 0.5 % for C12 and C2, 3 %
    /// for C11.
    pub fn allowed(&self) -> f64 {
        match self.name {
            "C11" => 0.03,
            "C12" | "C2" => 0.005,
            _ => 0.002,
        }
    }
}

/// `rigs/chaotic.toml` at another drive frequency.
///
/// # Panics
/// If the shipped rig file is not what it was.
pub fn chaotic_rig(frequency_hz: f64) -> Rig {
    let path = repository("rigs/chaotic.toml");
    let text = std::fs::read_to_string(&path).expect("the shipped rig file");
    assert!(text.contains("frequency_hz = 5.0"));
    let text = text.replace("frequency_hz = 5.0", &format!("frequency_hz = {frequency_hz:?}"));
    Rig::parse(&text, &path).expect("a rig file")
}

/// The shipped rig whose base is measured: three channels.
///
/// # Panics
/// If the rig file is not there, or not as expected.
pub fn measured_base_rig() -> Rig {
    Rig::read(repository("rigs/measured-base.toml")).expect("the shipped rig file")
}

/// Simulates, writes, reads and identifies one record of `seconds`.
///
/// # Panics
/// If any of these fails.
pub fn identified(rig: &Rig, seed: u64, seconds: f64) -> Identification {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("record.parquet");
    whirl::simulate::record(rig, &[], seconds, seed, &path, &ProgressBar::hidden()).expect("a simulated record");
    let record = Record::read(&path, rig, &ReadOptions::default()).expect("a record");
    identify(&[record], rig, &Settings::default()).expect("an identification")
}

/// 120 s of the chaotic rig for each frequency and seed, every coefficient beside its truth. Runs
/// on all threads.
///
/// # Panics
/// If a record cannot be simulated or identified, or a coefficient is missing.
pub fn table(frequencies_hz: &[f64], seeds: std::ops::RangeInclusive<u64>) -> Vec<Comparison> {
    let cases: Vec<(f64, u64)> = frequencies_hz.iter().flat_map(|f| seeds.clone().map(|s| (*f, s))).collect();
    cases
        .into_par_iter()
        .flat_map_iter(|(frequency_hz, seed)| {
            let rig = chaotic_rig(frequency_hz);
            let plant = Plant::of(&rig).expect("a plant");
            let truth = |name: &str| plant.truth(name, rig.omega()).expect("a coefficient");
            let found = identified(&rig, seed, 120.0);
            ALL.map(|name| {
                let p = found.parameter(name).expect("an identified coefficient");
                let scale = match name {
                    "B14" => truth("B15"),
                    "B24" => truth("B25"),
                    _ => truth(name).abs(),
                };
                Comparison {
                    frequency_hz,
                    seed,
                    name,
                    value: p.value,
                    truth: truth(name),
                    std_error: p.std_error,
                    scale,
                }
            })
        })
        .collect()
}

/// How well the standard errors cover the truth: comparisons, those within 3 standard errors, the
/// greatest deviation.
pub fn coverage(table: &[Comparison]) -> (usize, usize, f64) {
    let independent = table.iter().filter(|c| INDEPENDENT.contains(&c.name));
    independent.fold((0, 0, 0.0), |(all, within, worst), c| {
        let d = c.deviations();
        (all + 1, within + usize::from(d <= 3.0), f64::max(worst, d))
    })
}

//! Speed of identification, from file to parameters, and of the simulated rig's integration, 670 000 samples each;
//! `peers/speed.py` runs the public counterparts.
//!
//! The record is `WHIRL_BENCH_PARQUET` (that `whirl simulate --rig rigs/chaotic.toml --seconds 1340 --seed 1 -o record.parquet` wrote);
//! without it, the same is simulated first.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use whirl::identify::harmonic_balance::settings::Settings as BalanceSettings;
use whirl::identify::{Settings, harmonic_balance, identify};
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;
use whirl_hil_sim::{Simulation, SimulationSettings};

fn rig() -> Rig {
    Rig::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/chaotic.toml"))).expect("the rig file")
}

fn simulated() -> PathBuf {
    let path = std::env::temp_dir().join("whirl-bench-1340s.parquet");
    if !path.exists() {
        let bar = indicatif::ProgressBar::hidden();
        whirl::simulate::record(&rig(), &[], 1340.0, 1, &path, &bar).expect("a simulated record");
    }
    path
}

/// Angles after `samples` steps of the direct simulation.
fn integrate(tolerance: f64, samples: usize) -> [f64; 2] {
    let settings = SimulationSettings { tolerance, settle_s: 0.0, ..SimulationSettings::default() };
    let mut rig = Simulation::new(&settings).expect("a rig");
    let mut last = [0.0; 2];
    for _ in 0..samples {
        last = rig.next_sample().expect("a sample").angles;
    }
    last
}

fn benches(c: &mut Criterion) {
    let rig = rig();
    let path = std::env::var_os("WHIRL_BENCH_PARQUET").map_or_else(simulated, PathBuf::from);
    // Over five drive periods the loose tolerance must be within 2e-6 rad of the tight one.
    let (loose, tight) = (integrate(1e-9, 500), integrate(1e-13, 500));
    let error = (loose[0] - tight[0]).abs().max((loose[1] - tight[1]).abs());
    println!("integration: error over 5T {error:.1e} rad");
    assert!(error < 2e-6);
    let mut group = c.benchmark_group("670 000 samples");
    group.sample_size(10).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(5));
    let read = || Record::read(&path, &rig, &ReadOptions::default()).expect("a record");
    group.bench_function("weak form, from file to parameters", |b| {
        b.iter(|| identify(&[read()], black_box(&rig), &Settings::default()).expect("parameters"))
    });
    group.bench_function("frequency method, pieces of 100T, from file to parameters", |b| {
        b.iter(|| {
            harmonic_balance::identify(&[read()], black_box(&rig), &BalanceSettings::frequency(100))
                .expect("parameters")
        })
    });
    group.bench_function("double pendulum integrated", |b| b.iter(|| integrate(black_box(1e-9), 670_000)));
    group.finish();
}

criterion_group!(identification, benches);
criterion_main!(identification);

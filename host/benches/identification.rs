//! Speed of identification, from file to parameters, and of the integration of a double pendulum,
//! 670 000 samples each; `peers/speed.py` runs the public counterparts.
//!
//! The record is `WHIRL_BENCH_PARQUET` (that
//! `whirl simulate --rig rigs/chaotic.toml --seconds 1340 --seed 1 -o record.parquet` wrote);
//! without it, the same is simulated first.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use whirl::identify::harmonic_balance::settings::Settings as BalanceSettings;
use whirl::identify::{Settings, harmonic_balance, identify};
use whirl::model::double_pendulum::{DAMPINGS, DEFAULT_DAMPINGS};
use whirl::model::double_pendulum_dynamics::DoublePendulum;
use whirl::model::flow::{Flow, Outside, Work};
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;

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

/// Coefficients of the double pendulum of `peers/speed.py`: B11 B12 B13 B14 C11 C12, B21 B22 B23
/// B24 C2.
const COEFFICIENTS: [f64; 11] = [
    0.11321869783,
    0.07085065502,
    -0.11066396244,
    0.0,
    1.01997786e-3,
    3.26546619e-3,
    1.68157698983,
    0.26321600461,
    -0.41112571287,
    0.0,
    0.04850022937,
];

/// Angles of `samples` samples at 500 Hz with steps of at most `step_s`.
fn integrate(step_s: f64, samples: usize) -> Vec<[f64; 2]> {
    let omega = core::f64::consts::TAU * 5.0;
    let dampings: Vec<_> = DAMPINGS.iter().filter(|d| DEFAULT_DAMPINGS.contains(&d.id)).collect();
    let pendulum = DoublePendulum::new(omega, true, &dampings);
    let flow = Flow::new(&pendulum, &COEFFICIENTS, Outside::drive(0.0, 0.0, omega), step_s);
    let mut work = Work::plain(&pendulum);
    work.set(&[0.3, 2.0, 0.0, 0.0]);
    let mut out = vec![[0.0; 2]; samples];
    assert!(flow.samples(&mut work, 0.0, 2e-3, samples, |k, q| out[k] = [q[0], q[1]]));
    out
}

/// Step of the measured integration, s.
const STEP_S: f64 = 0.01 / 3.0;

fn benches(c: &mut Criterion) {
    let rig = rig();
    let path = std::env::var_os("WHIRL_BENCH_PARQUET").map_or_else(simulated, PathBuf::from);
    // Five drive periods must be within 2e-6 rad of what steps twenty times shorter give.
    let (coarse, fine) = (integrate(STEP_S, 501), integrate(STEP_S / 20.0, 501));
    let error = coarse.iter().flatten().zip(fine.iter().flatten()).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
    println!("integration: error over 5T {error:.1e} rad");
    assert!(error < 2e-6);
    let mut group = c.benchmark_group("670 000 samples");
    group.sample_size(10).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(5));
    let read = || Record::read(&path, &rig, &ReadOptions::default()).expect("a record");
    group.bench_function("record read", |b| b.iter(read));
    group.bench_function("weak form, from file to parameters", |b| {
        b.iter(|| identify(&[read()], black_box(&rig), &Settings::default()).expect("parameters"))
    });
    group.bench_function("frequency method, pieces of 100T, from file to parameters", |b| {
        b.iter(|| {
            harmonic_balance::identify(&[read()], black_box(&rig), &BalanceSettings::frequency(100))
                .expect("parameters")
        })
    });
    group.bench_function("double pendulum integrated", |b| b.iter(|| integrate(black_box(STEP_S), 670_000)));
    group.finish();
}

criterion_group!(identification, benches);
criterion_main!(identification);

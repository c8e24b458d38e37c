//! Speed of the phase-space statistics on one record of 670 000 samples; `peers/phase_space.py`
//! runs the public counterparts on the same record.
//!
//! The record is `WHIRL_BENCH_RECORD` (a CSV that
//! `whirl simulate --rig rigs/chaotic.toml --seconds 1340 --seed 1 -o record.csv` wrote); without
//! it, the same is simulated first.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use whirl::phase_space::average_mutual_information::average_mutual_information;
use whirl::phase_space::embedding::Embedding;
use whirl::phase_space::false_nearest_neighbours::{self, false_nearest_neighbours};
use whirl::phase_space::lyapunov_exponent::{self, divergence, fit};
use whirl::phase_space::observable::Observable;
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;

/// θ2 of the record, rad, and the size of a count.
fn angle() -> (Vec<f64>, f64) {
    let rig = Rig::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/chaotic.toml"))).expect("the rig file");
    let path = std::env::var_os("WHIRL_BENCH_RECORD").map_or_else(simulated, PathBuf::from);
    let record = Record::read(path, &rig, &ReadOptions::default()).expect("a record");
    let channel = &record.channels[1];
    (record.segments[0].columns[1].angle(channel), channel.scale())
}

fn simulated() -> PathBuf {
    let path = std::env::temp_dir().join("whirl-bench-1340s.parquet");
    if !path.exists() {
        let status = std::process::Command::new(env!("CARGO_BIN_EXE_whirl"))
            .args(["simulate", "--rig", concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/chaotic.toml")])
            .args(["--seconds", "1340", "--seed", "1", "-o"])
            .arg(&path)
            .status();
        assert!(status.is_ok_and(|s| s.success()), "whirl simulate");
    }
    path
}

fn benches(c: &mut Criterion) {
    let (x, step) = angle();
    let whole = Observable::angle(&[&x], step, 1);
    println!("{} samples", whole.len());
    c.bench_function("average mutual information, lags 1-100, 64 bins", |b| {
        b.iter(|| average_mutual_information(black_box(&whole), 100, 64))
    });
    let short = Observable::angle(&[&x[..30_000.min(x.len())]], step, 1);
    let settings =
        lyapunov_exponent::Settings { theiler: 100, steps: 500, followed: 5, unit: 100.0, settle: 50, ceiling: 0.7 };
    c.bench_function("largest Lyapunov exponent, 30 000 points", |b| {
        b.iter(|| {
            let e = Embedding::of_one(black_box(&short), 24, 5, settings.steps, usize::MAX);
            fit(&divergence(&e, &settings), &settings)
        })
    });
    let mut slow = c.benchmark_group("false nearest neighbours, dimensions 1-10");
    slow.sample_size(10).warm_up_time(Duration::from_millis(1)).measurement_time(Duration::from_secs(1));
    for theiler in [0, 100] {
        let settings = false_nearest_neighbours::Settings { theiler, ..Default::default() };
        slow.bench_function(format!("Theiler window {theiler}"), |b| {
            b.iter(|| false_nearest_neighbours(black_box(&whole), 24, &settings))
        });
    }
    slow.finish();
}

criterion_group!(phase_space, benches);
criterion_main!(phase_space);

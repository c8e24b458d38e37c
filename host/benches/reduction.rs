//! Proper orthogonal decomposition of 200 × 20 000 and 2000 × 20 000; `peers/reduction.py` is
//! numpy's method of snapshots on the same.

use std::cell::LazyCell;
use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use whirl::reduce::proper_orthogonal_decomposition::{Route, decompose};

/// Ten slow modes and a little hash noise, one vector a channel.
fn record(channels: usize, samples: usize) -> Vec<Vec<f64>> {
    (0..channels)
        .map(|c| {
            (0..samples)
                .map(|i| {
                    let noise = ((i * 2_654_435_761 + c * 40_503) % 1000) as f64 * 1e-3;
                    let slow: f64 = (1..=10)
                        .map(|k| (0.0137 * (k * i) as f64 + 0.1 * (c * k) as f64).sin() / f64::from(k as u32))
                        .sum();
                    slow + 1e-3 * noise
                })
                .collect()
        })
        .collect()
}

fn pod(c: &mut Criterion) {
    for (channels, samples) in [(200, 20_000), (2000, 20_000)] {
        // Made when it is asked for: making the large one takes longer than the small one's
        // measurement.
        let record = LazyCell::new(|| record(channels, samples));
        c.bench_function(&format!("pod {channels} x {samples}"), |b| {
            let slices: Vec<&[f64]> = record.iter().map(Vec::as_slice).collect();
            b.iter(|| decompose(black_box(&slices), None, Route::Covariance));
        });
    }
}

criterion_group! {
    name = reduction;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(5));
    targets = pod
}
criterion_main!(reduction);

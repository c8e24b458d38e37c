//! Rows against the integrals of the equation, and gaps.

use super::*;
use core::f64::consts::{PI, TAU};
use std::vec::Vec;

const PERIODS: u32 = 4;
const INCREMENT: u32 = 1 << 25; // 128 ticks a period

fn settings() -> RegressorSettings {
    let scale = CountScale::new(1 << 20).unwrap();
    RegressorSettings { scales: [scale; 2], sample_rate_millihertz: 500_000, periods: PERIODS }
}

fn theta(t: f64) -> [f64; 2] {
    [0.8 * (9.0 * t).sin(), 6.0 * t + 0.5 * (11.0 * t).cos()]
}

fn feed(regressor: &mut Regressor<f64, 12>, ticks: core::ops::Range<u32>) -> Vec<Vec<Row<f64>>> {
    let mut windows = Vec::new();
    for tick in ticks {
        let counts = theta(f64::from(tick) / 500.0).map(|x| (x * f64::from(1 << 20) / TAU).floor() as i32);
        let completes = regressor.completes_next();
        let pushed = regressor.push(tick, counts, tick.wrapping_mul(INCREMENT), INCREMENT);
        assert!(completes || pushed != Pushed::Complete);
        if pushed == Pushed::Complete {
            assert!(regressor.rows_at(11).is_none());
            let rows: Vec<_> = (0..=10).flat_map(|m| regressor.rows_at(m).unwrap()).collect();
            for (m, pair) in rows.chunks(2).enumerate() {
                let targets = [0, 1].map(|part: usize| [pair[part].first.1, pair[part].second.1]);
                for (a, b) in targets.iter().flatten().zip(regressor.targets_at(m).unwrap().iter().flatten()) {
                    assert!((a - b).abs() <= 1e-14 * a.abs(), "{a} {b}");
                }
            }
            windows.push(rows);
        }
    }
    windows
}

#[test]
fn rows_are_the_integrals_of_the_equation() {
    let mut regressor = Regressor::new(settings());
    let windows = feed(&mut regressor, 0..2_000);
    let length = 512;
    assert_eq!(regressor.length(), length);
    // Starts at the slopes' reach, then every half window.
    let delay = Regressor::<f64, 12>::DELAY;
    assert_eq!(windows.len(), (2_000 - 2 * delay as usize) / 256 - 1);
    let omega = TAU * 500.0 / 128.0;
    for (index, rows) in windows.iter().enumerate() {
        assert_eq!(rows.len(), 2 * 11);
        for (r, row) in rows.iter().enumerate() {
            let m = r / 2;
            // Direct quadrature with the exact second derivative.
            let mut sums = [0.0; 6];
            for n in 0..length {
                let tick = delay + 256 * index as u32 + n;
                let (t, u) = (f64::from(tick) / 500.0, f64::from(n) / f64::from(length));
                let turn = -TAU * m as f64 * u;
                let w = (PI * u).sin().powi(4) * if r % 2 == 0 { turn.cos() } else { turn.sin() };
                let [theta1, theta2] = theta(t);
                let (rate1, rate2) = (7.2 * (9.0 * t).cos(), 6.0 - 5.5 * (11.0 * t).sin() + 7.2 * (9.0 * t).cos());
                let accel1 = -64.8 * (9.0 * t).sin();
                let accel2 = accel1 - 60.5 * (11.0 * t).cos();
                let tau = TAU * f64::from(tick) / 128.0;
                let parts = [
                    (accel2 * theta2.cos() - rate2 * rate2 * theta2.sin()) / (omega * omega),
                    theta1.sin(),
                    (theta1 + theta2).sin() * tau.cos(),
                    (accel1 * theta2.cos() + rate1 * rate1 * theta2.sin()) / (omega * omega),
                    -(rate2 - rate1) / omega,
                    -accel1 / (omega * omega),
                ];
                sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += w * part / f64::from(length));
            }
            let r = m as f64 / f64::from(PERIODS);
            let weights = [1.0 + 1.5 * r.powi(3), 1.0 + r * r];
            let first = [row.first.0[0], row.first.0[1], row.first.0[5], row.first.1].map(|x| x * weights[0]);
            let second = [row.second.0[2], row.second.0[0]].map(|x| x * weights[1]);
            let found = [first[0], first[1], second[0], second[1], first[2], first[3]];
            for (k, (found, expected)) in found.into_iter().zip(sums).enumerate() {
                assert!((found - expected).abs() < 2e-5, "window {index} m {m} part {k}: {found} {expected}");
            }
        }
    }
}

#[test]
fn a_gap_or_another_drive_begins_anew() {
    let mut regressor = Regressor::new(settings());
    let whole = 512 + 2 * Regressor::<f64, 12>::DELAY;
    assert!(feed(&mut regressor, 0..whole - 1).is_empty());
    assert!(feed(&mut regressor, whole..2 * whole - 1).is_empty());
    assert_eq!(feed(&mut regressor, 2 * whole - 1..2 * whole).len(), 1);
    // A drive at rest gives nothing.
    for tick in 0..3_000 {
        let expected = if tick == 0 { Pushed::Began } else { Pushed::Taken };
        assert_eq!(regressor.push(tick, [0, 0], 0, 0), expected);
    }
    // And so does who says so.
    assert_eq!(feed(&mut regressor, 0..whole).len(), 1);
    regressor.clear();
    assert!(feed(&mut regressor, whole..2 * whole - 1).is_empty() && regressor.rows_at(0).is_none());
}

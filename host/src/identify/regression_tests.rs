//! Intervals, dependent columns and repeating windows on made rows.

use super::*;
use crate::identify::windows::frequency_of_row;
use rand::{RngExt, SeedableRng};

/// Windows of random columns whose target has noise that grows with frequency and is shared inside
/// a window.
fn windows(seed: u64, n: usize, frequencies: usize, truth: &[f64]) -> Vec<WindowRows> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let p = truth.len();
    (0..n)
        .map(|index| {
            let shared: f64 = rng.random_range(-1.0..1.0);
            let mut rows = Vec::new();
            for r in 0..row_count(frequencies) {
                let columns: Vec<f64> = (0..p).map(|_| rng.random_range(-1.0..1.0)).collect();
                let noise = rng.random_range(-1.0..1.0) + shared;
                let clean: f64 = columns.iter().zip(truth).map(|(a, b)| a * b).sum();
                rows.extend(&columns);
                rows.push(clean + noise * 0.01 * (1.0 + frequency_of_row(r) as f64));
            }
            WindowRows { start_s: index as f64, index, run: 0, equations: vec![rows] }
        })
        .collect()
}

#[test]
fn intervals_cover_the_truth_though_rows_share_their_noise() {
    let truth = [1.0, -2.0, 0.5];
    let (mut inside, mut count) = (0, 0);
    for seed in 0..300 {
        let s = solve(&windows(seed, 40, 10, &truth), &[3], 10).unwrap();
        for (i, t) in truth.iter().enumerate() {
            count += 1;
            inside += usize::from((s.coefficients[0][i] - t).abs() < 1.96 * s.covariance[(i, i)].sqrt());
        }
    }
    let share = f64::from(inside as u32) / f64::from(count);
    assert!((0.92..=0.99).contains(&share), "{share}");
}

#[test]
fn a_column_of_zeros_is_named() {
    let mut w = windows(1, 20, 4, &[1.0, 2.0]);
    for window in &mut w {
        window.equations[0].chunks_exact_mut(3).for_each(|row| row[1] = 0.0);
    }
    assert_eq!(solve(&w, &[2], 4).unwrap_err(), Unsolvable::Dependent { equation: 0, column: 1 });
}

#[test]
fn windows_that_repeat_are_recognised_and_widen_the_interval() {
    let one = windows(1, 1, 10, &[1.0, 2.0]).remove(0);
    let repeated: Vec<WindowRows> = (0..40).map(|index| WindowRows { index, ..one.clone() }).collect();
    let s = solve(&repeated, &[2], 10).unwrap();
    assert!(s.repeating && s.repetition > 0.99);
    let alone = solve(&windows(3, 40, 10, &[1.0, 2.0]), &[2], 10).unwrap();
    assert!(!alone.repeating, "{}", alone.repetition);
    assert!(s.covariance[(0, 0)] > 5.0 * alone.covariance[(0, 0)]);
}

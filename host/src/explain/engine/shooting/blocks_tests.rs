//! Least squares over windows: signs that are kept, and the covariance of even noise.

use super::*;
use crate::explain::ranking;

/// A Gram matrix of three columns with what coefficients leave of the target.
fn about_others(gram: &DMatrix<f64>, x: [f64; 3]) -> DMatrix<f64> {
    let mut change = DMatrix::identity(4, 4);
    (0..3).for_each(|i| change[(i, 3)] = -x[i]);
    change.transpose() * gram * change
}

/// y = 2 a − b + c over blocks of random rows: free, all are found; with b ≥ 0 it is held, and
/// the others are those of a fit without it.
#[test]
fn a_coefficient_of_the_wrong_sign_is_held_at_zero() {
    let mut seed = 7_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let grams: Vec<DMatrix<f64>> = (0..12)
        .map(|_| {
            let mut gram = DMatrix::zeros(4, 4);
            for _ in 0..20 {
                let (a, b, c) = (random(), random(), random());
                let row = DVector::from_vec(vec![a, b, c, 2.0 * a - b + c + 0.01 * random()]);
                gram += &row * row.transpose();
            }
            gram
        })
        .collect();
    let parts: Vec<Vec<Part>> =
        grams.iter().map(|g| vec![Part { gram: Gram::of_own(g.clone()), freedom: 20.0 }]).collect();
    let blocks = |signs: [f64; 3]| Blocks::new(parts.clone(), signs.to_vec(), Vec::new());
    let free = blocks([0.0; 3]).fit(&[0, 1, 2]).unwrap();
    assert!((free.all[1] + 1.0).abs() < 0.01, "{}", free.all);
    let kept = blocks([1.0, 1.0, 0.0]).fit(&[0, 1, 2]).unwrap();
    let without = blocks([0.0; 3]).fit(&[0, 2]).unwrap();
    assert_eq!(kept.all[1], 0.0);
    assert!((kept.all[0] - without.all[0]).abs() < 1e-12, "{}", kept.all);
    assert!(kept.covariance[(1, 1)] > 0.0 && kept.held_out.iter().sum::<f64>() > 0.1);
    // Of either sign where that is asked of the last.
    let either = blocks([1.0, 1.0, 0.0]).fit_of_either_sign(&[0, 2, 1], 1).unwrap();
    assert!((either.all[2] + 1.0).abs() < 0.01, "{}", either.all);
    // The same about other coefficients: the target is what these leave.
    let about = [1.5, 0.4, 0.9];
    let moved: Vec<Vec<Part>> =
        grams.iter().map(|g| vec![Part { gram: Gram::of_own(about_others(g, about)), freedom: 20.0 }]).collect();
    let other = Blocks::new(moved, vec![1.0, 1.0, 0.0], about.to_vec()).fit(&[0, 1, 2]).unwrap();
    assert!((other.all[1]).abs() < 1e-12 && (other.all[0] - kept.all[0]).abs() < 1e-9, "{}", other.all);
    assert!((other.held_out[3] / kept.held_out[3] - 1.0).abs() < 1e-6);
    // The second column taken away, about coefficients that hold it: what the others are by
    // themselves.
    let about = [1.5, -0.8, 0.9];
    let moved: Vec<Vec<Part>> =
        grams.iter().map(|g| vec![Part { gram: Gram::of_own(about_others(g, about)), freedom: 20.0 }]).collect();
    let blocks_about = Blocks::new(moved, vec![0.0; 3], about.to_vec());
    let gone = blocks_about.without(1..2).fit(&[0, 2]).unwrap();
    assert!((&gone.all - &without.all).amax() < 1e-9, "{} {}", gone.all, without.all);
    assert!((gone.held_out[3] / without.held_out[3] - 1.0).abs() < 1e-6);
    // Blocks that leave ten times the noise count a tenth.
    let mut weighed = blocks([0.0; 3]);
    let misfits: Vec<Vec<f64>> = (0..12).map(|k| vec![if k < 6 { 0.5 } else { 10.0 }]).collect();
    weighed.weigh(&misfits);
    assert!((weighed.noise() - (6.0 * 20.0 + 6.0 * 2.0)).abs() < 1e-12);
}

/// Rows of one horizon: the covariance of even noise is that of ordinary least squares. Twice
/// the same rows as two horizons tell no more: it stays what it is.
#[test]
fn even_noise_gives_the_covariance_of_ordinary_least_squares() {
    let mut seed = 3_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let grams: Vec<DMatrix<f64>> = (0..30)
        .map(|_| {
            (0..20).fold(DMatrix::zeros(3, 3), |gram, _| {
                let (a, b) = (random(), random());
                let row = DVector::from_vec(vec![a, b, a + 0.5 * b + 0.1 * random()]);
                gram + &row * row.transpose()
            })
        })
        .collect();
    let part = |g: &DMatrix<f64>| Part { gram: Gram::of_own(g.clone()), freedom: 20.0 };
    let once = Blocks::new(grams.iter().map(|g| vec![part(g)]).collect(), vec![0.0; 2], Vec::new());
    let fit = once.fit(&[0, 1]).unwrap();
    let total = grams.iter().fold(DMatrix::zeros(3, 3), |s, g| s + g);
    let normal = total.view((0, 0), (2, 2)).into_owned();
    let left = squares(&total, &fit.all) / (30.0 * 20.0 - 2.0);
    let plain = normal.try_inverse().unwrap() * left;
    let even = fit.even.unwrap();
    assert!((&even - &plain).amax() < 1e-9 * plain.amax(), "{even} {plain}");
    let twice = Blocks::new(grams.iter().map(|g| vec![part(g), part(g)]).collect(), vec![0.0; 2], Vec::new());
    let even = twice.fit(&[0, 1]).unwrap().even.unwrap();
    assert!((&even - &plain).amax() < 0.01 * plain.amax(), "{even} {plain}");
}

/// A ridge adds its share of the column's square to the normal matrix, whatever the windows weigh.
#[test]
fn a_ridge_makes_a_column_stiffer() {
    let (first, second) = (DVector::from_vec(vec![1.0, 2.0, 3.0]), DVector::from_vec(vec![2.0, -1.0, 1.0]));
    let gram = &first * first.transpose() + &second * second.transpose();
    let parts = (0..6).map(|_| vec![Part { gram: Gram::of_own(gram.clone()), freedom: 2.0 }; 2]).collect();
    let mut blocks = Blocks::new(parts, vec![0.0; 2], Vec::new());
    let misfits: Vec<Vec<f64>> = (0..6).map(|k| vec![1.0 + f64::from(k), 2.0]).collect();
    blocks.weigh(&misfits);
    let weight: f64 = misfits.iter().flatten().map(|e| 1.0 / e).sum();
    let mut normal = gram.view((0, 0), (2, 2)) * weight;
    normal[(1, 1)] *= 1.5;
    let wanted = normal.try_inverse().unwrap() * (gram.column(2).rows(0, 2) * weight);
    let found = blocks.fit_ridge(&[0, 1], &[0.0, 0.5]).unwrap().all;
    assert!((&found - &wanted).amax() < 1e-12, "{found} {wanted}");
    assert!((blocks.fit(&[0, 1]).unwrap().all - DVector::from_vec(vec![1.0, 1.0])).amax() < 1e-12);
}

/// A strength that one window alone shows takes nothing from what the others show of its fellow.
#[test]
fn what_one_window_alone_shows_does_not_spoil_the_rest() {
    let mut seed = 11_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let parts: Vec<Vec<Part>> = (0..12)
        .map(|window| {
            let mut gram = DMatrix::zeros(4, 4);
            for _ in 0..20 {
                let fades = |x: f64| if window == 0 { x } else { 1e-8 * x };
                let (a, b, c) = (20.0 * random(), fades(random()), fades(random()));
                let row = DVector::from_vec(vec![a, b, c, 2.0 * a + 0.3 * b - 0.2 * c + 2.0 * random()]);
                gram += &row * row.transpose();
            }
            vec![Part { gram: Gram::of_own(gram), freedom: 20.0 }]
        })
        .collect();
    let blocks = Blocks::new(parts, vec![0.0; 3], Vec::new());
    let (fit, alone) = (blocks.fit(&[0, 1, 2]).unwrap(), blocks.fit(&[0]).unwrap());
    assert!((fit.all[0] - 2.0).abs() < 0.02, "{}", fit.all);
    assert!(ranking::p_value(&fit, 3) < 1e-6, "{}", ranking::p_value(&fit, 3));
    // Where it is not held no block is worse for it.
    let worse = fit.held_out.iter().zip(&alone.held_out).map(|(a, b)| a / b).fold(0.0, f64::max);
    assert!(worse < 1.02, "{worse}");
}

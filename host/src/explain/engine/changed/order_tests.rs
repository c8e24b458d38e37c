//! Tests of what depends on time.

use super::*;

/// Even numbers between -1 and 1.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    move || 2.0 * rng.random::<f64>() - 1.0
}

/// Gram matrices of blocks of 60 rows y = a x₁ + b x₂ + noise, with coefficients and a size of the
/// motion of each block.
fn blocks(count: usize, seed: u64, of: impl Fn(usize) -> ([f64; 2], f64)) -> Vec<DMatrix<f64>> {
    let mut noise = noise(seed);
    let one = |k: usize| {
        let ([a, b], size) = of(k);
        let mut gram = DMatrix::zeros(3, 3);
        for _ in 0..60 {
            let x = [size * noise(), size * noise()];
            let row = [x[0], x[1], a * x[0] + b * x[1] + 0.1 * noise()];
            gram += DMatrix::from_fn(3, 3, |i, j| row[i] * row[j]);
        }
        gram
    };
    (0..count).map(one).collect()
}

#[test]
fn coefficients_that_change_at_once_are_found_where_they_do() {
    let step = blocks(24, 1, |k| ([1.0, if k < 14 { 0.5 } else { 0.6 }], 1.0));
    let mut size = noise(2);
    let by: Vec<f64> = (0..24).map(|_| size()).collect();
    for groups in [together(24), alike(&by)] {
        let (at, cut) = Measure::Coefficients(&step).in_time(&[groups]).unwrap();
        assert_eq!(at, 14);
        let times: Vec<f64> = (0..24).map(f64::from).collect();
        assert!(cut < left_by_drift(&step, &times).unwrap());
    }
    let drift = blocks(24, 3, |k| ([1.0, 0.5 + 0.01 * k as f64], 1.0));
    let times: Vec<f64> = (0..24).map(f64::from).collect();
    let (_, cut) = Measure::Coefficients(&drift).in_time(&[together(24), alike(&by)]).unwrap();
    assert!(left_by_drift(&drift, &times).unwrap() < cut);
}

/// By 0.5 % a test, of which 0.3 of 60 are expected.
#[test]
fn nothing_is_found_where_nothing_changes() {
    let found = |seed| Measure::Coefficients(&blocks(20, seed, |_| ([1.0, 0.5], 1.0))).in_time(&[together(20)]);
    assert!((0..60).filter_map(found).count() <= 2);
}

/// A law that is wrong where the motion is large, in a swing that dies: what is left goes with time,
/// and with the motion as well.
#[test]
fn what_goes_with_the_motion_is_no_change_in_time() {
    let size = |k: usize| (-0.1 * k as f64).exp();
    for seed in 0..10 {
        let dies = blocks(30, seed, |k| ([1.0, 0.5 + 0.5 * size(k)], size(k)));
        let by: Vec<f64> = (0..30).map(size).collect();
        let logs: Vec<f64> = (0..30).map(|k| (1.0 + 1e4 * size(k).powi(4)).ln()).collect();
        for of in [Measure::Coefficients(&dies), Measure::Levels(&logs)] {
            assert!(of.in_time(&[together(30)]).is_some(), "{seed}");
            assert!(of.in_time(&[together(30), alike(&by)]).is_none(), "{seed}");
        }
    }
}

#[test]
fn what_is_left_of_one_part_only_is_found() {
    let mut chance = noise(4);
    let logs: Vec<f64> = (0..23).map(|k| if k < 11 { 0.0 } else { 8.0 } + chance()).collect();
    let by: Vec<f64> = (0..23).map(|_| chance()).collect();
    assert_eq!(Measure::Levels(&logs).in_time(&[together(23), alike(&by)]).map(|f| f.0), Some(11));
    // Windows that are left out, all of them at the end, or here and there.
    let out = |is_out: &dyn Fn(usize) -> bool| (0..24).map(|k| f64::from(is_out(k))).collect::<Vec<f64>>();
    assert_eq!(Measure::Levels(&out(&|k| k > 18)).in_time(&[together(24)]).map(|f| f.0), Some(19));
    assert!(Measure::Levels(&out(&|k| k % 5 == 2)).in_time(&[together(24)]).is_none());
    assert!(Measure::Levels(&[1.0; 4]).in_time(&[together(4)]).is_none());
}

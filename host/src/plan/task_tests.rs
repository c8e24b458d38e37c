//! Bounds of a prediction.

use super::*;

#[test]
fn one_more_is_within_the_bounds_of_a_prediction() {
    // Of 1, e² and e⁴: logarithms 0, 2, 4; mean 2, sd 2; t of 2 degrees of freedom at 97.5 % is
    // 4.3027.
    let e = core::f64::consts::E;
    let all = [1.0, e.powi(2), e.powi(4)];
    let half = 4.302_653 * 2.0 * (4.0_f64 / 3.0).sqrt();
    assert!((bound(&all, 0.0).ln() - 2.0).abs() < 1e-12);
    assert!((bound(&all, 1.0).ln() - 2.0 - half).abs() < 1e-4, "{}", bound(&all, 1.0).ln());
    assert!((bound(&all, -1.0).ln() - 2.0 + half).abs() < 1e-4);
    assert!((bound(&[3.0], -1.0) - 3.0).abs() < 1e-12);
    assert_eq!(bound(&[3.0, 0.0], 1.0), 0.0);
}

//! What is strongest in slow swings read in steps, beside drifts, in noise, of arms that turn.

use super::super::coordinate::{Spectrum, describe};
use super::*;

fn motion(space: Space, x: Vec<f64>) -> Motion {
    Motion {
        name: "x".into(),
        unit: if space == Space::S1 { "rad" } else { "m" }.into(),
        space,
        derived: false,
        step: 0.0,
        quantisation_noise: 0.0,
        stretches: vec![x],
    }
}

fn spectrum_of(space: Space, rate_hz: f64, x: Vec<f64>) -> Spectrum {
    describe(&motion(space, x), None, rate_hz, None, 4).spectrum.unwrap()
}

/// Numbers between −½ and ½ that look like noise.
fn noise(n: usize) -> Vec<f64> {
    let mut seed = 1_u64;
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..n).map(|_| next()).collect()
}

/// A swing of 0.4 Hz that decays, from a camera's 30 pictures a second, read in steps.
fn swing(n: usize, step: f64) -> Vec<f64> {
    let t = (0..n).map(|i| i as f64 / 30.0);
    t.map(|t| ((0.16 * (-0.02 * t).exp() * (TAU * 0.4 * t + 2.0).cos()) / step).round() * step).collect()
}

#[test]
fn a_slow_swing_of_two_periods_has_its_frequency_whatever_its_unit() {
    for (space, n) in [(Space::S1, 157), (Space::R, 157), (Space::S1, 627), (Space::R, 627)] {
        let found = spectrum_of(space, 30.0, swing(n, 0.00153)).strongest.unwrap();
        assert!((found.frequency_hz - 0.4).abs() < 0.01 && !found.broad, "{n}: {found:?}");
    }
}

#[test]
fn text_and_json_tell_the_same() {
    let found = spectrum_of(Space::S1, 30.0, swing(157, 0.00153));
    let json = serde_json::to_value(&found).unwrap();
    assert_eq!(json["strongest"]["frequency_hz"].as_f64(), found.strongest.map(|s| s.frequency_hz));
    assert_eq!(json["strongest"]["broad"], false);
}

#[test]
fn a_drift_is_no_line_and_hides_none() {
    let tone = |i: usize| (TAU * 5.0 * i as f64 / 100.0).sin();
    let x = (0..2000).map(|i| 0.1 * i as f64 + 1e-5 * (i * i) as f64 + tone(i)).collect();
    let found = spectrum_of(Space::R, 100.0, x).strongest.unwrap();
    assert!((found.frequency_hz - 5.0).abs() < 0.02, "{found:?}");
}

#[test]
fn noise_has_no_frequency() {
    assert_eq!(spectrum_of(Space::R, 100.0, noise(5000)).strongest, None);
}

#[test]
fn an_arm_that_turns_has_that_of_its_velocity() {
    let x = (0..40_000).map(|i| f64::from(i) / 500.0).map(|t| TAU * 5.0 * t + 0.2 * (TAU * 2.5 * t).sin()).collect();
    let found = describe(&motion(Space::S1, x), None, 500.0, Some(5.0), 4).spectrum.unwrap().strongest.unwrap();
    assert_eq!((found.name.as_deref(), found.broad), (Some("f_e/2"), false), "{found:?}");
}

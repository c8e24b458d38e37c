//! Joints that stick, and motions that only look so.

use core::f64::consts::TAU;
use std::path::Path;

use nalgebra::DMatrix;

use super::*;
use crate::rig::{Rig, as_own};
use crate::signal::angles::Phase;

const Q: f64 = TAU / 1024.0;
const WINDOWS: Windows = Windows { length_s: 3.0, hop_s: 1.5, frequencies: 30 };
const COUNT: [Fineness; 2] = [Fineness::Counts(Q); 2];

fn bound() -> ObservedModel {
    let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap();
    let own = as_own::coordinates(&rig).unwrap();
    let bound = (*own.bound.unwrap()).clone();
    assert_eq!(bound.shown, DMatrix::from_row_slice(2, 2, &[1.0, 0.0, -1.0, 1.0]));
    bound
}

fn stretch(phi: impl Fn(f64) -> f64) -> Stretch {
    let x: Vec<f64> = (0..5000).map(|i| ((phi(i as f64 * 0.002) / Q).floor() + 0.5) * Q).collect();
    let second = x.iter().enumerate().map(|(i, x)| x + i as f64 * 0.01).collect();
    Stretch {
        start_s: 0.0,
        step_s: 0.002,
        coordinates: vec![x, second],
        inputs: Vec::new(),
        phase: Phase::Clock(0.0),
        amplitude_nm: None,
        history: None,
        base: None,
    }
}

/// Noise on a motion that stops. A swing of a tenth of the noise is no motion, one of ten times
/// the noise is.
#[test]
fn a_joint_that_sticks_is_seen_through_noise() {
    let bound = bound();
    let (sigma, mut seed) = (1e-3, 7_u32);
    let mut noise = || {
        let mut uniform = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
        };
        sigma * (0..12).map(|_| uniform()).sum::<f64>()
    };
    let mut with = |phi: &dyn Fn(f64) -> f64| {
        let mut out = stretch(|_| 0.0);
        out.coordinates[0] = (0..5000).map(|i| phi(0.002 * f64::from(i)) + noise()).collect();
        out.coordinates[1] = (0..5000).map(|i| (0.05 * f64::from(i)).sin()).collect();
        out
    };
    let sensors = [Fineness::Noise(sigma), Fineness::Noise(1e-6)];
    let sticks = with(&|t| if t < 4.0 { (7.0 * t).sin() } else { 0.1 });
    let found = standstills(&sticks, &bound, &sensors, 0.5);
    assert!(!found.is_empty() && found.iter().all(|s| s.sensor == 0), "{found:?}");
    let all = merged(&found);
    assert!(all.len() == 1 && all[0].0.abs_diff(2000) < 40 && all[0].1 == 5000, "{all:?}");
    assert!(!standstills(&with(&|t| 1e-4 * (14.0 * t).sin()), &bound, &sensors, 0.5).is_empty());
    assert!(standstills(&with(&|t| 1e-2 * (14.0 * t).sin()), &bound, &sensors, 0.5).is_empty());
}

/// Few samples, at a turning point: means of two stay within what noise gives.
#[test]
fn a_turning_point_that_stands_out_of_the_noise_is_no_standstill() {
    let bound = bound();
    let noise = |i: i32| f64::from((i * 7919) % 1009) / 1009.0 - 0.5;
    let with = |bend: f64| {
        let mut out = stretch(|_| 0.0);
        out.coordinates[0] = (0..200).map(|i| bend * f64::from(i - 100).powi(2) + 3.46 * noise(i)).collect();
        out.coordinates[1] = (0..200).map(|i| 3.0 * f64::from(i)).collect();
        out
    };
    let sensors = [Fineness::Noise(1.0), Fineness::Noise(1e-6)];
    let near = |found: &[Span]| found.iter().any(|s| s.sensor == 0 && s.first <= 100 && s.last >= 100);
    assert!(near(&standstills(&with(0.0), &bound, &sensors, 0.032)));
    assert!(!near(&standstills(&with(0.07), &bound, &sensors, 0.032)));
}

/// A circuit charged and discharged by steps rests on plateaus; with an inertia in its equation
/// the same numbers are those of a joint that may be held.
#[test]
fn what_has_no_inertia_settles_and_is_not_held() {
    let folder = tempfile::tempdir().unwrap();
    let model = "name = \"c\"\ntime = \"s\"\ncoordinates = [{ name = \"y\", space = \"R\" }]\ninputs = [\"u\"]\n\
        [[equation]]\nbalance = \"u\"\nterms = { a = \"y'\", g = \"y\" }\n";
    let rig = "name = \"c\"\nmodel = \"m.toml\"\nsample_rate_hz = 500.0\nchannel = [\n\
        { name = \"y\", measures = \"y\", unit = \"V\" },\n{ name = \"u\", measures = \"u\", unit = \"V\" },\n]\n";
    let mut charged = stretch(|t| {
        let (half, s) = (t % 2.0, (-20.0 * (t % 1.0)).exp());
        if half < 1.0 { 1.0 - s } else { s }
    });
    charged.coordinates.truncate(1);
    for (model, is_held) in [(model.to_owned(), false), (model.replace("y'", "y''"), true)] {
        std::fs::write(folder.path().join("m.toml"), model).unwrap();
        let at = folder.path().join("rig.toml");
        std::fs::write(&at, rig).unwrap();
        let rig = Rig::read(&at).unwrap();
        let bound = rig.bound.as_deref().unwrap();
        let found = standstills(&charged, bound, &[Fineness::Counts(Q)], 0.5);
        assert_eq!(!found.is_empty(), is_held, "{found:?}");
    }
}

#[test]
fn a_joint_that_sticks_is_left_out_and_one_that_turns_is_not() {
    let bound = bound();
    let sticks = stretch(|t| if t < 4.0 { (7.0 * t).sin() } else { 0.1 });
    let found = standstills(&sticks, &bound, &COUNT, 0.5);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].first.abs_diff(2000) < 30 && (found[0].last, found[0].sensor) == (5000, 0), "{found:?}");
    assert!(standstills(&stretch(|t| 0.3 * (5.0 * t).sin()), &bound, &COUNT, 0.5).is_empty());
    // Turning points of a slow swing of few counts are no standstills, nor is a flat place of
    // two frequencies.
    let slow = stretch(|t| 0.02 * (0.7 * t).sin());
    assert_eq!(standstills(&slow, &bound, &COUNT, 0.5), []);
    let beat = stretch(|t| 40.0 * Q * ((2.5 * (t - 5.0)).cos() - 0.25 * (5.0 * (t - 5.0)).cos()));
    assert!(!within(&beat.coordinates[0], COUNTS * Q, 250).is_empty());
    assert_eq!(standstills(&beat, &bound, &COUNT, 0.5), []);
    let (mut stretches, mut records) = (vec![sticks], vec![3]);
    let still = leave_out(&mut stretches, &mut records, &bound, &COUNT, &WINDOWS);
    assert!(stretches.len() == 1 && stretches[0].len().abs_diff(2000) < 30 && still.len() == 1);
    assert!((still[0].sensor, still[0].record) == (0, 3) && (still[0].stretch.start_s - 4.0).abs() < 0.06);
    assert_eq!(records, [3]);
    // Stop and go: what is left would have no room for windows.
    let mut goes = vec![stretch(|t| if t % 2.0 < 1.3 { (7.0 * t).sin() } else { 0.1 })];
    assert!(leave_out(&mut goes, &mut records, &bound, &COUNT, &WINDOWS).is_empty() && goes.len() == 1);
    // Nothing long enough would be left: what to say of such a record is for others to decide.
    let mut all = vec![stretch(|_| 0.1)];
    assert!(leave_out(&mut all, &mut records, &bound, &COUNT, &WINDOWS).is_empty());
    assert!(all.len() == 1 && all[0].len() == 5000);
}

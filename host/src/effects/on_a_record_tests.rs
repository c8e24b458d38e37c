//! What sensors show against motions that are known at all times.

use super::*;
use crate::effects::catalogue;
use crate::effects::entry::stand_ins;
use crate::model::model_file::expression::multiply;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::Value;

const STEP_S: f64 = 0.002;
/// Samples of the kernel of [`BandLimited`] beside an end.
const AT_AN_END: usize = 48;

/// The laws of an entry that reads, with strengths.
fn laws(id: &str, strengths: &[f64]) -> Vec<Addition> {
    let entry = catalogue().iter().find(|e| e.id == id).unwrap();
    let Value::Scalar(p) = entry.law(&stand_ins(&["x", "v"]), &Vec::new()).unwrap() else { panic!("{id}") };
    let parts = p.by_parameters();
    let of = |k: usize| parts.get(&vec![(Atom::Parameter(k), 1)]).map(Polynomial::node).unwrap();
    strengths.iter().enumerate().map(|(k, s)| (of(k), *s)).collect()
}

/// A swing of 2 rad at 1.3 Hz about 0.4 rad.
fn swing(t: f64) -> f64 {
    0.4 + 2.0 * (core::f64::consts::TAU * 1.3 * t).sin()
}

fn samples(of: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..1000).map(|i| of(3.0 + i as f64 * STEP_S)).collect()
}

fn at(values: &[f64]) -> Samples<'_> {
    Samples { values, start_s: 3.0, step_s: STEP_S }
}

/// Both strengths of an eccentricity of e are one law: e³ of it is left after three inversions, e⁴
/// in all. One strength taken off after the other would leave C S = 5·10⁻³ rad, a first order e²/2.
#[test]
fn a_strong_eccentricity_leaves_the_fourth_power() {
    let (c, s) = (0.06, 0.08);
    let seen = samples(|t| swing(t) + c * swing(t).sin() + s * swing(t).cos());
    let found = taken_off(&at(&seen), &laws("eccentricity", &[c, s]));
    for (x, wanted) in found.iter().zip(samples(swing)) {
        assert!((x - wanted).abs() < 1.01e-4, "{x} {wanted}");
    }
    let shown = put_on(&at(&samples(swing)), None, &laws("eccentricity", &[c, s]));
    assert!(shown.iter().zip(&seen).all(|(a, b)| (a - b).abs() < 1e-14));
}

/// 2.5 samples are a shift, which the first order −d v would miss by d² a/2 = 1.7·10⁻³ rad.
#[test]
fn a_delay_is_a_shift() {
    let d = 2.5 * STEP_S;
    let seen = samples(|t| swing(t - d));
    let found = taken_off(&at(&seen), &laws("channel-delay", &[d]));
    let shown = put_on(&at(&samples(swing)), None, &laws("channel-delay", &[d]));
    let within = AT_AN_END..seen.len() - AT_AN_END;
    for (i, wanted) in samples(swing).into_iter().enumerate().filter(|(i, _)| within.contains(i)) {
        // 10⁻⁶ of the amplitude each: the interpolation's own error.
        assert!((found[i] - wanted).abs() < 4e-6 && (shown[i] - seen[i]).abs() < 4e-6, "{i}");
    }
}

/// All laws of a sensor take what ought to be shown, whatever the order in which they stand, and
/// what is late is late as a whole.
#[test]
fn effects_on_one_sensor_have_no_order() {
    let (d, b, e, s) = (0.003, 0.02, 0.01, 0.004);
    let add = |x: f64| x + b + e * x.sin() + s * x;
    let seen = samples(|t| add(swing(t - d)));
    let mut all = [laws("channel-delay", &[d]), laws("zero-offset", &[b])].concat();
    all.extend([laws("scale-error", &[s]), laws("eccentricity", &[e, 0.0])].concat());
    for _ in 0..2 {
        let found = taken_off(&at(&seen), &all);
        let within = AT_AN_END..seen.len() - AT_AN_END;
        for (i, wanted) in samples(swing).into_iter().enumerate().filter(|(i, _)| within.contains(i)) {
            // Slopes up to 0.014 leave that to the third of 0.04 rad, 1.1·10⁻⁷, beside the shift's.
            assert!((found[i] - wanted).abs() < 4.2e-6, "{i}: {}", found[i] - wanted);
        }
        all.reverse();
    }
}

/// Rates that are known take the place of differences.
#[test]
fn known_rates_are_used() {
    let v = || symbol(Symbol::Rate(0));
    let shown = put_on(&at(&[1.0, 1.0]), Some(&[2.0, -3.0]), &[(multiply(v(), v()), 0.25)]);
    assert_eq!(shown, [2.0, 3.25]);
}

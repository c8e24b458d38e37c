//! Tests of tables: the spline exactly, its bounds against brute force, what is refused.

use super::*;
use crate::excitation::{Component, Form, Glide, Law};
use proptest::prelude::*;
use std::vec::Vec;

const LIMITS: ShakerLimits = ShakerLimits {
    amplitude_micrometre: 20_000,
    frequency_millihertz: 20_000,
    ramp_micrometre_per_s: 20_000,
    acceleration_millimetre_per_s2: 40_000,
};

/// The spline from its definition: y/a, and first and second derivative by turns.
fn exact(points: &[i16], turns: f64) -> [f64; 3] {
    let n = points.len();
    let x = turns * n as f64;
    let mut sums = [0.0; 3];
    // B(x) has its support within 2 of its point.
    for j in x.floor() as i64 - 2..=x.floor() as i64 + 3 {
        let c = f64::from(points[j.rem_euclid(n as i64) as usize]) / 32_768.0;
        let (d, sign) = ((x - j as f64).abs(), (x - j as f64).signum());
        let values = if d < 1.0 {
            [2.0 / 3.0 - d * d + d * d * d / 2.0, -2.0 * d + 1.5 * d * d, -2.0 + 3.0 * d]
        } else if d < 2.0 {
            let r = 2.0 - d;
            [r * r * r / 6.0, -r * r / 2.0, r]
        } else {
            [0.0; 3]
        };
        for (sum, value) in sums.iter_mut().zip([values[0], sign * values[1], values[2]]) {
            *sum += c * value;
        }
    }
    let n = n as f64;
    [sums[0], sums[1] * n, sums[2] * n * n]
}

fn some_points() -> Vec<i16> {
    (0..100_i32).map(|j| (j * 7_919 % 60_001 - 30_000) as i16).collect()
}

fn excitation(table: &Table) -> Excitation {
    Excitation { table: table.known().name, ..Excitation::sine(5_000, 1_000) }
}

proptest! {
    #[test]
    fn a_table_is_its_spline_within_a_nanometre_and_never_beyond_its_amplitude(
        points in prop::collection::vec(any::<i16>(), 8..=256), amplitude in 0_u32..100_000_000, phase: u32,
    ) {
        let table = Table::of(&points).unwrap();
        let [y, slope, _] = exact(&points, f64::from(phase) / 4_294_967_296.0);
        let a = f64::from(amplitude);
        let found = table.displacement(amplitude, phase);
        prop_assert!((f64::from(found) - a * y).abs() <= 0.5 + 1.5e-8 * a, "{found} for {}", a * y);
        let most = points.iter().map(|c| f64::from(*c).abs()).fold(0.0, f64::max) / 32_768.0;
        prop_assert!(f64::from(found).abs() <= a * most + 0.5 + 1.5e-8 * a && found.unsigned_abs() <= amplitude);
        let rough = table.slope(phase);
        prop_assert!((f64::from(rough[0]) - y).abs() < 1e-6);
        prop_assert!((f64::from(rough[1]) - slope).abs() < 1e-5 * points.len() as f64, "{rough:?} for {slope}");
        prop_assert!(slope.abs() <= f64::from(table.steepest()) + 1e-3);
    }

    #[test]
    fn the_acceleration_is_bounded_by_second_differences_which_it_reaches(
        points in prop::collection::vec(any::<i16>(), 8..=64), millihertz in 1_u32..7_000,
    ) {
        let table = Table::of(&points).unwrap();
        let n = points.len();
        // By brute force: fifty places between two points, and the points.
        let bend = (0..50 * n).map(|i| exact(&points, i as f64 / (50 * n) as f64)[2].abs()).fold(0.0, f64::max);
        let bound = f64::from(table.known().sharpest) / 32_768.0 * (n * n) as f64;
        prop_assert!((bend / bound - 1.0).abs() < 1e-9, "{bend} for {bound}");
        let limit = f64::from(table.known().amplitude_limit(40_000, millihertz));
        let acceleration = |micrometre: f64| micrometre * 1e-6 * bend * (f64::from(millihertz) / 1e3).powi(2);
        prop_assert!(acceleration(limit) <= 40.0 * (1.0 + 1e-9), "{}", acceleration(limit));
        prop_assert!(acceleration(limit + 1.0) > 40.0 * (1.0 - 1e-9));
    }
}

#[test]
fn the_greatest_values_leave_no_sum_beyond_its_bits() {
    for points in [[i16::MIN, i16::MAX].repeat(4), [i16::MIN; 8].to_vec(), [i16::MAX; 9].to_vec()] {
        let table = Table::of(&points).unwrap();
        for phase in (0..u32::MAX - 70_001).step_by(70_001) {
            assert!(table.displacement(u32::MAX, phase).unsigned_abs() <= i32::MAX as u32);
            assert!(table.displacement(1_000_000_000, phase).unsigned_abs() <= 1_000_000_000);
        }
    }
    assert_eq!(Table::of(&[i16::MIN; 8]).unwrap().displacement(5_000, 77), -5_000);
    assert_eq!((Table::EMPTY.displacement(5_000, 77), Table::EMPTY.points().len()), (0, 0));
}

#[test]
fn parts_bring_it_in_any_order_and_a_lost_or_other_one_is_known_by_its_check() {
    let points = some_points();
    let table = Table::of(&points).unwrap();
    let parts: Vec<Part> = table.parts().collect();
    assert_eq!(parts.len(), 17);
    let brought = |parts: &[Part]| {
        let (mut other, mut none) = (Table::EMPTY, Excitation::default());
        // Something was there before.
        other.points.fill(-5);
        parts.iter().for_each(|part| none.put(*part, &mut other).unwrap());
        other.extent(100).unwrap()
    };
    assert_eq!(brought(&parts), table.known());
    let mut all = parts.clone();
    all.reverse();
    all.extend(&parts[2..4]);
    assert_eq!(brought(&all), table.known());
    for lost in 0..17 {
        let mut some = parts.clone();
        let gone = some.remove(lost);
        assert_ne!(brought(&some).name, table.known().name);
        if let Part::Points { place, mut points } = gone {
            points[3] ^= 1;
            some.push(Part::Points { place, points });
            assert_ne!(brought(&some).name, table.known().name);
            let beyond = Part::Points { place: 43, points };
            assert_eq!(Excitation::default().put(beyond, &mut Table::EMPTY.clone()), Err(42));
        }
    }
    // The last place of the longest table has room for four.
    let longest = Table::of(&[-9; 256]).unwrap();
    assert_eq!(
        (longest.parts().count(), brought(&longest.parts().collect::<Vec<_>>())),
        (43, Table::of(&[-9; 100]).unwrap().known())
    );
    assert_eq!([7, 257].map(|n| Table::of(&[9; 300][..n])), [None; 2]);
    assert_eq!([7, 257].map(|n| table.extent(n)), [None; 2]);
}

#[test]
fn what_a_shaker_must_not_do_is_refused() {
    let table = Table::of(&some_points()).unwrap();
    let extent = table.known();
    let refused = |e: Excitation| e.refusal(&LIMITS).or_else(|| extent.refusal(&e, &LIMITS, 500_000));
    let good = excitation(&table);
    let most = extent.amplitude_limit(40_000, 1_000);
    assert!((1..5_000).contains(&most));
    assert_eq!(refused(good), Some(Refusal::Acceleration(most)));
    let with = |change: &dyn Fn(&mut Excitation)| {
        let mut excitation = good;
        excitation.amplitudes_micrometre[0] = most;
        change(&mut excitation);
        refused(excitation)
    };
    assert_eq!(with(&|_| {}), None);
    assert_eq!(
        with(&|e| (e.steps, e.hold_ms, e.amplitudes_micrometre[1]) = (2, 500, most + 1)),
        Some(Refusal::Acceleration(most))
    );
    // A hundred points, one a tick at most.
    assert_eq!(with(&|e| (e.frequency_millihertz, e.amplitudes_micrometre[0]) = (5_000, 1)), None);
    assert_eq!(with(&|e| e.frequency_millihertz = 5_001), Some(Refusal::Frequency(5_000)));
    assert_eq!(with(&|e| e.frequency_millihertz = 20_001), Some(Refusal::Frequency(20_000)));
    assert_eq!(with(&|e| e.amplitudes_micrometre[0] = 20_001), Some(Refusal::Amplitude(20_000)));
    assert_eq!(with(&|e| e.table.check ^= 1), Some(Refusal::Table(extent.name.check)));
    assert_eq!(with(&|e| e.table.points = 7), Some(Refusal::Points(8)));
    assert_eq!(with(&|e| e.table.points = 257), Some(Refusal::Points(256)));
    // Alone.
    let glide = Glide { law: Law::Linear, back: false, to_millihertz: 2_000, ms: 1_000 };
    assert_eq!(with(&|e| e.glide = glide), Some(Refusal::Form(32_768)));
    let half = Component { harmonic: 1, share: 1 << 14, phase: 0 };
    assert_eq!(with(&|e| e.form.0[0] = half), Some(Refusal::Form(32_768)));
    assert!(!good.is_sine() && !good.is_constant() && good.form == Form::SINE);
    assert!(good.commands().contains(&crate::frame::Command::Prepare(Part::Table(good.table))));
}

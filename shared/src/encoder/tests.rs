//! Counts, angles and turns: single values, and the laws that hold for any.

use super::*;
use proptest::prelude::*;

fn scale(n: u32) -> CountScale {
    CountScale::new(n).unwrap()
}

#[test]
fn the_middle_of_a_count_is_its_angle() {
    assert_eq!(scale(4).resolution(), PI / 2.0);
    assert_eq!(scale(4).radians(0), PI / 4.0);
    assert_eq!(scale(4).radians(-1), -PI / 4.0);
    assert_eq!(scale(4).wrapped_radians(2), -3.0 * PI / 4.0);
    assert!((scale(4096).radians(4096) - TAU * (1.0 + 0.5 / 4096.0)).abs() < 1e-15);
    // N = 1: every angle is the middle of the turn, which is −π on [−π, π).
    assert_eq!(scale(1).wrapped_radians(5), -PI);
    assert_eq!(CountScale::new(0), None);
}

#[test]
fn counts_within_a_turn() {
    assert_eq!([2047, 2048, -2048, -2049, 4096].map(|c| scale(4096).wrapped(c)), [2047, -2048, -2048, 2047, 0]);
    assert_eq!([2, 3, -2, -3, 5].map(|c| scale(5).wrapped(c)), [2, -2, -2, 2, 0]);
}

#[test]
fn counts_that_are_none() {
    assert_eq!(scale(4096).count(f64::NAN), None);
    assert_eq!(scale(4096).count(f64::INFINITY), None);
    assert_eq!(scale(4096).count(1e300), None);
    assert!(wrap(f64::INFINITY).is_nan());
}

#[test]
fn wrap_is_half_open() {
    assert_eq!(wrap(PI), -PI);
    assert_eq!(wrap(-PI), -PI);
    assert_eq!(wrap(0.0), 0.0);
    assert!(wrap(PI - 1e-15) > 3.0);
    let just_below = f64::from_bits((-PI).to_bits() + 1);
    assert!((-PI..PI).contains(&wrap(just_below)));
}

#[test]
fn rounding_at_odd_multiples_of_pi_leaves_no_angle_outside() {
    for k in -2_000_i32..2_000 {
        let mut angle = f64::from(2 * k + 1) * PI;
        (0..4).for_each(|_| angle = angle.next_down());
        for _ in 0..9 {
            let wrapped = wrap(angle);
            assert!((-PI..PI).contains(&wrapped) && wrapped.abs() > PI - 1e-10, "{angle}: {wrapped}");
            angle = angle.next_up();
        }
    }
}

#[test]
fn unwrapping_the_angle_survives_what_is_not_finite() {
    let mut unwrapper = AngleUnwrapper::default();
    assert_eq!(unwrapper.push(3.0), 3.0);
    assert!(unwrapper.push(f64::NAN).is_nan());
    assert!((unwrapper.push(-3.0) - (TAU - 3.0)).abs() < 1e-15);
}

#[test]
fn unwrapping_modulo_a_turn() {
    let mut unwrapper = Unwrapper::new(1024).unwrap();
    let list = [1020, 1023, 2, 1000, 488, 1000].map(|c| unwrapper.push(c));
    // 1000 → 488 is half a turn back, and back again half a turn back: of two equal steps the
    // negative.
    assert_eq!(list, [1020, 1023, 1026, 1000, 488, -24]);
    assert_eq!(Unwrapper::new(0), None);
    // Begun anew, a value is taken as it is.
    unwrapper.restart();
    assert_eq!([1023, 2].map(|c| unwrapper.push(c)), [1023, 1026]);
}

#[test]
fn direction_is_that_of_the_last_step() {
    let mut turns = MultiTurn::new();
    let mut seen = std::vec::Vec::new();
    for reading in [3, 3, 65_535, 0] {
        turns.update(reading);
        seen.push(turns.direction().sign());
    }
    assert_eq!(seen, [1, 0, -1, 1]);
}

#[test]
fn positions_wrap_at_the_ends_and_can_be_extended() {
    let mut turns = MultiTurn::new();
    let mut line = Unwrapper::wrapping32();
    turns.preset(i32::MAX - 5);
    let mut position = 0;
    for _ in 0..10 {
        position = line.push(i64::from(turns.update(turns.last.wrapping_add(1))));
    }
    assert_eq!(position, i64::from(i32::MAX) + 5);
}

proptest! {
    #[test]
    fn a_count_is_recovered_from_its_angle(count in -1_000_000_000_i64..1_000_000_000, n in 1_u32..100_000) {
        prop_assert_eq!(scale(n).count(scale(n).radians(count)), Some(count));
    }

    #[test]
    fn wrapped_differs_by_whole_turns(count in any::<i64>(), n in any::<u32>().prop_filter("zero", |&n| n > 0)) {
        let wrapped = scale(n).wrapped(count);
        prop_assert!((wrapped - count % i64::from(n)) % i64::from(n) == 0);
        let half = i64::from(n / 2);
        prop_assert!((-half..i64::from(n) - half).contains(&wrapped));
        prop_assert!((-PI..PI).contains(&scale(n).wrapped_radians(count)));
    }

    #[test]
    fn wrap_differs_by_whole_turns(angle in -1e6_f64..1e6) {
        let wrapped = wrap(angle);
        prop_assert!((-PI..PI).contains(&wrapped));
        let turns = (angle - wrapped) / TAU;
        prop_assert!((turns - libm::round(turns)).abs() < 1e-9);
    }

    #[test]
    fn multi_turn_follows_any_walk(steps in proptest::collection::vec(-32_768_i32..32_768, 1..500)) {
        let mut turns = MultiTurn::new();
        let mut position = 0_i64;
        for step in steps {
            position += i64::from(step);
            prop_assert_eq!(i64::from(turns.update(position as u16)), position);
        }
    }

    #[test]
    fn unwrapping_follows_any_walk_below_half_a_period(
        period in 3_u32..1 << 20, start in -1_000_i64..1_000, steps in proptest::collection::vec(-1.0_f64..1.0, 1..300),
    ) {
        let mut unwrapper = Unwrapper::new(period).unwrap();
        let mut position = start;
        prop_assert_eq!(unwrapper.push(start), start);
        for step in steps {
            position += (step * f64::from((period - 1) / 2)) as i64;
            prop_assert_eq!(unwrapper.push(position.rem_euclid(i64::from(period))), position);
        }
    }

    #[test]
    fn angle_unwrapping_follows_any_walk(steps in proptest::collection::vec(-3.1_f64..3.1, 1..300)) {
        let mut unwrapper = AngleUnwrapper::default();
        let mut angle = 0.0;
        for step in steps {
            angle += step;
            let got = unwrapper.push(wrap(angle));
            prop_assert!((got - angle).abs() < 1e-9);
        }
    }

    #[test]
    fn nothing_overflows(values in proptest::collection::vec(any::<i64>(), 1..50), period in 1_u32..) {
        let mut unwrapper = Unwrapper::new(period).unwrap();
        for value in values {
            unwrapper.push(value);
        }
    }
}

//! The device's estimate: windows, gaps, and motions that repeat.

use super::*;
use whirl_shared::waveform::displacement;

const INCREMENT: u32 = 42_949_673;

fn with_forget(forget_per_mille: u16) -> Estimator {
    Estimator::new(&Settings { forget_per_mille, ..Settings::default() }).unwrap()
}

/// No rig's motion, but one that determines every unknown: incommensurate swings, and turns.
fn motion(n: u32) -> [i32; 2] {
    [
        displacement(900, n.wrapping_mul(31_415_926)),
        (n as i32 * 37).wrapping_add(displacement(700, n.wrapping_mul(27_182_818))),
    ]
}

fn feed(estimator: &mut Estimator, ticks: core::ops::Range<u32>, amplitude: u32) -> std::vec::Vec<Outcome> {
    ticks.filter_map(|n| estimator.sample(n, motion(n), n.wrapping_mul(INCREMENT), INCREMENT, amplitude)).collect()
}

#[test]
fn settings_are_checked_and_rest_gives_nothing() {
    assert!(Estimator::new(&Settings { forget_per_mille: 1_001, ..Settings::default() }).is_none());
    assert!(
        Estimator::new(&Settings { counts_per_turn: heapless::Vec::from_array([4096, 0]), ..Settings::default() })
            .is_none()
    );
    let mut estimator = with_forget(900);
    assert!((0..5_000).all(|tick| estimator.sample(tick, [0, 0], 0, 0, 0).is_none()));
}

#[test]
fn arms_that_hang_still_are_not_identifiable() {
    let mut estimator = with_forget(900);
    let outcomes: std::vec::Vec<_> =
        (0..5_000_u32).filter_map(|t| estimator.sample(t, [0, 0], t.wrapping_mul(INCREMENT), INCREMENT, 1)).collect();
    assert_eq!(outcomes.len(), 3);
    for outcome in outcomes {
        assert!(matches!(outcome.first, Err(NoEstimate::NotIdentifiable(_))), "{outcome:?}");
        assert!(matches!(outcome.second, Err(NoEstimate::NotIdentifiable(_))), "{outcome:?}");
    }
}

#[test]
fn windows_follow_each_other_and_numbers_come_with_the_fourth() {
    let mut estimator = with_forget(900);
    let outcomes = feed(&mut estimator, 0..6_200, 1);
    let ticks: std::vec::Vec<_> = outcomes.iter().map(|o| (o.window.number, o.window.tick, o.window.length)).collect();
    assert_eq!(ticks, [1, 2, 3, 4, 5].map(|n| (n, 1_009 + 1_000 * n, 2_000)));
    for outcome in &outcomes {
        assert_eq!(outcome.first.is_ok(), outcome.window.number > 3, "{outcome:?}");
        assert_eq!(outcome.first.is_err(), outcome.first == Err(NoEstimate::TooFewRows));
    }
}

#[test]
fn a_window_counts_for_what_is_left_of_it_and_errors_are_those_of_correlated_rows() {
    let mut estimator = with_forget(900);
    let outcomes = feed(&mut estimator, 0..6_200, 1);
    let left: f32 = [1.0, 0.9, 0.81, 0.729, 0.6561].iter().sum();
    assert!((estimator.first.rows() / (65.0 * left) - 1.0).abs() < 1e-5);
    assert!((estimator.second.rows() / (65.0 * left) - 1.0).abs() < 1e-5);
    let (told, plain) = (outcomes[4].first.unwrap(), estimator.first.solve(TOLERANCE).unwrap());
    assert_eq!(told.values, plain.values);
    for (told, plain) in told.std_errors.iter().zip(plain.std_errors) {
        assert!((told / plain - 2.63_f32.sqrt()).abs() < 1e-3, "{told} {plain}");
    }
}

#[test]
fn a_gap_begins_windows_anew_and_another_amplitude_everything() {
    let mut estimator = with_forget(1_000);
    assert_eq!(feed(&mut estimator, 0..6_200, 1).len(), 5);
    let rows = estimator.first.rows();
    assert_eq!(rows, 5.0 * 65.0);
    assert!(feed(&mut estimator, 6_201..8_200, 1).is_empty());
    let after = feed(&mut estimator, 8_200..8_300, 1);
    assert_eq!((after.len(), after[0].window.number, estimator.first.rows()), (1, 1, rows + 65.0));
    assert!(feed(&mut estimator, 8_300..8_301, 2).is_empty());
    assert_eq!((estimator.first.rows(), estimator.window().number), (0.0, 0));
}

#[test]
fn periods_of_up_to_six_drives_are_seen_to_repeat() {
    // A hundred ticks a drive period, nearly, and whole parts of it.
    let increment = 42_949_620;
    for (period, first_seen) in [(1, 2), (2, 2), (3, 4), (4, 3), (5, 2), (6, 4)] {
        let mut estimator = with_forget(900);
        for n in 0..9_000_u32 {
            let slow = n.wrapping_mul(increment / period);
            let counts = [displacement(900, slow), displacement(700, slow.wrapping_mul(3).wrapping_add(77 << 24))];
            let outcome = estimator.sample(n, counts, n.wrapping_mul(increment), increment, 1);
            let Some(outcome) = outcome else { continue };
            let expected =
                if outcome.window.number < first_seen { NoEstimate::TooFewRows } else { NoEstimate::Repeating };
            assert_eq!((outcome.first, outcome.second), (Err(expected), Err(expected)), "period {period}");
        }
    }
}

#[test]
fn windows_shorter_than_the_steps_lose_nothing() {
    // 100 Hz: half a window is 50 ticks.
    let increment = 858_993_459;
    let mut estimator = with_forget(900);
    let numbers: std::vec::Vec<_> = (0..1_000_u32)
        .filter_map(|n| estimator.sample(n, motion(n), n.wrapping_mul(increment), increment, 1))
        .map(|outcome| outcome.window.number)
        .collect();
    assert!(numbers.len() >= 17 && numbers.windows(2).all(|w| w[1] == w[0] + 1), "{numbers:?}");
}

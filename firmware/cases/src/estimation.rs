//! The device's own estimate, by its bits.

use whirl_firmware::Settings;
use whirl_firmware::estimate::{Estimator, Outcome};
use whirl_shared::least_squares::{LeastSquares, NoEstimate};
use whirl_shared::waveform::displacement;

fn outcome() -> Outcome {
    let Some(mut estimator) = Estimator::new(&Settings::default()) else { panic!("settings") };
    let increment = 42_949_673_u32;
    let mut last = None;
    // No rig's motion, but one that determines every unknown: incommensurate swings, and turns.
    for n in 0..6_200_u32 {
        let counts = [
            displacement(900, n.wrapping_mul(31_415_926)),
            (n as i32 * 37).wrapping_add(displacement(700, n.wrapping_mul(27_182_818))),
        ];
        last = estimator.sample(n, counts, n.wrapping_mul(increment), increment, 1).or(last);
    }
    match last {
        Some(outcome) => outcome,
        None => panic!("no window"),
    }
}

pub fn the_estimate_has_the_same_bits() {
    let outcome = outcome();
    let (Ok(first), Ok(second)) = (outcome.first, outcome.second) else { panic!("{outcome:?}") };
    let known = first.values.iter().chain(&first.std_errors).chain(&second.values).chain(&second.std_errors);
    let words = known.chain([&first.condition, &second.condition]);
    let hash = words.fold(0x811c_9dc5_u32, |hash, x| (hash ^ x.to_bits()).wrapping_mul(0x0100_0193));
    assert_eq!(hash, BITS, "{hash:#010x}");
}

/// Of x86-64 and Cortex-M4F alike.
const BITS: u32 = 0x6dad_076b;

pub fn a_locked_motion_is_not_identifiable() {
    let Some(mut estimator) = Estimator::new(&Settings::default()) else { panic!("settings") };
    // Three drive periods long, a hundred ticks each but for rounding.
    let increment = 42_949_620_u32;
    let mut told = 0;
    for n in 0..7_000_u32 {
        let slow = n.wrapping_mul(increment / 3);
        let counts = [displacement(900, slow), displacement(700, slow.wrapping_mul(2).wrapping_add(77 << 24))];
        let Some(outcome) = estimator.sample(n, counts, n.wrapping_mul(increment), increment, 1) else { continue };
        let expected = if outcome.window.number < 4 { NoEstimate::TooFewRows } else { NoEstimate::Repeating };
        assert_eq!((outcome.first, outcome.second), (Err(expected), Err(expected)));
        told += 1;
    }
    assert!(told >= 5);
}

pub fn least_squares_find_what_they_were_given() {
    let mut fit = LeastSquares::<f32, 3>::new();
    assert!(fit.solve(1e-3).is_err());
    let mut state = 7_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f32::from((state >> 16) as i16) / 32_768.0
    };
    for block in 0..20 {
        fit.forget(0.8);
        // The second unknown changes half-way.
        let truth = [1.5, if block < 10 { -0.2 } else { -0.21 }, 30.0];
        for _ in 0..40 {
            let row = [noise(), noise(), 0.02 * noise()];
            fit.push(row, row.iter().zip(truth).map(|(a, x)| a * x).sum::<f32>() + 1e-3 * noise());
        }
    }
    let Ok(estimate) = fit.solve(1e-3) else { panic!("no estimate") };
    // What is left of the first half by now is a tenth of it.
    for (i, (truth, most)) in [(1.5, 1e-3), (-0.209, 1e-3), (30.0, 0.05)].into_iter().enumerate() {
        assert!((estimate.values[i] - truth).abs() < most, "{i}: {:?}", estimate.values);
    }
    let hash = estimate.values.iter().fold(0x811c_9dc5_u32, |h, x| (h ^ x.to_bits()).wrapping_mul(0x0100_0193));
    assert_eq!(hash, FIT, "{hash:#010x}");
}

/// Of x86-64 and Cortex-M4F alike.
const FIT: u32 = 0xfdb0_0dfa;

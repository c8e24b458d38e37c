//! The device's own estimate, by its bits.

use whirl_firmware::Settings;
use whirl_firmware::estimate::{Estimator, Outcome};
use whirl_shared::waveform::displacement;

fn outcome() -> Outcome {
    let Some(mut estimator) = Estimator::new(&Settings::default(), 0.9) else { panic!("settings") };
    let increment = 42_949_673_u32;
    let mut last = None;
    // No rig's motion, but one that determines every unknown: incommensurate swings, and turns.
    for n in 0..3_200_u32 {
        let counts = [
            displacement(900, n.wrapping_mul(31_415_926)),
            (n as i32 * 37).wrapping_add(displacement(700, n.wrapping_mul(27_182_818))),
        ];
        last = estimator.sample(n, counts, n.wrapping_mul(increment), increment).or(last);
    }
    match last {
        Some(outcome) => outcome,
        None => panic!("no window"),
    }
}

pub fn the_estimate_has_the_same_bits() {
    let outcome = outcome();
    let (Ok(first), Ok(second)) = (outcome.first, outcome.second) else { panic!("{outcome:?}") };
    let words = first.values.iter().chain(&first.std_errors).chain(&second.values).chain(&second.std_errors);
    let hash = words.fold(0x811c_9dc5_u32, |hash, x| (hash ^ x.to_bits()).wrapping_mul(0x0100_0193));
    assert_eq!(hash, BITS, "{hash:#010x}");
}

/// Of x86-64 and Cortex-M4F alike.
const BITS: u32 = 0x8633_f1a4;

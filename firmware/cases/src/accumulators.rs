//! Harmonic sums and the drive's waveform, by their bits.

use whirl_shared::harmonics::{HarmonicBank, HarmonicSettings, Window};
use whirl_shared::waveform::{PhaseAccumulator, cos_sin, displacement, phase_increment};

fn fold(hash: u32, word: u32) -> u32 {
    word.to_le_bytes().iter().fold(hash, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

/// A deterministic signal that is no harmonic: a 16-bit congruential generator, in ±1.
fn noise(state: &mut u32) -> f32 {
    *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    f32::from((*state >> 16) as i16) / 32_768.0
}

/// Harmonics of the k-th part of 5 Hz, over 20 periods.
fn bank(k: u32) -> HarmonicBank<f32, 2, 16> {
    let Some(settings) = HarmonicSettings::of_frequency(5_000, 500_000, k, 2_000, Window::SinFourth) else {
        panic!("settings")
    };
    HarmonicBank::new(settings)
}

pub fn sums_have_the_same_bits() {
    let mut bank = bank(20);
    let mut state = 1;
    while !bank.push([noise(&mut state), noise(&mut state)]) {}
    let mut hash = 0x811c_9dc5;
    for signal in 0..2 {
        for harmonic in 0..=16 {
            let Some([re, im]) = bank.sum(signal, harmonic) else { panic!("no sum") };
            hash = fold(fold(hash, re.to_bits()), im.to_bits());
        }
    }
    assert_eq!(hash, SUMS, "{hash:#010x}");
}

/// Of x86-64 and Cortex-M4F alike.
const SUMS: u32 = 0x429a_a55c;

pub fn phasors_do_not_drift() {
    // The drive is the tenth harmonic. Its phase over many windows is exact, and so is that of the
    // bank, whatever came before: Σ w cos² = Σ w / 2 = 3 L / 16.
    let mut bank = bank(10);
    let Some(increment) = phase_increment(5_000, 500_000) else { panic!("increment") };
    let mut drive = PhaseAccumulator { phase: 0, increment };
    for window in 0..10 {
        loop {
            let (cos, sin) = cos_sin::<f32>(drive.phase);
            drive.advance(1);
            if bank.push([cos, sin]) {
                break;
            }
        }
        let (Some(cos), Some(sin)) = (bank.sum(0, 10), bank.sum(1, 10)) else { panic!("no sum") };
        for (found, expected) in cos.into_iter().chain(sin).zip([375.0, 0.0, 0.0, -375.0]) {
            assert!((found - expected).abs() < 0.02, "window {window}: {found} for {expected}");
        }
        bank.restart(0);
    }
}

pub fn the_waveform_has_the_same_bits() {
    let Some(increment) = phase_increment(5_200, 500_000) else { panic!("increment") };
    let mut drive = PhaseAccumulator { phase: 0, increment };
    let mut hash = 0x811c_9dc5;
    for _ in 0..5_000 {
        hash = fold(hash, displacement(15_525_000, drive.phase).cast_unsigned());
        drive.advance(1);
    }
    assert_eq!(hash, WAVEFORM, "{hash:#010x}");
}

/// Of x86-64 and Cortex-M4F alike.
const WAVEFORM: u32 = 0xa602_ecd9;

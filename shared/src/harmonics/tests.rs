//! The bank against a direct Fourier sum, and its phasors against their exact values.

use core::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::vec::Vec;

use super::*;

const TURNS64: f64 = 18_446_744_073_709_551_616.0;

/// Two broadband signals without structure, in [−1, 1).
fn noise(length: u32) -> Vec<[f64; 2]> {
    let mut random = ChaCha8Rng::seed_from_u64(u64::from(length));
    let mut number = || (random.next_u64() >> 11) as f64 / 4_503_599_627_370_496.0 - 1.0;
    (0..length).map(|_| [number(), number()]).collect()
}

/// Σ w x e^{−ijφ} term by term, with the phase from the rational frequency in 128-bit integers.
fn direct(x: &[f64], f: u32, rate: u32, k: u32, length: u32, harmonic: u32, window: Window) -> ([f64; 2], f64) {
    let (mut sum, mut size) = ([0.0; 2], 0.0);
    for n in 0..u64::from(length) {
        let period = u128::from(rate) * u128::from(k);
        let rest = (u128::from(n) * u128::from(f) * u128::from(harmonic)) % period;
        let angle = rest as f64 / period as f64 * TAU;
        let weight = match window {
            Window::Rectangular => 1.0,
            Window::SinFourth => libm::pow(libm::sin(core::f64::consts::PI * n as f64 / f64::from(length)), 4.0),
        };
        let value = weight * x[n as usize];
        sum[0] += value * libm::cos(angle);
        sum[1] -= value * libm::sin(angle);
        size += value.abs();
    }
    (sum, size)
}

fn worst_error<T: Real + Into<f64>>(frequency: (u32, u32, u32), length: u32, window: Window) -> f64 {
    const M: usize = 24;
    let (f, rate, k) = frequency;
    let settings = HarmonicSettings::of_frequency(f, rate, k, length, window).unwrap();
    let mut bank: HarmonicBank<T, 2, M> = HarmonicBank::new(settings);
    let signals = noise(length);
    for (n, signal) in signals.iter().enumerate() {
        let done = bank.push(signal.map(T::from_f64));
        assert_eq!(done, n + 1 == signals.len());
    }
    let mut worst = 0.0_f64;
    for channel in 0..2 {
        // Single-precision banks are compared on the values that they were given.
        let x: Vec<f64> = signals.iter().map(|signal| T::from_f64(signal[channel]).into()).collect();
        for harmonic in 0..=M as u32 {
            let (want, size) = direct(&x, f, rate, k, length, harmonic, window);
            let got = bank.sum(channel, harmonic as usize).unwrap();
            for part in 0..2 {
                worst = worst.max((got[part].into() - want[part]).abs() / size);
            }
        }
    }
    worst
}

#[test]
fn sums_agree_with_a_direct_fourier_sum() {
    // 5 Hz at 500 Hz is commensurate; 5.2 Hz has a period of 96.15… samples; 20 periods of a
    // period-4 orbit.
    for (frequency, length) in
        [((5_000, 500_000, 4), 2_000), ((5_200, 500_000, 4), 1_923), ((5_200, 500_000, 7), 3_001)]
    {
        for window in [Window::SinFourth, Window::Rectangular] {
            let (single, double) =
                (worst_error::<f32>(frequency, length, window), worst_error::<f64>(frequency, length, window));
            assert!(single < 2e-6, "{frequency:?} {window:?}: {single:e}");
            assert!(double < 2e-15, "{frequency:?} {window:?}: {double:e}");
        }
    }
}

#[test]
fn a_harmonic_signal_is_found_with_its_sign_and_size() {
    // x = a cos(jφ − ψ) gives S_j = (a/2) e^{−iψ} Σw plus what the window lets through.
    let (a, psi, length) = (0.7, 0.4, 2_000_u32);
    let settings = HarmonicSettings::of_drive(42_949_673, 4, length, Window::SinFourth).unwrap();
    let mut bank: HarmonicBank<f64, 1, 12> = HarmonicBank::new(settings);
    for n in 0..u64::from(length) {
        let angle = settings.increment.wrapping_mul(n).wrapping_mul(9) as f64 / TURNS64 * TAU;
        bank.push([a * libm::cos(angle - psi)]);
    }
    let weight = bank.weight();
    assert!((weight / f64::from(length) - 0.375).abs() < 1e-12);
    let [re, im] = bank.sum(0, 9).unwrap();
    assert!((2.0 * re / weight - a * libm::cos(psi)).abs() < 1e-6);
    assert!((2.0 * im / weight + a * libm::sin(psi)).abs() < 1e-6);
    // Its neighbours are five lines away at 20 periods of 4: out of the window's main lobe.
    for j in [1, 2, 5, 8, 10, 12] {
        let [re, im] = bank.sum(0, j).unwrap();
        assert!(2.0 * libm::sqrt(re * re + im * im) / weight < 2e-3, "harmonic {j}");
    }
}

/// Greatest error of length and of phase of all phasors, over a number of samples.
fn drift<T: Real + Into<f64>, const M: usize>(samples: u32) -> (f64, f64) {
    let settings = HarmonicSettings::of_frequency(5_200, 500_000, 7, samples, Window::Rectangular).unwrap();
    let mut bank: HarmonicBank<T, 1, M> = HarmonicBank::new(settings);
    let (mut length, mut phase) = (0.0_f64, 0.0_f64);
    for n in 0..samples {
        // Every so often, and at each of the last ticks before and after a phasor is refreshed.
        if n % 997 == 0 || samples - n < 2 * M as u32 {
            for (j, z) in bank.phasors.iter().enumerate() {
                let [re, im]: [f64; 2] = [z[0].into(), z[1].into()];
                let [cos, minus_sin] = super::phasor::<f64>(j + 1, bank.phase);
                length = length.max((libm::sqrt(re * re + im * im) - 1.0).abs());
                phase = phase.max(libm::atan2(im * cos - re * minus_sin, re * cos + im * minus_sin).abs());
            }
        }
        bank.push([T::one()]);
    }
    (length, phase)
}

#[test]
fn phasors_do_not_drift_over_a_million_samples() {
    fn check<T: Real + Into<f64>, const M: usize>(epsilon: f64) {
        let (length, phase) = drift::<T, M>(1_000_000);
        // The renormalisation holds the length at rounding; the phase has M steps of it between two
        // refreshes.
        assert!(length < 2.0 * epsilon, "M = {M}: length off by {length:e}");
        assert!(phase < 1.5 * (M as f64 + 2.0) * epsilon, "M = {M}: phase off by {phase:e}");
    }
    check::<f32, 4>(1.2e-7);
    check::<f32, 40>(1.2e-7);
    check::<f64, 4>(2.3e-16);
    check::<f64, 40>(2.3e-16);
}

#[test]
fn the_recurrence_alone_does_drift() {
    // Why phasors are refreshed: the same recurrence with renormalisation only, single precision.
    let settings = HarmonicSettings::of_frequency(5_200, 500_000, 7, 1, Window::Rectangular).unwrap();
    let mut worst = 0.0_f64;
    for harmonic in 1..=40 {
        let rotation = super::phasor::<f32>(harmonic, settings.increment);
        let (mut z, mut exact) = ([1.0_f32, 0.0], 0_u64);
        for _ in 0..1_000_000 {
            z = product(z, rotation);
            let scale = 1.5 - 0.5 * (z[0] * z[0] + z[1] * z[1]);
            z = z.map(|part| part * scale);
            exact = exact.wrapping_add(settings.increment);
        }
        let want = super::phasor::<f64>(harmonic, exact);
        worst = worst.max((f64::from(z[0]) - want[0]).abs()).max((f64::from(z[1]) - want[1]).abs());
    }
    assert!(worst > 1e-3, "{worst:e}");
}

#[test]
fn windows_are_restarted_where_the_last_one_ended() {
    let settings = HarmonicSettings::of_frequency(5_200, 500_000, 3, 500, Window::SinFourth).unwrap();
    let mut bank: HarmonicBank<f64, 1, 6> = HarmonicBank::new(settings);
    let mut fresh = bank.clone();
    let signal = noise(1_000);
    for x in &signal[..500] {
        bank.push([x[0]]);
    }
    // A complete bank takes nothing more.
    let before = bank.sum(0, 3);
    assert!(bank.push([1e9]));
    assert_eq!((bank.sum(0, 3), bank.ticks()), (before, 500));

    let phase = bank.phase();
    assert_eq!(phase, settings.increment.wrapping_mul(500));
    bank.restart(phase);
    fresh.restart(phase);
    assert_eq!(bank.ticks(), 0);
    for x in &signal[500..] {
        assert_eq!(bank.push([x[0]]), fresh.push([x[0]]));
    }
    for j in 0..=6 {
        assert_eq!(bank.sum(0, j), fresh.sum(0, j));
    }
    assert_eq!(bank.sum(1, 0), None);
    assert_eq!(bank.sum(0, 7), None);
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    assert_eq!(HarmonicSettings::of_drive(1, 0, 10, Window::SinFourth), None);
    assert_eq!(HarmonicSettings::of_drive(1, 1, 0, Window::SinFourth), None);
    assert_eq!(HarmonicSettings::of_frequency(1, 0, 1, 10, Window::SinFourth), None);
    assert_eq!(HarmonicSettings::of_frequency(1, 1_000, 0, 10, Window::SinFourth), None);
    assert_eq!(HarmonicSettings::of_frequency(1_000, 1_000, 1, 10, Window::SinFourth), None);
    assert!(HarmonicSettings::of_drive(u32::MAX, u32::MAX, 1, Window::SinFourth).is_some());
}

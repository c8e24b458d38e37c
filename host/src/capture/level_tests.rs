//! Levelling against bases of known gain, noise and nature, block by block.

use std::path::Path;

use heapless::Vec as Few;
use rand::{Rng, SeedableRng};
use whirl_shared::excitation::Excitation;
use whirl_shared::frame::ShakerLimits;
use whirl_shared::waveform::{phase_increment, phase_radians};

use super::*;

/// A channel of 5 µm, or of 10⁻³ m/s².
fn rig(unit: &str) -> Rig {
    let gain = if unit == "um" { "-5.0" } else { "1e-3" };
    let text = format!(
        "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.2\n[[channel]]\nname = \"a\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n[[channel]]\nname = \"y\"\nmeasures = \"base\"\nunit = \"{unit}\"\ngain = {gain}\n"
    );
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

fn target() -> Target {
    Target(Excitation::sine(10_000, 5_200), None)
}

/// What the base shows (m or m/s²) of a commanded amplitude (m), an angle and some time (s).
type Base<'a> = dyn FnMut(f64, f64, f64) -> f64 + 'a;

/// The amplitudes that were commanded (µm), and how it ended.
fn levelled(unit: &str, base: &mut Base<'_>, most: u32, lost: Option<u32>) -> (Vec<u32>, Result<Level>) {
    let (rig, increment) = (rig(unit), phase_increment(5_200, 500_000).unwrap());
    let mut leveller = Leveller::new(&rig, target()).unwrap();
    let count = leveller.count;
    // The device's ramp: 20 mm/s, 40 µm a tick.
    let (mut amplitude, mut wanted, mut all) = (0_u32, 10_000_u32, Vec::new());
    for n in 0_u32.. {
        let first_tick = 4_000_000_000_u32.wrapping_add(10 * n);
        let phase = increment.wrapping_mul(10 * n);
        let mut last = 0;
        let mut block = SampleBlock {
            first_tick,
            phase,
            phase_increment: increment,
            amplitude_nanometre: amplitude * 1_000,
            ..SampleBlock::EMPTY
        };
        for i in 0..10 {
            let angle = phase_radians(phase.wrapping_add(increment.wrapping_mul(i)));
            let y = base(f64::from(amplitude) * 1e-6, angle, f64::from(10 * n + i) / 500.0);
            let shown = 40_000 + (y / count).round() as i32;
            if i == 0 {
                block.first = Few::from_slice(&[7, shown]).unwrap();
            } else {
                block.deltas.extend([0, (shown - last) as i16]);
            }
            last = shown;
        }
        amplitude =
            if amplitude < wanted { (amplitude + 400).min(wanted) } else { amplitude.saturating_sub(400).max(wanted) };
        if lost == Some(n % 30) {
            continue;
        }
        match leveller.block(&block, most) {
            Ok(Verdict::Waiting) => {}
            Ok(Verdict::Command(micrometre)) => {
                all.push(micrometre);
                wanted = micrometre;
            }
            Ok(Verdict::Level(level)) => return (all, Ok(level)),
            Err(e) => return (all, Err(e)),
        }
    }
    unreachable!()
}

#[test]
fn a_gain_is_made_up_for_within_the_noise() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut noise = || (random.next_u32() >> 8) as f64 / 16_777_216.0 - 0.5;
    // Clean, with harmonics, with noise of 0.1 mm (whole width); an offset in any case.
    for (gain, harmonic, width) in [(0.8, 0.0, 0.0), (1.3, 0.1, 0.0), (0.7, 0.03, 1e-4), (1.002, 0.0, 0.0)] {
        let mut base = |a: f64, angle: f64, _: f64| {
            a * gain * ((angle - 0.6).cos() + harmonic * (3.0 * angle).cos()) + width * noise()
        };
        let (commanded, level) = levelled("um", &mut base, 100_000, None);
        let level = level.unwrap();
        assert_eq!(commanded.len(), usize::from(gain != 1.002), "{commanded:?}");
        assert!((level.commanded_m * gain / 0.01 - 1.0).abs() < 0.006, "{level:?}");
        assert!((level.measured_m / 0.01 - 1.0).abs() < 0.005 && (level.gain / gain - 1.0).abs() < 3e-3, "{level:?}");
        assert!(level.std_error_m < 1e-5 && (width == 0.0 || level.std_error_m > 1e-7), "{level:?}");
        assert!(told(&level).contains("of 10.000 mm wanted"), "{}", told(&level));
    }
    // An accelerometer: −Ω² of the displacement.
    let square = (TAU * 5.2_f64).powi(2);
    let mut base = |a: f64, angle: f64, _: f64| -square * 0.9 * a * angle.cos();
    let (commanded, level) = levelled("m/s2", &mut base, 100_000, None);
    assert!((f64::from(commanded[0]) - 11_111.0).abs() < 3.0, "{commanded:?}");
    assert!((level.unwrap().measured_m - 0.01).abs() < 3e-6);
    // A shaker that gives way: several steps.
    let mut base = |a: f64, angle: f64, _: f64| a * (1.3 - 20.0 * a) * angle.cos();
    let (commanded, level) = levelled("um", &mut base, 100_000, None);
    let level = level.unwrap();
    assert_eq!(commanded.len(), 2, "{commanded:?}");
    assert!((level.measured_m / 0.01 - 1.0).abs() < 0.006, "{level:?}");
}

#[test]
fn what_cannot_be_levelled_is_told_with_both_amplitudes() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(4);
    let mut noise = || (random.next_u32() >> 8) as f64 / 16_777_216.0 - 0.5;
    let sine = |gain: f64| move |a: f64, angle: f64, _: f64| gain * a * angle.cos();
    let refused = |unit: &str, base: &mut Base<'_>, most: u32, lost: Option<u32>, parts: &[&str]| {
        let (commanded, error) = levelled(unit, base, most, lost);
        let text = error.unwrap_err().to_string();
        assert!(parts.iter().all(|part| text.contains(part)), "{text} for {parts:?}");
        assert!(
            text.contains("10.000 mm that the base's channel shows") && text.contains("amplifier's gain"),
            "{text}"
        );
        assert!(commanded.iter().all(|c| (5_000..=20_000).contains(c)), "{commanded:?}");
        commanded.len()
    };
    let half = &["which is not from half to twice", "measured 4.000 mm for 10.000 mm", "gain 0.400"];
    assert_eq!(refused("um", &mut sine(0.4), 100_000, None, half), 0);
    refused("um", &mut sine(2.5), 100_000, None, &["level at 4.000 mm"]);
    refused("um", &mut sine(0.7), 14_000, None, &["level at 14.28", "which is beyond the device's limits"]);
    // A sensor that stands still.
    refused("um", &mut |_, _, _| 0.0, 100_000, None, &["measured 0.000 mm"]);
    refused("um", &mut |_, _, _| 0.05 * noise(), 100_000, None, &["noise"]);
    // One that is never what it was: as many attempts as 30 s hold.
    let mut flips = |a: f64, angle: f64, _: f64| if a > 0.008 { 1.5 * a * angle.cos() } else { 0.6 * a * angle.cos() };
    refused("um", &mut flips, 100_000, None, &["not level after 30 s"]);
    // Whole seconds never come.
    refused("um", &mut sine(0.8), 100_000, Some(3), &["not level after 30 s", "measured nothing yet"]);
}

#[test]
fn a_device_s_limits_bound_what_is_commanded() {
    let limits = ShakerLimits {
        amplitude_micrometre: 20_000,
        frequency_millihertz: 20_000,
        ramp_micrometre_per_s: 20_000,
        acceleration_millimetre_per_s2: 40_000,
    };
    let hello = |limits, full_scale_micrometre| Hello { limits, full_scale_micrometre, ..Hello::default() };
    assert_eq!(most(&hello(limits, 25_000), target()), 20_000);
    assert_eq!(most(&hello(limits, 15_000), target()), 15_000);
    // 20 m/s² at 5.2 Hz.
    let weak = ShakerLimits { acceleration_millimetre_per_s2: 20_000, ..limits };
    assert_eq!(most(&hello(weak, 25_000), target()), 18_735);
}

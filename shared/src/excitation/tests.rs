//! Tests of the excitation: exactness, symmetry, bounds.

use super::course::{ROOTS, log2, scaled};
use super::*;
use crate::waveform::phase_increment;
use proptest::prelude::*;

const LIMITS: ShakerLimits = ShakerLimits {
    amplitude_micrometre: 20_000,
    frequency_millihertz: 20_000,
    ramp_micrometre_per_s: 20_000,
    acceleration_millimetre_per_s2: 40_000,
};

fn form(components: &[(u8, u16, u16)]) -> Form {
    let mut form = Form([Component::default(); MOST_COMPONENTS]);
    for (place, &(harmonic, share, phase)) in form.0.iter_mut().zip(components) {
        *place = Component { harmonic, share, phase };
    }
    form
}

fn sweep(law: Law, from: u32, to: u32, ms: u32, back: bool) -> Excitation {
    let glide = Glide { law, back, to_millihertz: to, ms };
    Excitation { glide, ..Excitation::sine(5_000, from) }
}

#[test]
fn one_component_is_the_sine_to_the_last_bit() {
    let mut phase = 7_u32;
    for amplitude in [0, 1, 999, 15_525_000, i32::MAX as u32] {
        for _ in 0..20_000 {
            phase = phase.wrapping_add(0x9e37_79b9);
            assert_eq!(
                Form::SINE.displacement(amplitude, phase),
                crate::waveform::displacement(amplitude, phase),
                "{amplitude} {phase}"
            );
        }
    }
}

#[test]
fn roots_and_logarithms_are_exact_to_their_places() {
    for (i, root) in ROOTS.iter().enumerate() {
        let exact = libm::exp2(libm::exp2(-1.0 - i as f64));
        assert!((*root as f64 / libm::exp2(62.0) - exact).abs() < 1e-15, "root {i}");
    }
    for (hi, lo) in
        [(2, 1), (3, 1), (3, 2), (1 << 31, 1), (u32::MAX, 1), (u32::MAX, u32::MAX), (68_719_477, 17_179_869)]
    {
        let exact = libm::log2(f64::from(hi) / f64::from(lo));
        let found = log2(hi, lo) as f64 / libm::exp2(32.0);
        assert!((-1e-14..3e-10).contains(&(exact - found)), "{hi}/{lo}: {found} for {exact}");
    }
    assert_eq!([log2(2, 1), log2(1 << 31, 1), log2(7, 7)], [1 << 32, 31 << 32, 0]);
    assert_eq!([scaled(5, 0), scaled(5, 1 << 32), scaled(1, 31 << 32)], [5, 10, 1 << 31]);
}

#[test]
fn a_linear_sweep_is_a_straight_line_and_stays_at_its_end() {
    let excitation = sweep(Law::Linear, 2_000, 8_000, 60_000, false);
    let mut course = Course::new(&excitation, 500_000).unwrap();
    let [from, to] = [2_000, 8_000].map(|f| phase_increment(f, 500_000).unwrap());
    for tick in 0..40_000_u32 {
        let stair = (tick / STAIR).min(3_000);
        let exact = f64::from(from) + f64::from(to - from) * f64::from(stair) / 3_000.0;
        assert!((f64::from(course.increment()) - exact).abs() <= 0.5, "tick {tick}");
        course.advance();
    }
    assert_eq!(course.increment(), to);
    assert!(!course.advance());
}

#[test]
fn a_logarithmic_sweep_is_an_exponential_downward_as_upward() {
    for [f, g] in [[2_000, 8_000], [500, 20_000], [1, 249_000]] {
        let ways = [(f, g), (g, f)].map(|(from, to)| {
            let mut course = Course::new(&sweep(Law::Logarithmic, from, to, 20_000, false), 500_000).unwrap();
            let mut increments = std::vec![course.increment()];
            while increments.len() < 1_001 {
                if course.advance() {
                    increments.push(course.increment());
                }
            }
            increments
        });
        let [lo, hi] = [f, g].map(|f| phase_increment(f, 500_000).unwrap());
        for (k, &increment) in ways[0].iter().enumerate() {
            let exact = f64::from(lo) * libm::pow(f64::from(hi) / f64::from(lo), k as f64 / 1_000.0);
            // Half a unit, and the logarithm's 2⁻³² of an octave.
            let bound = 0.5 + exact * 2.0 / 4_294_967_296.0;
            assert!((f64::from(increment) - exact).abs() <= bound, "stair {k}: {increment} for {exact}");
            assert_eq!(increment, ways[1][1_000 - k]);
        }
        assert_eq!((ways[0][0], ways[0][1_000]), (lo, hi));
    }
}

#[test]
fn there_and_back_repeats_itself() {
    let mut course = Course::new(&sweep(Law::Linear, 8_000, 2_000, 1_000, true), 500_000).unwrap();
    let increments: std::vec::Vec<u32> = (0..3_000)
        .map(|_| {
            let now = course.increment();
            course.advance();
            now
        })
        .collect();
    for tick in 0..1_000 {
        assert_eq!(increments[tick], increments[tick + 1_000]);
        // Stairs mirrored at the turn.
        let mirrored = if tick < 10 { 0 } else { 1_000 - tick / 10 * 10 };
        assert_eq!(increments[tick], increments[mirrored], "tick {tick}");
    }
    assert!(increments[0] > increments[500]);
    assert_eq!(increments[500], phase_increment(2_000, 500_000).unwrap());
}

#[test]
fn limits_hold_for_the_sum_and_name_what_is_beyond() {
    let good = Excitation::sine(5_000, 5_000);
    assert_eq!(good.refusal(&LIMITS), None);
    let with = |change: &dyn Fn(&mut Excitation)| {
        let mut excitation = good;
        change(&mut excitation);
        excitation.refusal(&LIMITS)
    };
    let thirds = form(&[(1, 10_923, 0), (2, 10_923, 0), (3, 10_922, 0)]);
    assert_eq!(with(&|e| e.form = thirds), None);
    // 40 m/s² over 4π² · 25 Hz² · (1 + 4 + 9)/3.
    assert_eq!(with(&|e| (e.form, e.amplitudes_micrometre[0]) = (thirds, 8_700)), Some(Refusal::Acceleration(8_684)));
    assert_eq!(with(&|e| e.amplitudes_micrometre[0] = 20_001), Some(Refusal::Amplitude(20_000)));
    assert_eq!(with(&|e| e.frequency_millihertz = 0), Some(Refusal::Frequency(1)));
    assert_eq!(with(&|e| (e.form, e.frequency_millihertz) = (thirds, 6_667)), Some(Refusal::Frequency(6_666)));
    assert_eq!(with(&|e| e.form = form(&[(1, WHOLE, 0), (2, 1, 0)])), Some(Refusal::Form(32_768)));
    assert_eq!(with(&|e| e.form = form(&[(0, 1, 0)])), Some(Refusal::Form(32_768)));
    assert_eq!(with(&|e| e.form = form(&[])), Some(Refusal::Form(32_768)));
    assert_eq!(with(&|e| e.steps = 0), Some(Refusal::Steps(1)));
    assert_eq!(with(&|e| e.steps = 9), Some(Refusal::Steps(8)));
    assert_eq!(with(&|e| e.steps = 2), Some(Refusal::HoldTime(100)));
    // The second of two amplitudes counts, too; what lies behind the steps does not.
    assert_eq!(
        with(&|e| (e.steps, e.hold_ms, e.amplitudes_micrometre[1]) = (2, 100, 30_000)),
        Some(Refusal::Amplitude(20_000))
    );
    assert_eq!(with(&|e| e.amplitudes_micrometre[1] = 30_000), None);
    let glide = |to, ms| Glide { law: Law::Linear, back: true, to_millihertz: to, ms };
    assert_eq!(with(&|e| e.glide = glide(8_000, 1_000)), None);
    assert_eq!(with(&|e| e.glide = glide(20_001, 1_000)), Some(Refusal::Frequency(20_000)));
    // Amplitude at the sweep's other end.
    assert_eq!(with(&|e| e.glide = glide(20_000, 1_000)), Some(Refusal::Acceleration(2_533)));
    assert_eq!(with(&|e| e.glide = glide(8_000, 99)), Some(Refusal::GlideTime(100)));
    assert_eq!(with(&|e| e.glide = glide(8_000, 3_600_001)), Some(Refusal::GlideTime(3_600_000)));
}

proptest! {
    #[test]
    fn a_form_is_its_sum_within_a_nanometre_and_never_beyond_the_amplitude(
        parts in prop::collection::vec((1_u8..=20, 0_u16..=5_461, any::<u16>()), 1..=6),
        amplitude in 0_u32..100_000_000, phase: u32,
    ) {
        let form = form(&parts);
        let y = form.displacement(amplitude, phase);
        let turns = |c: &Component| f64::from(c.harmonic) * f64::from(phase) / 4_294_967_296.0 + f64::from(c.phase) / 65_536.0;
        let exact: f64 = form
            .components()
            .map(|c| f64::from(amplitude) * f64::from(c.share) / 32_768.0 * libm::cos(core::f64::consts::TAU * turns(c)))
            .sum();
        // A nanometre of each component's amplitude, half of the sum; 1.2e-7 of the cosine.
        let bound = 0.5 + parts.len() as f64 + 1.2e-7 * f64::from(amplitude);
        prop_assert!((f64::from(y) - exact).abs() <= bound, "{y} for {exact}");
        prop_assert!(y.unsigned_abs() <= amplitude);
    }

    #[test]
    fn a_course_stays_between_its_ends(
        from in 1_u32..200_000, to in 1_u32..200_000, ms in 100_u32..3_600_000, log: bool, back: bool, at in 0_u32..1 << 20,
    ) {
        let law = if log { Law::Logarithmic } else { Law::Linear };
        let mut course = Course::new(&sweep(law, from, to, ms, back), 500_000).unwrap();
        course.taken = at % (2 * course.stairs);
        let [lo, hi] = course.ends;
        prop_assert!((lo..=hi).contains(&course.increment()));
    }
}

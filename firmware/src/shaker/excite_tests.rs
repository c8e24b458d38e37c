//! Excitation beyond one sine: exact at every tick, within its limits, ramped at both ends, stopped
//! by silence, by the emergency stop, started by a trigger.

use std::vec::Vec;

use proptest::prelude::*;
use whirl_shared::excitation::{Component, Excitation, Form, Glide, Law, Part, STAIR};
use whirl_shared::waveform::phase_increment;

use super::*;
use crate::testing::Recorder;
use whirl_shared::frame::{Command, CommandResult};

pub(super) fn armed() -> Shaker<Recorder> {
    let mut shaker = Shaker::new(&Settings::default(), Recorder::default());
    assert_eq!(shaker.command(Command::Arm), CommandResult::Done);
    shaker
}

/// What becomes of the last of its commands, or of the first that is refused.
pub(super) fn excite(shaker: &mut Shaker<Recorder>, excitation: Excitation) -> CommandResult {
    let results = excitation.commands().into_iter().map(|command| shaker.command(command));
    results.fold(CommandResult::Done, |first, next| if first == CommandResult::Done { next } else { first })
}

fn excited(excitation: Excitation) -> Shaker<Recorder> {
    let mut shaker = armed();
    assert_eq!(excite(&mut shaker, excitation), CommandResult::Done);
    shaker
}

/// Ticks with a living host: the drive of each.
pub(super) fn run(shaker: &mut Shaker<Recorder>, ticks: u32) -> Vec<Drive> {
    (0..ticks)
        .map(|_| {
            shaker.command(Command::KeepAlive);
            let drive = shaker.drive();
            shaker.tick();
            drive
        })
        .collect()
}

fn sweep(law: Law, back: bool) -> Excitation {
    Excitation { glide: Glide { law, back, to_millihertz: 8_000, ms: 4_000 }, ..Excitation::sine(5_000, 2_000) }
}

fn three() -> Form {
    let mut form = Form::SINE;
    for (i, component) in form.0.iter_mut().take(3).enumerate() {
        *component = Component { harmonic: 1 + i as u8, share: 10_922, phase: 20_000 * i as u16 };
    }
    form
}

#[test]
fn a_constant_excitation_is_the_sine_of_a_start() {
    let mut a = armed();
    let start = Command::Start { amplitude_micrometre: 5_000, frequency_millihertz: 5_000 };
    assert_eq!(a.command(start), CommandResult::Done);
    let mut b = excited(Excitation::sine(5_000, 5_000));
    assert_eq!(run(&mut a, 1_000), run(&mut b, 1_000));
    assert_eq!(a.output, b.output);
}

#[test]
fn a_sweep_begins_when_the_amplitude_is_there_and_ends_at_its_frequency() {
    for (law, back) in [(Law::Linear, false), (Law::Logarithmic, false), (Law::Linear, true), (Law::Logarithmic, true)]
    {
        let mut shaker = excited(sweep(law, back));
        let drives = run(&mut shaker, 4_600);
        let [from, to] = [2_000, 8_000].map(|f| phase_increment(f, 500_000).unwrap());
        // 5 mm at 20 mm/s are 125 ticks; the increment changes every ten of those that follow.
        let stair = |tick: usize| tick.saturating_sub(125) / STAIR as usize;
        for (tick, drive) in drives.iter().enumerate().skip(125) {
            assert_eq!(drive.state, ShakerState::Running);
            if stair(tick) == 0 {
                assert_eq!(drive.phase_increment, from);
            }
            if stair(tick) == stair(tick - 1) {
                assert_eq!(drive.phase_increment, drives[tick - 1].phase_increment, "tick {tick}");
            }
            assert_eq!(drive.phase, drives[tick - 1].phase.wrapping_add(drives[tick - 1].phase_increment));
        }
        assert_eq!(drives[125 + 2_000].phase_increment, to);
        assert_eq!(drives[125 + 2_400].phase_increment == to, !back);
        // As it has been commanded, so it was written: to the last bit.
        let written: Vec<i32> =
            drives.iter().map(|d| Form::SINE.displacement(d.amplitude_nanometre, d.phase)).collect();
        assert_eq!(shaker.output.writes[2..], written);
    }
}

#[test]
fn several_sines_are_written_as_their_sum_and_ramped_at_both_ends() {
    let mut shaker = excited(Excitation { form: three(), ..Excitation::sine(6_000, 4_000) });
    let mut drives = run(&mut shaker, 700);
    shaker.command(Command::Stop);
    drives.extend(run(&mut shaker, 200));
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Armed, StopCause::Command));
    // 6 mm at 20 mm/s are 150 ticks, up and down.
    assert_eq!([drives[0].amplitude_nanometre, drives[75].amplitude_nanometre], [0, 3_000_000]);
    assert!(drives[150..700].iter().all(|drive| drive.amplitude_nanometre == 6_000_000));
    assert_eq!(drives[775].amplitude_nanometre, 3_000_000);
    let written: Vec<i32> =
        drives[..851].iter().map(|d| three().displacement(d.amplitude_nanometre, d.phase)).collect();
    assert_eq!(shaker.output.writes[2..], written);
    assert_eq!(written.last(), Some(&0));
    assert!(written.iter().any(|y| *y > 3_000_000));
}

#[test]
fn amplitudes_follow_each_other_and_the_last_stays() {
    let mut excitation = Excitation { steps: 3, hold_ms: 1_000, ..Excitation::sine(2_000, 5_000) };
    excitation.amplitudes_micrometre[..4].copy_from_slice(&[2_000, 6_000, 4_000, 9_000]);
    let mut shaker = excited(excitation);
    let drives = run(&mut shaker, 3_000);
    // Ramps of 50, 100 and 50 ticks, each held for 500.
    for (tick, micrometre) in [
        (25, 1_000),
        (50, 2_000),
        (550, 2_000),
        (600, 4_000),
        (650, 6_000),
        (1_150, 6_000),
        (1_200, 4_000),
        (2_999, 4_000),
    ] {
        assert_eq!(drives[tick].amplitude_nanometre, micrometre * 1_000, "tick {tick}");
    }
    assert_eq!(
        [drives[40].state, drives[300].state, drives[600].state].map(|s| s == ShakerState::Running),
        [false, true, false]
    );
}

#[test]
fn silence_stops_a_sweep_along_a_ramp() {
    let mut shaker = excited(sweep(Law::Linear, true));
    run(&mut shaker, 1_000);
    let mut silent = 0;
    while shaker.state() == ShakerState::Running {
        shaker.tick();
        silent += 1;
    }
    // The time-out of 2 s; the last command came a tick before.
    assert_eq!((silent, shaker.state(), shaker.stop_cause()), (999, ShakerState::Stopping, StopCause::HostSilent));
    let before = shaker.drive();
    let mut last = before.amplitude_nanometre;
    while shaker.state() == ShakerState::Stopping {
        shaker.tick();
        let now = shaker.drive();
        assert!(last.abs_diff(now.amplitude_nanometre) <= 40_000);
        // The frequency stays meanwhile.
        assert!([before.phase_increment, 0].contains(&now.phase_increment));
        last = now.amplitude_nanometre;
    }
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Disarmed, false));
    assert_eq!(shaker.output.writes.last(), Some(&0));
}

#[test]
fn what_is_beyond_a_limit_is_refused_and_so_is_a_change_while_it_moves() {
    let mut shaker = armed();
    for (excitation, limit) in [
        (Excitation { form: three(), ..Excitation::sine(6_000, 6_667) }, 6_666),
        // 40 m/s² at 8 Hz.
        (Excitation { amplitudes_micrometre: [16_000; 8], ..sweep(Law::Linear, false) }, 15_831),
        (Excitation { glide: Glide { ms: 99, ..sweep(Law::Linear, false).glide }, ..sweep(Law::Linear, false) }, 100),
        (Excitation { steps: 0, ..Excitation::sine(1, 1) }, 1),
    ] {
        assert_eq!(excite(&mut shaker, excitation), CommandResult::OutOfRange { limit });
        assert_eq!(shaker.state(), ShakerState::Armed);
    }
    assert_eq!(excite(&mut shaker, sweep(Law::Linear, false)), CommandResult::Done);
    run(&mut shaker, 500);
    for command in [
        Command::Prepare(Part::Anew),
        Command::Excite { frequency_millihertz: 2_000 },
        Command::Start { amplitude_micrometre: 5_000, frequency_millihertz: 2_000 },
    ] {
        assert_eq!(shaker.command(command), CommandResult::WrongState);
    }
    assert_eq!(*shaker.excitation(), sweep(Law::Linear, false));
}

#[test]
fn the_emergency_stop_is_latched_until_it_is_released_and_disarmed() {
    let mut shaker = excited(sweep(Law::Linear, false));
    run(&mut shaker, 500);
    shaker.output.cut = true;
    let writes = shaker.output.writes.len();
    run(&mut shaker, 3);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Faulted, StopCause::EmergencyStop));
    assert_eq!((shaker.take_notice(), shaker.output.enabled), (Some(Notice::EmergencyStop), false));
    // At rest from that tick on, and the amplifier stays off when the line is there again.
    assert_eq!(shaker.output.writes[writes..], [0]);
    assert_eq!(shaker.command(Command::Disarm), CommandResult::WrongState);
    assert_eq!(shaker.command(Command::Arm), CommandResult::WrongState);
    shaker.output.cut = false;
    run(&mut shaker, 3);
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Faulted, false));
    assert_eq!(shaker.command(Command::Arm), CommandResult::WrongState);
    assert_eq!(shaker.command(Command::Disarm), CommandResult::Done);
    assert_eq!(shaker.command(Command::Arm), CommandResult::Done);
    // Also where nothing moves.
    shaker.output.cut = true;
    run(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Faulted, false));
}

#[test]
fn a_trigger_starts_what_waits_and_is_given_while_it_moves() {
    let mut shaker = excited(Excitation { on_trigger: true, ..Excitation::sine(1_000, 5_000) });
    run(&mut shaker, 100);
    assert_eq!((shaker.state(), shaker.output.trigger, shaker.take_begun()), (ShakerState::Armed, false, false));
    shaker.output.triggered = true;
    run(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.output.trigger, shaker.take_begun()), (ShakerState::Ramping, true, true));
    shaker.command(Command::Stop);
    run(&mut shaker, 200);
    assert_eq!((shaker.state(), shaker.output.trigger), (ShakerState::Armed, false));
    // A stop, silence and a fault end the waiting, too.
    for end in [Some(Command::Stop), Some(Command::Disarm), None] {
        let mut shaker = excited(Excitation { on_trigger: true, ..Excitation::sine(1_000, 5_000) });
        match end {
            Some(command) => assert_eq!(shaker.command(command), CommandResult::Done),
            None => (0..2_000).for_each(|_| shaker.tick()),
        }
        shaker.command(Command::Arm);
        shaker.output.triggered = true;
        run(&mut shaker, 10);
        assert_eq!(shaker.state(), ShakerState::Armed);
    }
}

fn any_excitation() -> impl Strategy<Value = Excitation> {
    let component = (0_u8..5, 0_u16..12_000, any::<u16>());
    let form = proptest::array::uniform6(component)
        .prop_map(|all| Form(all.map(|(harmonic, share, phase)| Component { harmonic, share, phase })));
    let law = prop_oneof![Just(Law::Steady), Just(Law::Linear), Just(Law::Logarithmic)];
    let glide = (law, any::<bool>(), 0_u32..25_000, 0_u32..9_000).prop_map(|(law, back, to_millihertz, ms)| Glide {
        law,
        back,
        to_millihertz,
        ms,
    });
    (
        1_u32..25_000,
        glide,
        proptest::array::uniform8(0_u32..25_000),
        0_u8..=8,
        0_u32..3_000,
        prop_oneof![Just(Form::SINE), form],
    )
        .prop_map(|(frequency_millihertz, glide, amplitudes_micrometre, steps, hold_ms, form)| Excitation {
            frequency_millihertz,
            glide,
            amplitudes_micrometre,
            steps,
            hold_ms,
            form,
            ..Excitation::default()
        })
}

proptest! {
    #[test]
    fn whatever_is_commanded_keeps_to_the_limits(excitation in any_excitation(), missed in 0_u32..50) {
        let mut shaker = armed();
        let result = excite(&mut shaker, excitation);
        prop_assert_eq!(result == CommandResult::Done, excitation.refusal(&Settings::default().limits).is_none());
        let limits = Settings::default().limits;
        let mut last = shaker.drive();
        for tick in 0..4_000 {
            if tick % 1_000 == 999 {
                shaker.skip(missed);
                last = shaker.drive();
            }
            shaker.command(Command::KeepAlive);
            shaker.tick();
            let now = shaker.drive();
            prop_assert!(now.state != ShakerState::Faulted);
            prop_assert!(now.amplitude_nanometre <= limits.amplitude_micrometre * 1_000);
            prop_assert!(now.amplitude_nanometre.abs_diff(last.amplitude_nanometre) <= 40_000);
            let hertz = f64::from(now.phase_increment) * 500.0 / 4_294_967_296.0;
            let parts = excitation.form.components();
            let acceleration: f64 = parts
                .map(|c| f64::from(c.share) / 32_768.0 * (core::f64::consts::TAU * f64::from(c.harmonic) * hertz).powi(2))
                .sum::<f64>() * f64::from(now.amplitude_nanometre) * 1e-9;
            prop_assert!(acceleration <= 40.000_1, "{acceleration}");
            prop_assert_eq!(last.phase.wrapping_add(last.phase_increment), now.phase);
            last = now;
        }
        let written = shaker.output.writes.iter().map(|y| y.unsigned_abs()).max();
        prop_assert!(written <= Some(limits.amplitude_micrometre * 1_000));
    }
}

//! The state machine: what it may do, and that it does nothing else.

use std::{format, vec};

use super::*;
use crate::testing::Recorder;
use whirl_shared::excitation::{Form, amplitude_limit};
use whirl_shared::frame::{Command, CommandResult};

mod rules;

const START: Command = Command::Start { amplitude_micrometre: 10_000, frequency_millihertz: 5_000 };

fn shaker() -> Shaker<Recorder> {
    Shaker::new(&Settings::default(), Recorder::default())
}

fn done(shaker: &mut Shaker<Recorder>, command: Command) {
    assert_eq!(shaker.command(command), CommandResult::Done, "{command:?}");
}

/// Ticks with a living host.
fn run(shaker: &mut Shaker<Recorder>, ticks: u32) {
    for _ in 0..ticks {
        shaker.command(Command::KeepAlive);
        shaker.tick();
    }
}

/// Ticks without a host.
fn alone(shaker: &mut Shaker<Recorder>, ticks: u32) {
    for _ in 0..ticks {
        shaker.tick();
    }
}

fn running() -> Shaker<Recorder> {
    let mut shaker = shaker();
    done(&mut shaker, Command::Arm);
    done(&mut shaker, START);
    run(&mut shaker, 1_000);
    assert_eq!(shaker.state(), ShakerState::Running);
    shaker
}

#[test]
fn silent_at_boot() {
    let mut shaker = shaker();
    alone(&mut shaker, 10_000);
    assert_eq!(shaker.output, Recorder { writes: vec![0], ..Recorder::default() });
    assert_eq!(shaker.drive(), Drive::default());
    assert_eq!((shaker.stop_cause(), shaker.take_notice()), (StopCause::None, None));
}

#[test]
fn a_whole_run() {
    let mut shaker = shaker();
    assert_eq!(shaker.command(START), CommandResult::WrongState);
    done(&mut shaker, Command::Arm);
    assert!(shaker.output.enabled);
    done(&mut shaker, START);
    assert_eq!(shaker.state(), ShakerState::Ramping);
    // 10 mm at 20 mm/s are 250 ticks.
    run(&mut shaker, 249);
    assert_eq!(shaker.state(), ShakerState::Ramping);
    run(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.drive().amplitude_nanometre), (ShakerState::Running, 10_000_000));
    assert_eq!(shaker.excitation().frequency_millihertz, 5_000);
    run(&mut shaker, 500);
    done(&mut shaker, Command::Stop);
    assert_eq!(shaker.state(), ShakerState::Stopping);
    run(&mut shaker, 250);
    assert_eq!((shaker.state(), shaker.drive().amplitude_nanometre), (ShakerState::Stopping, 0));
    run(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Armed, StopCause::Command));
    assert_eq!(shaker.output.writes.last(), Some(&0));
    // At rest nothing is written and the phase stands still.
    let (writes, phase) = (shaker.output.writes.len(), shaker.drive().phase);
    run(&mut shaker, 100);
    assert_eq!((shaker.output.writes.len(), shaker.drive().phase), (writes, phase));
    done(&mut shaker, Command::Disarm);
    assert!(!shaker.output.enabled);
    assert_eq!(shaker.state(), ShakerState::Disarmed);
}

#[test]
fn each_write_is_amplitude_times_cosine_of_the_phase_that_is_reported() {
    let mut shaker = shaker();
    done(&mut shaker, Command::Arm);
    done(&mut shaker, Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_200 });
    let mut phase = 0_u32;
    for _ in 0..2_000 {
        let drive = shaker.drive();
        assert_eq!((drive.phase, drive.phase_increment), (phase, 44_667_660));
        run(&mut shaker, 1);
        let want = f64::from(drive.amplitude_nanometre) * libm_cos(f64::from(phase) / 4_294_967_296.0);
        assert!((f64::from(*shaker.output.writes.last().unwrap()) - want).abs() < 3.0);
        phase = phase.wrapping_add(44_667_660);
    }
}

/// cos of a number of turns, by the standard library.
fn libm_cos(turns: f64) -> f64 {
    (turns * core::f64::consts::TAU).cos()
}

#[test]
fn host_silence_ramps_down_and_disarms() {
    let mut shaker = running();
    // 2 s are 1000 ticks after the last command, which came before the last tick.
    alone(&mut shaker, 998);
    assert_eq!(shaker.state(), ShakerState::Running);
    alone(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Stopping, StopCause::HostSilent));
    assert_eq!(shaker.take_notice(), Some(Notice::HostSilent));
    // The host comes back too late: the shaker goes on to stop and disarms.
    done(&mut shaker, Command::Stop);
    assert_eq!(shaker.command(START), CommandResult::WrongState);
    run(&mut shaker, 251);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Disarmed, StopCause::HostSilent));
    assert!(!shaker.output.enabled);
    assert_eq!(shaker.output.writes.last(), Some(&0));
}

#[test]
fn refused_commands_do_not_keep_the_watchdog_quiet_and_missed_ticks_count() {
    let mut shaker = running();
    shaker.skip(400);
    for _ in 0..599 {
        assert_ne!(shaker.command(Command::ZeroCounts), CommandResult::Done);
        shaker.tick();
    }
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Stopping, StopCause::HostSilent));
}

#[test]
fn an_armed_shaker_is_disarmed_by_silence() {
    let mut shaker = shaker();
    done(&mut shaker, Command::Arm);
    alone(&mut shaker, 999);
    assert_eq!(shaker.state(), ShakerState::Armed);
    alone(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Disarmed, false));
}

#[test]
fn limits() {
    let mut shaker = shaker();
    done(&mut shaker, Command::Arm);
    let mut start = |amplitude_micrometre, frequency_millihertz| {
        let before = format!("{shaker:?}");
        let result = shaker.command(Command::Start { amplitude_micrometre, frequency_millihertz });
        assert_eq!(before, format!("{shaker:?}"), "a refused command changed something");
        result
    };
    assert_eq!(start(20_001, 1_000), CommandResult::OutOfRange { limit: 20_000 });
    assert_eq!(start(u32::MAX, 1_000), CommandResult::OutOfRange { limit: 20_000 });
    assert_eq!(start(1_000, 20_001), CommandResult::OutOfRange { limit: 20_000 });
    assert_eq!(start(1_000, 0), CommandResult::OutOfRange { limit: 1 });
    // 40 m/s² at 10 Hz: 40/(20π)² m = 10.132 mm.
    assert_eq!(start(10_133, 10_000), CommandResult::OutOfRange { limit: 10_132 });
    assert_eq!(amplitude_limit(40_000, 10_000, &Form::SINE), 10_132);
    assert_eq!(amplitude_limit(u32::MAX, 0, &Form::SINE), u32::MAX);
    assert_eq!(amplitude_limit(1, 1_000, &Form::SINE), 25);
    for (command, limit) in [
        (Command::SetRamp { micrometre_per_s: 20_001 }, 20_000),
        (Command::SetRamp { micrometre_per_s: 0 }, 1),
        (Command::SetHostTimeout { ms: 99 }, 100),
        (Command::SetHostTimeout { ms: 60_001 }, 60_000),
    ] {
        assert_eq!(shaker.command(command), CommandResult::OutOfRange { limit });
    }
}

#[test]
fn the_limits_themselves_are_allowed() {
    for (amplitude_micrometre, frequency_millihertz) in [(20_000, 1), (0, 20_000), (10_132, 10_000)] {
        let mut shaker = shaker();
        done(&mut shaker, Command::Arm);
        done(&mut shaker, Command::Start { amplitude_micrometre, frequency_millihertz });
        run(&mut shaker, 600);
        let drive = shaker.drive();
        assert_eq!((drive.state, drive.amplitude_nanometre), (ShakerState::Running, amplitude_micrometre * 1_000));
    }
    let mut shaker = shaker();
    for (micrometre_per_s, ms) in [(1, 100), (20_000, 60_000)] {
        done(&mut shaker, Command::SetRamp { micrometre_per_s });
        done(&mut shaker, Command::SetHostTimeout { ms });
        assert_eq!((shaker.ramp_micrometre_per_s(), shaker.host_timeout_ms()), (micrometre_per_s, ms));
    }
}

#[test]
fn while_it_moves_the_amplitude_may_change_and_nothing_else() {
    let mut shaker = running();
    for command in [
        Command::Start { amplitude_micrometre: 10_000, frequency_millihertz: 5_001 },
        Command::SetRamp { micrometre_per_s: 1_000 },
        Command::SetHostTimeout { ms: 1_000 },
        Command::ZeroCounts,
        Command::Arm,
    ] {
        assert_eq!(shaker.command(command), CommandResult::WrongState, "{command:?}");
    }
    let phase = shaker.drive().phase;
    done(&mut shaker, Command::Start { amplitude_micrometre: 4_000, frequency_millihertz: 5_000 });
    assert_eq!((shaker.state(), shaker.drive().phase), (ShakerState::Ramping, phase));
    run(&mut shaker, 150);
    assert_eq!((shaker.state(), shaker.drive().amplitude_nanometre), (ShakerState::Running, 4_000_000));
}

#[test]
fn a_slower_ramp_is_kept() {
    let mut shaker = shaker();
    done(&mut shaker, Command::SetRamp { micrometre_per_s: 1_000 });
    assert_eq!(shaker.ramp_micrometre_per_s(), 1_000);
    done(&mut shaker, Command::Arm);
    done(&mut shaker, START);
    run(&mut shaker, 500);
    assert_eq!(shaker.drive().amplitude_nanometre, 1_000_000);
}

#[test]
fn disarming_while_moving_ramps_down_first() {
    let mut shaker = running();
    done(&mut shaker, Command::Disarm);
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Stopping, true));
    run(&mut shaker, 251);
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Disarmed, false));
    let mut shaker = running();
    done(&mut shaker, Command::Stop);
    done(&mut shaker, Command::Disarm);
    run(&mut shaker, 251);
    assert_eq!(shaker.state(), ShakerState::Disarmed);
}

#[test]
fn silence_while_stopping_disarms() {
    let mut shaker = shaker();
    done(&mut shaker, Command::SetRamp { micrometre_per_s: 100 });
    done(&mut shaker, Command::Arm);
    done(&mut shaker, START);
    run(&mut shaker, 5_000);
    done(&mut shaker, Command::Stop);
    alone(&mut shaker, 5_001);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Disarmed, StopCause::Command));
}

#[test]
fn every_run_begins_at_phase_zero() {
    let mut shaker = running();
    done(&mut shaker, Command::Stop);
    run(&mut shaker, 300);
    assert_ne!(shaker.drive().phase, 0);
    done(&mut shaker, START);
    assert_eq!((shaker.drive().phase, shaker.drive().phase_increment), (0, 42_949_673));
}

#[test]
fn a_failing_output_faults_and_disarm_clears() {
    let mut shaker = running();
    shaker.output.fail_write = true;
    run(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Faulted, StopCause::Fault));
    assert_eq!((shaker.drive().amplitude_nanometre, shaker.drive().phase_increment), (0, 0));
    assert_eq!((shaker.take_notice(), shaker.output.enabled), (Some(Notice::OutputFailed), false));
    assert_eq!(shaker.command(Command::Arm), CommandResult::WrongState);
    assert_eq!(shaker.command(START), CommandResult::WrongState);
    // Still broken: the fault stays.
    assert_eq!(shaker.command(Command::Disarm), CommandResult::WrongState);
    assert_eq!(shaker.state(), ShakerState::Faulted);
    shaker.output.fail_write = false;
    done(&mut shaker, Command::Disarm);
    assert_eq!(shaker.state(), ShakerState::Disarmed);
    done(&mut shaker, Command::Arm);
}

#[test]
fn an_amplifier_that_stays_on_is_switched_off_as_soon_as_that_works() {
    let mut shaker = running();
    shaker.output.fail_write = true;
    shaker.output.fail_enable = true;
    run(&mut shaker, 3);
    assert_eq!((shaker.state(), shaker.output.enabled), (ShakerState::Faulted, true));
    shaker.output.fail_write = false;
    run(&mut shaker, 1);
    assert!(shaker.output.enabled);
    shaker.output.fail_enable = false;
    run(&mut shaker, 1);
    assert_eq!((shaker.output.enabled, shaker.output.writes.last()), (false, Some(&0)));
    // And is left alone then.
    let writes = shaker.output.writes.len();
    run(&mut shaker, 10);
    assert_eq!(shaker.output.writes.len(), writes);
}

#[test]
fn a_host_is_heard_from_its_first_command_to_its_time_out() {
    let mut shaker = shaker();
    assert!(!shaker.hears_host());
    assert_eq!(shaker.command(START), CommandResult::WrongState);
    assert!(!shaker.hears_host());
    done(&mut shaker, Command::KeepAlive);
    alone(&mut shaker, 999);
    assert!(shaker.hears_host());
    alone(&mut shaker, 1);
    assert!(!shaker.hears_host());
}

#[test]
fn an_output_that_fails_at_boot_or_at_arming_faults() {
    let broken = Recorder { fail_write: true, ..Recorder::default() };
    assert_eq!(Shaker::new(&Settings::default(), broken).state(), ShakerState::Faulted);
    let mut shaker = shaker();
    shaker.output.fail_enable = true;
    assert_eq!(shaker.command(Command::Arm), CommandResult::WrongState);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Faulted, StopCause::Fault));
}

#[test]
fn an_amplitude_beyond_the_limit_is_cut_off_whatever_put_it_there() {
    let mut shaker = running();
    shaker.limits.amplitude_micrometre = 9_999;
    let writes = shaker.output.writes.len();
    run(&mut shaker, 1);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Faulted, StopCause::Limit));
    assert_eq!(shaker.output.writes[writes..], [0]);
    assert_eq!(shaker.take_notice(), Some(Notice::LimitExceeded));
}

#[test]
fn missed_ticks_move_the_phase_and_not_the_amplitude() {
    let mut shaker = shaker();
    done(&mut shaker, Command::Arm);
    done(&mut shaker, START);
    run(&mut shaker, 10);
    let before = shaker.drive();
    shaker.skip(7);
    let after = shaker.drive();
    assert_eq!(after.amplitude_nanometre, before.amplitude_nanometre);
    assert_eq!(after.phase, before.phase.wrapping_add(7 * before.phase_increment));
}

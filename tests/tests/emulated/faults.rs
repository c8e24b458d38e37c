//! What goes wrong on the emulated board is counted and reported, and leaves the shaker at rest.

use whirl_firmware::lock_step::Order;
use whirl_hil_sim::emulated::{Emulation, EmulatorSettings, Script, Sent, run};
use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::frame::{Command, CommandResult, Envelope, HostMessage, ShakerState, StopCause};

use crate::image;

fn emulate(script: Script, ticks: u32) -> Option<(Emulation, Sent)> {
    let image = image::image()?;
    let folder = tempfile::tempdir().unwrap();
    let emulation = run(&EmulatorSettings { script, ..EmulatorSettings::new(image, folder.path(), ticks) }).unwrap();
    let sent = Sent::of(&emulation.frames);
    Some((emulation, sent))
}

fn at_rest(emulation: &Emulation) -> bool {
    emulation.last.displacement_nanometre == 0 && !emulation.last.amplifier_on
}

#[test]
fn the_shaker_is_silent_until_it_is_told_to_move() {
    // A start without arming, and one beyond its limits.
    let script = Script::new()
        .command(100, Command::Start { amplitude_micrometre: 10_000, frequency_millihertz: 5_000 })
        .command(200, Command::Arm)
        .command(201, Command::Start { amplitude_micrometre: 20_001, frequency_millihertz: 5_000 })
        .command(202, Command::Start { amplitude_micrometre: 10_000, frequency_millihertz: 20_001 });
    let Some((emulation, sent)) = emulate(script, 1_200) else { return };
    assert_eq!((emulation.moving_ticks(), emulation.status), (0, Some(0)));
    let results: Vec<_> = sent.acks.iter().map(|ack| ack.result).collect();
    let out = |limit| CommandResult::OutOfRange { limit };
    assert_eq!(results, [CommandResult::WrongState, CommandResult::Done, out(20_000), out(20_000)]);
    assert_eq!(sent.statuses.last().unwrap().rejected_commands, 3);
}

#[test]
fn a_damaged_command_changes_nothing_and_is_counted() {
    let mut frame = [0; MAX_FRAME];
    let message = HostMessage::Command(Command::Arm);
    let length = encode(&Envelope { sequence: 0, message }, &mut frame).unwrap();
    let mut script = Script::new();
    for bit in 0..8 * (length - 1) {
        let mut damaged = frame;
        damaged[bit / 8] ^= 1 << (bit % 8);
        script = script.bytes(10 + 2 * bit as u32, &damaged[..length]);
    }
    let Some((emulation, sent)) = emulate(script, 1_100) else { return };
    assert_eq!(emulation.status, Some(0));
    assert!(sent.acks.is_empty(), "{:?}", sent.acks);
    let status = sent.statuses.last().unwrap();
    assert_eq!(status.shaker, ShakerState::Disarmed);
    assert!(status.bad_frames >= 8 * (length as u32 - 1), "{status:?}");
}

#[test]
fn a_host_that_falls_silent_leaves_the_shaker_at_rest() {
    let script = Script::new().command(0, Command::SetHostTimeout { ms: 500 }).drive(1, 700, 100, 5_000, 5_000);
    let Some((emulation, sent)) = emulate(script, 2_500) else { return };
    assert!(emulation.moving_ticks() > 500 && at_rest(&emulation), "{emulation:?}");
    let status = sent.statuses.last().unwrap();
    assert_eq!((status.shaker, status.stop_cause), (ShakerState::Disarmed, StopCause::HostSilent));
    assert!(sent.logs.iter().any(|log| log.text.contains("host silent")));
}

#[test]
fn a_panic_leaves_the_shaker_at_rest() {
    let script = Script::new().drive(0, 1_000, 400, 15_525, 5_000).order(800, Order::Panic);
    let Some((emulation, _)) = emulate(script, 1_000) else { return };
    assert!(emulation.moving_ticks() > 500);
    assert!(emulation.last.panicked && at_rest(&emulation), "{:?}", emulation.last);
    assert_eq!(emulation.status, Some(1));
    assert!(emulation.console.contains("ordered to"), "{}", emulation.console);
}

#[test]
fn a_panic_within_the_report_of_a_panic_leaves_the_shaker_at_rest_and_ends() {
    let script = Script::new().drive(0, 1_000, 400, 15_525, 5_000).order(800, Order::PanicTwice(false));
    let Some((emulation, _)) = emulate(script, 1_000) else { return };
    assert!(emulation.last.panicked && at_rest(&emulation), "{:?}", emulation.last);
    assert_eq!(emulation.status, Some(1));
    assert!(!emulation.console.contains("while it was written"), "{}", emulation.console);
}

#[test]
fn an_output_that_fails_is_a_fault_with_the_amplifier_off() {
    let script = Script::new().drive(0, 1_400, 400, 15_525, 5_000).order(900, Order::BreakOutput);
    let Some((emulation, sent)) = emulate(script, 1_600) else { return };
    assert!(!emulation.last.amplifier_on && emulation.last.amplitude_nanometre == 0, "{:?}", emulation.last);
    let status = sent.statuses.last().unwrap();
    assert_eq!((status.shaker, status.stop_cause), (ShakerState::Faulted, StopCause::Fault));
}

#[test]
fn missed_ticks_are_told_by_the_device_and_shown_by_the_stream() {
    let script = Script::new().drive(0, 1_500, 400, 15_525, 5_000).order(700, Order::Stall(7));
    let Some((emulation, sent)) = emulate(script, 1_600) else { return };
    let overruns = sent.statuses.last().unwrap().overruns;
    // The interrupt waits for the end of the stall: the tick in which it comes is late, not missed.
    assert!((6..=7).contains(&overruns), "{overruns}");
    assert_eq!(sent.samples.missing, u64::from(overruns));
    assert_eq!((sent.samples.received + sent.samples.missing) / 10, 159);
    assert_eq!(emulation.status, Some(0));
}

#[test]
fn a_link_that_takes_nothing_makes_drops_that_the_device_counts() {
    let script = Script::new().order(600, Order::BlockLink(1_000));
    let Some((emulation, sent)) = emulate(script, 3_000) else { return };
    assert_eq!(emulation.status, Some(0));
    let status = sent.statuses.last().unwrap();
    // 63 blocks fit; the rest of 1 000 samples is gone.
    assert!((360..=380).contains(&status.dropped_samples), "{status:?}");
    assert_eq!(sent.samples.missing, u64::from(status.dropped_samples));
    assert_eq!(sent.sequence.lost, 0);
}

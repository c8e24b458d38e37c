//! Zeros, resets and settings, as a host sees them.

use std::collections::BTreeSet;
use std::vec::Vec;

use super::*;
use crate::settings::Boot;
use crate::testing::{Host, Indexed, Recorder};
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::*;

/// A device and a host over a perfect link.
struct Device {
    app: App<(Indexed, Indexed), Recorder>,
    host: Host,
    counts: [u16; 2],
}

impl Device {
    fn boot(settings: &Settings, built_in: &Settings) -> Self {
        let app = App::new(settings.clone(), (Indexed::default(), Indexed::default()), Recorder::default());
        let mut app = app.unwrap();
        app.set_built_in(built_in);
        Self { app, host: Host::new(), counts: [0; 2] }
    }

    fn new() -> Self {
        let settings = Settings { boot_id: 77, ..Settings::default() };
        Self::boot(&settings, &settings)
    }

    /// Ticks in which the arms turn by so much each.
    fn turn(&mut self, ticks: u32, by: [i16; 2]) {
        for _ in 0..ticks {
            let (one, two) = self.app.inputs_mut();
            for (counter, (count, by)) in [one, two].into_iter().zip(self.counts.iter_mut().zip(by)) {
                *count = count.wrapping_add_signed(by);
                counter.0 = *count;
            }
            self.app.tick(0, 0);
            self.transmit();
        }
    }

    fn transmit(&mut self) {
        let mut out = [0; MAX_FRAME];
        while let Some(length) = self.app.poll_transmit(&mut out) {
            self.host.take(&out[..length]);
        }
    }

    /// Carries a command out; its result.
    fn command(&mut self, command: Command) -> CommandResult {
        let frame = self.host.frame(command);
        self.app.receive(&frame);
        self.turn(1, [0; 2]);
        let answer = self.host.received.iter().rev().find_map(|e| match &e.message {
            DeviceMessage::Ack(ack) => Some(ack.result),
            _ => None,
        });
        answer.unwrap()
    }

    fn hellos(&self) -> Vec<Hello> {
        let hello = |e: &Envelope<DeviceMessage>| match &e.message {
            DeviceMessage::Hello(hello) => Some(hello.clone()),
            _ => None,
        };
        self.host.received.iter().filter_map(hello).collect()
    }

    fn last_counts(&self) -> [i32; 2] {
        let kept = self.app.kept();
        [kept[0].count, kept[1].count]
    }

    /// The same device after a reset.
    fn reset(&self, cause: ResetCause) -> Self {
        let boot = Boot { reset: cause, kept: Some(self.app.kept()), ..Boot::default() };
        let settings = Settings { boot_id: 78, boot, ..Settings::default() };
        Self::boot(&settings, &settings)
    }
}

#[test]
fn counts_and_zeros_of_resting_arms_last_over_a_watchdog_s_reset() {
    let mut device = Device::new();
    device.turn(100, [40, -3]);
    device.turn(600, [0, 0]);
    let before = device.hellos();
    assert_eq!(
        before[0].zeros.iter().map(|zero| (zero.id, zero.source)).collect::<Vec<_>>(),
        [(77, ZeroSource::PowerUp); 2]
    );
    let mut after = device.reset(ResetCause::Watchdog);
    after.turn(1, [0, 0]);
    assert_eq!(after.last_counts(), [4_000, -300]);
    let hello = after.hellos().remove(0);
    assert_eq!((hello.boot_id, &hello.zeros, hello.reset), (78, &before[0].zeros, ResetCause::Watchdog));
    // And are said to be others' where an arm turned.
    device.turn(3, [5, 0]);
    let mut after = device.reset(ResetCause::Watchdog);
    after.turn(1, [2, 0]);
    assert_eq!(after.last_counts(), [4_017, -300]);
    let zeros = after.hellos().remove(0).zeros;
    assert_eq!((zeros[0].id, zeros[0].source), (78, ZeroSource::Carried));
    assert_eq!(zeros[1], before[0].zeros[1]);
}

#[test]
fn a_zero_that_was_commanded_has_an_id_of_its_own() {
    let mut device = Device::new();
    device.turn(10, [7, 7]);
    assert_eq!(device.command(Command::ZeroCounts), CommandResult::Done);
    assert_eq!(device.command(Command::ZeroCounts), CommandResult::Done);
    device.turn(1, [1, 0]);
    assert_eq!(device.last_counts(), [1, 0]);
    let ids: Vec<u32> = device.hellos().iter().map(|hello| hello.zeros[0].id).collect();
    assert_eq!(ids.len(), 3);
    assert!(ids[0] != ids[1] && ids[1] != ids[2] && ids[0] != ids[2], "{ids:?}");
    assert_eq!(device.hellos()[2].zeros[1].source, ZeroSource::Commanded);
    (0..64).for_each(|_| assert_eq!(device.command(Command::ZeroCounts), CommandResult::Done));
    let ids: BTreeSet<u32> = device.hellos().iter().map(|hello| hello.zeros[0].id).collect();
    assert_eq!(ids.len(), 3 + 64);
}

#[test]
fn an_index_is_told_and_so_is_a_count_that_was_lost() {
    let mut device = Device::new();
    device.turn(10, [100, 0]);
    device.app.inputs_mut().0.1 = Some(1_060);
    device.turn(1, [100, 0]);
    assert_eq!(
        device.hellos().last().unwrap().zeros.iter().map(|zero| zero.index).collect::<Vec<_>>(),
        [Some(1_060), None]
    );
    // A turn later at the same place, then five counts beside it.
    device.turn(40, [100, 0]);
    device.app.inputs_mut().0.1 = Some(1_060 + 4_096);
    device.turn(1, [100, 0]);
    device.turn(40, [100, 0]);
    device.app.inputs_mut().0.1 = Some(1_065 + 8_192);
    device.turn(1, [100, 0]);
    let logs: Vec<_> = device
        .host
        .received
        .iter()
        .filter_map(|e| if let DeviceMessage::Log(log) = &e.message { Some(log.text.as_str()) } else { None })
        .collect();
    assert_eq!(logs, ["encoder 1 has lost counts: its index moved"]);
    assert_eq!(device.hellos().len(), 2);
}

#[test]
fn settings_are_kept_for_the_next_boot_and_refused_under_a_run() {
    let mut device = Device::new();
    let set = Command::Set(Setting::CountsPerTurn { channel: 1, counts: 8_192 });
    assert_eq!(device.command(set), CommandResult::Done);
    let words = device.app.settings_to_keep().unwrap();
    device.app.settings_kept(true);
    assert_eq!(device.app.settings_to_keep(), None);
    device.transmit();
    // In force are the old ones.
    let hello = device.hellos().pop().unwrap();
    assert_eq!((&hello.counts_per_turn[..], hello.settings), (&[4_096; 2][..], SettingsSource::Changed));
    // A second one is beside the first.
    assert_eq!(device.command(Command::Set(Setting::Reversed { channel: 0, reversed: true })), CommandResult::Done);
    let both = device.app.settings_to_keep().unwrap();
    device.app.settings_kept(false);
    device.transmit();
    assert_eq!(device.hellos().pop().unwrap().settings, SettingsSource::NotKept);
    assert_ne!(both, words);
    let built_in = Settings { boot_id: 77, ..Settings::default() };
    let settings = built_in.with_words(&both).unwrap();
    assert_eq!((&settings.counts_per_turn[..], &settings.reversed[..]), (&[4_096, 8_192][..], &[true, false][..]));

    let refused = device.command(Command::Set(Setting::HostTimeout { ms: 1 }));
    assert_eq!(refused, CommandResult::OutOfRange { limit: 100 });
    assert_eq!(device.command(Command::Arm), CommandResult::Done);
    for command in [set, Command::Restart] {
        assert_eq!(device.command(command), CommandResult::WrongState);
    }
    assert_eq!((device.app.settings_to_keep(), device.app.restart_due()), (None, false));
    assert_eq!(device.command(Command::Disarm), CommandResult::Done);
    assert_eq!(device.command(Command::Restart), CommandResult::Done);
    assert!(device.app.restart_due());

    // The device that comes back counts the other way, and back to the image's own it goes too.
    let mut device = Device::boot(&settings, &built_in);
    device.turn(10, [3, 3]);
    assert_eq!(device.last_counts(), [-30, 30]);
    assert_eq!(device.hellos()[0].reversed, [true, false]);
    assert_eq!(device.command(Command::Set(Setting::BuiltIn)), CommandResult::Done);
    assert_eq!(device.app.settings_to_keep(), Some(built_in.to_words()));
}

#[test]
fn a_panic_s_text_is_in_the_next_hello_and_a_line_says_so() {
    let boot =
        Boot { reset: ResetCause::Panic, panic: "src/rig.rs:12: ordered to".try_into().unwrap(), ..Boot::default() };
    let settings = Settings { boot, ..Settings::default() };
    let mut device = Device::boot(&settings, &settings);
    device.transmit();
    let hello = device.hellos().remove(0);
    assert_eq!((hello.reset, hello.panic.as_str()), (ResetCause::Panic, "src/rig.rs:12: ordered to"));
    let log = device.host.received.iter().find_map(|e| match &e.message {
        DeviceMessage::Log(log) => Some((log.level, log.text.clone())),
        _ => None,
    });
    let (level, text) = log.unwrap();
    assert!(level == 0 && text.contains("panic"), "{text}");
}

//! What lasts over a reset of the emulated board: counts, zeros, settings, a panic's text.

use whirl_firmware::lock_step::Order;
use whirl_hil_sim::emulated::{Emulation, EmulatorSettings, Script, Sent, run};
use whirl_shared::block::{Counts, samples};
use whirl_shared::codec::Decoder;
use whirl_shared::frame::{
    Command, CommandResult, DeviceMessage, ResetCause, Setting, SettingsSource, ShakerState, ZeroSource,
};

use crate::image;

fn emulate(script: Script, ticks: u32, initial: [f64; 4]) -> Option<(Emulation, Sent)> {
    let image = image::image()?;
    let folder = tempfile::tempdir().unwrap();
    let mut settings = EmulatorSettings { script, ..EmulatorSettings::new(image, folder.path(), ticks) };
    settings.rig.initial = initial;
    let emulation = run(&settings).unwrap();
    assert_eq!(emulation.status, Some(0), "{}", emulation.console);
    let sent = Sent::of(&emulation.frames);
    Some((emulation, sent))
}

/// The counts of all samples, boot after boot.
fn counts(frames: &[u8]) -> Vec<(u32, Counts)> {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let messages = frames.iter().filter_map(|&byte| decoder.push(byte)?.ok());
    let block = |message| if let DeviceMessage::Samples(block) = message { Some(block) } else { None };
    messages
        .filter_map(|envelope| block(envelope.message))
        .flat_map(|block| samples(&block).map(|sample| (sample.tick, sample.counts)).collect::<Vec<_>>())
        .collect()
}

#[test]
fn resting_arms_keep_counts_and_zeros_over_a_watchdog_s_reset() {
    let script = Script::new().order(900, Order::Reset(false));
    let Some((emulation, sent)) = emulate(script, 1_500, [0.0; 4]) else { return };
    assert_eq!(emulation.resets, 1);
    let [first, second] = &sent.hellos[..] else { panic!("{:?}", sent.hellos) };
    assert_eq!((first.reset, second.reset), (ResetCause::Unknown, ResetCause::Watchdog));
    assert_ne!(first.boot_id, second.boot_id);
    assert_eq!(first.zeros, second.zeros);
    assert!(sent.logs.iter().any(|log| log.text.contains("watchdog")), "{:?}", sent.logs);
}

#[test]
fn arms_that_turn_are_carried_over_and_said_to_be() {
    const INITIAL: [f64; 4] = [2.0, 1.0, 20.0, -10.0];
    let script = Script::new().order(400, Order::Reset(false));
    let Some((reset, sent)) = emulate(script, 900, INITIAL) else { return };
    let Some((whole, _)) = emulate(Script::new(), 900, INITIAL) else { return };
    // Beside the run without a reset: the chip of the model loses none of the tick in which it is
    // reset.
    let (with, without) = (counts(&reset.frames), counts(&whole.frames));
    let restarted = with.windows(2).position(|pair| pair[1].0 < pair[0].0).unwrap() + 1;
    let lost = 401 - restarted;
    assert!(lost < 10, "{lost}");
    for (n, sample) in with[restarted..].iter().enumerate() {
        assert_eq!(sample.1, without[401 + n].1, "sample {n} after the reset");
    }
    let hellos = sent.hellos;
    assert!(hellos[1].zeros.len() == 2 && hellos[1].zeros.iter().all(|zero| zero.source == ZeroSource::Carried));
    assert!(hellos[1].zeros.iter().zip(&hellos[0].zeros).all(|(after, before)| after.id != before.id));
}

#[test]
fn a_panic_tells_its_text_after_the_reset_and_leaves_the_shaker_at_rest() {
    let script = Script::new().drive(0, 700, 300, 5_000, 5_000).order(600, Order::Reset(true));
    let Some((emulation, sent)) = emulate(script, 1_500, [0.1, 0.2, 0.0, 0.0]) else { return };
    assert_eq!(emulation.resets, 1);
    let hello = &sent.hellos[1];
    assert_eq!(hello.reset, ResetCause::Panic);
    assert!(hello.panic.contains("src/rig.rs:") && hello.panic.contains("ordered to, and to come back"), "{hello:?}");
    assert!(emulation.moving_ticks() > 500);
    let status = sent.statuses.last().unwrap();
    assert_eq!((status.shaker, status.amplitude_nanometre), (ShakerState::Disarmed, 0));
    assert!(!emulation.last.amplifier_on && emulation.last.displacement_nanometre == 0);
}

#[test]
fn a_panic_within_the_report_of_a_panic_ends_in_a_reset_too_and_in_no_loop() {
    let script = Script::new().drive(0, 700, 300, 5_000, 5_000).order(600, Order::PanicTwice(true));
    let Some((emulation, sent)) = emulate(script, 1_500, [0.1, 0.2, 0.0, 0.0]) else { return };
    assert_eq!((emulation.resets, sent.hellos.len()), (1, 2));
    // Nothing is left that could be told.
    assert_eq!((sent.hellos[1].reset, sent.hellos[1].panic.as_str()), (ResetCause::Watchdog, ""));
    assert!(emulation.moving_ticks() > 500);
    let status = sent.statuses.last().unwrap();
    assert_eq!((status.shaker, status.amplitude_nanometre), (ShakerState::Disarmed, 0));
    assert!(!emulation.last.amplifier_on && emulation.last.displacement_nanometre == 0);
}

#[test]
fn settings_last_in_flash_and_are_in_force_after_a_restart() {
    let script = Script::new()
        .command(100, Command::Set(Setting::CountsPerTurn { channel: 0, counts: 2_048 }))
        .command(120, Command::Set(Setting::Reversed { channel: 1, reversed: true }))
        .command(140, Command::Set(Setting::HostTimeout { ms: 1 }))
        .command(200, Command::Restart)
        .command(700, Command::Set(Setting::BuiltIn))
        .command(800, Command::Restart);
    let Some((emulation, sent)) = emulate(script, 1_200, [0.0; 4]) else { return };
    assert_eq!(emulation.resets, 2);
    let results: Vec<_> = sent.acks.iter().map(|ack| ack.result).collect();
    let done = CommandResult::Done;
    assert_eq!(results, [done, done, CommandResult::OutOfRange { limit: 100 }, done, done, done]);
    let told: Vec<_> = sent.hellos.iter().map(|h| (h.settings, h.counts_per_turn[0], h.reversed[1])).collect();
    assert_eq!(
        told,
        [
            (SettingsSource::BuiltIn, 4_096, false),
            (SettingsSource::Changed, 4_096, false),
            (SettingsSource::Changed, 4_096, false),
            (SettingsSource::Kept, 2_048, true),
            (SettingsSource::Changed, 2_048, true),
            (SettingsSource::Kept, 4_096, false),
        ]
    );
}

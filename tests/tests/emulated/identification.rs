//! Regression rows and estimates from the emulated board.

use std::path::Path;

use whirl::capture::{self, CaptureSettings};
use whirl::identify::from_rows;
use whirl::record::ReadOptions;
use whirl::rig::Rig;
use whirl_firmware::identification::ROWS_MESSAGES;
use whirl_firmware::lock_step::Order;
use whirl_hil_sim::RigSettings;
use whirl_hil_sim::emulated::{Script, board_settings, on_this_machine};
use whirl_shared::frame::{Command, Streamed};

use crate::image;

#[test]
fn rows_are_those_of_the_firmware_on_this_machine_and_identify_the_rig() {
    let ticks = 30_000;
    let script = Script::new().command(0, Command::Stream(Streamed::Rows)).drive(1, ticks, 5_000, 15_525, 5_000);
    let Some((emulation, sent)) = image::emulate(&script, ticks) else { return };
    assert_eq!(sent.samples.received, 0);
    // The ramp takes 389 ticks, then a window every thousand; all of them whole.
    let windows = (ticks - 400 - 1_040) / 1_000;
    assert_eq!(sent.rows.len(), windows as usize * ROWS_MESSAGES);
    let status = sent.statuses.last().unwrap();
    assert_eq!((status.dropped_frames, status.dropped_samples, status.samples_sent), (0, 0, 0));
    let rig = RigSettings { device: board_settings(&sent.firmware), ..RigSettings::default() };
    assert!(on_this_machine(&rig, &script, ticks).unwrap() == emulation.frames);

    let rig = Rig::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/chaotic.toml"))).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let journal = folder.path().join("rows.bytes");
    std::fs::write(&journal, [b"whirl-frames 1 {\"rows\":true}\0", &emulation.frames[..]].concat()).unwrap();
    let output = folder.path().join("rows.jsonl");
    let settings = CaptureSettings::new(format!("file:{}", journal.display()), &output);
    let outcome = capture::run(&settings, &rig, &mut |_| {}).unwrap();
    let told = outcome.rows.unwrap();
    // The first window began before the status from which on the recording counts its time.
    assert_eq!((told.windows, told.windows_lost, told.runs), (u64::from(windows) - 1, 0, 1));
    let read = from_rows::read(&[output], &ReadOptions::default()).unwrap().unwrap();
    let result = from_rows::identify(&read, &rig).unwrap();
    let b21 = result.parameter("B21").unwrap();
    assert!((b21.value - 1.681_58).abs() < 4.0 * b21.std_error && b21.std_error < 1e-3, "{b21:?}");
}

#[test]
fn a_link_that_takes_nothing_loses_rows_and_answers_that_the_device_counts() {
    let mut script = Script::new().command(0, Command::Stream(Streamed::Rows)).drive(1, 9_000, 5_000, 15_525, 5_000);
    // From the middle of a window on, over the end of the next two and more; the answers to forty
    // commands find no place.
    script = script.order(4_000, Order::BlockLink(2_500));
    for n in 0..40 {
        script = script.command(4_100 + 10 * n, Command::KeepAlive);
    }
    let Some((_, sent)) = image::emulate(&script, 9_000) else { return };
    let status = sent.statuses.last().unwrap();
    // Blocks go on into the identification: windows do not begin anew, but the rows of some are
    // gone.
    assert!(status.dropped_samples == 0 && status.dropped_frames > 20, "{status:?}");
    let last = sent.rows.iter().map(|rows| rows.window).max().unwrap();
    assert!((6..=7).contains(&last) && sent.rows.len() + 15 < last as usize * ROWS_MESSAGES, "{last}");
}

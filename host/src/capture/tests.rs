//! Captures from a scripted device whose losses are known to the sample.

#[path = "fake_device.rs"]
mod fake_device;
#[path = "hostile_device.rs"]
mod hostile_device;
#[path = "hostile_wires.rs"]
mod hostile_wires;
#[path = "interrupted_tests.rs"]
mod interrupted_tests;

use std::path::Path;
use std::sync::atomic::Ordering;

use self::fake_device::{Fake, Fault};
use super::journal::path_of;
use super::*;
use crate::record::{ReadOptions, Record, Segment};

fn rig(drive: bool) -> Rig {
    let drive =
        if drive { "[drive]\ndirection = \"vertical\"\nfrequency_hz = 5.0\namplitude_m = 0.0155\n" } else { "" };
    let text = format!(
        "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n{drive}\
         [[channel]]\nname = \"count1\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n\
         [[channel]]\nname = \"count2\"\nmeasures = \"theta2\"\nunit = \"count\"\ncounts_per_turn = 4096\n"
    );
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

struct Run {
    _dir: tempfile::TempDir,
    settings: CaptureSettings,
    rig: Rig,
}

impl Run {
    fn new(drive: bool, seconds: f64) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let mut settings = CaptureSettings::new("sim", dir.path().join("r.parquet"));
        settings.seconds = Some(seconds);
        settings.handshake_s = 0.4;
        settings.reconnect_s = 2.0;
        settings.keep_frames = true;
        Self { _dir: dir, settings, rig: rig(drive) }
    }

    fn capture(&self, fake: &mut Fake) -> Result<CaptureOutcome> {
        let mut settings = self.settings.clone();
        settings.from = "tcp:fake:1".into();
        let target = target(&settings, &self.rig).unwrap();
        live::run(&settings, &self.rig, fake, target, &mut |_| {})
    }

    fn read(&self) -> Record {
        Record::read(&self.settings.output, &self.rig, &ReadOptions::default()).unwrap()
    }

    /// The record made again from the journal is the same, byte for byte.
    fn replay_is_identical(&self) {
        let first = std::fs::read(&self.settings.output).unwrap();
        let again = self.settings.output.with_file_name("again.parquet");
        let from = format!("file:{}", path_of(&self.settings.output).display());
        run(&CaptureSettings::new(from, &again), &self.rig, &mut |_| {}).unwrap();
        assert!(first == std::fs::read(&again).unwrap());
    }
}

/// What each sample of the fake device is.
fn check_samples(record: &Record) {
    for s in &record.segments {
        for i in [0, s.len() / 2, s.len() - 1] {
            let tick = s.first_tick + i as i64;
            let crate::record::Column::Counts(c) = &s.columns[0] else { panic!() };
            assert_eq!(c[i], fake_device::count(tick), "tick {tick}");
        }
    }
}

#[test]
fn a_clean_capture_has_every_sample() {
    let run = Run::new(false, 4.0);
    let mut fake = Fake::new();
    let done = run.capture(&mut fake).unwrap();
    assert_eq!((done.losses.received, done.losses.lost(), done.complete), (2000, 0, true));
    assert!((done.duration_s - 4.0).abs() < 1e-9 && done.warnings.is_empty(), "{:?}", done.warnings);
    let r = run.read();
    assert_eq!((r.segments.len(), r.samples()), (1, 2000));
    assert_eq!(r.losses, done.losses);
    let m = r.metadata.as_ref().unwrap();
    assert_eq!((m.firmware.as_str(), m.board.as_str(), m.source.as_str()), ("fake 1.0", "memory", "tcp:fake:1"));
    assert!(m.started_at.as_ref().unwrap().ends_with('Z'));
    check_samples(&r);
    run.replay_is_identical();
    assert!(!fake.state().shaker_moved);
}

#[test]
fn the_drive_runs_during_the_record_and_stops_after_it() {
    let run = Run::new(true, 3.0);
    let mut fake = Fake::new();
    let done = run.capture(&mut fake).unwrap();
    assert_eq!((done.losses.received, done.complete), (1500, true));
    let r = run.read();
    assert!(r.segments[0].amplitude_nm.as_ref().unwrap().iter().all(|a| *a == 15_500_000));
    run.replay_is_identical();
    let state = fake.state();
    assert!(state.shaker_moved && state.at_rest(), "{state:?}");
    drop(state);
    // Also where it was left running, or with a fault.
    for before in [Fault::LeftRunning, Fault::LeftFaulted] {
        let run = Run::new(true, 1.0);
        let mut fake = Fake::with(&[(0, before)]);
        assert_eq!(run.capture(&mut fake).unwrap().losses.received, 500);
        assert!(fake.state().at_rest());
    }
}

#[test]
fn an_amplitude_beyond_the_limits_is_refused() {
    let mut run = Run::new(true, 3.0);
    run.settings.amplitude_m = Some(0.5);
    let mut fake = Fake::new();
    let e = run.capture(&mut fake).unwrap_err().to_string();
    assert!(e.contains("an amplitude of 0.5 m, expected at most 0.02 m (amplitude_limit_m"), "{e}");
    assert!(e.contains("whirl device set amplitude_limit_m=0.5"), "{e}");
    assert!(fake.state().at_rest() && !run.settings.output.exists() && !path_of(&run.settings.output).exists());
}

#[test]
fn link_faults_are_accounted_for_exactly() {
    let faults = [
        (700, Fault::DropFrame),
        (900, Fault::FlipBit),
        (1100, Fault::Repeat),
        (1300, Fault::SwapWithNext),
        (1500, Fault::Overrun(7)),
        (1700, Fault::DeviceDrops(3)),
        (1900, Fault::LoseBytes(3)),
        (2100, Fault::FlipBit),
        (2300, Fault::DropFrame),
    ];
    let run = Run::new(false, 6.0);
    let mut fake = Fake::with(&faults);
    let done = run.capture(&mut fake).unwrap();
    let l = &done.losses;
    assert_eq!((l.overruns, l.dropped_by_device, l.damaged, l.lost_on_link), (7, 30, 30, 20), "{l:?}");
    assert_eq!((l.duplicates, l.late, l.bad_frames, l.gaps, l.restarts), (10, 10, 3, 7, 0), "{l:?}");
    assert_eq!(l.received + l.lost(), 3000);
    let r = run.read();
    assert_eq!((r.segments.len(), &r.losses), (8, l));
    assert_eq!(r.segments.iter().map(Segment::len).sum::<usize>() as u64, l.received);
    check_samples(&r);
    run.replay_is_identical();
}

#[test]
fn an_unplugged_link_is_found_again() {
    let run = Run::new(true, 8.0);
    let mut fake = Fake::with(&[(1500, Fault::Unplug(600)), (3000, Fault::Silence(400))]);
    let done = run.capture(&mut fake).unwrap();
    assert!(done.reconnections >= 1 && done.complete, "{done:?}");
    let l = &done.losses;
    assert_eq!(l.received + l.lost(), 4000);
    assert!(l.lost() >= 1000 && l.lost() < 1100 && l.lost_on_link + l.damaged == l.lost(), "{l:?}");
    assert!(done.warnings.iter().any(|w| w.id == "reconnected"));
    check_samples(&run.read());
    run.replay_is_identical();
    assert!(fake.state().at_rest());
}

#[test]
fn a_device_that_keeps_all_and_gives_nothing_does_not_hold_up_the_end() {
    let run = Run::new(true, 6.0);
    // One gap in the middle, one across the end.
    let mut fake = Fake::with(&[(0, Fault::NeverRestores), (1500, Fault::Silence(300)), (3_300, Fault::Silence(200))]);
    let begun = std::time::Instant::now();
    let done = run.capture(&mut fake).unwrap();
    assert!(begun.elapsed().as_secs() < 10, "{:?}", begun.elapsed());
    let l = &done.losses;
    assert_eq!((l.received + l.lost(), l.restored), (done.last_tick.abs_diff(done.first_tick) + 1, 0));
    assert!(l.lost() >= 280 && l.gaps >= 1, "{l:?}");
    check_samples(&run.read());
    run.replay_is_identical();
    assert!(fake.state().at_rest());
}

#[test]
fn a_link_that_stays_away_leaves_a_readable_record() {
    let mut run = Run::new(false, 100.0);
    run.settings.reconnect_s = 0.3;
    let mut fake = Fake::with(&[(1500, Fault::Unplug(u32::MAX))]);
    let e = run.capture(&mut fake).unwrap_err().to_string();
    assert!(e.contains("lost for") && e.contains("--reconnect-s") && e.contains("samples until then are in"), "{e}");
    let r = run.read();
    assert!(r.samples() > 500 && r.samples() <= 1500);
    run.replay_is_identical();
}

#[test]
fn a_restarted_device_begins_a_segment() {
    let run = Run::new(true, 6.0);
    let mut fake = Fake::with(&[(1800, Fault::Restart)]);
    let done = run.capture(&mut fake).unwrap();
    assert_eq!(done.losses.restarts, 1);
    assert!(done.warnings.iter().any(|w| w.id == "device-restarted"), "{:?}", done.warnings);
    assert_eq!(done.losses.received + done.losses.lost(), 3000);
    let record = run.read();
    let boots: Vec<u32> = record.segments.iter().map(|s| s.boot).collect();
    assert!(boots.is_sorted() && (boots[0], boots[boots.len() - 1]) == (0, 1), "{boots:?}");
    run.replay_is_identical();
    assert!(fake.state().at_rest());
}

#[test]
fn ticks_that_go_back_under_the_same_boot_id_begin_a_segment_and_are_told() {
    let run = Run::new(false, 8.0);
    let done = run.capture(&mut Fake::with(&[(2500, Fault::TicksGoBack)])).unwrap();
    let told = done.warnings.iter().find(|w| w.id == "device-restarted").unwrap_or_else(|| panic!("{done:?}"));
    assert!(told.text.contains("under the same boot id") && told.details["zeros_kept"] == false, "{told:?}");
    assert_eq!((done.losses.restarts, done.losses.received + done.losses.lost()), (1, 4000), "{:?}", done.losses);
    let boots: Vec<u32> = run.read().segments.iter().map(|s| s.boot).collect();
    assert_eq!(boots, [0, 1]);
    let device = run.read().metadata.unwrap().device;
    assert!(!device[1].has_zeros_of(&device[0], 2) && device[1].boot_id == device[0].boot_id, "{device:?}");
    run.replay_is_identical();
}

#[test]
fn a_shaker_that_has_stopped_by_itself_stays_off_unless_it_is_to_be_started_again() {
    for (restart_drive, then) in [(false, "it stays off"), (true, "it is started again")] {
        let mut run = Run::new(true, 8.0);
        run.settings.restart_drive = restart_drive;
        let mut fake = Fake::with(&[(1800, Fault::Restart)]);
        let done = run.capture(&mut fake).unwrap();
        let told = done.warnings.iter().find(|w| w.id == "drive-stopped").unwrap();
        assert!(told.text.contains(then) && told.text.contains("has restarted"), "{told:?}");
        // At the end of the record it moves again, or it does not.
        let record = run.read();
        let amplitude = record.segments.last().unwrap().amplitude_nm.as_ref().unwrap();
        assert_eq!(*amplitude.last().unwrap() > 0, restart_drive);
        assert!(fake.state().at_rest());
    }
}

#[test]
fn a_link_lost_while_the_shaker_starts_does_not_start_it_later() {
    let run = Run::new(true, 8.0);
    // The ramp takes until tick 350.
    let mut fake = Fake::with(&[(200, Fault::Unplug(300))]);
    let e = run.capture(&mut fake).unwrap_err().to_string();
    assert!(e.contains("while the shaker was being started") && e.contains("--restart-drive"), "{e}");
    assert!(fake.state().at_rest());
}

#[test]
fn a_drive_without_amplitude_is_left_alone_with_a_warning() {
    let mut run = Run::new(true, 2.0);
    run.rig.drive.as_mut().unwrap().amplitude_m = None;
    run.settings.from = "tcp:fake:1".into();
    let mut fake = Fake::new();
    let done = run_from(&run.settings, &run.rig, &mut fake, &mut |_| {}).unwrap();
    assert!(done.warnings.iter().any(|w| w.id == "drive-left-alone"), "{:?}", done.warnings);
    assert!(!fake.state().shaker_moved);
    run.settings.drive = false;
    run.settings.output = run.settings.output.with_file_name("quiet.parquet");
    let done = run_from(&run.settings, &run.rig, &mut Fake::new(), &mut |_| {}).unwrap();
    assert!(done.warnings.is_empty(), "{:?}", done.warnings);
}

#[test]
fn wires_without_a_device_are_told_apart() {
    for (fault, parts) in [
        (Fault::Noise, &["noise", "bytes", "damaged frames", "baud rate"][..]),
        (Fault::Mute, &["no byte", "power"]),
        (Fault::WrongSchema, &["schema 12345678", "whirl flash"]),
        (Fault::WrongProtocol, &["protocol 99"]),
        (Fault::Foreign, &["another protocol version"]),
        (Fault::Deaf, &["no hello", "does not hear"]),
        (Fault::OtherEncoder, &["counts_per_turn = 4096", "1024 as the device says of encoder 2"]),
        (Fault::OtherRate, &["sample_rate_hz = 500", "1000 as the device says"]),
    ] {
        let run = Run::new(true, 2.0);
        let mut fake = Fake::with(&[(0, fault)]);
        let e = run.capture(&mut fake).unwrap_err().to_string();
        for part in parts {
            assert!(e.contains(part), "{fault:?}: {part:?} is not in: {e}");
        }
        assert!(!run.settings.output.exists() && !path_of(&run.settings.output).exists(), "{fault:?}");
    }
}

#[test]
fn a_capture_that_ends_while_the_rig_settles_says_so() {
    let mut run = Run::new(true, 5.0);
    run.settings.settle_s = Some(1e6);
    let stop = run.settings.stop.clone();
    let settings = CaptureSettings { from: "tcp:fake:1".into(), ..run.settings.clone() };
    let target = target(&settings, &run.rig).unwrap();
    let mut fake = Fake::new();
    let done = live::run(&settings, &run.rig, &mut fake, target, &mut |p| {
        stop.store(p.state == "settling", Ordering::Relaxed);
    });
    let e = done.unwrap_err().to_string();
    assert!(e.contains("left to settle (1000000 s before the first sample): no record is written"), "{e}");
    assert!(!run.settings.output.exists() && !path_of(&run.settings.output).exists());
}

#[test]
fn the_stop_flag_ends_in_order() {
    let mut run = Run::new(true, 1e6);
    run.settings.seconds = None;
    let mut fake = Fake::new();
    let stop = run.settings.stop.clone();
    let settings = CaptureSettings { from: "tcp:fake:1".into(), ..run.settings.clone() };
    let target = target(&settings, &run.rig).unwrap();
    let mut calls = 0;
    let done = live::run(&settings, &run.rig, &mut fake, target, &mut |p| {
        calls += usize::from(p.samples > 0);
        stop.store(calls > 1, Ordering::Relaxed);
    });
    let done = done.unwrap();
    assert!(done.losses.received > 0 && done.losses.lost() == 0 && done.complete);
    assert!(fake.state().at_rest());
    run.replay_is_identical();
}

#[test]
fn raw_bytes_and_damaged_journals_are_read_as_far_as_they_go() {
    let run = Run::new(false, 2.0);
    run.capture(&mut Fake::new()).unwrap();
    let frames = path_of(&run.settings.output);
    let bytes = std::fs::read(&frames).unwrap();
    let at = bytes.iter().position(|&b| b == 0).unwrap() + 1;
    let raw = run.settings.output.with_file_name("raw.frames");
    std::fs::write(&raw, &bytes[at..]).unwrap();
    let again = run.settings.output.with_file_name("again.parquet");
    let from = |path: &Path| CaptureSettings::new(format!("file:{}", path.display()), &again);
    let done = super::run(&from(&raw), &run.rig, &mut |_| {}).unwrap();
    assert!(done.losses.received >= 1000 && done.losses.lost() == 0);
    // Cut short: a crash.
    std::fs::write(&raw, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let done = super::run(&from(&raw), &run.rig, &mut |_| {}).unwrap();
    assert!(!done.complete && done.losses.received > 500 && done.warnings.iter().any(|w| w.id == "short"));
    for nothing in [&b""[..], b"\0\0\0", b"hello\0"] {
        std::fs::write(&raw, nothing).unwrap();
        assert!(super::run(&from(&raw), &run.rig, &mut |_| {}).is_err());
    }
    assert!(super::run(&from(&again), &run.rig, &mut |_| {}).unwrap_err().to_string().contains("two files"));
}

#[test]
fn settings_are_checked() {
    let mut s = CaptureSettings::new("tcp:x:1", "x.parquet");
    assert!(s.validate().is_ok());
    s.seconds = Some(0.0);
    assert!(s.validate().unwrap_err().to_string().contains("--seconds"));
    s.seconds = None;
    s.reconnect_s = f64::NAN;
    assert!(s.validate().unwrap_err().to_string().contains("--reconnect-s"));
    s.reconnect_s = 1.0;
    s.amplitude_m = Some(-1.0);
    assert!(s.validate().unwrap_err().to_string().contains("--amplitude-m"));
    s.amplitude_m = Some(0.01);
    assert!(target(&s, &rig(false)).unwrap_err().to_string().contains("[drive]"));
    assert_eq!(target(&s, &rig(true)).unwrap().unwrap().amplitude_micrometre(), 10_000);
}

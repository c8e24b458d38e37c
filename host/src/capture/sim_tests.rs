//! Captures of the simulated rig: at its own pace, and through lines of the system.

#[path = "back_fill_tests.rs"]
mod back_fill_tests;
#[path = "excite_sim_tests.rs"]
mod excite_tests;
#[path = "faulty_link_tests.rs"]
mod faulty_link_tests;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use whirl_hil_sim::transport::pty::PseudoTerminal;
use whirl_hil_sim::transport::server::{Pace, Server};
use whirl_hil_sim::transport::tcp::TcpServer;
use whirl_hil_sim::{FaultReport, FaultSettings, FaultyLink, VirtualRig};

use super::sim::Simulated;
use super::source::{Link, Source};
use super::*;
use crate::record::{ReadOptions, Record};

fn rig(name: &str, settle: &str) -> Rig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(name);
    let text = std::fs::read_to_string(&path).unwrap().replace("settle_s = 20.0", settle);
    Rig::parse(&text, &path).unwrap()
}

/// A simulated rig behind a link of the test's own, which every connection goes through.
struct Behind<F> {
    inner: Simulated,
    wrap: F,
}

impl<F: FnMut(Box<dyn Link>) -> Box<dyn Link> + Send> Source for Behind<F> {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        self.inner.open().map(&mut self.wrap)
    }
    fn now(&self) -> Instant {
        self.inner.now()
    }
    fn pause(&mut self, time: Duration) {
        self.inner.pause(time);
    }
    fn is_simulated(&self) -> bool {
        true
    }
    fn remedy(&self) -> String {
        String::new()
    }
}

#[test]
fn a_simulated_capture_repeats_to_the_byte() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 1.0");
    let capture = |name: &str| {
        let mut settings = CaptureSettings::new("sim", dir.path().join(name));
        settings.seconds = Some(3.0);
        settings.keep_frames = true;
        (run(&settings, &rig, &mut |_| {}).unwrap(), std::fs::read(&settings.output).unwrap())
    };
    let (done, first) = capture("a.parquet");
    assert_eq!((done.losses.received, done.losses.lost(), done.complete), (1500, 0, true), "{done:?}");
    assert!(done.warnings.is_empty() && done.firmware.starts_with("whirl"), "{done:?}");
    assert!(done.estimates.is_none() && done.rows.is_none(), "{done:?}");
    std::thread::sleep(Duration::from_millis(30));
    assert!(first == capture("b.parquet").1);
    let r = Record::read(&done.record, &rig, &ReadOptions::default()).unwrap();
    let s = &r.segments[0];
    assert!(s.amplitude_nm.as_ref().unwrap().iter().all(|a| *a == 15_525_000));
    let phase = s.phase.as_ref().unwrap();
    assert!(phase.windows(2).all(|w| w[1].wrapping_sub(w[0]).abs_diff(42_949_673) <= 1));
    // Ramp at 20 mm/s, then one second of settling.
    assert!(s.start_s > 1.7 && s.start_s < 3.0, "{}", s.start_s);
    let frames = path_of("a.parquet", &dir);
    let again = dir.path().join("again.parquet");
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(first == std::fs::read(again).unwrap());
}

#[test]
fn the_device_s_own_estimates_stand_beside_the_record() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 10.0");
    let mut settings = CaptureSettings::new("sim:4", dir.path().join("r.parquet"));
    settings.seconds = Some(30.0);
    settings.keep_frames = true;
    let mut shown = String::new();
    let done = run(&settings, &rig, &mut |p| shown = p.estimate.clone().unwrap_or(shown.clone())).unwrap();
    let path = done.estimates.clone().unwrap();
    assert_eq!(path, estimates::path_of(&settings.output));
    let text = std::fs::read_to_string(&path).unwrap();
    let all: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    // Every twenty periods, which are 4 s; the drive has run for longer than the record, so that
    // numbers are there at once.
    assert!((6..=7).contains(&all.len()), "{text}");
    for (a, b) in all.iter().zip(&all[1..]) {
        assert_eq!(b["tick"].as_i64().unwrap() - a["tick"].as_i64().unwrap(), 2_000);
    }
    let last = done.estimate.clone().unwrap();
    assert_eq!((last.status, last.parameters.len(), last.amplitude_m), (estimates::Status::Known, 11, 0.015_525));
    let line = text.lines().last().unwrap();
    let (object, _) = line.rsplit_once(",\"crc32\"").unwrap();
    assert_eq!(serde_json::to_string(&last).unwrap(), format!("{object}}}"));
    assert!(last.tick <= done.last_tick && all[0]["tick"].as_i64().unwrap() >= done.first_tick + 1_999);
    let b21 = last.parameters.iter().find(|p| p.name == "B21").unwrap();
    assert!((b21.value - 1.681_58).abs() < 4.0 * b21.std_error && b21.std_error < 0.005, "{b21:?}");
    // The journal gives the same once more.
    let again = dir.path().join("again.parquet");
    let frames = path_of("r.parquet", &dir);
    let made = run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert_eq!(std::fs::read_to_string(made.estimates.unwrap()).unwrap(), text);
    // A record that replaces it takes them away.
    settings.seconds = Some(2.0);
    settings.keep_frames = false;
    std::fs::remove_file(frames).unwrap();
    assert!(run(&settings, &rig, &mut |_| {}).unwrap().estimates.is_none() && !path.exists());
}

#[test]
fn rows_alone_identify_the_rig() {
    use crate::identify::{Settings, from_rows, identify};
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 10.0");
    let capture = |name: &str, rows: bool| {
        let mut settings = CaptureSettings::new("sim:4", dir.path().join(name));
        settings.seconds = Some(120.0);
        settings.rows = rows;
        settings.keep_frames = true;
        run(&settings, &rig, &mut |_| {}).unwrap()
    };
    let (samples, rows) = (capture("samples.parquet", false), capture("rows.jsonl", true));
    let told = rows.rows.unwrap();
    assert!((57..=59).contains(&told.windows) && (told.windows_lost, told.runs) == (0, 1), "{rows:?}");
    assert!(
        rows.complete && rows.losses.lost() == 0 && rows.estimate.is_some() && rows.warnings.is_empty(),
        "{rows:?}"
    );
    // A third of the bytes, the commands' answers and statuses among them.
    assert!(3 * rows.bytes < 2 * samples.bytes, "{} {}", rows.bytes, samples.bytes);
    let record = Record::read(&samples.record, &rig, &ReadOptions::default()).unwrap();
    let from_samples = identify(&[record], &rig, &Settings::default()).unwrap();
    let read = from_rows::read(std::slice::from_ref(&rows.record), &ReadOptions::default()).unwrap().unwrap();
    let from_rows = from_rows::identify(&read, &rig).unwrap();
    let names = |i: &crate::identify::Identification| i.parameters.iter().map(|p| p.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&from_rows), names(&from_samples));
    assert!(from_rows.within_bound() && from_rows.warnings.is_empty(), "{:?}", from_rows.warnings);
    for (a, b) in from_rows.parameters.iter().zip(&from_samples.parameters) {
        println!("{} {:.6} ± {:.6}, from samples {:.6} ± {:.6}", a.name, a.value, a.std_error, b.value, b.std_error);
        // The windows begin elsewhere.
        assert!((a.value - b.value).abs() < 3.0 * a.std_error.hypot(b.std_error), "{a:?} {b:?}");
    }
    // The journal gives the same once more, and nothing else reads rows.
    let again = dir.path().join("again.jsonl");
    let frames = path_of("rows.jsonl", &dir);
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&rows.record).unwrap() == std::fs::read(again).unwrap());
    let e = Record::read(&rows.record, &rig, &ReadOptions::default()).unwrap_err().to_string();
    assert!(e.contains("regression rows") && e.contains("identify"), "{e}");
}

#[test]
fn rows_are_refused_for_what_the_device_does_not_identify() {
    let dir = tempfile::tempdir().unwrap();
    let mut rig = rig("chaotic.toml", "settle_s = 0.0");
    rig.nominal = Some(vec!["viscous-friction@joint2".to_owned()]);
    let mut settings = CaptureSettings::new("sim", dir.path().join("rows.jsonl"));
    settings.rows = true;
    let e = run(&settings, &rig, &mut |_| {}).unwrap_err().to_string();
    assert!(e.contains("nominal.effects") && e.contains("--rows"), "{e}");
}

fn path_of(name: &str, dir: &tempfile::TempDir) -> PathBuf {
    journal::path_of(&dir.path().join(name))
}

#[test]
fn a_rig_without_plant_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("measured-double-pendulum.toml", "");
    let e = run(&CaptureSettings::new("sim", dir.path().join("r.parquet")), &rig, &mut |_| {}).unwrap_err().to_string();
    assert!(e.contains("[plant]"), "{e}");
}

/// Captures 80 s through a line of the system while its plug is pulled twice and the sampler misses
/// ticks.
fn unplugged_capture(from: &str, server: Server, dir: &tempfile::TempDir, rig: &Rig) {
    let mut settings = CaptureSettings::new(from, dir.path().join("r.parquet"));
    settings.seconds = Some(80.0);
    settings.reconnect_s = 20.0;
    settings.keep_frames = true;
    // By the wall's clock the shaker may still be starting: the device's is faster.
    settings.restart_drive = true;
    settings.amplitude_m = Some(0.015_525);
    let done = std::thread::scope(|scope| {
        scope.spawn(|| {
            // When the recording has come so far, by its journal.
            let journal = journal::path_of(&settings.output);
            for at in [30_000, 70_000] {
                while std::fs::metadata(&journal).map_or(0, |m| m.len()) < at {
                    std::thread::sleep(Duration::from_millis(1));
                }
                server.unplug_for(700);
                server.with_rig(|rig| {
                    rig.miss_ticks(13);
                    Ok(())
                });
            }
        });
        run(&settings, rig, &mut |_| {}).unwrap()
    });
    let l = &done.losses;
    assert!(done.complete && done.reconnections >= 2, "{done:?}");
    assert_eq!(l.received + l.lost(), 40_000);
    // A rig at the client's pace is ahead of it by what the line holds: an answer may come too
    // late.
    assert!(l.lost_on_link + l.damaged + l.restored >= 1400 && l.overruns == 26 && l.restarts == 0, "{l:?}");
    let r = Record::read(&done.record, rig, &ReadOptions::default()).unwrap();
    assert_eq!((&r.losses, r.segments.len() as u64), (l, l.gaps + 1));
    assert!(!whirl_moves(server));
    let again = dir.path().join("again.parquet");
    let frames = journal::path_of(&settings.output);
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(again).unwrap());
}

/// Whether the shaker still moves.
fn whirl_moves(server: Server) -> bool {
    let (tell, told) = std::sync::mpsc::channel();
    server.with_rig(move |rig| {
        tell.send(rig.status().amplitude_nanometre).unwrap();
        Ok(())
    });
    let amplitude = told.recv_timeout(Duration::from_secs(5)).unwrap();
    server.stop().unwrap();
    amplitude > 0
}

fn served(rig: &Rig) -> VirtualRig {
    let mut settings = Simulated::settings(rig, &[], Some(3), None).unwrap();
    settings.device.host_timeout_ms = 60_000;
    VirtualRig::new(&settings).unwrap()
}

#[test]
fn a_pseudo_terminal_is_unplugged_and_replugged() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 0.0");
    let link = dir.path().join("ttyRIG");
    let server = Server::start(served(&rig), PseudoTerminal::new(&link).unwrap(), None, Pace::Client).unwrap();
    unplugged_capture(&format!("serial:{}", link.display()), server, &dir, &rig);
}

#[test]
fn a_tcp_line_is_cut_and_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 0.0");
    let line = TcpServer::bind("127.0.0.1:0").unwrap();
    let address = line.address().unwrap();
    let server = Server::start(served(&rig), line, None, Pace::Client).unwrap();
    unplugged_capture(&format!("tcp:{address}"), server, &dir, &rig);
}

#[test]
fn ports_that_are_not_there_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 0.0");
    for (from, part) in
        [("serial:/dev/ttyNONE", "dialout"), ("tcp:127.0.0.1:1", "listens"), ("file:/none.frames", "bytes")]
    {
        let e = run(&CaptureSettings::new(from, dir.path().join("r.parquet")), &rig, &mut |_| {}).unwrap_err();
        assert!(e.to_string().contains(part), "{from}: {e}");
    }
    assert!(std::fs::read_dir(dir.path()).unwrap().next().is_none());
}

//! Captures of the simulated rig, with and without a faulty link between.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use whirl_hil_sim::{FaultReport, FaultSettings, FaultyLink};

use super::sim::Simulated;
use super::source::{Link, Source};
use super::*;
use crate::record::{ReadOptions, Record};

fn rig(name: &str, settle: &str) -> Rig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(name);
    let text = std::fs::read_to_string(&path).unwrap().replace("settle_s = 20.0", settle);
    Rig::parse(&text, &path).unwrap()
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

fn path_of(name: &str, dir: &tempfile::TempDir) -> PathBuf {
    journal::path_of(&dir.path().join(name))
}

/// A rig behind a link with faults in both directions; what the link did is known to the sample.
struct Faulty {
    inner: Simulated,
    shared: Arc<Mutex<Faults>>,
}

struct Faults {
    down: FaultyLink,
    up: rand_chacha::ChaCha8Rng,
    up_rate: f64,
}

struct FaultyPipe {
    inner: Box<dyn Link>,
    shared: Arc<Mutex<Faults>>,
    rest: Vec<u8>,
}

impl Source for Faulty {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        Ok(Box::new(FaultyPipe { inner: self.inner.open()?, shared: self.shared.clone(), rest: vec![] }))
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

impl Link for FaultyPipe {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.rest.is_empty() {
            let n = self.inner.read(buffer)?;
            self.rest = self.shared.lock().unwrap().down.push(&buffer[..n]);
            if self.rest.is_empty() {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        let n = self.rest.len().min(buffer.len());
        buffer[..n].copy_from_slice(&self.rest[..n]);
        self.rest.drain(..n);
        Ok(n)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut out = Vec::new();
        {
            let f = &mut *self.shared.lock().unwrap();
            let chance = |rng: &mut rand_chacha::ChaCha8Rng| f64::from(rng.next_u32()) < f.up_rate * 4_294_967_296.0;
            for &b in bytes {
                if chance(&mut f.up) {
                    match f.up.next_u32() % 3 {
                        0 => {}
                        1 => out.push(b ^ 1),
                        _ => out.extend([b, b]),
                    }
                } else {
                    out.push(b);
                }
            }
        }
        self.inner.write_all(&out)
    }
}

/// Captures through faults and holds the account against the link's own.
fn faulty_capture(seconds: f64, faults: FaultSettings, seed: u64) -> (CaptureOutcome, FaultReport) {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 0.0");
    let shared = Arc::new(Mutex::new(Faults {
        down: FaultyLink::new(faults, seed),
        up: rand_chacha::ChaCha8Rng::seed_from_u64(seed),
        up_rate: 0.01,
    }));
    let mut source = Faulty { inner: Simulated::new(&rig, &[], Some(seed), None).unwrap(), shared: shared.clone() };
    let mut settings = CaptureSettings::new("sim", dir.path().join("r.parquet"));
    settings.seconds = Some(seconds);
    settings.keep_frames = true;
    let done = run_from(&settings, &rig, &mut source, &mut |_| {}).unwrap();
    let report = {
        let mut shared = shared.lock().unwrap();
        shared.down.finish();
        shared.down.report().clone()
    };
    let l = &done.losses;
    assert_eq!(l.received + l.lost(), done.last_tick.abs_diff(done.first_tick) + 1);
    // The missing ticks are those that the link took, one by one.
    let r = Record::read(&done.record, &rig, &ReadOptions::default()).unwrap();
    assert_eq!((r.samples() as u64, &r.losses), (l.received, l));
    let mut missing = Vec::new();
    for w in r.segments.windows(2) {
        missing.extend(w[0].first_tick + w[0].len() as i64..w[1].first_tick);
    }
    let mut taken: Vec<i64> = report
        .lost
        .iter()
        .flat_map(|lost| (0..lost.count).map(move |i| i64::from(lost.first_tick) + i64::from(i)))
        .filter(|t| (done.first_tick..=done.last_tick).contains(t))
        .collect();
    taken.sort_unstable();
    assert_eq!(missing, taken);
    assert_eq!(l.restarts + l.overruns + l.dropped_by_device, 0);
    // The record made again from the journal is the same.
    let again = dir.path().join("again.parquet");
    let frames = journal::path_of(&settings.output);
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(again).unwrap());
    (done, report)
}

#[test]
fn every_sample_behind_a_faulty_link_is_accounted_for() {
    for seed in 1..4 {
        let (done, report) = faulty_capture(20.0, FaultSettings { unplug: 1e-3, ..FaultSettings::EVERYTHING }, seed);
        assert!(done.losses.lost() > 50 && report.samples.damaged > 0, "{:?}", done.losses);
    }
}

#[test]
fn a_rig_without_plant_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("measured-double-pendulum.toml", "");
    let e = run(&CaptureSettings::new("sim", dir.path().join("r.parquet")), &rig, &mut |_| {}).unwrap_err().to_string();
    assert!(e.contains("[plant]"), "{e}");
}

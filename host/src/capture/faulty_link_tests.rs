//! Links with faults in both directions: each sample is in the record or counted.

use super::*;

/// What happens in both directions; what the link did is known to the sample.
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

/// A simulated rig behind such a link.
fn faulty(rig: &Rig, seed: u64, shared: Arc<Mutex<Faults>>) -> impl Source {
    let wrap = move |inner| {
        // A capture ends the frame that was cut.
        shared.lock().unwrap().down.reopened();
        Box::new(FaultyPipe { inner, shared: shared.clone(), rest: vec![] }) as Box<dyn Link>
    };
    Behind { inner: Simulated::new(rig, &[], Some(seed), None).unwrap(), wrap }
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
    let mut source = faulty(&rig, seed, shared.clone());
    let mut settings = CaptureSettings::new("sim", dir.path().join("r.parquet"));
    settings.seconds = Some(seconds);
    settings.keep_frames = true;
    // The link is unplugged while the shaker starts, too.
    settings.restart_drive = true;
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
    // Neither as it was streamed nor as it was sent again.
    let taken: Vec<i64> = report
        .missing()
        .into_iter()
        .map(i64::from)
        .filter(|t| (done.first_tick..=done.last_tick).contains(t))
        .collect();
    assert!(missing == taken, "{} and {} ticks of {done:?}", missing.len(), taken.len());
    assert_eq!(l.restarts + l.overruns + l.dropped_by_device, 0);
    // The record made again from the journal is the same.
    let again = dir.path().join("again.parquet");
    let frames = journal::path_of(&settings.output);
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(again).unwrap());
    (done, report)
}

#[test]
fn rows_through_a_faulty_link_are_whole_or_counted() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 0.0");
    let shared = Arc::new(Mutex::new(Faults {
        down: FaultyLink::new(FaultSettings { unplug: 0.0, ..FaultSettings::EVERYTHING }, 5),
        up: rand_chacha::ChaCha8Rng::seed_from_u64(5),
        up_rate: 0.01,
    }));
    let mut source = faulty(&rig, 5, shared);
    let mut settings = CaptureSettings::new("sim", dir.path().join("rows.jsonl"));
    settings.seconds = Some(120.0);
    settings.rows = true;
    let done = run_from(&settings, &rig, &mut source, &mut |_| {}).unwrap();
    let told = done.rows.unwrap();
    assert!(told.windows > 10 && told.windows_lost > 5 && told.windows + told.windows_lost <= 60, "{told:?}");
    assert!(done.warnings.iter().any(|w| w.id == "windows-lost"), "{:?}", done.warnings);
}

#[test]
fn each_sample_of_ten_minutes_with_every_fault_is_accounted_for() {
    let (done, report) = faulty_capture(600.0, FaultSettings { unplug: 1e-3, ..FaultSettings::EVERYTHING }, 9);
    let l = &done.losses;
    // The last samples may be among the missing.
    assert!((298_000..=300_000).contains(&(l.received + l.lost())), "{l:?}");
    assert!(l.restored > 5500 && l.lost() < 100 && l.duplicates > 200 && l.late > 200, "{l:?}");
    assert!(done.reconnections > 2 && report.unplugged > 10, "{done:?}");
}

#[test]
fn every_sample_behind_a_faulty_link_is_accounted_for() {
    for seed in 1..3 {
        let (done, report) = faulty_capture(20.0, FaultSettings { unplug: 1e-3, ..FaultSettings::EVERYTHING }, seed);
        assert!(done.losses.restored > 50 && report.samples.damaged > 0, "{:?}", done.losses);
    }
}

//! A capture of the simulated rig through a link with every kind of fault, held against the link's
//! own account, tick by tick. Time is the rig's own.

use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl::capture::sim::Simulated;
use whirl::capture::source::{Link, Source};
use whirl::capture::{CaptureOutcome, CaptureSettings, run_from};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl_hil_sim::{FaultReport, FaultSettings, FaultyLink};

/// Both directions of the faulty link.
struct Faults {
    /// From the device, with an exact account.
    down: FaultyLink,
    /// To the device: bytes dropped, flipped, doubled.
    up: ChaCha8Rng,
    up_rate: f64,
}

struct FaultySource {
    inner: Simulated,
    faults: Arc<Mutex<Faults>>,
}

struct FaultyPort {
    inner: Box<dyn Link>,
    faults: Arc<Mutex<Faults>>,
    rest: Vec<u8>,
}

fn lock(faults: &Mutex<Faults>) -> MutexGuard<'_, Faults> {
    faults.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Source for FaultySource {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        let inner = self.inner.open()?;
        // A capture ends the frame that was cut.
        lock(&self.faults).down.reopened();
        Ok(Box::new(FaultyPort { inner, faults: self.faults.clone(), rest: Vec::new() }))
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

impl Link for FaultyPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.is_empty() {
            let n = self.inner.read(buffer)?;
            self.rest = lock(&self.faults).down.push(&buffer[..n]);
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
        let mut out = Vec::with_capacity(bytes.len() + 1);
        {
            let faults = &mut *lock(&self.faults);
            for &byte in bytes {
                if f64::from(faults.up.next_u32()) < faults.up_rate * 4_294_967_296.0 {
                    match faults.up.next_u32() % 3 {
                        0 => {}
                        1 => out.push(byte ^ 1),
                        _ => out.extend([byte, byte]),
                    }
                } else {
                    out.push(byte);
                }
            }
        }
        self.inner.write_all(&out)
    }
}

/// What a capture through faults gave, and what the link says that it did.
#[derive(Debug)]
pub struct Account {
    /// The capture's own account.
    pub outcome: CaptureOutcome,
    /// The fault injector's.
    pub injected: FaultReport,
    /// Ticks between the first and the last sample, both included.
    pub ticks: u64,
    /// Missing ticks of the record that the link did not take, and ticks that it took and the
    /// record has nevertheless.
    pub disagreements: usize,
}

/// Captures `seconds` through every kind of fault, in both directions, and compares the two
/// accounts.
///
/// # Panics
/// If the capture fails, or its record cannot be read.
pub fn capture(rig: &Rig, seconds: f64, seed: u64) -> Account {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let faults = Arc::new(Mutex::new(Faults {
        down: FaultyLink::new(FaultSettings::EVERYTHING, seed),
        up: ChaCha8Rng::seed_from_u64(seed),
        up_rate: 0.01,
    }));
    let inner = Simulated::new(rig, &[], Some(seed), None).expect("a simulated rig");
    let mut source = FaultySource { inner, faults: faults.clone() };
    let settings = CaptureSettings {
        seconds: Some(seconds),
        // The link is unplugged while the shaker starts, too.
        restart_drive: true,
        ..CaptureSettings::new("sim", folder.path().join("record.parquet"))
    };
    let outcome = run_from(&settings, rig, &mut source, &mut |_| {}).expect("a capture");
    let injected = {
        let mut faults = lock(&faults);
        faults.down.finish();
        faults.down.report().clone()
    };
    let record = Record::read(&outcome.record, rig, &ReadOptions::default()).expect("a record");
    let mut missing: Vec<i64> = Vec::new();
    for pair in record.segments.windows(2) {
        missing.extend(pair[0].first_tick + pair[0].len() as i64..pair[1].first_tick);
    }
    // Neither as it was streamed nor as it was sent again.
    let taken: Vec<i64> = injected
        .missing()
        .into_iter()
        .map(i64::from)
        .filter(|tick| (outcome.first_tick..=outcome.last_tick).contains(tick))
        .collect();
    let disagreements = missing.iter().filter(|t| taken.binary_search(t).is_err()).count()
        + taken.iter().filter(|t| missing.binary_search(t).is_err()).count();
    let ticks = outcome.last_tick.abs_diff(outcome.first_tick) + 1;
    Account { outcome, injected, ticks, disagreements }
}

//! What a capture shows of itself while it runs: a bounded copy, handed over where nobody has to
//! wait for it.
//!
//! ```text
//! session ─ offer ─▶ batch ── try_lock ──▶ Feed ── take ──▶ view (a thread of its own)
//! ```
//!
//! The session keeps what is new in a batch and hands it over when the feed is free at that moment;
//! where it is not, the batch waits. Nobody who takes, slowly or never, holds the recording up:
//! batch and feed hold the newest `MOST_SAMPLES`, older ones go unseen.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use whirl_shared::block::{Counts, samples};
use whirl_shared::frame::{DeviceMessage, Hello, SampleBlock, Status};

use super::Progress;
use super::estimates::DeviceEstimate;
use super::precision::Precision;
use crate::record::Losses;

/// Samples that wait to be seen: 16 s at 500 Hz.
const MOST_SAMPLES: usize = 8_192;
/// Lines that wait to be seen.
const MOST_LINES: usize = 64;

/// A sample as the device sent it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeenSample {
    /// The device's tick, wrapping.
    pub tick: u32,
    /// Counts of the device's channels, the encoders first.
    pub counts: Counts,
    /// Phase of the drive, turns · 2⁻³².
    pub phase: u32,
    /// Its advance in a tick; 0 where the shaker rests.
    pub phase_increment: u32,
    /// Commanded amplitude, nm.
    pub amplitude_nm: u32,
}

/// How a capture stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// State, samples, time.
    pub progress: Progress,
    /// Where samples have gone.
    pub losses: Losses,
    /// Times that the link was lost and found again.
    pub reconnections: u64,
    /// Samples go into the record.
    pub recording: bool,
    /// Amplitude (m) and frequency (Hz) asked of the shaker; none where it is left alone.
    pub asked: Option<(f64, f64)>,
    /// The device's newest estimate.
    pub estimate: Option<DeviceEstimate>,
    /// Of the parameter on which the end depends.
    pub precision: Option<Precision>,
    /// The device is simulated: its time need not be ours.
    pub simulated: bool,
}

/// What was seen since the last look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Samples, oldest first.
    pub samples: Vec<SeenSample>,
    /// What the device told of itself.
    pub hello: Option<Hello>,
    /// Its newest counters.
    pub status: Option<Status>,
    /// How the capture stands.
    pub standing: Option<Standing>,
    /// Lines to be told.
    pub lines: Vec<String>,
}

impl Seen {
    /// Takes what is newer.
    fn add(&mut self, newer: &mut Self) {
        self.samples.append(&mut newer.samples);
        self.lines.append(&mut newer.lines);
        self.hello = newer.hello.take().or(self.hello.take());
        self.status = newer.status.take().or(self.status.take());
        self.standing = newer.standing.take().or(self.standing.take());
        self.bound();
    }

    fn bound(&mut self) {
        self.samples.drain(..self.samples.len().saturating_sub(MOST_SAMPLES));
        self.lines.drain(..self.lines.len().saturating_sub(MOST_LINES));
    }

    fn block(&mut self, block: &SampleBlock) {
        self.samples.extend(samples(block).map(|sample| SeenSample {
            tick: sample.tick,
            counts: sample.counts,
            phase: sample.phase,
            phase_increment: block.phase_increment,
            amplitude_nm: block.amplitude_nanometre,
        }));
    }
}

/// Where a capture leaves what is to be seen.
#[derive(Debug, Default)]
pub struct Feed {
    seen: Mutex<Seen>,
    /// A simulated rig is not held to our time.
    hurry: AtomicBool,
}

impl Feed {
    /// What is new since the last call.
    pub fn take(&self) -> Seen {
        core::mem::take(&mut *self.seen.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Lets a simulated rig run as fast as it can, or in real time again; answers which.
    pub fn change_pace(&self) -> bool {
        !self.hurry.fetch_xor(true, Ordering::Relaxed)
    }

    /// Hands a batch over, if nobody looks just now.
    fn offer(&self, batch: &mut Seen) {
        let mut seen = match self.seen.try_lock() {
            Ok(seen) => seen,
            Err(TryLockError::Poisoned(seen)) => seen.into_inner(),
            Err(TryLockError::WouldBlock) => return,
        };
        seen.add(batch);
    }
}

/// The session's end of a feed.
#[derive(Debug)]
pub(super) struct Feeder {
    feed: std::sync::Arc<Feed>,
    batch: Seen,
    offered: Instant,
    /// A moment of ours, and the simulated rig's time then.
    pace: Option<(Instant, Instant)>,
}

/// Time between two batches.
const BETWEEN: Duration = Duration::from_millis(40);
/// How far behind our time a simulated rig may fall before its time is taken anew.
const BEHIND: Duration = Duration::from_millis(500);

impl Feeder {
    pub(super) fn new(feed: std::sync::Arc<Feed>) -> Self {
        Self { feed, batch: Seen::default(), offered: Instant::now(), pace: None }
    }

    /// A message of the device.
    pub(super) fn message(&mut self, message: &DeviceMessage) {
        match message {
            DeviceMessage::Samples(block) => {
                self.batch.block(block);
                self.batch.bound();
            }
            DeviceMessage::Hello(hello) => self.batch.hello = Some(hello.clone()),
            DeviceMessage::Status(status) => self.batch.status = Some(status.clone()),
            // What is sent again is of times that have been shown.
            DeviceMessage::Ack(_)
            | DeviceMessage::Log(_)
            | DeviceMessage::Estimate(_)
            | DeviceMessage::Rows(_)
            | DeviceMessage::Restored(_)
            | DeviceMessage::BackFilled(_)
            | DeviceMessage::Excited(_) => {}
        }
    }

    /// Whether a batch is due.
    pub(super) fn due(&self) -> bool {
        self.offered.elapsed() > BETWEEN
    }

    /// Lines to be told.
    pub(super) fn lines(&mut self, lines: &[String]) {
        self.batch.lines.extend_from_slice(lines);
        self.batch.bound();
    }

    /// Hands over what has come.
    pub(super) fn offer(&mut self, standing: Standing) {
        self.offered = Instant::now();
        self.batch.standing = Some(standing);
        self.feed.offer(&mut self.batch);
    }

    /// Lets a simulated rig wait for our time, `now` being its own.
    pub(super) fn keep_pace(&mut self, now: Instant) {
        if self.feed.hurry.load(Ordering::Relaxed) {
            self.pace = None;
            return;
        }
        let (ours, its) = *self.pace.get_or_insert((Instant::now(), now));
        let (real, device) = (ours.elapsed(), now.saturating_duration_since(its));
        if real > device + BEHIND {
            self.pace = None;
        }
        // Short, so that Ctrl-C and keys are heard.
        std::thread::sleep(device.saturating_sub(real).min(Duration::from_millis(20)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    fn block(first_tick: u32) -> DeviceMessage {
        let mut deltas = heapless::Vec::new();
        deltas.extend([1, -2]);
        DeviceMessage::Samples(SampleBlock {
            first_tick,
            phase: u32::MAX,
            phase_increment: 2,
            amplitude_nanometre: 7,
            first: [i32::MAX, 5].into(),
            deltas,
        })
    }

    fn standing() -> Standing {
        Standing {
            progress: Progress {
                state: "recording",
                samples: 0,
                lost: 0,
                device_s: 0.0,
                target_s: None,
                estimate: None,
                notices: Vec::new(),
            },
            losses: Losses::default(),
            reconnections: 0,
            recording: true,
            asked: None,
            estimate: None,
            precision: None,
            simulated: false,
        }
    }

    #[test]
    fn blocks_become_samples_and_are_handed_over_once() {
        let feed = Arc::new(Feed::default());
        let mut feeder = Feeder::new(feed.clone());
        feeder.message(&block(u32::MAX));
        feeder.lines(&["a".to_owned()]);
        feeder.offer(standing());
        let seen = feed.take();
        let ticks: Vec<_> = seen.samples.iter().map(|s| (s.tick, s.counts, s.phase)).collect();
        assert_eq!(ticks, [(u32::MAX, Counts::of(&[i32::MAX, 5]), u32::MAX), (0, Counts::of(&[i32::MIN, 3]), 1)]);
        assert_eq!((seen.lines.len(), seen.standing.is_some()), (1, true));
        assert_eq!(feed.take(), Seen::default());
    }

    #[test]
    fn what_nothing_newer_has_come_of_stays() {
        let status = |tick| Status { tick, ..Status::default() };
        let mut seen = Seen { status: Some(status(1)), standing: Some(standing()), ..Seen::default() };
        seen.add(&mut Seen::default());
        assert_eq!((seen.status.as_ref(), seen.standing.is_some()), (Some(&status(1)), true));
        seen.add(&mut Seen { status: Some(status(2)), ..Seen::default() });
        assert_eq!(seen.status, Some(status(2)));
    }

    #[test]
    fn one_who_never_takes_or_holds_the_feed_stops_nothing_and_costs_no_memory() {
        let feed = Arc::new(Feed::default());
        let mut feeder = Feeder::new(feed.clone());
        for i in 0..20_000 {
            feeder.message(&block(2 * i));
            if i % 10 == 0 {
                feeder.lines(&["line".to_owned()]);
                feeder.offer(standing());
            }
        }
        feeder.offer(standing());
        let seen = feed.take();
        assert_eq!((seen.samples.len(), seen.lines.len()), (MOST_SAMPLES, MOST_LINES));
        assert_eq!(seen.samples.last().unwrap().tick, 39_999);
        // While somebody looks, the batch waits, and comes whole afterwards.
        let held = feed.seen.lock().unwrap();
        for i in 20_000..40_000 {
            feeder.message(&block(2 * i));
            feeder.offer(standing());
        }
        drop(held);
        assert_eq!(feeder.batch.samples.len(), MOST_SAMPLES);
        feeder.offer(standing());
        assert_eq!(feed.take().samples.last().unwrap().tick, 79_999);
    }
}

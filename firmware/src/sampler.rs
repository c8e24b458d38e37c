//! The interrupt half: what happens at a sampling tick.
//!
//! 1. all counters are read, and the base's input, before anything else, one right after the other;
//! 2. the sample carries the drive's phase, increment and amplitude at this tick;
//! 3. the shaker writes this tick's displacement, then phase, ramp and watchdog advance;
//! 4. the sample goes into the block, a full block into its queue;
//! 5. requests are carried out; they act from the next tick on. Their answers go into the event
//!    queue.
//!
//! A block also ends early: where ticks were missed, where the drive's settings change or a ramp
//! starts or ends, where counts are zeroed. A queue that is full is counted, in samples or frames;
//! nothing waits.
//!
//! Time: bounded; a tick does at most one cosine and [`REQUESTS_PER_TICK`] requests.

mod requests;

use heapless::Vec;
use whirl_shared::block::{Counts, sample_count};
use whirl_shared::encoder::CountScale;
use whirl_shared::frame::{Excited, MOST_CHANNELS, MOST_ENCODERS, SampleBlock, ShakerState, Status};

use crate::base::Base;
use crate::block_builder::{BlockBuilder, Reading};
use crate::event::{Event, Notice, Present, Request, Snapshot};
use crate::inputs::{Inputs, Latched};
use crate::kept::Kept;
use crate::led;
use crate::output::ShakerOutput;
use crate::preview::Turning;
use crate::quadrature::Encoder;
use crate::queue::{Sink, Source};
use crate::settings::{Settings, SettingsError};
use crate::shaker::{Drive, Shaker};
use crate::zero::{Index, Reference};

/// Requests carried out at most in one tick.
pub const REQUESTS_PER_TICK: usize = 4;

/// What is known of one encoder beside its counter.
#[derive(Debug)]
struct Channel {
    encoder: Encoder,
    scale: CountScale,
    turning: Turning,
    last_turning: Turning,
    reference: Reference,
}

/// The interrupt half.
#[derive(Debug)]
pub struct Sampler<I, O> {
    inputs: I,
    channels: Vec<Channel, MOST_ENCODERS>,
    base: Base,
    shaker: Shaker<O>,
    /// Tick of the next sample.
    tick: u32,
    /// Positions at the last sample; `None` before the first and after zeroing.
    last_counts: Option<Counts>,
    builder: BlockBuilder,
    /// What may not change within a block besides what [`BlockBuilder`] watches.
    last_state: ShakerState,
    drive: Drive,
    excited: Excited,
    /// That is a sine of one amplitude, of which the blocks tell all.
    constant: bool,
    overruns: u32,
    dropped_samples: u32,
    dropped_events: u32,
    rejected: u32,
    latency_max_us: u32,
    ticks_per_status: u32,
    ticks_to_status: u32,
    latched: Option<Latched>,
    boot_id: u32,
    /// As they are to be in force after the next boot, and as the image has them.
    settings: [Settings; 2],
}

impl<I: Inputs, O: ShakerOutput> Sampler<I, O> {
    /// Tick 0, shaker disarmed.
    ///
    /// # Errors
    /// A setting that is not possible, with these inputs or at all.
    pub fn new(settings: &Settings, inputs: I, output: O) -> Result<Self, SettingsError> {
        settings.validate()?;
        // At most six.
        let (encoders, there) = (settings.counts_per_turn.len() as u32, inputs.encoders() as u32);
        if encoders != there {
            return Err(SettingsError { field: "encoders", found: encoders, min: there, max: there });
        }
        if settings.base_input && !I::BASE {
            return Err(SettingsError { field: "base_input", found: 1, min: 0, max: 0 });
        }
        let ticks_per_status = (settings.sample_rate_millihertz / 1_000).max(1);
        let shaker = Shaker::new(settings, output);
        let kept = |i: usize| settings.boot.kept.and_then(|kept| kept.get(i).copied());
        let mut channels = Vec::new();
        for (i, (&counts, &reversed)) in settings.counts_per_turn.iter().zip(&settings.reversed).enumerate() {
            let none = SettingsError { field: "counts_per_turn", found: 0, min: 1, max: u32::MAX };
            let channel = Channel {
                encoder: Encoder::new(reversed, kept(i).map_or(0, |kept| kept.count)),
                scale: CountScale::new(counts).ok_or(none)?,
                turning: Turning::default(),
                last_turning: Turning::default(),
                reference: Reference::new(kept(i), settings.boot_id, counts, ticks_per_status),
            };
            // As many as fit.
            let _ = channels.push(channel);
        }
        Ok(Self {
            inputs,
            channels,
            base: Base::new(settings.base.kind),
            drive: shaker.drive(),
            last_state: shaker.state(),
            excited: Excited::default(),
            constant: true,
            shaker,
            tick: 0,
            last_counts: None,
            builder: BlockBuilder::default(),
            overruns: 0,
            dropped_samples: 0,
            dropped_events: 0,
            rejected: 0,
            latency_max_us: 0,
            ticks_per_status,
            ticks_to_status: ticks_per_status,
            latched: None,
            boot_id: settings.boot_id,
            settings: [settings.clone(), settings.clone()],
        })
    }

    /// The settings of the image, where those in force are others.
    pub fn set_built_in(&mut self, built_in: &Settings) {
        self.settings[1] = built_in.clone();
    }

    /// Reads all inputs now, for the next tick. A board that can be held up between its clock and
    /// its counters reads again until both belong together.
    pub fn latch(&mut self) {
        let mut latched = Latched::default();
        self.inputs.latch(&mut latched);
        if self.base.is_there()
            && let Some(place) = latched.0.get_mut(self.channels.len())
        {
            *place = self.inputs.latch_base();
        }
        self.latched = Some(latched);
    }

    /// One sampling tick.
    ///
    /// `missed` is the number of ticks that have passed without a call since the last one;
    /// `latency_us` the delay from the tick to the counters' reading, as far as the board can tell
    /// it.
    pub fn tick(
        &mut self,
        missed: u32,
        latency_us: u32,
        blocks: &mut impl Sink<SampleBlock>,
        events: &mut impl Sink<Event>,
        requests: &mut impl Source<Request>,
    ) {
        if self.latched.is_none() {
            self.latch();
        }
        let latched = self.latched.take().unwrap_or_default();
        let counts = self.extend(&latched);
        self.latency_max_us = self.latency_max_us.max(latency_us);
        if missed > 0 {
            self.tick = self.tick.wrapping_add(missed);
            self.overruns = self.overruns.wrapping_add(missed);
            self.shaker.skip(missed);
        }
        self.drive = self.shaker.drive();
        if self.drive.state != self.last_state {
            self.last_state = self.drive.state;
            self.flush(blocks);
        }
        let reading = Reading {
            tick: self.tick,
            counts,
            phase: self.drive.phase,
            phase_increment: self.drive.phase_increment,
            amplitude_nanometre: self.drive.amplitude_nanometre,
        };
        self.shaker.tick();
        if let Some(block) = self.builder.push(reading) {
            self.put_block(block, blocks);
        }
        if let Some(block) = self.builder.take_full() {
            self.put_block(block, blocks);
        }
        self.follow(counts);
        self.look_for_indices(&latched, events);
        self.tick = self.tick.wrapping_add(1);
        self.report(missed, events);
        for _ in 0..REQUESTS_PER_TICK {
            let Some(request) = requests.take() else { break };
            self.carry_out(request, blocks, events);
        }
    }

    /// The multi-turn counts of a reading, the base's behind the encoders'.
    fn extend(&mut self, latched: &Latched) -> Counts {
        let mut counts = [0; MOST_CHANNELS];
        for ((count, channel), &latched) in counts.iter_mut().zip(&mut self.channels).zip(&latched.0) {
            *count = channel.encoder.extend(latched);
        }
        let mut all = self.channels.len();
        if let (true, Some(count), Some(&latched)) = (self.base.is_there(), counts.get_mut(all), latched.0.get(all)) {
            *count = self.base.extend(latched);
            all += 1;
        }
        Counts::of(&counts[..all])
    }

    fn follow(&mut self, counts: Counts) {
        let last = self.last_counts.replace(counts).unwrap_or(counts);
        for (channel, (&count, &last)) in self.channels.iter_mut().zip(counts.iter().zip(last.iter())) {
            channel.turning.push(channel.scale, count, count.wrapping_sub(last));
            channel.reference.observe(count);
        }
    }

    fn look_for_indices(&mut self, latched: &Latched, events: &mut impl Sink<Event>) {
        for i in 0..self.channels.len() {
            let channel = &mut self.channels[i];
            let seen = self.inputs.index(i).and_then(|seen| channel.encoder.index(seen, latched.0[i]));
            match seen.map(|count| channel.reference.index(count)) {
                Some(Index::First) => self.put_event(Event::Hello(self.present()), events),
                Some(Index::Slipped) => {
                    let notice = Notice::IndexSlipped(i as u8);
                    self.put_event(Event::Log { tick: self.tick, notice }, events);
                }
                Some(Index::Same) | None => {}
            }
        }
    }

    fn present(&self) -> Present {
        Present {
            tick: self.tick,
            host_timeout_ms: self.shaker.host_timeout_ms(),
            zeros: self.channels.iter().map(|channel| channel.reference.zero()).collect(),
        }
    }

    /// What is to be carried over a reset: the place of the last tick.
    pub fn kept(&self) -> Kept {
        let mut kept = Kept::default();
        for (place, channel) in kept.iter_mut().zip(&self.channels) {
            *place = channel.reference.kept();
        }
        kept
    }

    /// Whether the board's light is on.
    pub fn light(&self) -> bool {
        let gone = self.ticks_per_status.saturating_sub(self.ticks_to_status);
        // Rates are at most 10⁵ Hz, a second's ticks as many.
        let part = gone.saturating_mul(1_000) / self.ticks_per_status;
        led::on(self.shaker.state(), self.shaker.hears_host(), part)
    }

    fn report(&mut self, missed: u32, events: &mut impl Sink<Event>) {
        if self.shaker.take_begun() {
            // At its trigger.
            self.excited.tick = self.tick;
            self.put_event(Event::Excited(self.excited), events);
        }
        if let Some(notice) = self.shaker.take_notice() {
            #[cfg(feature = "defmt")]
            defmt::warn!("tick {=u32}: {}", self.tick, notice);
            self.put_event(Event::Log { tick: self.tick, notice }, events);
        }
        let passed = missed.saturating_add(1);
        if passed < self.ticks_to_status {
            self.ticks_to_status -= passed;
            return;
        }
        // The seconds stay where they were, also when the end of one was missed.
        let late = (passed - self.ticks_to_status) % self.ticks_per_status;
        self.ticks_to_status = self.ticks_per_status - late;
        for channel in &mut self.channels {
            channel.last_turning = core::mem::take(&mut channel.turning);
        }
        self.put_status(events);
    }

    fn flush(&mut self, blocks: &mut impl Sink<SampleBlock>) {
        if let Some(block) = self.builder.flush() {
            self.put_block(block, blocks);
        }
    }

    fn put_block(&mut self, block: SampleBlock, blocks: &mut impl Sink<SampleBlock>) {
        if let Err(block) = blocks.put(block) {
            self.dropped_samples = self.dropped_samples.wrapping_add(sample_count(&block));
        }
    }

    fn put_event(&mut self, event: Event, events: &mut impl Sink<Event>) {
        if events.put(event).is_err() {
            self.dropped_events = self.dropped_events.wrapping_add(1);
        }
    }

    fn put_status(&mut self, events: &mut impl Sink<Event>) {
        let snapshot = self.snapshot();
        self.latency_max_us = 0;
        self.put_event(Event::Status(snapshot), events);
        if !self.constant && self.shaker.moving() {
            self.put_event(Event::Excited(self.excited), events);
        }
    }

    /// The present counters and the shaker; the thread half adds its own.
    pub fn snapshot(&self) -> Snapshot {
        let drive = self.shaker.drive();
        Snapshot {
            status: Status {
                tick: self.tick,
                overruns: self.overruns,
                dropped_samples: self.dropped_samples,
                dropped_frames: self.dropped_events,
                rejected_commands: self.rejected,
                shaker: drive.state,
                stop_cause: self.shaker.stop_cause(),
                amplitude_nanometre: drive.amplitude_nanometre,
                frequency_millihertz: self.shaker.excitation().frequency_millihertz,
                latency_max_us: self.latency_max_us,
                ..Status::default()
            },
            turning: self.channels.iter().map(|channel| channel.last_turning).collect(),
        }
    }

    /// The drive at the last tick's sample, with the state that the shaker is in now.
    pub fn drive(&self) -> Drive {
        Drive { state: self.shaker.state(), ..self.drive }
    }

    /// The shaker.
    pub fn shaker(&self) -> &Shaker<O> {
        &self.shaker
    }

    /// The inputs and the output, for simulators.
    pub fn parts_mut(&mut self) -> (&mut I, &mut O) {
        (&mut self.inputs, self.shaker.output_mut())
    }
}

#[cfg(test)]
mod tests;

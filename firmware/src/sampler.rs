//! The interrupt half: what happens at a sampling tick.
//!
//! 1. both counters are read, before anything else, one right after the other;
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

use whirl_shared::block::sample_count;
use whirl_shared::encoder::CountScale;
use whirl_shared::frame::{Ack, CHANNELS, Command, CommandResult, SampleBlock, Setting, ShakerState, Status};

use crate::block_builder::{BlockBuilder, Reading};
use crate::event::{Event, Notice, Present, Request, Snapshot};
use crate::kept::Kept;
use crate::led;
use crate::output::ShakerOutput;
use crate::preview::Turning;
use crate::quadrature::{Encoder, QuadratureCounter};
use crate::queue::{Sink, Source};
use crate::settings::{Settings, SettingsError};
use crate::shaker::{Drive, Shaker};
use crate::zero::{Index, Reference};

/// Requests carried out at most in one tick.
pub const REQUESTS_PER_TICK: usize = 4;

/// The interrupt half.
#[derive(Debug)]
pub struct Sampler<C1, C2, O> {
    encoder1: Encoder<C1>,
    encoder2: Encoder<C2>,
    shaker: Shaker<O>,
    scales: [CountScale; CHANNELS],
    /// Tick of the next sample.
    tick: u32,
    /// Positions at the last sample; `None` before the first and after zeroing.
    last_counts: Option<[i32; CHANNELS]>,
    builder: BlockBuilder,
    /// What may not change within a block besides what [`BlockBuilder`] watches.
    last_state: ShakerState,
    drive: Drive,
    overruns: u32,
    dropped_samples: u32,
    dropped_events: u32,
    rejected: u32,
    latency_max_us: u32,
    ticks_per_status: u32,
    ticks_to_status: u32,
    turning: [Turning; CHANNELS],
    last_turning: [Turning; CHANNELS],
    latched: Option<[u16; CHANNELS]>,
    references: [Reference; CHANNELS],
    boot_id: u32,
    /// As they are to be in force after the next boot, and as the image has them.
    settings: [Settings; 2],
}

impl<C1: QuadratureCounter, C2: QuadratureCounter, O: ShakerOutput> Sampler<C1, C2, O> {
    /// Tick 0, shaker disarmed.
    ///
    /// # Errors
    /// A setting that is not possible.
    pub fn new(settings: &Settings, counter1: C1, counter2: C2, output: O) -> Result<Self, SettingsError> {
        settings.validate()?;
        let [Some(scale1), Some(scale2)] = settings.counts_per_turn.map(CountScale::new) else {
            return Err(SettingsError { field: "counts_per_turn", found: 0, min: 1, max: u32::MAX });
        };
        let ticks_per_status = (settings.sample_rate_millihertz / 1_000).max(1);
        let shaker = Shaker::new(settings, output);
        let kept = |i: usize| settings.boot.kept.map(|kept| kept[i]);
        let place = |i: usize| kept(i).map_or(0, |kept| kept.count);
        Ok(Self {
            encoder1: Encoder::new(counter1, settings.reversed[0], place(0)),
            encoder2: Encoder::new(counter2, settings.reversed[1], place(1)),
            drive: shaker.drive(),
            last_state: shaker.state(),
            shaker,
            scales: [scale1, scale2],
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
            turning: [Turning::default(); CHANNELS],
            last_turning: [Turning::default(); CHANNELS],
            latched: None,
            references: core::array::from_fn(|i| {
                Reference::new(kept(i), settings.boot_id, settings.counts_per_turn[i], ticks_per_status)
            }),
            boot_id: settings.boot_id,
            settings: [settings.clone(), settings.clone()],
        })
    }

    /// The settings of the image, where those in force are others.
    pub fn set_built_in(&mut self, built_in: &Settings) {
        self.settings[1] = built_in.clone();
    }

    /// Reads both counters now, for the next tick. A board that can be held up between its clock
    /// and its counters reads again until both belong together.
    pub fn latch(&mut self) {
        self.latched = Some([self.encoder1.latch(), self.encoder2.latch()]);
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
        let latched = self.latched.take().unwrap_or_else(|| [self.encoder1.latch(), self.encoder2.latch()]);
        let counts = [self.encoder1.extend(latched[0]), self.encoder2.extend(latched[1])];
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
        self.look_for_indices(latched, events);
        self.tick = self.tick.wrapping_add(1);
        self.report(missed, events);
        for _ in 0..REQUESTS_PER_TICK {
            let Some(request) = requests.take() else { break };
            self.carry_out(request, blocks, events);
        }
    }

    fn follow(&mut self, counts: [i32; CHANNELS]) {
        let last = self.last_counts.replace(counts).unwrap_or(counts);
        for i in 0..CHANNELS {
            self.turning[i].push(self.scales[i], counts[i], counts[i].wrapping_sub(last[i]));
            self.references[i].observe(counts[i]);
        }
    }

    fn look_for_indices(&mut self, latched: [u16; CHANNELS], events: &mut impl Sink<Event>) {
        for i in 0..CHANNELS {
            let seen = if i == 0 { self.encoder1.index(latched[0]) } else { self.encoder2.index(latched[1]) };
            match seen.map(|count| self.references[i].index(count)) {
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
            zeros: self.references.each_ref().map(Reference::zero),
        }
    }

    /// What is to be carried over a reset: the place of the last tick.
    pub fn kept(&self) -> Kept {
        self.references.each_ref().map(Reference::kept)
    }

    /// Whether the board's light is on.
    pub fn light(&self) -> bool {
        let gone = self.ticks_per_status.saturating_sub(self.ticks_to_status);
        // Rates are at most 10⁵ Hz, a second's ticks as many.
        let part = gone.saturating_mul(1_000) / self.ticks_per_status;
        led::on(self.shaker.state(), self.shaker.hears_host(), part)
    }

    /// Takes a setting: for the next boot.
    fn keep(&mut self, setting: Setting, events: &mut impl Sink<Event>) -> CommandResult {
        let new = match self.settings[0].with(setting, &self.settings[1]) {
            Ok(new) => new,
            Err(refused) => return refused,
        };
        if events.put(Event::Keep(new.to_words(), self.present())).is_err() {
            return CommandResult::WrongState;
        }
        self.settings[0] = new;
        CommandResult::Done
    }

    fn report(&mut self, missed: u32, events: &mut impl Sink<Event>) {
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
        self.last_turning = core::mem::take(&mut self.turning);
        self.put_status(events);
    }

    fn carry_out(&mut self, request: Request, blocks: &mut impl Sink<SampleBlock>, events: &mut impl Sink<Event>) {
        let ramp_before = self.shaker.drive().state;
        let mut result = self.shaker.command(request.command);
        if let (CommandResult::Done, Command::Set(setting)) = (result, request.command) {
            result = self.keep(setting, events);
        }
        if let Command::BackFill { boot_id, .. } = request.command
            && boot_id != self.boot_id
        {
            // The ticks of another boot.
            result = CommandResult::WrongState;
        }
        if result != CommandResult::Done {
            self.rejected = self.rejected.wrapping_add(1);
        }
        self.put_event(Event::Ack(Ack { command_sequence: request.sequence, result }), events);
        if result != CommandResult::Done {
            return;
        }
        match request.command {
            Command::Start { .. } if ramp_before == ShakerState::Ramping => self.flush(blocks),
            Command::ZeroCounts => {
                self.flush(blocks);
                self.encoder1.zero();
                self.encoder2.zero();
                self.last_counts = None;
                // Each of a boot's zeros has an id of its own, and none that of another boot but by
                // chance.
                let id = (self.boot_id ^ self.tick.wrapping_add(1)).wrapping_mul(0x0100_0193);
                self.references.iter_mut().for_each(|reference| reference.set_zero(id));
                self.put_event(Event::Hello(self.present()), events);
            }
            Command::Hello | Command::SetRamp { .. } | Command::SetHostTimeout { .. } => {
                self.put_event(Event::Hello(self.present()), events);
            }
            Command::Restart => self.put_event(Event::Restart, events),
            Command::Status => self.put_status(events),
            _ => {}
        }
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
                frequency_millihertz: self.shaker.frequency_millihertz(),
                latency_max_us: self.latency_max_us,
                ..Status::default()
            },
            turning: self.last_turning,
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

    /// Both counters and the output, for simulators.
    pub fn parts_mut(&mut self) -> (&mut C1, &mut C2, &mut O) {
        (self.encoder1.counter_mut(), self.encoder2.counter_mut(), self.shaker.output_mut())
    }
}

#[cfg(test)]
mod tests;

//! Both halves as one, for a single thread: host tests, simulators, the emulated board.

use core::borrow::BorrowMut;

use heapless::spsc::Queue;
use whirl_shared::excitation::Shape;
use whirl_shared::frame::{SampleBlock, Status};

use crate::adjust::Words;
use crate::estimate::Estimator;
use crate::event::{Event, Request};
use crate::history::KEPT;
use crate::inputs::Inputs;
use crate::kept::Kept;
use crate::link::Link;
use crate::output::ShakerOutput;
use crate::sampler::Sampler;
use crate::settings::{Settings, SettingsError};
use crate::shaker::Drive;

/// Slots of the block queue that boards use (one less is usable): 1.2 s of samples at 500 Hz.
pub const BLOCKS: usize = 64;
/// Slots of the event queue that boards use.
pub const EVENTS: usize = 32;
/// Slots of the request queue that boards use.
pub const REQUESTS: usize = 16;

/// The whole application. The const parameters are the queues' slots, of which one each stays
/// empty; `K` is memory for the blocks that are kept.
#[derive(Debug)]
pub struct App<I, O, const B: usize = BLOCKS, const E: usize = EVENTS, const R: usize = REQUESTS, K = [u8; KEPT]> {
    sampler: Sampler<I, O>,
    link: Link<Estimator, K>,
    blocks: Queue<SampleBlock, B>,
    events: Queue<Event, E>,
    requests: Queue<Request, R>,
}

impl<I: Inputs, O: ShakerOutput> App<I, O> {
    /// With the boards' queues; tick 0, shaker disarmed, a hello waiting to be sent.
    ///
    /// # Errors
    /// A setting that is not possible.
    pub fn new(settings: Settings, inputs: I, output: O) -> Result<Self, SettingsError> {
        Self::with_queues(settings, inputs, output)
    }
}

impl<I: Inputs, O: ShakerOutput, const B: usize, const E: usize, const R: usize> App<I, O, B, E, R> {
    /// As [`App::new`], with queues of other lengths.
    ///
    /// # Errors
    /// A setting that is not possible.
    pub fn with_queues(settings: Settings, inputs: I, output: O) -> Result<Self, SettingsError> {
        Self::with_memory(&settings, inputs, output, [0; KEPT])
    }
}

impl<I, O, K, const B: usize, const E: usize, const R: usize> App<I, O, B, E, R, K>
where
    I: Inputs,
    O: ShakerOutput,
    K: BorrowMut<[u8]>,
{
    /// As [`App::new`], with queues of other lengths, and other memory for the blocks that are
    /// kept.
    ///
    /// # Errors
    /// A setting that is not possible; memory for no block.
    pub fn with_memory(settings: &Settings, inputs: I, output: O, memory: K) -> Result<Self, SettingsError> {
        Ok(Self {
            sampler: Sampler::new(settings, inputs, output)?,
            link: Link::with(settings, Estimator::IDLE, memory)?,
            blocks: Queue::new(),
            events: Queue::new(),
            requests: Queue::new(),
        })
    }

    /// The settings of the image, where those in force are others.
    pub fn set_built_in(&mut self, built_in: &Settings) {
        self.sampler.set_built_in(built_in);
    }

    /// One sampling tick; see [`Sampler::tick`].
    pub fn tick(&mut self, missed: u32, latency_us: u32) {
        self.sampler.tick(missed, latency_us, &mut self.blocks, &mut self.events, &mut self.requests);
    }

    /// Bytes from the host. Commands in them are carried out at the end of the next tick.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.link.receive(bytes, &mut self.requests);
    }

    /// The next frame, if there is one, written to `out`; its length. `out` must hold
    /// [`whirl_shared::codec::MAX_FRAME`] bytes; with less, nothing is taken and `None` returned.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> Option<usize> {
        self.link.poll_transmit(out, &mut self.blocks, &mut self.events)
    }

    /// Takes a block in without sending any, see [`Link::keep_up`]; whether there was one.
    pub fn keep_up(&mut self) -> bool {
        self.link.keep_up(&mut self.blocks)
    }

    /// The drive at the last tick: the phase, increment and amplitude that its sample carries and
    /// from which its displacement was computed, with the state that the shaker is in now. Until
    /// the next tick the base follows the shape at that amplitude and `phase + u · phase_increment`,
    /// u from 0 to 1; of a sine that is `amplitude · cos(phase + u · phase_increment)`.
    pub fn drive(&self) -> Drive {
        self.sampler.drive()
    }

    /// The shape of the base's motion.
    pub fn shape(&self) -> Shape<'_> {
        self.sampler.shaker().shape()
    }

    /// What is to be carried over a reset.
    pub fn kept(&self) -> Kept {
        self.sampler.kept()
    }

    /// Settings that are to be kept; [`Self::settings_kept`] then tells the host what became of it.
    pub fn settings_to_keep(&self) -> Option<Words> {
        self.link.settings_to_keep()
    }

    /// The settings have been kept, or could not be.
    pub fn settings_kept(&mut self, done: bool) {
        self.link.kept(done);
    }

    /// Whether a restart is due, now that all is sent.
    pub fn restart_due(&self) -> bool {
        self.link.restart_due()
    }

    /// The present status.
    pub fn status(&self) -> Status {
        self.link.status(self.sampler.snapshot())
    }

    /// The inputs, for simulators.
    pub fn inputs_mut(&mut self) -> &mut I {
        self.sampler.parts_mut().0
    }

    /// The shaker's output, for simulators.
    pub fn output_mut(&mut self) -> &mut O {
        self.sampler.parts_mut().1
    }

    /// The inputs and the output, for simulators.
    pub fn parts_mut(&mut self) -> (&mut I, &mut O) {
        self.sampler.parts_mut()
    }
}

#[cfg(test)]
mod back_fill_tests;
#[cfg(test)]
mod lasting_tests;
#[cfg(test)]
mod tests;

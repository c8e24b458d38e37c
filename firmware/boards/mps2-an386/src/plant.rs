//! The plant's end: encoders and shaker are what the last exchange brought and what the next one
//! takes.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU16, AtomicUsize, Ordering::Relaxed};

use whirl_firmware::base::BaseInput;
use whirl_firmware::lock_step::{HOST_BYTES, REPLY_LEN, Reply, Request, shape_to_bytes};
use whirl_firmware::{QuadratureCounter, ShakerOutput};
use whirl_shared::excitation::Shape;

use whirl_board_mps2_an386::semihosting::File;

static COUNTS: [AtomicU16; 2] = [AtomicU16::new(0), AtomicU16::new(0)];
static BASE: AtomicU16 = AtomicU16::new(0);
static DISPLACEMENT: AtomicI32 = AtomicI32::new(0);
static AMPLIFIER: AtomicBool = AtomicBool::new(false);
static BROKEN: AtomicBool = AtomicBool::new(false);
/// The pipe to the plant for a panic: its handle, 0 as long as there is none.
static LAST_WORDS: AtomicUsize = AtomicUsize::new(0);

/// A counter: the value of the last exchange.
pub struct Counter(pub usize);

impl QuadratureCounter for Counter {
    fn count(&mut self) -> u16 {
        COUNTS[self.0].load(Relaxed)
    }
}

/// The input of the base's motion: the value of the last exchange.
pub struct Base;

impl BaseInput for Base {
    fn latch(&mut self) -> u16 {
        BASE.load(Relaxed)
    }
}

/// The shaker's output: taken along by the next exchange.
pub struct Output;

/// The output was broken by a test.
#[derive(Debug)]
pub struct Broken;

impl ShakerOutput for Output {
    type Error = Broken;

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), Broken> {
        if BROKEN.load(Relaxed) {
            return Err(Broken);
        }
        DISPLACEMENT.store(displacement_nanometre, Relaxed);
        Ok(())
    }

    fn enable(&mut self, on: bool) -> Result<(), Broken> {
        // The enable pin works also where the output does not.
        AMPLIFIER.store(on, Relaxed);
        Ok(())
    }
}

/// The output fails from now on.
pub fn break_output() {
    BROKEN.store(true, Relaxed);
}

/// Both pipes.
pub struct Plant {
    to: File,
    from: File,
    /// The host's bytes that came with the last reply.
    pub host: heapless::Vec<u8, HOST_BYTES>,
}

impl Plant {
    /// Opens the pipes, in the order in which the other side does.
    pub fn open() -> Option<Self> {
        let to = File::open("to_plant\0", true)?;
        let from = File::open("from_plant\0", false)?;
        LAST_WORDS.store(to.handle(), Relaxed);
        Some(Self { to, from, host: heapless::Vec::new() })
    }

    /// Moves the plant up to a tick; the drive's shape is told where it is a new one. `None` where
    /// the other side has gone or makes no sense.
    pub fn exchange(&mut self, request: Request, shape: Option<Shape<'_>>) -> Option<Reply> {
        let request = Request {
            displacement_nanometre: DISPLACEMENT.load(Relaxed),
            amplifier_on: AMPLIFIER.load(Relaxed),
            shape_follows: shape.is_some(),
            ..request
        };
        let mut bytes = [0; REPLY_LEN];
        let told = self.to.write_all(&request.to_bytes());
        if !told || !shape.is_none_or(|shape| self.to.write_all(&shape_to_bytes(shape))) {
            return None;
        }
        if !self.from.read_exact(&mut bytes) {
            return None;
        }
        let reply = Reply::from_bytes(&bytes)?;
        self.host.clear();
        self.host.resize(usize::from(reply.host_bytes), 0).ok()?;
        if !self.host.is_empty() && !self.from.read_exact(&mut self.host) {
            return None;
        }
        for (place, count) in COUNTS.iter().zip(reply.counts) {
            place.store(count, Relaxed);
        }
        BASE.store(reply.base, Relaxed);
        Some(reply)
    }
}

/// Silences the shaker and tells the plant, after a panic.
pub fn last_words() {
    DISPLACEMENT.store(0, Relaxed);
    AMPLIFIER.store(false, Relaxed);
    if let Some(file) = File::of_handle(LAST_WORDS.load(Relaxed)) {
        // Nobody is left to be told of a failure.
        let _ = file.write_all(&Request { panicked: true, ..Request::default() }.to_bytes());
    }
}

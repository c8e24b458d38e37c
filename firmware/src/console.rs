//! Incoming bytes → requests. A frame that does not decode is counted and does nothing else.

use whirl_shared::codec::Decoder;
use whirl_shared::frame::HostMessage;

use crate::event::Request;

/// The receiving end of the link.
#[derive(Debug)]
pub(crate) struct Console {
    decoder: Decoder<HostMessage>,
}

impl Console {
    pub const fn new() -> Self {
        Self { decoder: Decoder::new() }
    }

    /// Takes one byte; the byte that ends a good frame gives its command.
    pub fn push(&mut self, byte: u8) -> Option<Request> {
        match self.decoder.push(byte)? {
            Ok(envelope) => {
                let HostMessage::Command(command) = envelope.message;
                Some(Request { sequence: envelope.sequence, command })
            }
            Err(_error) => {
                #[cfg(feature = "defmt")]
                defmt::debug!("received frame discarded: {}", _error);
                None
            }
        }
    }

    /// Frames that did not decode, wrapping.
    pub fn bad_frames(&self) -> u32 {
        self.decoder.counters().bad_frames() as u32
    }
}

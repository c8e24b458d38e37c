//! Stand-ins for hardware and host, for the tests of this crate.

use std::vec::Vec;

use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::{Command, DeviceMessage, Envelope, HostMessage};

use crate::output::ShakerOutput;
use crate::quadrature::QuadratureCounter;

/// A counter that shows what the test puts in, and no index.
#[derive(Clone, Debug, Default)]
pub struct Counter(pub u16);

/// A counter with an index.
#[derive(Clone, Debug, Default)]
pub struct Indexed(pub u16, pub Option<u16>);

impl QuadratureCounter for Indexed {
    fn count(&mut self) -> u16 {
        self.0
    }

    fn index(&mut self) -> Option<u16> {
        self.1.take()
    }
}

impl QuadratureCounter for Counter {
    fn count(&mut self) -> u16 {
        self.0
    }
}

/// An output that keeps everything written to it and fails when told to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recorder {
    pub writes: Vec<i32>,
    pub enabled: bool,
    pub fail_write: bool,
    pub fail_enable: bool,
    pub cut: bool,
    pub triggered: bool,
    /// The trigger output.
    pub trigger: bool,
}

impl ShakerOutput for Recorder {
    type Error = ();

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), ()> {
        if self.fail_write {
            return Err(());
        }
        self.writes.push(displacement_nanometre);
        Ok(())
    }

    fn enable(&mut self, on: bool) -> Result<(), ()> {
        if self.fail_enable {
            return Err(());
        }
        self.enabled = on;
        Ok(())
    }

    fn is_cut(&mut self) -> bool {
        self.cut
    }

    fn is_triggered(&mut self) -> bool {
        self.triggered
    }

    fn trigger(&mut self, on: bool) {
        self.trigger = on;
    }
}

/// The other end of the link.
#[derive(Debug)]
pub struct Host {
    decoder: Decoder<DeviceMessage>,
    next: u16,
    pub received: Vec<Envelope<DeviceMessage>>,
    /// Every byte that came.
    pub bytes: Vec<u8>,
}

impl Host {
    pub fn new() -> Self {
        Self { decoder: Decoder::new(), next: 0, received: Vec::new(), bytes: Vec::new() }
    }

    pub fn frame(&mut self, command: Command) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let envelope = Envelope { sequence: self.next, message: HostMessage::Command(command) };
        self.next = self.next.wrapping_add(1);
        let length = encode(&envelope, &mut out).unwrap();
        out[..length].to_vec()
    }

    pub fn take(&mut self, bytes: &[u8]) {
        self.bytes.extend(bytes);
        for &byte in bytes {
            if let Some(result) = self.decoder.push(byte) {
                self.received.push(result.unwrap());
            }
        }
    }
}

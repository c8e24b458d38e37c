//! Any bytes to both decoders: no panic, every byte accounted for, whatever decodes encodes again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::{DeviceMessage, HostMessage};

fuzz_target!(|data: &[u8]| {
    let mut device: Decoder<DeviceMessage> = Decoder::new();
    let mut host: Decoder<HostMessage> = Decoder::new();
    let mut out = [0; MAX_FRAME];
    for &byte in data {
        if let Some(Ok(envelope)) = device.push(byte) {
            encode(&envelope, &mut out).expect("a decoded message fits into the longest frame");
        }
        if let Some(Ok(envelope)) = host.push(byte) {
            encode(&envelope, &mut out).expect("a decoded message fits into the longest frame");
        }
    }
    for (counters, pending) in [(device.counters(), device.pending_bytes()), (host.counters(), host.pending_bytes())] {
        assert!(counters.bytes_discarded + pending <= data.len() as u64);
    }
});

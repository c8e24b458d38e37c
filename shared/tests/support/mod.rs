//! Seeded streams of good, damaged and random frames, and the account that a decoder of them must
//! keep.

// Each of the targets that include this file uses a part of it.
#![allow(dead_code)]

mod messages;

use serde::Serialize;
use serde::de::DeserializeOwned;
use whirl_shared::codec::{CRC, Decoder, MAX_FRAME, encode};
use whirl_shared::frame::Envelope;

pub use self::messages::Source;

/// What is done to bytes on their way.
impl Source {
    /// Random bytes with a right checksum, as COBS: what postcard must cope with on its own.
    fn checked_noise(&mut self, from: &[u8]) -> Vec<u8> {
        let mut payload = from.to_vec();
        for _ in 0..self.below(4) {
            if payload.is_empty() {
                break;
            }
            let place = self.below(payload.len());
            match self.below(4) {
                0 => payload[place] = self.u32() as u8,
                1 => payload.truncate(place),
                2 => payload.insert(place, self.u32() as u8),
                _ => payload[place] = 0xff,
            }
        }
        payload.extend_from_slice(&CRC.checksum(&payload).to_le_bytes());
        let mut frame = vec![0; cobs::max_encoding_length(payload.len()) + 1];
        let length = cobs::encode(&payload, &mut frame);
        frame.truncate(length + 1);
        frame
    }

    fn damage(&mut self, frame: &mut Vec<u8>) {
        for _ in 0..=self.below(3) {
            let place = self.below(frame.len().max(1)).min(frame.len());
            match self.below(8) {
                0 if place < frame.len() => frame[place] ^= 1 << self.below(8),
                1 if place < frame.len() => frame[place] = self.u32() as u8,
                2 if place < frame.len() => {
                    frame.remove(place);
                }
                3 => frame.insert(place, self.u32() as u8),
                4 => frame.truncate(place),
                5 => frame.insert(place, 0),
                6 if place + 1 < frame.len() => frame.swap(place, place + 1),
                _ => {
                    let tail = frame.split_off(place);
                    frame.extend_from_slice(&tail);
                    frame.extend_from_slice(&tail);
                }
            }
        }
    }

    fn noise(&mut self, length: usize, zeros: bool) -> Vec<u8> {
        (0..length)
            .map(|_| {
                let byte = self.u32() as u8;
                if zeros { byte } else { byte.max(1) }
            })
            .collect()
    }
}

/// What a torture run has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Account {
    pub bytes: u64,
    pub intact_sent: u64,
    pub intact_received: u64,
    /// Frames that decoded although they had been damaged (undamaged copies among them).
    pub others_received: u64,
    pub bad: u64,
    /// FNV-1a of every message and error in order: equal for equal seeds.
    pub digest: u64,
}

struct Bench<M> {
    decoder: Decoder<M>,
    account: Account,
    /// Bytes of good frames with their zeros, zeros of empty frames.
    good_bytes: u64,
    idle_zeros: u64,
}

impl<M: DeserializeOwned + Serialize + PartialEq> Bench<M> {
    fn feed(&mut self, bytes: &[u8]) -> Option<Envelope<M>> {
        let mut last = None;
        for &byte in bytes {
            let pending = self.decoder.pending_bytes();
            let result = self.decoder.push(byte);
            self.account.bytes += 1;
            match (&result, byte) {
                (Some(Ok(_)), _) => self.good_bytes += pending + 1,
                (Some(Err(error)), _) => {
                    self.account.bad += 1;
                    self.note(&[*error as u8 + 1]);
                }
                (None, 0) => self.idle_zeros += 1,
                (None, _) => {}
            }
            if let Some(Ok(envelope)) = result {
                let mut frame = [0; MAX_FRAME];
                // Whatever decodes can be encoded again, within the greatest length.
                let length = encode(&envelope, &mut frame).expect("a decoded message fits into the longest frame");
                self.note(&frame[..length]);
                self.account.others_received += 1;
                last = Some(envelope);
            }
        }
        last
    }

    fn note(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.account.digest = (self.account.digest ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
    }

    /// Feeds an intact frame in step with the stream: it must come out as it is.
    fn intact(&mut self, envelope: &Envelope<M>, frame: &[u8]) {
        self.account.intact_sent += 1;
        if self.feed(frame).as_ref() == Some(envelope) {
            self.account.intact_received += 1;
            self.account.others_received -= 1;
        }
    }

    fn settle(&self) {
        let counters = self.decoder.counters();
        let pending = self.decoder.pending_bytes();
        assert_eq!(self.account.bytes, self.good_bytes + self.idle_zeros + counters.bytes_discarded + pending);
        assert_eq!(counters.frames, self.account.intact_received + self.account.others_received);
        assert_eq!(counters.bad_frames(), self.account.bad);
    }
}

/// Feeds at least `bytes` bytes made of good, damaged and random frames to a decoder, and checks
/// its account after each piece: every byte accounted for, every intact frame after a zero decoded
/// as it was sent.
pub fn torture<M>(seed: u64, bytes: u64, mut make: impl FnMut(&mut Source) -> Envelope<M>) -> Account
where
    M: DeserializeOwned + Serialize + PartialEq,
{
    let mut source = Source::new(seed);
    let account = Account { digest: 0xcbf2_9ce4_8422_2325, ..Account::default() };
    let mut bench = Bench { decoder: Decoder::new(), account, good_bytes: 0, idle_zeros: 0 };
    while bench.account.bytes < bytes {
        let envelope = make(&mut source);
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&envelope, &mut buffer).expect("a message fits into the longest frame");
        let intact = &buffer[..length];
        match source.below(8) {
            0 | 1 => {
                let mut frame = intact.to_vec();
                source.damage(&mut frame);
                bench.feed(&frame);
            }
            2 => {
                let payload =
                    postcard::to_slice(&envelope, &mut [0; MAX_FRAME]).map(|p| p.to_vec()).unwrap_or_default();
                let frame = source.checked_noise(&payload);
                bench.feed(&frame);
            }
            3 => {
                let length = source.below(64);
                let payload = source.noise(length, true);
                let frame = source.checked_noise(&payload);
                bench.feed(&frame);
            }
            4 => {
                let length = source.below(3 * MAX_FRAME);
                let noise = source.noise(length, true);
                bench.feed(&noise);
            }
            5 => {
                let length = source.below(3 * MAX_FRAME);
                let noise = source.noise(length, false);
                bench.feed(&noise);
            }
            _ => {
                bench.feed(&[0]);
                bench.intact(&envelope, intact);
            }
        }
        bench.settle();
    }
    bench.account
}

//! Messages ↔ bytes: `COBS(postcard(Envelope) ‖ CRC-32/ISO-HDLC, little endian) ‖ 0x00`.
//!
//! COBS takes every zero out of a frame, so that a zero byte always ends one: whatever was damaged,
//! the decoder is in step again after the next zero. The checksum covers the postcard bytes. A
//! frame is at most [`MAX_FRAME`] bytes, and a decoder holds one frame and nothing else.
//!
//! Limits: CRC-32 lets a damaged frame through with probability 2⁻³² at random damage (any burst of
//! up to 32 bits is found); a zero that is put into a frame or lost from its end costs the frames
//! on both sides of it.
//!
//! Source: COBS, S. Cheshire and M. Baker, IEEE/ACM Trans. Networking 7 (1999) 159; CRC-32/ISO-HDLC
//! is the checksum of Ethernet and zlib (polynomial 0x04C11DB7 reflected, initial value and final
//! xor 0xFFFFFFFF).

use core::fmt;
use core::marker::PhantomData;

use crc::{CRC_32_ISO_HDLC, Crc};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::excitation::{MOST_COMPONENTS, MOST_STEPS};
use crate::frame::regression::{ROW_LEN, ROWS_LEN};
use crate::frame::{BLOCK_LEN, Envelope, MOST_CHANNELS, MOST_ENCODERS, PANIC_LEN, TEXT_LEN};
use crate::regressor::{UNKNOWNS1, UNKNOWNS2};

/// The frame's checksum.
pub const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// Bytes of the checksum.
pub const CRC_LEN: usize = 4;
/// Bytes that a code of COBS spans at most.
const LONGEST_RUN: usize = 254;

// Greatest lengths of postcard's varints and of a text with its length.
const U16: usize = 3;
const U32: usize = 5;
const TEXT: usize = 1 + TEXT_LEN;
/// Of a list of at most 127 elements.
const LENGTH: usize = 1;
/// Envelope number and message id.
const HEAD: usize = U16 + 1;
const ZERO: usize = U32 + 1 + 1 + U32;
const HELLO: usize = HEAD
    + U16
    + 3 * U32
    + 2 * TEXT
    + U32
    + (1 + MOST_ENCODERS * U32)
    + 1
    + 4 * U32
    + U32
    + (1 + MOST_ENCODERS * ZERO)
    + 1
    + (1 + PANIC_LEN)
    + (1 + MOST_ENCODERS)
    + 2 * U32
    + 1
    + (1 + U32);
const STATUS: usize = HEAD + 7 * U32 + 2 + 3 * U32 + 2 * (1 + MOST_ENCODERS * U32) + U32;
const LOG: usize = HEAD + U32 + 1 + TEXT;
const ESTIMATE: usize = HEAD + 5 * U32 + U16 + 2 * (1 + 2 * 4) + (UNKNOWNS1 + UNKNOWNS2) * 2 * 4;
const EXCITED: usize =
    HEAD + U32 + (U32 + 2 + 2 * U32) + MOST_STEPS * U32 + 1 + U32 + MOST_COMPONENTS * (1 + 2 * U16) + 1 + (U16 + U32);
const ROWS: usize = HEAD + 5 * U32 + 2 + 1 + ROWS_LEN * ROW_LEN * 3;

/// Greatest length of a block's message.
const fn samples_len(channels: usize) -> usize {
    HEAD + 4 * U32 + 1 + channels * U32 + LENGTH + (BLOCK_LEN - 1) * channels * U16
}

const fn max(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}

/// Length on the wire of a frame whose postcard bytes number `payload`, at worst: the checksum, one
/// COBS byte for every 254 begun, and the zero.
#[must_use]
pub const fn frame_len(payload: usize) -> usize {
    let checked = payload + CRC_LEN;
    checked + checked / 254 + 1 + 1
}

/// Greatest length on the wire of any message in either direction, its zero included.
pub const MAX_FRAME: usize =
    frame_len(max(max(max(HELLO, samples_len(MOST_CHANNELS)), max(STATUS, LOG)), max(max(ESTIMATE, ROWS), EXCITED)));

/// Greatest length on the wire of a block of so many channels.
#[must_use]
pub const fn samples_frame_len(channels: usize) -> usize {
    frame_len(samples_len(channels))
}

/// Why a message could not be encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The frame does not fit into the buffer; [`MAX_FRAME`] bytes always do.
    BufferTooSmall,
    /// The message cannot be expressed in postcard (not possible with the messages of
    /// [`crate::frame`]).
    NotSerialisable,
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BufferTooSmall => "the frame does not fit into the buffer",
            Self::NotSerialisable => "the message cannot be serialised",
        })
    }
}

impl core::error::Error for EncodeError {}

/// Encodes one frame, its terminating zero included, and returns its length.
///
/// Message, checksum and COBS one after another over the whole frame, in its place: fewer
/// instructions than to carry each byte through all three.
///
/// # Errors
/// [`EncodeError::BufferTooSmall`] where `out` is shorter than the frame, or than COBS may make it
/// ([`frame_len`]) where that has 508 bytes or more; `out` then holds part of it.
pub fn encode<M: Serialize>(envelope: &Envelope<M>, out: &mut [u8]) -> Result<usize, EncodeError> {
    // The first place is COBS's.
    let checked = out.get_mut(1..).ok_or(EncodeError::BufferTooSmall)?;
    let payload = match postcard::to_slice(envelope, checked) {
        Ok(payload) => payload,
        Err(postcard::Error::SerializeBufferFull) => return Err(EncodeError::BufferTooSmall),
        Err(_) => return Err(EncodeError::NotSerialisable),
    };
    let (length, checksum) = (payload.len(), CRC.checksum(payload).to_le_bytes());
    let end = checked.get_mut(length..).and_then(|rest| rest.first_chunk_mut());
    *end.ok_or(EncodeError::BufferTooSmall)? = checksum;
    stuff(out, length + CRC_LEN).ok_or(EncodeError::BufferTooSmall)
}

/// Takes the zeros out of so many bytes from the second on, by COBS, and ends them with one. The
/// frame's length; none where it does not fit.
fn stuff(out: &mut [u8], length: usize) -> Option<usize> {
    if length >= LONGEST_RUN {
        return stuff_long(out, length);
    }
    // No run is too long for a code: every zero, and the first place, takes the way to the next.
    let (frame, rest) = out.split_at_mut_checked(1 + length)?;
    *frame.first_mut()? = 0;
    let mut run = 1_u8;
    for byte in frame.iter_mut().rev() {
        if *byte == 0 {
            *byte = run;
            run = 1;
        } else {
            run += 1;
        }
    }
    *rest.first_mut()? = 0;
    Some(length + 2)
}

/// The same where a run may be too long for a code, and takes one more.
fn stuff_long(out: &mut [u8], length: usize) -> Option<usize> {
    // A place more for each such run: what is read stays ahead of what is written.
    let start = 1 + length / LONGEST_RUN;
    out.get(..start + length)?;
    out.copy_within(1..=length, start);
    let (mut code, mut write, mut run) = (0, 1, 1_u8);
    for read in start..start + length {
        let byte = *out.get(read)?;
        if byte != 0 {
            *out.get_mut(write)? = byte;
            write += 1;
            run += 1;
        }
        if byte == 0 || usize::from(run) > LONGEST_RUN {
            *out.get_mut(code)? = run;
            code = write;
            write += 1;
            run = 1;
        }
    }
    *out.get_mut(code)? = run;
    *out.get_mut(write)? = 0;
    Some(write + 1)
}

/// Why a frame was discarded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameError {
    /// The checksum differs, or the frame is too short to hold one.
    BadChecksum,
    /// The bytes between two zeros are not COBS: a part is missing.
    BadCobs,
    /// The checksum is right but the bytes are no message of this version, or bytes are left over
    /// after it.
    Malformed,
    /// No zero came within the longest frame.
    Oversize,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BadChecksum => "bad checksum",
            Self::BadCobs => "broken framing",
            Self::Malformed => "not a message of this protocol version",
            Self::Oversize => "longer than any frame",
        })
    }
}

impl core::error::Error for FrameError {}

/// What a decoder has seen since it was made. Frames without bytes (two zeros in a row) are counted
/// nowhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderCounters {
    /// Messages decoded.
    pub frames: u64,
    /// Frames with [`FrameError::BadChecksum`].
    pub bad_checksum: u64,
    /// Frames with [`FrameError::BadCobs`].
    pub bad_cobs: u64,
    /// Frames with [`FrameError::Malformed`].
    pub malformed: u64,
    /// Frames with [`FrameError::Oversize`].
    pub oversize: u64,
    /// Bytes of all bad frames, their zeros included.
    pub bytes_discarded: u64,
}

impl DecoderCounters {
    /// Number of frames discarded for whatever reason.
    #[must_use]
    pub fn bad_frames(&self) -> u64 {
        self.bad_checksum + self.bad_cobs + self.malformed + self.oversize
    }
}

/// Finds messages in a stream of bytes. `N` is the length of the longest frame that is accepted,
/// its zero included.
///
/// Whatever the bytes, it neither panics nor grows, and it is in step again after the next zero.
#[derive(Clone, Debug)]
pub struct Decoder<M, const N: usize = MAX_FRAME> {
    buffer: [u8; N],
    used: usize,
    /// Bytes since the last zero, those beyond the buffer included.
    since_zero: u64,
    counters: DecoderCounters,
    message: PhantomData<fn() -> M>,
}

impl<M: DeserializeOwned, const N: usize> Default for Decoder<M, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: DeserializeOwned, const N: usize> Decoder<M, N> {
    /// A decoder that waits for the first byte of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: [0; N],
            used: 0,
            since_zero: 0,
            counters: DecoderCounters {
                frames: 0,
                bad_checksum: 0,
                bad_cobs: 0,
                malformed: 0,
                oversize: 0,
                bytes_discarded: 0,
            },
            message: PhantomData,
        }
    }

    /// Takes one byte; the byte that ends a frame gives its message or why it was discarded.
    pub fn push(&mut self, byte: u8) -> Option<Result<Envelope<M>, FrameError>> {
        if byte != 0 {
            // The frame's zero takes the last place, so a buffer of N holds N − 1 bytes before it.
            if let Some(place) = self.buffer.get_mut(self.used).filter(|_| self.used + 1 < N) {
                *place = byte;
                self.used += 1;
            }
            self.since_zero = self.since_zero.saturating_add(1);
            return None;
        }
        let (used, bytes) = (self.used, self.since_zero);
        self.used = 0;
        self.since_zero = 0;
        if bytes == 0 {
            return None;
        }
        let result = if bytes > used as u64 { Err(FrameError::Oversize) } else { self.decode(used) };
        match &result {
            Ok(_) => self.counters.frames += 1,
            Err(error) => {
                *match error {
                    FrameError::BadChecksum => &mut self.counters.bad_checksum,
                    FrameError::BadCobs => &mut self.counters.bad_cobs,
                    FrameError::Malformed => &mut self.counters.malformed,
                    FrameError::Oversize => &mut self.counters.oversize,
                } += 1;
                self.counters.bytes_discarded = self.counters.bytes_discarded.saturating_add(bytes).saturating_add(1);
            }
        }
        Some(result)
    }

    fn decode(&mut self, used: usize) -> Result<Envelope<M>, FrameError> {
        let frame = self.buffer.get_mut(..used).ok_or(FrameError::Oversize)?;
        let length = cobs::decode_in_place(frame).map_err(|_| FrameError::BadCobs)?;
        let checked = frame.get(..length).ok_or(FrameError::BadCobs)?;
        let (payload, sent) = checked.split_last_chunk::<CRC_LEN>().ok_or(FrameError::BadChecksum)?;
        if CRC.checksum(payload) != u32::from_le_bytes(*sent) {
            return Err(FrameError::BadChecksum);
        }
        match postcard::take_from_bytes(payload) {
            Ok((envelope, [])) => Ok(envelope),
            _ => Err(FrameError::Malformed),
        }
    }

    /// What was seen until now.
    #[must_use]
    pub fn counters(&self) -> DecoderCounters {
        self.counters
    }

    /// Bytes since the last zero: those of a frame that has not ended yet.
    #[must_use]
    pub fn pending_bytes(&self) -> u64 {
        self.since_zero
    }

    /// Forgets the bytes of a frame that has not ended (after the link was opened anew), counting
    /// them as discarded.
    pub fn abandon(&mut self) {
        self.counters.bytes_discarded = self.counters.bytes_discarded.saturating_add(self.since_zero);
        self.used = 0;
        self.since_zero = 0;
    }
}

#[cfg(test)]
mod tests;

//! What lasts over a reset, in memory that nothing initialises: both counts with their zeros, and
//! the text of a panic.
//!
//! Such memory holds noise after power-on, and may be torn in the middle of being written. So all
//! of it goes by a checksum (CRC-32, as the frames'), and the counts, which are written at every
//! tick, go to two places in turn, each with a number: the newer one that is whole counts. All
//! numbers are little-endian.

use core::fmt::{self, Write};

use heapless::String;
use whirl_shared::codec::CRC;
use whirl_shared::frame::{MOST_ENCODERS, PANIC_LEN, Zero, ZeroSource};

use crate::zero::KeptEncoder;

/// Bytes of a place for counts.
pub const KEPT_LEN: usize = 4 + MOST_ENCODERS * ENCODER_LEN + 4;
const ENCODER_LEN: usize = 3 * 4 + 1;
/// Bytes of the place for a panic's text.
pub const NOTE_LEN: usize = 1 + PANIC_LEN + 4;

/// All encoders; places that a board has no encoder for are as by default.
pub type Kept = [KeptEncoder; MOST_ENCODERS];

/// The bytes of a place, written as number `number`.
#[must_use]
pub fn to_bytes(number: u32, kept: &Kept) -> [u8; KEPT_LEN] {
    let mut bytes = [0; KEPT_LEN];
    bytes[..4].copy_from_slice(&number.to_le_bytes());
    for (place, encoder) in bytes[4..KEPT_LEN - 4].chunks_exact_mut(ENCODER_LEN).zip(kept) {
        place[..4].copy_from_slice(&encoder.count.to_le_bytes());
        place[4..8].copy_from_slice(&encoder.zero.id.to_le_bytes());
        place[8..12].copy_from_slice(&encoder.zero.index.unwrap_or(0).to_le_bytes());
        let source = match encoder.zero.source {
            ZeroSource::PowerUp => 0,
            ZeroSource::Commanded => 1,
            ZeroSource::Carried => 2,
        };
        place[12] = source | u8::from(encoder.at_rest) << 2 | u8::from(encoder.zero.index.is_some()) << 3;
    }
    seal(&mut bytes);
    bytes
}

fn from_bytes(bytes: &[u8; KEPT_LEN]) -> Option<(u32, Kept)> {
    if !sealed(bytes) {
        return None;
    }
    let mut kept = Kept::default();
    for (place, encoder) in bytes[4..KEPT_LEN - 4].chunks_exact(ENCODER_LEN).zip(&mut kept) {
        let flags = place[12];
        *encoder = KeptEncoder {
            count: word(&place[..4]).cast_signed(),
            zero: Zero {
                id: word(&place[4..8]),
                source: match flags & 3 {
                    0 => ZeroSource::PowerUp,
                    1 => ZeroSource::Commanded,
                    2 => ZeroSource::Carried,
                    _ => return None,
                },
                index: (flags & 8 != 0).then(|| word(&place[8..12])),
            },
            at_rest: flags & 4 != 0,
        };
    }
    Some((word(&bytes[..4]), kept))
}

/// The newer of two places, if one is whole: its number and what it holds.
#[must_use]
pub fn newest(places: &[[u8; KEPT_LEN]; 2]) -> Option<(u32, Kept)> {
    match places.each_ref().map(from_bytes) {
        [Some(a), Some(b)] => Some(if b.0.wrapping_sub(a.0).cast_signed() > 0 { b } else { a }),
        [a, b] => a.or(b),
    }
}

/// A text of a panic: as much of the message as fits.
#[must_use]
pub fn note(message: impl fmt::Display) -> [u8; NOTE_LEN] {
    let mut text = Cut(String::new());
    // What does not fit is cut.
    let _ = write!(text, "{message}");
    let mut bytes = [0; NOTE_LEN];
    let length = text.0.len().min(PANIC_LEN);
    bytes[0] = length as u8;
    bytes[1..=length].copy_from_slice(&text.0.as_bytes()[..length]);
    seal(&mut bytes);
    bytes
}

/// The text of a note, if it is one.
#[must_use]
pub fn read_note(bytes: &[u8; NOTE_LEN]) -> Option<String<PANIC_LEN>> {
    if !sealed(bytes) {
        return None;
    }
    let text = bytes[1..=PANIC_LEN].get(..usize::from(bytes[0]))?;
    String::try_from(core::str::from_utf8(text).ok()?).ok()
}

/// A text that takes what fits; line ends become spaces, since a message is one line.
struct Cut(String<PANIC_LEN>);

impl Write for Cut {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            let character = if character.is_control() { ' ' } else { character };
            self.0.push(character).map_err(|_| fmt::Error)?;
        }
        Ok(())
    }
}

fn word(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte))
}

fn seal(bytes: &mut [u8]) {
    let end = bytes.len().saturating_sub(4);
    let sum = CRC.checksum(&bytes[..end]);
    bytes[end..].copy_from_slice(&sum.to_le_bytes());
}

fn sealed(bytes: &[u8]) -> bool {
    let end = bytes.len().saturating_sub(4);
    CRC.checksum(&bytes[..end]) == word(&bytes[end..])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(count: i32) -> Kept {
        let zero = Zero { id: 0xdead_beef, source: ZeroSource::Commanded, index: Some(4_095) };
        let mut kept = Kept::default();
        kept[0] = KeptEncoder { count, zero, at_rest: true };
        kept[MOST_ENCODERS - 1].count = -count;
        kept
    }

    #[test]
    fn the_newer_whole_place_counts() {
        for number in [5, u32::MAX] {
            let [a, b] = [to_bytes(number, &kept(1)), to_bytes(number.wrapping_add(1), &kept(2))];
            let newer = Some((number.wrapping_add(1), kept(2)));
            assert_eq!((newest(&[a, b]), newest(&[b, a])), (newer, newer));
            for torn in 0..KEPT_LEN {
                let mut damaged = b;
                damaged[torn] ^= 0x10;
                assert_eq!(newest(&[a, damaged]), Some((number, kept(1))));
                assert_eq!(newest(&[damaged, damaged]), None);
            }
        }
        // Memory after power-on; the sum of nothing but zeros is not zero.
        assert_eq!(newest(&[[0; KEPT_LEN], [0xff; KEPT_LEN]]), None);
    }

    #[test]
    fn every_zero_lasts_as_it_was() {
        for source in [ZeroSource::PowerUp, ZeroSource::Commanded, ZeroSource::Carried] {
            for (index, at_rest) in [(None, false), (None, true), (Some(0), false), (Some(u32::MAX), true)] {
                let encoder = |count| KeptEncoder { count, zero: Zero { id: 0x0102_0304, source, index }, at_rest };
                let kept = [0, 1, 2, 3, 4, 5].map(|i| encoder(if i == 0 { i32::MIN } else { 0x0506_0708 + i }));
                let place = to_bytes(9, &kept);
                assert_eq!(newest(&[place, [0; KEPT_LEN]]), Some((9, kept)), "{source:?} {index:?} {at_rest}");
            }
        }
    }

    #[test]
    fn a_panic_s_text_lasts_and_is_cut_to_a_line() {
        let bytes = note(format_args!("panicked at src/rig.rs:12:5:\n{}", "x".repeat(200)));
        let text = read_note(&bytes).unwrap();
        assert_eq!(text.len(), PANIC_LEN);
        assert!(text.starts_with("panicked at src/rig.rs:12:5: xxx"), "{text}");
        for place in 0..NOTE_LEN {
            let mut damaged = bytes;
            damaged[place] ^= 1;
            assert_eq!(read_note(&damaged), None);
        }
        // A character that does not fit whole is left out.
        let text = read_note(&note("é".repeat(60))).unwrap();
        assert_eq!(text.chars().count(), 40);
        assert_eq!(read_note(&[0; NOTE_LEN]), None);
        let mut long = [b'x'; NOTE_LEN];
        long[0] = PANIC_LEN as u8 + 1;
        seal(&mut long);
        assert_eq!(read_note(&long), None);
    }
}

//! Settings in flash that is erased page by page, worn evenly and safe against a power cut at any
//! write.
//!
//! Two pages. Each change is appended behind the last one as a record of its own; when a page is
//! full the other one is erased and takes the next. The record with the highest number whose
//! checksum is right counts. So a page is erased once in as many changes as two pages hold (64 for
//! pages of 2 kB: 10 000 erasures are 640 000 changes), and the newest whole record is never on the
//! page that is being erased.
//!
//! A record, little-endian: number u32, words, CRC-32 over both, padded to what the flash writes at
//! once. Its place counts as free where every byte reads 0xFF; a torn record is skipped like a
//! damaged one.

use embedded_storage::nor_flash::NorFlash;
use whirl_shared::codec::CRC;

use crate::adjust::{WORDS, Words};

/// Bytes of a record; a multiple of what any of the boards' flashes write at once (16 at most).
pub const RECORD: usize = (4 + 4 * WORDS + 4).next_multiple_of(16);

/// Why settings could not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError {
    /// Reading, writing or erasing failed.
    Flash,
    /// What was written reads otherwise.
    Verify,
}

/// The store: both pages, of the flash's erase size each, at `offset`.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
    offset: u32,
}

/// The newest record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Found {
    number: u32,
    words: Words,
    page: u32,
}

impl<F: NorFlash> Store<F> {
    const PAGE: u32 = F::ERASE_SIZE as u32;
    const PLACES: u32 = Self::PAGE / RECORD as u32;

    /// The store at an offset of the flash, which is a multiple of its erase size.
    pub fn new(flash: F, offset: u32) -> Self {
        Self { flash, offset }
    }

    fn address(&self, page: u32, place: u32) -> u32 {
        self.offset + page * Self::PAGE + place * RECORD as u32
    }

    fn read(&mut self, page: u32, place: u32) -> Option<[u8; RECORD]> {
        let mut bytes = [0; RECORD];
        self.flash.read(self.address(page, place), &mut bytes).ok()?;
        Some(bytes)
    }

    /// The newest record; none where there is none.
    fn newest(&mut self) -> Option<Found> {
        let mut newest: Option<Found> = None;
        for page in 0..2 {
            for place in 0..Self::PLACES {
                let Some(bytes) = self.read(page, place) else { continue };
                let Some((number, words)) = decode(&bytes) else { continue };
                if newest.is_none_or(|found| number > found.number) {
                    newest = Some(Found { number, words, page });
                }
            }
        }
        newest
    }

    /// The settings that were kept last.
    pub fn load(&mut self) -> Option<Words> {
        self.newest().map(|found| found.words)
    }

    /// The first place of a page behind which nothing is written.
    fn free(&mut self, page: u32) -> Option<u32> {
        let used = (0..Self::PLACES)
            .rev()
            .find(|&place| self.read(page, place).is_none_or(|bytes| bytes.iter().any(|&byte| byte != 0xff)));
        let free = used.map_or(0, |place| place + 1);
        (free < Self::PLACES).then_some(free)
    }

    /// Keeps settings. Nothing is written where they are those already kept.
    ///
    /// # Errors
    /// A flash that fails; what was kept before is then still there.
    pub fn save(&mut self, words: &Words) -> Result<(), StoreError> {
        let newest = self.newest();
        if newest.is_some_and(|found| found.words == *words) {
            return Ok(());
        }
        let number = newest.map_or(1, |found| found.number.wrapping_add(1));
        let page = newest.map_or(0, |found| found.page);
        let (page, place) = match self.free(page) {
            Some(place) => (page, place),
            None => {
                // Never the page with the newest record, where there is one.
                let other = if newest.is_some() { 1 - page } else { page };
                let from = self.address(other, 0);
                self.flash.erase(from, from + Self::PAGE).map_err(|_| StoreError::Flash)?;
                (other, 0)
            }
        };
        let bytes = encode(number, words);
        self.flash.write(self.address(page, place), &bytes).map_err(|_| StoreError::Flash)?;
        if self.read(page, place) == Some(bytes) { Ok(()) } else { Err(StoreError::Verify) }
    }

    /// The flash.
    pub fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }
}

fn encode(number: u32, words: &Words) -> [u8; RECORD] {
    let mut bytes = [0; RECORD];
    for (place, word) in bytes.chunks_exact_mut(4).zip([number].iter().chain(words)) {
        place.copy_from_slice(&word.to_le_bytes());
    }
    let end = 4 + 4 * WORDS;
    let sum = CRC.checksum(&bytes[..end]);
    bytes[end..end + 4].copy_from_slice(&sum.to_le_bytes());
    bytes
}

fn decode(bytes: &[u8; RECORD]) -> Option<(u32, Words)> {
    let word = |i: usize| u32::from_le_bytes([bytes[4 * i], bytes[4 * i + 1], bytes[4 * i + 2], bytes[4 * i + 3]]);
    let whole = CRC.checksum(&bytes[..4 + 4 * WORDS]) == word(1 + WORDS);
    whole.then(|| (word(0), core::array::from_fn(|i| word(1 + i))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_storage::nor_flash::{ErrorType, NorFlashErrorKind, ReadNorFlash};
    use std::vec::Vec;

    const PAGE: usize = 2_048;

    /// Two pages behind another one; the power goes after so many bytes written or erased.
    struct Flash {
        bytes: Vec<u8>,
        left: usize,
        erased: [u32; 3],
    }

    impl Flash {
        fn new(content: u8) -> Self {
            Self { bytes: std::vec![content; 3 * PAGE], left: usize::MAX, erased: [0; 3] }
        }

        fn spend(&mut self) -> Result<(), NorFlashErrorKind> {
            self.left = self.left.checked_sub(1).ok_or(NorFlashErrorKind::Other)?;
            Ok(())
        }
    }

    impl ErrorType for &mut Flash {
        type Error = NorFlashErrorKind;
    }

    impl ReadNorFlash for &mut Flash {
        const READ_SIZE: usize = 1;
        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
            bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
            Ok(())
        }
        fn capacity(&self) -> usize {
            self.bytes.len()
        }
    }

    impl NorFlash for &mut Flash {
        const WRITE_SIZE: usize = 8;
        const ERASE_SIZE: usize = PAGE;
        fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
            assert!(from.is_multiple_of(PAGE as u32) && to - from == PAGE as u32);
            self.erased[from as usize / PAGE] += 1;
            for place in from..to {
                self.spend()?;
                self.bytes[place as usize] = 0xff;
            }
            Ok(())
        }
        fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
            assert!(offset.is_multiple_of(8) && bytes.len().is_multiple_of(8));
            for (place, &byte) in self.bytes.split_at_mut(offset as usize).1.iter_mut().zip(bytes) {
                self.left = self.left.checked_sub(1).ok_or(NorFlashErrorKind::Other)?;
                assert_eq!(*place, 0xff, "written without being erased");
                *place = byte;
            }
            Ok(())
        }
    }

    fn words(n: u32) -> Words {
        core::array::from_fn(|i| n.wrapping_mul(31) + i as u32)
    }

    fn store(flash: &mut Flash) -> Store<&mut Flash> {
        Store::new(flash, PAGE as u32)
    }

    #[test]
    fn the_last_one_is_found_and_both_pages_wear_alike() {
        for content in [0xff, 0x5a, 0] {
            let mut flash = Flash::new(content);
            assert_eq!(store(&mut flash).load(), None);
            for n in 0..1_000 {
                store(&mut flash).save(&words(n)).unwrap();
                assert_eq!(store(&mut flash).load(), Some(words(n)));
                store(&mut flash).save(&words(n)).unwrap();
            }
            assert_eq!(flash.erased[0], 0);
            let places = PAGE / RECORD;
            assert!(flash.erased[1..].iter().all(|&n| (n as usize).abs_diff(500 / places) <= 1), "{:?}", flash.erased);
            assert!(flash.bytes[..PAGE].iter().all(|&byte| byte == content));
        }
    }

    #[test]
    fn a_power_cut_leaves_the_old_settings_or_the_new_ones() {
        let places = (PAGE / RECORD) as u32;
        // In the middle of a page, and where the other one is erased.
        for before in [1, 5, places, 2 * places, 2 * places + 1] {
            for left in (0..PAGE + RECORD).step_by(7) {
                let mut flash = Flash::new(0xff);
                (0..before).for_each(|n| store(&mut flash).save(&words(n)).unwrap());
                flash.left = left;
                let done = store(&mut flash).save(&words(before)).is_ok();
                flash.left = usize::MAX;
                let found = store(&mut flash).load();
                let allowed = [Some(words(before)), (!done).then(|| words(before - 1))];
                assert!(allowed.contains(&found), "{before} {left}: {found:?}");
                // And it goes on.
                store(&mut flash).save(&words(900)).unwrap();
                assert_eq!(store(&mut flash).load(), Some(words(900)));
            }
        }
    }

    #[test]
    fn a_damaged_record_is_passed_over() {
        let mut flash = Flash::new(0xff);
        (0..3).for_each(|n| store(&mut flash).save(&words(n)).unwrap());
        flash.bytes[PAGE + 2 * RECORD + 9] ^= 4;
        assert_eq!(store(&mut flash).load(), Some(words(1)));
    }
}

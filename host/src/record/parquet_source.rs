//! A Parquet file as the parquet crate reads it, with every size that the file claims checked
//! before memory is taken for it.
//!
//! The crate trusts three claims of a page header: its compressed length, its length once
//! decompressed and the number of values of a dictionary; a damaged byte there would make it
//! reserve gigabytes. Headers are therefore looked at here first (thrift compact protocol, the
//! fields in the order in which every writer puts them).

use std::fs::File;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::sync::{Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use parquet::errors::{ParquetError, Result};
use parquet::file::reader::{ChunkReader, Length};

/// Longest page once decompressed, bytes (writers aim at 1 MiB).
const PAGE_LIMIT: i64 = 1 << 28;
/// Longest page header read, bytes.
const HEADER_LIMIT: u64 = 4096;

/// The file and its length.
pub(super) struct Source {
    file: File,
    len: u64,
    /// Columns are decoded side by side, and the file has one place at which it is read.
    turn: Mutex<()>,
}

impl Source {
    pub(super) fn new(file: File) -> std::io::Result<Self> {
        let len = file.metadata()?.len();
        Ok(Self { file, len, turn: Mutex::new(()) })
    }

    pub(super) fn file(&self) -> &File {
        &self.file
    }

    fn turn(&self) -> MutexGuard<'_, ()> {
        // It guards no state that a panic could have left half done.
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A place of its own in a file that several threads read.
pub(super) struct Place<'a> {
    source: &'a Source,
    at: u64,
}

impl Source {
    /// From the file's first byte on.
    pub(super) fn place(&self) -> Place<'_> {
        Place { source: self, at: 0 }
    }
}

impl Read for Place<'_> {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        let _turn = self.source.turn();
        let mut file = &self.source.file;
        file.seek(SeekFrom::Start(self.at))?;
        let n = file.read(to)?;
        self.at += n as u64;
        Ok(n)
    }
}

impl Seek for Place<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let (base, by) = match to {
            SeekFrom::Start(at) => (at, 0),
            SeekFrom::End(by) => (self.source.len, by),
            SeekFrom::Current(by) => (self.at, by),
        };
        self.at = base.checked_add_signed(by).ok_or_else(|| std::io::Error::from(std::io::ErrorKind::InvalidInput))?;
        Ok(self.at)
    }
}

impl Length for Source {
    fn len(&self) -> u64 {
        self.len
    }
}

impl ChunkReader for Source {
    type T = Cursor<Vec<u8>>;

    /// The crate reads page headers through this, and nothing else.
    fn get_read(&self, start: u64) -> Result<Self::T> {
        let mut header = Vec::new();
        let _turn = self.turn();
        let mut file = &self.file;
        file.seek(SeekFrom::Start(start))?;
        file.take(HEADER_LIMIT).read_to_end(&mut header)?;
        check_header(&header)?;
        Ok(Cursor::new(header))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        if start.checked_add(length as u64).is_none_or(|end| end > self.len) {
            return Err(ParquetError::EOF(format!(
                "{length} bytes from byte {start} wanted, and the file has {}",
                self.len
            )));
        }
        let mut bytes = vec![0; length];
        let _turn = self.turn();
        let mut file = &self.file;
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes.into())
    }
}

/// Bytes of a file read at once, as the crate reads them.
pub(super) struct Held {
    /// Where they stand in the file.
    start: u64,
    bytes: Bytes,
}

impl Source {
    /// `length` bytes from `start` on, and up to `more` behind them.
    pub(super) fn hold(&self, start: u64, length: u64, more: u64) -> Result<Held> {
        let ends = start.checked_add(length).filter(|end| *end <= self.len);
        let Some(end) = ends else {
            return Err(ParquetError::EOF(format!(
                "{length} bytes from byte {start} wanted, and the file has {}",
                self.len
            )));
        };
        let end = end.saturating_add(more).min(self.len);
        let length = usize::try_from(end - start).map_err(|e| ParquetError::General(e.to_string()))?;
        Ok(Held { start, bytes: self.get_bytes(start, length)? })
    }
}

impl Held {
    /// The bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// At most `length` bytes from byte `start` of the file on.
    fn part(&self, start: u64, length: usize) -> Bytes {
        let from = start.checked_sub(self.start).and_then(|from| usize::try_from(from).ok());
        let from = from.unwrap_or(usize::MAX).min(self.bytes.len());
        self.bytes.slice(from..from.saturating_add(length).min(self.bytes.len()))
    }
}

impl Length for Held {
    fn len(&self) -> u64 {
        self.start + self.bytes.len() as u64
    }
}

impl ChunkReader for Held {
    type T = Cursor<Bytes>;

    fn get_read(&self, start: u64) -> Result<Self::T> {
        let header = self.part(start, HEADER_LIMIT as usize);
        check_header(&header)?;
        Ok(Cursor::new(header))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        let part = self.part(start, length);
        if part.len() < length {
            return Err(ParquetError::EOF(format!(
                "{length} bytes from byte {start} wanted, outside of their row group"
            )));
        }
        Ok(part)
    }
}

/// Checks the sizes in a page header: fields 1 to 3 (type, decompressed and compressed size), and
/// field 7.1 of a dictionary page.
fn check_header(header: &[u8]) -> Result<()> {
    let bad = |what: &str| Err(ParquetError::General(format!("page header: {what}")));
    let mut at = 0;
    let mut sizes = [0i64; 3];
    for size in &mut sizes {
        // 0x15: next field, 32-bit integer.
        if header.get(at) != Some(&0x15) {
            return bad("not as the format defines it");
        }
        at += 1;
        *size = match zigzag(header, &mut at) {
            Some(v) => v,
            None => return bad("a number that does not end"),
        };
    }
    let [kind, decompressed, compressed] = sizes;
    if !(0..=PAGE_LIMIT).contains(&decompressed) || !(0..=PAGE_LIMIT).contains(&compressed) {
        return bad(&format!(
            "a page of {decompressed} bytes ({compressed} compressed), at most {PAGE_LIMIT} are read"
        ));
    }
    if kind == 2 {
        // Dictionary page: an optional checksum (field 4), then field 7, a struct whose first field
        // is the number of values.
        let mut field = 3;
        if header.get(at) == Some(&0x15) {
            at += 1;
            field = 4;
            if zigzag(header, &mut at).is_none() {
                return bad("a checksum that does not end");
            }
        }
        if header.get(at) != Some(&(((7 - field) << 4) | 0x0c)) || header.get(at + 1) != Some(&0x15) {
            return bad("a dictionary page that is not as the format defines it");
        }
        at += 2;
        // The narrowest type that is read takes 4 bytes a value.
        if zigzag(header, &mut at).is_none_or(|n| n < 0 || n > decompressed / 4) {
            return bad("a dictionary with more values than bytes");
        }
    }
    Ok(())
}

/// A zigzag varint of at most 32 bits; `at` moves past it.
fn zigzag(bytes: &[u8], at: &mut usize) -> Option<i64> {
    let mut value = 0u64;
    for shift in [0, 7, 14, 21, 28] {
        let byte = *bytes.get(*at)?;
        *at += 1;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            // Below 2³⁵: both halves fit.
            return Some((value >> 1).cast_signed() ^ -((value & 1).cast_signed()));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_of_gigabytes_are_refused() {
        // Data page, 200 bytes decompressed, 100 compressed.
        assert!(check_header(&[0x15, 0, 0x15, 0x90, 0x03, 0x15, 0xc8, 0x01, 0x2c]).is_ok());
        // 2 GiB decompressed.
        assert!(check_header(&[0x15, 0, 0x15, 0xfe, 0xff, 0xff, 0xff, 0x0f, 0x15, 0x10]).is_err());
        // A dictionary of 2³⁰ values in 16 bytes.
        assert!(check_header(&[0x15, 4, 0x15, 32, 0x15, 32, 0x4c, 0x15, 0x80, 0x80, 0x80, 0x80, 0x08]).is_err());
        assert!(check_header(&[0x15, 4, 0x15, 32, 0x15, 32, 0x4c, 0x15, 8]).is_ok());
        assert!(check_header(&[]).is_err());
    }

    #[test]
    fn a_dictionary_behind_its_checksum_is_bounded_as_one_without() {
        // 16 bytes, and a checksum of three bytes before the number of values.
        let page =
            |values: &[u8]| [&[0x15, 4, 0x15, 32, 0x15, 32, 0x15, 0xfe, 0xff, 0x05, 0x3c, 0x15], values].concat();
        assert!(check_header(&page(&[8])).is_ok());
        for refused in [&[10][..], &[1], &[0x80, 0x80, 0x80, 0x80, 0x08]] {
            assert!(check_header(&page(refused)).is_err(), "{refused:?}");
        }
        // A checksum that does not end; no dictionary behind it; another field in its place.
        assert!(check_header(&[0x15, 4, 0x15, 32, 0x15, 32, 0x15, 0xff, 0xff, 0xff, 0xff, 0xff]).is_err());
        assert!(check_header(&[0x15, 4, 0x15, 32, 0x15, 32, 0x15, 2]).is_err());
        assert!(check_header(&[0x15, 4, 0x15, 32, 0x15, 32, 0x15, 2, 0x4c, 0x15, 8]).is_err());
    }

    #[test]
    fn zigzag_follows_the_format() {
        for (bytes, value) in [(vec![0u8], 0), (vec![1], -1), (vec![2], 1), (vec![0x80, 0x01], 64)] {
            let mut at = 0;
            assert_eq!(zigzag(&bytes, &mut at), Some(value));
            assert_eq!(at, bytes.len());
        }
        assert_eq!(zigzag(&[0xff; 8], &mut 0), None);
    }
}

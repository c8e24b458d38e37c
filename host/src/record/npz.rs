//! Records as NumPy archives (`.npz`, stored or deflated): see [`super::arrays`] for the arrays
//! that are expected.
//!
//! A ZIP archive (PKWARE's APPNOTE, 64-bit sizes included) of `.npy` files (NumPy's format 1.0 to
//! 3.0). Only the arrays that a rig names are read; their checksums are verified. Memory is that of
//! these arrays.
//!
//! *Why not a crate*: npyz 0.9 reads archives by zip 0.6 and brings its zstd and bzip2 libraries in
//! C, which NumPy does not write, and allocates what a header claims; what is needed of both
//! formats is this file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom};
use std::path::Path;

use flate2::Crc;
use flate2::read::DeflateDecoder;

use super::Record;
use super::arrays::{self, Array, Shape};
use super::formats::{Format, ReadOptions};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

pub(super) const FORMAT: Format = Format {
    id: "npz",
    about: "NumPy archive with arrays t and one a channel (.npz)",
    extensions: &["npz"],
    is: |head| head.starts_with(b"PK\x03\x04") || head.starts_with(b"PK\x05\x06"),
    columns: |path, _| {
        let (mut file, entries) = opened(path)?;
        let names: Vec<String> = entries.keys().cloned().collect();
        Ok(arrays::listed(&names, |name| of_archive(&mut file, &entries, path, name)))
    },
    read,
    stream: None,
};

/// Longest header of an array, bytes; most arrays of an archive.
const HEADER_LIMIT: u32 = 1 << 16;
const MOST_ARRAYS: u64 = 100_000;

/// Where an array stands.
#[derive(Clone, Copy, Debug)]
struct Entry {
    /// 0 stored, 8 deflated.
    method: u16,
    crc: u32,
    compressed: u64,
    size: u64,
    offset: u64,
}

fn damaged(path: &Path, place: &str, what: impl std::fmt::Display) -> BadInput {
    BadInput::new(format!("a truncated or damaged archive ({what})"), "a whole .npz")
        .in_file(path)
        .at(place.to_owned())
        .remedy("Copy the file again, or save it again with numpy.savez")
}

fn invalid(text: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidData, text.into())
}

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let (mut file, entries) = opened(path)?;
    let names: Vec<String> = entries.keys().cloned().collect();
    arrays::record(path, rig, &names, options, |name| of_archive(&mut file, &entries, path, name))
}

/// The file and its arrays.
fn opened(path: &Path) -> Result<(BufReader<File>, BTreeMap<String, Entry>)> {
    let io = |e: Error| BadInput::io(path, &e).remedy("Name a record that exists");
    let file = super::formats::open(path)?;
    let length = file.metadata().map_err(io)?.len();
    let mut file = BufReader::new(file);
    let entries = directory(&mut file, length).map_err(|e| damaged(path, "end of file", e))?;
    Ok((file, entries))
}

fn of_archive(file: &mut BufReader<File>, entries: &BTreeMap<String, Entry>, path: &Path, name: &str) -> Result<Array> {
    let place = format!("array {name}");
    let Some(entry) = entries.get(name) else { return Err(damaged(path, &place, "missing")) };
    array(file, *entry, path, name).map_err(|e| damaged(path, &place, e))?
}

/// Little-endian numbers in a slice; 0 beyond its end.
fn number(bytes: &[u8], at: usize, width: usize) -> u64 {
    let part = bytes.get(at..at + width).unwrap_or_default();
    part.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b))
}

/// The arrays of the archive, by name, from its central directory.
fn directory(file: &mut BufReader<File>, length: u64) -> IoResult<BTreeMap<String, Entry>> {
    let tail_length = length.min(66_000);
    file.seek(SeekFrom::Start(length - tail_length))?;
    let mut tail = Vec::new();
    file.take(tail_length).read_to_end(&mut tail)?;
    let end = (0..tail.len().saturating_sub(21))
        .rev()
        .find(|&i| tail[i..].starts_with(b"PK\x05\x06"))
        .ok_or_else(|| invalid("no end of the directory"))?;
    let (mut count, mut size, mut start) =
        (number(&tail, end + 10, 2), number(&tail, end + 12, 4), number(&tail, end + 16, 4));
    // The 64-bit end, where a locator points at one.
    if end >= 20 && tail[end - 20..].starts_with(b"PK\x06\x07") {
        file.seek(SeekFrom::Start(number(&tail, end - 12, 8)))?;
        let mut long = [0; 56];
        file.read_exact(&mut long)?;
        if !long.starts_with(b"PK\x06\x06") {
            return Err(invalid("no 64-bit end of the directory"));
        }
        (count, size, start) = (number(&long, 32, 8), number(&long, 40, 8), number(&long, 48, 8));
    }
    if count > MOST_ARRAYS || start.checked_add(size).is_none_or(|e| e > length) {
        return Err(invalid("a directory that does not fit into the file"));
    }
    file.seek(SeekFrom::Start(start))?;
    let mut bytes = Vec::new();
    file.take(size).read_to_end(&mut bytes)?;
    let (mut out, mut at) = (BTreeMap::new(), 0);
    for _ in 0..count {
        let head = bytes.get(at..).filter(|b| b.len() >= 46 && b.starts_with(b"PK\x01\x02"));
        let Some(head) = head else { return Err(invalid("a broken directory")) };
        let (name, extra) = (number(head, 28, 2) as usize, number(head, 30, 2) as usize);
        let text = String::from_utf8_lossy(head.get(46..46 + name).unwrap_or_default()).into_owned();
        let mut entry = Entry {
            method: number(head, 10, 2) as u16,
            crc: number(head, 16, 4) as u32,
            compressed: number(head, 20, 4),
            size: number(head, 24, 4),
            offset: number(head, 42, 4),
        };
        widen(&mut entry, head.get(46 + name..46 + name + extra).unwrap_or_default());
        if let Some(name) = text.strip_suffix(".npy") {
            out.insert(name.to_owned(), entry);
        }
        at += 46 + name + extra + number(head, 32, 2) as usize;
    }
    Ok(out)
}

/// Sizes of 64 bits from the extra field of type 1, for those that are all ones.
fn widen(entry: &mut Entry, mut extra: &[u8]) {
    while extra.len() >= 4 {
        let (kind, size) = (number(extra, 0, 2), number(extra, 2, 2) as usize);
        if kind == 1 {
            let mut at = 4;
            for value in [&mut entry.size, &mut entry.compressed, &mut entry.offset] {
                if *value == 0xffff_ffff && at + 8 <= 4 + size {
                    *value = number(extra, at, 8);
                    at += 8;
                }
            }
        }
        extra = extra.get(4 + size..).unwrap_or_default();
    }
}

/// Reads an array; the outer error is the file's, the inner one the array's.
fn array(file: &mut BufReader<File>, entry: Entry, path: &Path, name: &str) -> IoResult<Result<Array>> {
    file.seek(SeekFrom::Start(entry.offset))?;
    let mut local = [0; 30];
    file.read_exact(&mut local)?;
    if !local.starts_with(b"PK\x03\x04") {
        return Err(invalid("no array where the directory says"));
    }
    file.seek_relative((number(&local, 26, 2) + number(&local, 28, 2)) as i64)?;
    let part = file.take(entry.compressed);
    let inner: Box<dyn Read + '_> = match entry.method {
        0 => Box::new(part),
        8 => Box::new(DeflateDecoder::new(part)),
        other => return Err(invalid(format!("compression method {other}"))),
    };
    let mut reader = Checked { inner: inner.take(entry.size), crc: Crc::new() };
    let (kind, shape, _) = header(&mut reader)?;
    let place = format!("array {name}");
    let count = match Shape(shape).checked(path, name) {
        Ok(n) => n,
        Err(e) => return Ok(Err(e)),
    };
    let Some(decode) = Decode::of(&kind) else {
        let found = format!("values of type {}", super::formats::shown(kind.as_bytes()));
        return Ok(Err(BadInput::new(found, "numbers: float32, float64 or integers")
            .in_file(path)
            .at(place)
            .remedy("Convert the array with .astype(float) before it is saved")));
    };
    let values = decode.read(&mut reader, count)?;
    std::io::copy(&mut reader, &mut std::io::sink())?;
    if reader.crc.sum() != entry.crc {
        return Err(invalid("its checksum is wrong"));
    }
    Ok(Ok(values))
}

/// A reader that sums what passes.
struct Checked<R> {
    inner: R,
    crc: Crc,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> IoResult<usize> {
        let n = self.inner.read(buffer)?;
        self.crc.update(&buffer[..n]);
        Ok(n)
    }
}

/// Type and shape of a `.npy` file, and whether its columns follow each other.
pub(super) fn header(reader: &mut impl Read) -> IoResult<(String, Vec<u64>, bool)> {
    let mut start = [0; 8];
    reader.read_exact(&mut start)?;
    if !start.starts_with(b"\x93NUMPY") {
        return Err(invalid("not an array of NumPy"));
    }
    let mut length = [0; 4];
    reader.read_exact(&mut length[..if start[6] == 1 { 2 } else { 4 }])?;
    let length = u32::from_le_bytes(length);
    if length > HEADER_LIMIT {
        return Err(invalid(format!("a header of {length} bytes")));
    }
    let mut text = vec![0; length as usize];
    reader.read_exact(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    let after = |key: &str| {
        let from = text.find(key)? + key.len();
        Some(text[from..].trim_start().strip_prefix(':')?.trim_start())
    };
    let kind = after("'descr'").and_then(|r| {
        let r = r.strip_prefix('\'').unwrap_or(r);
        Some(r.get(..r.find(['\'', ','])?)?.to_owned())
    });
    let shape = after("'shape'").and_then(|r| {
        let inside = r.strip_prefix('(')?;
        let inside = &inside[..inside.find(')')?];
        inside.split(',').map(str::trim).filter(|s| !s.is_empty()).map(|s| s.parse::<u64>().ok()).collect()
    });
    match (kind, shape) {
        (Some(kind), Some(shape)) => Ok((kind, shape, after("'fortran_order'").is_some_and(|r| r.starts_with("True")))),
        _ => Err(invalid("a header without descr or shape")),
    }
}

/// How the bytes of a value are read.
pub(super) struct Decode {
    big: bool,
    kind: u8,
    width: usize,
}

impl Decode {
    /// From NumPy's type such as `<f8`.
    pub(super) fn of(text: &str) -> Option<Self> {
        let [order, kind, width] = text.as_bytes() else { return None };
        let width = usize::from(width.checked_sub(b'0')?);
        matches!(order, b'<' | b'>' | b'|' | b'=').then_some(())?;
        Self::new(*order == b'>', *kind, width)
    }

    /// Of values of so many bytes of a kind, `f`, `i` or `u`; none for those that are not read.
    pub(super) fn new(big: bool, kind: u8, width: usize) -> Option<Self> {
        let known = matches!((kind, width), (b'f', 4 | 8) | (b'i' | b'u', 1 | 2 | 4 | 8));
        known.then_some(Self { big, kind, width })
    }

    /// Bytes of a value.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Reads `count` values; room grows with what the file really holds.
    pub(super) fn read(&self, reader: &mut impl Read, count: usize) -> IoResult<Array> {
        let (mut integers, mut floats) = (Vec::new(), Vec::new());
        let (mut chunk, mut left) = (Vec::new(), count);
        while left > 0 {
            let now = left.min(1 << 14);
            chunk.resize(now * self.width, 0);
            reader.read_exact(&mut chunk)?;
            for bytes in chunk.chunks_exact(self.width) {
                let mut b = [0; 8];
                b[..self.width].copy_from_slice(bytes);
                if self.big {
                    b[..self.width].reverse();
                }
                let raw = u64::from_le_bytes(b);
                // Numbers of fewer bits: their sign is spread by shifting up and down again.
                let shift = 64 - 8 * self.width as u32;
                match (self.kind, self.width) {
                    (b'f', 4) => floats.push(f64::from(f32::from_bits(raw as u32))),
                    (b'f', _) => floats.push(f64::from_bits(raw)),
                    (b'i', _) => integers.push((raw << shift).cast_signed() >> shift),
                    _ => integers.push(i64::try_from(raw).unwrap_or(i64::MAX)),
                }
            }
            left -= now;
        }
        Ok(if self.kind == b'f' { Array::Floats(floats) } else { Array::Integers(integers) })
    }
}

#[cfg(test)]
#[path = "npz_tests.rs"]
mod tests;

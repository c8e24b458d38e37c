//! Records as MATLAB files of version 5 (`save` without option, `-v6`, `-v7`): see [`super::arrays`] for the variables that are expected.
//!
//! Layout after "MAT-File Format" (The MathWorks): a header of 128 bytes whose last two tell the byte order, then elements, each a tag (type,
//! size) and its bytes; an element of type 15 is another one compressed by zlib; one of type 14 is an array: flags, dimensions, name, real
//! part. Only the variables that a rig names are read, the others are stepped over. Memory is that of these variables.
//!
//! *Why not a crate*: matfile 0.5 inflates compressed elements without bound and unwraps on some input; matio-rs needs a C library.
//! Not read: version 4, version 7.3 (HDF5), structures, cells, sparse and complex arrays; each says so.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Take};
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::Record;
use super::arrays::{self, Array, Shape};
use super::formats::{Format, ReadOptions};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

pub(super) const FORMAT: Format = Format {
    id: "mat",
    about: "MATLAB file of version 5 with variables t and one a channel (.mat)",
    extensions: &["mat"],
    is: |head| head.starts_with(b"MATLAB ") && head.len() >= 128,
    columns: |path, _| {
        let (mut file, little, places) = opened(path)?;
        let names: Vec<String> = places.keys().cloned().collect();
        Ok(arrays::listed(&names, |name| of_file(&mut file, little, &places, path, name)))
    },
    read,
    stream: None,
};

const ARRAY: u32 = 14;
const COMPRESSED: u32 = 15;
/// Most variables of a file.
const MOST_VARIABLES: usize = 100_000;
/// Longest name, bytes.
const LONGEST_NAME: u32 = 1 << 10;
/// Most dimensions.
const MOST_DIMENSIONS: u32 = 32;

/// Where a variable stands.
#[derive(Clone, Copy, Debug)]
struct Place {
    offset: u64,
    size: u32,
    compressed: bool,
}

/// Reads numbers in the file's byte order.
struct Source<R> {
    reader: R,
    little: bool,
}

impl<R: Read> Source<R> {
    fn bytes<const N: usize>(&mut self) -> std::io::Result<[u8; N]> {
        let mut b = [0; N];
        self.reader.read_exact(&mut b)?;
        if !self.little {
            b.reverse();
        }
        Ok(b)
    }

    fn u32(&mut self) -> std::io::Result<u32> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    /// Type, size, and the four bytes of a small element where it is one.
    fn tag(&mut self) -> std::io::Result<(u32, u32, Option<[u8; 4]>)> {
        let first = self.u32()?;
        if first >> 16 != 0 {
            let mut data = [0; 4];
            self.reader.read_exact(&mut data)?;
            return Ok((first & 0xffff, (first >> 16).min(4), Some(data)));
        }
        Ok((first, self.u32()?, None))
    }

    fn skip(&mut self, count: u64) -> std::io::Result<()> {
        let copied = std::io::copy(&mut (&mut self.reader).take(count), &mut std::io::sink())?;
        if copied < count { Err(std::io::ErrorKind::UnexpectedEof.into()) } else { Ok(()) }
    }

    /// The bytes of a short element and its padding.
    fn short(&mut self, limit: u32) -> std::io::Result<(u32, Vec<u8>)> {
        let (kind, size, small) = self.tag()?;
        if let Some(data) = small {
            return Ok((kind, data[..size as usize].to_vec()));
        }
        if size > limit {
            return Err(invalid(format!("an element of {size} bytes where at most {limit} are")));
        }
        let mut data = vec![0; size as usize];
        self.reader.read_exact(&mut data)?;
        self.skip(u64::from(size.wrapping_neg() & 7))?;
        Ok((kind, data))
    }
}

fn invalid(text: String) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidData, text)
}

/// Class, whether complex, dimensions and name of an array.
struct Head {
    class: u8,
    complex: bool,
    shape: Shape,
    name: String,
}

fn head<R: Read>(s: &mut Source<R>) -> std::io::Result<Head> {
    let (_, flags) = s.short(16)?;
    let (_, dimensions) = s.short(4 * MOST_DIMENSIONS)?;
    let (_, name) = s.short(LONGEST_NAME)?;
    if flags.len() < 4 {
        return Err(invalid("an array without flags".to_owned()));
    }
    let flags = if s.little { [flags[0], flags[1]] } else { [flags[3], flags[2]] };
    let shape = dimensions
        .chunks_exact(4)
        .map(|b| {
            let mut b = [b[0], b[1], b[2], b[3]];
            if !s.little {
                b.reverse();
            }
            u64::from(u32::from_le_bytes(b))
        })
        .collect();
    Ok(Head {
        class: flags[0],
        complex: flags[1] & 0x08 != 0,
        shape: Shape(shape),
        name: String::from_utf8_lossy(&name).into_owned(),
    })
}

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let (mut file, little, places) = opened(path)?;
    let names: Vec<String> = places.keys().cloned().collect();
    arrays::record(path, rig, &names, options, |name| of_file(&mut file, little, &places, path, name))
}

/// The file, whether it is little-endian, and its variables.
fn opened(path: &Path) -> Result<(BufReader<File>, bool, BTreeMap<String, Place>)> {
    let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
    let file = super::formats::open(path)?;
    let length = file.metadata().map_err(io)?.len();
    let mut file = BufReader::new(file);
    let little = header(&mut file, path)?;
    let places = variables(&mut file, little, length, path)?;
    Ok((file, little, places))
}

fn of_file(
    file: &mut BufReader<File>,
    little: bool,
    places: &BTreeMap<String, Place>,
    path: &Path,
    name: &str,
) -> Result<Array> {
    match places.get(name) {
        Some(place) => variable(file, little, *place, path, name),
        None => Err(damaged(path, &format!("variable {name}"), "missing")),
    }
}

fn damaged(path: &Path, place: &str, what: impl std::fmt::Display) -> BadInput {
    BadInput::new(format!("a truncated or damaged file ({what})"), "a whole MATLAB file")
        .in_file(path)
        .at(place.to_owned())
        .remedy("Copy the file again, or save it again with save -v7")
}

/// Whether the file is little-endian.
fn header(file: &mut BufReader<File>, path: &Path) -> Result<bool> {
    let mut head = [0; 128];
    file.read_exact(&mut head).map_err(|e| damaged(path, "header", e))?;
    if head.starts_with(b"MATLAB 7.3") {
        return Err(BadInput::new("a MATLAB file of version 7.3 (HDF5)", "one of version 5")
            .in_file(path)
            .at("header")
            .remedy("Save it again with save -v7"));
    }
    let little = match &head[126..128] {
        b"IM" => true,
        b"MI" => false,
        _ => return Err(damaged(path, "header, byte 126", "no byte order")),
    };
    let version = if little { [head[124], head[125]] } else { [head[125], head[124]] };
    if version != [0, 1] {
        return Err(BadInput::new(format!("version {}.{}", version[1], version[0]), "version 1.0 (MATLAB 5)")
            .in_file(path)
            .at("header, byte 124")
            .remedy("Save it again with save -v7"));
    }
    Ok(little)
}

/// Every variable by name.
fn variables(file: &mut BufReader<File>, little: bool, length: u64, path: &Path) -> Result<BTreeMap<String, Place>> {
    let mut out = BTreeMap::new();
    let mut offset = 128;
    while offset < length {
        let at = format!("byte {offset}");
        let bad = |e: std::io::Error| damaged(path, &at, e);
        file.seek(SeekFrom::Start(offset)).map_err(bad)?;
        let (kind, size, small) = Source { reader: &mut *file, little }.tag().map_err(bad)?;
        let start = offset + 8;
        let end = start + if small.is_some() { 0 } else { u64::from(size) };
        if end > length {
            return Err(damaged(path, &at, format!("an element of {size} bytes, {} left", length - start.min(length))));
        }
        if kind == ARRAY || kind == COMPRESSED {
            let place = Place { offset: start, size, compressed: kind == COMPRESSED };
            let name = with_array(file, little, place, |s| Ok(head(s)?.name)).map_err(bad)?;
            out.insert(name, place);
        }
        // Compressed elements are not padded.
        offset = if kind == COMPRESSED { end } else { end + (end.wrapping_neg() & 7) };
        if out.len() > MOST_VARIABLES {
            return Err(damaged(path, &at, "too many variables"));
        }
    }
    Ok(out)
}

/// Runs `f` on the contents of an array, inflated where they are compressed.
fn with_array<T>(
    file: &mut BufReader<File>,
    little: bool,
    place: Place,
    f: impl FnOnce(&mut Source<Box<dyn Read + '_>>) -> std::io::Result<T>,
) -> std::io::Result<T> {
    file.seek(SeekFrom::Start(place.offset))?;
    let part: Take<&mut BufReader<File>> = file.take(u64::from(place.size));
    let reader: Box<dyn Read + '_> = if place.compressed { Box::new(ZlibDecoder::new(part)) } else { Box::new(part) };
    let mut source = Source { reader, little };
    if place.compressed {
        let (kind, _, _) = source.tag()?;
        if kind != ARRAY {
            return Err(invalid(format!("an element of type {kind} within a compressed one")));
        }
    }
    f(&mut source)
}

/// Reads a variable.
fn variable(file: &mut BufReader<File>, little: bool, place: Place, path: &Path, name: &str) -> Result<Array> {
    let at = format!("variable {name}");
    let outer = with_array(file, little, place, |s| {
        let head = head(s)?;
        Ok(checked(&head, path, name).map(|count| values(s, count)))
    });
    outer.map_err(|e| damaged(path, &at, e))??.map_err(|e| damaged(path, &at, e))
}

/// The number of values of an array that can be a channel.
fn checked(head: &Head, path: &Path, name: &str) -> Result<usize> {
    let what = match head.class {
        1 => "a cell array",
        2 => "a structure",
        3 => "an object",
        4 => "a text",
        5 => "a sparse array",
        6..=15 if head.complex => "a complex array",
        6..=15 => return head.shape.checked(path, name),
        _ => "something unknown",
    };
    Err(BadInput::new(what, "a vector of real numbers")
        .in_file(path)
        .at(format!("variable {name}"))
        .remedy("Save the vector itself as a variable of its own"))
}

/// The real part. Values are stored in the smallest type that holds them, whatever the array's class.
fn values<R: Read>(s: &mut Source<R>, count: usize) -> std::io::Result<Array> {
    let (kind, size, small) = s.tag()?;
    let width = match kind {
        1 | 2 => 1,
        3 | 4 => 2,
        5..=7 => 4,
        9 | 12 | 13 => 8,
        other => return Err(invalid(format!("values of type {other}"))),
    };
    if u64::from(size) != width as u64 * count as u64 {
        return Err(invalid(format!("{size} bytes for {count} values of {width} bytes")));
    }
    let mut chunk = small.map_or_else(Vec::new, |d| d[..size as usize].to_vec());
    let (mut integers, mut floats) = (Vec::new(), Vec::new());
    let mut left = count;
    while left > 0 {
        let now = left.min(1 << 16);
        if small.is_none() {
            chunk.resize(now * width, 0);
            s.reader.read_exact(&mut chunk)?;
        }
        for bytes in chunk.chunks_exact(width).take(now) {
            let mut b = [0; 8];
            b[..width].copy_from_slice(bytes);
            if !s.little {
                b[..width].reverse();
            }
            let [b0, b1, b2, b3, ..] = b;
            match kind {
                1 => integers.push(i64::from(b0.cast_signed())),
                2 => integers.push(i64::from(b0)),
                3 => integers.push(i64::from(i16::from_le_bytes([b0, b1]))),
                4 => integers.push(i64::from(u16::from_le_bytes([b0, b1]))),
                5 => integers.push(i64::from(i32::from_le_bytes([b0, b1, b2, b3]))),
                6 => integers.push(i64::from(u32::from_le_bytes([b0, b1, b2, b3]))),
                7 => floats.push(f64::from(f32::from_le_bytes([b0, b1, b2, b3]))),
                9 => floats.push(f64::from_le_bytes(b)),
                12 => integers.push(i64::from_le_bytes(b)),
                _ => integers.push(i64::try_from(u64::from_le_bytes(b)).unwrap_or(i64::MAX)),
            }
        }
        left -= now;
    }
    Ok(if matches!(kind, 7 | 9) { Array::Floats(floats) } else { Array::Integers(integers) })
}

#[cfg(test)]
#[path = "mat_tests.rs"]
mod tests;

//! Records as MATLAB files of version 5 (`save` without option, `-v6`, `-v7`): see
//! [`super::arrays`] for the variables that are expected.
//!
//! Layout after "MAT-File Format" (The MathWorks): a header of 128 bytes whose last two tell the
//! byte order, then elements, each a tag (type, size) and its bytes; an element of type 15 is
//! another one compressed by zlib; one of type 14 is an array: flags, dimensions, name, real part.
//! What stands in structures and cell arrays has the name by which MATLAB takes it out
//! ([`super::mat_walk`]). Only the variables that a rig names are read, the others are stepped
//! over. Memory is that of these variables.
//!
//! *Why not a crate*: matfile 0.5 inflates compressed elements without bound and unwraps on some
//! input; matio-rs needs a C library. Not read: version 4, objects (tables and timeseries among
//! them), sparse and complex arrays; each says so. Version 7.3: [`super::hdf5`].

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Take};
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::Record;
use super::arrays::{self, Array};
use super::formats::{Format, ReadOptions};
use super::mat_walk::{self, ARRAY, Head, Place, Source, head, invalid};
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

const COMPRESSED: u32 = 15;
/// Most variables of a file.
const MOST_VARIABLES: usize = 100_000;

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
        let (kind, size, small) = Source::new(&mut *file, little).tag().map_err(bad)?;
        let start = offset + 8;
        let end = start + if small.is_some() { 0 } else { u64::from(size) };
        if end > length {
            return Err(damaged(path, &at, format!("an element of {size} bytes, {} left", length - start.min(length))));
        }
        if kind == ARRAY || kind == COMPRESSED {
            let place = Place { offset: start, size, compressed: kind == COMPRESSED, inner: 0, column: None };
            let top = Place { inner: 0, ..place };
            with_array(file, little, top, |s| mat_walk::walk(s, place, None, 0, &mut out)).map_err(bad)?;
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
    let mut source = Source::new(reader, little);
    if place.compressed {
        let (kind, _, _) = source.tag()?;
        if kind != ARRAY {
            return Err(invalid(format!("an element of type {kind} within a compressed one")));
        }
        source.at = 0;
    }
    source.skip(place.inner)?;
    f(&mut source)
}

/// Reads a variable.
fn variable(file: &mut BufReader<File>, little: bool, place: Place, path: &Path, name: &str) -> Result<Array> {
    let at = format!("variable {name}");
    let outer = with_array(file, little, place, |s| {
        let head = head(s)?;
        Ok(checked(&head, place, path, name).map(|part| values(s, part)))
    });
    outer.map_err(|e| damaged(path, &at, e))??.map_err(|e| damaged(path, &at, e))
}

/// What can be a channel of an array, itself or one of its columns: how many values come before,
/// how many these are, and how many the array has.
fn checked(head: &Head, place: Place, path: &Path, name: &str) -> Result<[usize; 3]> {
    let (what, remedy) = match (head.class, place.column) {
        (1, _) => {
            ("an empty cell array, or one too deep within others", "Save the vector itself as a variable of its own")
        }
        (2, _) => {
            ("an empty structure, or one too deep within others", "Save the vector itself as a variable of its own")
        }
        (3 | 17, _) => (
            "an object",
            "Save what is in it: T = table2struct(T, \"ToScalar\", true) of a table, t = ts.Time and x = ts.Data of a timeseries",
        ),
        (4, _) => ("a text", "Save the vector itself as a variable of its own"),
        (5, _) => ("a sparse array", "Save it as full(x)"),
        (6..=15, _) if head.complex => ("a complex array", "Save its real part, real(x)"),
        (6..=15, None) => {
            let whole = head.shape.checked(path, name);
            return whole.map(|count| [0, count, count]).map_err(|e| match head.shape.columns() {
                Some(_) => e.remedy(format!("Name one of its columns: \"{name}(:,1)\"")),
                None => e,
            });
        }
        (6..=15, Some(k)) => {
            let (rows, columns) = head.shape.columns().unwrap_or((0, 0));
            // As many as fit into memory: the walk lists no others.
            return Ok([k * rows, rows, rows * columns]);
        }
        _ => ("something unknown", "Save the vector itself as a variable of its own"),
    };
    Err(BadInput::new(what, "a vector of real numbers").in_file(path).at(format!("variable {name}")).remedy(remedy))
}

/// The real part: `count` of its `all` values, behind those that are skipped. Values are stored in
/// the smallest type that holds them, whatever the array's class.
fn values<R: Read>(s: &mut Source<R>, [skipped, count, all]: [usize; 3]) -> std::io::Result<Array> {
    let (kind, size, small) = s.tag()?;
    let width = match kind {
        1 | 2 => 1,
        3 | 4 => 2,
        5..=7 => 4,
        9 | 12 | 13 => 8,
        other => return Err(invalid(format!("values of type {other}"))),
    };
    if u64::from(size) != width as u64 * all as u64 {
        return Err(invalid(format!("{size} bytes for {all} values of {width} bytes")));
    }
    let mut chunk = match small {
        Some(d) => d[(skipped * width).min(4)..((skipped + count) * width).min(4)].to_vec(),
        None => {
            s.skip(width as u64 * skipped as u64)?;
            Vec::new()
        }
    };
    let (mut integers, mut floats) = (Vec::new(), Vec::new());
    let mut left = count;
    while left > 0 {
        let now = left.min(1 << 16);
        if small.is_none() {
            chunk.resize(now * width, 0);
            s.exact(&mut chunk)?;
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

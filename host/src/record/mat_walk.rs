//! What stands within the variables of a MATLAB file: structures and cell arrays, by the names by
//! which MATLAB takes them out.
//!
//! `run.theta1` is a field, `run(2).theta1` that of an array of structures, `c{3}` a cell, `x(:,2)`
//! a column of a matrix that is higher than wide; all of these within each other. Nothing is kept
//! but where each of them begins, so that memory is that of the names.

use std::collections::BTreeMap;
use std::io::Read;

use super::arrays::Shape;

/// An element that holds an array.
pub(super) const ARRAY: u32 = 14;
/// Classes of arrays.
const CELL: u8 = 1;
const STRUCTURE: u8 = 2;
const OPAQUE: u8 = 17;
/// Longest name, bytes.
const LONGEST_NAME: u32 = 1 << 10;
/// Most dimensions.
const MOST_DIMENSIONS: u32 = 32;
/// Deepest structure within structures.
const DEEPEST: usize = 8;
/// Most names that one variable gives.
const MOST_NAMES: usize = 10_000;

/// Where a variable stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) offset: u64,
    pub(super) size: u32,
    pub(super) compressed: bool,
    /// Where an array within it begins, bytes from the start of what it holds, inflated; 0 for the
    /// variable itself.
    pub(super) inner: u64,
    /// The column, where it is one of a matrix.
    pub(super) column: Option<usize>,
}

/// Reads numbers in the file's byte order.
pub(super) struct Source<R> {
    reader: R,
    pub(super) little: bool,
    /// Bytes that were taken.
    pub(super) at: u64,
}

impl<R: Read> Source<R> {
    pub(super) fn new(reader: R, little: bool) -> Self {
        Self { reader, little, at: 0 }
    }

    /// Fills a buffer.
    pub(super) fn exact(&mut self, buffer: &mut [u8]) -> std::io::Result<()> {
        self.reader.read_exact(buffer)?;
        self.at += buffer.len() as u64;
        Ok(())
    }

    fn bytes<const N: usize>(&mut self) -> std::io::Result<[u8; N]> {
        let mut b = [0; N];
        self.exact(&mut b)?;
        if !self.little {
            b.reverse();
        }
        Ok(b)
    }

    pub(super) fn u32(&mut self) -> std::io::Result<u32> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    /// Type, size, and the four bytes of a small element where it is one.
    pub(super) fn tag(&mut self) -> std::io::Result<(u32, u32, Option<[u8; 4]>)> {
        let first = self.u32()?;
        if first >> 16 != 0 {
            let mut data = [0; 4];
            self.exact(&mut data)?;
            return Ok((first & 0xffff, (first >> 16).min(4), Some(data)));
        }
        Ok((first, self.u32()?, None))
    }

    pub(super) fn skip(&mut self, count: u64) -> std::io::Result<()> {
        let copied = std::io::copy(&mut (&mut self.reader).take(count), &mut std::io::sink())?;
        self.at += copied;
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
        self.exact(&mut data)?;
        self.skip(u64::from(size.wrapping_neg() & 7))?;
        Ok((kind, data))
    }
}

pub(super) fn invalid(text: String) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidData, text)
}

/// Class, whether complex, dimensions and name of an array.
pub(super) struct Head {
    pub(super) class: u8,
    pub(super) complex: bool,
    pub(super) shape: Shape,
    pub(super) name: String,
}

pub(super) fn head<R: Read>(s: &mut Source<R>) -> std::io::Result<Head> {
    let (_, flags) = s.short(16)?;
    let (_, dimensions) = s.short(4 * MOST_DIMENSIONS)?;
    let (_, name) = s.short(LONGEST_NAME)?;
    if flags.len() < 4 {
        return Err(invalid("an array without flags".to_owned()));
    }
    let flags = if s.little { [flags[0], flags[1]] } else { [flags[3], flags[2]] };
    if flags[0] == OPAQUE {
        // An object has its name where others have their sizes.
        let name = String::from_utf8_lossy(&dimensions).into_owned();
        return Ok(Head { class: flags[0], complex: false, shape: Shape(Vec::new()), name });
    }
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

/// Lists an array under its name, or what stands in it where it is a structure or a cell array.
/// `place` is where its variable stands; `name` that of an array within another one.
///
/// # Errors
/// An array that is not whole.
pub(super) fn walk<R: Read>(
    s: &mut Source<R>,
    place: Place,
    name: Option<String>,
    depth: usize,
    out: &mut BTreeMap<String, Place>,
) -> std::io::Result<()> {
    let place = Place { inner: s.at, ..place };
    let head = head(s)?;
    let name = name.unwrap_or_else(|| head.name.clone());
    let count = head.shape.0.iter().copied().fold(1, u64::saturating_mul);
    let inside = depth < DEEPEST && out.len() < MOST_NAMES && count > 0;
    match head.class {
        CELL if inside => {
            let called = |k: u64| format!("{name}{{{}}}", k + 1);
            parts(s, place, count, &called, depth, out)
        }
        STRUCTURE if inside => {
            let fields = fields(s)?;
            let called = |k: u64| {
                // Fewer fields than a name has bytes: the index fits.
                let (element, field) = (k / fields.len() as u64, (k % fields.len() as u64) as usize);
                let index = if count > 1 { format!("({})", element + 1) } else { String::new() };
                format!("{name}{index}.{}", fields[field])
            };
            parts(s, place, count.saturating_mul(fields.len() as u64), &called, depth, out)
        }
        _ => {
            if let Some((_, columns)) = head.shape.columns().filter(|_| matches!(head.class, 6..=15)) {
                for k in 0..columns {
                    out.insert(format!("{name}(:,{})", k + 1), Place { column: Some(k), ..place });
                }
            }
            out.insert(name, place);
            Ok(())
        }
    }
}

/// Names of a structure's fields.
fn fields<R: Read>(s: &mut Source<R>) -> std::io::Result<Vec<String>> {
    let (_, length) = s.short(8)?;
    let Some(b) = length.first_chunk::<4>() else {
        return Err(invalid("a structure without a length of names".to_owned()));
    };
    let length = if s.little { u32::from_le_bytes(*b) } else { u32::from_be_bytes(*b) };
    if length == 0 || length > LONGEST_NAME {
        return Err(invalid(format!("names of fields of {length} bytes")));
    }
    let (_, text) = s.short(LONGEST_NAME * MOST_NAMES as u32)?;
    let name = |bytes: &[u8]| {
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).into_owned()
    };
    // At most LONGEST_NAME: it fits.
    Ok(text.chunks_exact(length as usize).map(name).collect())
}

/// The arrays that follow each other in a structure or a cell array.
fn parts<R: Read>(
    s: &mut Source<R>,
    place: Place,
    count: u64,
    called: &dyn Fn(u64) -> String,
    depth: usize,
    out: &mut BTreeMap<String, Place>,
) -> std::io::Result<()> {
    for k in 0..count {
        if out.len() >= MOST_NAMES {
            break;
        }
        let (kind, size, _) = s.tag()?;
        if kind != ARRAY {
            return Err(invalid(format!("an element of type {kind} within {}", called(k))));
        }
        let end = s.at + u64::from(size);
        if size > 0 {
            walk(s, place, Some(called(k)), depth + 1, out)?;
        }
        let rest = end.checked_sub(s.at).ok_or_else(|| invalid(format!("{}, longer than it says", called(k))))?;
        s.skip(rest)?;
    }
    Ok(())
}

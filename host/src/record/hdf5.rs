//! Records as HDF5: MATLAB's files of version 7.3 (`save -v7.3`), and what h5py or another program
//! writes (`.h5`, `.hdf5`); see [`super::arrays`] for the arrays that are expected.
//!
//! In a MATLAB file arrays are called as MATLAB takes them out, as in [`super::mat_walk`]:
//! `run.theta1`, `run(2).theta1`, `c{3}`, `x(:,2)`. Elsewhere they have their path, `run/theta1`,
//! and columns of a matrix are called as in Python, `x[:,1]` (of GNU Octave's `save -hdf5` as in
//! MATLAB). Read are whole numbers and binary32 and binary64, whole or in chunks, deflated or not;
//! texts, compounds and what MATLAB keeps as objects are refused by name.
//!
//! The format is read by the crate hdf5-reader: read only, no C, every allocation bounded by its
//! options; it read every file that h5py, hdf5storage and Octave wrote for us. *Others looked at*:
//! hdf5-pure 0.47 reads as well but is four times as large, its greater part a writer; hdf5-metno
//! and rust-hdf5 need the C library; hdf5-rust 2 reads no chunks. It runs under `catch_unwind`, as
//! Parquet's does. Memory is that of the arrays read and once that of the largest; a file that
//! claims more than it could hold deflated is refused before anything is made room for.

use std::collections::BTreeMap;
use std::panic::AssertUnwindSafe;
use std::path::Path;

use hdf5_reader::error::ByteOrder;
use hdf5_reader::group::Group;
use hdf5_reader::{Dataset, Datatype, Hdf5File, OpenOptions};

use super::arrays::{self, Array, Shape};
use super::formats::{Format, ReadOptions, open};
use super::npz::Decode;
use super::rows::ROW_LIMIT;
use super::{Record, quiet};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

pub(super) const FORMAT: Format = Format {
    id: "hdf5",
    about: "HDF5, MATLAB's of version 7.3 among it, with arrays t and one a channel (.mat, .h5, .hdf5)",
    extensions: &["h5", "hdf5"],
    is: |head| head.starts_with(b"\x89HDF\r\n\x1a\n") || head.starts_with(b"MATLAB 7.3 "),
    columns: |path, _| {
        let mut found = Found::open(path)?;
        let names: Vec<String> = found.arrays.keys().cloned().collect();
        Ok(arrays::listed(&names, |name| found.array(path, name)))
    },
    read,
    stream: None,
};

/// Most arrays of a file; deepest group within groups.
const MOST_ARRAYS: usize = 10_000;
const DEEPEST: usize = 8;
/// Most bytes of a chunk, inflated: writers make chunks of a few MiB at most.
const CHUNK: usize = 64 << 20;
/// By how much zlib makes anything smaller at most, and what a file may claim beside that, bytes.
const DEFLATED: u64 = 1100;
const LEAST: u64 = 1 << 16;

/// An array, or a column of a matrix.
struct Place {
    dataset: Dataset,
    column: Option<usize>,
    /// Whether one column follows the other, as in MATLAB and Octave; everywhere else rows do.
    by_columns: bool,
}

/// The arrays of a file.
struct Found {
    arrays: BTreeMap<String, Place>,
    matlab: bool,
    /// Length of the file, bytes.
    length: u64,
    /// The matrix that was read last, with its address: its columns are asked for one after
    /// another.
    matrix: Option<(u64, Vec<u8>)>,
}

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let mut found = Found::open(path)?;
    let names: Vec<String> = found.arrays.keys().cloned().collect();
    arrays::record(path, rig, &names, options, |name| found.array(path, name))
}

fn damaged(path: &Path, place: &str, what: impl std::fmt::Display) -> BadInput {
    BadInput::new(
        format!("a truncated or damaged file, or what this reader does not know ({what})"),
        "a whole HDF5 file",
    )
    .in_file(path)
    .at(place.to_owned())
    .remedy("Copy the file again; save it again with save -v7 (MATLAB) or with numbers in plain datasets")
}

/// Runs the reader's code; a panic of it is a damaged file.
fn guarded<T>(path: &Path, place: &str, f: impl FnOnce() -> hdf5_reader::error::Result<T>) -> Result<T> {
    quiet::catch(AssertUnwindSafe(f))
        .unwrap_or_else(|| Err(hdf5_reader::error::Error::InvalidData("nonsense in its structure".to_owned())))
        .map_err(|e| damaged(path, place, e))
}

impl Found {
    fn open(path: &Path) -> Result<Self> {
        let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
        let file = open(path)?;
        let length = file.metadata().map_err(io)?.len();
        let mut start = [0; 10];
        std::io::Read::read_exact(&mut &file, &mut start).map_err(|e| damaged(path, "start of file", e))?;
        drop(file);
        let matlab = start.starts_with(b"MATLAB 7.3");
        let options = OpenOptions {
            chunk_cache_bytes: 0,
            max_chunk_bytes: CHUNK,
            max_read_bytes: usize::try_from(length.saturating_mul(DEFLATED).saturating_add(LEAST))
                .unwrap_or(usize::MAX),
            ..OpenOptions::default()
        };
        let arrays = guarded(path, "start of file", || {
            let root = Hdf5File::open_with_options(path, options)?.root_group()?;
            let mut walk = Walk { references: None, matlab, arrays: BTreeMap::new() };
            if matlab {
                walk.references = root.group("#refs#").ok();
            }
            walk.group(&root, "", 0)?;
            Ok(walk.arrays)
        })?;
        Ok(Self { arrays, matlab, length, matrix: None })
    }

    fn array(&mut self, path: &Path, name: &str) -> Result<Array> {
        let place = format!("array {name}");
        let Some(Place { dataset, column, by_columns }) = self.arrays.get(name) else {
            return Err(damaged(path, &place, "missing"));
        };
        let class = if self.matlab { class(dataset) } else { None };
        let bad = |what: &str, remedy: &str| {
            Err(BadInput::new(what, "a vector of real numbers").in_file(path).at(place.clone()).remedy(remedy))
        };
        let alone = "Save the vector itself as an array of its own";
        match class.as_deref() {
            Some("char") => return bad("a text", alone),
            Some("cell" | "struct") => {
                return bad("an empty structure or cell array, or one too deep within others", alone);
            }
            Some(
                "double" | "single" | "logical" | "int8" | "uint8" | "int16" | "uint16" | "int32" | "uint32" | "int64"
                | "uint64",
            )
            | None => {}
            Some(_) => {
                return bad(
                    "an object",
                    "Save what is in it: T = table2struct(T, \"ToScalar\", true) of a table, t = ts.Time and x = ts.Data of a timeseries",
                );
            }
        }
        let Some(decode) = decode(dataset.dtype()) else {
            let what = match dataset.dtype() {
                Datatype::Compound { .. } if self.matlab => "complex numbers",
                Datatype::Compound { .. } => "a table of several fields",
                Datatype::String { .. } | Datatype::VarLen { .. } => "texts",
                Datatype::Reference { .. } => "references",
                _ => "values of another type",
            };
            return bad(what, "Save numbers, float32, float64 or integers, each column as an array of its own");
        };
        // Where MATLAB says that it is empty, its sizes stand in the array's place.
        if self.matlab && dataset.attribute("MATLAB_empty").and_then(|a| a.read_as_f64()).is_ok_and(|e| e != 0.0) {
            return Ok(Array::Floats(Vec::new()));
        }
        let mut sizes = dataset.shape().to_vec();
        if *by_columns {
            sizes.reverse();
        }
        let shape = Shape(sizes);
        let count = match column {
            Some(_) => 0,
            None => shape.checked(path, name).map_err(|e| match columns(dataset, *by_columns) {
                Some(_) => e.remedy(format!("Name one of its columns: \"{}\"", column_name(name, 0, *by_columns))),
                None => e,
            })?,
        };
        let bytes = guarded(path, &place, || dataset.raw_byte_len())?;
        if bytes as u64 > self.length.saturating_mul(DEFLATED).saturating_add(LEAST) {
            return Err(damaged(path, &place, format!("{bytes} bytes of values in a file of {}", self.length)));
        }
        let (Some(k), Some((rows, wide))) = (*column, columns(dataset, *by_columns)) else {
            let raw = guarded(path, &place, || dataset.read_raw_bytes())?;
            return decode.read(&mut raw.as_slice(), count).map_err(|e| damaged(path, &place, e));
        };
        if self.matrix.as_ref().is_none_or(|(address, _)| *address != dataset.address()) {
            let raw = guarded(path, &place, || dataset.read_raw_bytes())?;
            self.matrix = Some((dataset.address(), raw));
        }
        let raw = self.matrix.as_ref().map_or(&[][..], |(_, raw)| raw);
        let width = decode.width();
        let one: Vec<u8> = if *by_columns {
            raw.chunks_exact(rows * width).nth(k).unwrap_or_default().to_vec()
        } else {
            raw.chunks_exact(wide * width).flat_map(|row| &row[k * width..][..width]).copied().collect()
        };
        decode.read(&mut one.as_slice(), rows).map_err(|e| damaged(path, &place, e))
    }
}

/// Lists arrays.
struct Walk {
    /// Where MATLAB keeps what stands in cells and in arrays of structures.
    references: Option<Group>,
    matlab: bool,
    arrays: BTreeMap<String, Place>,
}

impl Walk {
    fn group(&mut self, group: &Group, name: &str, depth: usize) -> hdf5_reader::error::Result<()> {
        if depth > DEEPEST {
            return Ok(());
        }
        let separator = if self.matlab { '.' } else { '/' };
        let called = |child: &str| if name.is_empty() { child.to_owned() } else { format!("{name}{separator}{child}") };
        let (groups, datasets) = group.member_names()?;
        // Octave wraps each variable into a group: its type, its value.
        if !self.matlab && group.attribute("OCTAVE_NEW_FORMAT").is_ok() && datasets.iter().any(|d| d == "value") {
            return self.dataset(group.dataset("value")?, name.to_owned(), true, None, depth);
        }
        for child in datasets {
            if self.arrays.len() >= MOST_ARRAYS {
                return Ok(());
            }
            let dataset = group.dataset(&child)?;
            let field = (!name.is_empty()).then_some((name, child.as_str()));
            self.dataset(dataset, called(&child), self.matlab, field, depth)?;
        }
        for child in groups {
            if !(self.matlab && child.starts_with('#')) {
                self.group(&group.group(&child)?, &called(&child), depth + 1)?;
            }
        }
        Ok(())
    }

    /// Lists a dataset; one of references as what these stand for. `field`: the structure and the
    /// field that it is.
    fn dataset(
        &mut self,
        dataset: Dataset,
        name: String,
        by_columns: bool,
        field: Option<(&str, &str)>,
        depth: usize,
    ) -> hdf5_reader::error::Result<()> {
        let references = matches!(dataset.dtype(), Datatype::Reference { size: 8, .. });
        if let (true, Some(within)) = (references && depth <= DEEPEST, self.references.clone()) {
            let cell = class(&dataset).as_deref() == Some("cell");
            let count = dataset.num_elements()?;
            if count > MOST_ARRAYS as u64 {
                return Ok(());
            }
            let raw = dataset.read_raw_bytes()?;
            for (k, bytes) in raw.chunks_exact(8).enumerate() {
                let mut b = [0; 8];
                b.copy_from_slice(bytes);
                let Some(child) = within.child_name_by_address(u64::from_le_bytes(b))? else { continue };
                let called = match field {
                    Some((structure, field)) if !cell => format!("{structure}({}).{field}", k + 1),
                    _ => format!("{name}{{{}}}", k + 1),
                };
                match within.dataset(&child) {
                    Ok(inner) => self.dataset(inner, called, by_columns, None, depth + 1)?,
                    Err(_) => self.group(&within.group(&child)?, &called, depth + 1)?,
                }
            }
            return Ok(());
        }
        if decode(dataset.dtype()).is_some()
            && let Some((_, wide)) = columns(&dataset, by_columns)
        {
            for k in 0..wide {
                let place = Place { dataset: dataset.clone(), column: Some(k), by_columns };
                self.arrays.insert(column_name(&name, k, by_columns), place);
            }
        }
        self.arrays.insert(name, Place { dataset, column: None, by_columns });
        Ok(())
    }
}

fn column_name(name: &str, k: usize, by_columns: bool) -> String {
    if by_columns { format!("{name}(:,{})", k + 1) } else { format!("{name}[:,{k}]") }
}

/// Rows and columns of a matrix; where columns follow each other they are the other way round in
/// the file.
fn columns(dataset: &Dataset, by_columns: bool) -> Option<(usize, usize)> {
    let mut sizes = dataset.shape().to_vec();
    if by_columns {
        sizes.reverse();
    }
    Shape(sizes).columns().filter(|(rows, wide)| rows.saturating_mul(*wide) <= ROW_LIMIT)
}

/// MATLAB's class of an array.
fn class(dataset: &Dataset) -> Option<String> {
    dataset.attribute("MATLAB_class").and_then(|a| a.read_string()).ok()
}

/// How values are read; none for what are no numbers.
fn decode(kind: &Datatype) -> Option<Decode> {
    let big = |order: &ByteOrder| matches!(order, ByteOrder::BigEndian);
    match kind {
        Datatype::FixedPoint { size, signed, byte_order } => {
            Decode::new(big(byte_order), if *signed { b'i' } else { b'u' }, usize::from(*size))
        }
        Datatype::FloatingPoint { size, byte_order } => Decode::new(big(byte_order), b'f', usize::from(*size)),
        _ => None,
    }
}

#[cfg(test)]
#[path = "hdf5_tests.rs"]
mod tests;

//! The columns of a Parquet row group: opened, verified where it is whirl's own, and decoded side
//! by side.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use parquet::column::page::PageReader;
use parquet::column::reader::{ColumnReader, get_column_reader};
use parquet::errors::ParquetError;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::SerializedPageReader;
use parquet::schema::types::ColumnDescriptor;
use rayon::prelude::*;

use super::parquet_cells::{Cells, decode};
use super::parquet_recovery::{checked_range, extent};
use super::parquet_source::Source;
use super::parquet_structure::{Columns, Structure, verify};
use super::quiet;
use super::rows::Rows;
use crate::error::{BadInput, Result};

/// Rows read at once: what is decoded beside the record itself.
pub(super) const PART: usize = 1 << 16;
/// Longest row group read at once, bytes.
const HELD: u64 = 1 << 24;
/// What is read with it of what stands behind it: longer than the marker of any rig.
const MARKER: u64 = 1 << 14;

/// A column of a row group.
pub(super) struct Chunk {
    reader: ColumnReader,
    descriptor: Arc<ColumnDescriptor>,
}

/// Why a row group could not be read.
pub(super) enum Failure {
    /// The file is damaged from here on.
    File(String),
    /// A value in it is wrong.
    Bad(Box<BadInput>),
}

impl Failure {
    /// It, as part of a sentence.
    pub(super) fn reason(&self) -> String {
        match self {
            Self::File(why) => why.clone(),
            Self::Bad(e) => {
                let place = e.place.as_deref().unwrap_or_default();
                format!("{place}: found {}, expected {}", e.found, e.expected)
            }
        }
    }
}

/// What the crate says of a file, without its own name before it.
pub(super) fn words(error: &ParquetError) -> String {
    let text = error.to_string();
    let text = text.strip_prefix("Parquet error: ").unwrap_or(&text);
    match text.trim_start_matches("Invalid Parquet file. ") {
        "Corrupt footer" => "the file does not end as a whole one does".to_owned(),
        words => words.to_owned(),
    }
}

impl From<ParquetError> for Failure {
    fn from(e: ParquetError) -> Self {
        Self::File(words(&e))
    }
}

impl From<BadInput> for Failure {
    fn from(e: BadInput) -> Self {
        Self::Bad(Box::new(e))
    }
}

/// Opens some columns of a row group.
pub(super) fn open_group(
    source: &Arc<Source>,
    structure: &Structure,
    columns: &[usize],
    index: usize,
) -> core::result::Result<Vec<Chunk>, Failure> {
    let verified = &structure.groups[index];
    let group = &verified.metadata;
    // One small enough is read at once: page by page takes longer than decoding does.
    let held = match extent(group) {
        Some((start, length)) if length <= HELD => Some(Arc::new(source.hold(start, length, MARKER)?)),
        _ => None,
    };
    verify(source, held.as_deref(), verified, structure.written_by_whirl).map_err(Failure::File)?;
    let mut chunks = Vec::new();
    for column in columns {
        let chunk = group.columns().get(*column).ok_or_else(|| Failure::File("a column is missing".to_owned()))?;
        if checked_range(chunk).is_none() {
            return Err(Failure::File("a column chunk outside of the file".to_owned()));
        }
        let rows = rows_in(group)?;
        let pages: Box<dyn PageReader> = match &held {
            Some(held) => Box::new(SerializedPageReader::new(held.clone(), chunk, rows, None)?),
            None => Box::new(SerializedPageReader::new(source.clone(), chunk, rows, None)?),
        };
        let descriptor = chunk.column_descr_ptr();
        chunks.push(Chunk { reader: get_column_reader(descriptor.clone(), pages), descriptor });
    }
    Ok(chunks)
}

/// Rows that a row group says it has.
pub(super) fn rows_in(group: &RowGroupMetaData) -> core::result::Result<usize, Failure> {
    usize::try_from(group.num_rows()).map_err(|_| Failure::File("a negative number of rows".to_owned()))
}

/// Runs code of the parquet crate on whatever thread it is given to: a panic is caught on that
/// thread, where it can be kept quiet.
pub(super) fn caught<T>(f: impl FnOnce() -> core::result::Result<T, Failure>) -> core::result::Result<T, Failure> {
    quiet::catch(AssertUnwindSafe(f)).unwrap_or_else(|| Err(Failure::File("a damaged page".to_owned())))
}

/// The next `count` rows of some columns, decoded side by side: t, the channels, the device's.
pub(super) fn decode_all(
    chunks: &mut [Chunk],
    count: usize,
    columns: &Columns,
) -> core::result::Result<Vec<Cells>, Failure> {
    let decoded: Vec<core::result::Result<Cells, Failure>> =
        chunks.par_iter_mut().map(|chunk| caught(|| decode(&mut chunk.reader, &chunk.descriptor, count))).collect();
    let mut cells = decoded.into_iter().collect::<core::result::Result<Vec<_>, _>>()?;
    if let Some(rate) = columns.rate {
        // As it was written: see ParquetWriter::push.
        let Some(Cells::Integers(tick)) = cells.get(columns.channels.len()) else {
            return Err(Failure::File("a column tick without ticks".to_owned()));
        };
        let t = tick.iter().map(|tick| *tick as f64 / rate).collect();
        cells.insert(0, Cells::Reals(t));
    }
    Ok(cells)
}

/// Reads the next `count` rows of a row group's columns: t, the channels, the device's.
pub(super) fn read_part(
    chunks: &mut [Chunk],
    count: usize,
    columns: &Columns,
    rows: &mut Rows<'_>,
) -> core::result::Result<(), Failure> {
    let mut left = count;
    while left > 0 {
        let now = left.min(PART);
        take(decode_all(chunks, now, columns)?, columns.channels.len(), rows)?;
        left -= now;
    }
    Ok(())
}

/// Takes a run of rows, column by column: t, the channels, the device's.
pub(super) fn take(columns: Vec<Cells>, channels: usize, rows: &mut Rows<'_>) -> Result<()> {
    let before = rows.t.len();
    let first = rows.passed + before;
    for (k, cells) in columns.into_iter().enumerate() {
        if k == 0 {
            rows.take_times(first, cells)?;
            rows.resume(before);
        } else if k <= channels {
            rows.take_channel(first, k - 1, cells)?;
        } else {
            rows.take_device(first, k - 1 - channels, cells)?;
        }
    }
    Ok(())
}

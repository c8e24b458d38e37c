//! Records as Parquet: whirl's own ([`super::parquet_write`]) and anybody's with a column `t` and the rig's columns.
//!
//! - `t`: DOUBLE or FLOAT in seconds, an integer in seconds, or a timestamp. Channels: 32- or 64-bit integers, FLOAT or DOUBLE; a
//!   null or NaN is a gap. Compression: none or Snappy. Nested columns are not read.
//! - Row groups of up to 16 MiB are read at once. In a file as whirl wrote it `t` is not decoded but follows from the ticks, as it was made.
//! - A record of whirl's own brings its ticks, the drive's phase, its metadata and losses. Its row groups carry checksums,
//!   which are verified; without a footer it is read up to the last whole row group ([`ReadOptions::recover`]).
//!
//! The parquet crate is guarded in two ways: sizes are checked before it sees them ([`super::parquet_source`]), and it runs under
//! `catch_unwind`, since it panics on some damaged input (seen: an encoding that it does not know; 2 of 15 000 mutated files).
//! Memory is that of the columns read, or of a block of rows where they are streamed ([`super::stream`]): every column of a row group is then
//! decoded page by page beside the others.

use std::fs::File;
use std::io::Cursor;
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::Arc;

use parquet::column::page::PageReader;
use parquet::column::reader::{ColumnReader, get_column_reader};
use parquet::errors::ParquetError;
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use parquet::file::reader::SerializedPageReader;
use parquet::schema::types::{ColumnDescriptor, SchemaDescriptor};
use rayon::prelude::*;

use super::csv::OWN_COLUMNS;
use super::formats::{Format, ReadOptions};
use super::parquet_cells::{Cells, decode};
use super::parquet_recovery::{Marker, checked_range, crc_of_range, crc32, extent, marker_at, scan};
use super::parquet_source::{Held, Source as ParquetSource};
use super::parquet_write::KEY;
use super::rows::{Rows, missing_column};
use super::stream::{Source, Streamed};
use super::{Losses, Metadata, Record, quiet, segments};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

pub(super) const FORMAT: Format = Format {
    id: "parquet",
    about: "Parquet, whirl's own or with a column t in seconds (.parquet)",
    extensions: &["parquet", "pq"],
    is: |head| head.starts_with(b"PAR1"),
    read,
    stream: Some(Streamed { open, rows: rows_of }),
};

/// What is read from a file before its rows.
struct Structure {
    schema: Arc<SchemaDescriptor>,
    groups: Vec<RowGroupMetaData>,
    /// For a file without footer: the checksums from its markers.
    checksums: Option<Vec<u32>>,
    metadata: Option<Metadata>,
    losses: Option<Losses>,
    /// The file itself is whirl's, and not rewritten by another program that kept the metadata: it has markers.
    written_by_whirl: bool,
    /// Why the footer could not be read.
    truncated: Option<String>,
}

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let mut reader = Reader::open(path, rig, options)?;
    let mut rows = Rows::new(path, rig, "row", reader.own);
    rows.resample = options.resample;
    rows.reserve(reader.structure.groups.iter().filter_map(|g| rows_in(g).ok()).fold(0, usize::saturating_add));
    // A whole row group at a time, so that a damaged one is dropped whole.
    while reader.fill(&mut rows, usize::MAX)? {}
    let warnings = reader.warnings(&rows)?;
    segments::assemble(rows, reader.structure.metadata, reader.structure.losses, warnings)
}

fn open<'a>(path: &'a Path, rig: &'a Rig, options: &ReadOptions) -> Result<Box<dyn Source + 'a>> {
    Ok(Box::new(Reader::open(path, rig, options)?))
}

/// Rows that a file says it has.
fn rows_of(path: &Path) -> Option<u64> {
    let file = ParquetSource::new(File::open(path).ok()?).ok()?;
    let footer = quiet::catch(AssertUnwindSafe(|| ParquetMetaDataReader::new().parse_and_finish(file.file())))?.ok()?;
    u64::try_from(footer.file_metadata().num_rows()).ok()
}

/// Reads row groups, whole or in parts.
struct Reader<'a> {
    source: Arc<ParquetSource>,
    path: &'a Path,
    rig: &'a Rig,
    structure: Structure,
    columns: Columns,
    own: bool,
    recover: bool,
    /// Index of the row group being read, its columns where it has been begun, and its rows read.
    group: usize,
    begun: Option<Vec<Chunk>>,
    done: usize,
    /// Rows that stay when what follows them is damaged.
    whole: usize,
    broken: Option<String>,
    warnings: Vec<Warning>,
}

/// A column of a row group.
struct Chunk {
    reader: ColumnReader,
    descriptor: Arc<ColumnDescriptor>,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path, rig: &'a Rig, options: &ReadOptions) -> Result<Self> {
        let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
        let source = Arc::new(ParquetSource::new(File::open(path).map_err(io)?).map_err(io)?);
        let structure = guarded(path, || structure(&source, path))?;
        let mut warnings = Vec::new();
        if let Some(metadata) = &structure.metadata {
            check_rig(metadata, path, rig, &mut warnings)?;
        }
        let own = structure.metadata.is_some() && OWN_COLUMNS.iter().all(|c| leaf(&structure.schema, c).is_some());
        let rate =
            structure.metadata.as_ref().map(|m| m.sample_rate_hz).filter(|r| structure.written_by_whirl && *r > 0.0);
        let columns = columns(&structure.schema, path, rig, own, rate)?;
        let broken = structure.truncated.clone();
        let recover = options.recover;
        Ok(Self {
            source,
            path,
            rig,
            structure,
            columns,
            own,
            recover,
            group: 0,
            begun: None,
            done: 0,
            whole: 0,
            broken,
            warnings,
        })
    }

    /// Reads up to `most` rows of the next row groups (whole ones while they are small); whether there was one.
    fn part(&mut self, rows: &mut Rows<'_>, most: usize) -> core::result::Result<bool, Failure> {
        self.whole = rows.t.len();
        let Some(group) = self.structure.groups.get(self.group) else { return Ok(false) };
        let count = rows_in(group)?;
        if self.begun.is_none() && count <= most.min(PART) {
            return self.small_groups(rows, most).map(|()| true);
        }
        if self.begun.is_none() {
            self.begun = Some(open_group(&self.source, &self.structure, &self.columns.indices(), self.group)?);
        }
        let now = most.min(count - self.done);
        if let Some(chunks) = &mut self.begun {
            read_part(chunks, now, &self.columns, rows)?;
        }
        self.done += now;
        if self.done >= count {
            (self.begun, self.done) = (None, 0);
            self.group += 1;
        }
        Ok(true)
    }

    /// Reads row groups of at most `most` rows together, side by side: small ones cost more to open than to decode. Without a limit, all that follow each
    /// other, the next ones decoded while those before them are taken.
    fn small_groups(&mut self, rows: &mut Rows<'_>, most: usize) -> core::result::Result<(), Failure> {
        let (source, structure, columns) = (&self.source, &self.structure, &self.columns);
        let ahead = |from: usize| {
            let (mut to, mut sum) = (from, 0_usize);
            while let Some(group) = structure.groups.get(to) {
                // One with a wrong number of rows is told when it is its turn.
                let count = rows_in(group).unwrap_or(0);
                sum = sum.saturating_add(count);
                if to > from && (count > PART || sum > most.min(SIDE_BY_SIDE) || to - from >= MOST_GROUPS) {
                    break;
                }
                to += 1;
            }
            let decoded: Vec<core::result::Result<Vec<Cells>, Failure>> = (from..to)
                .into_par_iter()
                .map(|index| {
                    let open = || {
                        let count = rows_in(&structure.groups[index])?;
                        Ok((open_group(source, structure, &columns.indices(), index)?, count))
                    };
                    caught(open).and_then(|(mut chunks, count)| decode_all(&mut chunks, count, columns))
                })
                .collect();
            decoded
        };
        let small =
            |index: usize| structure.groups.get(index).is_some_and(|g| rows_in(g).is_ok_and(|count| count <= PART));
        let mut decoded = ahead(self.group);
        loop {
            let next = self.group + decoded.len();
            let go_on = most == usize::MAX && small(next);
            let channels = self.rig.channel.len();
            let (group, whole) = (&mut self.group, &mut self.whole);
            let take = || -> core::result::Result<(), Failure> {
                for cells in decoded {
                    take(cells?, channels, rows)?;
                    *group += 1;
                    *whole = rows.t.len();
                }
                Ok(())
            };
            let (taken, following) = rayon::join(take, || if go_on { ahead(next) } else { Vec::new() });
            taken?;
            if following.is_empty() {
                return Ok(());
            }
            decoded = following;
        }
    }
}

/// Opens some columns of a row group.
fn open_group(
    source: &Arc<ParquetSource>,
    structure: &Structure,
    columns: &[usize],
    index: usize,
) -> core::result::Result<Vec<Chunk>, Failure> {
    let group = &structure.groups[index];
    let checksum = structure.checksums.as_ref().and_then(|c| c.get(index).copied());
    let marked = structure.checksums.is_some() || structure.written_by_whirl;
    // One small enough is read at once: page by page takes longer than decoding does.
    let held = match extent(group) {
        Some((start, length)) if length <= HELD => Some(Arc::new(source.hold(start, length, MARKER)?)),
        _ => None,
    };
    verify(source, held.as_deref(), group, marked, checksum).map_err(Failure::File)?;
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
fn rows_in(group: &RowGroupMetaData) -> core::result::Result<usize, Failure> {
    usize::try_from(group.num_rows()).map_err(|_| Failure::File("a negative number of rows".to_owned()))
}

/// Runs code of the parquet crate on whatever thread it is given to: a panic is caught on that thread, where it can be kept quiet.
fn caught<T>(f: impl FnOnce() -> core::result::Result<T, Failure>) -> core::result::Result<T, Failure> {
    quiet::catch(AssertUnwindSafe(f)).unwrap_or_else(|| Err(Failure::File("a damaged page".to_owned())))
}

/// Runs code of the parquet crate, which panics on some damaged input; a panic leaves nothing behind that is used afterwards.
fn guarded<T>(path: &Path, f: impl FnOnce() -> Result<T>) -> Result<T> {
    quiet::catch(AssertUnwindSafe(f))
        .unwrap_or_else(|| Err(BadInput::new("a damaged file", "Parquet").in_file(path).remedy("Copy the file again")))
}

impl Source for Reader<'_> {
    fn fill(&mut self, rows: &mut Rows<'_>, most: usize) -> Result<bool> {
        let path = self.path;
        guarded(path, || match self.part(rows, most) {
            Ok(more) => Ok(more),
            Err(Failure::Bad(e)) => Err(*e),
            Err(Failure::File(e)) => {
                rows.truncate(self.whole);
                self.broken = Some(format!("row group {}: {e}", self.group + 1));
                self.group = self.structure.groups.len();
                self.begun = None;
                Ok(false)
            }
        })
    }

    fn warnings(&mut self, rows: &Rows<'_>) -> Result<Vec<Warning>> {
        let mut warnings = std::mem::take(&mut self.warnings);
        let Some(reason) = &self.broken else { return Ok(warnings) };
        let error = BadInput::new(
            format!("a truncated or damaged Parquet file ({reason}); {}", rows.last_whole()),
            "a whole one",
        )
        .in_file(self.path)
        .at(if self.structure.truncated.is_some() {
            "end of file".to_owned()
        } else {
            format!("after row {}", rows.passed + rows.t.len())
        })
        .remedy(remedy(self.path, rows.t.is_empty()));
        if !self.recover || rows.t.is_empty() {
            return Err(error);
        }
        warnings.push(Warning::new("recovered", error.found.clone(), "What follows the last whole row is lost"));
        Ok(warnings)
    }

    fn word(&self) -> &'static str {
        "row"
    }

    fn own(&self) -> bool {
        self.own
    }

    fn metadata(&self) -> Option<&Metadata> {
        self.structure.metadata.as_ref()
    }

    fn losses(&self) -> Option<&Losses> {
        self.structure.losses.as_ref()
    }
}

/// What to do about a truncated record: a journal beside it (see [`crate::capture::journal`]) has all of it.
fn remedy(path: &Path, nothing_whole: bool) -> String {
    let journal = crate::capture::journal::path_of(path);
    let rest = if nothing_whole {
        "Copy the file again"
    } else {
        "Copy the file again, or read it up to the last whole row with --recover"
    };
    if journal.exists() {
        format!(
            "`whirl capture --from file:{} --rig RIG.toml -o {}` makes it again, whole. {rest}",
            journal.display(),
            path.display()
        )
    } else {
        rest.to_owned()
    }
}

/// Why a row group could not be read.
pub(super) enum Failure {
    /// The file is damaged from here on.
    File(String),
    /// A value in it is wrong.
    Bad(Box<BadInput>),
}

impl From<ParquetError> for Failure {
    fn from(e: ParquetError) -> Self {
        Self::File(e.to_string())
    }
}

impl From<BadInput> for Failure {
    fn from(e: BadInput) -> Self {
        Self::Bad(Box::new(e))
    }
}

/// Reads the footer, or, where there is none, whirl's markers.
fn structure(source: &Arc<ParquetSource>, path: &Path) -> Result<Structure> {
    // The crate may panic here too; a file whose footer makes it panic is read by its markers like one without.
    let footer = quiet::catch(AssertUnwindSafe(|| ParquetMetaDataReader::new().parse_and_finish(source.file())))
        .unwrap_or_else(|| Err(ParquetError::General("damaged footer".to_owned())));
    match footer {
        Ok(file) => {
            let (metadata, losses) = own_metadata(&file);
            Ok(Structure {
                schema: file.file_metadata().schema_descr_ptr(),
                groups: file.row_groups().to_vec(),
                checksums: None,
                written_by_whirl: file.file_metadata().created_by().is_some_and(|c| c.starts_with("whirl version")),
                metadata,
                losses,
                truncated: None,
            })
        }
        Err(e) => {
            let mut file = source.file();
            let mut markers = scan(&mut file).map_err(|e| BadInput::io(path, &e))?.into_iter();
            let Some(first) = markers.next() else {
                return Err(BadInput::new(
                    format!("a truncated or damaged Parquet file ({e}); no row is whole"),
                    "a whole one",
                )
                .in_file(path)
                .at("end of file")
                .remedy(
                    "Copy or export the file again: only whirl's own records can be recovered without their footer",
                ));
            };
            let (mut metadata, _) = own_metadata(&first.metadata);
            let (mut groups, mut checksums) = (vec![], vec![]);
            let mut start = first.end;
            for Marker { data_crc, metadata: of_group, offset, end } in markers {
                // A row group stands right between two markers: one whose own marker is damaged ends the readable part.
                let fits = |g: &RowGroupMetaData| extent(g) == offset.checked_sub(start).map(|n| (start, n));
                match of_group.row_groups() {
                    [group] if first.offset == 4 && fits(group) => {
                        if let (Some(metadata), Some(boots)) = (&mut metadata, boots(&of_group)) {
                            metadata.boots = boots;
                        }
                        groups.push(group.clone());
                        checksums.push(data_crc);
                        start = end;
                    }
                    _ => break,
                }
            }
            Ok(Structure {
                schema: first.metadata.file_metadata().schema_descr_ptr(),
                groups,
                checksums: Some(checksums),
                written_by_whirl: true,
                metadata,
                losses: None,
                truncated: Some(format!("no footer: {e}")),
            })
        }
    }
}

/// Value of one of whirl's keys.
fn value(file: &ParquetMetaData, key: &str) -> Option<String> {
    let pairs = file.file_metadata().key_value_metadata();
    pairs?.iter().find(|kv| kv.key.strip_prefix(KEY) == Some(key))?.value.clone()
}

/// Ticks at which boots begin, where the file or a row group's marker lists any; in order, whatever the file says.
fn boots(file: &ParquetMetaData) -> Option<Vec<i64>> {
    let mut boots: Vec<i64> = serde_json::from_str(&value(file, "boots")?).ok()?;
    boots.sort_unstable();
    boots.dedup();
    Some(boots)
}

/// whirl's own metadata, where the file has it.
fn own_metadata(file: &ParquetMetaData) -> (Option<Metadata>, Option<Losses>) {
    let get = |key: &str| value(file, key);
    if get("format").is_none() {
        return (None, None);
    }
    let text = |key| get(key).unwrap_or_default();
    let metadata = Metadata {
        rig: text("rig"),
        firmware: text("firmware"),
        board: text("board"),
        started_at: get("started_at"),
        source: text("source"),
        written_by: text("written_by"),
        sample_rate_hz: get("sample_rate_hz")
            .and_then(|s| s.parse().ok())
            .filter(|r: &f64| r.is_finite())
            .unwrap_or(0.0),
        boots: boots(file).unwrap_or_default(),
    };
    (Some(metadata), get("losses").and_then(|s| serde_json::from_str(&s).ok()))
}

/// A record knows its encoders: the rig file given now must agree.
fn check_rig(metadata: &Metadata, path: &Path, rig: &Rig, warnings: &mut Vec<Warning>) -> Result<()> {
    let Ok(stored) = Rig::parse(&metadata.rig, path) else {
        warnings.push(Warning::new(
            "rig-metadata",
            "the rig file in the record's metadata cannot be read, so that it was not compared with the one given",
            "See that the rig file given is the one used at capture",
        ));
        return Ok(());
    };
    for c in &rig.channel {
        if let Some(s) = stored.channel.iter().find(|s| s.name == c.name)
            && s.counts_per_turn != c.counts_per_turn
        {
            let shown = |n: Option<u32>| n.map_or_else(|| "none".to_owned(), |n| n.to_string());
            return Err(BadInput::new(
                format!("counts_per_turn = {} ({})", shown(c.counts_per_turn), rig.path.display()),
                format!("{} as recorded in {}", shown(s.counts_per_turn), path.display()),
            )
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", c.name))
            .remedy("Name the rig file that was used at capture"));
        }
        if let Some(s) = stored.channel.iter().find(|s| s.name == c.name)
            && s.measures != c.measures
        {
            warnings.push(Warning::new(
                "rig-metadata",
                format!("{} measures {} in the rig file, and {} in the record", c.name, c.measures, s.measures),
                "See that the rig file given is the one used at capture",
            ));
        }
    }
    Ok(())
}

/// Index of a column that is not nested.
fn leaf(schema: &SchemaDescriptor, name: &str) -> Option<usize> {
    schema.columns().iter().position(|c| {
        let parts = c.path().parts();
        parts.len() == 1 && parts[0] == name && c.max_rep_level() == 0 && c.max_def_level() <= 1
    })
}

/// Columns to read: t, the channels, and the device's.
struct Columns {
    t: usize,
    channels: Vec<usize>,
    own: Option<[usize; 3]>,
    /// Sampling rate by which t follows from the tick, Hz, where the file is as whirl wrote it.
    rate: Option<f64>,
}

impl Columns {
    /// Them in the order in which they are read: t (unless it follows from the tick), the channels, the device's.
    fn indices(&self) -> Vec<usize> {
        let own = self.own.iter().flatten();
        let t = Some(&self.t).filter(|_| self.rate.is_none());
        t.into_iter().chain(&self.channels).chain(own).copied().collect()
    }
}

fn columns(schema: &SchemaDescriptor, path: &Path, rig: &Rig, own: bool, rate: Option<f64>) -> Result<Columns> {
    let names: Vec<String> = schema.columns().iter().map(|c| c.path().string()).collect();
    let find = |name: &str| leaf(schema, name).ok_or_else(|| missing_column(path, name, &names));
    let own = if own { Some([find(OWN_COLUMNS[0])?, find(OWN_COLUMNS[1])?, find(OWN_COLUMNS[2])?]) } else { None };
    let channels = rig.channel.iter().map(|c| find(&c.name)).collect::<Result<_>>()?;
    Ok(Columns { t: find("t")?, channels, own, rate: rate.filter(|_| own.is_some()) })
}

/// Verifies the checksum in the marker behind a row group of whirl's own. `held`: its bytes and what follows them, where they were read at once.
fn verify(
    source: &ParquetSource,
    held: Option<&Held>,
    group: &RowGroupMetaData,
    marked: bool,
    checksum: Option<u32>,
) -> core::result::Result<(), String> {
    if !marked {
        return Ok(());
    }
    let damaged = || "checksum of a row group is wrong".to_owned();
    let (start, length) = extent(group).ok_or_else(damaged)?;
    let mut file = source.place();
    let near = held.and_then(|h| marker_at(&mut Cursor::new(h.bytes()), length));
    let expected = match checksum {
        Some(crc) => crc,
        None => match near.or_else(|| marker_at(&mut file, start.saturating_add(length))) {
            Some(marker) if marker.metadata.row_groups() == [group.clone()] => marker.data_crc,
            Some(_) => return Err("the footer and the marker behind a row group disagree".to_owned()),
            None => return Err("the marker behind a row group is damaged".to_owned()),
        },
    };
    let found = match held {
        // As long as it was asked to be: length is at most HELD.
        Some(held) => held.bytes().get(..length as usize).map(crc32),
        None => crc_of_range(&mut file, start, length),
    };
    if found == Some(expected) { Ok(()) } else { Err(damaged()) }
}

/// Rows read at once: what is decoded beside the record itself.
const PART: usize = 1 << 16;
/// Row groups opened at once, and their rows.
const MOST_GROUPS: usize = 32;
const SIDE_BY_SIDE: usize = 2 * PART;
/// Longest row group read at once, bytes.
const HELD: u64 = 1 << 24;
/// What is read with it of what stands behind it: longer than the marker of any rig.
const MARKER: u64 = 1 << 14;

/// The next `count` rows of some columns, decoded side by side: t, the channels, the device's.
fn decode_all(chunks: &mut [Chunk], count: usize, columns: &Columns) -> core::result::Result<Vec<Cells>, Failure> {
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
fn read_part(
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
fn take(columns: Vec<Cells>, channels: usize, rows: &mut Rows<'_>) -> Result<()> {
    let first = rows.passed + rows.t.len();
    for (k, cells) in columns.into_iter().enumerate() {
        if k == 0 {
            rows.take_times(first, cells)?;
        } else if k <= channels {
            rows.take_channel(first, k - 1, cells)?;
        } else {
            rows.take_device(first, k - 1 - channels, cells)?;
        }
    }
    Ok(())
}

#[cfg(test)]
#[path = "parquet_tests.rs"]
mod tests;

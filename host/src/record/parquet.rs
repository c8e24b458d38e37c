//! Records as Parquet: whirl's own ([`super::parquet_write`]) and anybody's with a column `t` and the rig's columns.
//!
//! - `t`: DOUBLE or FLOAT in seconds, an integer in seconds, or a timestamp. Channels: 32- or 64-bit integers, FLOAT or DOUBLE; a
//!   null or NaN is a gap. Compression: none or Snappy. Nested columns are not read.
//! - A record of whirl's own brings its ticks, the drive's phase, its metadata and losses. Its row groups carry checksums,
//!   which are verified; without a footer it is read up to the last whole row group ([`ReadOptions::recover`]).
//!
//! The parquet crate is guarded in two ways: sizes are checked before it sees them ([`super::parquet_source`]), and it runs under
//! `catch_unwind`, since it panics on some damaged input (seen: an encoding that it does not know; 2 of 15 000 mutated files).
//! Memory is that of the columns read.

use std::fs::File;
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::Arc;

use parquet::column::reader::get_column_reader;
use parquet::errors::ParquetError;
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use parquet::file::reader::SerializedPageReader;
use parquet::schema::types::SchemaDescriptor;

use super::csv::OWN_COLUMNS;
use super::formats::{Format, ReadOptions};
use super::parquet_cells::{Number, for_each};
use super::parquet_recovery::{Marker, checked_range, crc_of_range, extent, marker_at, scan};
use super::parquet_source::Source;
use super::parquet_write::KEY;
use super::rows::{Cell, Rows, missing_column};
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
    let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
    let source = Arc::new(Source::new(File::open(path).map_err(io)?).map_err(io)?);
    // A panic of the crate leaves nothing behind that is used afterwards: rows and source are dropped.
    quiet::catch(AssertUnwindSafe(|| read_source(&source, path, rig, options)))
        .unwrap_or_else(|| Err(BadInput::new("a damaged file", "Parquet").in_file(path).remedy("Copy the file again")))
}

fn read_source(source: &Arc<Source>, path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let structure = structure(source, path)?;
    let mut warnings = Vec::new();
    if let Some(metadata) = &structure.metadata {
        check_rig(metadata, path, rig, &mut warnings)?;
    }
    let own = structure.metadata.is_some() && OWN_COLUMNS.iter().all(|c| leaf(&structure.schema, c).is_some());
    let mut rows = Rows::new(path, rig, "row", own);
    rows.resample = options.resample;
    let columns = columns(&structure.schema, path, rig, own)?;
    let marked = structure.checksums.is_some() || structure.written_by_whirl;
    let mut broken = structure.truncated.clone();
    for (k, group) in structure.groups.iter().enumerate() {
        let before = rows.t.len();
        let checksum = structure.checksums.as_ref().and_then(|c| c.get(k).copied());
        let done = verify(source, group, marked, checksum).map_err(Failure::File).and_then(|()| {
            read_group(source, group, &columns, &mut rows).map_err(|e| match e {
                Failure::File(e) => Failure::File(format!("row group {}: {e}", k + 1)),
                bad => bad,
            })
        });
        match done {
            Ok(()) => {}
            Err(Failure::Bad(e)) => return Err(*e),
            Err(Failure::File(e)) => {
                rows.truncate(before);
                broken = Some(e);
                break;
            }
        }
    }
    if let Some(reason) = broken {
        let error = BadInput::new(
            format!("a truncated or damaged Parquet file ({reason}); {}", rows.last_whole()),
            "a whole one",
        )
        .in_file(path)
        .at(if structure.truncated.is_some() {
            "end of file".to_owned()
        } else {
            format!("after row {}", rows.t.len())
        })
        .remedy(remedy(path, rows.t.is_empty()));
        if !options.recover || rows.t.is_empty() {
            return Err(error);
        }
        warnings.push(Warning::new("recovered", error.found.clone(), "What follows the last whole row is lost"));
    }
    segments::assemble(rows, structure.metadata, structure.losses, warnings)
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
fn structure(source: &Arc<Source>, path: &Path) -> Result<Structure> {
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
            let (metadata, _) = own_metadata(&first.metadata);
            let (mut groups, mut checksums) = (vec![], vec![]);
            let mut start = first.end;
            for Marker { data_crc, metadata, offset, end } in markers {
                // A row group stands right between two markers: one whose own marker is damaged ends the readable part.
                let fits = |g: &RowGroupMetaData| extent(g) == offset.checked_sub(start).map(|n| (start, n));
                match metadata.row_groups() {
                    [group] if first.offset == 4 && fits(group) => {
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

/// whirl's own metadata, where the file has it.
fn own_metadata(file: &ParquetMetaData) -> (Option<Metadata>, Option<Losses>) {
    let pairs = file.file_metadata().key_value_metadata();
    let get = |key: &str| {
        let found = pairs?.iter().find(|kv| kv.key.strip_prefix(KEY) == Some(key))?;
        found.value.clone()
    };
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
}

fn columns(schema: &SchemaDescriptor, path: &Path, rig: &Rig, own: bool) -> Result<Columns> {
    let names: Vec<String> = schema.columns().iter().map(|c| c.path().string()).collect();
    let find = |name: &str| leaf(schema, name).ok_or_else(|| missing_column(path, name, &names));
    let own = if own { Some([find(OWN_COLUMNS[0])?, find(OWN_COLUMNS[1])?, find(OWN_COLUMNS[2])?]) } else { None };
    Ok(Columns { t: find("t")?, channels: rig.channel.iter().map(|c| find(&c.name)).collect::<Result<_>>()?, own })
}

/// Verifies the checksum in the marker behind a row group of whirl's own.
fn verify(
    source: &Source,
    group: &RowGroupMetaData,
    marked: bool,
    checksum: Option<u32>,
) -> core::result::Result<(), String> {
    if !marked {
        return Ok(());
    }
    let damaged = || "checksum of a row group is wrong".to_owned();
    let (start, length) = extent(group).ok_or_else(damaged)?;
    let mut file = source.file();
    let expected = match checksum {
        Some(crc) => crc,
        None => match marker_at(&mut file, start.saturating_add(length)) {
            Some(marker) if marker.metadata.row_groups() == [group.clone()] => marker.data_crc,
            Some(_) => return Err("the footer and the marker behind a row group disagree".to_owned()),
            None => return Err("the marker behind a row group is damaged".to_owned()),
        },
    };
    if crc_of_range(&mut file, start, length) == Some(expected) { Ok(()) } else { Err(damaged()) }
}

/// Reads one row group into `rows`.
fn read_group(
    source: &Arc<Source>,
    group: &RowGroupMetaData,
    columns: &Columns,
    rows: &mut Rows<'_>,
) -> core::result::Result<(), Failure> {
    let first = rows.t.len();
    let count = usize::try_from(group.num_rows()).map_err(|_| Failure::File("a negative number of rows".to_owned()))?;
    // Messages count rows from 1.
    let place = |i: usize| (first + i + 1) as u64;
    let each =
        |column: usize, take: &mut dyn FnMut(usize, Number) -> Result<()>| -> core::result::Result<(), Failure> {
            let chunk = group.columns().get(column).ok_or_else(|| Failure::File("a column is missing".to_owned()))?;
            if checked_range(chunk).is_none() {
                return Err(Failure::File("a column chunk outside of the file".to_owned()));
            }
            let pages = SerializedPageReader::new(source.clone(), chunk, count, None)?;
            for_each(get_column_reader(chunk.column_descr_ptr(), Box::new(pages)), chunk.column_descr(), count, take)
        };
    each(columns.t, &mut |i, number| {
        let t = rows.seconds(number);
        rows.check_time(place(i), t)?;
        rows.push_time(place(i), t);
        Ok(())
    })?;
    for (k, &column) in columns.channels.iter().enumerate() {
        each(column, &mut |i, number| {
            let cell = match number {
                Number::Null => Cell::Missing,
                Number::Integer(v) | Number::Timestamp(v, _) => rows.check_integer(place(i), k, v)?,
                Number::Real(v) => rows.check_number(place(i), k, v)?,
            };
            rows.push_cell(place(i), k, cell);
            Ok(())
        })?;
    }
    if let Some(own) = columns.own {
        for (j, &column) in own.iter().enumerate() {
            each(column, &mut |i, number| rows.push_device(place(i), j, number))?;
        }
    }
    Ok(())
}

#[cfg(test)]
#[path = "parquet_tests.rs"]
mod tests;

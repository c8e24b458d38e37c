//! Records as Parquet: whirl's own ([`super::parquet_write`]) and anybody's with a column `t` and
//! the rig's columns.
//!
//! - The time: DOUBLE, FLOAT or an integer in the unit that its name or the rig file says (seconds
//!   otherwise), a point in time, a time of day, or a length of time as pandas and polars write it
//!   ([`super::arrow_schema`]). Channels: 32- or 64-bit integers, FLOAT or DOUBLE; a null or NaN is
//!   a gap. Compression: any that is common. Nested columns are not read.
//! - Row groups of up to 16 MiB are read at once. In a file as whirl wrote it `t` is not decoded
//!   but follows from the ticks, as it was made.
//! - A record of whirl's own brings its ticks, the drive's phase, its metadata and losses. Its row
//!   groups carry checksums, which are verified.
//! - To recover a damaged file ([`ReadOptions::recover`]), every whole row group of whirl's own is
//!   read, footer or not, and of other files, whose footer is needed, every row whose pages are
//!   whole ([`super::parquet_salvage`]). What is left out is a gap.
//!
//! The parquet crate is guarded in two ways: sizes are checked before it sees them
//! ([`super::parquet_source`]), and it runs under `catch_unwind`, since it panics on some damaged
//! input (seen: an encoding that it does not know; 2 of 15 000 mutated files). Memory is that of
//! the columns read, or of a block of rows where they are streamed ([`super::stream`]): every
//! column of a row group is then decoded page by page beside the others.

use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::Arc;

use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use rayon::prelude::*;

use super::csv::OWN_COLUMNS;
use super::formats::{Format, ReadOptions};
use super::parquet_cells::Cells;
use super::parquet_chunks::{Chunk, Failure, PART, caught, decode_all, open_group, read_part, rows_in, take};
use super::parquet_recovery::marker_at;
use super::parquet_salvage::salvage;
use super::parquet_source::Source as ParquetSource;
use super::parquet_structure::{
    Columns, FIRST_MARKER, Structure, check_rig, columns, flat, listed, own_metadata, structure,
};
use super::rows::Rows;
use super::stream::{Source, Streamed};
use super::{Losses, Metadata, Record, quiet, segments};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

pub(super) const FORMAT: Format = Format {
    id: "parquet",
    about: "Parquet, whirl's own or with a column for the time (.parquet)",
    extensions: &["parquet", "pq"],
    is: |head| head.starts_with(b"PAR1"),
    columns: |path, _| {
        let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
        let source = Arc::new(ParquetSource::new(super::formats::open(path)?).map_err(io)?);
        Ok(listed(&guarded(path, || structure(&source, path, false))?))
    },
    read,
    stream: Some(Streamed { open, rows: rows_of }),
};

/// Row groups opened at once, and their rows.
const MOST_GROUPS: usize = 32;
const SIDE_BY_SIDE: usize = 2 * PART;

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let mut reader = Reader::open(path, rig, options)?;
    let mut rows = Rows::new(path, rig, "row", reader.own);
    rows.resample = options.resample;
    let claimed = reader.structure.groups.iter().filter_map(|g| rows_in(&g.metadata).ok());
    rows.reserve(claimed.fold(0, usize::saturating_add));
    // A whole row group at a time, so that a damaged one is dropped whole.
    while reader.fill(&mut rows, usize::MAX)? {}
    let warnings = reader.warnings(&rows)?;
    segments::assemble(rows, reader.structure.metadata, reader.structure.losses, warnings)
}

fn open<'a>(path: &'a Path, rig: &'a Rig, options: &ReadOptions) -> Result<Box<dyn Source + 'a>> {
    Ok(Box::new(Reader::open(path, rig, options)?))
}

fn footer(path: &Path) -> Option<ParquetMetaData> {
    let file = ParquetSource::new(super::formats::open(path).ok()?).ok()?;
    quiet::catch(AssertUnwindSafe(|| ParquetMetaDataReader::new().parse_and_finish(file.file())))?.ok()
}

/// Rows that a file says it has.
fn rows_of(path: &Path) -> Option<u64> {
    u64::try_from(footer(path)?.file_metadata().num_rows()).ok()
}

/// What a record of whirl's own says of itself, one that is cut short by its head; none for every
/// other file.
pub fn metadata(path: &Path) -> Option<Metadata> {
    match footer(path) {
        Some(footer) => own_metadata(&footer).0,
        None => {
            let source = ParquetSource::new(super::formats::open(path).ok()?).ok()?;
            own_metadata(&marker_at(&mut source.place(), FIRST_MARKER)?.metadata).0
        }
    }
}

/// Whether a file has its end, in which Parquet keeps what it holds.
pub fn has_footer(path: &Path) -> bool {
    footer(path).is_some()
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
    /// The row group that ended the reading, and why.
    broken: Option<(usize, String)>,
    /// The first value that was wrong where damage is passed over: the error if nothing else is
    /// found.
    wrong: Option<BadInput>,
    warnings: Vec<Warning>,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path, rig: &'a Rig, options: &ReadOptions) -> Result<Self> {
        let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
        let source = Arc::new(ParquetSource::new(super::formats::open(path)?).map_err(io)?);
        let structure = guarded(path, || structure(&source, path, options.recover))?;
        let mut warnings = Vec::new();
        // Columns as they stand say nothing that could contradict it.
        if let Some(metadata) = structure.metadata.as_ref().filter(|_| !rig.is_of_columns()) {
            check_rig(metadata, path, rig, &mut warnings)?;
        }
        let (names, _) = flat(&structure.schema);
        let own = structure.metadata.is_some() && OWN_COLUMNS.iter().all(|c| names.iter().any(|n| n == c));
        let rate =
            structure.metadata.as_ref().map(|m| m.sample_rate_hz).filter(|r| structure.written_by_whirl && *r > 0.0);
        let columns = columns(&structure, path, rig, own, rate)?;
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
            broken: None,
            wrong: None,
            warnings,
        })
    }

    /// Reads up to `most` rows of the next row groups (whole ones while they are small); whether
    /// there was one.
    fn part(&mut self, rows: &mut Rows<'_>, most: usize) -> core::result::Result<bool, Failure> {
        self.whole = rows.t.len();
        let Some(group) = self.structure.groups.get(self.group) else { return Ok(false) };
        if group.behind_a_hole && self.begun.is_none() {
            rows.lose(None, self.group + 1, "nothing says what stood here");
        }
        let count = rows_in(&group.metadata)?;
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

    /// Reads row groups of at most `most` rows together, side by side: small ones cost more to open
    /// than to decode. Without a limit, all that follow each other, the next ones decoded while
    /// those before them are taken.
    fn small_groups(&mut self, rows: &mut Rows<'_>, most: usize) -> core::result::Result<(), Failure> {
        let (source, structure, columns) = (&self.source, &self.structure, &self.columns);
        let ahead = |from: usize| {
            let (mut to, mut sum) = (from, 0_usize);
            while let Some(group) = structure.groups.get(to) {
                // One with a wrong number of rows is told when it is its turn.
                let count = rows_in(&group.metadata).unwrap_or(0);
                sum = sum.saturating_add(count);
                if to > from
                    && (group.behind_a_hole || count > PART || sum > most.min(SIDE_BY_SIDE) || to - from >= MOST_GROUPS)
                {
                    break;
                }
                to += 1;
            }
            let decoded: Vec<core::result::Result<Vec<Cells>, Failure>> = (from..to)
                .into_par_iter()
                .map(|index| {
                    let open = || {
                        let count = rows_in(&structure.groups[index].metadata)?;
                        Ok((open_group(source, structure, &columns.indices(), index)?, count))
                    };
                    caught(open).and_then(|(mut chunks, count)| decode_all(&mut chunks, count, columns))
                })
                .collect();
            decoded
        };
        let small = |index: usize| {
            let fits = |g: &RowGroupMetaData| rows_in(g).is_ok_and(|count| count <= PART);
            structure.groups.get(index).is_some_and(|g| fits(&g.metadata) && !g.behind_a_hole)
        };
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

/// Runs code of the parquet crate, which panics on some damaged input; a panic leaves nothing
/// behind that is used afterwards.
fn guarded<T>(path: &Path, f: impl FnOnce() -> Result<T>) -> Result<T> {
    quiet::catch(AssertUnwindSafe(f))
        .unwrap_or_else(|| Err(BadInput::new("a damaged file", "Parquet").in_file(path).remedy("Copy the file again")))
}

impl Reader<'_> {
    /// Passes over a row group that broke, or ends the reading there.
    fn broke(&mut self, failure: Failure, rows: &mut Rows<'_>) -> Result<bool> {
        rows.truncate(self.whole);
        let begun = std::mem::take(&mut self.done);
        self.begun = None;
        let number = self.group + 1;
        let why = failure.reason();
        match failure {
            Failure::Bad(e) if !self.recover => return Err(*e),
            Failure::File(_) if !self.recover => {
                self.broken = Some((self.group, why));
                self.group = self.structure.groups.len();
                return Ok(false);
            }
            Failure::Bad(e) => drop(self.wrong.get_or_insert(*e)),
            Failure::File(_) => {}
        }
        let group = &self.structure.groups[self.group].metadata;
        if self.structure.written_by_whirl {
            rows.lose(rows_in(group).ok(), number, &why);
        } else {
            let wrong = salvage(&self.source, group, number, &self.columns, begun, &why, rows);
            self.wrong = self.wrong.take().or(wrong);
        }
        self.group += 1;
        Ok(true)
    }

    /// The error for a file that is damaged, or for one of which nothing could be recovered.
    fn error(&self, rows: &Rows<'_>) -> Option<BadInput> {
        let (place, why) = match (&self.broken, &self.structure.truncated) {
            (Some((group, why)), _) => {
                let first = rows.passed + rows.t.len();
                let count = rows_in(&self.structure.groups[*group].metadata).unwrap_or(0);
                let of = self.structure.groups.len();
                let last = first.saturating_add(count);
                (format!("row group {} of {of} (rows {} to {last})", group + 1, first + 1), why.clone())
            }
            (None, Some(why)) => ("end of file".to_owned(), why.clone()),
            (None, None) if rows.t.is_empty() => ("whole file".to_owned(), rows.damage.reason()?),
            (None, None) => return None,
        };
        let recoverable = !self.recover && (self.broken.is_some() || !rows.t.is_empty());
        let whole = if self.broken.is_some() && rows.t.is_empty() && !self.recover {
            // What follows may well be.
            "no row before it is whole".to_owned()
        } else {
            rows.last_whole()
        };
        if let Some(codec) = codec_left_out(&why) {
            let found = format!("columns compressed with {codec}, which this build cannot read");
            let remedy = "Save the file again with snappy (in pandas: compression=\"snappy\")";
            return Some(BadInput::new(found, "snappy, or none").in_file(self.path).at(place).remedy(remedy));
        }
        let found = format!("a truncated or damaged Parquet file ({why}); {whole}");
        let remedy = if recoverable {
            "Copy the file again, or read what is whole of it with --recover"
        } else {
            "Copy the file again"
        };
        Some(BadInput::new(found, "a whole one").in_file(self.path).at(place).remedy(remedy))
    }
}

/// The compression that the library was built without, as its error tells.
fn codec_left_out(why: &str) -> Option<&str> {
    let rest = why.split_once("Disabled feature at compile time: ")?.1;
    rest.split(|c: char| !c.is_alphanumeric()).next().filter(|name| !name.is_empty())
}

impl Source for Reader<'_> {
    fn fill(&mut self, rows: &mut Rows<'_>, most: usize) -> Result<bool> {
        let path = self.path;
        rows.per_second = self.columns.time.per_second.unwrap_or(1.0);
        if rows.time_name != self.columns.time.name {
            rows.time_name.clone_from(&self.columns.time.name);
        }
        guarded(path, || match caught(|| self.part(rows, most)) {
            Ok(more) => Ok(more),
            Err(failure) => self.broke(failure, rows),
        })
    }

    fn warnings(&mut self, rows: &Rows<'_>) -> Result<Vec<Warning>> {
        let mut warnings = std::mem::take(&mut self.warnings);
        if let Some(error) = self.error(rows) {
            if !self.recover || rows.t.is_empty() {
                return Err(self.wrong.take().unwrap_or(error));
            }
            warnings.push(Warning::new("recovered", error.found, "What follows the last whole row is lost"));
        }
        warnings.extend(rows.damage.warning());
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

#[cfg(test)]
#[path = "parquet_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "parquet_damage_tests.rs"]
mod damage_tests;

#[cfg(test)]
#[path = "parquet_columns_tests.rs"]
mod columns_tests;

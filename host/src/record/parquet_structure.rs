//! What a Parquet file says of itself: its schema, where its row groups stand and which checksums
//! they have, and whirl's own metadata.
//!
//! The footer says all of it. In a record of whirl's own the markers ([`super::parquet_recovery`])
//! say it again, each with its own checksum: where the footer is missing, or may not be believed,
//! they are used instead. A footer that somebody else wrote is all that there is.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::Arc;

use parquet::errors::ParquetError;
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use parquet::schema::types::SchemaDescriptor;

use super::arrow_schema::durations;
use super::csv::OWN_COLUMNS;
use super::formats::Listed;
use super::names::{self, TimeChoice, TimeColumn};
use super::parquet_cells::{is_time, not_a_number};
use super::parquet_chunks;
use super::parquet_nested::nested;
use super::parquet_recovery::{Marker, crc_of_range, crc32, extent, marker_at, scan, stated_crc};
use super::parquet_source::{Held, Source};
use super::parquet_write::KEY;
use super::rows::sources;
use super::{DeviceBoot, Losses, Metadata, quiet};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

/// Where the first marker stands: behind the file's magic.
pub(super) const FIRST_MARKER: u64 = 4;

/// A row group and what is known of it.
pub(super) struct Group {
    pub(super) metadata: RowGroupMetaData,
    /// Checksum of its bytes, where a marker that is whole was read before it.
    checksum: Option<u32>,
    /// Bytes that nothing describes stand before it: at least one row group whose marker is
    /// damaged.
    pub(super) behind_a_hole: bool,
}

/// What is read from a file before its rows.
pub(super) struct Structure {
    pub(super) schema: Arc<SchemaDescriptor>,
    pub(super) groups: Vec<Group>,
    pub(super) metadata: Option<Metadata>,
    pub(super) losses: Option<Losses>,
    /// The file itself is whirl's, and not rewritten by another program that kept the metadata: it
    /// has markers.
    pub(super) written_by_whirl: bool,
    /// Units in a second, for each column of lengths of time.
    pub(super) durations: BTreeMap<String, f64>,
    /// Why the footer is not used.
    pub(super) truncated: Option<String>,
}

/// Reads the footer, or, where there is none or it is damaged, whirl's markers. To `recover`, the
/// markers of whirl's own record are believed before the footer, which has no checksum.
pub(super) fn structure(source: &Arc<Source>, path: &Path, recover: bool) -> Result<Structure> {
    // The crate may panic here too; a file whose footer makes it panic is read by its markers like
    // one without.
    let footer = quiet::catch(AssertUnwindSafe(|| ParquetMetaDataReader::new().parse_and_finish(source.file())))
        .unwrap_or_else(|| Err(ParquetError::General("damaged footer".to_owned())));
    let file = match footer {
        Ok(file) => file,
        Err(e) => return by_markers(source, path, &format!("no footer: {}", parquet_chunks::words(&e))),
    };
    let written_by_whirl = file.file_metadata().created_by().is_some_and(|c| c.starts_with("whirl version"));
    let (metadata, losses) = own_metadata(&file);
    let mut schema = file.file_metadata().schema_descr_ptr();
    if written_by_whirl
        && let Some(head) = marker_at(&mut source.place(), FIRST_MARKER)
        && (own_metadata(&head.metadata).0.map(at_the_start) != metadata.clone().map(at_the_start)
            || head.metadata.file_metadata().schema_descr() != &*schema)
    {
        return by_markers(source, path, "a damaged footer: it contradicts the head of the file");
    }
    let mut groups: Vec<Group> =
        file.row_groups().iter().map(|g| Group { metadata: g.clone(), checksum: None, behind_a_hole: false }).collect();
    if written_by_whirl && recover {
        let markers = markers(source, path)?;
        if let Some(first) = markers.first() {
            schema = first.metadata.file_metadata().schema_descr_ptr();
        }
        groups = merged(groups, markers);
    }
    let durations = durations(&file);
    Ok(Structure { schema, groups, written_by_whirl, metadata, losses, durations, truncated: None })
}

fn markers(source: &Arc<Source>, path: &Path) -> Result<Vec<Marker>> {
    scan(&mut source.place()).map_err(|e| BadInput::io(path, &e))
}

/// The row groups that markers describe, in the order of the file: a marker stands right behind its
/// row group.
fn marked(markers: Vec<Marker>) -> Vec<Group> {
    let (mut groups, mut end) = (Vec::new(), None);
    for marker in markers {
        if let [group] = marker.metadata.row_groups() {
            match extent(group) {
                Some((start, length))
                    if start >= end.unwrap_or(FIRST_MARKER) && start.checked_add(length) == Some(marker.offset) =>
                {
                    let (metadata, checksum) = (group.clone(), Some(marker.data_crc));
                    groups.push(Group { metadata, checksum, behind_a_hole: end.is_some_and(|end| start > end) });
                }
                _ => continue,
            }
        }
        end = Some(marker.end);
    }
    groups
}

/// The structure of a record of whirl's own without its footer.
fn by_markers(source: &Arc<Source>, path: &Path, why: &str) -> Result<Structure> {
    let markers = markers(source, path)?;
    let Some(any) = markers.first() else {
        return Err(BadInput::new(
            format!("a truncated or damaged Parquet file ({why}); no row is whole"),
            "a whole one",
        )
        .in_file(path)
        .at("end of file")
        .remedy("Copy or export the file again: only whirl's own records can be recovered without their footer"));
    };
    let schema = any.metadata.file_metadata().schema_descr_ptr();
    // A head that is damaged takes whirl's metadata with it: the columns are then read as
    // anybody's.
    let mut metadata = own_metadata(&any.metadata).0;
    if let Some(metadata) = &mut metadata {
        let newest = |key| markers.iter().rev().find(|m| value(&m.metadata, key).is_some());
        metadata.boots = newest("boots").and_then(|m| boots(&m.metadata)).unwrap_or_default();
        metadata.device = newest("device").map(|m| device(&m.metadata)).unwrap_or_default();
    }
    let groups = marked(markers);
    Ok(Structure {
        schema,
        groups,
        metadata,
        losses: None,
        written_by_whirl: true,
        durations: BTreeMap::new(),
        truncated: Some(why.to_owned()),
    })
}

/// The row groups of footer and markers together: those that markers describe, and, where there are
/// fewer of them than the footer has, the others.
fn merged(footer: Vec<Group>, markers: Vec<Marker>) -> Vec<Group> {
    let most = footer.len();
    let mut groups = marked(markers);
    groups.iter_mut().for_each(|g| g.behind_a_hole = false);
    let taken: Vec<(u64, u64)> = groups.iter().filter_map(|g| extent(&g.metadata)).collect();
    for candidate in footer {
        if groups.len() >= most {
            break;
        }
        // One that stands nowhere is told as damaged when it is its turn.
        let (start, length) = extent(&candidate.metadata).unwrap_or((0, 0));
        // Those of the markers follow each other and do not overlap.
        let next = taken.partition_point(|(other, n)| other + n <= start);
        if taken.get(next).is_none_or(|(other, _)| start.saturating_add(length) <= *other) {
            groups.push(candidate);
        }
    }
    groups.sort_by_key(|g| extent(&g.metadata).map_or(0, |(start, _)| start));
    groups
}

/// What the head of the file can know of it: restarts and lines of the device come later.
fn at_the_start(metadata: Metadata) -> Metadata {
    Metadata { boots: Vec::new(), device: Vec::new(), lines: Default::default(), excitation: None, ..metadata }
}

/// Value of one of whirl's keys.
fn value(file: &ParquetMetaData, key: &str) -> Option<String> {
    let pairs = file.file_metadata().key_value_metadata();
    pairs?.iter().find(|kv| kv.key.strip_prefix(KEY) == Some(key))?.value.clone()
}

/// Ticks at which boots begin, where the file or a row group's marker lists any; in order, whatever
/// the file says.
fn boots(file: &ParquetMetaData) -> Option<Vec<i64>> {
    let mut boots: Vec<i64> = serde_json::from_str(&value(file, "boots")?).ok()?;
    boots.sort_unstable();
    boots.dedup();
    Some(boots)
}

/// What the device told of its boots, in order, whatever the file says.
fn device(file: &ParquetMetaData) -> Vec<DeviceBoot> {
    let told = value(file, "device").and_then(|text| serde_json::from_str(&text).ok());
    let mut told: Vec<DeviceBoot> = told.unwrap_or_default();
    told.sort_by_key(|boot| boot.tick);
    told
}

/// whirl's own metadata, where the file has it.
pub(super) fn own_metadata(file: &ParquetMetaData) -> (Option<Metadata>, Option<Losses>) {
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
        device: device(file),
        lines: get("log").and_then(|s| serde_json::from_str(&s).ok()).unwrap_or_default(),
        excitation: get("excitation").and_then(|s| serde_json::from_str(&s).ok()),
        table: get("table").and_then(|s| serde_json::from_str(&s).ok()).unwrap_or_default(),
        level: get("level").and_then(|s| serde_json::from_str(&s).ok()),
    };
    (Some(metadata), get("losses").and_then(|s| serde_json::from_str(&s).ok()))
}

/// A record knows its encoders: the rig file given now must agree.
pub(super) fn check_rig(metadata: &Metadata, path: &Path, rig: &Rig, warnings: &mut Vec<Warning>) -> Result<()> {
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

/// Columns to read: t, the channels, and the device's.
pub(super) struct Columns {
    t: usize,
    pub(super) channels: Vec<usize>,
    own: Option<[usize; 3]>,
    /// The column of the time.
    pub(super) time: TimeColumn,
    /// Sampling rate by which t follows from the tick, Hz, where the file is as whirl wrote it.
    pub(super) rate: Option<f64>,
}

impl Columns {
    /// Them in the order in which they are read: t (unless it follows from the tick), the channels,
    /// the device's.
    pub(super) fn indices(&self) -> Vec<usize> {
        let own = self.own.iter().flatten();
        let t = Some(&self.t).filter(|_| self.rate.is_none());
        t.into_iter().chain(&self.channels).chain(own).copied().collect()
    }
}

/// Names of the columns that are not nested, and their places in the schema.
pub(super) fn flat(schema: &SchemaDescriptor) -> (Vec<String>, Vec<usize>) {
    let flat = |i: &usize| {
        let c = schema.column(*i);
        c.path().parts().len() == 1 && c.max_rep_level() == 0 && c.max_def_level() <= 1
    };
    let places: Vec<usize> = (0..schema.num_columns()).filter(flat).collect();
    (places.iter().map(|i| schema.column(*i).name().to_owned()).collect(), places)
}

/// The columns of a file, and whether they are numbers.
pub(super) fn listed(structure: &Structure) -> Vec<Listed> {
    let schema = &structure.schema;
    let (names, places) = flat(schema);
    let timed = |i: usize| is_time(&schema.column(i)) || structure.durations.contains_key(schema.column(i).name());
    let number = |i: usize| not_a_number(&schema.column(i)).is_none() && !timed(i);
    names.into_iter().zip(places).map(|(name, i)| Listed { name, is_number: number(i) }).collect()
}

/// The column of the time: by its name, or the only one that is of points or lengths of time by its
/// type.
fn time(
    structure: &Structure,
    names: &[String],
    places: &[usize],
    choice: &TimeChoice,
    path: &Path,
) -> Result<TimeColumn> {
    let typed =
        |i: &usize| is_time(&structure.schema.column(places[*i])) || structure.durations.contains_key(&names[*i]);
    let mut time = names::time_column(names, choice, path).or_else(|e| {
        let found: Vec<usize> = (0..names.len()).filter(typed).collect();
        match found[..] {
            [index] if choice.column.is_none() && !names.iter().any(|n| names::is_time(n)) => {
                Ok(TimeColumn { index, name: names[index].clone(), per_second: None })
            }
            _ => {
                let asked = choice.column.as_deref().unwrap_or("t");
                Err(nested(&structure.schema, asked, path).unwrap_or(e))
            }
        }
    })?;
    time.per_second = time.per_second.or_else(|| structure.durations.get(&time.name).copied());
    Ok(TimeColumn { index: places[time.index], ..time })
}

/// Finds the columns.
pub(super) fn columns(structure: &Structure, path: &Path, rig: &Rig, own: bool, rate: Option<f64>) -> Result<Columns> {
    let schema = &structure.schema;
    let (names, places) = flat(schema);
    let checked = |index: usize, time: bool| {
        let column = schema.column(index);
        match not_a_number(&column) {
            None => Ok(index),
            Some(_) if time && is_time(&column) => Ok(index),
            Some(kind) => Err(BadInput::new(format!("the type {kind}"), "numbers: INT32, INT64, FLOAT or DOUBLE")
                .in_file(path)
                .at(format!("column {}", column.name()))
                .remedy("Convert the column to numbers and save it again (in pandas: df[name].astype(\"float64\"))")),
        }
    };
    let wanted = sources(rig).columns;
    let used: Vec<&str> = wanted.iter().map(|c| c.name.as_str()).collect();
    let find = |name: &str| {
        let place =
            names::find_beside(&names, name, &used, path).map_err(|e| nested(schema, name, path).unwrap_or(e))?;
        checked(places[place], false)
    };
    let own = if own { Some([find(OWN_COLUMNS[0])?, find(OWN_COLUMNS[1])?, find(OWN_COLUMNS[2])?]) } else { None };
    let channels = used.iter().map(|name| find(name)).collect::<Result<_>>()?;
    let choice = if own.is_some() { &TimeChoice::default() } else { &rig.time };
    let time = time(structure, &names, &places, choice, path)?;
    Ok(Columns { t: checked(time.index, true)?, time, channels, own, rate: rate.filter(|_| own.is_some()) })
}

/// Verifies a row group of whirl's own by the checksum in the marker behind it. `held`: its bytes
/// and what follows them, where they were read at once.
pub(super) fn verify(
    source: &Source,
    held: Option<&Held>,
    group: &Group,
    marked: bool,
) -> core::result::Result<(), String> {
    if !marked {
        return Ok(());
    }
    let damaged = || "its checksum is wrong".to_owned();
    let (start, length) = extent(&group.metadata).ok_or_else(|| "it stands outside of the file".to_owned())?;
    let mut file = source.place();
    let found = match held {
        // As long as it was asked to be: it is held.
        Some(held) => held.bytes().get(..length as usize).map(crc32),
        None => crc_of_range(&mut file, start, length),
    };
    let expected = match group.checksum {
        Some(crc) => crc,
        None => {
            let end = start.saturating_add(length);
            let near = held.and_then(|h| marker_at(&mut Cursor::new(h.bytes()), length));
            match near.or_else(|| marker_at(&mut file, end)) {
                Some(marker) if marker.metadata.row_groups() == [group.metadata.clone()] => marker.data_crc,
                Some(_) => return Err("the footer and the marker behind it disagree".to_owned()),
                // A marker that is damaged elsewhere still proves by its checksum of the rows that
                // these are whole.
                None => stated_crc(&mut file, end).ok_or_else(damaged)?,
            }
        }
    };
    if found == Some(expected) { Ok(()) } else { Err(damaged()) }
}

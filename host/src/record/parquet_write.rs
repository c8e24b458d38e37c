//! Writes whirl's record as Parquet, in bounded memory: one row group ([`group_rows`]) is held at a
//! time.
//!
//! | column | type | unit |
//! |---|---|---|
//! | `tick` | INT64 | sampling ticks of the device's clock |
//! | `t` | DOUBLE | s, tick / sampling rate |
//! | one for each channel, by its name in the rig file | INT32 | counts, multi-turn |
//! | `phase` | INT32, unsigned | the drive's phase, turns · 2⁻³² |
//! | `amplitude_nm` | INT32, unsigned | commanded amplitude of the base, nm |
//!
//! Integers are delta-coded, times byte-split, both then Snappy-compressed. After each row group
//! stands a marker ([`super::parquet_recovery`]), and all is handed to the operating system, so
//! that a crash costs at most the row group begun.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::Crc;
use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{DataType, DoubleType, Int32Type, Int64Type};
use parquet::errors::{ParquetError, Result as ParquetResult};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{ColumnPath, SchemaDescriptor, Type};
use whirl_shared::excitation::Excitation;

use super::csv::OWN_COLUMNS;
use super::csv_write::create_file;
use super::parquet_recovery::marker;
use super::writer::Sample;
use super::{DeviceBoot, DeviceLine, Losses, Metadata};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

/// Rows of a row group: 5 s at 500 Hz.
pub(super) const GROUP_ROWS: usize = 2500;
/// Share of a long record that its next row group is: the file ends with a list of all of them,
/// which is kept until then.
const SHARE: usize = 512;
/// Most rows of a row group.
const MOST_ROWS: usize = 1 << 16;

/// Rows of the row group that follows `written` rows: 5 s for the first 43 minutes, then 1/512 of
/// what there is, so that their number grows with the logarithm of the record's length (to 2300 in
/// a day, not 17 000).
fn group_rows(written: usize) -> usize {
    (written / SHARE).clamp(GROUP_ROWS, MOST_ROWS)
}
/// Prefix of whirl's keys in the file's key-value metadata.
pub(super) const KEY: &str = "whirl.";
/// Version of this layout.
pub(super) const LAYOUT: &str = "1";
/// Longest rig file that a record carries, bytes.
const RIG_LIMIT: usize = 1 << 20;

/// A file that keeps a checksum of what is written since the last reset.
struct Checked {
    file: File,
    crc: Crc,
}

impl Write for Checked {
    fn write(&mut self, buffer: &[u8]) -> std::io::Result<usize> {
        let n = self.file.write(buffer)?;
        self.crc.update(&buffer[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// Writes the file.
pub(super) struct ParquetWriter {
    path: PathBuf,
    rate: f64,
    writer: SerializedFileWriter<Checked>,
    schema: Arc<SchemaDescriptor>,
    /// Rows in finished row groups.
    written: usize,
    /// See [`Metadata::boots`].
    boots: Vec<i64>,
    /// See [`Metadata::device`].
    device: Vec<DeviceBoot>,
    /// See [`Metadata::lines`].
    lines: Vec<DeviceLine>,
    /// See [`Metadata::excitation`].
    excitation: Option<Excitation>,
    tick: Vec<i64>,
    t: Vec<f64>,
    counts: Vec<Vec<i32>>,
    phase: Vec<i32>,
    amplitude_nm: Vec<i32>,
}

/// whirl's keys for metadata known at the start.
fn key_values(metadata: &Metadata) -> Vec<KeyValue> {
    let mut pairs = vec![
        ("format", Some(LAYOUT.to_owned())),
        ("rig", Some(metadata.rig.clone())),
        ("firmware", Some(metadata.firmware.clone())),
        ("board", Some(metadata.board.clone())),
        ("source", Some(metadata.source.clone())),
        ("written_by", Some(metadata.written_by.clone())),
        ("sample_rate_hz", Some(metadata.sample_rate_hz.to_string())),
    ];
    if let Some(at) = &metadata.started_at {
        pairs.push(("started_at", Some(at.clone())));
    }
    if !metadata.table.is_empty() {
        pairs.push(("table", serde_json::to_string(&metadata.table).ok()));
    }
    if let Some(level) = &metadata.level {
        pairs.push(("level", serde_json::to_string(level).ok()));
    }
    pairs.into_iter().map(|(k, v)| KeyValue::new(format!("{KEY}{k}"), v)).collect()
}

/// whirl's key for the boots, where there was a restart.
fn boots(boots: &[i64]) -> Option<KeyValue> {
    let list: Vec<String> = boots.iter().map(i64::to_string).collect();
    (!list.is_empty()).then(|| KeyValue::new(format!("{KEY}boots"), format!("[{}]", list.join(","))))
}

/// whirl's key for what the device told of its boots.
fn device(boots: &[DeviceBoot]) -> Option<KeyValue> {
    let text = serde_json::to_string(boots).ok().filter(|_| !boots.is_empty())?;
    Some(KeyValue::new(format!("{KEY}device"), text))
}

impl ParquetWriter {
    /// `place`: the file that is opened, which may be another until the record has its name.
    pub(super) fn create(path: &Path, place: &Path, metadata: &Metadata, rig: &Rig) -> Result<Self> {
        if metadata.rig.len() > RIG_LIMIT {
            return Err(BadInput::new(
                format!("a rig file of {} bytes", metadata.rig.len()),
                format!("at most {RIG_LIMIT} bytes"),
            )
            .in_file(&rig.path)
            .remedy("Shorten its comments"));
        }
        if let Some(c) = rig.channel.iter().find(|c| c.name == "t" || OWN_COLUMNS.contains(&c.name.as_str())) {
            return Err(BadInput::new(format!("a channel named {}", c.name), "a name that whirl's records do not use")
                .in_file(&rig.path)
                .at(format!("channel \"{}\"", c.name))
                .remedy("Rename the channel: t, tick, phase and amplitude_nm are columns of every record"));
        }
        let failed = |e: ParquetError| BadInput::new(e.to_string(), "").in_file(path);
        let schema = Arc::new(schema(rig).map_err(failed)?);
        let mut properties = WriterProperties::builder()
            .set_created_by(format!("whirl version {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::SNAPPY)
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::None)
            .set_offset_index_disabled(true)
            .set_encoding(Encoding::DELTA_BINARY_PACKED)
            .set_key_value_metadata(Some(key_values(metadata)));
        properties = properties.set_column_encoding(ColumnPath::from("t"), Encoding::BYTE_STREAM_SPLIT);
        let file = Checked { file: create_file(path, place)?, crc: Crc::new() };
        let mut writer =
            SerializedFileWriter::new(file, schema.clone(), Arc::new(properties.build())).map_err(failed)?;
        let schema = Arc::new(SchemaDescriptor::new(schema));
        let head = key_values(metadata).into_iter().chain(device(&metadata.device)).collect();
        let first = marker(&schema, Some(head), None, Crc::new().sum()).map_err(failed)?;
        writer.write_all(&first).and_then(|()| writer.flush()).map_err(|e| BadInput::io(path, &e))?;
        let column = Vec::with_capacity(GROUP_ROWS);
        Ok(Self {
            path: path.to_path_buf(),
            rate: metadata.sample_rate_hz,
            writer,
            schema,
            written: 0,
            boots: metadata.boots.clone(),
            device: metadata.device.clone(),
            lines: metadata.lines.clone(),
            excitation: metadata.excitation,
            tick: Vec::with_capacity(GROUP_ROWS),
            t: Vec::with_capacity(GROUP_ROWS),
            counts: vec![column.clone(); rig.channel.len()],
            phase: column.clone(),
            amplitude_nm: column,
        })
    }

    pub(super) fn boot(&mut self, tick: i64) {
        self.boots.push(tick);
    }

    pub(super) fn device(&mut self, boots: &[DeviceBoot]) {
        self.device = boots.to_vec();
    }

    pub(super) fn lines(&mut self, lines: &[DeviceLine]) {
        self.lines = lines.to_vec();
    }

    pub(super) fn excitation(&mut self, excitation: Option<&Excitation>) {
        self.excitation = excitation.copied();
    }

    pub(super) fn push(&mut self, sample: &Sample<'_>) -> Result<()> {
        self.tick.push(sample.tick);
        self.t.push(sample.tick as f64 / self.rate);
        for (column, &count) in self.counts.iter_mut().zip(sample.counts) {
            column.push(count);
        }
        // Parquet's unsigned 32-bit integers are stored as the same bits, signed.
        self.phase.push(sample.phase.cast_signed());
        self.amplitude_nm.push(sample.amplitude_nm.cast_signed());
        if self.tick.len() >= group_rows(self.written) { self.write_group() } else { Ok(()) }
    }

    fn write_group(&mut self) -> Result<()> {
        if self.tick.is_empty() {
            return Ok(());
        }
        self.try_write_group().map_err(|e| failed(&self.path, &e))?;
        self.written += self.tick.len();
        self.tick.clear();
        self.t.clear();
        self.counts.iter_mut().for_each(Vec::clear);
        self.phase.clear();
        self.amplitude_nm.clear();
        Ok(())
    }

    fn try_write_group(&mut self) -> ParquetResult<()> {
        self.writer.flush()?;
        self.writer.inner_mut().crc = Crc::new();
        let mut group = self.writer.next_row_group()?;
        column::<Int64Type>(&mut group, &self.tick)?;
        column::<DoubleType>(&mut group, &self.t)?;
        for counts in &self.counts {
            column::<Int32Type>(&mut group, counts)?;
        }
        column::<Int32Type>(&mut group, &self.phase)?;
        column::<Int32Type>(&mut group, &self.amplitude_nm)?;
        group.close()?;
        self.writer.flush()?;
        let crc = self.writer.inner().crc.sum();
        let last = self.writer.flushed_row_groups().last().cloned();
        // The head has the first boot.
        let pairs = boots(&self.boots).map(|boots| core::iter::once(boots).chain(device(&self.device)).collect());
        let bytes = marker(&self.schema, pairs, last, crc)?;
        self.writer.write_all(&bytes)?;
        self.writer.flush()?;
        Ok(())
    }

    pub(super) fn finish(mut self, losses: &Losses) -> Result<()> {
        self.write_group()?;
        let bad = |e: serde_json::Error| BadInput::new(e.to_string(), "").in_file(&self.path);
        let json = serde_json::to_string(losses).map_err(bad)?;
        if !self.lines.is_empty() {
            let lines = serde_json::to_string(&self.lines).map_err(bad)?;
            self.writer.append_key_value_metadata(KeyValue::new(format!("{KEY}log"), lines));
        }
        if let Some(excitation) = &self.excitation {
            let text = serde_json::to_string(excitation).map_err(bad)?;
            self.writer.append_key_value_metadata(KeyValue::new(format!("{KEY}excitation"), text));
        }
        self.writer.append_key_value_metadata(KeyValue::new(format!("{KEY}losses"), json));
        for pair in boots(&self.boots).into_iter().chain(device(&self.device)) {
            self.writer.append_key_value_metadata(pair);
        }
        self.writer.finish().map_err(|e| failed(&self.path, &e))?;
        self.writer.inner().file.sync_all().map_err(|e| BadInput::io(&self.path, &e))
    }
}

fn failed(path: &Path, e: &ParquetError) -> BadInput {
    BadInput::new(e.to_string(), "")
        .in_file(path)
        .remedy("Free space on the disk; what was written until then is read with --recover")
}

fn column<T: DataType>(group: &mut SerializedRowGroupWriter<'_, Checked>, values: &[T::T]) -> ParquetResult<()> {
    let Some(mut column) = group.next_column()? else {
        return Err(ParquetError::General("more columns than the schema has".to_owned()));
    };
    column.typed::<T>().write_batch(values, None, None)?;
    column.close()
}

fn schema(rig: &Rig) -> ParquetResult<Type> {
    let field = |name: &str, physical: Physical, logical: Option<LogicalType>| {
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(logical)
            .build()
            .map(Arc::new)
    };
    let unsigned = Some(LogicalType::integer(32, false));
    let mut fields = vec![field("tick", Physical::INT64, None)?, field("t", Physical::DOUBLE, None)?];
    for c in &rig.channel {
        fields.push(field(&c.name, Physical::INT32, None)?);
    }
    fields.push(field("phase", Physical::INT32, unsigned.clone())?);
    fields.push(field("amplitude_nm", Physical::INT32, unsigned)?);
    Type::group_type_builder("whirl").with_fields(fields).build()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn created(path: &Path, metadata: &Metadata, rig: &Rig) -> Result<ParquetWriter> {
        ParquetWriter::create(path, path, metadata, rig)
    }

    #[test]
    fn a_day_has_some_thousand_row_groups_and_a_short_record_small_ones() {
        assert_eq!((group_rows(0), group_rows(1_000_000), group_rows(usize::MAX)), (2500, 2500, 65_536));
        let (mut written, mut groups) = (0, 0);
        while written < 43_200_000 {
            written += group_rows(written);
            groups += 1;
        }
        assert!((2000..2600).contains(&groups), "{groups}");
    }

    /// A rig of one channel of this name.
    fn rig(channel: &str) -> Rig {
        let text = format!(
            "name = \"x\"\nmodel = \"chain\"\nsample_rate_hz = 500.0\n[[channel]]\nname = \"{channel}\"\n\
             measures = \"x0\"\nunit = \"count\"\ncounts_per_turn = 4096\n"
        );
        Rig::parse(&text, Path::new("rig.toml")).unwrap()
    }

    #[test]
    fn rows_of_finished_row_groups_are_counted_for_the_next_ones_length() {
        let folder = tempfile::tempdir().unwrap();
        let metadata = Metadata { sample_rate_hz: 500.0, ..Metadata::default() };
        let mut writer = created(&folder.path().join("r.parquet"), &metadata, &rig("count1")).unwrap();
        let mut push = |ticks: core::ops::Range<i64>| {
            for tick in ticks {
                writer.push(&Sample { tick, counts: &[0], phase: 0, amplitude_nm: 0 }).unwrap();
            }
            (writer.written, writer.tick.len())
        };
        assert_eq!(push(0..2499), (0, 2499));
        assert_eq!(push(2499..5003), (5000, 3));
        writer.written = 3000 * SHARE;
        let mut push = |ticks: core::ops::Range<i64>| {
            ticks.for_each(|tick| writer.push(&Sample { tick, counts: &[0], phase: 0, amplitude_nm: 0 }).unwrap());
            writer.tick.len()
        };
        assert_eq!(push(5003..7999), 2999);
        assert_eq!(push(7999..8000), 0);
    }

    #[test]
    fn a_channel_with_the_name_of_a_column_of_every_record_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.parquet");
        for name in ["t", "tick", "phase", "amplitude_nm"] {
            let refused = created(&path, &Metadata::default(), &rig(name)).err().map(|e| e.to_string());
            let e = refused.unwrap_or_else(|| panic!("a channel {name} was taken"));
            assert!(e.contains(&format!("a channel named {name}")) && !path.exists(), "{e}");
        }
    }

    #[test]
    fn a_rig_file_goes_into_the_record_up_to_a_mebibyte() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.parquet");
        for (length, taken) in [(RIG_LIMIT, true), (RIG_LIMIT + 1, false)] {
            let metadata = Metadata { rig: "#".repeat(length), ..Metadata::default() };
            assert_eq!(created(&path, &metadata, &rig("count1")).is_ok(), taken, "{length}");
        }
    }
}

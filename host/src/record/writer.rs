//! Writes whirl's own records as samples come: Parquet, or CSV by the file's extension. Memory is
//! bounded.

use std::path::{Path, PathBuf};

use whirl_shared::excitation::Excitation;

use super::csv_write::CsvWriter;
use super::parquet_write::ParquetWriter;
use super::{DeviceBoot, DeviceLine, Losses, Metadata};
use crate::error::{BadInput, Result};
use crate::files::Part;
use crate::rig::measures::BASE;
use crate::rig::{Channel, Rig, computed};

/// One sample of whirl's own records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample<'a> {
    /// Device's tick, made continuous in 64 bits; t = tick / sampling rate.
    pub tick: i64,
    /// Multi-turn counts, one for each channel of the rig file.
    pub counts: &'a [i32],
    /// The drive's phase, turns · 2⁻³².
    pub phase: u32,
    /// Commanded amplitude of the base, nm.
    pub amplitude_nm: u32,
}

/// What to do where a record that can be made again cannot be written.
pub(super) const FULL: &str =
    "Free space on the disk, or name another folder; nothing was written, and what has this name stays as it was";

/// Endings of the records that are written.
const ENDINGS: [&str; 4] = [".parquet", ".pq", ".csv", ".csv.gz"];

/// Refuses a record's name whose ending promises a format that is not written: Parquet under such a
/// name would be found out only by the program that opens it. What stands behind a dot without
/// looking like an ending (`run.2`) is part of the name.
///
/// # Errors
/// Names the endings that can be written.
pub fn check_ending(path: &Path) -> Result<()> {
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let Some((_, ending)) = name.trim_start_matches('.').rsplit_once('.') else { return Ok(()) };
    let promises = ending.starts_with(|c: char| c.is_ascii_alphabetic())
        && ending.len() <= 7
        && ending.chars().all(|c| c.is_ascii_alphanumeric());
    if !promises || ENDINGS.iter().any(|known| name.ends_with(known)) {
        return Ok(());
    }
    Err(BadInput::new(format!("a record with the ending .{ending}"), "one of .parquet, .csv, .csv.gz")
        .in_file(path)
        .at("-o")
        .remedy("Name the record with one of these endings; without one it is Parquet"))
}

/// Writes a record sample by sample.
pub struct RecordWriter {
    path: PathBuf,
    channels: usize,
    last_tick: Option<i64>,
    rows: u64,
    inner: Inner,
    /// Where it is written until it is whole; none where it is written under its name.
    part: Option<Part>,
}

enum Inner {
    Parquet(Box<ParquetWriter>),
    Csv(Box<CsvWriter>),
}

impl RecordWriter {
    /// Opens `path` (an existing file is replaced) for a record of the rig's channels, which must
    /// be counts, or the base's with a gain, the unit's worth of a count. The clock is
    /// `metadata.sample_rate_hz`, or the rig's where that is 0. `.csv` and
    /// `.csv.gz` give CSV, everything else Parquet. What is measured is written under its name from
    /// the first sample on, so that a capture that was cut off can be read.
    ///
    /// # Errors
    /// A file that cannot be written; a channel that holds no counts.
    pub fn create(path: impl AsRef<Path>, metadata: &Metadata, rig: &Rig) -> Result<Self> {
        Self::create_at(path.as_ref(), None, metadata, rig)
    }

    /// The same for a record that can be made again: it gets its name when it is finished, and what
    /// had the name is there until then.
    ///
    /// # Errors
    /// As [`RecordWriter::create`].
    pub fn create_beside(path: impl AsRef<Path>, metadata: &Metadata, rig: &Rig) -> Result<Self> {
        let path = path.as_ref();
        Self::create_at(path, Some(Part::of(path)?), metadata, rig)
    }

    fn create_at(path: &Path, part: Option<Part>, metadata: &Metadata, rig: &Rig) -> Result<Self> {
        computed::refuse(&rig.channel, &rig.path)?;
        let worthless = |c: &&Channel| c.unit != "count" && !(c.measures == BASE && c.gain.is_some());
        if let Some(c) = rig.channel.iter().find(worthless) {
            return Err(BadInput::new(
                format!("unit \"{}\"", c.unit),
                "unit \"count\": whirl's own records hold raw counts",
            )
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", c.name))
            .remedy(if c.measures == BASE {
                "Give the channel gain, what a count of the base's sensor is worth in its unit"
            } else {
                "Give the channel unit = \"count\" and counts_per_turn"
            }));
        }
        let mut metadata = metadata.clone();
        if !(metadata.sample_rate_hz.is_finite() && metadata.sample_rate_hz > 0.0) {
            metadata.sample_rate_hz = rig.sample_rate_hz;
        }
        let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
        let place = part.as_ref().map_or(path, Part::place);
        let inner = if name.ends_with(".csv") || name.ends_with(".csv.gz") {
            Inner::Csv(Box::new(CsvWriter::create(path, place, &metadata, rig)?))
        } else {
            Inner::Parquet(Box::new(ParquetWriter::create(path, place, &metadata, rig)?))
        };
        Ok(Self { path: path.to_path_buf(), channels: rig.channel.len(), last_tick: None, rows: 0, inner, part })
    }

    /// The device has restarted: the samples from this tick on are of another boot (CSV has no room
    /// for it).
    pub fn boot(&mut self, tick: i64) {
        if let Inner::Parquet(w) = &mut self.inner {
            w.boot(tick);
        }
    }

    /// What the device has told of its boots until now (CSV has no room for it).
    pub fn device(&mut self, boots: &[DeviceBoot]) {
        if let Inner::Parquet(w) = &mut self.inner {
            w.device(boots);
        }
    }

    /// What the device said, for the metadata (CSV has no room for it).
    pub fn lines(&mut self, lines: &[DeviceLine]) {
        if let Inner::Parquet(w) = &mut self.inner {
            w.lines(lines);
        }
    }

    /// What moved the base, for the metadata (CSV has no room for it).
    pub fn excitation(&mut self, excitation: Option<&Excitation>) {
        if let Inner::Parquet(w) = &mut self.inner {
            w.excitation(excitation);
        }
    }

    /// Appends a sample.
    ///
    /// # Errors
    /// A full disk; a tick that is not later than the one before; a wrong number of counts.
    pub fn push(&mut self, sample: &Sample<'_>) -> Result<()> {
        if sample.counts.len() != self.channels {
            return Err(BadInput::new(format!("{} counts", sample.counts.len()), format!("{}", self.channels))
                .in_file(&self.path)
                .at(format!("tick {}", sample.tick)));
        }
        if let Some(last) = self.last_tick
            && sample.tick <= last
        {
            return Err(BadInput::new(format!("tick {} after {last}", sample.tick), "a later tick").in_file(&self.path));
        }
        self.last_tick = Some(sample.tick);
        self.rows += 1;
        let pushed = match &mut self.inner {
            Inner::Parquet(w) => w.push(sample),
            Inner::Csv(w) => w.push(sample),
        };
        pushed.map_err(|e| if self.part.is_some() { e.remedy(FULL) } else { e })
    }

    /// Samples taken so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Ends the record: what was lost, and the metadata as known at the end, go into it (CSV has no
    /// room for them).
    ///
    /// # Errors
    /// A full disk.
    pub fn finish(self, losses: &Losses) -> Result<()> {
        let finished = match self.inner {
            Inner::Parquet(w) => w.finish(losses),
            Inner::Csv(w) => w.finish(),
        };
        let Some(part) = self.part else { return finished };
        finished.map_err(|e| e.remedy(FULL))?;
        part.keep().map_err(|e| BadInput::io(&self.path, &e).remedy(FULL))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ending_that_is_not_written_is_refused() {
        for name in ["r.parquet", "R.CSV", "a/r.csv.gz", "r.pq", "r", "run.2", "run 1.25 Hz", ".hidden", "a.b/r"] {
            assert!(check_ending(Path::new(name)).is_ok(), "{name}");
        }
        for name in ["q.xlsx", "q.gz", "q.mat", "q.csv.zip", "q.json"] {
            let e = check_ending(Path::new(name)).unwrap_err().to_string();
            assert!(e.contains("one of .parquet, .csv, .csv.gz") && e.contains("-o"), "{e}");
        }
    }

    #[test]
    fn a_record_that_can_be_made_again_replaces_another_once_it_is_whole() {
        let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 500.0\n[[channel]]\nname = \"c\"\n\
                    measures = \"q\"\nunit = \"count\"\ncounts_per_turn = 4096\n";
        let rig = Rig::parse(text, Path::new("rig.toml")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for name in ["r.csv", "r.csv.gz", "r.parquet"] {
            let path = folder.path().join(name);
            std::fs::write(&path, "before").unwrap();
            let write = || {
                let mut w = RecordWriter::create_beside(&path, &Metadata::default(), &rig).unwrap();
                w.push(&Sample { tick: 0, counts: &[1], phase: 0, amplitude_nm: 0 }).unwrap();
                w
            };
            drop(write());
            assert_eq!(std::fs::read_to_string(&path).unwrap(), "before", "{name}");
            write().finish(&Losses::default()).unwrap();
            assert_ne!(std::fs::read(&path).unwrap(), b"before", "{name}");
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{name}");
            std::fs::remove_file(&path).unwrap();
        }
    }
}

//! The journal of a capture: every byte of the wire, in a file beside the record (`REC.frames`), from which the record can be
//! made again: `whirl capture --from file:REC.frames --rig RIG.toml -o REC`.
//!
//! It begins with `whirl-frames 1 `, the capture's terms as JSON, and a zero byte; then come the wire's bytes up to the one
//! with which the recording ended. Where the link was lost, a zero byte stands between what came before and after, so that
//! the frame that was cut does not spoil the next one. A record is a function of these bytes and the rig file alone.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{BadInput, Result};

/// Begins a journal.
pub(crate) const MAGIC: &[u8] = b"whirl-frames 1 ";
/// Longest first line, bytes.
pub(super) const HEADER_LIMIT: usize = 1 << 16;

/// On what terms a capture records.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Terms {
    /// The source, for the record's metadata.
    pub source: String,
    /// Start of the capture, RFC 3339.
    pub started_at: Option<String>,
    /// Device time to record, s.
    pub seconds: Option<f64>,
    /// Record only from the moment on at which the drive runs so: amplitude µm, frequency mHz.
    pub from_drive: Option<(u32, u32)>,
    /// Record only when that long has gone by since then (or since the first sample), s of device time.
    pub settle_s: f64,
    /// Samples before a hello are not recorded.
    pub hello_first: bool,
    /// Regression rows are recorded, not samples.
    pub rows: bool,
}

/// The journal beside a record.
pub fn path_of(record: &Path) -> PathBuf {
    let mut name = record.as_os_str().to_owned();
    name.push(".frames");
    name.into()
}

/// A journal that is being written.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    bytes: u64,
}

impl Journal {
    /// Starts the journal of `record`.
    ///
    /// # Errors
    /// One that is there already: it holds a capture that did not end.
    pub(super) fn create(record: &Path, terms: &Terms) -> Result<Self> {
        let path = path_of(record);
        let mut file = File::create_new(&path).map_err(|e| {
            if e.kind() == std::io::ErrorKind::AlreadyExists {
                BadInput::new("the journal of a capture that did not end", "no such file").in_file(&path).remedy(
                    format!(
                        "Make its record with `whirl capture --from file:{} --rig RIG.toml -o {}`, or delete it",
                        path.display(),
                        record.display()
                    ),
                )
            } else {
                BadInput::io(&path, &e).remedy("Name an output file in a folder that exists and can be written")
            }
        })?;
        let json = serde_json::to_string(terms).map_err(|e| BadInput::new(e.to_string(), "").in_file(&path))?;
        let header = [MAGIC, json.as_bytes(), b"\0"].concat();
        file.write_all(&header).map_err(|e| BadInput::io(&path, &e))?;
        Ok(Self { path, file, bytes: 0 })
    }

    /// Appends bytes of the wire; they are with the operating system when this returns.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes).map_err(|e| {
            BadInput::io(&self.path, &e).remedy("Free space on the disk; what was captured until now is readable")
        })
    }

    /// Ends the journal.
    pub(super) fn finish(self, keep: bool) -> Result<()> {
        let Self { path, file, .. } = self;
        drop(file);
        if keep { Ok(()) } else { std::fs::remove_file(&path).map_err(|e| BadInput::io(&path, &e)) }
    }
}

/// Terms at the start of a journal, and where the wire's bytes begin; none for bytes without such a start.
///
/// # Errors
/// A start that is damaged.
pub(super) fn header(start: &[u8], path: &Path) -> Result<Option<(Terms, usize)>> {
    let Some(rest) = start.strip_prefix(MAGIC) else {
        return Ok(None);
    };
    let bad = |found: String| {
        BadInput::new(found, "the terms of a capture")
            .in_file(path)
            .at("start of file")
            .remedy("The journal is damaged; its bytes behind the first zero are those of the wire")
    };
    let end = rest.iter().position(|&b| b == 0).ok_or_else(|| bad("no end of the first line".to_owned()))?;
    let terms: Terms = serde_json::from_slice(&rest[..end]).map_err(|e| bad(e.to_string()))?;
    if terms.seconds.is_some_and(|s| !(s.is_finite() && s > 0.0)) || !(0.0..=1e7).contains(&terms.settle_s) {
        return Err(bad("times that cannot be".to_owned()));
    }
    Ok(Some((terms, MAGIC.len() + end + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_come_back_and_a_journal_is_never_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let record = dir.path().join("r.parquet");
        let terms =
            Terms { source: "sim".into(), seconds: Some(2.5), from_drive: Some((15_525, 5000)), ..Default::default() };
        let mut journal = Journal::create(&record, &terms).unwrap();
        journal.write(&[1, 2, 0, 3]).unwrap();
        journal.finish(true).unwrap();
        let bytes = std::fs::read(path_of(&record)).unwrap();
        let (read, at) = header(&bytes, &record).unwrap().unwrap();
        assert_eq!((read, &bytes[at..]), (terms, &[1u8, 2, 0, 3][..]));
        let e = Journal::create(&record, &Terms::default()).err().unwrap().to_string();
        assert!(e.contains("did not end") && e.contains("--from file:"), "{e}");
        assert!(header(b"\x05raw bytes\0", &record).unwrap().is_none());
        assert!(header(b"whirl-frames 1 {\"seconds\":-1}\0", &record).is_err());
        assert!(header(b"whirl-frames 1 {", &record).is_err());
    }
}

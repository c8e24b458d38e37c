//! The journal of a capture: every byte of the wire, in a file beside the record (`REC.frames`),
//! from which the record can be made again:
//! `whirl capture --from file:REC.frames --rig RIG.toml -o REC`.
//!
//! It begins with `whirl-frames 1 `, the capture's terms as JSON, and a zero byte; then come the
//! wire's bytes up to the one with which the recording ended: whole frames, without those that say
//! nothing (see `super::sieve`). Where the link was lost or the capture was resumed, a zero byte
//! may stand between what came before and after, so that a frame that was cut does not spoil the
//! next one. A record is a function of these bytes and the rig file alone.
//!
//! A journal that somebody asked to keep ends with a zero byte and `whirl-frames kept`, which no
//! zero follows: to a decoder it is the start of a frame that never ends. What makes a record again
//! from such a journal neither removes it nor replaces a record unasked. Where a capture goes on
//! behind the mark, it is a frame that is refused, and the journal is kept all the same.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::drive::Target;
use super::excite;
use crate::error::{BadInput, Result};
use crate::record::Level;
use crate::rig::Rig;
use crate::rig::measures::BASE;

/// Begins a journal.
pub(crate) const MAGIC: &[u8] = b"whirl-frames 1 ";
/// Longest first line, bytes.
pub(super) const HEADER_LIMIT: usize = 1 << 16;
/// Ends a journal that is to be kept.
const KEPT: &[u8] = b"\0whirl-frames kept";
/// A loss of power costs what came within this long: half of the second that is promised.
const SYNC: Duration = Duration::from_millis(500);

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
    /// Record only when that long has gone by since then (or since the first sample), s of device
    /// time.
    pub settle_s: f64,
    /// Samples before a hello are not recorded.
    pub hello_first: bool,
    /// Regression rows are recorded, not samples.
    pub rows: bool,
    /// Control points of the table that the device was brought.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub table: Vec<i16>,
    /// What the amplitude was levelled to; it is `from_drive`'s then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level: Option<Level>,
    /// Options of the command that a continuation must have too, beside source, rig file and
    /// record.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<String>,
    /// What of rig file and drive a continuation must share, in words; empty in a journal that does
    /// not say.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rig: Vec<String>,
}

/// What of the rig file and of the drive decides what a record means.
pub(super) fn essentials(rig: &Rig, target: Option<Target>) -> Vec<String> {
    let mut list = vec![format!("sample_rate_hz = {}", rig.sample_rate_hz)];
    for c in &rig.channel {
        let counts = c.counts_per_turn.map_or_else(|| "none".to_owned(), |n| n.to_string());
        let worth =
            c.gain.filter(|_| c.measures == BASE).map_or_else(String::new, |g| format!(", gain = {g:e} {}", c.unit));
        list.push(format!("channel \"{}\" for {}, counts_per_turn = {counts}{worth}", c.name, c.measures));
    }
    list.push(match target {
        Some(t) => format!("a drive of {}", excite::words(&t.0)),
        None => "no drive".to_owned(),
    });
    list
}

/// The journal beside a record.
pub fn path_of(record: &Path) -> PathBuf {
    let mut name = record.as_os_str().to_owned();
    name.push(".frames");
    name.into()
}

/// A journal that is being written; no other program takes it as its own meanwhile (a lock on the
/// file says so).
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    sync: Sync,
    /// It was to be kept before this capture.
    kept: bool,
}

/// What becomes of a journal at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// It is of no further use.
    Removed,
    /// The capture was to be longer: it may be gone on with, or made a record of.
    Left,
    /// Somebody asked for it.
    Kept,
}

/// Brings what was written to the disk every half second, beside the capture: a disk that is slow
/// for a moment must not keep the link from being read.
struct Sync {
    /// Something was written since the last time.
    dirty: Arc<AtomicBool>,
    /// Dropped, it ends the thread.
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<std::io::Result<()>>>,
}

impl Sync {
    fn start(file: &File) -> std::io::Result<Self> {
        let (file, dirty) = (file.try_clone()?, Arc::new(AtomicBool::new(true)));
        let (end, ended) = channel::<()>();
        let seen = Arc::clone(&dirty);
        let work = move || {
            loop {
                let wait = ended.recv_timeout(SYNC);
                if seen.swap(false, Ordering::AcqRel) {
                    file.sync_data()?;
                }
                if wait == Err(RecvTimeoutError::Disconnected) {
                    return Ok(());
                }
            }
        };
        let thread = std::thread::Builder::new().name("journal".to_owned()).spawn(work)?;
        Ok(Self { dirty, end: Some(end), thread: Some(thread) })
    }

    /// What the disk said, where the thread has ended.
    fn fault(&mut self) -> Option<std::io::Error> {
        if self.end.is_some() && !self.thread.as_ref()?.is_finished() {
            return None;
        }
        self.thread.take()?.join().ok()?.err()
    }
}

impl Drop for Sync {
    fn drop(&mut self) {
        self.end = None;
        if let Some(thread) = self.thread.take() {
            // A fault of the disk was told at the last write, or the record beside it is whole.
            let _ = thread.join();
        }
    }
}

/// An error of a journal's file.
fn fault(path: &Path, e: &std::io::Error) -> BadInput {
    BadInput::io(path, e).remedy("Free space on the disk; what was captured until now is readable")
}

impl Journal {
    /// Starts the journal of `record`.
    ///
    /// # Errors
    /// One that is there already (see [`super::interrupted`]); a folder that cannot be written.
    pub(super) fn create(record: &Path, terms: &Terms) -> Result<Self> {
        let path = path_of(record);
        let json = serde_json::to_string(terms).map_err(|e| BadInput::new(e.to_string(), "").in_file(&path))?;
        let header = [MAGIC, json.as_bytes(), b"\0"].concat();
        let file = File::create_new(&path).map_err(|e| {
            BadInput::io(&path, &e).remedy("Name an output file in a folder that exists and can be written")
        })?;
        let journal = Self::of(path, file)?;
        journal.append(&header)?;
        // The name too is on the disk from now on; folders cannot be opened everywhere.
        let folder = record.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
        Ok(journal)
    }

    /// Takes up the journal of a capture that was interrupted, to go on behind its end.
    ///
    /// # Errors
    /// One that another program is writing.
    pub(super) fn take_up(path: &Path) -> Result<Self> {
        let file = OpenOptions::new().read(true).append(true).open(path).map_err(|e| BadInput::io(path, &e))?;
        Self::of(path.to_path_buf(), file)
    }

    fn of(path: PathBuf, file: File) -> Result<Self> {
        lock(&file, &path)?;
        let kept = is_kept(&path);
        let sync = Sync::start(&file).map_err(|e| BadInput::io(&path, &e))?;
        Ok(Self { path, file, sync, kept })
    }

    fn append(&self, bytes: &[u8]) -> Result<()> {
        (&self.file).write_all(bytes).map_err(|e| fault(&self.path, &e))
    }

    /// Appends bytes of the wire; they are with the operating system when this returns, and on the
    /// disk within a second.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.append(bytes)?;
        self.sync.dirty.store(true, Ordering::Release);
        self.sync.fault().map_or(Ok(()), |e| Err(fault(&self.path, &e)))
    }

    /// Whether it was to be kept before this capture.
    pub(super) fn kept(&self) -> bool {
        self.kept
    }

    /// Ends the journal.
    pub(super) fn finish(self, end: End) -> Result<()> {
        if end == End::Kept && !is_kept(&self.path) {
            self.append(KEPT)?;
        }
        let Self { path, file, sync, .. } = self;
        drop(sync);
        if end != End::Removed {
            return file.sync_all().map_err(|e| fault(&path, &e));
        }
        // Removed before it is unlocked: nobody else takes it up in between.
        let removed = remove(&path);
        drop(file);
        removed
    }
}

/// Takes the journal's lock. Where a file system has none, this goes on without: the journal is
/// never overwritten anyhow.
fn lock(file: &File, path: &Path) -> Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(busy(path)),
        _ => Ok(()),
    }
}

fn busy(path: &Path) -> BadInput {
    BadInput::new("a capture that is under way", "a journal that nobody writes")
        .in_file(path)
        .remedy("Let that capture end, or name another output file")
}

/// Whether a capture is writing this journal now.
pub(super) fn is_busy(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
}

/// Whether somebody asked to keep this journal.
pub fn is_kept(path: &Path) -> bool {
    let end = |file: &mut File| {
        let mut end = [0; KEPT.len()];
        // Of a few bytes: within any offset.
        file.seek(SeekFrom::End(-(KEPT.len() as i64)))?;
        file.read_exact(&mut end)?;
        Ok::<_, std::io::Error>(end)
    };
    path.is_file() && File::open(path).and_then(|mut file| end(&mut file)).is_ok_and(|end| end == KEPT)
}

/// Removes a journal that is of no further use.
pub(super) fn remove(path: &Path) -> Result<()> {
    std::fs::remove_file(path).map_err(|e| BadInput::io(path, &e))
}

/// Terms of a journal file; none where it does not begin like one. A capture that was killed at
/// once leaves a start that was cut.
pub(super) fn terms_of(path: &Path) -> Result<Start> {
    let mut start = Vec::new();
    let io = |e: std::io::Error| BadInput::io(path, &e);
    File::open(path).map_err(io)?.take(HEADER_LIMIT as u64).read_to_end(&mut start).map_err(io)?;
    if is_cut(&start) {
        return Ok(Start::Cut);
    }
    Ok(header(&start, path)?.map_or(Start::Raw, |(terms, _)| Start::Terms(Box::new(terms))))
}

/// How a file of frames begins.
#[derive(Debug, PartialEq)]
pub(super) enum Start {
    /// With a capture's terms.
    Terms(Box<Terms>),
    /// Like a journal whose capture ended before its first line was written: it holds nothing of
    /// the wire.
    Cut,
    /// With the wire's bytes.
    Raw,
}

/// Whether this is all of a file, and it ends within a journal's first line.
pub(super) fn is_cut(start: &[u8]) -> bool {
    let begins = start.len() < MAGIC.len() && MAGIC.starts_with(start);
    let within = start.starts_with(MAGIC) && start.len() < HEADER_LIMIT && !start.contains(&0);
    begins || within
}

/// Terms at the start of a journal, and where the wire's bytes begin; none for bytes without such a
/// start.
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
#[path = "journal_tests.rs"]
mod tests;

//! The formats that a record is read from: one file and one line in [`FORMATS`] each.
//!
//! The content decides before the extension does: a gzip or Parquet file is known by its first
//! bytes whatever its name.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::Record;
use super::names::TimeChoice;
use super::stream::Streamed;
use crate::error::{BadInput, Result};
use crate::files;
use crate::rig::Rig;

/// How a record is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Read a truncated or torn file up to its last whole row, with a warning, instead of refusing
    /// it.
    pub recover: bool,
    /// Make an uneven clock even, by cubics between the samples, with a warning.
    pub resample: bool,
}

/// A column of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its name.
    pub name: String,
    /// Whether its cells are numbers, so that it may be a channel.
    pub is_number: bool,
}

/// A file format for records.
pub struct Format {
    /// Short name.
    pub id: &'static str,
    /// What it is, for lists.
    pub about: &'static str,
    /// Extensions, without the first dot.
    pub extensions: &'static [&'static str],
    /// Whether a file with these first bytes (up to 512) is of this format, whatever its name.
    pub is: fn(&[u8]) -> bool,
    /// Its columns.
    pub columns: fn(&Path, &TimeChoice) -> Result<Vec<Listed>>,
    /// Reads it.
    pub read: fn(&Path, &Rig, &ReadOptions) -> Result<Record>,
    /// Reads it block by block, where the format allows that.
    pub(super) stream: Option<Streamed>,
}

/// Every format, in the order in which contents are tried.
pub static FORMATS: &[Format] = &[
    super::regression_rows::FORMAT,
    super::parquet::FORMAT,
    super::csv::GZIP,
    super::npz::FORMAT,
    super::npy::FORMAT,
    super::hdf5::FORMAT,
    super::mat::FORMAT,
    super::lvm::FORMAT,
    super::csv::FORMAT,
];

/// Reads a record in whichever format it is.
///
/// # Errors
/// A file that cannot be opened, is empty or is of no known format, and what the format's reader
/// reports.
pub fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    of(path).and_then(|format| (format.read)(path, rig, options)).map_err(|e| with_journal(e, path, rig))
}

/// Where the journal of an interrupted capture stands beside a record that cannot be read, it makes
/// the record whole.
pub(super) fn with_journal(e: BadInput, path: &Path, rig: &Rig) -> BadInput {
    match crate::capture::interrupted::whole_again(path, &rig.path) {
        Some(command) if e.file.as_deref() == Some(path) && !e.remedy.contains(&command) => {
            let remedy = format!("{command} makes it whole from the journal beside it. {}", e.remedy);
            e.remedy(remedy)
        }
        _ => e,
    }
}

/// The columns of a file, the time's and the device's among them.
///
/// # Errors
/// As [`read`], as far as the file's head goes.
pub fn columns(path: &Path, time: &TimeChoice) -> Result<Vec<Listed>> {
    of(path).and_then(|format| (format.columns)(path, time))
}

/// The format of a file.
///
/// # Errors
/// A file that cannot be opened, is empty or is of no known format.
pub fn of(path: &Path) -> Result<&'static Format> {
    let head = head(path, 512)?;
    if head.is_empty() {
        return Err(BadInput::new("an empty file (0 bytes)", "a record")
            .in_file(path)
            .at("start of file")
            .remedy("Record again, or copy the file again"));
    }
    if is_utf16(&head) {
        return Err(BadInput::new(
            "a text in UTF-16 (as Excel's \"Unicode Text\" and PowerShell's > write it)",
            "a text in UTF-8",
        )
        .in_file(path)
        .at("start of file")
        .remedy("Save it as UTF-8 (in Excel: CSV UTF-8), or: iconv -f UTF-16 -t UTF-8 FILE > utf8.csv"));
    }
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let by_extension = |f: &&Format| f.extensions.iter().any(|e| name.ends_with(&format!(".{e}")));
    let by_content = FORMATS.iter().find(|f| (f.is)(&head));
    match (by_content, FORMATS.iter().find(by_extension)) {
        (Some(format), _) => Ok(format),
        (None, Some(format)) => Err(BadInput::new(
            format!("a file that begins with {}", bytes_for_people(&head)),
            format!("{} (as its name says)", format.about),
        )
        .in_file(path)
        .at("start of file")
        .remedy("The file is damaged or of another format: copy or export it again")),
        (None, None) => {
            let list: Vec<&str> = FORMATS.iter().map(|f| f.about).collect();
            Err(BadInput::new(
                format!("a file that begins with {}", bytes_for_people(&head)),
                format!("one of: {}", list.join("; ")),
            )
            .in_file(path)
            .at("start of file")
            .remedy("Export the record as CSV with a header row and a column for the time"))
        }
    }
}

/// Whether bytes are a text of two bytes a character: marked so, or Latin letters all of them.
fn is_utf16(head: &[u8]) -> bool {
    let latin = |k: usize| head.chunks_exact(2).take(32).all(|pair| pair[1 - k] == 0 && (9..127).contains(&pair[k]));
    head.starts_with(&[0xff, 0xfe]) || head.starts_with(&[0xfe, 0xff]) || (head.len() >= 8 && (latin(0) || latin(1)))
}

/// Opens a record's file.
///
/// # Errors
/// A file that cannot be opened; a folder, device, pipe or socket.
pub(super) fn open(path: &Path) -> Result<File> {
    files::open(path, "a record", "Name a record that exists and can be read")
}

/// Its first bytes, at most so many.
fn head(path: &Path, most: u64) -> Result<Vec<u8>> {
    let mut head = Vec::new();
    open(path)?.take(most).read_to_end(&mut head).map_err(|e| BadInput::io(path, &e).remedy("Copy the file again"))?;
    Ok(head)
}

/// What an existing file is, where it is something that no program of whirl's makes again: a
/// record, the journal of a capture, a rig file, a model file written by hand. None for everything
/// else, and for what cannot be read.
pub fn recorded(path: &Path) -> Option<&'static str> {
    // As much as a CSV's longest header row, and as a rig file has.
    let head = head(path, 1 << 20).ok()?;
    if head.starts_with(crate::capture::journal::MAGIC) {
        return Some("the journal of a capture");
    }
    if FORMATS.iter().any(|f| f.id != super::csv::FORMAT.id && (f.is)(&head)) {
        return Some("a record");
    }
    let text = std::str::from_utf8(&head).ok()?.trim_start_matches('\u{feff}').trim_start();
    let header = text.lines().next().unwrap_or_default();
    if header.contains([',', ';', '\t'])
        && header.split([',', ';', '\t']).any(|c| super::names::is_time(c.trim().trim_matches('"')))
    {
        return Some("a record");
    }
    let table: toml::Table = toml::from_str(text).ok()?;
    if table.contains_key("sample_rate_hz") && table.contains_key("channel") {
        return Some("a rig file");
    }
    // One that was identified names its method.
    (table.contains_key("equation") && !table.contains_key("method")).then_some("a model file")
}

/// Whether a file's name says that it is a record, or what a capture writes beside one.
pub fn is_named_as_record(path: &Path) -> bool {
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    FORMATS
        .iter()
        .flat_map(|f| f.extensions)
        .chain(&["frames", "estimates.jsonl"])
        .any(|e| !["txt", "dat"].contains(e) && name.ends_with(&format!(".{e}")))
}

/// The first bytes of a file, printable.
fn bytes_for_people(head: &[u8]) -> String {
    let hex: Vec<String> = head.iter().take(4).map(|b| format!("{b:02x}")).collect();
    format!("the bytes {}", hex.join(" "))
}

/// A value from a file as it is shown in a message: at most 40 characters, control characters
/// escaped.
pub(super) fn shown(cell: &[u8]) -> String {
    let text = String::from_utf8_lossy(&cell[..cell.len().min(160)]);
    let mut out: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    if text.chars().count() > 40 || cell.len() > 160 {
        out.push('…');
    }
    format!("\"{out}\"")
}

//! A record of regression rows instead of samples (`whirl capture --rows`): what the device's own
//! identification has summed over each window of twenty drive periods, from which `whirl identify`
//! works alone.
//!
//! JSON, an object a line: first a [`Header`], then a [`Window`] for every complete window, last a
//! [`Footer`]. Rows are those of `whirl_shared::regressor`: of m = 0 the real one, then of each m
//! the real and the imaginary one; in a row an equation's columns, then its target. Windows with
//! consecutive `index` in one `run` overlap by half. Every line carries its checksum
//! (`super::sealed_line`).

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::formats::{self, Format, ReadOptions};
use super::sealed_line::{self, Opened, seal};
use super::{Losses, Metadata};
use crate::error::{BadInput, Result};
use crate::warning::Warning;

/// Begins such a file.
const MAGIC: &[u8] = b"{\"format\":\"whirl-rows\"";
/// Longest line, bytes: a window of 127 frequencies takes a quarter of it.
const LINE_LIMIT: u64 = 1 << 20;
/// Most frequencies of a window.
const FREQUENCIES_LIMIT: usize = 255;

/// The entry among the formats: such a file is known, and said not to hold samples.
pub(super) const FORMAT: Format = Format {
    id: "rows",
    about: "whirl's regression rows (identify only)",
    extensions: &["rows.jsonl"],
    is,
    columns: |path, _| Err(no_samples(path)),
    read: |path, _, _| Err(no_samples(path)),
    stream: None,
};

fn no_samples(path: &Path) -> BadInput {
    BadInput::new("regression rows", "samples")
        .in_file(path)
        .remedy("`whirl identify` works from rows; for everything else capture again without --rows")
}

/// Whether these are the first bytes of such a file.
fn is(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// First line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// "whirl-rows".
    pub format: String,
    /// Version of this layout: 1.
    pub version: u32,
    /// What whirl's own records carry.
    pub metadata: Metadata,
}

/// A window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// Number of the unbroken stretch.
    pub run: usize,
    /// Number of the window in it.
    pub index: usize,
    /// Tick of its last sample, on the record's line.
    pub tick: i64,
    /// Its length, ticks.
    pub window_ticks: u32,
    /// Advance of the drive's phase in a tick, turns · 2⁻³².
    pub phase_increment: u32,
    /// Commanded amplitude, nm.
    pub amplitude_nm: u32,
    /// Rows of the first equation: B11 B12 B13 B14 C11 C12, target.
    pub first: Vec<[f32; 7]>,
    /// Rows of the second equation: B21 B22 B23 B24 C2, target.
    pub second: Vec<[f32; 6]>,
}

/// Last line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Footer {
    /// Windows in the file.
    pub windows: u64,
    /// Windows of which a part was lost, or all of it.
    pub windows_lost: u64,
    /// Samples under the windows, and what the device says it never took.
    pub losses: Losses,
}

/// A line behind the first.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Line {
    Window(Window),
    End(Footer),
}

/// A record of rows.
#[derive(Clone, Debug)]
pub struct RowsRecord {
    /// File it was read from.
    pub path: PathBuf,
    /// First line.
    pub header: Header,
    /// Windows, in order of time.
    pub windows: Vec<Window>,
    /// Last line.
    pub footer: Footer,
    /// Things noticed while reading.
    pub warnings: Vec<Warning>,
}

/// Writes the file; each line is with the operating system when it is written.
pub struct RowsWriter {
    path: PathBuf,
    file: BufWriter<File>,
}

impl RowsWriter {
    /// Creates the file.
    ///
    /// # Errors
    /// A path that cannot be written.
    pub fn create(path: &Path, metadata: Metadata) -> Result<Self> {
        let file = File::create(path).map_err(|e| {
            BadInput::io(path, &e).remedy("Name an output file in a folder that exists and can be written")
        })?;
        let mut writer = Self { path: path.to_path_buf(), file: BufWriter::new(file) };
        writer.line(&Header { format: "whirl-rows".to_owned(), version: 1, metadata })?;
        Ok(writer)
    }

    fn line(&mut self, line: &impl Serialize) -> Result<()> {
        let failed = |e: String| {
            BadInput::new(e, "")
                .in_file(&self.path)
                .remedy("Free space on the disk; what was written is read with --recover")
        };
        let text = seal(&serde_json::to_string(line).map_err(|e| failed(e.to_string()))?) + "\n";
        self.file.write_all(text.as_bytes()).and_then(|()| self.file.flush()).map_err(|e| failed(e.to_string()))
    }

    /// Appends a window.
    ///
    /// # Errors
    /// A full disk.
    pub fn push(&mut self, window: Window) -> Result<()> {
        self.line(&Line::Window(window))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// A full disk.
    pub fn finish(mut self, footer: Footer) -> Result<()> {
        self.line(&Line::End(footer))?;
        self.file.get_ref().sync_all().map_err(|e| BadInput::io(&self.path, &e))
    }
}

/// Whether a file holds rows; false also where it cannot be read.
pub fn holds_rows(path: &Path) -> bool {
    let mut head = Vec::new();
    formats::open(path).is_ok_and(|f| f.take(MAGIC.len() as u64).read_to_end(&mut head).is_ok()) && is(&head)
}

/// Checks that a window can be worked with.
fn check(window: &Window, last: Option<&Window>) -> std::result::Result<(), String> {
    let rows = window.first.len();
    if rows != window.second.len() || rows.is_multiple_of(2) || !(5..=2 * FREQUENCIES_LIMIT + 1).contains(&rows) {
        return Err(format!("{rows} and {} rows", window.second.len()));
    }
    if last.is_some_and(|w| w.first.len() != rows) {
        return Err(format!("{rows} rows, other than in the window before"));
    }
    if window.window_ticks < 16 || window.phase_increment == 0 {
        return Err(format!("a window of {} ticks at a drive of {}", window.window_ticks, window.phase_increment));
    }
    if window.first.as_flattened().iter().chain(window.second.as_flattened()).any(|x| !x.is_finite()) {
        return Err("a number that is none".to_owned());
    }
    match last {
        Some(w) if (window.run, window.index) <= (w.run, w.index) => {
            Err(format!("window {} of run {}", window.index, window.run))
        }
        _ => Ok(()),
    }
}

/// A line's object, its checksum checked and taken off; `sealed` says that there must be one.
fn unsealed(line: &str, is_text: bool, sealed: bool) -> std::result::Result<String, String> {
    let line = line.strip_suffix('\n').unwrap_or(line);
    if !is_text {
        return Err("bytes that are no text".to_owned());
    }
    match sealed_line::open(line) {
        Opened::Right(object) => Ok(object),
        Opened::Bare if !sealed => Ok(line.to_owned()),
        Opened::Bare => Err("no checksum, which the first line has".to_owned()),
        Opened::Wrong => Err("a line that does not fit its checksum".to_owned()),
    }
}

impl RowsRecord {
    /// Reads a record of rows.
    ///
    /// # Errors
    /// Names the file, the line, the value found and the one expected; a file without its last line
    /// names the last whole window, and is read up to it with `--recover`, which also leaves
    /// damaged lines out.
    pub fn read(path: &Path, options: &ReadOptions) -> Result<Self> {
        let io = |e: std::io::Error| BadInput::io(path, &e).remedy("Name a record that exists and can be read");
        let mut file = BufReader::new(formats::open(path)?);
        let mut record = Self {
            path: path.to_path_buf(),
            header: Header { format: String::new(), version: 0, metadata: Metadata::default() },
            windows: Vec::new(),
            footer: Footer::default(),
            warnings: Vec::new(),
        };
        let bad = |number: usize, found: String, expected: &str| {
            BadInput::new(found, expected).in_file(path).at(format!("line {number}"))
        };
        let mut ended = false;
        let mut cut = None;
        let (mut sealed, mut damaged) = (false, Vec::new());
        for number in 1.. {
            let mut bytes = Vec::new();
            let n = (&mut file).take(LINE_LIMIT).read_until(b'\n', &mut bytes).map_err(io)?;
            let (is_text, line) = match String::from_utf8(bytes) {
                Ok(text) => (true, text),
                Err(e) => (false, String::from_utf8_lossy(e.as_bytes()).into_owned()),
            };
            if n == 0 {
                break;
            }
            if !line.ends_with('\n') {
                if n as u64 >= LINE_LIMIT {
                    return Err(bad(number, format!("more than {LINE_LIMIT} bytes"), "a window"));
                }
                cut = Some(number);
                break;
            }
            if ended {
                return Err(bad(number, "a line behind the last one".to_owned(), "the end of the file"));
            }
            let checked = unsealed(&line, is_text, sealed);
            if number == 1 {
                let text = checked.map_err(|found| bad(1, found, "the first line of a record of rows"))?;
                sealed = text.len() + 1 < line.len();
                record.header = serde_json::from_str(&text)
                    .map_err(|e| bad(1, e.to_string(), "the first line of a record of rows"))?;
                if record.header.version != 1 {
                    return Err(
                        bad(1, format!("version {}", record.header.version), "version 1").remedy("Use a newer whirl")
                    );
                }
                continue;
            }
            let parsed = checked.and_then(|text| match serde_json::from_str(&text).map_err(|e| e.to_string())? {
                Line::End(footer) => {
                    record.footer = footer;
                    ended = true;
                    Ok(())
                }
                Line::Window(window) => {
                    check(&window, record.windows.last())?;
                    record.windows.push(window);
                    Ok(())
                }
            });
            match parsed {
                Ok(()) => {}
                Err(_) if options.recover => damaged.push(number),
                Err(found) => {
                    return Err(bad(number, found, "a window's rows")
                        .remedy("Copy the file again, or leave damaged lines out with --recover"));
                }
            }
        }
        if let Some(first) = damaged.first() {
            let (lines, were) = if damaged.len() == 1 { ("line", "was") } else { ("lines", "were") };
            record.warnings.push(Warning::new(
                "recovered",
                format!("{} damaged {lines} {were} left out, the first is line {first}", damaged.len()),
                "Their windows are missing; copy the file again if the original is whole",
            ));
        }
        if !ended {
            let whole = record.windows.len();
            if !options.recover {
                let found = cut.map_or("no last line".to_owned(), |n| format!("line {n} cut short"));
                return Err(BadInput::new(found, "a whole file")
                    .in_file(path)
                    .at(format!("behind window {whole}"))
                    .remedy("Copy it again, or read its whole windows with --recover"));
            }
            record.warnings.push(Warning::new(
                "recovered",
                format!("the file is cut; its {whole} whole windows were read"),
                "Its losses are not known",
            ));
        }
        Ok(record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(run: usize, index: usize) -> Window {
        Window {
            run,
            index,
            tick: 1_999 + 1_000 * index as i64,
            window_ticks: 2_000,
            phase_increment: 42_949_673,
            amplitude_nm: 15_525_000,
            first: vec![[0.1, -2.5e-7, 3.0, 4.0, 5.0, 6.0, 7.0]; 65],
            second: vec![[1.0; 6]; 65],
        }
    }

    fn written(dir: &tempfile::TempDir) -> PathBuf {
        let path = dir.path().join("r.rows.jsonl");
        let mut writer = RowsWriter::create(&path, Metadata { sample_rate_hz: 500.0, ..Metadata::default() }).unwrap();
        for (run, index) in [(0, 0), (0, 1), (1, 0)] {
            writer.push(window(run, index)).unwrap();
        }
        writer
            .finish(Footer { windows: 3, windows_lost: 1, losses: Losses { received: 5_000, ..Losses::default() } })
            .unwrap();
        path
    }

    #[test]
    fn what_was_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = written(&dir);
        assert!(holds_rows(&path) && !holds_rows(dir.path()));
        let record = RowsRecord::read(&path, &ReadOptions::default()).unwrap();
        assert_eq!(record.windows, [window(0, 0), window(0, 1), window(1, 0)]);
        assert_eq!((record.footer.windows_lost, record.footer.losses.received), (1, 5_000));
    }

    #[test]
    fn files_that_are_cut_or_wrong_are_told() {
        let dir = tempfile::tempdir().unwrap();
        let path = written(&dir);
        let sealed = std::fs::read_to_string(&path).unwrap();
        // Without checksums, so that what is wrong shows in the lines themselves.
        let whole: String = sealed.lines().map(|l| unsealed(l, true, true).unwrap() + "\n").collect();
        let lines: Vec<&str> = whole.lines().collect();
        let read = |text: &str, recover: bool| {
            std::fs::write(&path, text).unwrap();
            RowsRecord::read(&path, &ReadOptions { recover, ..ReadOptions::default() })
        };
        let cut = &whole[..whole.len() - 200];
        let e = read(cut, false).unwrap_err().to_string();
        assert!(e.contains("behind window") && e.contains("--recover"), "{e}");
        assert_eq!(read(cut, true).unwrap().windows.len(), 3);
        assert!(read(&lines[..3].join("\n"), false).is_err());
        for (text, part) in [
            (whole.replace("\"version\":1", "\"version\":9"), "line 1"),
            (whole.replace("\"window_ticks\":2000", "\"window_ticks\":3"), "line 2"),
            (whole.replacen("\"index\":1", "\"index\":0", 1), "line 3"),
            (whole.replacen("[0.1,", "[null,", 1), "line 2"),
            (format!("{whole}{{}}\n"), "line 6"),
            ("\u{1}\n".to_owned(), "line 1"),
        ] {
            let e = read(&text, false).unwrap_err().to_string();
            assert!(e.contains(part), "{e}");
        }
        assert!(read("", true).unwrap().windows.is_empty());
        // A digit that changed on the way is noticed, and its line can be left out.
        let changed = sealed.replacen("[0.1,", "[0.2,", 1);
        let e = read(&changed, false).unwrap_err().to_string();
        assert!(e.contains("line 2") && e.contains("checksum") && e.contains("--recover"), "{e}");
        let recovered = read(&changed, true).unwrap();
        assert_eq!(recovered.windows.len(), 2);
        assert!(recovered.warnings.iter().any(|w| w.text.contains("1 damaged line was left out, the first is line 2")));
        let bare = [sealed.lines().next().unwrap(), lines[1]].join("\n") + "\n";
        assert!(read(&bare, false).unwrap_err().to_string().contains("no checksum"));
    }
}

//! Rows that are done, in a file beside the table (`TABLE.journal`): a batch that was killed goes
//! on from them.
//!
//! JSON lines. The first says what the batch is: command, version, hash of the rig, options, shard.
//! Then one for each record that is done, handed to the disk before the next is begun, with the
//! record's hash: one that changed since is done anew. A line that was cut off counts as not there.
//! The last line of a batch that came to its end says so.

use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::row::{Cell, Row, kind};
use super::{FORMAT, hash};
use crate::error::{BadInput, Result};
use crate::files;

/// What a batch is: rows of two batches belong together where these are equal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// [`FORMAT`].
    pub format: u32,
    /// Command.
    pub command: String,
    /// Version of whirl.
    pub version: String,
    /// SHA-256 of the rig file with what it names.
    pub rig: String,
    /// Every option with its values; files by their hash.
    pub options: BTreeMap<String, Vec<String>>,
    /// Shard, `I/N`; none for all records.
    pub shard: Option<String>,
}

impl Header {
    /// Short name of the run: the same for all shards of one list of records, and for nothing else.
    pub fn run(&self, records: &[PathBuf]) -> String {
        let of_all = Self { shard: None, ..self.clone() };
        let names: Vec<String> = records.iter().map(|r| r.display().to_string()).collect();
        // Texts and maps of texts are always JSON.
        let text = serde_json::to_string(&(of_all, names)).unwrap_or_default();
        hash::of(text.as_bytes()).chars().take(16).collect()
    }

    /// What differs from another's, in words.
    fn differs(&self, now: &Self) -> Vec<String> {
        let mut out = Vec::new();
        let mut differ = |what: &str, was: &str, is: &str| {
            if was != is {
                out.push(format!("{what} was {was}, is {is}"));
            }
        };
        differ("the command", &self.command, &now.command);
        differ("whirl", &self.version, &now.version);
        let all = String::from("all records");
        differ("the shard", self.shard.as_ref().unwrap_or(&all), now.shard.as_ref().unwrap_or(&all));
        let names: std::collections::BTreeSet<&String> = self.options.keys().chain(now.options.keys()).collect();
        for name in names {
            let told = |of: &Self| {
                let values = of.options.get(name).map(|v| v.join(", ")).filter(|v| !v.is_empty());
                values.unwrap_or_else(|| "not given".to_owned())
            };
            differ(name, &told(self), &told(now));
        }
        if self.rig != now.rig {
            out.push("the rig file, or a file that it names, has changed".to_owned());
        }
        out
    }
}

/// A line behind the header.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Line {
    Done { file: String, hash: String, cells: Vec<(String, String)> },
    Finished { finished: bool },
}

/// A journal that is there already.
#[derive(Debug)]
pub struct Found {
    header: Header,
    /// Rows by file and hash.
    rows: HashMap<(String, String), Row>,
    /// Whether the batch came to its end.
    pub finished: bool,
    /// Bytes of whole lines.
    whole: u64,
}

/// A journal that is written.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

/// The journal of a table.
pub fn path_of(table: &Path) -> PathBuf {
    let mut name = table.as_os_str().to_os_string();
    name.push(".journal");
    PathBuf::from(name)
}

const ANEW: &str = "Begin anew with --force instead of --resume, or name another table";

impl Found {
    /// Reads a journal, if there is one with a whole first line.
    ///
    /// # Errors
    /// A file that is no journal of a batch, a damaged line.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        if !path.exists() {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        let mut file = files::open(path, "the journal of a batch", ANEW)?;
        std::io::Read::read_to_end(&mut file, &mut bytes).map_err(|e| BadInput::io(path, &e))?;
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |last| last + 1);
        let begun = b"{\"format\":";
        if whole == 0 && bytes.iter().zip(begun).all(|(a, b)| a == b) {
            // Killed before the first line was whole: nothing was done yet.
            return Ok(None);
        }
        let bad = |line: usize, e: &dyn std::fmt::Display| {
            let found = e.to_string();
            BadInput::new(found, "the journal of a batch").in_file(path).at(format!("line {line}")).remedy(ANEW)
        };
        let mut lines = bytes[..whole].split_inclusive(|b| *b == b'\n').enumerate();
        let Some((_, first)) = lines.next() else { return Err(bad(1, &"no whole line")) };
        let header: Header = serde_json::from_slice(first).map_err(|e| bad(1, &e))?;
        if header.format != FORMAT {
            return Err(bad(1, &format!("format {}", header.format)));
        }
        let mut found = Self { header, rows: HashMap::new(), finished: false, whole: whole as u64 };
        for (i, line) in lines {
            match serde_json::from_slice(line).map_err(|e| bad(i + 1, &e))? {
                Line::Done { file, hash, cells } => {
                    found.finished = false;
                    found.rows.insert((file, hash), row_of(cells).map_err(|e| bad(i + 1, &e))?);
                }
                Line::Finished { finished } => found.finished = finished,
            }
        }
        Ok(Some(found))
    }

    /// Rows that are there.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Refuses to go on with another batch.
    ///
    /// # Errors
    /// Names what differs.
    pub fn belongs_to(&self, now: &Header, path: &Path) -> Result<()> {
        let differs = self.header.differs(now);
        if differs.is_empty() {
            return Ok(());
        }
        Err(BadInput::new(format!("another batch: {}", differs.join("; ")), "the batch that was begun")
            .in_file(path)
            .at("--resume")
            .remedy(ANEW))
    }

    /// The row of a record, if it is done and the record's bytes are the same.
    pub fn row(&self, file: &str, hash: &str) -> Option<&Row> {
        self.rows.get(&(file.to_owned(), hash.to_owned()))
    }
}

fn row_of(cells: Vec<(String, String)>) -> core::result::Result<Row, String> {
    let mut row = Row::default();
    for (name, text) in cells {
        let cell = Cell::read(kind(&name), &text).ok_or_else(|| format!("{name}: \"{text}\""))?;
        row.set(&name, cell);
    }
    Ok(row)
}

impl Journal {
    /// Begins one.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn create(path: &Path, header: &Header) -> Result<Self> {
        let file = File::create(path).map_err(|e| BadInput::io(path, &e))?;
        let journal = Self { path: path.to_path_buf(), file: Mutex::new(file) };
        journal.line(header)?;
        Ok(journal)
    }

    /// Goes on behind the whole lines of one.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn go_on(path: &Path, found: &Found) -> Result<Self> {
        let open = || {
            let mut file = OpenOptions::new().write(true).open(path)?;
            file.set_len(found.whole)?;
            file.seek(SeekFrom::End(0))?;
            Ok(file)
        };
        let file = open().map_err(|e: std::io::Error| BadInput::io(path, &e))?;
        Ok(Self { path: path.to_path_buf(), file: Mutex::new(file) })
    }

    /// A record is done.
    ///
    /// # Errors
    /// A full disk.
    pub fn done(&self, file: &str, hash: &str, row: &Row) -> Result<()> {
        let cells = row.0.iter().map(|(name, cell)| (name.clone(), cell.written())).collect();
        self.line(&Line::Done { file: file.to_owned(), hash: hash.to_owned(), cells })
    }

    /// The batch came to its end, and its table is written.
    ///
    /// # Errors
    /// A full disk.
    pub fn finish(&self) -> Result<()> {
        self.line(&Line::Finished { finished: true })
    }

    fn line(&self, line: &impl Serialize) -> Result<()> {
        let mut text = serde_json::to_vec(line).map_err(|e| BadInput::new(e.to_string(), "").in_file(&self.path))?;
        text.push(b'\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(&text).and_then(|()| file.sync_data()).map_err(|e| BadInput::io(&self.path, &e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header() -> Header {
        Header {
            format: FORMAT,
            command: "identify".into(),
            version: "0.1.0".into(),
            rig: "aa".into(),
            options: BTreeMap::from([("--method".into(), vec!["weak".into()])]),
            shard: Some("1/2".into()),
        }
    }

    fn row(x: f64) -> Row {
        let mut row = Row::default();
        row.integer("exit_status", 0);
        row.text("error", "a\n\"b\" é");
        row.number("B11", x);
        row
    }

    #[test]
    fn what_is_done_is_found_and_a_torn_line_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = path_of(&folder.path().join("t.csv"));
        assert!(path.ends_with("t.csv.journal") && Found::read(&path).unwrap().is_none());
        let journal = Journal::create(&path, &header()).unwrap();
        journal.done("a.csv", "11", &row(0.1)).unwrap();
        journal.done("b.csv", "22", &row(1.0 / 3.0)).unwrap();
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        let found = Found::read(&path).unwrap().unwrap();
        assert_eq!((found.len(), found.row("a.csv", "11"), found.row("a.csv", "12")), (1, Some(&row(0.1)), None));
        let journal = Journal::go_on(&path, &found).unwrap();
        journal.done("b.csv", "22", &row(1.0 / 3.0)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), whole);
        assert!(!Found::read(&path).unwrap().unwrap().finished);
        journal.finish().unwrap();
        let found = Found::read(&path).unwrap().unwrap();
        assert!(found.finished && found.row("b.csv", "22") == Some(&row(1.0 / 3.0)));
        // Once more begun, it is open again.
        Journal::go_on(&path, &found).unwrap().done("c.csv", "33", &row(2.0)).unwrap();
        assert!(!Found::read(&path).unwrap().unwrap().finished);
    }

    #[test]
    fn another_batch_is_told_by_what_differs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j");
        Journal::create(&path, &header()).unwrap();
        let found = Found::read(&path).unwrap().unwrap();
        assert!(found.belongs_to(&header(), &path).is_ok() && found.is_empty());
        let changed = Header {
            version: "0.2.0".into(),
            rig: "bb".into(),
            options: BTreeMap::from([("--from".into(), vec!["5".into()])]),
            shard: None,
            ..header()
        };
        let text = found.belongs_to(&changed, &path).unwrap_err().to_string();
        for part in [
            "whirl was 0.1.0, is 0.2.0",
            "the shard was 1/2, is all records",
            "--from was not given, is 5",
            "--method was weak, is not given",
            "the rig file, or a file that it names, has changed",
            "--resume",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let records = [PathBuf::from("a"), PathBuf::from("b")];
        assert_eq!(header().run(&records), Header { shard: None, ..header() }.run(&records));
        assert_ne!(header().run(&records), header().run(&records[..1]));
        assert_ne!(header().run(&records), changed.run(&records));
        std::fs::write(&path, "{\"format\":1,\"com").unwrap();
        assert!(Found::read(&path).unwrap().is_none());
        std::fs::write(&path, "my notes").unwrap();
        assert!(Found::read(&path).is_err());
        std::fs::write(&path, "{\"a\":1}\n").unwrap();
        assert!(Found::read(&path).unwrap_err().to_string().contains("line 1"));
    }
}

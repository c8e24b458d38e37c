//! Files by name: regular ones to read, results to write, and whether two names are one file.
//!
//! A device, pipe or socket has no length, may never end and may never answer: it is refused before
//! it is opened.

use std::fs::{File, Metadata};
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::error::{BadInput, Result};

/// Version of what whirl writes as JSON, the first key of every object: docs/json.md tells the
/// others.
pub const FORMAT: u32 = 1;

/// Longest text file that is read (rig, model, effects), bytes: a thousand times the longest that
/// ships.
const LONGEST_TEXT: u64 = 1 << 20;
/// Most links from name to name that are followed, as Linux does.
const MOST_LINKS: usize = 40;

/// Opens a regular file; `what` it is to be ("a record"), `remedy` where it cannot be opened.
///
/// # Errors
/// A file that is not there or may not be read; a folder, device, pipe or socket.
pub fn open(path: &Path, what: &str, remedy: &str) -> Result<File> {
    let io = |e: std::io::Error| BadInput::io(path, &e).remedy(remedy);
    // A pipe would wait for its writer once it is opened: the name is asked first, the open file
    // again.
    regular(path, what, &std::fs::metadata(path).map_err(io)?)?;
    let file = File::open(path).map_err(io)?;
    regular(path, what, &file.metadata().map_err(io)?)?;
    Ok(file)
}

/// Reads a text file of at most 1 MiB.
///
/// # Errors
/// As [`open`]; a longer one; bytes that are not UTF-8.
pub fn read_text(path: &Path, what: &str, remedy: &str) -> Result<String> {
    let mut bytes = Vec::new();
    open(path, what, remedy)?
        .take(LONGEST_TEXT + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| BadInput::io(path, &e).remedy(remedy))?;
    if bytes.len() as u64 > LONGEST_TEXT {
        return Err(BadInput::new(format!("more than {LONGEST_TEXT} bytes"), what).in_file(path).remedy(remedy));
    }
    String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count() + 1;
        BadInput::new("bytes that are no text (UTF-8)", what).in_file(path).at(format!("line {line}")).remedy(remedy)
    })
}

fn regular(path: &Path, what: &str, metadata: &Metadata) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    if metadata.is_dir() {
        return Err(BadInput::new("a folder", what).in_file(path).remedy("Name the file inside of it"));
    }
    Err(BadInput::new(kind(metadata), format!("{what}, in a regular file"))
        .in_file(path)
        .remedy("Save it to a file first"))
}

#[cfg(unix)]
fn kind(metadata: &Metadata) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    let t = metadata.file_type();
    if t.is_fifo() {
        "a pipe"
    } else if t.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn kind(_: &Metadata) -> &'static str {
    "a device"
}

/// Writes a file whole: beside its name first, then renamed, so that no half-written result is left
/// behind.
///
/// # Errors
/// A folder that does not exist, a full disk, missing rights.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let fail =
        |e: std::io::Error| BadInput::io(path, &e).remedy("Name a file in a folder that exists and can be written to");
    let part = Part::of(path)?;
    std::fs::write(part.place(), bytes).map_err(fail)?;
    part.keep().map_err(fail)
}

/// A file that is written beside its name and gets the name once it is whole ([`Part::keep`]); what
/// had the name is there until then. Dropped before, it is removed.
#[derive(Debug)]
pub struct Part {
    place: PathBuf,
    /// None where nothing is renamed.
    target: Option<PathBuf>,
}

impl Part {
    /// Where a file of this name is written until it is whole; nothing is created yet.
    ///
    /// # Errors
    /// A folder that does not exist.
    pub fn of(path: &Path) -> Result<Self> {
        // A device or pipe is written to as it is.
        if is_special(path) {
            return Ok(Self { place: path.to_path_buf(), target: None });
        }
        let unnamed = || BadInput::new("no file name, or no folder", "a file to write").in_file(path);
        // A link stays one: the file behind it is replaced.
        let target = resolve(path).ok_or_else(unnamed)?;
        let mut name = target.file_name().ok_or_else(unnamed)?.to_os_string();
        name.push(format!(".{}.part", std::process::id()));
        Ok(Self { place: target.with_file_name(name), target: Some(target) })
    }

    /// The file that is to be written.
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Gives the whole file its name.
    ///
    /// # Errors
    /// A name that cannot be taken.
    pub fn keep(mut self) -> std::io::Result<()> {
        let Some(target) = &self.target else { return Ok(()) };
        std::fs::rename(&self.place, target)?;
        self.target = None;
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if self.target.is_some() {
            let _ = std::fs::remove_file(&self.place);
        }
    }
}

/// The file that a name leads to, links followed, whether it is there yet or not; none where its
/// folder is not there.
pub fn resolve(path: &Path) -> Option<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        if let Ok(whole) = path.canonicalize() {
            return Some(whole);
        }
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        match std::fs::read_link(&path) {
            // A link to what is not there yet.
            Ok(to) => path = folder.join(to),
            Err(_) => return Some(folder.canonicalize().ok()?.join(path.file_name()?)),
        }
    }
    None
}

/// Whether two names lead to one file: by name, by link, or by two names of the file itself (hard
/// links).
pub fn same(a: &Path, b: &Path) -> bool {
    if let (Ok(a), Ok(b)) = (std::fs::metadata(a), std::fs::metadata(b))
        && identity(&a).is_some_and(|id| identity(&b) == Some(id))
    {
        return true;
    }
    resolve(a).is_some_and(|a| resolve(b).as_ref() == Some(&a))
}

#[cfg(unix)]
fn identity(metadata: &Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn identity(_: &Metadata) -> Option<(u64, u64)> {
    None
}

/// Whether a name stands for a device, pipe or socket, or for what this program was handed open
/// (`/dev/stdout`).
pub fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
        || ((path.starts_with("/dev") || path.starts_with("/proc")) && path.exists())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let read = |path: &Path| read_text(path, "a rig file", "Name one").unwrap_err().to_string();
        assert!(read(folder.path()).contains("found a folder, expected a rig file. Name the file inside"));
        assert!(read(&folder.path().join("none")).contains("Name one"));
        let long = folder.path().join("long");
        std::fs::write(&long, vec![b'#'; (LONGEST_TEXT + 1) as usize]).unwrap();
        assert!(read(&long).contains("more than 1048576 bytes"));
        std::fs::write(&long, b"a = 1\n\xff").unwrap();
        assert!(read(&long).contains("line 2: found bytes that are no text"));
        #[cfg(unix)]
        {
            assert!(read(Path::new("/dev/zero")).contains("found a device, expected a rig file, in a regular file"));
            let socket = folder.path().join("socket");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
            assert!(read(&socket).contains("a socket") && is_special(&socket));
        }
    }

    #[test]
    fn what_has_the_name_stays_until_the_new_file_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.csv");
        std::fs::write(&path, "old").unwrap();
        let names = || std::fs::read_dir(folder.path()).unwrap().count();
        let part = Part::of(&path).unwrap();
        std::fs::write(part.place(), "to").unwrap();
        assert_eq!((std::fs::read_to_string(&path).unwrap().as_str(), names()), ("old", 2));
        drop(part);
        assert_eq!((std::fs::read_to_string(&path).unwrap().as_str(), names()), ("old", 1));
        let part = Part::of(&path).unwrap();
        std::fs::write(part.place(), "new").unwrap();
        part.keep().unwrap();
        assert_eq!((std::fs::read_to_string(&path).unwrap().as_str(), names()), ("new", 1));
        assert!(Part::of(&folder.path().join("no/r.csv")).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn one_file_has_many_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a"), "x").unwrap();
        std::fs::write(at("b"), "x").unwrap();
        std::fs::hard_link(at("a"), at("hard")).unwrap();
        std::os::unix::fs::symlink("a", at("soft")).unwrap();
        std::os::unix::fs::symlink("new", at("ahead")).unwrap();
        std::os::unix::fs::symlink("round", at("round")).unwrap();
        assert!(same(&at("a"), &at("hard")) && same(&at("a"), &at("soft")) && same(&at("a"), &at("./a")));
        assert!(same(&at("new"), &at("ahead")) && same(&at("new"), &at("./new")));
        assert!(!same(&at("a"), &at("b")) && !same(&at("a"), &at("new")) && !same(&at("no/x"), &at("no/x")));
        assert_eq!(resolve(&at("round")), None);
    }
}

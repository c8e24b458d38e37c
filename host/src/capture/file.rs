//! `file:FRAMES`: bytes of the wire that were recorded before, such as the journal of a capture
//! that crashed.
//!
//! whirl's journals begin with a line of their own (see [`super::journal`]), which makes the record
//! come out as it would have at capture, byte for byte; a file without it is taken as the wire's
//! bytes from the first on.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::PathBuf;

use super::source::{Link, Source, SourceKind, bad};
use crate::files;

pub(super) const KIND: SourceKind = SourceKind {
    id: "file",
    form: "file:FRAMES",
    about: "bytes of the wire recorded before (REC.frames)",
    parse: |argument, _| match argument {
        Some(path) if !path.is_empty() => {
            // A device or pipe might never end, or never answer.
            files::open(path.as_ref(), "bytes of the wire", "Name a file with the wire's bytes")?;
            Ok(Box::new(Frames { path: path.into() }))
        }
        _ => Err(bad(argument.unwrap_or_default(), "file:FRAMES").remedy("Such as file:run1.parquet.frames")),
    },
};

struct Frames {
    path: PathBuf,
}

struct Bytes(BufReader<File>);

impl Source for Frames {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        Ok(Box::new(Bytes(BufReader::with_capacity(1 << 16, File::open(&self.path)?))))
    }

    fn is_replay(&self) -> bool {
        true
    }

    fn remedy(&self) -> String {
        "Name a file with the wire's bytes, such as run1.parquet.frames".to_owned()
    }
}

impl Link for Bytes {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }

    /// Nothing listens; what is sent is dropped.
    fn write_all(&mut self, _bytes: &[u8]) -> io::Result<()> {
        Ok(())
    }
}

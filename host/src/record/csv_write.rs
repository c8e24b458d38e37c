//! whirl's record as CSV: `t,CHANNEL…,tick,phase,amplitude_nm`, gzipped where the name ends in
//! `.gz`.
//!
//! `t` is printed with as many digits as tell its value apart from its neighbours' (shortest that
//! reads back the same).

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::Metadata;
use super::csv::OWN_COLUMNS;
use super::writer::Sample;
use crate::error::{BadInput, Result};
use crate::rig::Rig;

enum Sink {
    Plain(BufWriter<File>),
    Gzip(BufWriter<GzEncoder<File>>),
}

/// Writes the CSV.
pub(super) struct CsvWriter {
    path: PathBuf,
    rate: f64,
    sink: Sink,
}

impl CsvWriter {
    /// `place`: the file that is opened, which may be another until the record has its name.
    pub(super) fn create(path: &Path, place: &Path, metadata: &Metadata, rig: &Rig) -> Result<Self> {
        let file = create_file(path, place)?;
        let sink = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz")) {
            Sink::Gzip(BufWriter::new(GzEncoder::new(file, Compression::default())))
        } else {
            Sink::Plain(BufWriter::new(file))
        };
        let mut writer = Self { path: path.to_path_buf(), rate: metadata.sample_rate_hz, sink };
        let mut header = "t".to_owned();
        for name in rig.channel.iter().map(|c| c.name.as_str()).chain(OWN_COLUMNS) {
            header.push(',');
            header.push_str(&text_cell(name));
        }
        header.push('\n');
        writer.write(|w| w.write_all(header.as_bytes()))?;
        Ok(writer)
    }

    fn write(&mut self, f: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
        match &mut self.sink {
            Sink::Plain(w) => f(w),
            Sink::Gzip(w) => f(w),
        }
        .map_err(|e| BadInput::io(&self.path, &e))
    }

    pub(super) fn push(&mut self, sample: &Sample<'_>) -> Result<()> {
        let t = sample.tick as f64 / self.rate;
        self.write(|w| {
            write!(w, "{t}")?;
            for c in sample.counts {
                write!(w, ",{c}")?;
            }
            writeln!(w, ",{},{},{}", sample.tick, sample.phase, sample.amplitude_nm)
        })
    }

    pub(super) fn finish(self) -> Result<()> {
        let io = |e: std::io::Error| BadInput::io(&self.path, &e);
        match self.sink {
            Sink::Plain(w) => w.into_inner().map_err(|e| io(e.into_error())),
            Sink::Gzip(w) => {
                let gzip = w.into_inner().map_err(|e| io(e.into_error()))?;
                gzip.finish().map_err(io)
            }
        }
        // The journal beside it goes once this has returned.
        .and_then(|file| file.sync_all().map_err(io))
    }
}

/// A text as a cell: in quotes where it needs them, behind an apostrophe where a spreadsheet would
/// take it for a formula.
pub(super) fn text_cell(text: &str) -> String {
    let text = if is_formula(text) { format!("'{text}") } else { text.to_owned() };
    if text.contains([',', '"', ';', '\t']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// Whether a spreadsheet would compute this text.
pub(crate) fn is_formula(text: &str) -> bool {
    text.starts_with(['=', '+', '-', '@'])
}

/// Opens a file for writing at a place, with a remedy for its name where that fails.
pub(super) fn create_file(path: &Path, place: &Path) -> Result<File> {
    File::create(place)
        .map_err(|e| BadInput::io(path, &e).remedy("Name an output file in a folder that exists and can be written"))
}

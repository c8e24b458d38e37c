//! A record from bytes that were recorded before (`file:FRAMES`).

use super::journal::{HEADER_LIMIT, MAGIC, Terms, header};
use super::recorder::Recorder;
use super::source::{Link, Source};
use super::{CaptureOutcome, CaptureSettings, Progress, outcome};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

/// Reads the bytes to their end, or to the end of the recording.
pub(super) fn run(
    settings: &CaptureSettings,
    rig: &Rig,
    source: &mut dyn Source,
    progress: &mut dyn FnMut(&Progress),
) -> Result<CaptureOutcome> {
    let path = settings.from.split_once(':').map_or("", |(_, path)| path).to_owned();
    let io = |e: &std::io::Error| BadInput::io(&path, e).remedy("Name a file with the wire's bytes");
    if std::path::Path::new(&path) == settings.output {
        return Err(BadInput::new("the record and the bytes in one file", "two files")
            .in_file(&path)
            .at("-o")
            .remedy("Name another output file"));
    }
    let mut link = source.open().map_err(|e| io(&e))?;
    let mut buffer = vec![0; HEADER_LIMIT];
    let mut filled = fill(&mut *link, &mut buffer).map_err(|e| io(&e))?;
    if filled == 0 {
        return Err(BadInput::new("an empty file", "bytes of the wire").in_file(&path).at("start of file"));
    }
    let found = header(&buffer[..filled], std::path::Path::new(&path))?;
    let (mut terms, mut at) = found.unwrap_or_else(|| {
        // Bytes of unknown origin: all samples, with or without a hello.
        (Terms { source: format!("file:{path}"), ..Terms::default() }, 0)
    });
    debug_assert!(at == 0 || buffer.starts_with(MAGIC));
    terms.seconds = settings.seconds.or(terms.seconds);
    let seconds = terms.seconds;
    let mut recorder = Recorder::new(rig, &settings.output, terms)?;
    let (mut bytes, mut bad, mut good) = (0u64, 0u64, 0u64);
    'file: while filled > 0 {
        for &byte in &buffer[at..filled] {
            bytes += 1;
            match recorder.push(byte) {
                Ok(None) => {}
                Ok(Some(super::recorder::Event::Message(_))) => good += 1,
                Ok(Some(super::recorder::Event::Bad(_))) => bad += 1,
                Err(e) => {
                    // What came before the fault stays readable.
                    recorder.finish()?;
                    return Err(e.in_file(&path));
                }
            }
            if recorder.ended() {
                break 'file;
            }
        }
        progress(&Progress {
            state: "reading",
            samples: recorder.ticks(),
            lost: recorder.losses().lost(),
            device_s: recorder.ticks() as f64 / rig.sample_rate_hz,
            target_s: seconds,
            estimate: None,
        });
        at = 0;
        filled = fill(&mut *link, &mut buffer).map_err(|e| io(&e))?;
    }
    let finished = recorder.finish()?;
    let done = outcome(settings, finished, seconds).ok_or_else(|| {
        BadInput::new(format!("no sample in {bytes} bytes ({good} good frames, {bad} damaged)"), "a device's samples")
            .in_file(&path)
            .remedy("See that these are bytes of the wire of this version's firmware, such as run1.parquet.frames")
    })?;
    Ok(CaptureOutcome { bytes, ..done })
}

/// Reads until the buffer is full or the file ends.
fn fill(link: &mut dyn Link, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match link.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

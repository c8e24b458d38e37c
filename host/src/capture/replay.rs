//! A record from bytes that were recorded before (`file:FRAMES`).

use super::interrupted::NextStep;
use super::journal::{self, End, HEADER_LIMIT, Journal, Terms, header, is_cut};
use super::recorder::Recorder;
use super::source::{Link, Source};
use super::{CaptureOutcome, CaptureSettings, Progress, outcome};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

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
        return Err(nothing_in_it(&path));
    }
    let own = is_own_journal(&path, &settings.output);
    if own && journal::is_busy(std::path::Path::new(&path)) {
        return Err(BadInput::new("a capture that is under way", "a capture that has ended")
            .in_file(&path)
            .remedy("Let it end: it makes this record itself. Another -o gives a record of what there is"));
    }
    if is_cut(&buffer[..filled]) && filled < HEADER_LIMIT {
        return Err(nothing_in_it(&path));
    }
    let found = header(&buffer[..filled], std::path::Path::new(&path))?;
    let (mut terms, mut at) = found.unwrap_or_else(|| {
        // Bytes of unknown origin: all samples, with or without a hello.
        (Terms { source: format!("file:{path}"), ..Terms::default() }, 0)
    });
    // A shorter record than the journal's is not all of it.
    let part = settings.seconds.is_some_and(|s| terms.seconds.is_none_or(|all| s < all));
    terms.seconds = settings.seconds.or(terms.seconds);
    let (seconds, from, options) = (terms.seconds, terms.source.clone(), terms.options.clone());
    let mut recorder = Recorder::new(rig, &settings.output, terms)?;
    let (mut bytes, mut bad, mut good) = (0u64, 0u64, 0u64);
    'file: while filled > 0 {
        for &byte in &buffer[at..filled] {
            bytes += 1;
            match recorder.push(byte) {
                Ok(None) => {}
                Ok(Some(super::recorder::Event::Message(_))) => good += 1,
                Ok(Some(super::recorder::Event::Bad)) => bad += 1,
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
            notices: Vec::new(),
        });
        at = 0;
        filled = fill(&mut *link, &mut buffer).map_err(|e| io(&e))?;
    }
    let finished = recorder.finish()?;
    let next =
        own.then(|| NextStep { source: &from, options: &options, rig: &rig.path, record: &settings.output }.resume());
    let mut done =
        outcome(settings, finished, seconds).ok_or_else(|| no_sample(&path, [bytes, good, bad], next.as_deref()))?;
    let file = std::path::Path::new(&path);
    let kept = own && (settings.keep_frames || journal::is_kept(file));
    let frames = (kept || own && part).then(|| path.clone().into());
    if kept {
        Journal::take_up(file)?.finish(End::Kept)?;
    } else if own && !part {
        // The record is whole and on the disk: its journal is of no further use, and would stand in
        // the next capture's way.
        journal::remove(file)?;
    }
    if own && part && !kept {
        done.warnings.push(Warning::new(
            "journal-kept",
            format!("{path} stays: it holds more than the {} s that were asked for", done.duration_s),
            "Make the record again without --seconds, or delete it",
        ));
    }
    Ok(CaptureOutcome { bytes, frames, ..done })
}

/// Whether a file is the journal beside a record.
fn is_own_journal(path: &str, record: &std::path::Path) -> bool {
    let same = |a: &std::path::Path, b: &std::path::Path| {
        a == b || a.canonicalize().ok().is_some_and(|a| b.canonicalize().is_ok_and(|b| a == b))
    };
    same(std::path::Path::new(path), &journal::path_of(record))
}

/// The error for a file in which a capture has written nothing yet.
fn nothing_in_it(path: &str) -> BadInput {
    BadInput::new("nothing of the wire", "frames of a device")
        .in_file(path)
        .at("start of file")
        .remedy("The capture ended before its device answered: capture again, which replaces this file, or delete it")
}

/// The error for bytes, with so many good and damaged frames in them, that make no record; `next`:
/// the command that goes on in the capture that wrote them.
fn no_sample(path: &str, [bytes, good, bad]: [u64; 3], next: Option<&str>) -> BadInput {
    let found = format!("no sample for a record in {bytes} bytes ({good} good frames, {bad} damaged)");
    let error = BadInput::new(found, "a device's samples").in_file(path);
    match next {
        Some(next) => error.remedy(format!(
            "The capture ended before its recording began: go on in it with {next}, or capture again, which replaces it"
        )),
        None => {
            error.remedy("See that these are bytes of the wire of this version's firmware, such as run1.parquet.frames")
        }
    }
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

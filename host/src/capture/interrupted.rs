//! What an interrupted capture leaves, and what can be done with it.
//!
//! | beside REC | the next `capture -o REC` | `capture --resume -o REC` | `capture --from file:REC.frames -o REC` |
//! |---|---|---|---|
//! | no journal | captures | refuses: nothing to resume | no such file |
//! | a journal whose first line was cut | replaces it, and says so | as new | refuses: nothing in it |
//! | a journal without a sample of the record | replaces it, and says so | goes on in it | refuses: no sample |
//! | a journal with samples | refuses, with the three commands | goes on in it | makes REC, removes the journal |
//! | one that was to be kept (`--keep-frames`) | refuses | goes on in it, keeps it | makes REC where there is none, or with `--force`; keeps it |
//! | a journal that is being written | refuses | refuses | refuses |
//!
//! The record itself (none, a part, whole) does not matter to any of these: the journal is the
//! truth, and it is on the disk before the record.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::CaptureSettings;
use super::drive::Target;
use super::journal::{self, End, Journal, Start, Terms};
use super::recorder::{Event, Recorder};
use crate::error::{BadInput, Result, plain};
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::shell_word;

/// Options of the command that a continuation must have too, beside source, rig file and record.
pub(super) fn options(settings: &CaptureSettings) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for effect in &settings.effects {
        words.extend([EFFECT.to_owned(), effect.clone()]);
    }
    words.extend(settings.rows.then(|| "--rows".to_owned()));
    if let Some(until) = &settings.until {
        words.extend(["--until".to_owned(), until.to_string()]);
    }
    match settings.amplitude_m {
        _ if !settings.drive => words.push("--no-drive".to_owned()),
        Some(amplitude) => words.extend(["--amplitude-m".to_owned(), amplitude.to_string()]),
        None => {}
    }
    words.extend(settings.excite.options());
    words.extend(settings.level.then(|| LEVEL.to_owned()));
    words
}

/// The option that puts an effect into a simulated rig.
const EFFECT: &str = "--effect";

/// The option that levels the amplitude.
const LEVEL: &str = "--level-amplitude";

/// Effects among the options of a command.
fn effects(options: &[String]) -> String {
    let words: Vec<&str> = options.windows(2).filter(|w| w[0] == EFFECT).map(|w| w[1].as_str()).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

/// The commands after an interruption.
pub(super) struct NextStep<'a> {
    pub(super) source: &'a str,
    /// See [`options`].
    pub(super) options: &'a [String],
    pub(super) rig: &'a Path,
    pub(super) record: &'a Path,
}

impl NextStep<'_> {
    /// Goes on in the same record.
    pub(super) fn resume(&self) -> String {
        let path = |p: &Path| shell_word(&p.display().to_string());
        let options: String = self.options.iter().map(|word| format!(" {}", shell_word(word))).collect();
        format!(
            "`whirl capture --resume --from {}{options} --rig {} -o {}`",
            shell_word(self.source),
            path(self.rig),
            path(self.record)
        )
    }

    /// Makes the record of what there is.
    pub(super) fn make(&self) -> String {
        make_command(self.record, &shell_word(&self.rig.display().to_string()))
    }

    /// All that can be done, in a sentence.
    pub(super) fn all(&self) -> String {
        let journal = journal::path_of(self.record);
        format!(
            "Go on in the same record with {}, make the record of what there is with {}, or delete {}",
            self.resume(),
            self.make(),
            plain(&journal.display().to_string())
        )
    }
}

/// Makes a record from the journal beside it; `rig` as it stands in the command.
fn make_command(record: &Path, rig: &str) -> String {
    let from = format!("file:{}", journal::path_of(record).display());
    let record = shell_word(&record.display().to_string());
    format!("`whirl capture --from {} --rig {rig} -o {record}`", shell_word(&from))
}

/// The command that makes a record whole from the journal beside it, where there is one.
pub fn whole_again(record: &Path, rig: &Path) -> Option<String> {
    let path = journal::path_of(record);
    // One whose first line was cut has nothing to make a record of.
    let usable = path.is_file() && matches!(journal::terms_of(&path), Ok(Start::Terms(_)));
    usable.then(|| make_command(record, &shell_word(&rig.display().to_string())))
}

/// Ticks by which the journal beside a record goes on behind the record's last one: of a capture
/// that was interrupted, or is under way. None where there is no journal of this rig's, or it holds
/// nothing more.
pub fn ticks_behind(record: &Path, rig: &Rig, last_tick: i64) -> Option<u64> {
    let path = journal::path_of(record);
    let Ok(Start::Terms(terms)) = journal::terms_of(&path) else { return None };
    if terms.rows {
        return None;
    }
    let mut recorder = Recorder::dry(rig, record, *terms).ok()?;
    each_byte(&path, |byte| {
        recorder.push(byte)?;
        Ok(!recorder.ended())
    })
    .ok()?;
    let newest = recorder.into_last_tick().ok()??;
    u64::try_from(newest.checked_sub(last_tick)?).ok().filter(|ticks| *ticks > 0)
}

/// Bytes of a journal behind its first line, handed on one by one until `take` says that it has
/// enough.
fn each_byte(path: &Path, mut take: impl FnMut(u8) -> Result<bool>) -> Result<()> {
    let io = |e: std::io::Error| BadInput::io(path, &e);
    let mut file = File::open(path).map_err(io)?;
    let mut buffer = vec![0; journal::HEADER_LIMIT];
    let mut first = true;
    loop {
        let mut filled = 0;
        while filled < buffer.len() {
            match file.read(&mut buffer[filled..]) {
                Ok(0) => break,
                Ok(n) => filled += n,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(io(e)),
            }
        }
        if filled == 0 {
            return Ok(());
        }
        let at = if first { journal::header(&buffer[..filled], path)?.map_or(0, |(_, at)| at) } else { 0 };
        first = false;
        for &byte in &buffer[at..filled] {
            if !take(byte)? {
                return Ok(());
            }
        }
    }
}

/// Whether a journal holds a sample of its record. What cannot be told counts as one.
fn has_samples(path: &Path, terms: &Terms, rig: &Rig, record: &Path) -> bool {
    let Ok(mut recorder) = Recorder::new(rig, record, Terms { rows: false, ..terms.clone() }) else { return true };
    let mut found = false;
    let read = each_byte(path, |byte| {
        let event = recorder.push(byte)?;
        // Rows are not decoded into windows here: any of them counts.
        let rows = terms.rows && event.is_some_and(|e| e.is_rows());
        found |= rows || recorder.has_samples();
        Ok(!found)
    });
    found || read.is_err()
}

/// A journal to be written, and what was noticed of one that was there.
pub(super) type Opened = (Journal, Option<Warning>);

/// The journal of a new capture.
///
/// # Errors
/// One with samples stands in its place; one that is being written; a folder that cannot be
/// written.
pub(super) fn begin(settings: &CaptureSettings, rig: &Rig, terms: &Terms) -> Result<Opened> {
    let (record, path) = (&settings.output, journal::path_of(&settings.output));
    if !path.exists() {
        return Ok((Journal::create(record, terms)?, None));
    }
    let mine = options(settings);
    let next = NextStep { source: &settings.from, options: &mine, rig: &rig.path, record };
    let refused =
        |found: &str, next: &NextStep<'_>| Err(BadInput::new(found, "no such file").in_file(&path).remedy(next.all()));
    match journal::terms_of(&path) {
        Ok(Start::Cut) => {}
        Ok(Start::Terms(old)) if !has_samples(&path, &old, rig, record) => {}
        Ok(Start::Terms(_)) if journal::is_kept(&path) => {
            return Err(BadInput::new("the journal of a capture, which was to be kept", "no such file")
                .in_file(&path)
                .remedy("Name another record, or move this journal away"));
        }
        Ok(Start::Terms(old)) => {
            return refused(
                "the journal of a capture that did not end",
                &NextStep { source: &old.source, options: &old.options, ..next },
            );
        }
        _ => return refused("a file that may be the journal of a capture", &next),
    }
    // Taken up first: a capture that is under way holds it.
    Journal::take_up(&path)?.finish(End::Removed)?;
    let warning = Warning::new(
        "empty-journal",
        format!("{}, left by a capture that ended before its first sample, was replaced", path.display()),
        "Nothing is lost: it held no sample",
    );
    Ok((Journal::create(record, terms)?, Some(warning)))
}

/// The terms of the capture that is to be resumed; none where it ended before they were written.
///
/// # Errors
/// No journal; one that is no journal; a source, rig file or drive that differs from the
/// interrupted capture's.
pub(super) fn to_resume(settings: &CaptureSettings, rig: &Rig, target: Option<Target>) -> Result<Option<Terms>> {
    let path = journal::path_of(&settings.output);
    let anew = "Leave --resume out to capture anew";
    if !path.exists() {
        return Err(BadInput::new("no journal: nothing to resume", "that of an interrupted capture")
            .in_file(&path)
            .remedy(format!("See that -o names the record that was interrupted. {anew}")));
    }
    let terms = match journal::terms_of(&path)? {
        Start::Cut => {
            drop(Journal::take_up(&path)?);
            return Ok(None);
        }
        Start::Terms(terms) => *terms,
        Start::Raw => {
            return Err(BadInput::new("bytes without the terms of a capture", "a journal of whirl's")
                .in_file(&path)
                .remedy(format!("Only a capture's own journal can be resumed. {anew}, into another file")));
        }
    };
    let differs = |what: &str, found: String, expected: String| {
        Err(BadInput::new(found, format!("{expected}, as in the capture that was interrupted"))
            .in_file(&path)
            .at(what)
            .remedy("Resume with the same source, rig file and drive, or capture into another file"))
    };
    // A port may have another name once it was plugged in again; what kind it is, and a simulated
    // rig's seed, matter.
    let kind = |source: &str| source.split(':').next().map(str::to_owned).unwrap_or_default();
    let (old, new) = (&terms.source, &settings.from);
    if kind(old) != kind(new) || (kind(old) == "sim" && old != new) {
        return differs("--from", new.clone(), old.clone());
    }
    let (old, new) = (effects(&terms.options), effects(&options(settings)));
    if kind(&settings.from) == "sim" && old != new {
        return differs(EFFECT, new, old);
    }
    if terms.rows != settings.rows {
        let word = |rows: bool| if rows { "--rows" } else { "samples" }.to_owned();
        return differs("--rows", word(settings.rows), word(terms.rows));
    }
    if terms.options.iter().any(|word| word == LEVEL) != settings.level {
        let word = |level: bool| if level { LEVEL } else { "an amplitude that is commanded" }.to_owned();
        return differs(LEVEL, word(settings.level), word(!settings.level));
    }
    let now = journal::essentials(rig, target);
    if terms.rig.is_empty() || terms.rig == now {
        return Ok(Some(terms));
    }
    let pair = terms.rig.iter().zip(&now).find(|(old, new)| old != new);
    let count = |n: usize| format!("{n} quantities");
    let (old, new) = pair.map_or((count(terms.rig.len()), count(now.len())), |(a, b)| (a.clone(), b.clone()));
    differs(&plain(&rig.path.display().to_string()), new, old)
}

/// What to say of a capture that goes on.
pub(super) fn noticed(settings: &CaptureSettings, recorder: &Recorder<'_>) -> Option<Warning> {
    let had = recorder.losses().received;
    let (asked, governs) = (settings.seconds, recorder.seconds());
    let terms = match (asked, governs) {
        (Some(asked), Some(governs)) if asked != governs => format!("; its {governs} s hold, not --seconds {asked}"),
        (Some(asked), None) => format!("; it was to go on until it is ended, so that --seconds {asked} does not hold"),
        _ => String::new(),
    };
    Some(
        Warning::new(
            "resumed",
            format!("the record goes on behind {had} samples of an interrupted capture{terms}"),
            "What the device still has of the time between is restored; the rest is a gap, marked and counted",
        )
        .with("samples_before", had),
    )
}

/// Takes up the journal of `record`: all of it goes into the recorder, then what comes is appended
/// to it.
///
/// # Errors
/// A journal that is being written, or does not fit the rig file.
pub(super) fn take_up(recorder: &mut Recorder<'_>, record: &Path) -> Result<Journal> {
    let path = journal::path_of(record);
    let mut journal = Journal::take_up(&path)?;
    each_byte(&path, |byte| {
        recorder.push(byte).map_err(|e| e.in_file(&path))?;
        Ok(!recorder.ended())
    })?;
    // The frame that was cut must not spoil the next one.
    if !recorder.ended() {
        recorder.push(0)?;
        journal.write(&[0])?;
    }
    Ok(journal)
}

impl Event {
    fn is_rows(&self) -> bool {
        matches!(self, Self::Message(m) if matches!(m.message, whirl_shared::frame::DeviceMessage::Rows(_)))
    }
}

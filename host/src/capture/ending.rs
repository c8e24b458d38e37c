//! The end of a capture: the shaker at rest, the record whole, the journal removed or kept, the
//! next step told.

use super::interrupted::NextStep;
use super::journal::{End, Journal, path_of};
use super::live::{STOPPING, Session};
use super::precision::Precision;
use super::recorder::Recorder;
use super::{CaptureOutcome, outcome};
use crate::error::{BadInput, Result};
use crate::warning::Warning;
use crate::wording::format::rounded;
use whirl_shared::frame::{Command, Streamed};

impl Session<'_> {
    /// Brings the shaker to rest, whatever has happened before.
    pub(super) fn stop_drive(&mut self, recorder: &mut Recorder<'_>) {
        if self.settings.rows && self.link.is_some() {
            // The next capture finds samples.
            self.commands.send(Command::Stream(Streamed::Samples));
            if !self.drive.active() {
                // Nobody waits for an answer.
                let _ = self.turn_after_end(recorder);
            }
        }
        if !self.drive.active() || self.link.is_none() {
            return;
        }
        let begun = self.source.now();
        self.drive.stop(&mut self.commands, begun);
        while !self.drive.off() && self.link.is_some() && self.source.now().duration_since(begun) < STOPPING {
            // The record is over; only answers are of interest, and a fault here has nobody to be
            // told to who does not know of it: the device's watchdog stops the shaker.
            if self.turn_after_end(recorder).is_err() {
                return;
            }
        }
    }

    /// As [`Session::turn`], with nothing recorded.
    fn turn_after_end(&mut self, recorder: &mut Recorder<'_>) -> Result<()> {
        recorder.close();
        self.turn(recorder)?;
        self.drive.poll(&mut self.commands, self.source.now())
    }

    /// Ends record and journal.
    pub(super) fn finish(mut self, recorder: Recorder<'_>, result: Result<()>) -> Result<CaptureOutcome> {
        let (settings, recorded) = (self.settings, recorder.has_samples());
        let (recording, settle_s) = (recorder.recording(), recorder.settle_s());
        let until = self.precision(&recorder);
        let seconds = recorder.seconds().filter(|_| !until.as_ref().is_some_and(|until| until.reached));
        let (source, options) = (recorder.source().to_owned(), recorder.options().to_vec());
        let finished = recorder.finish();
        let journal = self.journal.take();
        let frames = path_of(&settings.output);
        let next = NextStep { source: &source, options: &options, rig: &self.rig.path, record: &settings.output };
        let finished = match finished {
            Ok(finished) => finished,
            // The record is not whole: the journal is what is left.
            Err(e) => {
                let remedy = format!("{}. Its bytes are safe in {}. {}", e.remedy, frames.display(), next.all());
                return Err(e.remedy(remedy));
            }
        };
        let received = finished.losses.received;
        let done = outcome(settings, finished, seconds);
        // One that was to be longer may be gone on with.
        let interrupted = recorded && (result.is_err() || done.as_ref().is_some_and(|done| !done.complete));
        let keep = settings.keep_frames || journal.as_ref().is_some_and(Journal::kept);
        if let Some(journal) = journal {
            journal.finish(match recorded {
                true if interrupted => End::Left,
                true if keep => End::Kept,
                _ => End::Removed,
            })?;
        }
        if let Err(e) = result {
            let remedy = if recorded {
                let output = settings.output.display();
                format!("{}. {received} samples until then are in {output}. {}", e.remedy, resume_advice(&next))
            } else {
                e.remedy.clone()
            };
            return Err(e.remedy(remedy));
        }
        let Some(mut done) = done else {
            return Err(self.no_sample(recording, settle_s));
        };
        if let (true, Some(short)) = (interrupted, done.warnings.iter_mut().find(|w| w.id == "short")) {
            short.advice = format!("The record is whole as far as it goes. {}", resume_advice(&next));
        }
        self.add_warnings(&mut done.warnings);
        done.warnings.extend(until.as_ref().and_then(Precision::missed));
        Ok(CaptureOutcome {
            until,
            frames: (keep || interrupted).then_some(frames),
            bytes: self.bytes,
            reconnections: self.reconnections,
            ..done
        })
    }

    /// Why there is no record: how far the capture had come when it ended.
    fn no_sample(&self, recording: bool, settle_s: f64) -> BadInput {
        let (found, remedy) = if self.settings.rows {
            self.no_window()
        } else if self.hello.is_none() {
            ("the capture ended before the device had answered".to_owned(), "Let it run for longer".to_owned())
        } else if !recording {
            let doing = if self.level.is_some() {
                "the amplitude was being levelled".to_owned()
            } else if settle_s > 0.0 {
                format!("the rig was left to settle ({settle_s} s before the first sample)")
            } else {
                "the drive was starting".to_owned()
            };
            let remedy = "Capture again, and end it (q or Ctrl-C) only when it says \"recording\"";
            (format!("the capture ended while {doing}"), remedy.to_owned())
        } else {
            ("the capture ended before a sample had come".to_owned(), "Let it run for longer".to_owned())
        };
        BadInput::new(format!("{found}: no record is written"), "").in_file(&self.settings.from).remedy(remedy)
    }

    /// The same where regression rows were to be recorded.
    fn no_window(&self) -> (String, String) {
        let length = match &self.rig.drive {
            Some(drive) => format!("20 drive periods ({} s)", rounded(20.0 / drive.frequency_hz, 4)),
            None => "20 drive periods".to_owned(),
        };
        let found = format!("the capture ended before one window of rows was whole, which takes {length}");
        let remedy = if self.settings.drive {
            "Let it run for longer, or record samples: leave --rows out"
        } else {
            "There are windows only while the drive runs: leave --no-drive out, or record samples: leave --rows out"
        };
        (found, remedy.to_owned())
    }

    /// What the session itself noticed.
    fn add_warnings(&mut self, warnings: &mut Vec<Warning>) {
        warnings.splice(0..0, self.resumed.take());
        warnings.append(&mut self.drive.warnings);
        warnings.extend(self.stall.warning(self.source.now()));
        if self.reconnections > 0 {
            let times =
                if self.reconnections == 1 { "once".to_owned() } else { format!("{} times", self.reconnections) };
            warnings.push(Warning::new(
                "reconnected",
                format!("the link was lost {times} (last: {})", self.lost_because),
                "Gaps that the device could not fill again are marked and counted; check the cable",
            ));
        }
    }
}

/// What to do with a record that is shorter than it was to be.
fn resume_advice(next: &NextStep<'_>) -> String {
    format!("Go on in it with {}, or end it here with {}, which removes its journal", next.resume(), next.make())
}

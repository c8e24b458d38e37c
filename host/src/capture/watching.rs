//! What a capture shows while it runs, and the precision at which it ends.

use std::time::Instant;

use super::Progress;
use super::feed::Standing;
use super::live::Session;
use super::precision::Precision;
use super::recorder::Recorder;

impl Session<'_> {
    /// Tells how far it is; what is to be told at once is told once.
    pub(super) fn tell(&mut self, recorder: &Recorder<'_>, progress: &mut dyn FnMut(&Progress)) {
        let told = self.progress(recorder);
        if let Some(feeder) = &mut self.feeder {
            feeder.lines(&told.notices);
        }
        progress(&told);
        self.notices.clear();
    }

    /// Leaves a copy for those who look on, who may hold a simulated rig to our time; never waits
    /// for them.
    pub(super) fn be_seen(&mut self, recorder: &Recorder<'_>, now: Instant) {
        let simulated = self.source.is_simulated();
        let due = match &mut self.feeder {
            None => return,
            Some(feeder) => {
                if simulated {
                    feeder.keep_pace(now);
                }
                feeder.due()
            }
        };
        if due {
            let standing = self.standing(recorder, simulated);
            if let Some(feeder) = &mut self.feeder {
                feeder.offer(standing);
            }
        }
    }

    fn standing(&self, recorder: &Recorder<'_>, simulated: bool) -> Standing {
        let target = self.drive.target();
        Standing {
            progress: Progress { notices: Vec::new(), ..self.progress(recorder) },
            losses: recorder.losses(),
            reconnections: self.reconnections,
            recording: recorder.recording(),
            asked: target
                .map(|t| (f64::from(t.amplitude_micrometre()) * 1e-6, f64::from(t.frequency_millihertz()) * 1e-3)),
            estimate: recorder.newest_estimate().cloned(),
            precision: self.precision(recorder),
            simulated,
        }
    }

    /// Of the parameter on which the end depends.
    pub(super) fn precision(&self, recorder: &Recorder<'_>) -> Option<Precision> {
        let until = self.until.as_ref()?;
        let samples = recorder.ticks().saturating_sub(recorder.losses().lost());
        Some(until.now(samples as f64 / self.rig.sample_rate_hz))
    }

    /// Whether the parameter is known as well as was asked for.
    pub(super) fn is_precise(&mut self, recorder: &Recorder<'_>) -> bool {
        let Some(until) = &mut self.until else { return false };
        if recorder.estimates() == self.estimates {
            return false;
        }
        self.estimates = recorder.estimates();
        if let Some(estimate) = recorder.newest_estimate() {
            until.take(estimate);
        }
        self.precision(recorder).is_some_and(|precision| precision.reached)
    }
}

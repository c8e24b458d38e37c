//! A device that is there and brings nothing: it answers, repeats itself or sends what is no frame,
//! but no new sample comes.

use std::time::{Duration, Instant};

use super::live::SILENCE;
use crate::warning::Warning;

/// Watches for new samples.
#[derive(Debug)]
pub(super) struct Stall {
    last_new: Instant,
    /// The present one has been reported.
    reported: bool,
    times: u32,
    longest: Duration,
}

impl Stall {
    pub(super) fn new(now: Instant) -> Self {
        Self { last_new: now, reported: false, times: 0, longest: Duration::ZERO }
    }

    /// Something new came.
    pub(super) fn over(&mut self, now: Instant) {
        if self.reported {
            self.longest = self.longest.max(self.lasts(now));
        }
        self.last_new = now;
        self.reported = false;
    }

    /// How long nothing new has come.
    pub(super) fn lasts(&self, now: Instant) -> Duration {
        now.duration_since(self.last_new)
    }

    /// Whether it is time to tell that nothing new comes: once a stall.
    pub(super) fn is_to_be_reported(&mut self, now: Instant) -> bool {
        let tell = !self.reported && self.lasts(now) > SILENCE;
        if tell {
            self.reported = true;
            self.times += 1;
        }
        tell
    }

    /// Whether a stall that was reported is under way.
    pub(super) fn is_reported(&self) -> bool {
        self.reported
    }

    /// What to say of it at the end.
    pub(super) fn warning(&self, now: Instant) -> Option<Warning> {
        let longest = if self.reported { self.longest.max(self.lasts(now)) } else { self.longest };
        let times = if self.times == 1 { "once".to_owned() } else { format!("{} times", self.times) };
        (self.times > 0).then(|| {
            Warning::new(
                "no-new-samples",
                format!(
                    "no new sample came for more than {} s {times}, at longest for {:.1} s",
                    SILENCE.as_secs_f64(),
                    longest.as_secs_f64()
                ),
                "The gaps are marked and counted; look at the device's log, its load and the cable",
            )
            .with("times", self.times)
            .with("longest_s", longest.as_secs_f64())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_is_told_once_and_summed_up() {
        let start = Instant::now();
        let at = |s: f64| start + Duration::from_secs_f64(s);
        let mut stall = Stall::new(start);
        assert!(!stall.is_to_be_reported(at(2.4)) && stall.warning(at(2.4)).is_none());
        assert!(stall.is_to_be_reported(at(2.6)) && !stall.is_to_be_reported(at(3.0)) && stall.is_reported());
        stall.over(at(4.0));
        assert!(!stall.is_reported() && !stall.is_to_be_reported(at(5.0)));
        let warning = stall.warning(at(6.0)).unwrap();
        assert!(warning.text.contains("once") && warning.text.contains("4.0 s"), "{}", warning.text);
        assert!(stall.is_to_be_reported(at(20.0)));
        assert!(stall.warning(at(20.0)).unwrap().text.contains("2 times, at longest for 16.0 s"));
    }
}

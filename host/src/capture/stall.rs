//! A device that is there and brings nothing: it answers, repeats itself or sends what is no frame,
//! but no new sample comes.

use std::time::{Duration, Instant};

use super::live::SILENCE;
use crate::warning::Warning;

/// Watches for new samples.
#[derive(Debug)]
pub(super) struct Stall {
    last_new: Instant,
    /// It was told of the present one.
    told: bool,
    times: u32,
    longest: Duration,
}

impl Stall {
    pub(super) fn new(now: Instant) -> Self {
        Self { last_new: now, told: false, times: 0, longest: Duration::ZERO }
    }

    /// Something new came.
    pub(super) fn over(&mut self, now: Instant) {
        if self.told {
            self.longest = self.longest.max(self.lasts(now));
        }
        self.last_new = now;
        self.told = false;
    }

    /// How long nothing new has come.
    pub(super) fn lasts(&self, now: Instant) -> Duration {
        now.duration_since(self.last_new)
    }

    /// Whether it is time to tell that nothing new comes: once a stall.
    pub(super) fn is_to_be_told(&mut self, now: Instant) -> bool {
        let tell = !self.told && self.lasts(now) > SILENCE;
        if tell {
            self.told = true;
            self.times += 1;
        }
        tell
    }

    /// Whether a stall that was told is under way.
    pub(super) fn told(&self) -> bool {
        self.told
    }

    /// What to say of it at the end.
    pub(super) fn warning(&self, now: Instant) -> Option<Warning> {
        let longest = if self.told { self.longest.max(self.lasts(now)) } else { self.longest };
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
        assert!(!stall.is_to_be_told(at(2.4)) && stall.warning(at(2.4)).is_none());
        assert!(stall.is_to_be_told(at(2.6)) && !stall.is_to_be_told(at(3.0)) && stall.told());
        stall.over(at(4.0));
        assert!(!stall.told() && !stall.is_to_be_told(at(5.0)));
        let warning = stall.warning(at(6.0)).unwrap();
        assert!(warning.text.contains("once") && warning.text.contains("4.0 s"), "{}", warning.text);
        assert!(stall.is_to_be_told(at(20.0)));
        assert!(stall.warning(at(20.0)).unwrap().text.contains("2 times, at longest for 16.0 s"));
    }
}

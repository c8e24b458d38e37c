//! Asks the device for what the link has lost, one gap at a time, from the earliest on.
//!
//! What is missing, and for how long it is worth asking, says the account ([`super::accounting`]);
//! here is only when to ask. A question or an answer may be lost as anything else on the link:
//! where nothing of an answer comes for [`SILENCE`], it is asked for again, for as long as the
//! account waits.

use std::time::{Duration, Instant};

use whirl_shared::frame::Command;

/// How long an answer may pause.
const SILENCE: Duration = Duration::from_secs(1);
/// How long the end of a capture waits for what is being restored, at most.
pub(super) const LONGEST: Duration = Duration::from_secs(300);

/// Ticks that are missing, as the device counts them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gap {
    pub(super) boot_id: u32,
    pub(super) first_tick: u32,
    pub(super) ticks: u32,
}

/// What was asked for.
#[derive(Debug, Default)]
pub(super) struct BackFill {
    /// With the time at which something of the answer came last.
    asked: Option<(Gap, Instant)>,
}

impl BackFill {
    /// What is to be asked now, where this is missing.
    pub(super) fn ask(&mut self, gap: Option<Gap>, now: Instant) -> Option<Command> {
        let Some(gap) = gap else {
            self.asked = None;
            return None;
        };
        let under_way = self.asked.is_some_and(|(asked, heard)| {
            let within = gap.first_tick.wrapping_sub(asked.first_tick) < asked.ticks;
            asked.boot_id == gap.boot_id && within && now.duration_since(heard) < SILENCE
        });
        if under_way {
            return None;
        }
        self.asked = Some((gap, now));
        let Gap { boot_id, first_tick, ticks } = gap;
        Some(Command::BackFill { boot_id, first_tick, ticks })
    }

    /// A part of an answer came.
    pub(super) fn heard(&mut self, now: Instant) {
        if let Some((_, heard)) = &mut self.asked {
            *heard = now;
        }
    }

    /// An answer is complete, or the link was opened anew: what is missing now is asked for.
    pub(super) fn over(&mut self) {
        self.asked = None;
    }

    /// Whether an answer is waited for.
    pub(super) fn is_under_way(&self) -> bool {
        self.asked.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_asked_for_once_until_it_is_answered_or_nothing_comes() {
        let (mut back_fill, start) = (BackFill::default(), Instant::now());
        let gap = |first_tick, ticks| Some(Gap { boot_id: 7, first_tick, ticks });
        let command = |first_tick, ticks| Some(Command::BackFill { boot_id: 7, first_tick, ticks });
        let after = |ms| start + Duration::from_millis(ms);
        assert_eq!(back_fill.ask(None, start), None);
        assert_eq!(back_fill.ask(gap(u32::MAX - 9, 100), start), command(u32::MAX - 9, 100));
        // As it is filled, over the wrap of the device's ticks.
        back_fill.heard(after(900));
        assert_eq!(back_fill.ask(gap(50, 40), after(1_800)), None);
        assert_eq!(back_fill.ask(gap(50, 40), after(1_900)), command(50, 40));
        // Another gap; another boot; an answer that was not complete.
        assert_eq!(back_fill.ask(gap(500, 10), after(1_950)), command(500, 10));
        let other = Some(Gap { boot_id: 8, first_tick: 500, ticks: 10 });
        assert!(back_fill.ask(other, after(1_951)).is_some() && back_fill.ask(other, after(1_952)).is_none());
        back_fill.over();
        assert!(back_fill.ask(other, after(1_953)).is_some() && back_fill.is_under_way());
        assert_eq!(back_fill.ask(None, after(1_954)), None);
        assert!(!back_fill.is_under_way());
    }
}

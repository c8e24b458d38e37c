//! What is on the screen, from what a capture has shown: the last seconds of each angle, its
//! Poincaré section, first light.
//!
//! Rates are differences over 2·lag samples, lag about a fortieth of a drive period (10 ms without
//! a drive): for the eye alone. A section is stroboscopic: a point where the device's own phase
//! passes 0, linear between the samples before and behind it, while samples are recorded. Memory is
//! bounded: [`LONGEST_S`] of samples, [`MOST_POINTS`] points a section.

use std::collections::VecDeque;

use whirl_shared::frame::{Hello, MOST_ENCODERS, Status};

use super::first_light::Turning;
use crate::capture::feed::{Seen, SeenSample, Standing};
use crate::rig::Rig;
use crate::rig::measures::BASE;
use crate::wording::symbols::symbol_plain;

/// Longest stretch of time that can be shown, s.
pub(super) const LONGEST_S: f64 = 20.0;
/// Stretches of time that can be shown, s.
const SPANS_S: [f64; 5] = [1.0, 2.0, 5.0, 10.0, LONGEST_S];
/// Most samples that are kept, whatever the rate.
const MOST_SAMPLES: usize = 40_000;
/// Most points of a section: above an hour at 5 Hz.
const MOST_POINTS: usize = 20_000;
/// Ticks by which a block may come late.
const LATE: u32 = 1_000;
/// Lines that are kept.
const MOST_LINES: usize = 100;

/// Pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Page {
    /// Angles, phase portrait, section, drive, losses, estimate.
    #[default]
    Motion,
    /// Each encoder turned by hand.
    FirstLight,
}

/// An encoder, as the rig file has it.
#[derive(Clone, Debug)]
pub(super) struct Arm {
    /// `θ₁`.
    pub(super) symbol: String,
    /// What is measured, in words.
    pub(super) measures: &'static str,
    pub(super) counts_per_turn: u32,
    pub(super) turning: Turning,
    /// Angle (degrees, −180 to 180) and rate (degrees a second) at phase 0.
    pub(super) section: VecDeque<(f64, f64)>,
    /// Greatest rate seen, degrees a second, and greatest angle from 0, degrees.
    pub(super) fastest: f64,
    pub(super) widest: f64,
}

/// A sample with what was found of it; the rate is that in the middle of those around it.
#[derive(Clone, Copy, Debug)]
struct Kept {
    sample: SeenSample,
    /// No sample is missing before it.
    follows: bool,
}

/// All that is drawn.
#[derive(Debug)]
pub(super) struct Scene {
    pub(super) title: String,
    pub(super) arms: Vec<Arm>,
    pub(super) rate_hz: f64,
    history: VecDeque<Kept>,
    /// Half of the samples over which a rate is taken.
    lag: usize,
    pub(super) hello: Option<Hello>,
    pub(super) status: Option<Status>,
    pub(super) standing: Option<Standing>,
    pub(super) lines: VecDeque<String>,
    pub(super) page: Page,
    /// The arm whose phase portrait is shown where there is room for one alone.
    pub(super) arm: usize,
    span: usize,
    /// The simulated rig runs as fast as it can.
    pub(super) hurry: bool,
    /// The end was asked for.
    pub(super) ending: bool,
}

/// What a channel measures, in words.
fn words(measures: &str) -> &'static str {
    match measures {
        "theta1" | "phi1" => "arm 1 against the frame",
        "theta2" => "arm 2 against arm 1",
        "phi2" => "arm 2 against the frame",
        _ => "its own angle",
    }
}

/// `theta1` as `θ₁`.
fn symbol(measures: &str) -> String {
    let name = measures.replace("theta", "θ").replace("phi", "φ");
    symbol_plain(&name)
}

impl Scene {
    pub(super) fn new(rig: &Rig, title: &str) -> Self {
        let arms = rig.channel.iter().filter(|c| c.measures != BASE).take(MOST_ENCODERS).map(|c| Arm {
            symbol: symbol(&c.measures),
            measures: words(&c.measures),
            counts_per_turn: c.counts_per_turn.unwrap_or(1).max(1),
            turning: Turning::default(),
            section: VecDeque::new(),
            fastest: 0.0,
            widest: 0.0,
        });
        let span_s = rig.drive.map_or(0.4, |d| 1.0 / d.frequency_hz);
        // Bounded by the samples that are kept; rates are at most 1e7 Hz.
        let lag = ((rig.sample_rate_hz * span_s / 40.0).round() as usize).clamp(1, MOST_SAMPLES / 8);
        Self {
            title: title.to_owned(),
            arms: arms.collect(),
            rate_hz: rig.sample_rate_hz,
            history: VecDeque::new(),
            lag,
            hello: None,
            status: None,
            standing: None,
            lines: VecDeque::new(),
            page: Page::default(),
            arm: 0,
            span: 2,
            hurry: false,
            ending: false,
        }
    }

    /// Takes what is new.
    pub(super) fn take(&mut self, seen: Seen) {
        let recorded_before = self.recording();
        self.standing = seen.standing.or(self.standing.take());
        if self.recording() && !recorded_before {
            // What came while the drive was started is not of the motion that is recorded.
            self.arms.iter_mut().for_each(|arm| arm.section.clear());
        }
        let boot = |hello: &Option<Hello>| hello.as_ref().map(|h| h.boot_id);
        if self.hello.is_some() && seen.hello.is_some() && boot(&self.hello) != boot(&seen.hello) {
            self.history.clear();
            self.arms.iter_mut().for_each(|arm| arm.turning = Turning::default());
        }
        self.hello = seen.hello.or(self.hello.take());
        self.status = seen.status.or(self.status.take());
        self.lines.extend(seen.lines);
        self.lines.drain(..self.lines.len().saturating_sub(MOST_LINES));
        for sample in seen.samples {
            self.sample(sample);
        }
    }

    fn recording(&self) -> bool {
        self.standing.as_ref().is_some_and(|s| s.recording)
    }

    fn sample(&mut self, sample: SeenSample) {
        let ahead = self.history.back().map(|last| sample.tick.wrapping_sub(last.sample.tick));
        if let Some(ahead @ (0 | 0x8000_0000..)) = ahead {
            // A repeated block, or one that comes late.
            if ahead == 0 || ahead > u32::MAX - LATE {
                return;
            }
            // A device that has restarted.
            self.history.clear();
        }
        self.history.push_back(Kept { sample, follows: ahead == Some(1) });
        let most = ((LONGEST_S * self.rate_hz) as usize).clamp(1, MOST_SAMPLES) + 2 * self.lag + 2;
        self.history.drain(..self.history.len().saturating_sub(most));
        for (arm, &count) in self.arms.iter_mut().zip(sample.counts.iter()) {
            arm.turning.take(count, sample.tick, self.rate_hz);
        }
        self.strobe();
    }

    /// Puts a point into each section where the phase has passed 0 in the middle of the newest
    /// samples.
    fn strobe(&mut self) {
        let Some(i) = self.history.len().checked_sub(self.lag + 1).filter(|i| *i > self.lag) else { return };
        let (before, now) = (self.history[i - 1].sample, self.history[i].sample);
        let passed = now.phase_increment > 0 && now.phase < before.phase && self.history[i].follows;
        let share = f64::from(before.phase.wrapping_neg()) / f64::from(now.phase_increment.max(1));
        for k in 0..self.arms.len() {
            let (Some(earlier), Some(later)) = (self.rate(i - 1, k), self.rate(i, k)) else { return };
            let turn = f64::from(self.arms[k].counts_per_turn);
            let moved = f64::from(now.counts[k].wrapping_sub(before.counts[k]));
            let arm = &mut self.arms[k];
            arm.fastest = arm.fastest.max(later.abs());
            arm.widest = arm.widest.max(degrees(f64::from(now.counts[k]) + 0.5, turn).abs());
            if passed {
                let count = f64::from(before.counts[k]) + share.clamp(0.0, 1.0) * moved;
                arm.section
                    .push_back((degrees(count + 0.5, turn), earlier + share.clamp(0.0, 1.0) * (later - earlier)));
                arm.section.drain(..arm.section.len().saturating_sub(MOST_POINTS));
            }
        }
    }

    /// Rate at a kept sample, degrees a second; none beside a gap.
    fn rate(&self, i: usize, arm: usize) -> Option<f64> {
        let (first, last) =
            (self.history.get(i.checked_sub(self.lag)?)?.sample, self.history.get(i + self.lag)?.sample);
        let ticks = last.tick.wrapping_sub(first.tick);
        if ticks as usize != 2 * self.lag {
            return None;
        }
        let turns =
            f64::from(last.counts[arm].wrapping_sub(first.counts[arm])) / f64::from(self.arms[arm].counts_per_turn);
        Some(360.0 * turns * self.rate_hz / f64::from(ticks))
    }

    /// The stretch of time that is shown, s.
    pub(super) fn span_s(&self) -> f64 {
        SPANS_S[self.span]
    }

    /// Shows a longer stretch of time, or a shorter one.
    pub(super) fn zoom(&mut self, longer: bool) {
        self.span = if longer { (self.span + 1).min(SPANS_S.len() - 1) } else { self.span.saturating_sub(1) };
    }

    /// Where in the history the shown stretch begins, and time before now, s.
    fn shown(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let newest = self.history.back().map_or(0, |k| k.sample.tick);
        let before = move |k: &Kept| f64::from(newest.wrapping_sub(k.sample.tick)) / self.rate_hz;
        let first = self.history.partition_point(|k| before(k) > self.span_s());
        self.history.iter().enumerate().skip(first).map(move |(i, k)| (i, -before(k)))
    }

    /// Time before now (s) and angle (degrees, −180 to 180) of an arm.
    pub(super) fn angles(&self, arm: usize) -> Vec<(f64, f64)> {
        let turn = f64::from(self.arms[arm].counts_per_turn);
        self.shown().map(|(i, t)| (t, degrees(f64::from(self.history[i].sample.counts[arm]) + 0.5, turn))).collect()
    }

    /// Angle (degrees) and rate (degrees a second) of an arm.
    pub(super) fn portrait(&self, arm: usize) -> Vec<(f64, f64)> {
        let turn = f64::from(self.arms[arm].counts_per_turn);
        let angle = |i: usize| degrees(f64::from(self.history[i].sample.counts[arm]) + 0.5, turn);
        self.shown().filter_map(|(i, _)| Some((angle(i), self.rate(i, arm)?))).collect()
    }

    /// The newest sample.
    pub(super) fn newest(&self) -> Option<&SeenSample> {
        self.history.back().map(|kept| &kept.sample)
    }
}

/// Counts as an angle from −180 to 180 degrees.
pub(super) fn degrees(counts: f64, counts_per_turn: f64) -> f64 {
    let turns = counts / counts_per_turn;
    360.0 * (turns - turns.round())
}

#[cfg(test)]
#[path = "scene_tests.rs"]
pub(super) mod tests;

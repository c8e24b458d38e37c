//! Places in a record from which a model is followed: pieces, states fitted to their beginnings, and
//! the step of integration that does.

use crate::identify::Prepared;
use crate::identify::shooting::problem::{Piece, Problem};
use crate::identify::stretches::Stretch;
use crate::identify::track::Track;
use crate::model::dynamics::Dynamics;
use crate::rig::Rig;

/// Length of the fit, drive periods.
pub const FIT_PERIODS: f64 = 2.0;
/// Longest prediction, drive periods.
pub const LONGEST_PERIODS: f64 = 60.0;
/// Most pieces where nobody says how many.
pub const MOST_STARTS: usize = 60;
/// Steps of integration a drive period.
const STEPS: f64 = 50.0;

/// Pieces in which a step of integration is sought, and the share of what a sensor shows to which
/// solutions over the fit are exact.
const MOST_SEARCHED: usize = 12;
const EXACT: f64 = 1e-4;
/// Steps that the search begins with, as shares of what it is given (see
/// [`crate::identify::shooting::run::integration_step`]).
const SEARCHED: f64 = 20.0;
/// By how much at most a step is made finer: 122 predictions of 60 periods must end in some
/// seconds.
const MOST_FINER: f64 = 16.0;

/// The time scales of a motion.
#[derive(Clone, Copy)]
pub struct Pace {
    /// Period of the drive, or what stands for it, s.
    pub period_s: f64,
    /// Angular frequency of the drive, rad/s; 0 for none.
    pub omega: f64,
}

/// A record on its axis of time.
#[derive(Clone, Copy)]
pub struct RecordTrack<'a> {
    /// Its stretches.
    pub stretches: &'a [Stretch],
    /// They as one track.
    pub track: &'a Track<'a>,
}

/// Samples that a start needs where the longest stretch has so many: its fit and a quarter of the
/// longest prediction behind it; half of a short record, which has no room for that, and the fit
/// twice at least.
fn least_room(stretch: usize, fit: usize, longest: usize) -> usize {
    let wished = fit + longest.saturating_sub(fit) / 4;
    if stretch > wished { wished } else { (stretch / 2).max(2 * fit) }
}

/// A model that is followed from many places.
pub struct Starts<'a> {
    /// Its equations.
    pub dynamics: &'a dyn Dynamics,
    /// Values of their parameters.
    pub parameters: &'a [f64],
    /// Drive's period and frequency.
    pub pace: Pace,
    /// Most pieces.
    most: usize,
    /// Step of integration, s.
    pub step_s: f64,
}

impl<'a> Starts<'a> {
    /// For a model on a record, with `most` pieces at most.
    pub fn new(
        dynamics: &'a dyn Dynamics,
        parameters: &'a [f64],
        record: RecordTrack<'_>,
        pace: Pace,
        most: usize,
    ) -> Self {
        let mut out = Self { dynamics, parameters, pace, most, step_s: pace.period_s / STEPS };
        if pace.omega == 0.0 {
            // Nothing says how fast a system of its own moves: found from the beginnings of some
            // pieces.
            let (pieces, guesses) = out.pieces(record);
            let every = pieces.len().div_ceil(MOST_SEARCHED).max(1);
            let values = out.samples(FIT_PERIODS, record.track) * record.track.sensors.len();
            let head = |p: &Piece| Piece { measured: p.measured[..values.min(p.measured.len())].to_vec(), ..*p };
            let heads: Vec<Piece> = pieces.iter().step_by(every).map(head).collect();
            let guesses: Vec<Vec<f64>> = guesses.into_iter().step_by(every).collect();
            if !heads.is_empty() {
                // The search begins at a twentieth of what it is given: at the step that a drive of
                // this period would have.
                let longest = out.step_s;
                let found = record.track.step_s(dynamics, &heads, &guesses, parameters, SEARCHED * longest, EXACT);
                out.step_s = found.max(longest / MOST_FINER).min(longest);
            }
        }
        out
    }

    /// What is fitted along a track whose inputs are `at`.
    pub fn problem<'b>(
        &'b self,
        track: &'b Track<'_>,
        at: &'b (dyn Fn(f64, &mut [f64]) + Sync),
    ) -> Problem<'b, dyn Dynamics + 'b> {
        track.problem(self.dynamics, self.step_s, at)
    }

    /// Samples of so many periods.
    pub fn samples(&self, periods: f64, track: &Track<'_>) -> usize {
        (periods * self.pace.period_s / track.spacing_s).round() as usize
    }

    /// The state at the first sample of a stretch, fitted to its first periods.
    pub fn first_state(&self, record: RecordTrack<'_>, stretch: usize) -> Option<Vec<f64>> {
        let at = |t: f64, out: &mut [f64]| record.track.inputs(t, out);
        let problem = self.problem(record.track, &at);
        let fit = self.samples(FIT_PERIODS, record.track).min(record.track.samples(stretch));
        let (piece, guess) = record.track.piece(stretch, 0, fit)?;
        let levels = [self.samples(1.0, record.track).min(fit), fit];
        problem.fit_state(&piece, &guess, self.parameters, &levels, &mut problem.room(false)).map(|f| f.0)
    }

    /// Pieces for horizons, evenly over the record.
    pub fn pieces(&self, record: RecordTrack<'_>) -> (Vec<Piece>, Vec<Vec<f64>>) {
        let track = record.track;
        let (fit, longest) = (self.samples(FIT_PERIODS, track), self.samples(FIT_PERIODS + LONGEST_PERIODS, track));
        let lengths: Vec<usize> = (0..record.stretches.len()).map(|k| track.samples(k)).collect();
        let least = least_room(lengths.iter().copied().max().unwrap_or(0), fit, longest);
        let room: Vec<usize> = lengths.iter().map(|n| n.saturating_sub(least)).collect();
        let all: usize = room.iter().sum();
        let every = all.div_ceil(self.most).max(self.samples(1.0, track)).max(1);
        let mut out = (Vec::new(), Vec::new());
        // Counted on from stretch to stretch, so that many short ones are no more starts than one.
        let mut next = 0;
        for (k, room) in room.into_iter().enumerate() {
            let firsts = (next..room).step_by(every);
            next = (next + firsts.len() * every).saturating_sub(room);
            for first in firsts {
                if let Some((piece, guess)) = track.piece(k, first, longest.min(lengths[k] - first)) {
                    out.0.push(piece);
                    out.1.push(guess);
                }
            }
        }
        out
    }
}

/// What stands for the drive's period in a free pendulum, s.
const FREE_PERIOD_S: f64 = 0.2;
/// Fewest samples of a period.
const FEWEST_SAMPLES: f64 = 8.0;

/// The drive's period; in a free system of a user's own that of the highest frequency that the weak
/// form takes into account.
pub fn period_s(rig: &Rig, prepared: &Prepared) -> f64 {
    let windows = &prepared.geometry.windows;
    match (rig.drive, &rig.bound) {
        (Some(d), _) => 1.0 / d.frequency_hz,
        (None, None) => FREE_PERIOD_S,
        (None, Some(_)) => (windows.length_s / windows.frequencies as f64).max(FEWEST_SAMPLES / rig.sample_rate_hz),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two periods of 20 samples are fitted, sixty predicted.
    #[test]
    fn a_short_record_has_starts() {
        let of = |stretch| least_room(stretch, 40, 1240);
        assert_eq!([341, 340, 200, 100].map(of), [340, 170, 100, 80]);
    }
}

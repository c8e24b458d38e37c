//! An encoder that stops for good, or begins late, while its arm moves by few counts a sample: the
//! jump of the velocity that [`super::frozen`] looks for then drowns in the counts' own steps.
//!
//! The scale is the motion's own: m samples, in which it moves by the last [`LEAP`] counts L before
//! the run (at least [`LEAST`] samples). Over them the velocity goes from L/m to nothing. Three
//! things tell a sensor from a joint:
//! - the run lasts for [`LASTS`] m samples at least, to the end of the stretch or from its start;
//! - the motion does not slow down toward it: half of the samples make at least [`HALF`] of the
//!   way (0.5 where the velocity is constant, 0.25 where a constant force brings it to rest);
//! - nowhere else in the stretch does the velocity change by half as much in as many samples, max
//!   abs(x(i+m) − 2 x(i) + x(i−m)) < L/2. What brings a joint to rest (friction, springs, gravity,
//!   a drive's command) acts elsewhere in the record too; before it comes to rest a joint is braked
//!   by at least 4 L/m² over the last m samples, and that is seen.
//!
//! Limits: a stretch needs [`ELSEWHERE`] m samples of motion. What happens once in a stretch, from
//! one sample to the next and in the middle of a steady motion (an arm that is caught by hand, or
//! hits a latch), looks like a sensor that dies. Sensors without steps are not looked at.

use super::trace::Samples;

/// Counts of the way: five times what the steps of counts can make of a second difference.
const LEAP: f64 = 10.0;
/// Fewest samples over which it is looked at.
const LEAST: usize = 4;
/// Length of the run over that of the motion before it.
const LASTS: usize = 8;
/// Least share of the way in the half of the samples next to the run.
const HALF: f64 = 0.38;
/// Samples of motion, over those of the motion next to the run.
const ELSEWHERE: usize = 50;

/// Whether the velocity leaps as nowhere else where a run of equal samples `from..to` has its end:
/// `before` it or behind.
pub fn leaps(s: &Samples<'_>, (from, to): (usize, usize), before: bool, quantum: f64) -> bool {
    // The motion: sample 0 is the run's own nearest.
    let room = if before { from } else { s.len() - to };
    let x = |k: usize| if before { s.at(from - k) } else { s.at(to - 1 + k) };
    let way = |k: usize| (x(k) - x(0)).abs();
    let longest = ((to - from) / LASTS).min(room / ELSEWHERE);
    let Some(m) = (1..=longest).find(|k| way(*k) >= LEAP * quantum).map(|m| m.max(LEAST)) else { return false };
    if m > longest || quantum == 0.0 || way(m / 2) < HALF * way(m) * (2 * (m / 2)) as f64 / m as f64 {
        return false;
    }
    let most = 0.5 * way(m);
    (m..=room - m).all(|k| (x(k - m) - 2.0 * x(k) + x(k + m)).abs() < most)
}

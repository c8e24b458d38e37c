//! A free motion of which a record holds less than three periods.
//!
//! Equations with a few coefficients follow half a swing whatever is missing in them: that they
//! describe it says nothing. Periods are counted by how often a sensor turns back, by more than
//! `TURNS` of what it spans, two of them a period; a whole turn of an arm is a period too. A motion
//! that has come to rest within the record is one that is long enough.

use std::f64::consts::TAU;

use crate::inspect::motion::{Motion, Space, motions};
use crate::record::Record;
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::{in_seconds, several};

/// Periods below which is warned.
const FEWEST: usize = 3;
/// Share of a sensor's span by which it must turn back (by hand).
const TURNS: f64 = 0.05;
/// Rows in which something may be seen to be at rest.
const REST_ROWS: usize = 10;
/// Share of the span that the last third of a motion that has come to rest keeps below.
const RESTS: f64 = 0.1;
/// Steps of a sensor that a motion must span.
const STEPS: f64 = 20.0;

/// What is to be said of records of a free motion; nothing of one that is driven, by a base or by
/// measured inputs.
pub fn warned(records: &[Record], rig: &Rig) -> Option<Warning> {
    let is_driven = rig.drive.is_some() || rig.bound.as_ref().is_some_and(|b| !b.inputs.is_empty());
    if is_driven {
        return None;
    }
    let all: Vec<Motion> = records.iter().flat_map(motions).filter(|m| !m.derived).collect();
    let moving = || all.iter().filter(|m| m.stretches.iter().any(|x| span(x) > STEPS * m.step));
    let rests = |m: &Motion| m.stretches.iter().any(|x| span(x) > STEPS * m.step && comes_to_rest(x));
    if moving().any(rests) {
        return None;
    }
    // Of several records each adds what it holds.
    let (turns, most) = moving()
        .map(|m| (moving().filter(|n| n.name == m.name).map(turns_of).sum::<usize>(), m))
        .max_by_key(|(turns, _)| *turns)?;
    if turns >= 2 * FEWEST {
        return None;
    }
    let seconds: f64 = records.iter().flat_map(|r| &r.segments).map(|s| s.len() as f64 * s.step_s).sum();
    let times = several(turns, "time");
    let text = format!(
        "{} turns back {times} in {}: less than {FEWEST} periods of the motion, and hardly anything in so short a record can contradict the model",
        most.name,
        in_seconds(seconds)
    );
    let advice = format!(
        "Trust the parameters, and that the equations describe the record, only with a longer one: {FEWEST} periods at least, better ten"
    );
    Some(Warning::new("few-periods", text, advice).with("channel", most.name.clone()).with("turns", turns))
}

/// Turnings of a sensor, and two for each whole turn of an arm.
fn turns_of(m: &Motion) -> usize {
    let whole = |x: &[f64]| if m.space == Space::S1 { (span(x) / TAU) as usize } else { 0 };
    m.stretches.iter().map(|x| turnings(x) + 2 * whole(x)).sum()
}

fn span(x: &[f64]) -> f64 {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    (high - low).max(0.0)
}

fn comes_to_rest(x: &[f64]) -> bool {
    x.len() >= 3 * REST_ROWS && span(&x[x.len() - x.len() / 3..]) < RESTS * span(x)
}

/// How often a series turns back by more than a share of its span.
fn turnings(x: &[f64]) -> usize {
    let least = TURNS * span(x);
    let Some(first) = x.first().filter(|_| least > 0.0) else { return 0 };
    let (mut low, mut high, mut way, mut count) = (*first, *first, 0, 0);
    for x in x {
        (low, high) = (low.min(*x), high.max(*x));
        let turned = if way >= 0 && *x < high - least {
            -1
        } else if way <= 0 && *x > low + least {
            1
        } else {
            continue;
        };
        count += usize::from(way != 0);
        (way, low, high) = (turned, *x, *x);
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn swing(periods: f64, decay: f64) -> Vec<f64> {
        let at = |i: usize| periods * TAU * i as f64 / 1000.0;
        (0..1000).map(|i| (-decay * at(i)).exp() * at(i).cos()).collect()
    }

    #[test]
    fn a_swing_turns_twice_a_period() {
        for (periods, turns) in [(0.4, 0), (0.7, 1), (1.2, 2), (3.2, 6), (10.2, 20)] {
            assert_eq!(turnings(&swing(periods, 0.0)), turns, "{periods}");
        }
        assert_eq!(turnings(&[]) + turnings(&[1.0; 9]), 0);
    }

    #[test]
    fn small_noise_is_no_turning() {
        let noisy: Vec<f64> =
            swing(1.2, 0.0).iter().enumerate().map(|(i, x)| x + if i % 2 == 0 { 0.02 } else { -0.02 }).collect();
        assert_eq!(turnings(&noisy), 2);
    }

    #[test]
    fn what_has_died_away_is_long_enough() {
        assert!(comes_to_rest(&swing(1.0, 1.0)) && !comes_to_rest(&swing(1.0, 0.05)));
    }
}

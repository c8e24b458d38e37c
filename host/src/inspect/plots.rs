//! The points that a report draws of a record: histories, portraits, Poincaré sections. Single
//! precision is enough here.

use serde::Serialize;
use std::f64::consts::TAU;

use super::coordinate::Coordinate;
use super::motion::{Motion, Space};
use crate::record::Record;
use crate::report::figures::decimate;
use crate::signal::angles::wrap;

/// Most points of one plotted series.
const MOST: usize = 2000;

/// A series over time. A gap is a pair of `null`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct History {
    /// Time, s.
    pub time_s: Vec<f32>,
    /// Value: rad (unwrapped or wrapped, as the field says) or the coordinate's unit.
    pub value: Vec<f32>,
}

/// What is drawn of one coordinate.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Plots {
    /// The coordinate's name.
    pub name: String,
    /// The whole record, unwrapped, least and greatest of each step of time kept.
    pub whole: History,
    /// Its beginning, wrapped to [−π, π), every sample up to 2000.
    pub start: History,
    /// Portrait: value (wrapped), `null` between stretches and where an angle passes ±π.
    pub portrait_x: Vec<f32>,
    /// Portrait: velocity, unit/s.
    pub portrait_v: Vec<f32>,
    /// Poincaré section at τ mod 2π = 0: value (wrapped).
    pub section_x: Vec<f32>,
    /// Poincaré section: velocity, unit/s.
    pub section_v: Vec<f32>,
}

/// Samples (fractional) of a segment at which the drive's phase passes zero.
fn section_samples(record: &Record, segment: usize, drive_hz: f64) -> Vec<f64> {
    let s = &record.segments[segment];
    if let Some(phase) = &s.phase {
        // The device's own phase, turns · 2⁻³²: it passes zero where it wraps.
        return phase
            .windows(2)
            .enumerate()
            .filter(|(_, w)| w[1] < w[0] && w[0] - w[1] > 1 << 31)
            .map(|(i, w)| {
                let (before, after) = ((u32::MAX - w[0]) as f64 + 1.0, f64::from(w[1]));
                i as f64 + before / (before + after)
            })
            .collect();
    }
    let turns = |i: usize| s.time(i) * drive_hz;
    let (first, last) = (turns(0).ceil() as i64, turns(s.len().saturating_sub(1)).floor() as i64);
    // A record's start is far from 2⁵³ turns, and there is at most one passage for each ten samples
    // (rig files say so).
    (first..=last.min(first.saturating_add(s.len() as i64)))
        .map(|k| (k as f64 / drive_hz - s.start_s) / s.step_s)
        .collect()
}

/// The whole record: least and greatest of each stretch of time, the pen lifted between segments.
fn whole(record: &Record, motion: &Motion) -> History {
    let all: Vec<f64> = motion.stretches.iter().flatten().copied().collect();
    let places: Vec<(usize, usize)> =
        motion.stretches.iter().enumerate().flat_map(|(s, x)| (0..x.len()).map(move |i| (s, i))).collect();
    let mut out = History::default();
    let mut before = None;
    for k in decimate::extremes(&all, MOST) {
        let (s, i) = places[k];
        let Some(segment) = record.segments.get(s) else { continue };
        if before.is_some_and(|b| b != s) {
            out.time_s.push(f32::NAN);
            out.value.push(f32::NAN);
        }
        before = Some(s);
        out.time_s.push(segment.time(i) as f32);
        out.value.push(all[k] as f32);
    }
    out
}

/// Collects what is drawn of one coordinate. `start_s`: length of the beginning that is drawn
/// sample by sample.
pub fn plots(record: &Record, motion: &Motion, coordinate: &Coordinate, drive_hz: Option<f64>, start_s: f64) -> Plots {
    let mut out = Plots { name: motion.name.clone(), ..Plots::default() };
    let bent = |x: f64| if motion.space == Space::S1 { wrap(x) } else { x };
    let total: usize = motion.stretches.iter().map(Vec::len).sum();
    let m = coordinate.slope_half_width;
    let velocities = motion.velocities(record.sample_rate_hz, m);
    // An irrational stride: a whole one would meet a locked orbit at the same few places over and
    // over.
    let stride = match total.div_ceil(2 * MOST) {
        0 | 1 => 1.0,
        whole => whole as f64 + 0.618_033_988_75,
    };
    out.whole = whole(record, motion);
    let (mut taken, mut next, mut picked) = (0usize, 0usize, 0.0_f64);
    let stretches = motion.stretches.iter().enumerate();
    for (s, x) in stretches.filter(|(s, x)| !x.is_empty() && *s < record.segments.len()) {
        let v = &velocities[s];
        let mut before = f64::NAN;
        // One count over all stretches, so that many short ones stay few points.
        let from = taken;
        taken += v.len();
        while next < taken {
            let i = next - from;
            picked += 1.0;
            next = (picked * stride) as usize;
            let here = bent(x[i + m]);
            // A new stretch, or a turn past ±π: the pen is lifted.
            if !((here - before).abs() < 0.5 * TAU || motion.space == Space::R && !before.is_nan()) {
                out.portrait_x.push(f32::NAN);
                out.portrait_v.push(f32::NAN);
            }
            before = here;
            out.portrait_x.push(here as f32);
            out.portrait_v.push(v[i] as f32);
        }
        for at in drive_hz.map(|f| section_samples(record, s, f)).unwrap_or_default() {
            let at = at - m as f64;
            let i = at.floor();
            if i < 0.0 || i as usize + 1 >= v.len() || out.section_x.len() >= 2 * MOST {
                continue;
            }
            let (i, u) = (i as usize, at - i);
            let (a, b) = (x[i + m], x[i + m + 1]);
            out.section_x.push(bent(a + u * (b - a)) as f32);
            out.section_v.push((v[i] + u * (v[i + 1] - v[i])) as f32);
        }
    }
    if let (Some(x), Some(segment)) = (motion.stretches.first(), record.segments.first()) {
        let n = ((start_s * record.sample_rate_hz).ceil() as usize + 1).min(x.len());
        let stride = n.div_ceil(MOST).max(1);
        let mut before = f64::NAN;
        for i in (0..n).step_by(stride) {
            // A turn past ±π: the pen is lifted.
            let turn = (bent(x[i]) - before).abs() > 0.5 * TAU && motion.space == Space::S1;
            if turn {
                out.start.time_s.push(f32::NAN);
                out.start.value.push(f32::NAN);
            }
            before = bent(x[i]);
            out.start.time_s.push(segment.time(i) as f32);
            out.start.value.push(before as f32);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::coordinate::describe;
    use super::*;
    use crate::record::{Column, Segment};

    #[test]
    fn thousands_of_short_segments_stay_few_points() {
        let segment = |k: i64| {
            let column = Column::Values((0..19).map(|i| (0.01 * (20 * k + i) as f64).sin()).collect());
            Segment { first_tick: 20 * k, ..Segment::new(0.02 * k as f64, 0.001, vec![column]) }
        };
        let record = Record {
            path: "x.csv".into(),
            sample_rate_hz: 1000.0,
            channels: vec![crate::rig::Channel::new("x", "rad")],
            segments: (0..20_000).map(segment).collect(),
            ..Record::default()
        };
        let motion = &super::super::motion::motions(&record)[0];
        let c = describe(motion, None, 1000.0, Some(5.0), 4);
        let p = plots(&record, motion, &c, Some(5.0), 4.0);
        assert!(p.whole.time_s.len() <= 2 * MOST + 4, "{}", p.whole.time_s.len());
        assert!((MOST..=4 * MOST + 4).contains(&p.portrait_x.len()), "{}", p.portrait_x.len());
        assert!(p.section_x.len() <= 2 * MOST);
    }
}

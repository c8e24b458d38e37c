//! Unstable periodic orbits of a free record, whose period is not known beforehand: a stretch that
//! leaves its start and comes back to it, ‖s_i(t) − s_i(t + p)‖ < e · span_i for every coordinate i
//! and any p, with s_i(t) = [θ_i(t), θ_i(t + T_d)] (one delay more where there is a single
//! coordinate) and distances on the circle: (3.24) without a drive (D. Auerbach et al., *Physical
//! Review Letters* 58, 1987).
//!
//! Every start's returns are followed up to the longest period; of neighbouring starts that return
//! after the same time the best is kept, its period from the parabola through the squared distances
//! of three samples. Best closing ones first, a stretch is counted under an orbit that it follows,
//! once or several times round; two are compared at 120 equal parts of the period, from whatever
//! part on.
//!
//! Limits: a period should have some hundred samples; a decaying motion never returns, and one that
//! spirals slowly out of an equilibrium does so at every turn. Cost: samples times longest period,
//! with starts left out beyond 3·10⁸ comparisons.

use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;

use super::orbit_catalogue::at;
use super::unstable_periodic_orbit::Trajectory;

/// Points at which orbits are compared; several times round divides them evenly.
const POINTS: usize = 120;
/// Points by which one orbit may run before or behind another: slow parts take longer a little way
/// off.
const DRIFT: usize = POINTS / 20;
/// Tolerances that a state must have been away before it can return.
const AWAY: f64 = 3.0;
/// Most comparisons of two states.
const MOST_WORK: usize = 300_000_000;
/// Relative difference of two periods beyond which orbits are different ones.
const SAME_PERIOD: f64 = 0.05;
/// Groups of periods, each of which keeps its own best closing ones.
const GROUPS: usize = 16;
/// States whose share within the tolerance of some orbit is told.
const STATES: usize = 5000;

/// Choices of an extraction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// e, share of the span.
    pub tolerance: f64,
    /// Longest period looked for, samples.
    pub longest: usize,
    /// Two orbits are one where they lie nowhere farther apart than so many tolerances.
    pub merge: f64,
    /// Delay T_d, samples.
    pub delay: usize,
    /// Most closing stretches that are compared.
    pub most: usize,
}

/// A distinct orbit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FreeOrbit {
    /// Period, s.
    pub period_s: f64,
    /// Time at which its best closing stretch starts, s.
    pub start_s: f64,
    /// Closing error, share of the span.
    pub error: f64,
    /// Whole turns over the orbit, one for each coordinate; none for a coordinate that is no angle.
    pub turns: Vec<Option<i64>>,
    /// Closing stretches that are this orbit.
    pub seen: usize,
}

/// Outcome of an extraction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FreeExtraction {
    /// Choices.
    pub settings: Settings,
    /// Distinct orbits, by period.
    pub orbits: Vec<FreeOrbit>,
    /// Closing stretches found, before merging.
    pub recurrences: usize,
    /// Share of the record's states that lie within the tolerance of some orbit.
    pub coverage: f64,
}

/// A stretch that closes after `period` samples.
#[derive(Clone, Copy, Debug)]
struct Closing {
    stretch: usize,
    start: usize,
    period: f64,
    error: f64,
}

/// Delays in a state.
fn delays(stretch: &Trajectory<'_>) -> usize {
    if stretch.tracks.len() == 1 { 3 } else { 2 }
}

fn samples(stretch: &Trajectory<'_>) -> usize {
    stretch.tracks.iter().map(|t| t.values.len()).min().unwrap_or(0)
}

/// Largest over the coordinates of ‖s_i(n) − s_i(m)‖/span_i; infinity where it is above `limit`.
fn distance(stretch: &Trajectory<'_>, n: usize, m: usize, delay: usize, limit: f64) -> f64 {
    let mut worst = 0.0_f64;
    for t in &stretch.tracks {
        let mut square = 0.0;
        for d in 0..delays(stretch) {
            square += t.difference(t.values[m + d * delay] - t.values[n + d * delay]).powi(2);
            if square > limit * limit {
                return f64::INFINITY;
            }
        }
        worst = worst.max(square.sqrt());
    }
    worst
}

/// Returns to the state at sample n: period in samples, error.
fn returns(stretch: &Trajectory<'_>, n: usize, settings: &Settings) -> Vec<(f64, f64)> {
    let (tolerance, delay) = (settings.tolerance, settings.delay);
    let room = samples(stretch).saturating_sub(n + (delays(stretch) - 1) * delay + 3);
    let error = |p: usize| distance(stretch, n, n + p, delay, AWAY * tolerance);
    let mut found = Vec::new();
    let (mut away, mut best) = (false, None::<(usize, f64)>);
    for p in 1..settings.longest.min(room) {
        let e = error(p);
        away |= e == f64::INFINITY;
        if !away {
            continue;
        }
        if e < tolerance {
            if best.is_none_or(|b| e < b.1) {
                best = Some((p, e));
            }
        } else if let Some((p, e)) = best.take() {
            let square = |p: usize| error(p).min(AWAY * tolerance).powi(2);
            let (a, b, c) = (square(p - 1), e * e, square(p + 1));
            let bend = a - 2.0 * b + c;
            let shift = if bend > 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            found.push((p as f64 + shift, e));
        }
    }
    found
}

/// The best closing stretches of a record's stretch.
fn closing(index: usize, stretch: &Trajectory<'_>, stride: usize, settings: &Settings) -> Vec<Closing> {
    let starts: Vec<usize> = (0..samples(stretch)).step_by(stride).collect();
    let all: Vec<Vec<(f64, f64)>> = starts.par_iter().map(|n| returns(stretch, *n, settings)).collect();
    let mut out = Vec::new();
    // Runs of starts that return after nearly the same time: its period at the last start, and the
    // best.
    let mut runs: Vec<(f64, Closing)> = Vec::new();
    for (start, found) in starts.iter().zip(&all) {
        let mut next = Vec::with_capacity(found.len());
        for &(period, error) in found {
            let here = Closing { stretch: index, start: *start, period, error };
            let near = runs.iter().position(|(p, _)| (p - period).abs() <= 2.0 + stride as f64);
            let best = match near.map(|i| runs.swap_remove(i).1) {
                Some(best) if best.error <= error => best,
                _ => here,
            };
            next.push((period, best));
        }
        out.extend(runs.drain(..).map(|r| r.1));
        runs = next;
    }
    out.extend(runs.into_iter().map(|r| r.1));
    out
}

/// State at a real sample.
fn state(stretch: &Trajectory<'_>, t: f64, delay: usize) -> Vec<f64> {
    let of = |d: usize| stretch.tracks.iter().map(move |k| at(k.values, t + (d * delay) as f64));
    (0..delays(stretch)).flat_map(of).collect()
}

fn within(stretch: &Trajectory<'_>, a: &[f64], b: &[f64], limit: f64) -> bool {
    let count = stretch.tracks.len();
    a.iter().zip(b).enumerate().all(|(i, (a, b))| stretch.tracks[i % count].difference(a - b) < limit)
}

/// Whether a state lies within `limit` of the straight line between two neighbouring points of an
/// orbit.
fn beside(stretch: &Trajectory<'_>, a: &[f64], [b0, b1]: [&[f64]; 2], limit: f64) -> bool {
    let count = stretch.tracks.len();
    // Signed differences in spans.
    let signed = |i: usize, d: f64| {
        let track = &stretch.tracks[i % count];
        let d = if track.angle { d - TAU * (d / TAU).round() } else { d };
        d / track.span
    };
    let (mut along, mut square) = (0.0, 0.0);
    for i in 0..a.len() {
        let (x, y) = (signed(i, a[i] - b0[i]), signed(i, b1[i] - b0[i]));
        along += x * y;
        square += y * y;
    }
    let u = if square > 0.0 { (along / square).clamp(0.0, 1.0) } else { 0.0 };
    (0..a.len()).all(|i| (signed(i, a[i] - b0[i]) - u * signed(i, b1[i] - b0[i])).abs() < limit)
}

/// Whether `a`, from some part on, goes `times` round `b`, a little earlier or later at times.
fn follows(stretch: &Trajectory<'_>, a: &[Vec<f64>], b: &[Vec<f64>], times: usize, limit: f64) -> bool {
    (0..POINTS).any(|shift| {
        a.iter().enumerate().all(|(s, a)| {
            let place = s * times + shift + POINTS;
            (place - DRIFT..place + DRIFT).any(|j| beside(stretch, a, [&b[j % POINTS], &b[(j + 1) % POINTS]], limit))
        })
    })
}

/// Extracts the orbits.
pub fn extract(record: &[Trajectory<'_>], settings: &Settings) -> FreeExtraction {
    let total: usize = record.iter().map(samples).sum();
    let stride = total.saturating_mul(settings.longest).div_ceil(MOST_WORK).max(1);
    let mut found: Vec<Closing> =
        record.iter().enumerate().flat_map(|(i, s)| closing(i, s, stride, settings)).collect();
    let recurrences = found.len();
    found.sort_by(|a, b| a.error.total_cmp(&b.error).then((a.stretch, a.start).cmp(&(b.stretch, b.start))));
    // Long ones close less well: each group of periods keeps its own.
    let mut kept = [0; GROUPS];
    found.retain(|c| {
        let group = (c.period / settings.longest.max(1) as f64 * GROUPS as f64) as usize;
        let count = &mut kept[group.min(GROUPS - 1)];
        *count += 1;
        *count <= settings.most.div_ceil(GROUPS)
    });
    let limit = settings.merge * settings.tolerance;
    let (mut orbits, mut points): (Vec<FreeOrbit>, Vec<Vec<Vec<f64>>>) = (Vec::new(), Vec::new());
    for c in &found {
        let stretch = &record[c.stretch];
        let here: Vec<Vec<f64>> = (0..POINTS)
            .map(|s| state(stretch, c.start as f64 + c.period * s as f64 / POINTS as f64, settings.delay))
            .collect();
        let period_s = c.period * stretch.step_s;
        let known = (0..orbits.len()).find(|&o| {
            let ratio = period_s / orbits[o].period_s;
            let times = ratio.round().max(1.0);
            (ratio / times - 1.0).abs() < SAME_PERIOD && follows(stretch, &here, &points[o], times as usize, limit)
        });
        if let Some(o) = known {
            orbits[o].seen += 1;
            continue;
        }
        let repeats = [2, 3, 4, 5, 6, 8].iter().any(|j| {
            (0..POINTS).all(|s| {
                let place = s + POINTS / j + POINTS;
                (place - DRIFT..place + DRIFT)
                    .any(|k| beside(stretch, &here[s], [&here[k % POINTS], &here[(k + 1) % POINTS]], limit))
            })
        });
        if repeats {
            continue;
        }
        let turns = stretch
            .tracks
            .iter()
            .map(|t| {
                t.angle.then(|| ((at(t.values, c.start as f64 + c.period) - t.values[c.start]) / TAU).round() as i64)
            })
            .collect();
        let start_s = stretch.start_s + c.start as f64 * stretch.step_s;
        orbits.push(FreeOrbit { period_s, start_s, error: c.error, turns, seen: 1 });
        points.push(here);
    }
    let coverage = coverage(record, &points, total, settings);
    orbits.sort_by(|a, b| a.period_s.total_cmp(&b.period_s));
    FreeExtraction { settings: *settings, orbits, recurrences, coverage }
}

fn coverage(record: &[Trajectory<'_>], points: &[Vec<Vec<f64>>], total: usize, settings: &Settings) -> f64 {
    let stride = total.div_ceil(STATES).max(1);
    let (mut covered, mut all) = (0_usize, 0_usize);
    for stretch in record {
        let last = samples(stretch).saturating_sub((delays(stretch) - 1) * settings.delay + 3);
        let near: Vec<bool> = (1..last)
            .step_by(stride)
            .collect::<Vec<usize>>()
            .into_par_iter()
            .map(|n| {
                let here = state(stretch, n as f64, settings.delay);
                points.iter().flatten().any(|p| within(stretch, &here, p, settings.tolerance))
            })
            .collect();
        all += near.len();
        covered += near.iter().filter(|n| **n).count();
    }
    covered as f64 / all.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::test_series::lorenz;
    use super::super::unstable_periodic_orbit::Track;
    use super::*;

    fn stretch<'a>(values: &[&'a [f64]]) -> Trajectory<'a> {
        let track = |x: &&'a [f64]| {
            let (low, high) = x.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
            Track { values: x, angle: false, span: high - low }
        };
        Trajectory { tracks: values.iter().map(track).collect(), start_s: 0.0, step_s: 0.01, phase: 0.0 }
    }

    /// Shortest orbits of Lorenz's system and their periods: Viswanath, *Nonlinearity* 16, 2003: AB
    /// 1.5587, AAB and ABB 2.3059, then those of four turns: AAAB, ABBB 3.0236, AABB 3.0843.
    #[test]
    fn finds_lorenzs_shortest_orbits_with_their_published_periods() {
        let [x, y, z] = lorenz(60_000, 5);
        let settings = Settings { tolerance: 0.02, longest: 340, merge: 2.0, delay: 10, most: 2000 };
        for record in [vec![&x[..], &y[..], &z[..]], vec![&x[..], &z[..]]] {
            let found = extract(&[stretch(&record)], &settings);
            let periods: Vec<f64> = found.orbits.iter().map(|o| o.period_s).collect();
            let near = |wanted: f64| periods.iter().filter(|p| (**p / wanted - 1.0).abs() < 0.006).count();
            assert_eq!(near(1.5587), 1, "{periods:?}");
            // Two coordinates tell neighbouring stretches apart less well than three: some stand
            // there twice.
            assert!(near(2.3059) == 2 || (record.len() == 2 && near(2.3059) > 2), "{periods:?}");
            assert!(near(3.0236) >= 1 && near(3.0843) >= 1, "{periods:?}");
            // The spirals about the two equilibria take 0.63 to 0.7 a turn; nothing lies between
            // them and AB.
            assert!(!periods.iter().any(|p| (0.8..1.5).contains(p) || (1.65..2.2).contains(p)), "{periods:?}");
            assert!(found.coverage > 0.2 && found.recurrences > 10);
        }
    }

    #[test]
    fn a_whirling_orbit_is_told_with_its_turns_and_not_twice_round() {
        // A turn every 137.3 samples, that swings; then away.
        let phase = |i: usize| TAU * i as f64 / 137.3;
        let x: Vec<f64> = (0..3000)
            .map(|i| {
                if i < 1500 {
                    phase(i) + 0.5 * phase(i).sin()
                } else {
                    1e-5 * (i as f64 - 1500.0).powi(2) + phase(1500)
                }
            })
            .collect();
        let record = Trajectory {
            tracks: vec![Track { values: &x, angle: true, span: TAU }],
            start_s: 5.0,
            step_s: 0.01,
            phase: 0.0,
        };
        let settings = Settings { tolerance: 0.01, longest: 600, merge: 2.0, delay: 30, most: 2000 };
        let found = extract(&[record], &settings);
        let first = &found.orbits[0];
        assert!((first.period_s - 1.373).abs() < 2e-3 && first.turns == [Some(1)], "{found:?}");
        assert!(!found.orbits.iter().any(|o| (o.period_s / 2.746 - 1.0).abs() < 0.02), "{found:?}");
    }

    #[test]
    fn what_decays_or_is_too_short_has_none() {
        let x: Vec<f64> = (0..4000).map(|i| (0.05 * f64::from(i)).sin() * (-1e-3 * f64::from(i)).exp()).collect();
        let settings = Settings { tolerance: 0.01, longest: 500, merge: 2.0, delay: 20, most: 2000 };
        let near_the_end = extract(&[stretch(&[&x[..1500]])], &settings);
        assert!(near_the_end.orbits.is_empty(), "{near_the_end:?}");
        assert!(extract(&[stretch(&[&x[..30]])], &settings).orbits.is_empty());
        assert!(extract(&[], &settings).orbits.is_empty());
    }
}

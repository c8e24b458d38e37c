//! Short gaps filled from the rows around them.
//!
//! Every missing row ends a stretch: one in a hundred, and no stretch is long enough for anything.
//! A value between rows follows from Lagrange's polynomial through m rows before the gap and m
//! after it, Σ w_j x_j; of white noise σ² in the rows it has the part Σ w_j² σ². How far it misses
//! is tried on rows that are there, taken for missing:
//!
//! v_m = ⟨(x − Σ w_j x_j)²/(1 + Σ w_j²)⟩
//!
//! is σ² where noise is all that it misses by, and falls with m where motion is. Gaps of a length
//! are filled where v of an m agrees with those of all greater ones for every sensor, by the least.
//! What acts is known and has no noise: a column that mostly repeats itself (a command that is held)
//! is filled by the row before, another by the best m where that misses by little of its scatter. A
//! record without noise keeps its gaps; one that is sampled too coarsely for its motion does too.
//!
//! What follows a gap must go on from what came before it: the first row behind is compared with
//! the polynomial through the last ones before, by the scatter of the same comparison within
//! stretches. So releases of a motion stay apart, and so do leaps of an encoder that stand clear of
//! that scatter. Values are made of rows that were recorded, as many as in the trial: two gaps with
//! fewer between them part stretches. So does every gap of a record that lost more than a tenth.

use super::segments::plural;
use super::{Column, Record, Segment};
use crate::signal::lagrange;
use crate::warning::Warning;

/// Most rows of a gap that is filled. A Lagrange polynomial over more has little of the noise's size
/// left: over four, eight rows give 2.5 to 7 times the noise's power.
const LONGEST: usize = 3;
/// Most rows on each side that a value is made of.
const SIDE: usize = 4;
/// Ratio of v_m to those of greater m up to which they agree: what motion adds is then a third of
/// the noise's power at most.
const AGREE: f64 = 1.3;
/// Fewest places for the trial: with them v scatters by a fifth.
const FEWEST: usize = 50;
/// Most places: with them v scatters by a hundredth, and more would only take longer.
const MOST: usize = 20_000;
/// Most of a sensor's scatter that is noise (σ over the standard deviation), and of what acts that a
/// filled value may miss by: a row of thousands is then wrong by that.
const NOISE: f64 = 0.3;
const ACTING: f64 = 0.02;
/// Most rows of a record that are filled (by hand: standard errors take them for measured).
const MOST_FILLED: f64 = 0.1;
/// Scatters within which a row behind a gap goes on from those before it.
const GOES_ON: f64 = 6.0;
/// Most parts of a step by which a stretch may be off the clock of the one before.
const OFF_CLOCK: f64 = 0.25;

/// What was filled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Filled {
    /// Rows.
    pub(super) rows: u64,
    /// Rows of the longest gap.
    pub(super) longest: usize,
}

impl Filled {
    /// What is said of it, where some were filled; `stretches` are left.
    pub(super) fn warning(self, stretches: u64) -> Option<Warning> {
        let (rows, row) = (plural(self.rows, "row"), plural(self.longest as u64, "row"));
        let (are, were) = if self.rows == 1 { ("is", "was") } else { ("are", "were") };
        let left = plural(stretches, "unbroken stretch");
        let text = format!(
            "{rows} that {are} missing or left out, in gaps of up to {row}, {were} filled from those around; {left} left"
        );
        let advice = "Tried on rows that are there, such values miss by hardly more than the sensors' noise";
        (self.rows > 0).then(|| Warning::new("gaps-filled", text, advice))
    }
}

/// How values of a channel are filled in.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Filling {
    /// The row before.
    Repeat,
    /// Polynomial through so many rows on each side.
    Polynomial(usize),
}

impl Filling {
    /// Rows before and behind a gap that a value is made of.
    fn sides(self) -> (usize, usize) {
        match self {
            Self::Repeat => (1, 0),
            Self::Polynomial(m) => (m, m),
        }
    }
}

/// What the trial found for gaps of a length: of each channel its filling, and degree and scatter
/// of the row behind about the polynomial through those before.
type Trial = Vec<(Filling, usize, f64)>;

/// Fills the short gaps of a record. `moduli`: of each channel what it was recorded modulo of;
/// `sensors`: channels that show the motion, the others act.
pub(super) fn fill(record: &mut Record, moduli: &[Option<f64>], sensors: &[usize]) -> Filled {
    let gaps: Vec<Option<usize>> = record.segments.windows(2).map(|w| rows_between(&w[0], &w[1])).collect();
    let trial = |lost: usize| {
        let channel = |k: usize| tried(&record.segments, (k, sensors.contains(&k)), lost);
        gaps.contains(&Some(lost)).then(|| (0..record.channels.len()).map(channel).collect::<Option<Trial>>()).flatten()
    };
    let trials: Vec<Option<Trial>> = (1..=LONGEST).map(trial).collect();
    let mut filled = Filled::default();
    if trials.iter().all(Option::is_none) {
        return filled;
    }
    let short: usize = gaps.iter().flatten().sum();
    if short as f64 > MOST_FILLED * record.samples() as f64 {
        return filled;
    }
    let (mut out, mut clocks): (Vec<Segment>, Vec<Clock>) = (Vec::new(), Vec::new());
    for (k, next) in std::mem::take(&mut record.segments).into_iter().enumerate() {
        let gap = k.checked_sub(1).and_then(|k| gaps[k]).and_then(|lost| Some((lost, trials[lost - 1].as_ref()?)));
        let joined = match (gap, out.last_mut(), clocks.last_mut()) {
            (Some((lost, trial)), Some(last), Some(clock)) => turns(last, &next, lost, trial, moduli).map(|turns| {
                clock.add(last.len() + lost, &next);
                let first = last.len();
                join(last, &next, lost, trial, &turns);
                last.filled.push(first..first + lost);
                filled.rows += lost as u64;
                filled.longest = filled.longest.max(lost);
            }),
            _ => None,
        };
        if joined.is_none() {
            clocks.push(Clock::of(&next));
            out.push(next);
        }
    }
    for (segment, clock) in out.iter_mut().zip(&clocks) {
        clock.set(segment);
    }
    record.segments = out;
    filled
}

/// Rows missing between two stretches of one clock; none where they are too many.
fn rows_between(a: &Segment, b: &Segment) -> Option<usize> {
    if a.boot != b.boot || a.phase.is_some() != b.phase.is_some() || a.is_empty() || b.is_empty() {
        return None;
    }
    let steps = (b.start_s - a.time(a.len() - 1)) / a.step_s;
    let lost = steps.round() - 1.0;
    let is_short = (1.0..=LONGEST as f64).contains(&lost) && (steps - steps.round()).abs() < OFF_CLOCK;
    // Within 1 … LONGEST.
    is_short.then_some(lost as usize)
}

/// Tries gaps of `lost` rows in a channel (a sensor's or not) on rows that are there.
fn tried(segments: &[Segment], (channel, shows): (usize, bool), lost: usize) -> Option<(Filling, usize, f64)> {
    let span = 2 * SIDE + lost;
    let series: Vec<Vec<f64>> = segments.iter().map(|s| values(&s.columns[channel])).collect();
    let places: usize = series.iter().map(|x| (x.len() + 1).saturating_sub(span)).sum();
    if places < FEWEST {
        return None;
    }
    let every = places.div_ceil(MOST);
    let windows = || series.iter().flat_map(|x| x.windows(span)).step_by(every);
    let is_held = !shows && {
        let (same, all) = windows().fold((0, 0), |(s, n), w| (s + usize::from(w[SIDE] == w[SIDE - 1]), n + 1));
        2 * same > all
    };
    let filling = if is_held { Filling::Repeat } else { Filling::Polynomial(side(windows, lost, shows)?) };
    let scatter = |degree: usize| {
        let w = weights(&before(degree), lost as f64 + 1.0);
        // The row that is taken for the first behind a gap, and those before the gap.
        let off = |x: &[f64]| (x[SIDE + lost] - dot(&w, &x[SIDE - w.len()..SIDE])).powi(2);
        let (sum, n) = windows().fold((0.0, 0.0), |(s, n), x| (s + off(x), n + 1.0));
        (sum / n).sqrt()
    };
    let (degree, least) = (0..3).map(|d| (d, scatter(d))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some((filling, degree, least))
}

/// The fewest rows on each side from which more do not come nearer; for what acts the number that
/// comes nearest.
fn side<'a, W: Iterator<Item = &'a [f64]>>(windows: impl Fn() -> W, lost: usize, shows: bool) -> Option<usize> {
    let (sum, squares, n) = windows().fold((0.0, 0.0, 0.0), |(s, q, n), x| (s + x[0], q + x[0] * x[0], n + 1.0));
    let variance: f64 = (squares - sum * sum / n).max(0.0) / n;
    let missed = |m: usize| {
        let weights: Vec<Vec<f64>> = (0..lost).map(|k| weights(&around(m, m, lost), (k + 1) as f64)).collect();
        let (mut sum, mut n) = (0.0, 0.0);
        for x in windows() {
            for (k, w) in weights.iter().enumerate() {
                let (left, right) = w.split_at(m);
                let filled = dot(left, &x[SIDE - m..SIDE]) + dot(right, &x[SIDE + lost..SIDE + lost + m]);
                sum += (x[SIDE + k] - filled).powi(2) / (1.0 + dot(w, w));
                n += 1.0;
            }
        }
        sum / n
    };
    let v: Vec<f64> = (1..=SIDE).map(missed).collect();
    if shows {
        let agree = |m: &usize| v[*m..].iter().all(|other| v[m - 1] <= AGREE * other);
        return (1..SIDE).find(agree).filter(|m| v[m - 1] <= NOISE * NOISE * variance);
    }
    let best = (1..=SIDE).min_by(|a, b| v[a - 1].total_cmp(&v[b - 1]))?;
    (v[best - 1] <= ACTING * ACTING * variance).then_some(best)
}

/// Whole turns, as values, that put every channel of a stretch behind a gap where the one before it
/// leads to; none where a channel does not go on.
fn turns(a: &Segment, b: &Segment, lost: usize, trial: &Trial, moduli: &[Option<f64>]) -> Option<Vec<f64>> {
    let recorded = a.len() - a.filled.last().map_or(0, |f| f.end);
    let of = |(k, (filling, degree, scatter)): (usize, &(Filling, usize, f64))| {
        let (left, right) = filling.sides();
        if recorded < left.max(*degree + 1) || b.len() < right {
            return None;
        }
        let last = tail(&a.columns[k], *degree + 1);
        let led = dot(&weights(&before(*degree), lost as f64 + 1.0), &last);
        let first = value(&b.columns[k], 0);
        let modulus = moduli.get(k).copied().flatten();
        // Which way round is not known.
        if modulus.is_some_and(|m| GOES_ON * scatter >= 0.5 * m) {
            return None;
        }
        let turns = modulus.map_or(0.0, |m| m * ((led - first) / m).round());
        if let Column::Counts(b) = &b.columns[k]
            && b.iter().any(|c| (f64::from(*c) + turns).abs() >= f64::from(i32::MAX))
        {
            return None;
        }
        let goes_on = *filling == Filling::Repeat || (first + turns - led).abs() <= GOES_ON * scatter;
        goes_on.then_some(turns)
    };
    trial.iter().enumerate().map(of).collect()
}

/// Appends `lost` rows and a stretch.
fn join(a: &mut Segment, b: &Segment, lost: usize, trial: &Trial, turns: &[f64]) {
    for ((k, column), (filling, _, _)) in a.columns.iter_mut().enumerate().zip(trial) {
        let (left, right) = filling.sides();
        let mut nodes = tail(column, left);
        nodes.extend((0..right).map(|i| value(&b.columns[k], i) + turns[k]));
        let places = around(left, right, lost);
        let between = (1..=lost).map(|i| dot(&weights(&places, i as f64), &nodes));
        match (column, &b.columns[k]) {
            (Column::Counts(a), Column::Counts(b)) => {
                // As an encoder would show it; turns of counts are whole counts.
                a.extend(between.map(|x| x.round() as i32));
                a.extend(b.iter().map(|c| c.saturating_add(turns[k] as i32)));
            }
            (Column::Values(a), b) => {
                a.extend(between);
                a.extend(values(b).into_iter().map(|x| x + turns[k]));
            }
            // Columns of one channel are of one kind.
            (Column::Counts(_), Column::Values(_)) => {}
        }
    }
    if let (Some(a), Some(b)) = (&mut a.phase, &b.phase) {
        fill_phase(a, b, lost);
    }
    if let (Some(a), Some(b)) = (&mut a.amplitude_nm, &b.amplitude_nm) {
        let held = a.last().copied().unwrap_or(0);
        a.extend(std::iter::repeat_n(held, lost));
        a.extend(b);
    }
}

/// The drive's phase over a gap: its last advance goes on, what is left is shared out evenly.
fn fill_phase(a: &mut Vec<u32>, b: &[u32], lost: usize) {
    let (Some(&last), Some(&next)) = (a.last(), b.first()) else { return };
    let after = || b.get(1).map_or(0, |second| second.wrapping_sub(next));
    let advance = a.len().checked_sub(2).map_or_else(after, |i| last.wrapping_sub(a[i]));
    let steps = lost as u32 + 1;
    // Two's complement: the shorter way round.
    let left = next.wrapping_sub(last.wrapping_add(advance.wrapping_mul(steps))) as i32;
    for i in 1..steps {
        let share = (i64::from(left) * i64::from(i) / i64::from(steps)) as u32;
        a.push(last.wrapping_add(advance.wrapping_mul(i)).wrapping_add(share));
    }
    a.extend(b);
}

/// The line through the times of all rows of stretches that were joined, by least squares.
struct Clock {
    parts: Vec<Part>,
}

/// Rows of one of them.
struct Part {
    /// How many.
    rows: f64,
    /// Number of the middle one, and its time, s.
    middle: f64,
    time_s: f64,
    step_s: f64,
    jitter_s: f64,
}

impl Part {
    /// Σ (i − ī)² over its rows.
    fn spread(&self) -> f64 {
        self.rows * (self.rows * self.rows - 1.0) / 12.0
    }
}

impl Clock {
    fn of(s: &Segment) -> Self {
        let mut out = Self { parts: Vec::new() };
        out.add(0, s);
        out
    }

    /// Adds a stretch whose first row has this number.
    fn add(&mut self, first: usize, s: &Segment) {
        let half = 0.5 * (s.len() as f64 - 1.0);
        self.parts.push(Part {
            rows: s.len() as f64,
            middle: first as f64 + half,
            time_s: s.start_s + half * s.step_s,
            step_s: s.step_s,
            jitter_s: s.jitter_s,
        });
    }

    fn set(&self, s: &mut Segment) {
        if self.parts.len() < 2 {
            return;
        }
        let n: f64 = self.parts.iter().map(|p| p.rows).sum();
        let mean = |of: &dyn Fn(&Part) -> f64| self.parts.iter().map(|p| p.rows * of(p)).sum::<f64>() / n;
        let (i, t) = (mean(&|p| p.middle), mean(&|p| p.time_s));
        let spread: f64 = self.parts.iter().map(|p| p.rows * (p.middle - i).powi(2) + p.spread()).sum();
        let along = |p: &Part| p.rows * (p.middle - i) * (p.time_s - t) + p.step_s * p.spread();
        s.step_s = self.parts.iter().map(along).sum::<f64>() / spread;
        s.start_s = t - s.step_s * i;
        s.jitter_s = mean(&|p| p.jitter_s * p.jitter_s).sqrt();
    }
}

fn values(column: &Column) -> Vec<f64> {
    (0..column.len()).map(|i| value(column, i)).collect()
}

fn value(column: &Column, i: usize) -> f64 {
    match column {
        Column::Counts(c) => f64::from(c[i]),
        Column::Values(v) => v[i],
    }
}

/// The last `n` values.
fn tail(column: &Column, n: usize) -> Vec<f64> {
    (column.len() - n..column.len()).map(|i| value(column, i)).collect()
}

/// Places of the last `degree` + 1 rows before a gap, its last row before at 0.
fn before(degree: usize) -> Vec<f64> {
    (0..=degree).rev().map(|i| -(i as f64)).collect()
}

/// Places of rows on both sides of a gap of `lost` rows, which lie at 1 … `lost`.
fn around(left: usize, right: usize, lost: usize) -> Vec<f64> {
    (0..left).rev().map(|i| -(i as f64)).chain((1..=right).map(|i| (lost + i) as f64)).collect()
}

/// Weights of the polynomial through `places` at `at`.
fn weights(places: &[f64], at: f64) -> Vec<f64> {
    lagrange::weights(places, at).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
#[path = "bridge_tests.rs"]
mod tests;

//! Slips of single counts, which lie below the noise of any sample and show in what the equations
//! leave of many.
//!
//! An encoder that loses or gains c counts is off by them from then on. In the residuals r of a
//! piece of [`super::shooting`] (predicted minus measured, in the sensors' σ) that is a step of
//! height −s at sample j of sensor k, s being c counts in σ, beside what the piece's own state and
//! an offset of the sensor take of it. With Q an orthonormal basis of the residuals' derivatives by
//! these and L samples,
//!
//! R = −Σ_{i≥j} (r − Q Qᵀ r)_ik,  S = L − j − |Σ_{i≥j} Q_ik|²,  gain = 2 s R − s² S
//!
//! is what the step takes off the sum of squares; c is the whole number of counts nearest to R/S. A
//! step is believed whose gain exceeds `LIMIT` times the samples for which the sensor stands on one
//! count, since what rounding leaves is of one sign for as long, and beside which the piece is like
//! what noise leaves (`LIKE`): a model that misses something leaves more. Pieces overlap by half,
//! since a step at the end of a piece is taken for its state.
//!
//! Limits: the place is right to a few samples; two slips within half a piece are found one after
//! the other; sensors that count alone; nothing is said where the equations miss something besides.

use std::borrow::Cow;

use indicatif::ProgressBar;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::best::MOST_SAMPLES;
use super::prepared::Prepared;
use super::shooting::problem::{Piece, Problem};
use super::{Identification, Settings, best, built_in, shooting};
use crate::error::Result;
use crate::model::dynamics::Dynamics;
use crate::record::{Column, Record};
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::suspects::{Mending, slipped};

/// Least gain in units of the noise's variance: eight standard deviations, by chance 10⁻¹⁵ a look.
const LIMIT: f64 = 64.0;
/// Mean square of a piece without its step, in units of what the pieces leave in the middle (of the
/// noise's variance where that is more): five standard deviations of it for 400 samples of two
/// sensors.
const LIKE: f64 = 1.25;
/// Share of the pieces beyond which steps in them are none of slips: an encoder that loses counts
/// does so now and then, and what the equations lack shows everywhere (by hand).
const EVERYWHERE: f64 = 0.5;
/// Share by which what the equations leave may grow where true slips are taken back: windows are
/// few, and scatter (by hand).
const GROWS: f64 = 0.05;
/// Samples within which two pieces show one step.
const SAME: usize = 12;
/// Times that what is found is taken back and everything identified again: where slips are many,
/// the offsets that they leave hide the later ones at first.
const MOST_ROUNDS: usize = 4;

/// A step of one sensor by whole counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slip {
    /// Sensor, in the order of the rig's equations.
    pub sensor: usize,
    /// Stretch of the prepared record.
    pub stretch: usize,
    /// Sample of the stretch from which on it is off.
    pub sample: usize,
    /// By how many counts.
    pub counts: f64,
    /// What it takes off the sum of squares, in units of the noise's variance.
    pub gain: f64,
}

/// The same in a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Record.
    pub record: usize,
    /// Channel of the record.
    pub channel: usize,
    /// Time of the first sample that is off, s.
    pub time_s: f64,
    /// By how many steps of its counts.
    pub steps: f64,
}

/// Slips in what a fit leaves. `states`: the fitted state of each piece; `first`: the sample of its
/// stretch at which a piece begins; `count`: size of one count of each sensor.
pub fn find<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    states: &[Vec<f64>],
    parameters: &[f64],
    first: &(dyn Fn(&Piece) -> usize + Sync),
    count: &[Option<f64>],
) -> Vec<Slip> {
    if count.iter().all(Option::is_none) {
        return Vec::new();
    }
    let between = overlapping(problem, pieces, states, parameters);
    let all: Vec<(&Piece, &Vec<f64>)> = pieces.iter().zip(states).chain(between.iter().map(|(p, s)| (p, s))).collect();
    let of = |(piece, state): &(&Piece, &Vec<f64>)| {
        let (residuals, by_state) = problem.linear(piece, state, parameters)?;
        let seen = Seen { readings: &piece.measured, sigma: problem.sigma, count };
        greatest_step(&residuals, &by_state, &seen, piece.stretch, first(piece))
    };
    let steps: Vec<Step> = all.par_iter().filter_map(of).collect();
    believed(&steps)
}

/// Steps of pieces that are like what noise leaves without them, each once; none where most pieces
/// have one.
pub fn believed(steps: &[Step]) -> Vec<Slip> {
    let mut left: Vec<f64> = steps.iter().map(|s| s.before).collect();
    left.sort_by(f64::total_cmp);
    let usual = left.get(left.len() / 2).map_or(1.0, |m| m.max(1.0));
    let believed = |s: &Step| s.slip.filter(|_| s.behind < LIKE * usual);
    let mut found: Vec<Slip> = steps.iter().filter_map(believed).collect();
    if found.len() as f64 > EVERYWHERE * steps.len() as f64 {
        return Vec::new();
    }
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut kept: Vec<Slip> = Vec::new();
    for f in found {
        let same = |k: &Slip| k.sensor == f.sensor && k.stretch == f.stretch && k.sample.abs_diff(f.sample) <= SAME;
        if !kept.iter().any(same) {
            kept.push(f);
        }
    }
    kept.sort_by_key(|k| (k.stretch, k.sample));
    kept
}

/// Pieces half of which are of one piece and half of the next, with their states.
fn overlapping<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    states: &[Vec<f64>],
    parameters: &[f64],
) -> Vec<(Piece, Vec<f64>)> {
    let sensors = problem.sensors.len().max(1);
    let one = |k: usize| {
        let (a, b) = (&pieces[k], &pieces[k + 1]);
        let half = a.measured.len() / sensors / 2;
        let spans_s = (a.measured.len() / sensors) as f64 * problem.spacing_s;
        let follows = a.stretch == b.stretch && (b.start_s - a.start_s - spans_s).abs() < 0.5 * problem.spacing_s;
        if !follows || half < 8 {
            return None;
        }
        let (piece, guess) = problem.joined(a, b, &states[k], parameters, half)?;
        let samples = piece.measured.len() / sensors;
        let mut room = problem.room(false);
        let (state, _) = problem.fit_state(&piece, &guess, parameters, &[samples / 2, samples], &mut room)?;
        Some((piece, state))
    };
    (0..pieces.len().saturating_sub(1)).into_par_iter().filter_map(one).collect()
}

/// What the sensors showed over a piece.
pub struct Seen<'a> {
    /// Readings, sensor after sensor for each sample.
    pub readings: &'a [f64],
    /// Noise of each sensor.
    pub sigma: &'a [f64],
    /// Size of a count of each.
    pub count: &'a [Option<f64>],
}

/// The greatest step of a piece, if any exceeds the limit, and the mean squares that the piece
/// leaves with and without it.
pub struct Step {
    slip: Option<Slip>,
    before: f64,
    behind: f64,
}

/// Looks for the greatest step of a piece that begins at the sample `first` of a stretch, in its
/// residuals and their derivatives by its state, both in units of the noise.
pub fn greatest_step(
    residuals: &DVector<f64>,
    by_state: &DMatrix<f64>,
    seen: &Seen<'_>,
    stretch: usize,
    first: usize,
) -> Option<Step> {
    let sensors = seen.sigma.len();
    let (residuals, basis) = beside(residuals, by_state, sensors)?;
    let samples = residuals.len() / sensors;
    let cost = residuals.norm_squared();
    let mut best: Option<Slip> = None;
    for (k, size) in seen.count.iter().enumerate() {
        let Some(count) = *size else { continue };
        let size = count / seen.sigma[k];
        let limit = LIMIT * dwell(seen.readings, k, sensors, count);
        let (mut sum, mut of_basis) = (0.0, DVector::zeros(basis.ncols()));
        for j in (1..samples).rev() {
            let row = j * sensors + k;
            sum -= residuals[row];
            of_basis += basis.row(row).transpose();
            let free = (samples - j) as f64 - of_basis.norm_squared();
            let counts = (sum / (free * size)).round();
            if !(free > 1.0 && counts != 0.0) {
                continue;
            }
            let step = counts * size;
            let gain = 2.0 * step * sum - step * step * free;
            if gain > limit && best.is_none_or(|b| gain > b.gain) {
                best = Some(Slip { sensor: k, stretch, sample: first + j, counts, gain });
            }
        }
    }
    let freedom = (residuals.len() - basis.ncols()).max(1) as f64;
    let behind = (cost - best.map_or(0.0, |b| b.gain)) / freedom;
    Some(Step { slip: best, before: cost / freedom, behind })
}

/// Samples for which a sensor stands on one count in a piece, in the mean: 1 where each shows
/// another, without end where it rests. What rounding leaves is of one sign for as long.
fn dwell(readings: &[f64], sensor: usize, sensors: usize, count: f64) -> f64 {
    let of = || readings.iter().skip(sensor).step_by(sensors);
    let changes = of().zip(of().skip(1)).filter(|(a, b)| (*a - *b).abs() > 0.5 * count).count();
    of().count() as f64 / changes as f64
}

/// Residuals without what the piece's state and a constant offset of each sensor take of them, and
/// an orthonormal basis of that: behind a slip every piece has an offset, which is no step.
fn beside(residuals: &DVector<f64>, by_state: &DMatrix<f64>, sensors: usize) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let states = by_state.ncols();
    let mut derivatives = by_state.clone().resize_horizontally(states + sensors, 0.0);
    for row in 0..residuals.len() {
        derivatives[(row, states + row % sensors)] = 1.0;
    }
    // Scaled, since positions and rates differ by orders of magnitude.
    for mut column in derivatives.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    let basis = derivatives.qr().q();
    let taken = &basis * (basis.transpose() * residuals);
    let left = residuals - taken;
    left.iter().all(|x| x.is_finite()).then_some((left, basis))
}

/// Where slips stand in the records.
pub fn placed(slips: &[Slip], bound: &ObservedModel, prepared: &Prepared) -> Vec<Placed> {
    let one = |s: &Slip| {
        let (record, channel) = (prepared.record_of[s.stretch], bound.sensors[s.sensor]);
        Placed { record, channel, time_s: prepared.stretches[s.stretch].time(s.sample), steps: s.counts }
    };
    slips.iter().map(one).collect()
}

/// Runs an identification, takes back the slips that it finds, and runs it again until it finds no
/// more; the records as they then are, with their slips in their warnings. Where the
/// equations miss something all the same, what looked like slips may be that: nothing is taken
/// back.
///
/// # Errors
/// Those of `run`.
pub fn without<'a>(
    records: &'a [Record],
    mut run: impl FnMut(&[Record]) -> Result<Identification>,
) -> Result<(Identification, Cow<'a, [Record]>)> {
    let plain = run(records)?;
    if plain.slips.is_empty() {
        return Ok((plain, Cow::Borrowed(records)));
    }
    let (mut mended, mut taken) = (records.to_vec(), 0);
    let mut slips = plain.slips.clone();
    for _ in 0..MOST_ROUNDS {
        take_back(&mut mended, &slips);
        taken += slips.len();
        // What cannot be identified any more had no slips.
        let Ok(found) = run(&mended) else { break };
        if found.slips.is_empty() {
            if !explains(&found) {
                break;
            }
            return Ok((found, Cow::Owned(mended)));
        }
        if found.slips.len() >= taken || leaves_more(&found, &plain) {
            // Taking them back leads nowhere.
            break;
        }
        slips.clone_from(&found.slips);
    }
    Ok((plain, Cow::Borrowed(records)))
}

/// Whether the equations leave more of a record than of the one before: it had no slips there.
fn leaves_more(found: &Identification, before: &Identification) -> bool {
    let of = |i: &Identification| i.details.residual_over_noise;
    of(found).zip(of(before)).is_some_and(|(now, before)| now > (1.0 + GROWS) * before)
}

/// Whether the equations leave nothing but the sensors' noise.
fn explains(found: &Identification) -> bool {
    let noise = |s: &shooting::Details| s.converged && s.noise_ratio.iter().all(|r| *r < shooting::MISSES);
    found.not_by_shooting.is_none()
        && found.shooting.as_ref().is_some_and(noise)
        && !found.warnings.iter().any(|w| w.invalidates)
}

/// Takes slips back, and tells them in their records' warnings.
fn take_back(records: &mut [Record], slips: &[Placed]) {
    for slip in slips {
        let record = &mut records[slip.record];
        let at = |(k, s): (usize, &crate::record::Segment)| {
            let sample = ((slip.time_s - s.start_s) / s.step_s).round();
            // Neither negative nor beyond the segment.
            (sample >= 0.0 && sample < s.len() as f64).then_some((k, sample as usize))
        };
        let Some((segment, sample)) = record.segments.iter().enumerate().find_map(at) else { continue };
        if !matches!(record.segments[segment].columns[slip.channel], Column::Counts(_)) {
            continue;
        }
        let size = slip.steps * record.channels[slip.channel].counts_a_step();
        let mut mending = Mending::default();
        mending.take_back(slip.channel, segment, sample, size);
        mending.apply(record);
        let row = record.numbering.as_ref().and_then(|n| n.at_time(slip.time_s));
        let step = slipped::Step { row, time_s: (slip.time_s * 1e6).round() / 1e6, size, near: true };
        // Half a spacing for times that were rounded.
        let same_s = (SAME as f64 + 0.5) / record.sample_rate_hz;
        slipped::tell(record, slip.channel, &[step], same_s);
    }
}

/// Records without the slips that their rig's equations show, told in their warnings; none where
/// there are none, or where nothing can be identified.
pub fn taken_back(records: &[Record], rig: &Rig) -> Option<Vec<Record>> {
    let samples: usize = records.iter().map(Record::samples).sum();
    let own = built_in::written(rig).ok()?;
    let counts = built_in::bound(&own).ok()?.sensors.iter().any(|c| rig.channel[*c].unit == "count");
    if !counts || samples > MOST_SAMPLES || records.iter().flat_map(|r| &r.warnings).any(|w| w.invalidates) {
        return None;
    }
    let (weak, choices) = (Settings::default(), shooting::Settings::default());
    let run = |records: &[Record]| best::once(records, rig, &weak, &choices, &ProgressBar::hidden());
    match without(records, run).ok()?.1 {
        Cow::Owned(mended) => Some(mended),
        Cow::Borrowed(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of twenty pieces so many with a step that leaves noise.
    fn steps(with: usize) -> Vec<Step> {
        let slip = |k: usize| Slip { sensor: 0, stretch: 0, sample: 100 * k, counts: 1.0, gain: 500.0 };
        (0..20).map(|k| Step { slip: (k < with).then(|| slip(k)), before: 1.5, behind: 1.0 }).collect()
    }

    #[test]
    fn steps_in_most_pieces_are_no_slips() {
        assert_eq!([0, 4, 10, 11, 20].map(|with| believed(&steps(with)).len()), [0, 4, 10, 0, 0]);
    }
}

//! All of phase space over one record, for `whirl inspect`: each measured coordinate's delay and
//! dimension, then, of all coordinates together, sections, exponents, correlation dimension and
//! periodic orbits.
//!
//! **Work on long records is capped** so that it does not grow beyond some seconds ([`Settings`]):
//! of a record of more than a million samples 32 evenly spread pieces are used; false neighbours
//! compare every s-th delay vector (10 000), the divergence 60 000, the tangent maps 100 000, the
//! correlation dimension 20 000. What was used is in the result.
//!
//! A coordinate that does not move is left out; a record that repeats or rests has no exponent,
//! dimension nor catalogue of orbits.

use std::f64::consts::TAU;

use serde::Serialize;

use super::average_mutual_information::{self as information, Information, Minimum};
use super::correlation_dimension::{CorrelationDimension, correlation_dimension};
use super::false_nearest_neighbours::{self as false_neighbours, FalseNeighbours};
use super::free_orbit::{self, FreeExtraction};
use super::observable::Observable;
use super::poincare_section::{Section, section};
pub use super::survey_exponent::Lyapunov;
use super::survey_exponent::{self, JointState};
pub use super::survey_settings::Settings;
use super::survey_warnings;
use super::unstable_periodic_orbit::{self as orbits, Extraction, Track, Trajectory};
use crate::inspect::coordinate::Coordinate;
use crate::inspect::motion::{Motion, Space};
use crate::record::Record;
use crate::statistics::Z95;
use crate::warning::Warning;

/// Longest orbit of a free record that is looked for, times round.
const LONGEST_FREE: usize = 8;

/// Delay and dimension of one coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoordinateSpace {
    /// The model's name of it.
    pub name: String,
    /// Average mutual information (2.18).
    pub mutual_information: Information,
    /// All its minima.
    pub minima: Vec<Minimum>,
    /// Lag of the first of all minima, samples.
    pub first_minimum: Option<usize>,
    /// T_d: the first minimum that is not weak, else the first, else the lag where I has lost 1 −
    /// 1/e of its fall, samples.
    pub delay: usize,
    /// Whether no minimum is clear.
    pub weak: bool,
    /// False nearest neighbours and Cao's measure at T_d.
    pub false_neighbours: FalseNeighbours,
    /// First dimension with few enough false neighbours.
    pub dimension: Option<usize>,
    /// Dimension by Cao's measure.
    pub cao_dimension: Option<usize>,
}

/// Phase space of a record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhaseSpace {
    /// Choices.
    pub settings: Settings,
    /// Samples used.
    pub samples: usize,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Theiler window, samples.
    pub theiler: u32,
    /// Measured coordinates that move.
    pub coordinates: Vec<CoordinateSpace>,
    /// T_d of the embedding of all coordinates together, samples.
    pub delay: usize,
    /// Its dimension: the largest of the coordinates'.
    pub dimension: Option<usize>,
    /// Poincaré sections at τ = 0, π/2, π, 3π/2 (driven).
    pub sections: Vec<Section>,
    /// Largest Lyapunov exponent.
    pub lyapunov: Option<Lyapunov>,
    /// Correlation dimension, the drive's phase among the coordinates.
    pub correlation_dimension: Option<CorrelationDimension>,
    /// Unstable periodic orbits (driven).
    pub orbits: Option<Extraction>,
    /// Unstable periodic orbits (free).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_orbits: Option<FreeExtraction>,
    /// Whether it is of a free motion that dies away, which has neither exponent nor attractor.
    #[serde(skip)]
    pub dies_away: bool,
}

impl PhaseSpace {
    /// Whether neighbouring states are shown to move apart: the exponent's 95 % interval lies above
    /// zero.
    pub fn spreads(&self) -> bool {
        self.lyapunov.as_ref().is_some_and(|l| l.per_second > Z95 * l.std_error)
    }
}

/// Share of a record's first third below which the motion in its last dies away (by hand).
const DIED: f64 = 0.8;

/// A piece of a record that is used: samples from … to − 1 of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    segment: usize,
    from: usize,
    to: usize,
}

/// Pieces of segments of these lengths: all of them, or 32 evenly spread ones of `most` samples
/// together.
fn pieces(lengths: &[usize], most: usize) -> Vec<Piece> {
    let all: usize = lengths.iter().sum();
    let whole = lengths.iter().enumerate().filter(|(_, n)| **n > 0);
    if all <= most {
        return whole.map(|(segment, n)| Piece { segment, from: 0, to: *n }).collect();
    }
    let (every, used) = (all / 32, most / 32);
    let mut out = Vec::new();
    for (segment, n) in whole {
        for from in (0..*n).step_by(every.max(1)) {
            out.push(Piece { segment, from, to: (from + used.min(every)).min(*n) });
        }
    }
    out
}

/// A measured coordinate that moves, in the pieces that are used.
struct MovingCoordinate<'a> {
    motion: &'a Motion,
    inspected: &'a Coordinate,
    pieces: Vec<Vec<f64>>,
}

impl<'a> MovingCoordinate<'a> {
    /// Those of a record.
    fn all(motions: &'a [Motion], coordinates: &'a [Coordinate], pieces: &[Piece]) -> Vec<Self> {
        let moves = |m: &Motion, c: &Coordinate| !m.derived && c.greatest - c.least > (6.0 * c.step).max(1e-9);
        let cut = |m: &Motion| -> Vec<Vec<f64>> {
            let samples = |p: &Piece| m.stretches.get(p.segment).map_or(Vec::new(), |x| x[p.from..p.to].to_vec());
            pieces.iter().map(samples).collect()
        };
        let both = motions.iter().zip(coordinates).filter(|(m, c)| moves(m, c));
        both.map(|(motion, inspected)| Self { motion, inspected, pieces: cut(motion) }).collect()
    }

    /// What delay vectors are made of.
    fn observable(&self, seed: u64) -> Observable {
        let parts: Vec<&[f64]> = self.pieces.iter().map(Vec::as_slice).collect();
        let of = if self.motion.space == Space::S1 { Observable::angle } else { Observable::number };
        of(&parts, self.motion.step, seed)
    }

    /// One of its pieces, with the range over which it moves.
    fn track(&self, piece: usize) -> Track<'_> {
        let angle = self.motion.space == Space::S1;
        let range = self.inspected.greatest - self.inspected.least;
        Track { values: &self.pieces[piece], angle, span: if angle { range.min(TAU) } else { range } }
    }
}

/// What the analyses of one record share.
struct Survey<'a> {
    moving: Vec<MovingCoordinate<'a>>,
    observables: Vec<Observable>,
    rate: f64,
    /// Drive's period, samples.
    period: Option<f64>,
    settings: &'a Settings,
}

impl Survey<'_> {
    /// Delay and dimension of each coordinate. The Theiler window of a free system grows with the
    /// delays found.
    fn coordinates(&self, theiler: &mut u32) -> Vec<CoordinateSpace> {
        let settings = self.settings;
        let lags = self.period.map_or((0.4 * self.rate) as usize, |t| t.round() as usize).clamp(100, 500);
        let mut spaces = Vec::new();
        for (o, c) in self.observables.iter().zip(&self.moving) {
            let bits = information::average_mutual_information(o, lags, settings.bins);
            let minima = information::minima(&bits.bits);
            let chosen = information::recommended(&minima, settings.weak);
            let delay = chosen.map_or_else(|| decay(&bits.bits), |c| c.lag).max(1);
            *theiler = if self.period.is_some() { *theiler } else { (*theiler).max(4 * delay as u32) };
            let weak = chosen.is_none_or(|c| c.depth < settings.weak);
            let choice = false_neighbours::Settings {
                dimensions: settings.dimensions,
                theiler: *theiler,
                noise: 3.0 * c.inspected.noise.max(c.inspected.quantisation_noise) / o.unit,
                most: settings.most_neighbours,
                ..Default::default()
            };
            let found = false_neighbours::false_nearest_neighbours(o, delay, &choice);
            spaces.push(CoordinateSpace {
                name: c.motion.name.clone(),
                first_minimum: minima.first().map(|m| m.lag),
                delay,
                weak,
                dimension: false_neighbours::dimension(&found.share, settings.false_share),
                cao_dimension: false_neighbours::cao_dimension(&found.e1, 0.1),
                false_neighbours: found,
                mutual_information: bits,
                minima,
            });
        }
        spaces
    }

    /// The pieces of all coordinates together, with the drive's phase.
    fn stretches(&self, record: &Record, pieces: &[Piece], drive_hz: Option<f64>) -> Vec<Trajectory<'_>> {
        let stretch = |(number, piece): (usize, &Piece)| {
            let segment = &record.segments[piece.segment];
            Trajectory {
                tracks: self.moving.iter().map(|c| c.track(number)).collect(),
                start_s: segment.time(piece.from),
                step_s: segment.step_s,
                phase: match (&segment.phase, drive_hz) {
                    (Some(turns), Some(_)) => f64::from(turns[piece.from]) / 4_294_967_296.0,
                    (None, Some(f)) => (segment.time(piece.from) * f).rem_euclid(1.0),
                    _ => 0.0,
                },
            }
        };
        pieces.iter().enumerate().map(stretch).collect()
    }

    /// Sections at τ = 0, π/2, π, 3π/2.
    fn sections(&self, stretches: &[Trajectory<'_>]) -> Vec<Section> {
        let widths: Vec<usize> = self.moving.iter().map(|c| c.inspected.slope_half_width).collect();
        match self.period {
            Some(t) if !self.moving.is_empty() => {
                [0.0, 0.25, 0.5, 0.75].map(|turns| section(stretches, turns, t, &widths, 1000)).to_vec()
            }
            _ => Vec::new(),
        }
    }

    /// Whether the record moves less from third to third, and in the last less than [`DIED`] of the
    /// first, by the path that all coordinates go in a sample: what is on no attractor.
    fn keeps_to_no_attractor(&self) -> bool {
        let path = |x: &[f64]| x.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>();
        let third = |k: usize| -> f64 {
            let of = |c: &MovingCoordinate<'_>| {
                let whole: f64 = c.pieces.iter().map(|p| path(p)).sum();
                let part: f64 = match &c.pieces[..] {
                    [one] => path(&one[k * one.len() / 3..(k + 1) * one.len() / 3]),
                    all => all[k * all.len() / 3..(k + 1) * all.len() / 3].iter().map(|p| path(p)).sum(),
                };
                if whole > 0.0 { part / whole } else { 0.0 }
            };
            self.moving.iter().map(of).sum()
        };
        let [first, second, last] = [0, 1, 2].map(third);
        first > second && second > last && last < DIED * first
    }

    /// Exponent and correlation dimension, of all coordinates together.
    fn exponent_and_dimension(&self, stretches: &[Trajectory<'_>], out: &mut PhaseSpace) {
        let phase = self.period.map(|t| phase_of(stretches, t));
        let state = JointState { coordinates: self.observables.iter().collect(), phase: phase.as_ref() };
        // What dies away keeps to no attractor: neighbours part for good, or not at all.
        out.dies_away = self.period.is_none() && self.keeps_to_no_attractor();
        if !out.dies_away {
            out.lyapunov = survey_exponent::lyapunov(&state, self.period, out, self.rate);
        }
        let delays = state.delays(out.dimension);
        let e = state.embedding(delays, out.delay, 0, self.settings.most_vectors);
        let noise = self.moving.iter().zip(&self.observables).map(|(c, o)| c.inspected.noise / o.unit);
        let noise = 3.0 * noise.fold(0.0, f64::max);
        if !out.dies_away {
            out.correlation_dimension = Some(correlation_dimension(&e, out.theiler, 1000, noise));
        }
    }

    /// The catalogue of orbits, of a driven or a free record.
    fn orbits(&self, stretches: &[Trajectory<'_>], out: &mut PhaseSpace, warnings: &mut Vec<Warning>) {
        let Settings { tolerance, longest, .. } = *self.settings;
        let Some(period) = self.period else {
            // Once round takes about four delays.
            let longest = (4 * out.delay).saturating_mul(longest.min(LONGEST_FREE));
            let choice = free_orbit::Settings { tolerance, longest, merge: 2.0, delay: out.delay, most: 2000 };
            out.free_orbits = Some(free_orbit::extract(stretches, &choice));
            return;
        };
        let choice = orbits::Settings { tolerance, longest, merge: 2.0, delay: out.delay, period, most: 2000 };
        let found = orbits::extract(stretches, &choice);
        if found.orbits.len() < 6 {
            let seconds = out.samples as f64 / self.rate;
            warnings.push(survey_warnings::few_orbits(found.orbits.len(), seconds, self.settings));
        }
        out.orbits = Some(found);
    }
}

/// The sections of a record alone: see [`survey`].
pub fn sections(
    record: &Record,
    motions: &[Motion],
    coordinates: &[Coordinate],
    drive_hz: Option<f64>,
    settings: &Settings,
) -> Vec<Section> {
    let lengths: Vec<usize> = record.segments.iter().map(|s| s.len()).collect();
    let pieces = pieces(&lengths, settings.most_samples.max(1));
    let moving = MovingCoordinate::all(motions, coordinates, &pieces);
    let rate = record.sample_rate_hz;
    let survey = Survey { moving, observables: Vec::new(), rate, period: drive_hz.map(|f| rate / f), settings };
    survey.sections(&survey.stretches(record, &pieces, drive_hz))
}

/// Surveys a record. `motions` and `coordinates` are those of its inspection; `repeats`: the record
/// repeats or rests.
pub fn survey(
    record: &Record,
    motions: &[Motion],
    coordinates: &[Coordinate],
    drive_hz: Option<f64>,
    repeats: bool,
    settings: &Settings,
) -> (PhaseSpace, Vec<Warning>) {
    let rate = record.sample_rate_hz;
    let period = drive_hz.map(|f| rate / f);
    let lengths: Vec<usize> = record.segments.iter().map(|s| s.len()).collect();
    let pieces = pieces(&lengths, settings.most_samples.max(1));
    let moving = MovingCoordinate::all(motions, coordinates, &pieces);
    let observables = moving.iter().enumerate().map(|(i, c)| c.observable(settings.seed.wrapping_add(i as u64)));
    let survey = Survey { observables: observables.collect(), moving, rate, period, settings };
    let mut theiler = period.map_or(0, |t| t.round() as u32);
    let mut warnings = Vec::new();
    let spaces = survey.coordinates(&mut theiler);
    // The coordinate whose information falls most has most to tell about the delay.
    let fall = |s: &CoordinateSpace| {
        let b = &s.mutual_information.bits;
        b.first().copied().unwrap_or(0.0) - b.iter().copied().fold(f64::INFINITY, f64::min)
    };
    let delay = spaces.iter().max_by(|a, b| fall(a).total_cmp(&fall(b))).map_or(1, |s| s.delay);
    let stretches = survey.stretches(record, &pieces, drive_hz);
    let mut out = PhaseSpace {
        settings: settings.clone(),
        samples: pieces.iter().map(|p| p.to - p.from).sum(),
        sample_rate_hz: rate,
        theiler,
        delay,
        dimension: spaces.iter().filter_map(|s| s.dimension).max(),
        coordinates: spaces,
        sections: survey.sections(&stretches),
        lyapunov: None,
        correlation_dimension: None,
        orbits: None,
        free_orbits: None,
        dies_away: false,
    };
    if !(repeats || survey.moving.is_empty()) {
        survey.exponent_and_dimension(&stretches, &mut out);
        survey.orbits(&stretches, &mut out, &mut warnings);
    }
    (out, warnings)
}

/// Lag at which I has lost all but 1/e of its fall.
fn decay(bits: &[f64]) -> usize {
    let (first, least) = (bits.first().copied().unwrap_or(0.0), bits.iter().copied().fold(f64::INFINITY, f64::min));
    bits.iter().position(|b| *b - least <= (first - least) / std::f64::consts::E).map_or(1, |i| i + 1)
}

/// The drive's phase as an angle.
fn phase_of(stretches: &[Trajectory<'_>], period: f64) -> Observable {
    let turns: Vec<Vec<f64>> = stretches
        .iter()
        .map(|s| {
            let n = s.tracks.first().map_or(0, |t| t.values.len());
            (0..n).map(|i| TAU * (s.phase + i as f64 / period).rem_euclid(1.0)).collect()
        })
        .collect();
    Observable::angle(&turns.iter().map(Vec::as_slice).collect::<Vec<_>>(), 0.0, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_records_are_cut_into_spread_pieces() {
        let whole = |segment, to| Piece { segment, from: 0, to };
        assert_eq!(pieces(&[10, 0, 20], 100), [whole(0, 10), whole(2, 20)]);
        let cut = pieces(&[43_000_000], 1_000_000);
        assert!((32..=33).contains(&cut.len()) && cut.iter().all(|p| p.to - p.from <= 31_250 && p.to <= 43_000_000));
        assert!(cut.last().is_some_and(|p| p.from > 41_000_000));
        assert!(pieces(&[], 5).is_empty());
    }

    #[test]
    fn without_a_minimum_the_delay_is_a_decay() {
        assert_eq!(decay(&[4.0, 3.0, 2.0, 1.2, 0.8, 0.5, 0.2, 0.0]), 4);
        assert_eq!(decay(&[]), 1);
    }
}

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
use super::embedding::{Component, Embedding};
use super::false_nearest_neighbours::{self as false_neighbours, FalseNeighbours};
use super::free_orbit::{self, FreeExtraction};
use super::lyapunov_exponent::{self as divergence, Divergence, Fit};
use super::observable::Observable;
use super::poincare_section::{Section, section};
pub use super::survey_settings::Settings;
use super::survey_warnings;
use super::tangent_exponent::{self as tangent, Tangent};
use super::unstable_periodic_orbit::{self as orbits, Extraction, Stretch, Track};
use crate::inspect::coordinate::Coordinate;
use crate::inspect::motion::{Motion, Space};
use crate::record::Record;
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

/// Largest Lyapunov exponent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Lyapunov {
    /// By local linear maps, 1/s.
    pub per_second: f64,
    /// Standard error, 1/s.
    pub std_error: f64,
    /// 95 % interval, 1/s.
    pub interval: [f64; 2],
    /// The exponent a drive period.
    pub per_period: Option<f64>,
    /// Its standard error.
    pub per_period_std_error: Option<f64>,
    /// The local linear maps' numbers, per sample.
    pub tangent: Tangent,
    /// Step δ of the maps, s.
    pub step_s: f64,
    /// By divergence of neighbours, 1/s; none where the curve has no straight part.
    pub divergence_per_second: Option<f64>,
    /// Its standard error, 1/s.
    pub divergence_std_error: Option<f64>,
    /// Its fit window, s.
    pub fit_window_s: Option<[f64; 2]>,
    /// The straight part, per sample.
    pub fit: Option<Fit>,
    /// The curve S(k), one value a sample.
    pub divergence: Divergence,
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
}

impl PhaseSpace {
    /// Whether neighbouring states are shown to move apart: the exponent's 95 % interval lies above
    /// zero.
    pub fn spreads(&self) -> bool {
        self.lyapunov.as_ref().is_some_and(|l| l.per_second > 1.96 * l.std_error)
    }
}

/// Pieces of the segments that are used: segment, first and last sample.
fn pieces(lengths: &[usize], most: usize) -> Vec<(usize, usize, usize)> {
    let all: usize = lengths.iter().sum();
    let whole = lengths.iter().enumerate().filter(|(_, n)| **n > 0);
    if all <= most {
        return whole.map(|(s, n)| (s, 0, *n)).collect();
    }
    let (every, used) = (all / 32, most / 32);
    let mut out = Vec::new();
    for (s, n) in whole {
        for from in (0..*n).step_by(every.max(1)) {
            out.push((s, from, (from + used.min(every)).min(*n)));
        }
    }
    out
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
    let moving: Vec<(&Motion, &Coordinate)> = motions
        .iter()
        .zip(coordinates)
        .filter(|(m, c)| !m.derived && c.greatest - c.least > (6.0 * c.step).max(1e-9))
        .collect();
    let cut = |m: &'_ Motion| -> Vec<Vec<f64>> {
        pieces.iter().map(|(s, a, b)| m.stretches.get(*s).map_or(Vec::new(), |x| x[*a..*b].to_vec())).collect()
    };
    let series: Vec<Vec<Vec<f64>>> = moving.iter().map(|(m, _)| cut(m)).collect();
    let observables: Vec<Observable> = series
        .iter()
        .zip(&moving)
        .enumerate()
        .map(|(i, (x, (m, _)))| {
            let parts: Vec<&[f64]> = x.iter().map(Vec::as_slice).collect();
            let seed = settings.seed.wrapping_add(i as u64);
            if m.space == Space::S1 {
                Observable::angle(&parts, m.step, seed)
            } else {
                Observable::number(&parts, m.step, seed)
            }
        })
        .collect();
    let lags = period.map_or((0.4 * rate) as usize, |t| t.round() as usize).clamp(100, 500);
    let mut theiler = period.map_or(0, |t| t.round() as u32);
    let mut spaces = Vec::new();
    let mut warnings = Vec::new();
    for (o, (m, c)) in observables.iter().zip(&moving) {
        let bits = information::average_mutual_information(o, lags, settings.bins);
        let minima = information::minima(&bits.bits);
        let chosen = information::recommended(&minima, settings.weak);
        let delay = chosen.map_or_else(|| decay(&bits.bits), |c| c.lag).max(1);
        theiler = if period.is_some() { theiler } else { theiler.max(4 * delay as u32) };
        let weak = chosen.is_none_or(|c| c.depth < settings.weak);
        if weak || minima.first().is_some_and(|f| f.lag != delay) {
            warnings.push(survey_warnings::weak_minima(&m.name, &minima, delay, weak, rate));
        }
        let choice = false_neighbours::Settings {
            dimensions: settings.dimensions,
            theiler,
            noise: 3.0 * c.noise.max(c.quantisation_noise) / o.unit,
            most: settings.most_neighbours,
            ..Default::default()
        };
        let found = false_neighbours::false_nearest_neighbours(o, delay, &choice);
        spaces.push(CoordinateSpace {
            name: m.name.clone(),
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
    // The coordinate whose information falls most has most to tell about the delay.
    let fall = |s: &CoordinateSpace| {
        let b = &s.mutual_information.bits;
        b.first().copied().unwrap_or(0.0) - b.iter().copied().fold(f64::INFINITY, f64::min)
    };
    let delay = spaces.iter().max_by(|a, b| fall(a).total_cmp(&fall(b))).map_or(1, |s| s.delay);
    let stretches: Vec<Stretch<'_>> = pieces
        .iter()
        .enumerate()
        .map(|(p, (s, from, _))| {
            let segment = &record.segments[*s];
            Stretch {
                tracks: series
                    .iter()
                    .zip(&moving)
                    .map(|(x, (m, c))| Track {
                        values: &x[p],
                        angle: m.space == Space::S1,
                        span: if m.space == Space::S1 { (c.greatest - c.least).min(TAU) } else { c.greatest - c.least },
                    })
                    .collect(),
                start_s: segment.time(*from),
                step_s: segment.step_s,
                phase: match (&segment.phase, drive_hz) {
                    (Some(turns), Some(_)) => f64::from(turns[*from]) / 4_294_967_296.0,
                    (None, Some(f)) => (segment.time(*from) * f).rem_euclid(1.0),
                    _ => 0.0,
                },
            }
        })
        .collect();
    let widths: Vec<usize> = moving.iter().map(|(_, c)| c.slope_half_width).collect();
    let sections = match period {
        Some(t) if !moving.is_empty() => {
            [0.0, 0.25, 0.5, 0.75].map(|turns| section(&stretches, turns, t, &widths, 1000)).to_vec()
        }
        _ => Vec::new(),
    };
    let mut out = PhaseSpace {
        settings: settings.clone(),
        samples: pieces.iter().map(|p| p.2 - p.1).sum(),
        sample_rate_hz: rate,
        theiler,
        delay,
        dimension: spaces.iter().filter_map(|s| s.dimension).max(),
        coordinates: spaces,
        sections,
        lyapunov: None,
        correlation_dimension: None,
        orbits: None,
        free_orbits: None,
    };
    if repeats || moving.is_empty() {
        return (out, warnings);
    }
    let phase = period.map(|t| phase_of(&stretches, t));
    let shared: Vec<&Observable> = observables.iter().collect();
    out.lyapunov = lyapunov(&shared, phase.as_ref(), period, &out, rate);
    let state = (delays(shared.len(), phase.is_some(), out.dimension), delay);
    let e = joint(&shared, phase.as_ref(), state, 0, settings.most_vectors);
    let noise = 3.0 * moving.iter().zip(&shared).map(|((_, c), o)| c.noise / o.unit).fold(0.0, f64::max);
    out.correlation_dimension = Some(correlation_dimension(&e, theiler, 1000, noise));
    if let Some(t) = period {
        let choice = orbits::Settings {
            tolerance: settings.tolerance,
            longest: settings.longest,
            merge: 2.0,
            delay,
            period: t,
            most: 2000,
        };
        let found = orbits::extract(&stretches, &choice);
        let seconds = out.samples as f64 / rate;
        if found.orbits.len() < 6 {
            warnings.push(Warning::new(
                "few-orbits",
                format!(
                    "{} orbits of period ≤ {} in {seconds:.0} s at a tolerance of {} %",
                    found.orbits.len(),
                    settings.longest,
                    100.0 * settings.tolerance
                ),
                format!(
                    "Raise the tolerance to {} %, or record {:.0} min",
                    160.0 * settings.tolerance,
                    (seconds / 15.0).ceil().max(10.0)
                ),
            ));
        }
        out.orbits = Some(found);
    } else {
        // Once round takes about four delays.
        let longest = (4 * delay).saturating_mul(settings.longest.min(LONGEST_FREE));
        let choice = free_orbit::Settings { tolerance: settings.tolerance, longest, merge: 2.0, delay, most: 2000 };
        out.free_orbits = Some(free_orbit::extract(&stretches, &choice));
    }
    (out, warnings)
}

/// Lag at which I has lost all but 1/e of its fall.
fn decay(bits: &[f64]) -> usize {
    let (first, least) = (bits.first().copied().unwrap_or(0.0), bits.iter().copied().fold(f64::INFINITY, f64::min));
    bits.iter().position(|b| *b - least <= (first - least) / std::f64::consts::E).map_or(1, |i| i + 1)
}

/// The drive's phase as an angle.
fn phase_of(stretches: &[Stretch<'_>], period: f64) -> Observable {
    let turns: Vec<Vec<f64>> = stretches
        .iter()
        .map(|s| {
            let n = s.tracks.first().map_or(0, |t| t.values.len());
            (0..n).map(|i| TAU * (s.phase + i as f64 / period).rem_euclid(1.0)).collect()
        })
        .collect();
    Observable::angle(&turns.iter().map(Vec::as_slice).collect::<Vec<_>>(), 0.0, 0)
}

/// Delays of each coordinate in a state of all together: two, three of a single one without a
/// drive, and one where a free system's coordinates are as many as its dimension: more would add
/// directions in which no neighbour lies, whose gradients are the flow's curvature.
fn delays(coordinates: usize, driven: bool, dimension: Option<usize>) -> usize {
    match coordinates {
        _ if driven => 2,
        1 => 3,
        n if dimension.is_some_and(|d| d <= n) => 1,
        _ => 2,
    }
}

/// So many delays of each coordinate, and the drive's phase last.
fn joint<'a>(
    o: &[&'a Observable],
    phase: Option<&'a Observable>,
    (delays, delay): (usize, usize),
    ahead: usize,
    most: usize,
) -> Embedding<'a> {
    let mut components: Vec<Component<'a>> =
        (0..delays).flat_map(|j| o.iter().map(move |of| Component { of, delay: j * delay })).collect();
    components.extend(phase.map(|of| Component { of, delay: 0 }));
    Embedding::new(components, ahead, most)
}

fn lyapunov(
    o: &[&Observable],
    phase: Option<&Observable>,
    period: Option<f64>,
    space: &PhaseSpace,
    rate: f64,
) -> Option<Lyapunov> {
    let delays = delays(o.len(), phase.is_some(), space.dimension);
    // An eighth of a drive period: long beside the noise of a count, short beside the curvature of
    // the flow.
    let step = period.map_or((space.delay as f64 / 2.0).round(), |t| (t / 8.0).round()).max(1.0) as usize;
    let unknowns = delays * o.len() + usize::from(phase.is_some()) + 1;
    let tangent = tangent::tangent_exponent(
        o,
        phase,
        &tangent::Settings {
            step,
            delays,
            neighbours: 8 * unknowns,
            theiler: space.theiler,
            keep: space.dimension.filter(|_| phase.is_none()),
            steps: 6000,
            vectors: 100_000,
        },
    )?;
    let steps = period.map_or(20.0 * space.delay as f64, |t| 10.0 * t).round() as usize;
    let choice = divergence::Settings {
        theiler: space.theiler,
        steps: steps.clamp(10, 2000),
        followed: delays * o.len(),
        unit: period.unwrap_or(1.0),
        settle: period.map_or(space.delay, |t| (0.5 * t).round() as usize),
        ceiling: 0.7,
    };
    let e = joint(o, phase, (delays, space.delay), choice.steps, space.settings.most_pairs);
    let followed = divergence::divergence(&e, &choice);
    let fit = divergence::fit(&followed, &choice);
    let (value, error) = (tangent.exponent * rate, tangent.std_error * rate);
    Some(Lyapunov {
        per_second: value,
        std_error: error,
        interval: [value - 1.96 * error, value + 1.96 * error],
        per_period: period.map(|t| tangent.exponent * t),
        per_period_std_error: period.map(|t| tangent.std_error * t),
        tangent,
        step_s: step as f64 / rate,
        divergence_per_second: fit.map(|f| f.slope * rate),
        divergence_std_error: fit.map(|f| f.std_error * rate),
        fit_window_s: fit.map(|f| [f.from as f64 / rate, f.to as f64 / rate]),
        fit,
        divergence: followed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_records_are_cut_into_spread_pieces() {
        assert_eq!(pieces(&[10, 0, 20], 100), [(0, 0, 10), (2, 0, 20)]);
        let cut = pieces(&[43_000_000], 1_000_000);
        assert!((32..=33).contains(&cut.len()) && cut.iter().all(|p| p.2 - p.1 <= 31_250 && p.2 <= 43_000_000));
        assert!(cut.last().is_some_and(|p| p.1 > 41_000_000));
        assert!(pieces(&[], 5).is_empty());
    }

    #[test]
    fn without_a_minimum_the_delay_is_a_decay() {
        assert_eq!(decay(&[4.0, 3.0, 2.0, 1.2, 0.8, 0.5, 0.2, 0.0]), 4);
        assert_eq!(decay(&[]), 1);
    }
}

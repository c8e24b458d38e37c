//! Orbits and pieces from a record.

use std::f64::consts::TAU;

use nalgebra::DMatrix;

use super::orbit::Orbit;
use super::settings::Orbits;
use crate::identify::stretches::{Stretch, mixed};
use crate::phase_space::average_mutual_information::{average_mutual_information, minima, recommended};
use crate::phase_space::observable::Observable;
use crate::phase_space::unstable_periodic_orbit::{self as unstable, Track};

/// Depth below which a minimum of the mutual information is weak, share of its fall.
const WEAK: f64 = 0.05;

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Orbits or pieces.
    pub orbits: Vec<Orbit>,
    /// Delay T_d used, samples (orbits that close).
    pub delay: Option<usize>,
    /// Closing stretches before near-identical ones were merged.
    pub recurrences: usize,
}

/// T_d of the angle whose information falls most: its first minimum that is not weak, else its
/// first minimum, else a quarter of the drive period.
fn delay(series: &[Vec<Vec<f64>>], circle: &[bool], period: f64) -> usize {
    let lags = (period.round() as usize).clamp(20, 500);
    let best = (0..circle.len())
        .map(|c| {
            let parts: Vec<&[f64]> = series.iter().map(|s| s[c].as_slice()).collect();
            let of = if circle[c] { Observable::angle(&parts, 0.0, 1) } else { Observable::number(&parts, 0.0, 1) };
            let bits = average_mutual_information(&of, lags, 64).bits;
            let fall = bits.first().copied().unwrap_or(0.0) - bits.iter().copied().fold(f64::INFINITY, f64::min);
            (fall, recommended(&minima(&bits), WEAK).map(|m| m.lag))
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    best.and_then(|b| b.1).unwrap_or((0.25 * period).round() as usize).max(1)
}

/// Finds them. Orbits close in what the sensors show of the coordinates, y = S q; `circle`: which
/// coordinates are angles; `period` is the drive's, samples.
pub fn find(stretches: &[Stretch], shown: &DMatrix<f64>, circle: &[bool], period: f64, what: &Orbits) -> Found {
    match *what {
        Orbits::Pieces { periods } => {
            let length = periods as f64 * period;
            let mut orbits = Vec::new();
            for stretch in stretches {
                // Three samples before the first and after the last are needed for differences.
                for p in 0.. {
                    match Orbit::cut(stretch, 4 + (p as f64 * length).round() as usize, periods, period, 0.0) {
                        Some(orbit) => orbits.push(orbit),
                        None => break,
                    }
                }
            }
            Found { orbits, ..Found::default() }
        }
        Orbits::Unstable { tolerance, longest, delay: chosen } => {
            let series: Vec<Vec<Vec<f64>>> = stretches.iter().map(|s| mixed(shown, &s.coordinates)).collect();
            let is_angle = |r: usize| (0..circle.len()).all(|c| shown[(r, c)] == 0.0 || circle[c]);
            let circle: Vec<bool> = (0..shown.nrows()).map(is_angle).collect();
            let delay = chosen.unwrap_or_else(|| delay(&series, &circle, period));
            let span = |c: usize| {
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                series.iter().flat_map(|s| &s[c]).for_each(|x| (low, high) = (low.min(*x), high.max(*x)));
                (high - low).clamp(f64::MIN_POSITIVE, if circle[c] { TAU } else { f64::INFINITY })
            };
            let spans: Vec<f64> = (0..circle.len()).map(span).collect();
            let tracks: Vec<unstable::Trajectory<'_>> = stretches
                .iter()
                .zip(&series)
                .map(|(stretch, s)| unstable::Trajectory {
                    tracks: s
                        .iter()
                        .zip(&spans)
                        .zip(&circle)
                        .map(|((x, span), circle)| Track { values: x, angle: *circle, span: *span })
                        .collect(),
                    start_s: stretch.start_s,
                    step_s: stretch.step_s,
                    phase: if stretch.is_empty() { 0.0 } else { (stretch.tau(0) / TAU).rem_euclid(1.0) },
                })
                .collect();
            let extraction = unstable::extract(
                &tracks,
                &unstable::Settings { tolerance, longest, merge: 2.0, delay, period, most: 2000 },
            );
            let orbits = extraction
                .orbits
                .iter()
                .filter_map(|o| Orbit::cut(&stretches[o.place.0], o.place.1, o.period, period, o.error))
                .collect();
            Found { orbits, delay: Some(delay), recurrences: extraction.recurrences }
        }
    }
}

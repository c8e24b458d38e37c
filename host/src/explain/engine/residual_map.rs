//! Residuals against coordinates: means in bins with the band that the sensors' noise alone gives,
//! and the clearest places.
//!
//! The mean of a residual in each of 24 bins of a coordinate is compared with the band (95 %) that
//! noise alone gives: the smoothed record is measured again by the same sensors with their grids
//! shifted, and what this does to the mean of a bin is a draw of its noise.

use core::f64::consts::{PI, TAU};

use serde::Serialize;

use super::axes::Axis;
use crate::statistics::Z95;
use crate::wording::format::significant;

/// Bins of a map.
const BINS: usize = 24;
/// A bin counts as disagreeing from this many bands on.
pub const CLEARLY: f64 = 1.6;
/// Most places that are told of a record's maps.
const MOST_PLACES: usize = 12;
/// Fewest samples of a bin that is shown.
const LEAST_SAMPLES: f64 = 100.0;

/// A stretch of a coordinate in which an equation's residual exceeds what noise gives.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Where {
    /// Equation, from 1.
    pub equation: usize,
    /// Coordinate.
    pub against: String,
    /// From.
    pub from: f64,
    /// To.
    pub to: f64,
    /// Mean residual there, in the unit of its map; against frequency an amplitude.
    pub value: f64,
    /// Band (95 %) of the sensors' noise alone.
    pub band: f64,
    /// Unit of the coordinate, and of the residual.
    #[serde(skip)]
    pub units: (String, String),
}

impl Where {
    /// The stretch in words: `frequency 0 … 5.16 Hz`.
    pub fn stretch(&self) -> String {
        let to = with_unit(significant(self.to, 3), &self.units.0);
        format!("{} {} … {to}", self.against, significant(self.from, 3))
    }

    /// A number of its residual with its unit.
    pub fn residual(&self, x: f64) -> String {
        with_unit(significant(x, 2), &self.units.1)
    }
}

fn with_unit(number: String, unit: &str) -> String {
    if matches!(unit, "" | "1") { number } else { format!("{number} {unit}") }
}

/// The residual of an equation against a coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Map {
    /// Equation, from 1.
    pub equation: usize,
    /// Coordinate.
    pub against: String,
    /// Unit of the coordinate.
    pub against_unit: String,
    /// Unit of the residual.
    pub unit: String,
    /// Centre, mean residual, band of each bin that holds samples.
    pub bins: Vec<[f64; 3]>,
}

impl Map {
    /// Whether `other` shows the same equation against the same coordinate.
    pub fn of(&self, other: &Self) -> bool {
        self.equation == other.equation && self.against == other.against
    }
}

/// The residual of an equation over a record, and what the sensors' noise adds to it over the
/// smoothed one, repeat by repeat.
pub struct Residual<'a> {
    /// Equation, from 1.
    pub equation: usize,
    /// Unit.
    pub unit: &'a str,
    /// Over the record.
    pub values: &'a [f64],
    /// Over the smoothed record.
    pub noise: &'a [Vec<f64>],
}

impl Residual<'_> {
    /// Its means in bins of every coordinate, over the record and over the smoothed one, and the
    /// bins in which they clearly exceed noise.
    pub fn against(
        &self,
        axes: &[Axis],
        along: &[Vec<f64>],
        clean: &[Vec<f64>],
        maps: &mut Vec<Map>,
        places: &mut Vec<Where>,
    ) {
        for ((axis, at), clean) in axes.iter().zip(along).zip(clean) {
            let (low, high) = if axis.turn {
                (-PI, PI)
            } else {
                at.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)))
            };
            if high <= low || !(high - low).is_finite() {
                continue;
            }
            let bin = |x: f64| (((x - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
            let mut sums = [(0.0, 0.0); BINS];
            for (x, r) in at.iter().zip(self.values) {
                let s = &mut sums[bin(*x)];
                (s.0, s.1) = (s.0 + r, s.1 + 1.0);
            }
            let draws = self.draws(clean, (low, high), &bin);
            let overall = draws.iter().fold((0.0, 0.0), |t, d| (t.0 + d.0, t.1 + d.1));
            // Without a draw nothing is known of the noise.
            if overall.1 == 0.0 {
                continue;
            }
            let mut bins = Vec::new();
            for b in 0..BINS {
                let (sum, n) = sums[b];
                // A bin with few samples says little.
                if n < LEAST_SAMPLES {
                    continue;
                }
                // Four draws a bin are few: its neighbours' count with it.
                let near = draws[b.saturating_sub(1)..=(b + 1).min(BINS - 1)]
                    .iter()
                    .fold((0.0, 0.0), |t, d| (t.0 + d.0, t.1 + d.1));
                let (power, count) = if near.1 >= 8.0 { near } else { overall };
                let band = Z95 * (power / f64::max(count, 1.0) / n).sqrt();
                let width = (high - low) / BINS as f64;
                let from = low + b as f64 * width;
                bins.push([from + 0.5 * width, sum / n, band]);
                if (sum / n).abs() > CLEARLY * band {
                    places.push(Where {
                        equation: self.equation,
                        against: axis.name.clone(),
                        from,
                        to: from + width,
                        value: sum / n,
                        band,
                        units: (axis.unit.clone(), self.unit.to_owned()),
                    });
                }
            }
            maps.push(Map {
                equation: self.equation,
                against: axis.name.clone(),
                against_unit: axis.unit.clone(),
                unit: self.unit.to_owned(),
                bins,
            });
        }
    }

    /// For each bin the sum of n · mean² over repeats and their number: each repeat is one draw of
    /// what noise does to that mean, and the variance of a mean falls with the number of samples,
    /// n · mean² does not.
    fn draws(&self, clean: &[f64], (low, high): (f64, f64), bin: &dyn Fn(f64) -> usize) -> [(f64, f64); BINS] {
        let mut draws = [(0.0, 0.0); BINS];
        for repeat in self.noise {
            let mut means = [(0.0, 0.0); BINS];
            for (x, r) in clean.iter().zip(repeat).filter(|(x, _)| **x >= low && **x <= high) {
                let m = &mut means[bin(*x)];
                (m.0, m.1) = (m.0 + r, m.1 + 1.0);
            }
            for (draw, (sum, n)) in draws.iter_mut().zip(means).filter(|(_, (_, n))| *n >= 50.0) {
                (draw.0, draw.1) = (draw.0 + sum * sum / n, draw.1 + 1.0);
            }
        }
        draws
    }
}

/// Neighbouring bins of one sign become one place; the twelve clearest are kept, largest first.
pub fn merge(places: Vec<Where>) -> Vec<Where> {
    let mut out: Vec<Where> = Vec::new();
    for p in places {
        match out.last_mut() {
            Some(last)
                if last.equation == p.equation
                    && last.against == p.against
                    && (last.to - p.from).abs() < 1e-9 * TAU.max(p.from.abs())
                    && last.value.signum() == p.value.signum() =>
            {
                last.to = p.to;
                if p.value.abs() / p.band > last.value.abs() / last.band {
                    (last.value, last.band) = (p.value, p.band);
                }
            }
            _ => out.push(p),
        }
    }
    largest_first(&mut out);
    out.truncate(MOST_PLACES);
    out
}

/// Places in bins, merged, and others beside them, largest first.
pub fn together(bins: Vec<Where>, others: Vec<Where>) -> Vec<Where> {
    let mut out = merge(bins);
    out.extend(others);
    largest_first(&mut out);
    out
}

/// Sorts places by how far they exceed what noise gives, whatever they are against.
fn largest_first(places: &mut [Where]) {
    places.sort_by(|a, b| (b.value.abs() / b.band).total_cmp(&(a.value.abs() / a.band)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_stands_before_bins_that_it_exceeds() {
        let place = |against: &str, from: f64, value: f64| Where {
            equation: 1,
            against: against.to_owned(),
            from,
            to: from + 1.0,
            value,
            band: 1.0,
            units: ("m".to_owned(), "N".to_owned()),
        };
        assert_eq!(place("position of x", 0.5, 2.0).stretch(), "position of x 0.500 … 1.50 m");
        assert_eq!(place("x", 0.0, -2.0).residual(-2.0), "−2.0 N");
        // Two neighbours of one sign are one place.
        let bins = vec![place("x", 0.0, 2.0), place("x", 1.0, 3.0), place("x", 2.0, -4.0)];
        let lines = merge(vec![place("frequency", 5.0, 9.0), place("frequency", 20.0, 3.5)]);
        let told: Vec<f64> = together(bins, lines).iter().map(|w| w.value).collect();
        assert_eq!(told, [9.0, -4.0, 3.5, 3.0]);
    }
}

//! A motion at even times, along which states of effects that remember are followed.

use std::sync::OnceLock;

use super::equations_of_motion::wrapped;
use super::expression::Symbol;

/// Steps to a sample.
pub(super) const STEPS: usize = 2;

/// A motion at even times. Between two samples the coordinates are cubics with the rates at both
/// ends.
#[derive(Debug)]
pub struct Course {
    coordinates: Vec<Vec<f64>>,
    rates: Vec<Vec<f64>>,
    step_s: f64,
    circle: Vec<bool>,
    /// Coordinates and rates at every sample, and over every step from one to the next.
    samples: OnceLock<[Vec<Vec<f64>>; 2]>,
    steps: OnceLock<[Vec<Vec<f64>>; 2]>,
}

impl Course {
    /// Of coordinates, unwrapped, and their rates a second, `step_s` seconds apart; `circle` tells
    /// which coordinates lie on a circle.
    pub fn new(coordinates: Vec<Vec<f64>>, rates: Vec<Vec<f64>>, step_s: f64, circle: Vec<bool>) -> Self {
        Self { coordinates, rates, step_s, circle, samples: OnceLock::new(), steps: OnceLock::new() }
    }

    /// Coordinates, unwrapped.
    pub fn coordinates(&self) -> &[Vec<f64>] {
        &self.coordinates
    }

    /// Their rates a second.
    pub fn rates(&self) -> &[Vec<f64>] {
        &self.rates
    }

    /// Time between samples, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Whether each coordinate lies on a circle.
    pub fn circle(&self) -> &[bool] {
        &self.circle
    }

    /// How many samples.
    pub fn len(&self) -> usize {
        self.coordinates.first().map_or(0, Vec::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A coordinate or rate at every sample; none for what is neither.
    pub(super) fn at_samples(&self, symbol: Symbol) -> Option<&[f64]> {
        let all = self.samples.get_or_init(|| {
            let placed = |(x, circle): (&Vec<f64>, &bool)| -> Vec<f64> {
                if *circle { x.iter().map(|x| wrapped(*x)).collect() } else { x.clone() }
            };
            [self.coordinates.iter().zip(&self.circle).map(placed).collect(), self.rates.clone()]
        });
        series(all, symbol)
    }

    /// The same as [`Course::over`] of all steps, [`STEPS`] from one sample to the next.
    pub(super) fn over_steps(&self, symbol: Symbol) -> Option<&[f64]> {
        let all = self.steps.get_or_init(|| {
            let count = self.len().saturating_sub(1);
            let over = |symbol: Symbol| -> Vec<f64> {
                let part = |j: usize| [j, j + 1].map(|k| k as f64 / STEPS as f64);
                (0..count).flat_map(|i| (0..STEPS).map(move |j| self.over(symbol, i, part(j)))).collect()
            };
            let of = |symbol: fn(usize) -> Symbol| (0..self.coordinates.len()).map(|k| over(symbol(k))).collect();
            [of(Symbol::Coordinate), of(Symbol::Rate)]
        });
        series(all, symbol)
    }

    /// A coordinate half-way through a part of the way from sample `i` to the next, or its mean rate
    /// over that part, which is what a law that is linear in the rate is driven by.
    pub(super) fn over(&self, symbol: Symbol, i: usize, [from, to]: [f64; 2]) -> f64 {
        match symbol {
            Symbol::Rate(k) => {
                let way = self.way(k, i);
                if to > from {
                    (way.at(to) - way.at(from)) / ((to - from) * self.step_s)
                } else {
                    way.slope(from) / self.step_s
                }
            }
            Symbol::Coordinate(k) => {
                let x = self.coordinates[k][i] + self.way(k, i).at(0.5 * (from + to));
                if self.circle[k] { wrapped(x) } else { x }
            }
            _ => f64::NAN,
        }
    }

    fn way(&self, k: usize, i: usize) -> Way {
        let whole = self.coordinates[k][i + 1] - self.coordinates[k][i];
        let bends = [i, i + 1].map(|i| self.step_s * self.rates[k][i] - whole);
        Way { whole, bends }
    }
}

/// That of a symbol among those of the coordinates and the rates.
fn series([coordinates, rates]: &[Vec<Vec<f64>>; 2], symbol: Symbol) -> Option<&[f64]> {
    match symbol {
        Symbol::Coordinate(k) => coordinates.get(k).map(Vec::as_slice),
        Symbol::Rate(k) => rates.get(k).map(Vec::as_slice),
        _ => None,
    }
}

/// The cubic through two neighbouring samples with their rates (Hermite), from the first on.
struct Way {
    whole: f64,
    /// What the rates at both ends would go further in one sample.
    bends: [f64; 2],
}

impl Way {
    fn at(&self, s: f64) -> f64 {
        let [a, b] = self.bends;
        s * self.whole + s * (1.0 - s) * (a * (1.0 - s) - b * s)
    }

    fn slope(&self, s: f64) -> f64 {
        let [a, b] = self.bends;
        self.whole + (1.0 - 2.0 * s) * (a * (1.0 - s) - b * s) - s * (1.0 - s) * (a + b)
    }
}

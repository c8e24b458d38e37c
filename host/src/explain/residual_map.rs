//! Where simulation and measurement disagree: the residual of each equation of motion against angle, velocity, drive phase and time.
//!
//! The residual r_i = J_oi (φ̈_i + …) is a torque (divided by J_oi where no mass is known), evaluated with smoothed angles, rates and accelerations.
//! Its mean in each of 24 bins of a coordinate is compared with the band (95 %) that the sensors' noise alone gives: the smoothed record is
//! measured again by the same sensors with their grids shifted, and what this does to the mean of a bin is a draw of its noise.

use core::f64::consts::{PI, TAU};

use nalgebra::DVector;
use serde::Serialize;

use super::design::{self, Design, base_terms};
use super::effects::{Action, Variant, wrapped};
use super::ranking;
use super::state::State;
use crate::identify::Geometry;
use crate::identify::noise_bias::{REPEATS, measure, smoothed_stretches};
use crate::identify::windows::evaluate_all;
use crate::model::weak::{Order, Sample, Series, WeakModel};
use crate::signal::angles::AngleSegment;

/// Bins of a map.
const BINS: usize = 24;
/// A bin counts as disagreeing from this many bands on.
const CLEARLY: f64 = 1.6;
/// Fewest samples of a bin that is shown.
const LEAST_SAMPLES: f64 = 100.0;

/// A stretch of a coordinate in which an equation's residual exceeds what noise gives.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Where {
    /// Equation, 1 or 2.
    pub equation: usize,
    /// Coordinate.
    pub against: String,
    /// From.
    pub from: f64,
    /// To.
    pub to: f64,
    /// Mean residual there, N m (or rad/s² where no mass is known).
    pub value: f64,
    /// Band (95 %) of the sensors' noise alone.
    pub band: f64,
}

/// The residual of an equation against a coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Map {
    /// Equation, 1 or 2.
    pub equation: usize,
    /// Coordinate.
    pub against: String,
    /// Unit of the coordinate.
    pub against_unit: &'static str,
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

/// Coordinates: name, unit, function of a sample.
fn coordinates(driven: bool) -> Vec<(&'static str, &'static str, Series)> {
    let mut out: Vec<(&'static str, &'static str, Series)> = vec![
        ("angle of joint1", "rad", std::sync::Arc::new(|s: &Sample| wrapped(s.phi[0]))),
        ("angle of joint2", "rad", std::sync::Arc::new(|s: &Sample| wrapped(s.phi[1] - s.phi[0]))),
        ("velocity of joint1", "rad/s", std::sync::Arc::new(|s: &Sample| s.rate[0])),
        ("velocity of joint2", "rad/s", std::sync::Arc::new(|s: &Sample| s.rate[1] - s.rate[0])),
        ("velocity of arm2", "rad/s", std::sync::Arc::new(|s: &Sample| s.rate[1])),
    ];
    if driven {
        out.push(("drive phase", "rad", std::sync::Arc::new(|s: &Sample| s.sin_tau.atan2(s.cos_tau))));
    }
    out.push(("time", "s", std::sync::Arc::new(|s: &Sample| s.time)));
    out
}

/// The model's variants with given coefficients.
fn model_with<'a>(state: &'a State, x: &DVector<f64>) -> (Vec<(&'a Variant, Vec<f64>)>, Vec<f64>) {
    let n = 2 * base_terms(state.context.driven);
    let mut at = n;
    let model = state
        .chosen
        .iter()
        .map(|k| {
            let strengths = k.strengths.iter().enumerate().map(|(i, _)| x[at + i]).collect();
            at += k.strengths.len();
            (&k.candidate.variant, strengths)
        })
        .collect();
    (model, x.rows(0, n).iter().copied().collect())
}

/// Power of the rows' residuals, by equation and frequency.
pub(super) struct Power {
    /// Ratio to what the sensors' noise alone gives, averaged over equations and frequencies.
    pub(super) ratio: f64,
    /// Mean square residual.
    found: Vec<Vec<f64>>,
    /// What noise alone gives.
    noise: [Vec<f64>; 2],
}

/// Power of the rows' residuals beside what the sensors' noise alone gives.
pub(super) fn power(
    state: &State,
    design: &Design,
    own: &[usize],
    x: &DVector<f64>,
    geometry: &Geometry,
    sigma: [f64; 2],
) -> Power {
    let (model, base) = model_with(state, x);
    let truth = smoothed_stretches(&state.segments, &geometry.kernels, &geometry.windows);
    let clean = design::residual(&state.context, &truth, geometry, &model, &base);
    let mut noise = [vec![0.0; design.frequencies + 1], vec![0.0; design.frequencies + 1]];
    let mut count = noise.clone();
    for r in 0..REPEATS {
        let measured: Vec<AngleSegment> =
            truth.iter().enumerate().map(|(i, s)| measure(s, r, sigma, i as u64)).collect();
        let noisy = design::residual(&state.context, &measured, geometry, &model, &base);
        for (a, b) in clean.iter().zip(&noisy) {
            for (row, (a, b)) in a.iter().zip(b).enumerate() {
                let (e, m) = design.place_of_row(row);
                noise[e][m] += (b - a) * (b - a);
                count[e][m] += 1.0;
            }
        }
    }
    let found = ranking::mean_squares(design, own, x);
    let mut sum = 0.0;
    let mut n = 0.0;
    for e in 0..2 {
        for m in 0..=design.frequencies {
            if noise[e][m] > 0.0 {
                sum += found[e][m] * count[e][m] / noise[e][m];
                n += 1.0;
            }
        }
    }
    for (noise, count) in noise.iter_mut().zip(&count) {
        noise.iter_mut().zip(count).for_each(|(v, n)| *v /= f64::max(*n, 1.0));
    }
    Power { ratio: if n > 0.0 { sum / n } else { f64::INFINITY }, found, noise }
}

/// Adds a map of each equation's residual against frequency: rms over windows of the rows' residual at each frequency of the test functions, as the
/// amplitude of an acceleration (times J_oi where that is known), and the frequencies at which it clearly exceeds noise.
pub(super) fn add_frequencies(
    maps: &mut Vec<Map>,
    places: &mut Vec<Where>,
    power: &Power,
    geometry: &Geometry,
    context: &super::effects::Context,
) {
    let step = 1.0 / geometry.windows.length_s;
    let mut found = Vec::new();
    for e in 0..2 {
        let inertia = context.known.get(["J_o1", "J_o2"][e]).copied();
        // A row is ∫ w Y dt of the non-dimensional equation; ∫ sin⁴(πu) over a window is 3/8 of its length, half of an amplitude at its frequency.
        let scale = inertia.unwrap_or(1.0) * context.omega * context.omega / (0.375 * geometry.windows.length_s) * 2.0;
        let unit = if inertia.is_some() { "N m" } else { "rad/s²" };
        let mut bins = Vec::new();
        for (m, (f, n)) in power.found[e].iter().zip(&power.noise[e]).enumerate() {
            let (value, band) = (scale * f.sqrt(), scale * 1.96 * n.sqrt());
            let at = m as f64 * step;
            bins.push([at, value, band]);
            if value > CLEARLY * band {
                found.push(Where {
                    equation: e + 1,
                    against: "frequency".to_owned(),
                    from: (at - 0.5 * step).max(0.0),
                    to: at + 0.5 * step,
                    value,
                    band,
                });
            }
        }
        maps.push(Map {
            equation: e + 1,
            against: "frequency".to_owned(),
            against_unit: "Hz",
            unit: unit.to_owned(),
            bins,
        });
    }
    places.extend(merge(found).into_iter().take(4));
}

/// Series of both residuals and of all coordinates.
fn series(state: &State, x: &DVector<f64>) -> WeakModel {
    let (model, base) = model_with(state, x);
    let n = base.len() / 2;
    let square = state.context.omega * state.context.omega;
    let mut out = WeakModel::default();
    for i in 0..2 {
        let forces: Vec<(Series, f64)> = model
            .iter()
            .flat_map(|(v, k)| match &v.action {
                Action::Force(f) => f.iter().zip(k).filter_map(|(pair, k)| pair[i].clone().map(|f| (f, *k))).collect(),
                Action::Sensor(_) | Action::Runaway(_) => Vec::new(),
            })
            .collect();
        let b: Vec<f64> = (0..4).map(|k| if k < n { base[i * n + k] } else { 0.0 }).collect();
        let scale = state.context.known.get(["J_o1", "J_o2"][i]).copied().unwrap_or(1.0);
        let residual = move |s: &Sample| {
            let j = 1 - i;
            let turn = if i == 0 { -1.0 } else { 1.0 };
            let coupling = s.accel[j] * s.cos_delta() + turn * s.rate[j] * s.rate[j] * s.sin_delta();
            let left: f64 = s.sin[i] * (b[1] + b[2] * s.cos_tau + b[3] * s.sin_tau)
                + forces.iter().map(|(f, k)| k * f(s)).sum::<f64>();
            scale * (s.accel[i] + b[0] * coupling + square * left)
        };
        let _ = out.part(&format!("r{i}"), residual, Order::Value, 1.0);
    }
    for (name, _, f) in coordinates(state.context.driven) {
        let _ = out.part(name, move |s| f(s), Order::Value, 1.0);
    }
    out
}

/// Maps of both equations against all coordinates, and the places where they clearly disagree, largest first.
pub(super) fn maps(state: &State, x: &DVector<f64>, geometry: &Geometry, sigma: [f64; 2]) -> (Vec<Map>, Vec<Where>) {
    let weak = series(state, x);
    let axes: Vec<Axis> = coordinates(state.context.driven)
        .iter()
        .map(|(name, unit, _)| Axis {
            name: (*name).to_owned(),
            unit,
            turn: name.starts_with("angle") || *name == "drive phase",
        })
        .collect();
    let values = evaluate_all(&state.segments, &weak, &geometry.kernels);
    let truth = smoothed_stretches(&state.segments, &geometry.kernels, &geometry.windows);
    let clean = evaluate_all(&truth, &weak, &geometry.kernels);
    let mut noise = [Vec::new(), Vec::new()];
    for r in 0..REPEATS {
        let measured: Vec<AngleSegment> =
            truth.iter().enumerate().map(|(i, s)| measure(s, r, sigma, i as u64)).collect();
        let noisy = evaluate_all(&measured, &weak, &geometry.kernels);
        for (e, noise) in noise.iter_mut().enumerate() {
            noise.push(noisy[e].iter().zip(&clean[e]).map(|(a, b)| a - b).collect::<Vec<f64>>());
        }
    }
    let (mut maps, mut places) = (Vec::new(), Vec::new());
    for e in 0..2 {
        let unit = if state.context.known.contains_key(["J_o1", "J_o2"][e]) { "N m" } else { "rad/s²" };
        let residual = Residual { equation: e + 1, unit, values: &values[e], noise: &noise[e] };
        residual.against(&axes, (&values[2..], &clean[2..]), &mut maps, &mut places);
    }
    (maps, merge(places))
}

/// A coordinate that residuals are looked at against.
pub(super) struct Axis {
    /// Name.
    pub(super) name: String,
    /// Unit.
    pub(super) unit: &'static str,
    /// Whether it runs from −π to π.
    pub(super) turn: bool,
}

/// The residual of an equation over a record, and what the sensors' noise adds to it over the smoothed one, repeat by repeat.
pub(super) struct Residual<'a> {
    /// Equation, from 1.
    pub(super) equation: usize,
    /// Unit.
    pub(super) unit: &'a str,
    /// Over the record.
    pub(super) values: &'a [f64],
    /// Over the smoothed record.
    pub(super) noise: &'a [Vec<f64>],
}

impl Residual<'_> {
    /// Its means in bins of every coordinate, over the record and over the smoothed one, and the bins in which they clearly exceed noise.
    pub(super) fn against(
        &self,
        axes: &[Axis],
        (along, clean): (&[Vec<f64>], &[Vec<f64>]),
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
                let band = 1.96 * (power / f64::max(count, 1.0) / n).sqrt();
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
                    });
                }
            }
            maps.push(Map {
                equation: self.equation,
                against: axis.name.clone(),
                against_unit: axis.unit,
                unit: self.unit.to_owned(),
                bins,
            });
        }
    }

    /// For each bin the sum of n · mean² over repeats and their number: each repeat is one draw of what noise does to that mean, and the
    /// variance of a mean falls with the number of samples, n · mean² does not.
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

/// Neighbouring bins of one sign become one place; the twelve clearest are kept.
pub(super) fn merge(places: Vec<Where>) -> Vec<Where> {
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
    out.sort_by(|a, b| (b.value.abs() / b.band).total_cmp(&(a.value.abs() / a.band)));
    out.truncate(12);
    out
}

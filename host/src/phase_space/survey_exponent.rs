//! The largest Lyapunov exponent of a record, from the state that all its coordinates make
//! together:
//! some delays of each and the drive's phase.

use serde::Serialize;

use super::embedding::{Component, Embedding};
use super::lyapunov_exponent::{self as divergence, Divergence, StraightPart};
use super::observable::Observable;
use super::survey::PhaseSpace;
use super::tangent_exponent::{self as tangent, Tangent};
use crate::statistics::Z95;

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
    pub fit: Option<StraightPart>,
    /// The curve S(k), one value a sample.
    pub divergence: Divergence,
}

/// All coordinates of a record together, and the drive's phase where there is a drive.
pub(super) struct JointState<'a> {
    /// The coordinates.
    pub coordinates: Vec<&'a Observable>,
    /// The phase, as an angle.
    pub phase: Option<&'a Observable>,
}

impl<'a> JointState<'a> {
    /// Delays of each coordinate in a state: two, five of a single one without a drive (a motion on a
    /// surface crosses itself in fewer, Takens 1981), and one where a free system's coordinates are as
    /// many as its dimension.
    pub fn delays(&self, dimension: Option<usize>) -> usize {
        match self.coordinates.len() {
            _ if self.phase.is_some() => 2,
            1 => 5,
            n if dimension.is_some_and(|d| d <= n) => 1,
            _ => 2,
        }
    }

    /// So many delays of each coordinate, and the drive's phase last.
    pub fn embedding(&self, delays: usize, delay: usize, ahead: usize, most: usize) -> Embedding<'a> {
        let of_delay = |j: usize| self.coordinates.iter().map(move |of| Component { of, delay: j * delay });
        let mut components: Vec<Component<'a>> = (0..delays).flat_map(of_delay).collect();
        components.extend(self.phase.map(|of| Component { of, delay: 0 }));
        Embedding::new(components, ahead, most)
    }
}

/// The exponent of a record, by local linear maps and by the divergence of neighbours. `period`: of
/// the drive, samples; `space`: what was found of its coordinates.
pub(super) fn lyapunov(state: &JointState<'_>, period: Option<f64>, space: &PhaseSpace, rate: f64) -> Option<Lyapunov> {
    let JointState { coordinates, phase } = state;
    let delays = state.delays(space.dimension);
    // An eighth of a drive period: long beside the noise of a count, short beside the curvature of
    // the flow.
    let step = period.map_or((space.delay as f64 / 2.0).round(), |t| (t / 8.0).round()).max(1.0) as usize;
    let unknowns = delays * coordinates.len() + usize::from(phase.is_some()) + 1;
    let tangent = tangent::tangent_exponent(
        coordinates,
        *phase,
        &tangent::Settings {
            step,
            delays,
            neighbours: 8 * unknowns,
            theiler: space.theiler,
            in_sheet: phase.is_none(),
            steps: 6000,
            vectors: 100_000,
        },
    )?;
    let steps = period.map_or(20.0 * space.delay as f64, |t| 10.0 * t).round() as usize;
    let choice = divergence::Settings {
        theiler: space.theiler,
        steps: steps.clamp(10, 2000),
        followed: delays * coordinates.len(),
        unit: period.unwrap_or(1.0),
        settle: period.map_or(space.delay, |t| (0.5 * t).round() as usize),
        ceiling: 0.7,
    };
    let e = state.embedding(delays, space.delay, choice.steps, space.settings.most_pairs);
    let followed = divergence::divergence(&e, &choice);
    let fit = divergence::fit(&followed, &choice);
    let (value, error) = (tangent.exponent * rate, tangent.std_error * rate);
    Some(Lyapunov {
        per_second: value,
        std_error: error,
        interval: [value - Z95 * error, value + Z95 * error],
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

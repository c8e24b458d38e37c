//! The prediction horizon: how long the model follows the record from an initial state that was
//! fitted to a short stretch of it.
//!
//! From each of many starts, spread over the record, the state is fitted to two drive periods
//! (parameters held, [`crate::motion::starts`]); from their end on the solution runs free, and the
//! horizon is the time until any sensor's angle is off by more than the tolerance. Chaos ends it
//! even for a perfect model: error grows as e^{λt} from what the sensors' noise leaves in the state.
//! The same is therefore done with a record that the model itself made.

use indicatif::ProgressBar;
use rayon::prelude::*;
use serde::Serialize;

use crate::identify::shooting::problem::{Piece, Problem};
use crate::model::dynamics::Dynamics;

/// Horizons of a record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Horizon {
    /// Time of each start's free run, s.
    pub start_s: Vec<f64>,
    /// Horizon from it, s.
    pub seconds: Vec<f64>,
    /// How many of them ended with the record or at the longest prediction, the angles still within
    /// the tolerance.
    pub unended: usize,
    /// Starts whose state could not be fitted.
    pub unfitted: usize,
    /// 10, 25, 50, 75 and 90 % quantiles, s.
    pub quantiles_s: [f64; 5],
    /// By how much predictions miss over the fit and as long behind it, and to their end, in units of
    /// the sensors' noise: rms, the median of the starts.
    pub error: [f64; 2],
}

impl Horizon {
    /// The median, s.
    pub fn median(&self) -> f64 {
        self.quantiles_s[2]
    }
}

/// Value below which a share of sorted values lies (linear between them).
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    match sorted.len() {
        0 => f64::NAN,
        n => {
            let at = share.clamp(0.0, 1.0) * (n - 1) as f64;
            let (low, u) = (at.floor() as usize, at - at.floor());
            sorted[low] + u * (sorted[(low + 1).min(n - 1)] - sorted[low])
        }
    }
}

/// What came of a start: its time, its horizon, whether that has not ended, and the errors.
type Followed = (f64, f64, bool, [f64; 2]);

/// Horizons from pieces that begin with the stretch of the fit and go on as long as predictions are
/// looked at. `guesses`: each piece's rough initial state; `levels`: samples of the fit, shortest
/// first; `tolerance`: of each sensor, in its unit; `bar` is told of each piece.
pub fn horizon<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    guesses: &[Vec<f64>],
    parameters: &[f64],
    levels: &[usize],
    tolerance: &[f64],
    bar: &ProgressBar,
) -> Horizon {
    let sensors = problem.sensors.len().max(1);
    let fit = levels.iter().copied().max().unwrap_or(2);
    let found: Vec<Option<Followed>> = pieces
        .par_iter()
        .zip(guesses)
        .map_init(
            || problem.room(false),
            |work, (piece, guess)| {
                bar.inc(1);
                let head = problem.head(piece, fit);
                let (state, _) = problem.fit_state(&head, guess, parameters, levels, work)?;
                // A solution that ceases to exist ends the horizon where it does: no more samples
                // come.
                let residuals = problem.residuals_until(piece, &state, parameters);
                let samples = residuals.len() / sensors;
                let rms = |of: &[f64]| (of.iter().map(|r| r * r).sum::<f64>() / of.len().max(1) as f64).sqrt();
                let error = [2 * fit * sensors, residuals.len()].map(|n| rms(&residuals[..residuals.len().min(n)]));
                let off = |i: &usize| {
                    (0..sensors).any(|k| (residuals[i * sensors + k] * problem.sigma[k]).abs() > tolerance[k])
                };
                let end = (fit.min(samples)..samples).find(off);
                let whole = piece.measured.len() / sensors;
                let last = end.unwrap_or(samples);
                let seconds = last.saturating_sub(fit) as f64 * problem.spacing_s;
                let start = piece.start_s + fit as f64 * problem.spacing_s;
                Some((start, seconds, end.is_none() && samples == whole, error))
            },
        )
        .collect();
    let unfitted = found.iter().filter(|f| f.is_none()).count();
    let found: Vec<Followed> = found.into_iter().flatten().collect();
    let seconds: Vec<f64> = found.iter().map(|f| f.1).collect();
    let sorted = |mut of: Vec<f64>| {
        of.sort_by(f64::total_cmp);
        of
    };
    let error = [0, 1].map(|k| quantile(&sorted(found.iter().map(|f| f.3[k]).collect()), 0.5));
    let sorted = sorted(seconds.clone());
    Horizon {
        start_s: found.iter().map(|f| f.0).collect(),
        unended: found.iter().filter(|f| f.2).count(),
        unfitted,
        // Where no start could be followed, nothing lasts.
        quantiles_s: [0.1, 0.25, 0.5, 0.75, 0.9].map(|q| if sorted.is_empty() { 0.0 } else { quantile(&sorted, q) }),
        error,
        seconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::shooting::zeros::Zeros;
    use crate::model::dynamics::Here;

    #[test]
    fn quantiles_lie_between_values() {
        let x = [1.0, 2.0, 4.0, 8.0];
        assert_eq!((quantile(&x, 0.0), quantile(&x, 0.5), quantile(&x, 1.0)), (1.0, 3.0, 8.0));
        assert!(quantile(&[], 0.5).is_nan());
    }

    /// q̈ = a q: errors of the state grow as e^{√a t}.
    struct Saddle;

    impl Dynamics for Saddle {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            1
        }
        fn acceleration_held(&self, Here { parameters: p, q, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = p[0] * q[0];
            true
        }
    }

    #[test]
    fn a_model_that_is_off_is_followed_for_as_long_as_its_error_takes_to_grow() {
        // Truth: q = ½ e^{−2t}; model: the same with a force in the wrong place of the eigenvalue,
        // so that what it gets wrong grows.
        let sensors = [vec![1.0]];
        let problem = Problem {
            dynamics: &Saddle,
            sensors: &sensors,
            sigma: &[1e-3],
            spacing_s: 0.01,
            step_s: 0.01,
            omega: 0.0,
            inputs: None,
            zeros: Zeros::default(),
        };
        let wobble = |i: usize| if i.is_multiple_of(2) { 1e-4 } else { -1e-4 };
        let measured: Vec<f64> = (0..800).map(|i| 0.5 * (-2.0 * 0.01 * i as f64).exp() + wobble(i)).collect();
        let piece = Piece { start_s: 3.0, tau: 0.0, stretch: 0, measured };
        let bar = ProgressBar::hidden();
        let run =
            |a: f64| horizon(&problem, std::slice::from_ref(&piece), &[vec![0.5, -1.0]], &[a], &[20, 40], &[0.3], &bar);
        let (good, poor) = (run(4.0), run(4.4));
        assert_eq!((good.seconds.len(), good.unfitted), (1, 0));
        assert!((good.start_s[0] - 3.4).abs() < 1e-12);
        assert!(good.median() > poor.median() + 0.5 && poor.median() > 0.2, "{good:?} {poor:?}");
        assert!(good.error[0] < 0.3 && poor.error[0] > 2.0 * good.error[0], "{good:?} {poor:?}");
    }
}

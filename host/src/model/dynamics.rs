//! Equations of motion that can be integrated: accelerations from state, parameters, drive phase
//! and measured inputs.
//!
//! q̈ = a(q, q̇, u, τ, t; p) for n coordinates (rad or m, each with its rate a second) and P
//! parameters. What predicts, simulates or shoots takes any [`Dynamics`]: a built-in system, a
//! system with effects added, or a model file.

use super::model_file::equations_of_motion::turns;
use super::model_file::expression::Function;

/// What acts from outside at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Instant<'a> {
    /// Time of the record, s.
    pub time: f64,
    /// Phase τ of the drive, rad; 0 for a free system.
    pub tau: f64,
    /// Measured inputs, in the model's order and SI units.
    pub inputs: &'a [f64],
}

/// What accelerations are functions of.
#[derive(Clone, Copy)]
pub struct Here<'a> {
    /// Values of the parameters (P).
    pub parameters: &'a [f64],
    /// Coordinates (n).
    pub q: &'a [f64],
    /// Their rates (n).
    pub v: &'a [f64],
    /// What acts from outside.
    pub at: &'a Instant<'a>,
    /// Signs of [`Dynamics::switches`], in [−1, 1], then turns of [`Dynamics::seams`].
    pub signs: &'a [f64],
}

/// Room for accelerations and their partial derivatives.
pub struct Linearisation<'a> {
    /// q̈ (n).
    pub acceleration: &'a mut [f64],
    /// ∂q̈, n rows of 2n + P columns (q, v, parameters), row after row.
    pub partials: &'a mut [f64],
}

/// A second-order system with parameters.
pub trait Dynamics: Sync {
    /// Coordinates n.
    fn degrees_of_freedom(&self) -> usize;

    /// Parameters P.
    fn parameter_count(&self) -> usize;

    /// Accelerations q̈ (n), linear in each sign, so that one between −1 and 1 stands for sticking.
    /// False where they do not exist (a singular mass matrix, a value that is not finite); `out` is
    /// then undefined.
    fn acceleration_held(&self, here: Here<'_>, out: &mut [f64]) -> bool;

    /// Accelerations and partials at once: what variational equations need. The default takes
    /// [`differences`]; override it where the two share work.
    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        self.acceleration_held(here, out.acceleration) && differences(self, here, out.partials)
    }

    /// Whether [`Dynamics::linearise_held`] also takes room for 2n partials a row, those by
    /// coordinates and rates alone: what a state's own variational equations need.
    fn takes_states_alone(&self) -> bool {
        false
    }

    /// Where accelerations jump: weights of linear forms in the rates, n each, on whose signs they
    /// depend (dry friction: a joint's relative velocity). An integrator holds the signs between
    /// the zeros of these forms. None by default.
    fn switches(&self) -> &[Vec<f64>] {
        &[]
    }

    /// Where accelerations jump with the position: weights of linear forms in the coordinates, n
    /// each, of which they depend on the number of whole turns (a spring in a joint that turns over:
    /// its angle jumps from π to −π). An integrator holds these numbers between the crossings of
    /// odd multiples of π. None by default.
    fn seams(&self) -> &[Vec<f64>] {
        &[]
    }

    /// Signs of the rates' forms, then turns of those of the coordinates, as the state has them.
    fn signs(&self, q: &[f64], v: &[f64]) -> Vec<f64> {
        let of = |w: &[f64], x: &[f64]| -> f64 { w.iter().zip(x).map(|(a, b)| a * b).sum() };
        let signs = self.switches().iter().map(|w| Function::Sign.value(of(w, v)));
        signs.chain(self.seams().iter().map(|w| turns(of(w, q)))).collect()
    }

    /// [`Dynamics::acceleration_held`] with the state's own signs.
    fn acceleration(&self, parameters: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        self.acceleration_held(Here { parameters, q, v, at, signs: &self.signs(q, v) }, out)
    }
}

/// Partial derivatives as of [`Linearisation`] by central differences, the signs held, with steps
/// of 1e-6 of each argument's size (at least 1e-6).
pub fn differences<D: Dynamics + ?Sized>(dynamics: &D, here: Here<'_>, out: &mut [f64]) -> bool {
    let n = dynamics.degrees_of_freedom();
    let width = 2 * n + dynamics.parameter_count();
    let mut arguments: Vec<f64> = [here.q, here.v, here.parameters].concat();
    let (mut ahead, mut behind) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..width {
        let kept = arguments[k];
        let step = 1e-6 * kept.abs().max(1.0);
        let mut at_step = |value: f64, to: &mut [f64]| {
            arguments[k] = value;
            let (q, rest) = arguments.split_at(n);
            let (v, parameters) = rest.split_at(n);
            dynamics.acceleration_held(Here { parameters, q, v, ..here }, to)
        };
        let exists = at_step(kept + step, &mut ahead) && at_step(kept - step, &mut behind);
        arguments[k] = kept;
        if !exists {
            return false;
        }
        for i in 0..n {
            out[i * width + k] = (ahead[i] - behind[i]) / (2.0 * step);
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// q̈ = −k sin q − c q̇ + u.
    struct Pendulum;

    impl Dynamics for Pendulum {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            2
        }
        fn acceleration_held(&self, Here { parameters: p, q, v, at, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = -p[0] * q[0].sin() - p[1] * v[0] + at.inputs[0];
            out[0].is_finite()
        }
    }

    #[test]
    fn differences_give_the_analytic_partials() {
        let at = Instant { time: 0.0, tau: 0.0, inputs: &[0.3] };
        let mut out = [0.0; 4];
        let here = Here { parameters: &[40.0, 0.2], q: &[0.7], v: &[-3.0], at: &at, signs: &[] };
        assert!(differences(&Pendulum, here, &mut out));
        let expected = [-40.0 * 0.7_f64.cos(), -0.2, -0.7_f64.sin(), 3.0];
        for (o, e) in out.iter().zip(expected) {
            assert!((o - e).abs() < 1e-6, "{o} {e}");
        }
        assert!(!differences(&Pendulum, Here { parameters: &[f64::NAN, 0.2], ..here }, &mut out));
    }
}

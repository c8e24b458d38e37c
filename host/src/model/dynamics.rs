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
    /// Signs of [`Dynamics::switches`], in [−1, 1], turns of [`Dynamics::seams`], signs of
    /// [`Dynamics::corners`].
    pub signs: &'a [f64],
}

/// Room for accelerations and their partial derivatives.
pub struct Linearisation<'a> {
    /// q̈ (n).
    pub acceleration: &'a mut [f64],
    /// ∂q̈, n rows of 2n + P columns (q, v, parameters), row after row.
    pub partials: &'a mut [f64],
}

/// The relative velocity of two surfaces, w·v + o + g·u, whose sign dry friction has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Switch {
    /// w of the rates (n).
    pub weights: Vec<f64>,
    /// o: minus the speed of a surface that moves steadily, in the rates' unit.
    pub offset: f64,
    /// g of the measured inputs, such as a belt's speed; empty without any.
    pub inputs: Vec<f64>,
}

impl Switch {
    /// Of surfaces that the coordinates alone move.
    pub fn of_rates(weights: Vec<f64>) -> Self {
        Self { weights, ..Self::default() }
    }

    /// The relative velocity.
    pub fn rate(&self, v: &[f64], inputs: &[f64]) -> f64 {
        dot(&self.weights, v) + (self.offset + dot(&self.inputs, inputs))
    }

    /// The relative acceleration: w·a + g·u̇.
    pub fn acceleration(&self, a: &[f64], input_rates: &[f64]) -> f64 {
        dot(&self.weights, a) + dot(&self.inputs, input_rates)
    }
}

/// A position w·q + o + c·turns at whose zero a law has a corner or jumps: a clearance's end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Corner {
    /// w of the coordinates (n).
    pub weights: Vec<f64>,
    /// o, in the coordinates' unit.
    pub offset: f64,
    /// A seam of [`Dynamics::seams`], and what its number of turns is multiplied with.
    pub turns: Option<(usize, f64)>,
}

impl Corner {
    /// The position, after so many turns of each seam.
    pub fn value(&self, q: &[f64], turns: &[f64]) -> f64 {
        dot(&self.weights, q) + self.shift(turns)
    }

    /// What is beside the coordinates.
    pub fn shift(&self, turns: &[f64]) -> f64 {
        self.offset + self.turns.map_or(0.0, |(seam, c)| c * turns[seam])
    }
}

fn dot(w: &[f64], x: &[f64]) -> f64 {
    w.iter().zip(x).map(|(w, x)| w * x).sum()
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

    /// Where accelerations jump: relative velocities on whose signs they depend (dry friction). An
    /// integrator holds the signs between the zeros of these. None by default.
    fn switches(&self) -> &[Switch] {
        &[]
    }

    /// Where accelerations jump with the position: weights of linear forms in the coordinates, n
    /// each, of which they depend on the number of whole turns (a spring in a joint that turns over:
    /// its angle jumps from π to −π). An integrator holds these numbers between the crossings of
    /// odd multiples of π. None by default.
    fn seams(&self) -> &[Vec<f64>] {
        &[]
    }

    /// Where accelerations have a corner or jump with the position otherwise: an integrator holds the
    /// signs between the zeros of these. None by default.
    fn corners(&self) -> &[Corner] {
        &[]
    }

    /// How many signs and turns are held.
    fn held(&self) -> usize {
        self.switches().len() + self.seams().len() + self.corners().len()
    }

    /// Signs of the switches, then turns of the seams, then signs of the corners, as the state has
    /// them.
    fn signs(&self, q: &[f64], v: &[f64], inputs: &[f64]) -> Vec<f64> {
        let turned: Vec<f64> = self.seams().iter().map(|w| turns(dot(w, q))).collect();
        let signs = self.switches().iter().map(|s| Function::Sign.value(s.rate(v, inputs)));
        let corners = self.corners().iter().map(|c| Function::Sign.value(c.value(q, &turned)));
        signs.chain(turned.iter().copied()).chain(corners).collect()
    }

    /// [`Dynamics::acceleration_held`] with the state's own signs.
    fn acceleration(&self, parameters: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        self.acceleration_held(Here { parameters, q, v, at, signs: &self.signs(q, v, at.inputs) }, out)
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

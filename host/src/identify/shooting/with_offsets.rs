//! A system whose sensors have zeros of their own in every piece.
//!
//! To the coordinates one more is added for each sensor, o with ö = 0, which the sensor shows
//! beside what it measures: y = m·q + o. A piece then finds its sensors' zeros (and their drift)
//! with its state, and what slips did before it does not reach the parameters. Coordinates: q, then
//! o.

use crate::model::dynamics::{Corner, Dynamics, Here, Linearisation, Switch};

/// Equations with an offset of each sensor.
pub struct WithOffsets<'a> {
    inner: &'a dyn Dynamics,
    offsets: usize,
    switches: Vec<Switch>,
    seams: Vec<Vec<f64>>,
    corners: Vec<Corner>,
}

impl<'a> WithOffsets<'a> {
    /// For equations whose motion so many sensors show.
    pub fn new(inner: &'a dyn Dynamics, offsets: usize) -> Self {
        let padded = |w: &Vec<f64>| w.iter().copied().chain(std::iter::repeat_n(0.0, offsets)).collect();
        let switch = |s: &Switch| Switch { weights: padded(&s.weights), ..s.clone() };
        let switches = inner.switches().iter().map(switch).collect();
        let seams = inner.seams().iter().map(padded).collect();
        let corner = |c: &Corner| Corner { weights: padded(&c.weights), ..c.clone() };
        let corners = inner.corners().iter().map(corner).collect();
        Self { inner, offsets, switches, seams, corners }
    }

    /// What each sensor shows, offsets behind the coordinates.
    pub fn sensors(&self, sensors: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let own = |k: usize| (0..self.offsets).map(move |o| f64::from(u8::from(o == k)));
        sensors.iter().enumerate().map(|(k, w)| w.iter().copied().chain(own(k)).collect()).collect()
    }

    /// A state without offsets as one with them, all zero.
    pub fn state(&self, state: &[f64]) -> Vec<f64> {
        let none = || std::iter::repeat_n(0.0, self.offsets);
        let (q, v) = state.split_at(state.len() / 2);
        q.iter().copied().chain(none()).chain(v.iter().copied()).chain(none()).collect()
    }

    /// Without the offsets.
    fn inside<'b>(&self, here: Here<'b>) -> Here<'b> {
        let n = self.inner.degrees_of_freedom();
        Here { q: &here.q[..n], v: &here.v[..n], ..here }
    }
}

impl Dynamics for WithOffsets<'_> {
    fn degrees_of_freedom(&self) -> usize {
        self.inner.degrees_of_freedom() + self.offsets
    }

    fn parameter_count(&self) -> usize {
        self.inner.parameter_count()
    }

    fn switches(&self) -> &[Switch] {
        &self.switches
    }

    fn seams(&self) -> &[Vec<f64>] {
        &self.seams
    }

    fn corners(&self) -> &[Corner] {
        &self.corners
    }

    fn acceleration_held(&self, here: Here<'_>, out: &mut [f64]) -> bool {
        let n = self.inner.degrees_of_freedom();
        out[n..].fill(0.0);
        self.inner.acceleration_held(self.inside(here), &mut out[..n])
    }

    fn takes_states_alone(&self) -> bool {
        self.inner.takes_states_alone()
    }

    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        let Linearisation { acceleration, partials } = out;
        let (n, all) = (self.inner.degrees_of_freedom(), self.degrees_of_freedom());
        let width = partials.len() / all;
        let inner_width = width - 2 * self.offsets;
        let mut inner = vec![0.0; n * inner_width];
        acceleration[n..].fill(0.0);
        partials.fill(0.0);
        let of_inner = Linearisation { acceleration: &mut acceleration[..n], partials: &mut inner };
        if !self.inner.linearise_held(self.inside(here), of_inner) {
            return false;
        }
        for (from, to) in inner.chunks_exact(inner_width).zip(partials.chunks_exact_mut(width)) {
            to[..n].copy_from_slice(&from[..n]);
            to[all..all + n].copy_from_slice(&from[n..2 * n]);
            to[2 * all..].copy_from_slice(&from[2 * n..]);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::flow::{Flow, Outside, Work};

    /// q̈ = −k sin q − c q̇.
    struct Pendulum;

    impl Dynamics for Pendulum {
        fn degrees_of_freedom(&self) -> usize {
            1
        }
        fn parameter_count(&self) -> usize {
            2
        }
        fn acceleration_held(&self, Here { parameters: p, q, v, .. }: Here<'_>, out: &mut [f64]) -> bool {
            out[0] = -p[0] * q[0].sin() - p[1] * v[0];
            true
        }
    }

    /// The motion is that without offsets, which drift evenly; derivatives by state and parameters
    /// stand in their places.
    #[test]
    fn offsets_move_on_their_own() {
        let wide = WithOffsets::new(&Pendulum, 1);
        assert_eq!(wide.sensors(&[vec![1.0]]), [[1.0, 1.0]]);
        assert_eq!(wide.state(&[0.3, -2.0]), [0.3, 0.0, -2.0, 0.0]);
        let parameters = [40.0, 0.2];
        let run = |dynamics: &dyn Dynamics, state: &[f64]| {
            let mut work = Work::by_all(dynamics);
            work.set(state);
            assert!(Flow::new(dynamics, &parameters, Outside::drive(0.0, 0.0, 0.0), 0.01).carry(&mut work, 0.0, 0.5));
            (work.state().to_vec(), work.derivatives().to_vec())
        };
        let (plain, by) = run(&Pendulum, &[0.3, -2.0]);
        let (state, by_all) = run(&wide, &[0.3, 0.05, -2.0, 0.1]);
        assert!((state[0] - plain[0]).abs() < 1e-12 && (state[2] - plain[1]).abs() < 1e-12);
        assert!((state[1] - 0.1).abs() < 1e-12 && (state[3] - 0.1).abs() < 1e-12, "{state:?}");
        // Columns: q, o, v, its rate, two parameters; rows the same without parameters.
        for (row, of) in [(0, 0), (2, 1)] {
            for (column, from) in [(0, 0), (2, 1), (4, 2), (5, 3)] {
                let (a, b) = (by_all[row * 6 + column], by[of * 4 + from]);
                assert!((a - b).abs() < 1e-9, "{row} {column}: {a} {b}");
            }
        }
        assert!((by_all[6 + 1] - 1.0).abs() < 1e-12 && (by_all[6 + 3] - 0.5).abs() < 1e-12);
    }
}

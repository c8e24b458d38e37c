//! One step of Dormand and Prince's method from each of many states, side by side, with the
//! derivatives by that state: the same step as [`super::Flow`] takes over one spacing. Steps in
//! which a sign turns, or a rate begins at zero, are left to it.

use super::crossing::{crossing, turned_over};
use super::{Flow, Inputs, Work};
use crate::model::dynamics::{Dynamics, Instant, Switch};
use crate::model::model_file::equations_of_motion::abreast::{Abreast, Room};
use crate::model::model_file::equations_of_motion::{EquationsOfMotion, turns};
pub use crate::model::model_file::tape::ABREAST;
use crate::model::tableau::{A, C};
use crate::model::vectors::{add_matrix_products, combine};

/// The stage at the step's end. Its rates say only whether a sign turns: no column is made of them.
const LAST: usize = 6;

/// States, their derivatives and the room that a step needs. Columns of [`ABREAST`] states: q (n), v
/// (n), ∂q (n rows of 2n), ∂v (n rows of 2n).
pub struct Steps {
    n: usize,
    count: usize,
    y: Vec<f64>,
    next: Vec<f64>,
    k: [Vec<f64>; 7],
    partials: Vec<f64>,
    accelerations: Vec<f64>,
    room: Room,
    times: Vec<f64>,
    taus: Vec<f64>,
    inputs: Vec<Vec<f64>>,
    signs: Vec<Vec<f64>>,
    /// Which steps are whole: no sign turned and the equations had a solution.
    whole: Vec<bool>,
    /// For steps that are not.
    alone: Work,
    /// Which states have a solution.
    pub exists: Vec<bool>,
}

/// What acts from outside: the drive's angular frequency (rad/s), and measured inputs by time.
pub struct Outside<'a> {
    /// rad/s; 0 without a drive.
    pub omega: f64,
    /// How many inputs.
    pub inputs: usize,
    /// Writes them.
    pub at: &'a (dyn Fn(f64, &mut [f64]) + Sync),
}

/// The vector field that states follow: the equations of motion at values of their parameters.
#[derive(Clone, Copy)]
pub struct VectorField<'a> {
    /// The equations.
    pub motion: &'a EquationsOfMotion,
    /// Values of their parameters.
    pub parameters: &'a [f64],
}

impl Steps {
    /// Room for a system.
    pub fn new(motion: &EquationsOfMotion) -> Self {
        let n = motion.degrees_of_freedom();
        let length = 2 * n * (1 + 2 * n) * ABREAST;
        Self {
            n,
            count: 0,
            y: vec![0.0; length],
            next: vec![0.0; length],
            k: core::array::from_fn(|_| vec![0.0; length]),
            partials: vec![0.0; 2 * n * n * ABREAST],
            accelerations: vec![0.0; n * ABREAST],
            room: Room::default(),
            times: Vec::new(),
            taus: Vec::new(),
            inputs: Vec::new(),
            signs: vec![vec![0.0; ABREAST]; motion.held()],
            whole: Vec::new(),
            alone: Work::by_state(motion),
            exists: Vec::new(),
        }
    }

    /// Begins with states at (q then v), derivatives the identity.
    pub fn set<'a>(&mut self, states: impl Iterator<Item = &'a [f64]>) {
        let m = 2 * self.n;
        self.y.fill(0.0);
        self.count = 0;
        for (i, state) in states.take(ABREAST).enumerate() {
            (0..m).for_each(|c| self.y[c * ABREAST + i] = state[c]);
            (0..m).for_each(|c| self.y[(m + c * m + c) * ABREAST + i] = 1.0);
            self.count = i + 1;
        }
    }

    /// What a column holds for a state: q and v (2n), then the derivatives row after row (2n × 2n).
    pub fn value(&self, column: usize, state: usize) -> f64 {
        self.y[column * ABREAST + state]
    }

    /// Acceleration of a coordinate at a state that the last step began from.
    pub fn acceleration(&self, coordinate: usize, state: usize) -> f64 {
        self.k[0][(self.n + coordinate) * ABREAST + state]
    }

    /// One step of `h` seconds from every state, at its time (s) and phase of the drive (rad);
    /// one after the other where they do not go side by side. [`Steps::exists`] tells of which
    /// states the equations have a solution.
    pub fn carry(&mut self, field: VectorField<'_>, at: impl Fn(usize) -> (f64, f64), outside: &Outside<'_>, h: f64) {
        if field.motion.goes_abreast() {
            self.take(field, &at, outside, h);
        } else {
            self.whole = vec![false; self.count];
            self.next.copy_from_slice(&self.y);
        }
        self.exists = vec![true; self.count];
        for i in (0..self.count).filter(|&i| !self.whole[i]).collect::<Vec<_>>() {
            let (time, tau) = at(i);
            self.exists[i] = self.carry_alone(field, i, time, tau, outside, h);
        }
    }

    /// The step of one state, which is in `next` yet.
    fn carry_alone(
        &mut self,
        field: VectorField<'_>,
        i: usize,
        time: f64,
        tau: f64,
        outside: &Outside<'_>,
        h: f64,
    ) -> bool {
        let VectorField { motion, parameters } = field;
        let (n, m) = (self.n, 2 * self.n);
        let start: Vec<f64> = (0..m).map(|c| self.next[c * ABREAST + i]).collect();
        let mut inputs = vec![0.0; outside.inputs];
        (outside.at)(time, &mut inputs);
        let (mut acceleration, instant) = (vec![0.0; n], Instant { time, tau, inputs: &inputs });
        if !motion.acceleration(parameters, &start[..n], &start[n..], &instant, &mut acceleration) {
            return false;
        }
        self.alone.set(&start);
        let inputs = (outside.inputs > 0).then_some(Inputs { count: outside.inputs, at: outside.at });
        let around = super::Outside { origin: time, tau, omega: outside.omega, inputs };
        if !Flow::new(motion, parameters, around, h).carry(&mut self.alone, time, h) {
            return false;
        }
        acceleration.iter().enumerate().for_each(|(c, x)| self.k[0][(n + c) * ABREAST + i] = *x);
        let reached = self.alone.state().iter().chain(self.alone.derivatives());
        reached.enumerate().for_each(|(c, x)| self.y[c * ABREAST + i] = *x);
        true
    }

    /// The steps that go side by side.
    fn take(&mut self, field: VectorField<'_>, at: impl Fn(usize) -> (f64, f64), outside: &Outside<'_>, h: f64) {
        let motion = field.motion;
        let (n, count) = (self.n, self.count);
        self.whole = vec![true; count];
        let begins: Vec<(f64, f64)> = (0..count).map(at).collect();
        for (switch, signs) in motion.switches().iter().zip(&mut self.signs) {
            for (i, sign) in signs.iter_mut().enumerate().take(count) {
                let moved: f64 =
                    switch.weights.iter().enumerate().map(|(j, w)| w * self.y[(n + j) * ABREAST + i]).sum();
                let rate = moved + level(switch, outside, begins[i].0);
                *sign = rate.signum();
                self.whole[i] &= rate != 0.0;
            }
        }
        let held = motion.switches().len();
        for (weights, turned) in motion.seams().iter().zip(&mut self.signs[held..]) {
            for (i, to) in turned.iter_mut().enumerate().take(count) {
                *to = turns(weights.iter().enumerate().map(|(j, w)| w * self.y[j * ABREAST + i]).sum());
            }
        }
        let (turned, signs) = self.signs[held..].split_at_mut(motion.seams().len());
        let turns_of = |i: usize| -> Vec<f64> { turned.iter().map(|t| t[i]).collect() };
        for (corner, signs) in motion.corners().iter().zip(signs) {
            for (i, sign) in signs.iter_mut().enumerate().take(count) {
                let at: f64 = corner.weights.iter().enumerate().map(|(j, w)| w * self.y[j * ABREAST + i]).sum();
                *sign = (at + corner.shift(&turns_of(i))).signum();
            }
        }
        self.rates(field, &begins, outside, 0, 0.0);
        for stage in 1..=LAST {
            let Self { y, next, k, .. } = self;
            let mut terms: Vec<(f64, &[f64])> = vec![(1.0, y)];
            terms.extend(A[stage].iter().zip(k.iter()).filter(|(a, _)| **a != 0.0).map(|(a, k)| (h * a, &k[..])));
            combine(next, &terms);
            if stage < LAST || !motion.switches().is_empty() {
                self.rates(field, &begins, outside, stage, C[stage] * h);
            }
        }
        for i in 0..count {
            let form =
                |x: &[f64], w: &[f64]| -> f64 { w.iter().enumerate().map(|(j, w)| w * x[(n + j) * ABREAST + i]).sum() };
            let times = [begins[i].0, begins[i].0 + h];
            for (switch, signs) in motion.switches().iter().zip(&self.signs) {
                let (s, w) = (signs[i], &switch.weights);
                let levels = times.map(|t| level(switch, outside, t));
                let rise = times.map(|t| rise(switch, outside, t, h));
                let ends = [s * (form(&self.y, w) + levels[0]), s * (form(&self.next, w) + levels[1])];
                let slopes = [s * h * (form(&self.k[0], w) + rise[0]), s * h * (form(&self.k[LAST], w) + rise[1])];
                self.whole[i] &= crossing(ends, slopes).is_none();
            }
            let place =
                |x: &[f64], w: &[f64]| -> f64 { w.iter().enumerate().map(|(j, w)| w * x[j * ABREAST + i]).sum() };
            for (w, turned) in motion.seams().iter().zip(&self.signs[held..]) {
                let ends = [place(&self.y, w), place(&self.next, w)];
                let slopes = [h * form(&self.y, w), h * form(&self.next, w)];
                self.whole[i] &= turned_over(turned[i], ends, slopes).is_none();
            }
            let (turned, signs) = self.signs[held..].split_at(motion.seams().len());
            let turned: Vec<f64> = turned.iter().map(|t| t[i]).collect();
            for (corner, signs) in motion.corners().iter().zip(signs) {
                let (s, w, shift) = (signs[i], &corner.weights, corner.shift(&turned));
                let ends = [s * (place(&self.y, w) + shift), s * (place(&self.next, w) + shift)];
                let slopes = [s * h * form(&self.y, w), s * h * form(&self.next, w)];
                self.whole[i] &= crossing(ends, slopes).is_none();
            }
            self.whole[i] &= (0..2 * n * (1 + 2 * n)).all(|c| self.next[c * ABREAST + i].is_finite());
        }
        core::mem::swap(&mut self.y, &mut self.next);
    }

    /// Rates of all columns (of the states alone in the last stage) into a stage, from the states
    /// (stage 0) or the attempted ones, `after` seconds after the beginnings.
    fn rates(
        &mut self,
        field: VectorField<'_>,
        begins: &[(f64, f64)],
        outside: &Outside<'_>,
        stage: usize,
        after: f64,
    ) {
        let (n, m, count) = (self.n, 2 * self.n, self.count);
        let Self { y, next, k, partials, accelerations, room, times, taus, inputs, signs, whole, .. } = self;
        let y: &[f64] = if stage == 0 { y } else { next };
        times.clear();
        times.extend(begins.iter().map(|b| b.0 + after));
        taus.clear();
        taus.extend(begins.iter().map(|b| b.1 + outside.omega * after));
        inputs.resize(outside.inputs, Vec::new());
        if outside.inputs > 0 {
            inputs.iter_mut().for_each(|u| u.resize(count, 0.0));
            let mut here = vec![0.0; outside.inputs];
            for (i, t) in times.iter().enumerate() {
                (outside.at)(*t, &mut here);
                inputs.iter_mut().zip(&here).for_each(|(u, x)| u[i] = *x);
            }
        }
        let at = Abreast { count, states: &y[..m * ABREAST], times, taus, inputs, signs };
        let (parameters, out) = (field.parameters, &mut k[stage]);
        out[..n * ABREAST].copy_from_slice(&y[n * ABREAST..m * ABREAST]);
        if stage == LAST {
            field.motion.accelerate_abreast(parameters, &at, room, accelerations, whole);
            out[n * ABREAST..m * ABREAST].copy_from_slice(accelerations);
            return;
        }
        field.motion.linearise_abreast(parameters, &at, room, accelerations, partials, whole);
        out[n * ABREAST..m * ABREAST].copy_from_slice(accelerations);
        // ∂q̇ = ∂v, ∂v̇ = ∂a/∂q ∂q + ∂a/∂v ∂v: the rows of ∂q lie before those of ∂v.
        let (head, tail) = out[m * ABREAST..].split_at_mut(n * m * ABREAST);
        head.copy_from_slice(&y[(m + n * m) * ABREAST..]);
        tail.fill(0.0);
        let derivatives = &y[m * ABREAST..];
        add_matrix_products::<ABREAST>(tail, partials, derivatives, m, m);
    }
}

/// What a relative velocity has beside the coordinates' rates at a time.
fn level(switch: &Switch, outside: &Outside<'_>, time: f64) -> f64 {
    if switch.inputs.is_empty() {
        return switch.offset;
    }
    let mut inputs = vec![0.0; outside.inputs];
    (outside.at)(time, &mut inputs);
    switch.rate(&[], &inputs)
}

/// Its derivative, over a step.
fn rise(switch: &Switch, outside: &Outside<'_>, time: f64, h: f64) -> f64 {
    let at = |t: f64| level(switch, outside, t);
    if switch.inputs.is_empty() { 0.0 } else { (at(time + 0.5 * h) - at(time - 0.5 * h)) / h }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::flow;
    use crate::model::model_file::ModelFile;

    const TEXT: &str = "name = \"m\"\ninputs = [\"u\"]\ncoordinates = [{ name = \"p\", space = \"S1\" }, { name = \"x\", space = \"R\" }]\n\
        [[equation]]\nbalance = \"-(1.5*p'' + 0.3*cos(p)*x'')\"\nterms = { g = \"sin(p)\", c = \"p'\", f = \"sign(p')\" }\n\
        [[equation]]\nbalance = \"u - (x'' + 0.3*(cos(p)*p'' - sin(p)*p'^2))\"\nterms = { k = \"x\", d = \"sign(x' - p')\", t = \"cos(tau)\" }\n";

    /// Steps side by side are those of [`Flow`] one by one, derivatives too; those in which
    /// friction turns are left to it, and no others.
    #[test]
    fn steps_are_those_that_are_taken_one_by_one() {
        let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
        let motion = EquationsOfMotion::new(&model, 3.0).unwrap();
        let parameters = [4.0, 0.1, 0.3, 20.0, 0.2, 0.7];
        assert!(motion.goes_abreast());
        let input = |t: f64, out: &mut [f64]| out[0] = (5.0 * t).sin();
        let mut seed = 11_u32;
        let mut random = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            8.0 * (f64::from(seed >> 8) / f64::from(1 << 24) - 0.5)
        };
        let mut states: Vec<Vec<f64>> = (0..ABREAST).map(|_| (0..4).map(|_| random()).collect()).collect();
        states[7][2] = 0.0;
        // Turns at once.
        states[8] = vec![0.5, 0.1, 1e-4, 2.0];
        let of = |i: usize| (0.01 * i as f64, 0.3 * i as f64);
        let mut steps = Steps::new(&motion);
        steps.set(states.iter().map(Vec::as_slice));
        steps.carry(
            VectorField { motion: &motion, parameters: &parameters },
            of,
            &Outside { omega: 3.0, inputs: 1, at: &input },
            0.004,
        );
        assert!(!steps.whole[7] && !steps.whole[8], "{:?}", &steps.whole[..9]);
        assert!(steps.whole.iter().filter(|w| **w).count() > ABREAST / 2);
        let rates = |s: &[f64]| [s[2], s[3] - s[2]];
        for (i, state) in states.iter().enumerate() {
            let (time, tau) = of(i);
            let outside =
                flow::Outside { origin: time, tau, omega: 3.0, inputs: Some(Inputs { count: 1, at: &input }) };
            let mut work = Work::by_state(&motion);
            work.set(state);
            assert!(Flow::new(&motion, &parameters, outside, 0.004).carry(&mut work, time, 0.004));
            let turned = rates(state).iter().zip(rates(work.state())).any(|(a, b)| a * b <= 1e-12);
            assert_eq!(steps.whole[i], !turned, "{i}");
            assert!(steps.exists[i], "{i}");
            let alone = work.state().iter().chain(work.derivatives());
            for (c, x) in alone.enumerate() {
                assert!(
                    (steps.value(c, i) - x).abs() <= 1e-12 * x.abs().max(1.0),
                    "{i} {c}: {} {x}",
                    steps.value(c, i)
                );
            }
        }
    }
}

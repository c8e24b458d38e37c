//! Solutions of [`Dynamics`] at the samples of a record, with their derivatives by initial state
//! and parameters.
//!
//! Dormand and Prince's method of order 5 (J. Comput. Appl. Math. 6, 1980) with equal steps, over
//! state and variational equations δq̈ = ∂a/∂q δq + ∂a/∂v δv + ∂a/∂p at once. As q̇ = v,
//! coordinates between the ends of a step are the quintic polynomial through q, v and a at both
//! (error h⁶ q⁽⁶⁾/46080), so that the samples do not set the step.
//!
//! Dry friction: the signs of [`Dynamics::switches`] are held during a step; a step in which one of
//! their rates passes zero ends there, at the root of the cubic through rate and acceleration at
//! both ends. There the sign turns, or the joint sticks where both signs drive it back: then the
//! sign is the value in [−1, 1] that keeps its rate zero, until that leaves the interval. At such
//! an instant derivatives jump by (a₊ − a₋) (w·δv)/(w·a₋), w·v being the rate (saltation; Filippov
//! 1988). What jumps where an angle has made a turn ([`Dynamics::seams`]), or has a corner at a
//! position ([`Dynamics::corners`]), is held in the same way; there derivatives jump by (a₊ − a₋)
//! (w·δq)/(w·v).

pub mod abreast;
mod crossing;
mod outside;
mod switching;

pub use self::outside::{Inputs, Outside};
use self::switching::HeldSigns;
use super::dynamics::{Dynamics, Here, Instant, Linearisation};
use super::tableau::{A, C};

/// Most changes of a sign within one step.
const MOST_EVENTS: usize = 24;

/// How a switch stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    /// Sliding, or on one side of a corner, with this sign.
    Slides(f64),
    /// Sticking.
    Sticks,
    /// A seam, behind so many turns.
    Turned(f64),
}

impl Mode {
    /// What is held: a sign, 0 where it follows from sticking, or turns.
    fn value(self) -> f64 {
        match self {
            Self::Slides(x) | Self::Turned(x) => x,
            Self::Sticks => 0.0,
        }
    }
}

/// A system with parameters and surroundings.
pub struct Flow<'a, D: Dynamics + ?Sized> {
    dynamics: &'a D,
    parameters: &'a [f64],
    outside: Outside<'a>,
    /// Longest step, s.
    step: f64,
}

/// State with derivatives, and the room that integration needs. Rows of `columns` derivatives
/// follow the state: q (n), v (n), ∂q (n rows), ∂v (n rows).
#[derive(Clone, Debug)]
pub struct Work {
    n: usize,
    columns: usize,
    /// Column in which the parameters' derivatives begin, if they are wanted.
    first_parameter: Option<usize>,
    y: Vec<f64>,
    next: Vec<f64>,
    k: [Vec<f64>; 7],
    partials: Vec<f64>,
    inputs: Vec<f64>,
    modes: Vec<Mode>,
    signs: Vec<f64>,
    accel: [Vec<f64>; 3],
    sample: Vec<f64>,
}

impl Work {
    /// Room for a system with `columns` derivatives; `first_parameter` as in [`Work::set`].
    fn new<D: Dynamics + ?Sized>(dynamics: &D, columns: usize, first_parameter: Option<usize>) -> Self {
        let (n, count) = (dynamics.degrees_of_freedom(), dynamics.parameter_count());
        let length = 2 * n * (1 + columns);
        let held = dynamics.held();
        let alone = first_parameter.is_none() && dynamics.takes_states_alone();
        Self {
            n,
            columns,
            first_parameter,
            y: vec![0.0; length],
            next: vec![0.0; length],
            k: core::array::from_fn(|_| vec![0.0; length]),
            partials: vec![0.0; n * (2 * n + if alone { 0 } else { count })],
            inputs: Vec::new(),
            modes: vec![Mode::Slides(1.0); held],
            signs: vec![0.0; held],
            accel: core::array::from_fn(|_| vec![0.0; n]),
            sample: vec![0.0; n * (1 + columns)],
        }
    }

    /// Room for the state alone.
    pub fn plain<D: Dynamics + ?Sized>(dynamics: &D) -> Self {
        Self::new(dynamics, 0, None)
    }

    /// Room for the state and its derivatives by initial state (2n columns, q then v).
    pub fn by_state<D: Dynamics + ?Sized>(dynamics: &D) -> Self {
        Self::new(dynamics, 2 * dynamics.degrees_of_freedom(), None)
    }

    /// Room for the state and its derivatives by initial state and parameters (2n + P columns).
    pub fn by_all<D: Dynamics + ?Sized>(dynamics: &D) -> Self {
        let n = dynamics.degrees_of_freedom();
        Self::new(dynamics, 2 * n + dynamics.parameter_count(), Some(2 * n))
    }

    /// Room for the state and one tangent vector.
    pub fn tangent<D: Dynamics + ?Sized>(dynamics: &D) -> Self {
        Self::new(dynamics, 1, None)
    }

    /// Sets the state (q then v); derivatives by initial state become the identity, all others
    /// zero.
    pub fn set(&mut self, state: &[f64]) {
        let (n, w) = (self.n, self.columns);
        self.y.fill(0.0);
        self.y[..2 * n].copy_from_slice(&state[..2 * n]);
        for i in 0..(2 * n).min(w) {
            self.y[2 * n + i * w + i] = 1.0;
        }
    }

    /// State, q then v.
    pub fn state(&self) -> &[f64] {
        &self.y[..2 * self.n]
    }

    /// Derivatives of the state: 2n rows of the columns.
    pub fn derivatives(&self) -> &[f64] {
        &self.y[2 * self.n..]
    }

    /// Derivatives of the state, to be changed (tangent vectors made orthonormal).
    pub fn derivatives_mut(&mut self) -> &mut [f64] {
        &mut self.y[2 * self.n..]
    }
}

impl<'a, D: Dynamics + ?Sized> Flow<'a, D> {
    /// `step`: longest step, s.
    pub fn new(dynamics: &'a D, parameters: &'a [f64], outside: Outside<'a>, step: f64) -> Self {
        Self { dynamics, parameters, outside, step }
    }

    /// Carries the state from `start` over `duration` (s). False where the equations have no
    /// solution.
    pub fn carry(&self, work: &mut Work, start: f64, duration: f64) -> bool {
        self.samples(work, start, duration, 2, |_, _| {})
    }

    /// Carries the state over `count` samples `spacing` apart (s), the first at `start`, and shows
    /// each sample's coordinates (n) followed by their derivatives (n rows). The state is the last
    /// sample's then. False where the equations have no solution.
    pub fn samples(
        &self,
        work: &mut Work,
        start: f64,
        spacing: f64,
        count: usize,
        mut visit: impl FnMut(usize, &[f64]),
    ) -> bool {
        let (n, w) = (work.n, work.columns);
        if let Some(inputs) = self.outside.inputs {
            work.inputs.resize(inputs.count, 0.0);
        }
        self.initial_modes(work, start);
        work.sample[..n].copy_from_slice(&work.y[..n]);
        work.sample[n..].copy_from_slice(&work.y[2 * n..2 * n + n * w]);
        visit(0, &work.sample);
        if count < 2 {
            return true;
        }
        let length = (count - 1) as f64 * spacing;
        let steps = (length / self.step - 1e-9).ceil().max(1.0);
        let h = length / steps;
        let corners = self.dynamics.held() - self.dynamics.corners().len();
        let mut shown = 1;
        let mut fresh = false;
        for step in 0..steps as usize {
            let end = if step + 1 == steps as usize { length } else { (step + 1) as f64 * h };
            let mut t = step as f64 * h;
            let mut events = 0;
            loop {
                if !fresh && !self.rates(work, start + t, 0) {
                    return false;
                }
                let left = end - t;
                if !self.attempt(work, start + t, left) {
                    return false;
                }
                let event = if work.modes.is_empty() { None } else { self.event(work, start + t, left) };
                // What comes to rest about a corner passes it without end.
                let event = event.filter(|e| events < MOST_EVENTS || e.1 < corners);
                let taken = match event {
                    Some((share, _)) if share < 1.0 => {
                        if !self.attempt(work, start + t, share * left) {
                            return false;
                        }
                        share * left
                    }
                    _ => left,
                };
                let reached = if event.is_some_and(|e| e.0 < 1.0) { t + taken } else { end };
                while shown < count {
                    let at = shown as f64 * spacing;
                    if at > reached + 1e-9 * spacing && shown + 1 < count || (shown + 1 == count && reached < length) {
                        break;
                    }
                    if taken > 0.0 {
                        work.interpolate((at - t) / taken, taken);
                    } else {
                        work.sample[..n].copy_from_slice(&work.next[..n]);
                        work.sample[n..].copy_from_slice(&work.next[2 * n..2 * n + n * w]);
                    }
                    visit(shown, &work.sample);
                    shown += 1;
                }
                core::mem::swap(&mut work.y, &mut work.next);
                work.k.swap(0, 6);
                self.keep_stuck(work, start + reached);
                fresh = true;
                t = reached;
                if let Some((share, switch)) = event {
                    events += 1;
                    if events > MOST_EVENTS || !self.turn(work, start + t, switch) {
                        return false;
                    }
                    fresh = false;
                    if share < 1.0 {
                        continue;
                    }
                }
                break;
            }
        }
        true
    }

    fn instant<'b>(&self, time: f64, inputs: &'b mut [f64]) -> Instant<'b> {
        if let Some(i) = self.outside.inputs {
            (i.at)(time, inputs);
        }
        Instant { time, tau: self.outside.tau + self.outside.omega * (time - self.outside.origin), inputs }
    }

    /// Rates of the state with its derivatives into stage `k`, from `next` (stages 1 to 6) or from
    /// the state (stage 0).
    fn rates(&self, work: &mut Work, time: f64, k: usize) -> bool {
        let (n, w) = (work.n, work.columns);
        let Work { y, next, k: stages, partials, inputs, modes, signs, accel, first_parameter, .. } = work;
        let y: &[f64] = if k == 0 { y } else { next };
        let out = &mut stages[k];
        let instant = self.instant(time, inputs);
        let (q, v) = y[..2 * n].split_at(n);
        let width = partials.len() / n.max(1);
        for (s, m) in signs.iter_mut().zip(modes.iter()) {
            *s = m.value();
        }
        // Sticking joints: the sign that keeps the rate zero, one joint after the other (the laws
        // are linear in each sign).
        let stuck = modes.contains(&Mode::Sticks);
        let here = Here { parameters: self.parameters, q, v, at: &instant, signs: &[] };
        let held = HeldSigns { flow: self, here };
        if stuck {
            for _ in 0..2 {
                for s in 0..modes.len() {
                    if modes[s] == Mode::Sticks && !held.solve(signs, s, accel) {
                        return false;
                    }
                }
            }
        }
        let (head, tail) = out.split_at_mut(2 * n);
        head[..n].copy_from_slice(v);
        if w == 0 {
            return self.dynamics.acceleration_held(Here { signs, ..here }, &mut head[n..]);
        }
        let both = Linearisation { acceleration: &mut head[n..], partials };
        if !self.dynamics.linearise_held(Here { signs, ..here }, both) {
            return false;
        }
        if stuck {
            for s in 0..modes.len() {
                if modes[s] == Mode::Sticks && !held.constrain(partials, signs, s, accel) {
                    return false;
                }
            }
        }
        let (dq, dv) = y[2 * n..].split_at(n * w);
        let (out_q, out_v) = tail.split_at_mut(n * w);
        out_q.copy_from_slice(dv);
        for (i, row) in out_v.chunks_exact_mut(w).enumerate() {
            let a = &partials[i * width..(i + 1) * width];
            match first_parameter {
                Some(first) => {
                    row[..*first].fill(0.0);
                    row[*first..].copy_from_slice(&a[2 * n..]);
                }
                None => row.fill(0.0),
            }
            for j in 0..n {
                let (by_q, by_v) = (a[j], a[n + j]);
                let (sq, sv) = (&dq[j * w..(j + 1) * w], &dv[j * w..(j + 1) * w]);
                for ((r, x), z) in row.iter_mut().zip(sq).zip(sv) {
                    *r += by_q * x + by_v * z;
                }
            }
        }
        true
    }

    /// One step of size h from the state (its rates in stage 0) to `next`, whose rates are in
    /// stage 6.
    fn attempt(&self, work: &mut Work, time: f64, h: f64) -> bool {
        for stage in 1..7 {
            let Work { y, next, k, .. } = work;
            let a = A[stage].map(|a| h * a);
            let [k0, k1, k2, k3, k4, k5, _] = k;
            let all = next.iter_mut().zip(y.iter()).zip(k0.iter());
            match stage {
                1 => all.for_each(|((o, y), k0)| *o = y + a[0] * k0),
                2 => all.zip(k1.iter()).for_each(|(((o, y), k0), k1)| *o = y + a[0] * k0 + a[1] * k1),
                3 => all
                    .zip(k1.iter().zip(k2.iter()))
                    .for_each(|(((o, y), k0), (k1, k2))| *o = y + a[0] * k0 + a[1] * k1 + a[2] * k2),
                4 => all
                    .zip(k1.iter().zip(k2.iter()).zip(k3.iter()))
                    .for_each(|(((o, y), k0), ((k1, k2), k3))| *o = y + a[0] * k0 + a[1] * k1 + a[2] * k2 + a[3] * k3),
                5 => all.zip(k1.iter().zip(k2.iter()).zip(k3.iter().zip(k4.iter()))).for_each(
                    |(((o, y), k0), ((k1, k2), (k3, k4)))| {
                        *o = y + a[0] * k0 + a[1] * k1 + a[2] * k2 + a[3] * k3 + a[4] * k4
                    },
                ),
                _ => all.zip(k2.iter().zip(k3.iter()).zip(k4.iter().zip(k5.iter()))).for_each(
                    |(((o, y), k0), ((k2, k3), (k4, k5)))| {
                        *o = y + a[0] * k0 + a[2] * k2 + a[3] * k3 + a[4] * k4 + a[5] * k5
                    },
                ),
            }
            if !self.rates(work, time + C[stage] * h, stage) {
                return false;
            }
        }
        work.next[..2 * work.n].iter().all(|x| x.is_finite())
    }
}

impl Work {
    /// Coordinates and their derivatives at share u of the step of size h, from both ends.
    fn interpolate(&mut self, u: f64, h: f64) {
        let (n, w) = (self.n, self.columns);
        let u = u.clamp(0.0, 1.0);
        let (u2, u3) = (u * u, u * u * u);
        let (u4, u5) = (u2 * u2, u2 * u3);
        let end = 10.0 * u3 - 15.0 * u4 + 6.0 * u5;
        let weights = [
            1.0 - end,
            h * (u - 6.0 * u3 + 8.0 * u4 - 3.0 * u5),
            0.5 * h * h * (u2 - 3.0 * u3 + 3.0 * u4 - u5),
            end,
            h * (-4.0 * u3 + 7.0 * u4 - 3.0 * u5),
            0.5 * h * h * (u3 - 2.0 * u4 + u5),
        ];
        let Self { y, next, k, sample, .. } = self;
        let [a, b, c, d, e, f] = weights;
        let mut part = |to: core::ops::Range<usize>, position: usize, rate: usize| {
            let len = to.len();
            let (q0, v0, a0) = (&y[position..position + len], &y[rate..rate + len], &k[0][rate..rate + len]);
            let (q1, v1, a1) = (&next[position..position + len], &next[rate..rate + len], &k[6][rate..rate + len]);
            for (i, s) in sample[to].iter_mut().enumerate() {
                *s = a * q0[i] + b * v0[i] + c * a0[i] + d * q1[i] + e * v1[i] + f * a1[i];
            }
        };
        part(0..n, 0, n);
        part(n..n + n * w, 2 * n, 2 * n + n * w);
    }
}

#[cfg(test)]
mod tests;

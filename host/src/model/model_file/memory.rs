//! States of effects that remember: dz_k/dt = r_k(x, v, z), followed along a motion that is known.
//!
//! Between two samples the coordinates are cubics (`course`). A step is the
//! exponential midpoint rule z ← z + h φ(h J) r with J = ∂r/∂z and φ(y) = (eʸ − 1)/y, at the place in
//! the middle of the step and its mean rate: exact for laws that are linear in z where the motion is even, and
//! stable however fast z settles (Dahl's law at a small presliding distance). Several states take
//! φ's rational form (1 − ½ h J + (h J)²/12) Δz = h r instead, whose error in the frequency of what
//! swings is (ω h)⁴/720. Where an argument of a sign or a size turns
//! within a sample it is cut finely, and where it turns. States begin at 0. Laws that are straight
//! lines in their states have rates and slopes at all steps at once (`affine`).

use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};

use super::affine::Affine;
pub use super::course::Course;
use super::course::STEPS;
use super::expression::{Expression, Function, Node, Symbol, number};
use super::tape::Tape;

/// Steps to a sample within which a sign turns; to others [`STEPS`].
const STEPS_AT_TURNS: usize = 16;

/// Laws of the rates of one or more states, over coordinates, rates and [`Symbol::State`].
#[derive(Debug)]
pub struct Memory {
    rates: Vec<Node>,
    /// Rates, their slopes by every state (row after row), then the arguments of signs and sizes.
    tape: OnceLock<Tape>,
}

impl PartialEq for Memory {
    fn eq(&self, other: &Self) -> bool {
        self.rates == other.rates
    }
}

/// Arguments of signs and sizes in an expression.
fn turning(n: &Node, into: &mut Vec<Node>) {
    match &**n {
        Expression::Call(Function::Sign | Function::Abs, a) if !into.contains(a) => into.push(a.clone()),
        Expression::Call(_, a) | Expression::PowerWhole(a, _) => turning(a, into),
        Expression::Add(a, b)
        | Expression::Subtract(a, b)
        | Expression::Multiply(a, b)
        | Expression::Divide(a, b)
        | Expression::Power(a, b) => {
            turning(a, into);
            turning(b, into);
        }
        _ => {}
    }
}

impl Memory {
    /// States with these rates.
    pub fn new(rates: Vec<Node>) -> Self {
        Self { rates, tape: OnceLock::new() }
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.rates.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.rates.is_empty()
    }

    /// The laws of the rates.
    pub fn rates(&self) -> &[Node] {
        &self.rates
    }

    fn tape(&self) -> &Tape {
        self.tape.get_or_init(|| {
            let m = self.len();
            let slope =
                |r: &Node, k: usize| r.derivative_between_jumps(Symbol::State(k)).unwrap_or_else(|| number(f64::NAN));
            let mut all = self.rates.clone();
            all.extend(self.rates.iter().flat_map(|r| (0..m).map(move |k| slope(r, k))));
            let mut turns = Vec::new();
            self.rates.iter().for_each(|r| turning(r, &mut turns));
            Tape::new(&[all, turns].concat())
        })
    }

    /// Whether rates are straight lines in the states, and nothing turns where a state does.
    fn is_affine(&self) -> bool {
        let of_state = |s: Symbol| matches!(s, Symbol::State(_));
        let mut turns = Vec::new();
        self.rates.iter().for_each(|r| turning(r, &mut turns));
        let slopes =
            self.rates.iter().flat_map(|r| (0..self.len()).map(move |k| r.derivative_between_jumps(Symbol::State(k))));
        !turns.iter().any(|a| a.any(&of_state)) && slopes.into_iter().all(|s| s.is_some_and(|s| !s.any(&of_state)))
    }

    /// The shortest time in which a state settles where nothing moves, s; infinite where none
    /// settles by itself.
    pub fn settles_s(&self) -> f64 {
        let (tape, m) = (self.tape(), self.len());
        let mut out = vec![0.0; tape.len()];
        tape.at(&vec![0.0; tape.symbols().len()], &mut Vec::new(), &mut out);
        (0..m).map(|k| out[m + k * m + k]).filter(|j| *j < 0.0).map(|j| -1.0 / j).fold(f64::INFINITY, f64::min)
    }

    /// Every state at every sample of a motion, from 0 on; none where one leaves the finite
    /// numbers.
    pub fn follow(&self, course: &Course) -> Option<Vec<Vec<f64>>> {
        let m = self.len();
        let count = course.len();
        let mut walk = Walk {
            memory: self,
            course,
            values: vec![0.0; self.tape().symbols().len()],
            registers: Vec::new(),
            out: vec![0.0; self.tape().len()],
        };
        let affine = self.is_affine().then(|| Affine::new(self.tape(), m, course));
        let mut z = vec![0.0; m];
        let mut all = vec![Vec::with_capacity(count); m];
        let turns = m + m * m..self.tape().len();
        let mut before: Vec<f64> = Vec::new();
        for i in 0..count {
            all.iter_mut().zip(&z).for_each(|(to, z)| to.push(*z));
            if i + 1 == count {
                break;
            }
            let turned = match &affine {
                Some(affine) => affine.turned[i],
                None => {
                    if i == 0 {
                        walk.evaluate(0, [0.0; 2], &z);
                        before = walk.out[turns.clone()].to_vec();
                    }
                    walk.evaluate(i, [1.0; 2], &z);
                    let turned = walk.out[turns.clone()].iter().zip(&before).any(|(a, b)| a * b <= 0.0);
                    before.copy_from_slice(&walk.out[turns.clone()]);
                    turned
                }
            };
            let steps = if turned { STEPS_AT_TURNS } else { STEPS };
            for j in 0..steps {
                let part = [j, j + 1].map(|k| k as f64 / steps as f64);
                match &affine {
                    _ if turned => walk.cut(i, part, &mut z),
                    Some(affine) => {
                        affine.evaluate(i * STEPS + j, &z, &mut walk.out);
                        walk.step((part[1] - part[0]) * course.step_s(), &mut z);
                    }
                    None => walk.go(i, part, &mut z),
                }
            }
            if !z.iter().all(|z| z.is_finite()) {
                return None;
            }
        }
        Some(all)
    }
}

/// One way along a motion.
struct Walk<'a> {
    memory: &'a Memory,
    course: &'a Course,
    values: Vec<f64>,
    registers: Vec<f64>,
    out: Vec<f64>,
}

impl Walk<'_> {
    /// Everything on the tape over a part of the way from sample `i` to the next.
    fn evaluate(&mut self, i: usize, part: [f64; 2], z: &[f64]) {
        let tape = self.memory.tape();
        for (to, s) in self.values.iter_mut().zip(tape.symbols()) {
            *to = match *s {
                Symbol::State(k) => z[k],
                s => self.course.over(s, i, part),
            };
        }
        tape.at(&self.values, &mut self.registers, &mut self.out);
    }

    /// One step over a part of the way from sample `i` to the next.
    fn go(&mut self, i: usize, [from, to]: [f64; 2], z: &mut [f64]) {
        self.evaluate(i, [from, to], z);
        self.step((to - from) * self.course.step_s(), z);
    }

    /// The same in two, where an argument of a sign or a size turns: a state that is taken along from
    /// there on (play) is else ahead by what the motion makes of half a step.
    fn cut(&mut self, i: usize, [from, to]: [f64; 2], z: &mut [f64]) {
        let start = z.to_vec();
        let first = z.len() + z.len() * z.len();
        self.evaluate(i, [from, from], z);
        let before = self.out[first..].to_vec();
        self.go(i, [from, to], z);
        self.evaluate(i, [to, to], z);
        let turns = before.iter().zip(&self.out[first..]).filter(|(a, b)| *a * *b < 0.0);
        let share = turns.map(|(a, b)| a / (a - b)).fold(1.0, f64::min);
        if share < 1.0 {
            z.copy_from_slice(&start);
            let at = from + share * (to - from);
            self.go(i, [from, at], z);
            self.go(i, [at, to], z);
        }
    }

    /// One step from the rates and slopes last evaluated.
    fn step(&self, h: f64, z: &mut [f64]) {
        let m = z.len();
        if let [z] = z {
            let y = h * self.out[1];
            // φ(y), whose series begins with 1.
            let phi = if y.abs() < 1e-8 { 1.0 } else { y.exp_m1() / y };
            *z += h * self.out[0] * phi;
            return;
        }
        if let [z0, z1] = z {
            let h = |k: usize| h * self.out[k];
            let half = [[0.5 * h(2), 0.5 * h(3)], [0.5 * h(4), 0.5 * h(5)]];
            // (h J)²/12 = (½ h J)²/3.
            let square = |i: usize, j: usize| half[i][0] * half[0][j] + half[i][1] * half[1][j];
            let of = |i: usize, j: usize| f64::from(u8::from(i == j)) - half[i][j] + square(i, j) / 3.0;
            let [[a, b], [c, d]] = [[of(0, 0), of(0, 1)], [of(1, 0), of(1, 1)]];
            let determinant = a * d - b * c;
            *z0 += (d * h(0) - b * h(1)) / determinant;
            *z1 += (a * h(1) - c * h(0)) / determinant;
            return;
        }
        let slopes = DMatrix::from_fn(m, m, |i, j| h * self.out[m + i * m + j]);
        let slopes = DMatrix::identity(m, m) - 0.5 * &slopes + &slopes * &slopes / 12.0;
        let rates = DVector::from_iterator(m, self.out[..m].iter().map(|r| h * r));
        match slopes.lu().solve(&rates) {
            Some(step) => z.iter_mut().zip(step.iter()).for_each(|(z, d)| *z += d),
            None => z.fill(f64::NAN),
        }
    }
}

#[cfg(test)]
#[path = "memory_tests.rs"]
mod tests;

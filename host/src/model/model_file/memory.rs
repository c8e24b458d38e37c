//! States of effects that remember: dz_k/dt = r_k(x, v, z), followed along a motion that is known.
//!
//! Between two samples the coordinates are parabolas and the rates straight lines. A step is the
//! exponential midpoint rule z ← z + h φ(h J) r with J = ∂r/∂z and φ(y) = (eʸ − 1)/y, at the motion
//! in the middle of the step: exact for laws that are linear in z where the motion is even, and
//! stable however fast z settles (Dahl's law at a small presliding distance). Several states take
//! φ's rational form (1 − ½ h J + (h J)²/12) Δz = h r instead, whose error in the frequency of what
//! swings is (ω h)⁴/720. Where an argument of a sign or a size turns
//! within a sample it is cut finely, and where it turns. States begin at 0.

use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};

use super::equations_of_motion::wrapped;
use super::expression::{Expression, Function, Node, Symbol, number};
use super::tape::Tape;

/// Steps to a sample, and to one within which a sign turns.
const STEPS: usize = 2;
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

/// A motion at even times.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    /// Coordinates, unwrapped.
    pub coordinates: &'a [Vec<f64>],
    /// Their rates a second.
    pub rates: &'a [Vec<f64>],
    /// Spacing, s.
    pub step_s: f64,
    /// Whether each coordinate lies on a circle.
    pub circle: &'a [bool],
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
    pub fn follow(&self, course: &Course<'_>) -> Option<Vec<Vec<f64>>> {
        let m = self.len();
        let count = course.coordinates.first().map_or(0, Vec::len);
        let mut walk = Walk {
            memory: self,
            course,
            values: vec![0.0; self.tape().symbols().len()],
            registers: Vec::new(),
            out: vec![0.0; self.tape().len()],
        };
        let mut z = vec![0.0; m];
        let mut all = vec![Vec::with_capacity(count); m];
        let turns = m + m * m..self.tape().len();
        let mut before: Vec<f64> = Vec::new();
        for i in 0..count {
            all.iter_mut().zip(&z).for_each(|(to, z)| to.push(*z));
            if i + 1 == count {
                break;
            }
            if i == 0 {
                walk.evaluate(0, 0.0, &z);
                before = walk.out[turns.clone()].to_vec();
            }
            walk.evaluate(i, 1.0, &z);
            let turned = walk.out[turns.clone()].iter().zip(&before).any(|(a, b)| a * b <= 0.0);
            before.copy_from_slice(&walk.out[turns.clone()]);
            let steps = if turned { STEPS_AT_TURNS } else { STEPS };
            for j in 0..steps {
                let part = [j, j + 1].map(|k| k as f64 / steps as f64);
                if turned { walk.cut(i, part, &mut z) } else { walk.go(i, part, &mut z) }
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
    course: &'a Course<'a>,
    values: Vec<f64>,
    registers: Vec<f64>,
    out: Vec<f64>,
}

impl Walk<'_> {
    /// Everything on the tape at a share of the way from sample `i` to the next.
    fn evaluate(&mut self, i: usize, share: f64, z: &[f64]) {
        let c = self.course;
        let tape = self.memory.tape();
        let line = |x: &[f64]| x[i] + share * (x[i + 1] - x[i]);
        for (to, s) in self.values.iter_mut().zip(tape.symbols()) {
            *to = match *s {
                Symbol::Rate(k) => line(&c.rates[k]),
                Symbol::Coordinate(k) => {
                    // The parabola of the rates' mean slope, through both samples.
                    let bend = 0.5 * c.step_s * (c.rates[k][i + 1] - c.rates[k][i]);
                    let x = line(&c.coordinates[k]) - bend * share * (1.0 - share);
                    if c.circle[k] { wrapped(x) } else { x }
                }
                Symbol::State(k) => z[k],
                _ => f64::NAN,
            };
        }
        tape.at(&self.values, &mut self.registers, &mut self.out);
    }

    /// One step over a part of the way from sample `i` to the next.
    fn go(&mut self, i: usize, [from, to]: [f64; 2], z: &mut [f64]) {
        self.evaluate(i, 0.5 * (from + to), z);
        self.step((to - from) * self.course.step_s, z);
    }

    /// The same in two, where an argument of a sign or a size turns: a state that is taken along from
    /// there on (play) is else ahead by what the motion makes of half a step.
    fn cut(&mut self, i: usize, [from, to]: [f64; 2], z: &mut [f64]) {
        let start = z.to_vec();
        let first = z.len() + z.len() * z.len();
        self.evaluate(i, from, z);
        let before = self.out[first..].to_vec();
        self.go(i, [from, to], z);
        self.evaluate(i, to, z);
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
mod tests {
    use super::super::expression::{add, call, divide, multiply, subtract, symbol};
    use super::*;

    /// (v − |v| z)/d.
    fn dahl(d: f64) -> Memory {
        let (v, z) = (symbol(Symbol::Rate(0)), symbol(Symbol::State(0)));
        Memory::new(vec![divide(subtract(v.clone(), multiply(call(Function::Abs, v), z)), number(d))])
    }

    fn swing(count: usize, step_s: f64) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let at = |i: usize| 3.0 * i as f64 * step_s;
        let x = (0..count).map(|i| at(i).sin()).collect();
        let v = (0..count).map(|i| 3.0 * at(i).cos()).collect();
        (vec![x], vec![v])
    }

    /// Dahl's law has the closed solution z = s − (s − z₀) exp(−|x − x₀|/d) from one reversal to
    /// the next.
    #[test]
    fn dahls_friction_follows_its_closed_solution_however_stiff() {
        let step_s = 0.005;
        let (x, v) = swing(2000, step_s);
        let course = Course { coordinates: &x, rates: &v, step_s, circle: &[false] };
        for (d, most) in [(0.3, 1e-4), (0.02, 1e-4), (1e-6, 1e-9)] {
            let z = dahl(d).follow(&course).unwrap().remove(0);
            let (mut from, mut start, mut sign) = (x[0][0], 0.0, 1.0);
            for i in 0..2000 {
                if v[0][i] * sign < 0.0 {
                    // The reversal lies at ± 1.
                    start = sign - (sign - start) * (-(sign - from) * sign / d).exp();
                    (from, sign) = (sign, -sign);
                }
                let expected = sign - (sign - start) * (-(x[0][i] - from) * sign / d).exp();
                let near = (x[0][i].abs() - 1.0).abs() < 2e-4;
                assert!((z[i] - expected).abs() < if near { 0.2 } else { most }, "{d} {i}: {} {expected}", z[i]);
            }
        }
    }

    /// Play of 0.2 under sin 3t: z stands for 0.4 of the way after a reversal, then follows 0.2 behind.
    #[test]
    fn play_follows_at_its_distance_from_where_it_is_taken_along() {
        let (x, v, z) = (symbol(Symbol::Coordinate(0)), symbol(Symbol::Rate(0)), symbol(Symbol::State(0)));
        let sign = |a: Node| call(Function::Sign, a);
        let over = subtract(multiply(sign(v.clone()), subtract(x, z)), number(0.2));
        let law = multiply(v, multiply(number(0.5), add(number(1.0), sign(over))));
        let step_s = 0.005;
        let (x, v) = swing(2000, step_s);
        let course = Course { coordinates: &x, rates: &v, step_s, circle: &[false] };
        let z = Memory::new(vec![law]).follow(&course).unwrap().remove(0);
        let mut expected = 0.0_f64;
        for (i, z) in z.iter().enumerate() {
            expected = expected.clamp(x[0][i] - 0.2, x[0][i] + 0.2);
            // A sample is 0.015 of the way, a sixteenth of it 9e-4.
            assert!((z - expected).abs() < 4e-5, "{i}: {z} {expected}");
        }
    }

    /// z′ = v − z/T is a high-pass of the position; fast ones settle at T v.
    #[test]
    fn relaxation_is_a_high_pass() {
        let law = |t: f64| {
            Memory::new(vec![subtract(symbol(Symbol::Rate(0)), multiply(number(1.0 / t), symbol(Symbol::State(0))))])
        };
        assert!((law(0.2).settles_s() - 0.2).abs() < 1e-15 && dahl(0.1).settles_s().is_infinite());
        let (x, v) = swing(4000, 0.005);
        let course = Course { coordinates: &x, rates: &v, step_s: 0.005, circle: &[false] };
        for t in [0.2, 1e-5] {
            let z = law(t).follow(&course).unwrap().remove(0);
            for i in 3000..4000 {
                let a = 0.015 * i as f64;
                let w = 3.0 * t;
                let expected = (w * w * a.sin() + w * a.cos()) / (1.0 + w * w);
                assert!((z[i] - expected).abs() < 2e-4 * w.max(0.01), "{t} {i}: {} {expected}", z[i]);
            }
        }
    }

    /// Two states that swing, and one that runs away.
    #[test]
    fn several_states_swing_and_what_runs_away_is_refused() {
        let z = |k| symbol(Symbol::State(k));
        let two = Memory::new(vec![z(1), add(multiply(number(-400.0), z(0)), symbol(Symbol::Rate(0)))]);
        let (x, v) = swing(1000, 0.005);
        let course = Course { coordinates: &x, rates: &v, step_s: 0.005, circle: &[false] };
        let out = two.follow(&course).unwrap();
        // z″ + 400 z = 3 cos 3t from rest.
        for i in 0..1000 {
            let t = 0.005 * i as f64;
            let expected = 3.0 / 391.0 * ((3.0 * t).cos() - (20.0 * t).cos());
            assert!((out[0][i] - expected).abs() < 1e-5, "{i}: {} {expected}", out[0][i]);
        }
        assert!(Memory::new(vec![add(number(1.0), multiply(number(1e4), z(0)))]).follow(&course).is_none());
    }

    /// Followed with the motion, a state is what it is along the motion that was found.
    #[test]
    fn a_state_followed_with_the_motion_is_that_along_it() {
        use super::super::ModelFile;
        use super::super::equations_of_motion::EquationsOfMotion;
        use super::super::expression::Expression;
        use crate::model::integrate::{Outside, Settings, solve};
        struct Nothing;
        impl Outside for Nothing {
            fn tau(&self, _: f64) -> f64 {
                0.0
            }
            fn inputs(&self, _: f64, _: &mut [f64]) {}
        }
        let text = "name = \"m\"\ncoordinates = [{ name = \"x\", space = \"R\" }]\n\
            [[equation]]\nbalance = \"-x''\"\nterms = { k = \"x\" }\n";
        let model = ModelFile::parse(text, std::path::Path::new("m.toml")).unwrap();
        let state = std::sync::Arc::new(Expression::Memory(std::sync::Arc::new(dahl(0.05)), 0));
        let terms = [(0, "F".to_owned(), state)];
        let motion = EquationsOfMotion::with_columns(&model, 1.0, &terms).unwrap();
        assert_eq!(motion.hidden().len(), 1);
        let step_s = 0.005;
        let settings = Settings { start_s: 0.0, step_s, count: 1000, tolerance: 1e-10, inputs: 0, finest: 400.0 };
        let initial = motion.with_states(&[1.0, 0.0], &[]);
        let all = solve(&motion, &[9.0, 1.2], &initial, &Nothing, &settings).unwrap();
        let column = |k: usize| vec![all.iter().map(|y| y[k]).collect::<Vec<f64>>()];
        let course = Course { coordinates: &column(0), rates: &column(2), step_s, circle: &[false] };
        let z = dahl(0.05).follow(&course).unwrap().remove(0);
        for (i, y) in all.iter().enumerate() {
            // y holds x, what nothing depends on, v, z.
            assert!((y[3] - z[i]).abs() < 2e-3, "{i}: {y:?} {}", z[i]);
        }
        let size = |from: usize| all[from..].iter().fold(0.0_f64, |m, y| m.max(y[0].abs()));
        assert!(size(800) < 0.6 * size(0), "friction takes energy away");
    }
}

//! Expressions compiled to a list of operations over blocks of samples, common parts computed once.
//!
//! A block of `BLOCK` samples stays in the first-level cache; every operation is a loop over it.
//! Sine and cosine of the same argument are computed together. The sign and the absolute value of a
//! quantity are their means over one sampling step, [`mean_sign`] and [`mean_abs`], from the change
//! between neighbouring samples, so blocks are computed with one more sample on either side where
//! there is one. Of points that are no neighbours they are those of the point itself.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use pulp::{Arch, NullaryFnOnce};

use super::expression::{Expression as E, Function, Node, Symbol, hat};
use crate::model::weak::{mean_abs, mean_sign};
use crate::signal::sin_cos::sin_cos;

/// Samples of a block.
const BLOCK: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Operation {
    Number(f64),
    /// Column of the inputs.
    Load(usize),
    Add(usize, usize),
    Subtract(usize, usize),
    Multiply(usize, usize),
    Divide(usize, usize),
    Power(usize, usize),
    PowerWhole(usize, i32),
    /// Sine of one into the register itself, cosine into the next.
    SinCos(usize),
    /// The second result of the operation before.
    Second,
    Call(Function, usize),
    Hat(usize, f64, Option<f64>),
}

/// Most points of [`Tape::over`]: the registers of a hundred operations stay in the first-level
/// cache.
pub const ABREAST: usize = 32;
/// Most points of [`Tape::among`], neighbours included: the registers of a thousand operations stay
/// in the second-level cache.
const MOST: usize = 40;

/// Room for [`Tape::over`] and [`Tape::among`], and what they found.
#[derive(Clone, Debug, Default)]
pub struct Registers {
    values: Vec<f64>,
    /// Points of a register.
    stride: usize,
}

impl Registers {
    fn room(&mut self, operations: usize, stride: usize) -> &mut [f64] {
        self.values.resize(operations * stride, 0.0);
        self.stride = stride;
        &mut self.values
    }
}

/// Several expressions as one list of operations.
#[derive(Clone, Debug)]
pub struct Tape {
    operations: Vec<Operation>,
    /// Register of each expression.
    outputs: Vec<usize>,
    /// Symbols that are columns of the input, in their order.
    symbols: Vec<Symbol>,
    /// Neighbours on either side that matter.
    halo: usize,
}

#[derive(Default)]
struct Builder {
    operations: Vec<Operation>,
    symbols: Vec<Symbol>,
    /// Registers by operation, for common parts.
    known: HashMap<(u8, u64, u64, u64), usize>,
    /// Registers by node.
    nodes: HashMap<*const E, usize>,
}

impl Builder {
    fn push(&mut self, key: (u8, u64, u64, u64), operation: Operation) -> usize {
        if let Some(&r) = self.known.get(&key) {
            return r;
        }
        self.operations.push(operation);
        self.known.insert(key, self.operations.len() - 1);
        self.operations.len() - 1
    }

    fn symbol(&mut self, s: Symbol) -> usize {
        let column = self.symbols.iter().position(|x| *x == s).unwrap_or_else(|| {
            self.symbols.push(s);
            self.symbols.len() - 1
        });
        self.push((1, column as u64, 0, 0), Operation::Load(column))
    }

    fn node(&mut self, e: &Node) -> usize {
        if let Some(&r) = self.nodes.get(&Arc::as_ptr(e)) {
            return r;
        }
        let mut two = |tag: u8, a: &Node, b: &Node, f: fn(usize, usize) -> Operation| {
            let (a, b) = (self.node(a), self.node(b));
            self.push((tag, a as u64, b as u64, 0), f(a, b))
        };
        let r = match &**e {
            E::Number(x) => self.push((0, x.to_bits(), 0, 0), Operation::Number(*x)),
            E::Symbol(s) => self.symbol(*s),
            // A state that nothing follows has no value: never one that is silently wrong.
            E::Memory(..) => self.push((0, f64::NAN.to_bits(), 0, 0), Operation::Number(f64::NAN)),
            E::Add(a, b) => two(2, a, b, Operation::Add),
            E::Subtract(a, b) => two(3, a, b, Operation::Subtract),
            E::Multiply(a, b) => two(4, a, b, Operation::Multiply),
            E::Divide(a, b) => two(5, a, b, Operation::Divide),
            E::Power(a, b) => two(6, a, b, Operation::Power),
            E::PowerWhole(a, n) => {
                let a = self.node(a);
                self.push((7, a as u64, i64::from(*n) as u64, 0), Operation::PowerWhole(a, *n))
            }
            E::Call(f @ (Function::Sin | Function::Cos), a) => {
                let a = self.node(a);
                let sin = self.push((8, a as u64, 0, 0), Operation::SinCos(a));
                if sin + 1 == self.operations.len() {
                    self.operations.push(Operation::Second);
                }
                if *f == Function::Sin { sin } else { sin + 1 }
            }
            E::Call(f, a) => {
                let a = self.node(a);
                self.push((9, a as u64, *f as u64, 0), Operation::Call(*f, a))
            }
            E::Hat { from_node, width, period } => {
                let a = self.node(from_node);
                let p = period.unwrap_or(0.0);
                self.push((10, a as u64, width.to_bits(), p.to_bits()), Operation::Hat(a, *width, *period))
            }
        };
        self.nodes.insert(Arc::as_ptr(e), r);
        r
    }
}

impl Tape {
    /// Compiles expressions.
    pub fn new(expressions: &[Node]) -> Self {
        let mut b = Builder::default();
        let outputs = expressions.iter().map(|e| b.node(e)).collect();
        let averaged = |o: &Operation| matches!(o, Operation::Call(Function::Sign | Function::Abs, _));
        let halo = usize::from(b.operations.iter().any(averaged));
        Self { operations: b.operations, outputs, symbols: b.symbols, halo }
    }

    /// Symbols that the columns of [`Tape::run`] stand for, in their order.
    pub fn symbols(&self) -> &[Symbol] {
        &self.symbols
    }

    /// Number of expressions.
    pub fn len(&self) -> usize {
        self.outputs.len()
    }

    /// Whether there is no expression.
    pub fn is_empty(&self) -> bool {
        self.outputs.is_empty()
    }

    /// Values of every expression at every sample; `columns` in the order of [`Tape::symbols`], of
    /// `count` samples each.
    pub fn run(&self, columns: &[&[f64]], count: usize) -> Vec<Vec<f64>> {
        let mut out = vec![vec![0.0; count]; self.outputs.len()];
        let mut registers = vec![0.0; self.operations.len() * (BLOCK + 2)];
        for start in (0..count).step_by(BLOCK) {
            let end = (start + BLOCK).min(count);
            let (from, to) = (start.saturating_sub(self.halo), (end + self.halo).min(count));
            self.block::<{ BLOCK + 2 }>(columns, from..to, true, &mut registers);
            for (out, &r) in out.iter_mut().zip(&self.outputs) {
                let at = r * (BLOCK + 2);
                out[start..end].copy_from_slice(&registers[at + start - from..at + end - from]);
            }
        }
        out
    }

    /// Values of every expression at `count` points that are no neighbours, [`ABREAST`] at most:
    /// [`Tape::output`] shows them.
    pub fn over(&self, columns: &[&[f64]], count: usize, registers: &mut Registers) {
        self.block::<ABREAST>(columns, 0..count, false, registers.room(self.operations.len(), ABREAST));
    }

    /// Values of every expression at a range of `count` points, two fewer than 40 at most, with
    /// their neighbours where these matter: [`Tape::output`] shows them from the place that is
    /// returned.
    pub fn among(&self, columns: &[&[f64]], points: Range<usize>, count: usize, registers: &mut Registers) -> usize {
        let (from, to) = (points.start.saturating_sub(self.halo), (points.end + self.halo).min(count));
        self.block::<MOST>(columns, from..to, true, registers.room(self.operations.len(), MOST));
        points.start - from
    }

    /// What an expression came out as at every point of [`Tape::over`].
    pub fn output<'a>(&self, k: usize, registers: &'a Registers) -> &'a [f64] {
        &registers.values[self.outputs[k] * registers.stride..(self.outputs[k] + 1) * registers.stride]
    }

    fn block<const STRIDE: usize>(
        &self,
        columns: &[&[f64]],
        points: Range<usize>,
        neighbours: bool,
        registers: &mut [f64],
    ) {
        Arch::new().dispatch(Block::<STRIDE> { operations: &self.operations, columns, points, neighbours, registers });
    }

    /// Values of every expression at one point (signs are plain signs). `values` has one entry for
    /// each of [`Tape::symbols`]; `registers` is scratch.
    pub fn at(&self, values: &[f64], registers: &mut Vec<f64>, out: &mut [f64]) {
        registers.clear();
        let mut second = 0.0;
        for operation in &self.operations {
            let r = &*registers;
            let value = match *operation {
                Operation::Number(x) => x,
                Operation::Load(c) => values[c],
                Operation::Add(a, b) => r[a] + r[b],
                Operation::Subtract(a, b) => r[a] - r[b],
                Operation::Multiply(a, b) => r[a] * r[b],
                Operation::Divide(a, b) => r[a] / r[b],
                Operation::Power(a, b) => r[a].powf(r[b]),
                Operation::PowerWhole(a, n) => r[a].powi(n),
                Operation::SinCos(a) => {
                    let (sin, cos) = r[a].sin_cos();
                    second = cos;
                    sin
                }
                Operation::Second => second,
                Operation::Call(f, a) => f.value(r[a]),
                Operation::Hat(a, width, period) => hat(r[a], width, period),
            };
            registers.push(value);
        }
        out.iter_mut().zip(&self.outputs).for_each(|(o, &r)| *o = registers[r]);
    }
}

/// A block of samples or points, every operation over all of them; compiled for each kind of
/// vectors that processors have (pulp).
struct Block<'a, const STRIDE: usize> {
    operations: &'a [Operation],
    columns: &'a [&'a [f64]],
    points: Range<usize>,
    /// Whether each point is a sampling step from the one before it.
    neighbours: bool,
    registers: &'a mut [f64],
}

impl<const STRIDE: usize> NullaryFnOnce for Block<'_, STRIDE> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { operations, columns, points, neighbours, registers } = self;
        let n = points.len();
        for (k, operation) in operations.iter().enumerate() {
            let (before, rest) = registers.split_at_mut(k * STRIDE);
            let (own, after) = rest.split_at_mut(STRIDE);
            let out = &mut own[..n];
            let get = |r: usize| &before[r * STRIDE..r * STRIDE + n];
            macro_rules! each {
                ($a:expr, $f:expr) => {
                    out.iter_mut().zip(get($a)).for_each(|(o, &a)| *o = $f(a))
                };
                ($a:expr, $b:expr, $f:expr) => {
                    out.iter_mut().zip(get($a)).zip(get($b)).for_each(|((o, &a), &b)| *o = $f(a, b))
                };
            }
            match *operation {
                Operation::Number(x) => out.fill(x),
                Operation::Load(c) => out.copy_from_slice(&columns[c][points.clone()]),
                Operation::Add(a, b) => each!(a, b, |a: f64, b: f64| a + b),
                Operation::Subtract(a, b) => each!(a, b, |a: f64, b: f64| a - b),
                Operation::Multiply(a, b) => each!(a, b, |a: f64, b: f64| a * b),
                Operation::Divide(a, b) => each!(a, b, |a: f64, b: f64| a / b),
                Operation::Power(a, b) => each!(a, b, f64::powf),
                Operation::PowerWhole(a, 2) => each!(a, |a: f64| a * a),
                Operation::PowerWhole(a, 3) => each!(a, |a: f64| a * a * a),
                Operation::PowerWhole(a, p) => each!(a, |a: f64| a.powi(p)),
                Operation::SinCos(a) => sin_cos(get(a), out, &mut after[..n]),
                Operation::Second => {}
                Operation::Call(Function::Sign, a) if neighbours => averaged(get(a), mean_sign, out),
                Operation::Call(Function::Abs, a) if neighbours => averaged(get(a), mean_abs, out),
                Operation::Call(Function::Abs, a) => each!(a, f64::abs),
                Operation::Call(f, a) => each!(a, |a: f64| f.value(a)),
                Operation::Hat(a, width, period) => each!(a, |a: f64| hat(a, width, period)),
            }
        }
    }
}

/// The mean over one sampling step, by the value of a point and the change to its neighbours.
#[inline(always)]
fn averaged(x: &[f64], mean: impl Fn(f64, f64) -> f64, out: &mut [f64]) {
    for (i, o) in out.iter_mut().enumerate() {
        let (b, f) = (i.saturating_sub(1), (i + 1).min(x.len() - 1));
        let step = if f > b { (x[f] - x[b]) / (f - b) as f64 } else { 0.0 };
        *o = mean(x[i], step);
    }
}

#[cfg(test)]
#[path = "tape_tests.rs"]
mod tests;

//! Laws of states' rates that are straight lines in the states, r = a(x, v) + J(x, v) z, along a
//! motion: a and J at every step at once, whatever the states come out as.

use super::expression::Symbol;
use super::memory::Course;
use super::tape::{ABREAST, Registers, Tape};

/// Rates and slopes along a motion.
pub(super) struct Affine {
    states: usize,
    /// Rates where all states are 0, then slopes row after row, for the middle of each step.
    rows: Vec<f64>,
    /// Whether an argument of a sign or a size turns between a sample and the next.
    pub turned: Vec<bool>,
}

impl Affine {
    /// Of a tape of rates, slopes, and what signs and sizes are taken of, in `steps` to a sample.
    pub fn new(tape: &Tape, states: usize, course: &Course<'_>, steps: usize) -> Self {
        let samples = course.coordinates.first().map_or(0, Vec::len).saturating_sub(1);
        let width = states + states * states;
        let step = |p: usize| (p / steps, [p % steps, p % steps + 1].map(|k| k as f64 / steps as f64));
        let rows = along(tape, 0..width, course, samples * steps, step);
        let turning = tape.len() - width;
        // At the last sample, the end of the way to it.
        let sample = |i: usize| if i < samples { (i, [0.0; 2]) } else { (samples - 1, [1.0; 2]) };
        // One sample alone has no way.
        let turns = if turning == 0 || samples == 0 {
            Vec::new()
        } else {
            along(tape, width..tape.len(), course, samples + 1, sample)
        };
        let turned = (0..samples)
            .map(|i| (0..turning).any(|k| turns[i * turning + k] * turns[(i + 1) * turning + k] <= 0.0))
            .collect();
        Self { states, rows, turned }
    }

    /// Rates, then slopes, at a step.
    pub fn evaluate(&self, step: usize, z: &[f64], out: &mut [f64]) {
        let m = self.states;
        let row = &self.rows[step * (m + m * m)..(step + 1) * (m + m * m)];
        out[..row.len()].copy_from_slice(row);
        for (to, slopes) in out[..m].iter_mut().zip(row[m..].chunks_exact(m)) {
            *to += slopes.iter().zip(z).map(|(j, z)| j * z).sum::<f64>();
        }
    }
}

/// Some of a tape's expressions over parts of a motion (sample, from where to where on the way to the
/// next) where all states are 0, part after part.
fn along(
    tape: &Tape,
    wanted: std::ops::Range<usize>,
    course: &Course<'_>,
    count: usize,
    part: impl Fn(usize) -> (usize, [f64; 2]),
) -> Vec<f64> {
    let mut out = vec![0.0; count * wanted.len()];
    let mut columns = vec![[0.0; ABREAST]; tape.symbols().len()];
    let mut registers = Registers::default();
    for (block, to) in out.chunks_mut(ABREAST * wanted.len()).enumerate() {
        let here = to.len() / wanted.len();
        for (column, symbol) in columns.iter_mut().zip(tape.symbols()) {
            for (lane, x) in column.iter_mut().enumerate().take(here) {
                let (sample, part) = part(block * ABREAST + lane);
                *x = if matches!(symbol, Symbol::State(_)) { 0.0 } else { course.over(*symbol, sample, part) };
            }
        }
        let inputs: Vec<&[f64]> = columns.iter().map(|c| &c[..here]).collect();
        tape.over(&inputs, here, &mut registers);
        for (k, expression) in wanted.clone().enumerate() {
            let values = &tape.output(expression, &registers)[..here];
            to.iter_mut().skip(k).step_by(wanted.len()).zip(values).for_each(|(to, x)| *to = *x);
        }
    }
    out
}

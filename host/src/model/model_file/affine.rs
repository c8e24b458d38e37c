//! Laws of states' rates that are straight lines in the states, r = a(x, v) + J(x, v) z, along a
//! motion: a and J at every step at once, whatever the states come out as.

use super::course::{Course, STEPS};
use super::expression::Symbol;
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
    /// Of a tape of rates, slopes, and what signs and sizes are taken of.
    pub fn new(tape: &Tape, states: usize, course: &Course) -> Self {
        let samples = course.len().saturating_sub(1);
        let width = states + states * states;
        let rows = along(tape, 0..width, samples * STEPS, |s| course.over_steps(s));
        let turning = tape.len() - width;
        // One sample alone has no way.
        let turns = if turning == 0 || samples == 0 {
            Vec::new()
        } else {
            along(tape, width..tape.len(), samples + 1, |s| course.at_samples(s))
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

/// Some of a tape's expressions where all states are 0, at `count` places of a motion at which it
/// tells what coordinates and rates are, place after place.
fn along<'a>(
    tape: &Tape,
    wanted: std::ops::Range<usize>,
    count: usize,
    motion: impl Fn(Symbol) -> Option<&'a [f64]>,
) -> Vec<f64> {
    let mut out = vec![0.0; count * wanted.len()];
    let (none, unknown) = (vec![0.0; count], vec![f64::NAN; count]);
    let of = |s: &Symbol| motion(*s).unwrap_or(if matches!(s, Symbol::State(_)) { &none } else { &unknown });
    let columns: Vec<&[f64]> = tape.symbols().iter().map(of).collect();
    let mut registers = Registers::default();
    for (block, to) in out.chunks_mut(ABREAST * wanted.len()).enumerate() {
        let here = to.len() / wanted.len();
        let inputs: Vec<&[f64]> = columns.iter().map(|c| &c[block * ABREAST..][..here]).collect();
        tape.over(&inputs, here, &mut registers);
        for (k, expression) in wanted.clone().enumerate() {
            let values = &tape.output(expression, &registers)[..here];
            to.iter_mut().skip(k).step_by(wanted.len()).zip(values).for_each(|(to, x)| *to = *x);
        }
    }
    out
}

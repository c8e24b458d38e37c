//! A model file's series over a stretch: low-passed coordinates, their slopes, inputs and phase
//! into the tape.
//!
//! Inputs pass through the same low-pass as the coordinates wherever they are part of a product,
//! and stand as measured where they are linear: either way they are taken as band-limited, nothing
//! is interpolated.

use std::ops::Range;

use super::windows::{Kernels, Stretches, step_at};
use crate::model::model_file::equations_of_motion::wrapped;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::weak_form::WeakForm;
use crate::signal::fast_convolution::{self as convolution, FastConvolution};

use super::stretches::Stretch;

/// Stretches with a model.
pub struct System<'a> {
    /// The stretches.
    pub stretches: &'a [Stretch],
    /// The model.
    pub weak: &'a WeakForm,
    /// The low-passes.
    pub kernels: &'a Kernels,
    /// Whether each coordinate lies on S1.
    pub circle: &'a [bool],
}

impl Stretches for System<'_> {
    fn count(&self) -> usize {
        self.stretches.len()
    }

    fn samples(&self, stretch: usize) -> usize {
        self.stretches[stretch].len()
    }

    fn step_s(&self, stretch: usize) -> f64 {
        self.stretches[stretch].step_s
    }

    fn time(&self, stretch: usize, sample: usize) -> f64 {
        self.stretches[stretch].time(sample)
    }

    fn evaluate(
        &self,
        stretch: usize,
        convolution: &FastConvolution,
        range: Range<usize>,
        work: &mut convolution::Work,
        series: &mut Vec<Vec<f64>>,
    ) {
        let s = &self.stretches[stretch];
        let reach = convolution.reach();
        let (from, to) = (range.start - reach, range.end + reach);
        let symbols = self.weak.tape.symbols();
        let n = s.coordinates.len();
        // Smoothed signals that some series needs: coordinates, then inputs; the convolution takes
        // them in pairs.
        let needed: Vec<usize> = (0..n + s.inputs.len())
            .filter(|&k| {
                symbols.iter().any(|x| match *x {
                    Symbol::Coordinate(i) | Symbol::Rate(i) | Symbol::ClearRate(i) | Symbol::Acceleration(i) => i == k,
                    Symbol::Input(i) | Symbol::InputRate(i) => n + i == k,
                    _ => false,
                })
            })
            .collect();
        let signal = |k: usize| if k < n { &s.coordinates[k][from..to] } else { &s.inputs[k - n][from..to] };
        let mut filtered: Vec<Option<[Vec<f64>; 3]>> = vec![None; n + s.inputs.len()];
        for pair in needed.chunks(2) {
            let second = pair.get(1).copied().unwrap_or(pair[0]);
            convolution.apply([signal(pair[0]), signal(second)], work);
            for (place, &k) in pair.iter().enumerate() {
                filtered[k] = Some([0, 1, 2].map(|output: usize| work.outputs[output][place].clone()));
            }
        }
        for (k, circle) in self.circle.iter().enumerate() {
            if let (true, Some(f)) = (circle, filtered[k].as_mut()) {
                f[0].iter_mut().for_each(|x| *x = wrapped(*x));
            }
        }
        let phase: Vec<f64> =
            if symbols.contains(&Symbol::Tau) { range.clone().map(|i| s.tau(i)).collect() } else { Vec::new() };
        let times: Vec<f64> =
            if symbols.contains(&Symbol::Time) { range.clone().map(|i| s.time(i)).collect() } else { Vec::new() };
        let remembered: Vec<Vec<f64>> = symbols
            .iter()
            .map(|x| if let Symbol::Memory(k) = *x { s.remembered(k, range.start, range.len()) } else { Vec::new() })
            .collect();
        let filtered = |k: usize, output: usize| filtered[k].as_ref().map_or(&[][..], |f| &f[output][..]);
        // Functions of accelerations, of effects only: by differences of the smoothed rates.
        let accelerations: Vec<Vec<f64>> = (0..n)
            .map(|i| {
                let rate = if symbols.contains(&Symbol::Acceleration(i)) { filtered(i, 1) } else { &[] };
                (0..rate.len()).map(|k| step_at(rate, k) / s.step_s).collect()
            })
            .collect();
        let columns: Vec<&[f64]> = symbols
            .iter()
            .zip(&remembered)
            .map(|(x, remembered)| match *x {
                Symbol::Coordinate(i) => filtered(i, 0),
                Symbol::Rate(i) => filtered(i, 1),
                Symbol::ClearRate(i) => filtered(i, 2),
                Symbol::Input(k) => filtered(n + k, 0),
                Symbol::InputRate(k) => filtered(n + k, 1),
                Symbol::Raw(i) => &s.coordinates[i][range.clone()],
                Symbol::RawInput(k) => &s.inputs[k][range.clone()],
                Symbol::Tau => &phase[..],
                Symbol::Time => &times[..],
                Symbol::Memory(_) => &remembered[..],
                Symbol::Acceleration(i) => &accelerations[i],
                // Signs are held in simulations only, states stand in laws of their own.
                Symbol::Held(_) | Symbol::State(_) => &[],
            })
            .collect();
        *series = self.weak.tape.run(&columns, range.len());
    }
}

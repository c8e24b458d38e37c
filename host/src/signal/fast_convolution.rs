//! Several kernels over pairs of long signals, by fast convolution: the outputs of
//! [`Kernel::apply`] to rounding, several times faster.
//!
//! Overlap and save (Oppenheim and Schafer, *Discrete-Time Signal Processing*, 8.7.3): blocks of a
//! fixed length that stays in the nearest caches, two real signals as one complex one, one
//! transform forth and one back for each kernel; of every block the samples whose kernel lies
//! inside of it are kept.

use std::sync::Arc;

use pulp::{Arch, NullaryFnOnce};
use realfft::num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

use super::low_pass::Kernel;

/// Which output of a kernel is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// The smoothed signal.
    Smooth,
    /// Its time derivative.
    Slope,
}

/// The kernels' spectra, for signals of any length.
pub struct FastConvolution {
    /// The longest kernel's reach.
    reach: usize,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
    /// Spectra of the filters, scaled by one over the transform's length.
    spectra: Vec<Vec<Complex64>>,
}

/// Room that [`FastConvolution::apply`] works in, and what it found.
#[derive(Default)]
pub struct Work {
    /// Outputs in the planned order, one for each of the pair: sample i belongs to input sample i +
    /// reach.
    pub outputs: Vec<[Vec<f64>; 2]>,
    signal: Vec<Complex64>,
    product: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl FastConvolution {
    /// Plans `outputs` for signals of any length; fastest for those that have `count` outputs.
    pub fn new(outputs: &[(&Kernel, Output)], count: usize) -> Self {
        let reach = outputs.iter().map(|(k, _)| k.reach()).max().unwrap_or(0);
        // Transforms cost n log n, and something for each of their samples; lengths that they like.
        let cost = |n: usize| count.div_ceil(n - 2 * reach) as f64 * n as f64 * ((n as f64).log2() + 6.0);
        let size = (8..=22)
            .flat_map(|k| [1 << k, 9 << (k - 3), 3 << (k - 1)])
            .filter(|&n: &usize| n > 2 * reach)
            .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))
            .unwrap_or_else(|| (4 * reach).next_power_of_two());
        let mut planner = FftPlanner::<f64>::new();
        let (forward, inverse) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
        let spectra = outputs
            .iter()
            .map(|(kernel, output)| {
                let weights = kernel.weights(*output);
                let mut x = vec![Complex64::default(); size];
                for (k, w) in weights.iter().enumerate() {
                    // Lag k − reach, wrapped to the transform's length.
                    x[(k + size - kernel.reach()) % size].re += w / size as f64;
                }
                forward.process(&mut x);
                x
            })
            .collect();
        Self { reach, forward, inverse, spectra }
    }

    /// Samples needed on either side of an output.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// Every output for a pair of signals of one length, at all samples whose kernels lie inside,
    /// into `work.outputs`.
    pub fn apply(&self, pair: [&[f64]; 2], work: &mut Work) {
        let size = self.forward.len();
        let length = pair[0].len().min(pair[1].len());
        let count = length.saturating_sub(2 * self.reach);
        let kept = size - 2 * self.reach;
        let Work { outputs, signal, product, scratch } = work;
        outputs.resize_with(self.spectra.len(), Default::default);
        outputs.iter_mut().flatten().for_each(|o| o.clear());
        signal.resize(size, Complex64::default());
        product.resize(size, Complex64::default());
        let room = self.forward.get_inplace_scratch_len().max(self.inverse.get_inplace_scratch_len());
        scratch.resize(room, Complex64::default());
        let arch = Arch::new();
        for from in (0..count).step_by(kept) {
            let block = pair.map(|x| &x[from..length.min(from + size)]);
            // A whirling angle is large: what is filtered is its change within the block.
            let offset = block.map(|x| x[0]);
            arch.dispatch(Join { signal, block, offset });
            signal[block[0].len()..].fill(Complex64::default());
            self.forward.process_with_scratch(signal, scratch);
            let now = kept.min(count - from);
            for (spectrum, [first, second]) in self.spectra.iter().zip(outputs.iter_mut()) {
                arch.dispatch(Multiply { product, signal, spectrum });
                self.inverse.process_with_scratch(product, scratch);
                // What a filter does to the constant taken off: times its sum, 1 or 0.
                let gain = spectrum[0].re * size as f64;
                let back = offset.map(|o| gain * o);
                let kept = &product[self.reach..self.reach + now];
                let from = first.len();
                first.resize(from + now, 0.0);
                second.resize(from + now, 0.0);
                arch.dispatch(Part { kept, back, to: [&mut first[from..], &mut second[from..]] });
            }
        }
    }
}

/// Two real signals, each relative to its offset, as a complex one.
struct Join<'a> {
    signal: &'a mut [Complex64],
    block: [&'a [f64]; 2],
    offset: [f64; 2],
}

impl NullaryFnOnce for Join<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { signal, block: [a, b], offset } = self;
        for (z, (a, b)) in signal.iter_mut().zip(a.iter().zip(b)) {
            *z = Complex64::new(a - offset[0], b - offset[1]);
        }
    }
}

/// A spectrum times a filter's.
struct Multiply<'a> {
    product: &'a mut [Complex64],
    signal: &'a [Complex64],
    spectrum: &'a [Complex64],
}

impl NullaryFnOnce for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (p, (a, b)) in self.product.iter_mut().zip(self.signal.iter().zip(self.spectrum)) {
            *p = a * b;
        }
    }
}

/// A complex signal as two real ones.
struct Part<'a> {
    kept: &'a [Complex64],
    back: [f64; 2],
    to: [&'a mut [f64]; 2],
}

impl NullaryFnOnce for Part<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { kept, back, to: [first, second] } = self;
        for (p, (a, b)) in kept.iter().zip(first.iter_mut().zip(second)) {
            (*a, *b) = (p.re + back[0], p.im + back[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gives_what_the_direct_convolution_gives() {
        let kernel = Kernel::design(2e-3, 40.0, 60.0);
        let other = Kernel::design(2e-3, 20.0, 80.0);
        // Less than a block, some blocks and a rest, nothing.
        for n in [997, 20_011, 2 * kernel.reach() + 1, 2 * kernel.reach(), 3] {
            let x: Vec<f64> = (0..n).map(|i| 300.0 + 0.06 * i as f64 + (0.11 * i as f64).sin()).collect();
            let y: Vec<f64> = (0..n).map(|i| (0.017 * (i * i % 701) as f64).cos()).collect();
            let wanted = [(&kernel, Output::Smooth), (&kernel, Output::Slope), (&other, Output::Slope)];
            let fast = FastConvolution::new(&wanted, n);
            assert!(fast.reach() == kernel.reach() && kernel.reach() > other.reach());
            let mut work = Work::default();
            // What was in the room before does not matter.
            fast.apply([&[f64::NAN; 3000], &[1.0; 3000]], &mut work);
            fast.apply([&x, &y], &mut work);
            for ((k, output), found) in wanted.iter().zip(&work.outputs) {
                for (input, found) in [&x, &y].iter().zip(found) {
                    let (mut smooth, mut slope) = (vec![], vec![]);
                    k.apply(input, &mut smooth, &mut slope);
                    let direct = if *output == Output::Smooth { &smooth } else { &slope };
                    let further = kernel.reach() - k.reach();
                    assert_eq!(found.len(), n.saturating_sub(2 * kernel.reach()));
                    let worst =
                        found.iter().zip(direct.iter().skip(further)).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                    assert!(worst < 1e-9, "{n}: {output:?} {worst:e}");
                }
            }
        }
    }
}

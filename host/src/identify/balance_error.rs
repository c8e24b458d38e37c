//! How much of the measured right-hand side the identified model leaves: ‖Y − Σ λ_j X_j‖/‖Y‖ over
//! the record's samples.
//!
//! For a drive whose right-hand side is a force this is the relative force error. Velocities and
//! accelerations come from the low-passed coordinates (its derivative kernel once and twice),
//! inputs through the same low-pass; both sides are then compared in the band that holds 99.5 % of
//! the right-hand side's power, since above it there is little but noise.

use nalgebra::DVector;
use realfft::RealFftPlanner;

use super::per_record::Split;
use super::stretches::Stretch;
use super::windows::Kernels;
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::wrapped;
use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::tape::Tape;
use crate::rig::Rig;
use crate::signal::low_pass::Kernel;

/// Most samples that are looked at.
const MOST: usize = 100_000;

/// The relative error of each equation; `columns` are the coefficients of each equation's columns.
pub fn balance_errors(
    model: &ModelFile,
    rig: &Rig,
    stretches: &[Stretch],
    kernels: &Kernels,
    record_of: &[usize],
    split: &Split,
    columns: &[DVector<f64>],
) -> Vec<f64> {
    let omega = rig.omega();
    let nodes: Vec<Node> = model
        .equations
        .iter()
        .flat_map(|e| std::iter::once(&e.balance).chain(e.terms.iter().map(|t| &t.of)))
        .map(|n| model.in_seconds(n, omega))
        .collect();
    let tape = Tape::new(&nodes);
    let mut left = MOST;
    let mut sums = vec![(0.0, 0.0); model.equations.len()];
    for (s, &record) in stretches.iter().zip(record_of) {
        let length = s.len().min(left);
        let values = strong_series(s, length, &tape, kernels, &model.circle());
        left -= length;
        let mut at = 0;
        for (e, equation) in model.equations.iter().enumerate() {
            let lambda = split.of_record(e, &columns[e], record);
            let measured = &values[at];
            let left: Vec<f64> = (0..measured.len())
                .map(|i| measured[i] - lambda.iter().enumerate().map(|(j, k)| k * values[at + 1 + j][i]).sum::<f64>())
                .collect();
            let least = 8.0 / (measured.len().max(16) as f64 * s.step_s);
            let pass = band(measured, s.step_s).max(least).min(0.3 / s.step_s);
            let kernel = Kernel::design(s.step_s, pass, (1.5 * pass).min(0.45 / s.step_s));
            let (mut smooth, mut unused) = (vec![], vec![]);
            for (series, sum) in [(&left, 0), (measured, 1)] {
                kernel.apply(series, &mut smooth, &mut unused);
                let square: f64 = smooth.iter().map(|x| x * x).sum();
                if sum == 0 { sums[e].0 += square } else { sums[e].1 += square }
            }
            at += 1 + equation.terms.len();
        }
    }
    sums.iter().map(|(r, y)| if *y > 0.0 { (r / y).sqrt() } else { f64::NAN }).collect()
}

/// Frequency below which 99.5 % of a signal's power lies, Hz.
fn band(x: &[f64], step_s: f64) -> f64 {
    let size = 4096.min(x.len() & !1);
    if size < 16 {
        return 0.0;
    }
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(size);
    let (mut input, mut output) = (fft.make_input_vec(), fft.make_output_vec());
    let mut power = vec![0.0; output.len()];
    for piece in x.windows(size).step_by(size / 2) {
        for (i, (y, x)) in input.iter_mut().zip(piece).enumerate() {
            *y = x * (core::f64::consts::PI * i as f64 / size as f64).sin().powi(2);
        }
        if fft.process(&mut input, &mut output).is_ok() {
            power.iter_mut().zip(&output).for_each(|(p, z)| *p += z.norm_sqr());
        }
    }
    let whole: f64 = power.iter().sum();
    let mut sum = 0.0;
    let last = power.iter().position(|p| {
        sum += p;
        sum >= 0.995 * whole
    });
    last.unwrap_or(power.len()) as f64 / (size as f64 * step_s)
}

/// Every expression of a tape over the first samples of a stretch, without the ends that the
/// low-passes reach.
pub fn strong_series(s: &Stretch, length: usize, tape: &Tape, kernels: &Kernels, circle: &[bool]) -> Vec<Vec<f64>> {
    let reach = kernels.full.reach();
    // The derivative kernel is applied twice.
    let lost = 2 * reach;
    if length <= 2 * lost {
        return vec![Vec::new(); tape.len()];
    }
    let count = length - 2 * lost;
    let filtered = |x: &[f64]| {
        let (mut smooth, mut slope, mut unused, mut second) = (vec![], vec![], vec![], vec![]);
        kernels.full.apply(&x[..length], &mut smooth, &mut slope);
        kernels.full.apply(&slope, &mut unused, &mut second);
        [smooth[reach..reach + count].to_vec(), slope[reach..reach + count].to_vec(), second]
    };
    let coordinates: Vec<[Vec<f64>; 3]> = s
        .coordinates
        .iter()
        .zip(circle)
        .map(|(x, circle)| {
            let mut f = filtered(x);
            if *circle {
                f[0].iter_mut().for_each(|x| *x = wrapped(*x));
            }
            f
        })
        .collect();
    let inputs: Vec<[Vec<f64>; 3]> = s.inputs.iter().map(|x| filtered(x)).collect();
    let phase: Vec<f64> = if tape.symbols().contains(&Symbol::Tau) {
        (lost..lost + count).map(|i| s.tau(i)).collect()
    } else {
        Vec::new()
    };
    let times: Vec<f64> = if tape.symbols().contains(&Symbol::Time) {
        (lost..lost + count).map(|i| s.time(i)).collect()
    } else {
        Vec::new()
    };
    let remembered: Vec<Vec<f64>> = tape
        .symbols()
        .iter()
        .map(|x| if let Symbol::Memory(k) = *x { s.remembered(k, lost, count) } else { Vec::new() })
        .collect();
    let columns: Vec<&[f64]> = tape
        .symbols()
        .iter()
        .zip(&remembered)
        .map(|(x, remembered)| match *x {
            Symbol::Coordinate(i) | Symbol::Raw(i) => &coordinates[i][0][..],
            Symbol::Rate(i) | Symbol::ClearRate(i) => &coordinates[i][1],
            Symbol::Acceleration(i) => &coordinates[i][2],
            Symbol::Input(k) | Symbol::RawInput(k) => &inputs[k][0],
            Symbol::InputRate(k) => &inputs[k][1],
            Symbol::Memory(_) => remembered,
            Symbol::Tau | Symbol::Held(_) | Symbol::State(_) => &phase,
            Symbol::Time => &times,
        })
        .collect();
    tape.run(&columns, count)
}

//! Test functions of the weak form and the rows that they give.
//!
//! w_m(u) = sin⁴(πu) e^{−2πimu}, u ∈ [0, 1] over a window of length L, m = 0 … M: smooth, vanishing with three derivatives
//! at both ends. As sin⁴(πu) = Σ_{k=−2}^{2} a_k e^{−2πiku} with a = (1, −4, 6, −4, 1)/16, every ∫ w_m s, ∫ ẇ_m s, ∫ ẅ_m s is a
//! combination of five bins of the plain discrete Fourier transform S of the series s on the window:
//! ∫ w_m⁽ᵖ⁾ s dt = Δt Σ_k a_k (−2πi(m+k)/L)ᵖ S(m+k). One FFT a series and window serves all m, terms and equations. The sums
//! are trapezoidal and, the integrand vanishing at both ends, of higher order.
//!
//! Windows start every half window, at multiples of ten drive periods (rounded to samples), so that windows of a periodic
//! record repeat and can be recognised as repeating.

use core::f64::consts::TAU;
use std::collections::BTreeMap;

use rayon::prelude::*;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;

use crate::model::weak::{Equation, Order, Part, Sample, WeakModel};
use crate::signal::angles::{AngleSegment, Phase};
use crate::signal::low_pass::{FastConvolution, Kernel, Output, is_smooth};
use crate::signal::sin_cos::sin_cos;

/// Coefficients of sin⁴(πu) in e^{−2πiku}, k = −2 … 2.
const SIN4: [f64; 5] = [1.0 / 16.0, -0.25, 0.375, -0.25, 1.0 / 16.0];

/// Geometry of the windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Windows {
    /// Length, s.
    pub length_s: f64,
    /// Distance between starts, s.
    pub hop_s: f64,
    /// Number of frequencies above zero: m = 0 … frequencies, at m/length Hz.
    pub frequencies: usize,
}

/// Rows of one equation from one window: row r holds the p columns and then the target.
#[derive(Clone, Debug)]
pub struct WindowRows {
    /// Time of the window's first sample, s.
    pub start_s: f64,
    /// Windows with consecutive `index` in one `run` overlap by half.
    pub index: usize,
    /// Number of the unbroken stretch.
    pub run: usize,
    /// For each equation the rows: m = 0 (real part only), then real and imaginary part of each m.
    pub equations: Vec<Vec<f64>>,
}

/// Number of rows that M frequencies give.
pub const fn row_count(frequencies: usize) -> usize {
    1 + 2 * frequencies
}

/// Frequency index m of a row.
pub const fn frequency_of_row(row: usize) -> usize {
    row.div_ceil(2)
}

/// The even number nearest to `target` that is a product of 2, 3 and 5, for fast transforms (the window's length is free).
fn smooth_length(target: f64) -> usize {
    let centre = (target.round() as usize).max(16);
    (0..centre)
        .flat_map(|d| [centre - d, centre + d])
        .find(|&n| n.is_multiple_of(2) && n >= 16 && is_smooth(n))
        .unwrap_or(centre)
}

/// Samples that one window needs at this sampling step, the kernel's reach on either side included.
pub fn samples_needed(windows: &Windows, kernels: &Kernels, step_s: f64) -> usize {
    smooth_length(windows.length_s / step_s) + 2 * kernels.reach()
}

struct Place {
    segment: usize,
    start: usize,
    index: usize,
}

/// The low-passes of the weak form.
#[derive(Clone, Debug)]
pub struct Kernels {
    /// Everything up to where the signal sinks into the noise.
    pub full: Kernel,
    /// Only what stands clear of the noise, for signs of velocities.
    pub clear: Kernel,
}

impl Kernels {
    /// Samples needed on either side of a window.
    pub fn reach(&self) -> usize {
        self.full.reach().max(self.clear.reach())
    }
}

/// Unbroken stretches whose series can be evaluated: what rows are made of.
pub(crate) trait Stretches: Sync {
    /// Number of stretches.
    fn count(&self) -> usize;

    /// Samples of a stretch.
    fn samples(&self, stretch: usize) -> usize;

    /// Sampling step of a stretch, s.
    fn step_s(&self, stretch: usize) -> f64;

    /// Time of a sample, s.
    fn time(&self, stretch: usize, sample: usize) -> f64;

    /// Every series of the model at samples first … last of a stretch.
    fn evaluate(&self, stretch: usize, convolution: &FastConvolution, first: usize, last: usize) -> Vec<Vec<f64>>;
}

/// The double pendulum's angles with its model.
struct Pendulum<'a> {
    segments: &'a [AngleSegment],
    model: &'a WeakModel,
    kernels: &'a Kernels,
}

impl Stretches for Pendulum<'_> {
    fn count(&self) -> usize {
        self.segments.len()
    }
    fn samples(&self, stretch: usize) -> usize {
        self.segments[stretch].len()
    }
    fn step_s(&self, stretch: usize) -> f64 {
        self.segments[stretch].step_s
    }
    fn time(&self, stretch: usize, sample: usize) -> f64 {
        self.segments[stretch].time(sample)
    }
    fn evaluate(&self, stretch: usize, convolution: &FastConvolution, first: usize, last: usize) -> Vec<Vec<f64>> {
        evaluate(&self.segments[stretch], self.model, self.kernels, convolution, first, last)
    }
}

/// Rows of every window of every segment, in order of time; the same on any number of threads.
pub fn rows(segments: &[AngleSegment], model: &WeakModel, kernels: &Kernels, windows: &Windows) -> Vec<WindowRows> {
    rows_of(&Pendulum { segments, model, kernels }, &model.equations, kernels, windows)
}

/// The convolution with every low-pass's outputs for inputs of a length: smooth, slope, clear slope.
pub(crate) fn convolution(kernels: &Kernels, length: usize) -> FastConvolution {
    FastConvolution::new(
        length,
        &[(&kernels.full, Output::Smooth), (&kernels.full, Output::Slope), (&kernels.clear, Output::Slope)],
    )
}

/// As [`rows`], for any system.
pub(crate) fn rows_of(
    source: &impl Stretches,
    equations: &[Equation],
    kernels: &Kernels,
    windows: &Windows,
) -> Vec<WindowRows> {
    if source.count() == 0 {
        return Vec::new();
    }
    let step_s = source.step_s(0);
    let length = smooth_length(windows.length_s / step_s);
    let reach = kernels.reach();
    let mut places = Vec::new();
    for segment in 0..source.count() {
        for index in 0.. {
            let start = reach + (index as f64 * windows.hop_s / source.step_s(segment)).round() as usize;
            if start + length + reach > source.samples(segment) {
                break;
            }
            places.push(Place { segment, start, index });
        }
    }
    // Neighbouring windows share their smoothed samples: work through them in fixed groups.
    const GROUP: usize = 8;
    let groups: Vec<&[Place]> = places.chunk_by(|a, b| a.segment == b.segment).flat_map(|c| c.chunks(GROUP)).collect();
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    // Groups of one length, nearly all, share their convolution.
    let span = |group: &[Place]| group[group.len() - 1].start + length - group[0].start + 2 * reach;
    let mut convolutions: BTreeMap<usize, FastConvolution> = BTreeMap::new();
    for group in &groups {
        convolutions.entry(span(group)).or_insert_with_key(|&n| convolution(kernels, n));
    }
    groups
        .par_iter()
        .flat_map_iter(|group| {
            let (first, last) = (group[0].start, group[group.len() - 1].start + length);
            let series = source.evaluate(group[0].segment, &convolutions[&span(group)], first, last);
            let mut input = fft.make_input_vec();
            let mut output = fft.make_output_vec();
            let mut scratch = fft.make_scratch_vec();
            let bins = windows.frequencies + 3;
            group
                .iter()
                .map(|place| {
                    let transforms: Vec<Vec<Complex64>> = series
                        .iter()
                        .map(|s| {
                            let x = &s[place.start - first..place.start - first + length];
                            // A whirling angle is large: what matters is its change.
                            let offset = x[0];
                            input.iter_mut().zip(x).for_each(|(y, x)| *y = x - offset);
                            let done = fft.process_with_scratch(&mut input, &mut output, &mut scratch);
                            debug_assert!(done.is_ok(), "lengths are the planner's own");
                            let mut bins: Vec<Complex64> = output.iter().take(bins).copied().collect();
                            bins[0] += offset * length as f64;
                            bins
                        })
                        .collect();
                    WindowRows {
                        start_s: source.time(place.segment, place.start),
                        index: place.index,
                        run: place.segment,
                        equations: assemble(equations, &transforms, windows.frequencies, step_s, length),
                    }
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Change of a sampled quantity over one step around sample k.
fn step_at(x: &[f64], k: usize) -> f64 {
    let (before, after) = (k.saturating_sub(1), (k + 1).min(x.len() - 1));
    if after > before { (x[after] - x[before]) / (after - before) as f64 } else { 0.0 }
}

/// Every series of a model over all samples that the low-passes reach, segment after segment.
pub(crate) fn evaluate_all(segments: &[AngleSegment], model: &WeakModel, kernels: &Kernels) -> Vec<Vec<f64>> {
    let reach = kernels.reach();
    // Long segments in fixed pieces, so that transforms stay short.
    const PIECE: usize = 20_000;
    let pieces: Vec<(&AngleSegment, usize, usize)> = segments
        .iter()
        .filter(|s| s.len() > 2 * reach)
        .flat_map(|s| {
            let last = s.len() - reach;
            (reach..last).step_by(PIECE).map(move |a| (s, a, (a + PIECE).min(last)))
        })
        .collect();
    let parts: Vec<Vec<Vec<f64>>> = pieces
        .par_iter()
        .map(|&(segment, first, last)| {
            let convolution = convolution(kernels, last - first + 2 * reach);
            evaluate(segment, model, kernels, &convolution, first, last)
        })
        .collect();
    (0..model.series.len()).map(|k| parts.iter().flat_map(|p| p[k].iter().copied()).collect()).collect()
}

/// Samples worked through at once: what the series share stays in the first-level cache.
const BLOCK: usize = 64;

/// Every series of the model at samples first … last of a segment.
fn evaluate(
    segment: &AngleSegment,
    model: &WeakModel,
    kernels: &Kernels,
    convolution: &FastConvolution,
    first: usize,
    last: usize,
) -> Vec<Vec<f64>> {
    let reach = kernels.reach();
    let input = [0, 1].map(|i: usize| &segment.phi[i][first - reach..last + reach]);
    let outputs = convolution.apply(input);
    let [phi, rate, clear] =
        [0, 1, 2].map(|k: usize| [0, 1].map(|i: usize| &outputs[k][i][reach..reach + last - first]));
    let n = last - first;
    let mut series = vec![vec![0.0; n]; model.series.len()];
    let driven = !matches!(segment.phase, Phase::Clock(0.0));
    let mut samples = [Sample::default(); BLOCK];
    let (mut tau, mut sin, mut cos) = ([0.0; BLOCK], [[0.0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
    cos[2] = [1.0; BLOCK];
    for from in (0..n).step_by(BLOCK) {
        let to = (from + BLOCK).min(n);
        for i in 0..2 {
            sin_cos(&phi[i][from..to], &mut sin[i][..to - from], &mut cos[i][..to - from]);
        }
        if driven {
            tau.iter_mut().zip(from..to).for_each(|(tau, k)| *tau = segment.tau(first + k));
            sin_cos(&tau[..to - from], &mut sin[2][..to - from], &mut cos[2][..to - from]);
        }
        for (j, k) in (from..to).enumerate() {
            samples[j] = Sample {
                raw: [segment.phi[0][first + k], segment.phi[1][first + k]],
                phi: [phi[0][k], phi[1][k]],
                rate: [rate[0][k], rate[1][k]],
                clear_rate: [clear[0][k], clear[1][k]],
                clear_step: [step_at(clear[0], k), step_at(clear[1], k)],
                turn: [rate[0][k] * segment.step_s, rate[1][k] * segment.step_s],
                accel: [step_at(rate[0], k) / segment.step_s, step_at(rate[1], k) / segment.step_s],
                sin: [sin[0][j], sin[1][j]],
                cos: [cos[0][j], cos[1][j]],
                sin_tau: sin[2][j],
                cos_tau: cos[2][j],
                time: segment.time(first + k),
            };
        }
        for (column, f) in series.iter_mut().zip(&model.series) {
            f(&samples[..to - from], &mut column[from..to]);
        }
    }
    series
}

/// Rows of all equations from the transforms of all series.
fn assemble(
    equations: &[Equation],
    transforms: &[Vec<Complex64>],
    frequencies: usize,
    step_s: f64,
    length: usize,
) -> Vec<Vec<f64>> {
    let length_s = length as f64 * step_s;
    // Bin m + k, k from −2: a real series has S(−n) = conj S(n).
    let bin = |s: usize, n: i64| if n >= 0 { transforms[s][n as usize] } else { transforms[s][(-n) as usize].conj() };
    let integral = |parts: &[Part], m: usize| -> Complex64 {
        parts
            .iter()
            .map(|part| {
                let mut sum = Complex64::new(0.0, 0.0);
                for (a, k) in SIN4.iter().zip(-2_i64..) {
                    let n = m as i64 + k;
                    let slope = Complex64::new(0.0, -TAU * n as f64 / length_s);
                    let factor = match part.order {
                        Order::Value => Complex64::new(1.0, 0.0),
                        Order::First => -slope,
                        Order::Second => slope * slope,
                    };
                    sum += bin(part.series, n) * factor * *a;
                }
                sum * (part.factor * step_s)
            })
            .sum()
    };
    equations
        .iter()
        .map(|equation| {
            let columns = equation.terms.len() + 1;
            let mut rows = vec![0.0; row_count(frequencies) * columns];
            for m in 0..=frequencies {
                for c in 0..columns {
                    let parts = if c + 1 == columns { &equation.target } else { &equation.terms[c].parts };
                    let z = integral(parts, m);
                    if m == 0 {
                        rows[c] = z.re;
                    } else {
                        rows[(2 * m - 1) * columns + c] = z.re;
                        rows[2 * m * columns + c] = z.im;
                    }
                }
            }
            rows
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::weak::Term;

    /// ∫ w ẍ and ∫ w ẋ of a known signal equal direct quadrature of its exact derivatives.
    #[test]
    fn integration_by_parts_agrees_with_direct_quadrature() {
        let step = 2e-3;
        let x = |t: f64| 40.0 * t + (7.0 * t).sin() + 0.3 * (23.0 * t).cos();
        let dx = |t: f64| 40.0 + 7.0 * (7.0 * t).cos() - 6.9 * (23.0 * t).sin();
        let ddx = |t: f64| -49.0 * (7.0 * t).sin() - 158.7 * (23.0 * t).cos();
        let segment = AngleSegment {
            start_s: 0.0,
            step_s: step,
            phi: [(0..3000).map(|i| x(i as f64 * step)).collect(), vec![0.0; 3000]],
            phase: Phase::Clock(0.0),
            relative: false,
            runaway: (0.0, 0.0),
            count_rad: [None; 2],
        };
        let mut model = WeakModel::default();
        let second = model.part("x", |s| s.raw[0], Order::Second, 1.0);
        let first = model.part("x", |s| s.raw[0], Order::First, 1.0);
        let value = model.part("rate", |s| s.rate[0], Order::Value, 1.0);
        model.equations.push(Equation {
            terms: vec![
                Term { name: "a".into(), unit: "1", parts: vec![first] },
                Term { name: "b".into(), unit: "1", parts: vec![value] },
            ],
            target: vec![second],
        });
        let kernel = Kernel::design(step, 60.0, 90.0);
        let windows = Windows { length_s: 4.0, hop_s: 2.0, frequencies: 12 };
        let kernels = Kernels { full: kernel.clone(), clear: kernel.clone() };
        let out = rows(&[segment], &model, &kernels, &windows);
        assert_eq!(out.len(), 1);
        for row in 0..row_count(12) {
            let m = frequency_of_row(row);
            let weight = |i: usize| {
                let u = i as f64 / 2000.0;
                let w = (core::f64::consts::PI * u).sin().powi(4);
                let angle = -TAU * m as f64 * u;
                w * if row == 0 || row % 2 == 1 { angle.cos() } else { angle.sin() } * step
            };
            let start = kernel.reach();
            let direct =
                |f: &dyn Fn(f64) -> f64| -> f64 { (0..2000).map(|i| weight(i) * f((start + i) as f64 * step)).sum() };
            let got = &out[0].equations[0][row * 3..row * 3 + 3];
            assert!((got[0] - direct(&dx)).abs() < 1e-7, "row {row}: {} {}", got[0], direct(&dx));
            assert!((got[1] - direct(&dx)).abs() < 2e-2, "row {row}: {} {}", got[1], direct(&dx));
            assert!((got[2] - direct(&ddx)).abs() < 1e-6, "row {row}: {} {}", got[2], direct(&ddx));
        }
    }

    #[test]
    fn smooth_lengths_are_near_and_even() {
        assert_eq!(smooth_length(2000.0), 2000);
        assert_eq!(smooth_length(1923.08), 1920);
        assert_eq!(smooth_length(3.0), 16);
    }
}

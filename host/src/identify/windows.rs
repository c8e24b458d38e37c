//! Test functions of the weak form and the rows that they give.
//!
//! w_m(u) = sin⁴(πu) e^{−2πimu}, u ∈ [0, 1] over a window of length L, m = 0 … M: smooth, vanishing
//! with three derivatives at both ends. As sin⁴(πu) = Σ_{k=−2}^{2} a_k e^{−2πiku} with a = (1, −4,
//! 6, −4, 1)/16, every ∫ w_m s, ∫ ẇ_m s, ∫ ẅ_m s is a combination of five bins of the plain
//! discrete Fourier transform S of the series s on the window: ∫ w_m⁽ᵖ⁾ s dt = Δt Σ_k a_k
//! (−2πi(m+k)/L)ᵖ S(m+k). One transform a series and window (`transforms`) serves all m, terms and
//! equations (`assembly`). The sums are trapezoidal and, the integrand vanishing at both ends, of
//! higher order.
//!
//! Windows start every half window, at multiples of ten drive periods (rounded to samples), so that
//! windows of a periodic record repeat and can be recognised as repeating.

use std::ops::Range;

use rayon::prelude::*;
use realfft::num_complex::Complex64;

use super::assembly::Assembly;
use super::transforms::{self, Transforms, good_length};
use crate::model::weak::Equation;
use crate::signal::fast_convolution::{self as convolution, FastConvolution, Output};
use crate::signal::low_pass::Kernel;

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

/// Samples that one window needs at this sampling step, the kernel's reach on either side included.
pub fn samples_needed(windows: &Windows, kernels: &Kernels, step_s: f64) -> usize {
    good_length(windows.length_s / step_s).saturating_add(2 * kernels.reach())
}

struct WindowStart {
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
pub trait Stretches: Sync {
    /// Number of stretches.
    fn count(&self) -> usize;

    /// Samples of a stretch.
    fn samples(&self, stretch: usize) -> usize;

    /// Sampling step of a stretch, s.
    fn step_s(&self, stretch: usize) -> f64;

    /// Time of a sample, s.
    fn time(&self, stretch: usize, sample: usize) -> f64;

    /// Every series of the model at a range of samples of a stretch, into `series`.
    fn evaluate(
        &self,
        stretch: usize,
        convolution: &FastConvolution,
        range: Range<usize>,
        work: &mut convolution::Work,
        series: &mut Vec<Vec<f64>>,
    );
}

/// The convolution with every low-pass's outputs: smooth, slope, clear slope; `count` of each at a
/// time.
fn convolution(kernels: &Kernels, count: usize) -> FastConvolution {
    let outputs = [(&kernels.full, Output::Smooth), (&kernels.full, Output::Slope), (&kernels.clear, Output::Slope)];
    FastConvolution::new(&outputs, count)
}

/// Windows worked through at once: neighbours share their smoothed samples.
const GROUP: usize = 8;

/// Room for one thread's windows.
#[derive(Default)]
struct Work {
    convolution: convolution::Work,
    /// Series of several groups of windows.
    series: Vec<Vec<Vec<f64>>>,
    transforms: transforms::Work,
    bins: Vec<Complex64>,
}

/// What windows of one length and sampling step have in common, whatever the record.
pub(crate) struct Plan {
    windows: Windows,
    step_s: f64,
    length: usize,
    transforms: Transforms,
    convolution: FastConvolution,
}

impl Plan {
    /// For `together` windows at a time that follow each other.
    pub(crate) fn new(kernels: &Kernels, windows: &Windows, step_s: f64, together: usize) -> Self {
        let length = good_length(windows.length_s / step_s);
        let hops = together.clamp(1, GROUP) - 1;
        let typical = length + (hops as f64 * windows.hop_s / step_s).round() as usize;
        Self {
            windows: *windows,
            step_s,
            length,
            transforms: Transforms::new(length, windows.frequencies + 3),
            convolution: convolution(kernels, typical),
        }
    }
}

/// Rows of every window of every stretch, in order of time; the same on any number of threads.
pub fn rows_of(
    source: &impl Stretches,
    equations: &[Equation],
    kernels: &Kernels,
    windows: &Windows,
) -> Vec<WindowRows> {
    if source.count() == 0 {
        return Vec::new();
    }
    let step_s = source.step_s(0);
    let longest = (0..source.count()).map(|s| source.samples(s)).max().unwrap_or(0);
    // Nothing is planned for windows that no stretch has room for.
    let Some(spare) = longest.checked_sub(samples_needed(windows, kernels, step_s)) else { return Vec::new() };
    let together = 1 + (spare as f64 * step_s / windows.hop_s) as usize;
    rows_planned(source, equations, &Plan::new(kernels, windows, step_s, together))
}

/// As [`rows_of`] with a plan made before.
pub(crate) fn rows_planned(source: &impl Stretches, equations: &[Equation], plan: &Plan) -> Vec<WindowRows> {
    let Plan { windows, step_s, length, transforms: transform, convolution } = plan;
    let (step_s, length) = (*step_s, *length);
    let reach = convolution.reach();
    let mut places = Vec::new();
    for segment in 0..source.count() {
        for index in 0.. {
            let start = reach + (index as f64 * windows.hop_s / source.step_s(segment)).round() as usize;
            if start + length + reach > source.samples(segment) {
                break;
            }
            places.push(WindowStart { segment, start, index });
        }
    }
    // Groups of neighbours, and as many groups together as make a matrix product worth while:
    // fixed, whatever the threads.
    let groups: Vec<&[WindowStart]> =
        places.chunk_by(|a, b| a.segment == b.segment).flat_map(|c| c.chunks(GROUP)).collect();
    let mut tasks: Vec<&[&[WindowStart]]> = Vec::new();
    let mut rest = &groups[..];
    while !rest.is_empty() {
        let mut windows = 0;
        let fit = rest.iter().take_while(|g| {
            windows += g.len();
            windows <= GROUP
        });
        let (now, later) = rest.split_at(fit.count().max(1));
        tasks.push(now);
        rest = later;
    }
    let assembly = Assembly::new(equations, windows.frequencies, step_s, length);
    let found: Vec<Vec<WindowRows>> = tasks
        .par_iter()
        .with_min_len(4)
        .map_init(Work::default, |work, task| {
            let Work { convolution: room, series, transforms, bins } = work;
            series.resize_with(series.len().max(task.len()), Vec::new);
            for (group, series) in task.iter().zip(series.iter_mut()) {
                let range = group[0].start..group[group.len() - 1].start + length;
                source.evaluate(group[0].segment, convolution, range, room, series);
            }
            let starts: Vec<Vec<usize>> =
                task.iter().map(|group| group.iter().map(|p| p.start - group[0].start).collect()).collect();
            let parts: Vec<(&[Vec<f64>], &[usize])> =
                series.iter().zip(&starts).map(|(s, starts)| (&s[..], &starts[..])).collect();
            transform.apply(&parts, transforms, bins);
            let each = (series[0].len() * transform.bins()).max(1);
            task.iter()
                .flat_map(|group| group.iter())
                .zip(bins.chunks_exact(each))
                .map(|(place, bins)| WindowRows {
                    start_s: source.time(place.segment, place.start),
                    index: place.index,
                    run: place.segment,
                    equations: assembly.rows(bins),
                })
                .collect()
        })
        .collect();
    found.into_iter().flatten().collect()
}

/// Change of a sampled quantity over one step around sample k.
pub(crate) fn step_at(x: &[f64], k: usize) -> f64 {
    let (before, after) = (k.saturating_sub(1), (k + 1).min(x.len() - 1));
    if after > before { (x[after] - x[before]) / (after - before) as f64 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use super::*;
    use crate::model::weak::{Order, Part, Term};

    /// One signal, as it is and its low-passed slope.
    struct Signal {
        x: Vec<f64>,
        step_s: f64,
    }

    impl Stretches for Signal {
        fn count(&self) -> usize {
            1
        }
        fn samples(&self, _: usize) -> usize {
            self.x.len()
        }
        fn step_s(&self, _: usize) -> f64 {
            self.step_s
        }
        fn time(&self, _: usize, sample: usize) -> f64 {
            sample as f64 * self.step_s
        }
        fn evaluate(
            &self,
            _: usize,
            convolution: &FastConvolution,
            range: Range<usize>,
            work: &mut convolution::Work,
            series: &mut Vec<Vec<f64>>,
        ) {
            let reach = convolution.reach();
            let part = &self.x[range.start - reach..range.end + reach];
            convolution.apply([part, part], work);
            *series = vec![self.x[range].to_vec(), work.outputs[1][0].clone()];
        }
    }

    /// ∫ w ẍ and ∫ w ẋ of a known signal equal direct quadrature of its exact derivatives.
    #[test]
    fn integration_by_parts_agrees_with_direct_quadrature() {
        let step = 2e-3;
        let x = |t: f64| 40.0 * t + (7.0 * t).sin() + 0.3 * (23.0 * t).cos();
        let dx = |t: f64| 40.0 + 7.0 * (7.0 * t).cos() - 6.9 * (23.0 * t).sin();
        let ddx = |t: f64| -49.0 * (7.0 * t).sin() - 158.7 * (23.0 * t).cos();
        let signal = Signal { x: (0..3000).map(|i| x(i as f64 * step)).collect(), step_s: step };
        let part = |series, order| vec![Part { series, order, factor: 1.0 }];
        let term = |name: &str, parts| Term { name: name.into(), unit: "1", parts };
        let equations = [Equation {
            terms: vec![term("a", part(0, Order::First)), term("b", part(1, Order::Value))],
            target: part(0, Order::Second),
        }];
        let kernel = Kernel::design(step, 60.0, 90.0);
        let windows = Windows { length_s: 4.0, hop_s: 2.0, frequencies: 12 };
        let kernels = Kernels { full: kernel.clone(), clear: kernel.clone() };
        let out = rows_of(&signal, &equations, &kernels, &windows);
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
}

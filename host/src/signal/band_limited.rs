//! A sampled signal between its samples, taken as band-limited.
//!
//! x(t) = Σ_k x_k s(t − kΔ), s a sinc under a Kaiser window (β = 14.5, 48 samples to either side;
//! flat to 0.9 of the Nyquist frequency within 1e-6), evaluated once on a grid eight times as fine;
//! between the points of that grid a polynomial of degree five through six of them (error below
//! 1e-6 of the amplitude at the Nyquist frequency). Beyond the ends the signal is continued
//! point-symmetrically, so that neither value nor slope jumps there.

/// Points of the fine grid a sample.
const FINE: usize = 8;
/// Samples to either side of the kernel.
const HALF: usize = 48;
/// Kaiser's β.
const BETA: f64 = 14.5;

/// A signal between its samples.
#[derive(Clone, Debug)]
pub struct BandLimited {
    start_s: f64,
    /// Points of the fine grid a second.
    rate: f64,
    fine: Vec<f64>,
}

/// I₀ by its power series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    while term > 1e-17 * sum && k < 200.0 {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}

/// Samples to either side that the low-pass reaches.
pub const REACH: usize = HALF;

/// The low-pass that samples stand for, s(x) at a distance in samples, to a constant near 1.
pub fn kernel(x: f64) -> f64 {
    let sinc = if x == 0.0 { 1.0 } else { (core::f64::consts::PI * x).sin() / (core::f64::consts::PI * x) };
    let u = x / HALF as f64;
    sinc * bessel_i0(BETA * (1.0 - u * u).max(0.0).sqrt()) / bessel_i0(BETA)
}

/// Samples, and `beyond` more on either side, which continue them point-symmetrically.
fn continued(samples: &[f64], beyond: usize) -> Vec<f64> {
    let (n, last) = (samples.len() as i64, samples.len() as i64 - 1);
    let at = |i: i64| match samples {
        [] => 0.0,
        [first, ..] if i < 0 => 2.0 * first - samples[(-i).min(last) as usize],
        [.., end] if i > last => 2.0 * end - samples[(2 * last - i).max(0) as usize],
        _ => samples[i as usize],
    };
    (-(beyond as i64)..n + beyond as i64).map(at).collect()
}

/// Sums of samples under the weights of every phase: side by side, each in the samples' order.
fn weighted(kernel: &[[f64; FINE]], samples: &[f64]) -> [f64; FINE] {
    let mut out = [0.0; FINE];
    for (w, x) in kernel.iter().zip(samples) {
        out.iter_mut().zip(w).for_each(|(o, w)| *o += w * x);
    }
    out
}

impl BandLimited {
    /// Takes samples from `start_s` on, `step_s` apart.
    pub fn new(samples: &[f64], start_s: f64, step_s: f64) -> Self {
        // Weights for each phase of the fine grid, over the samples −HALF+1 … HALF around.
        let phases: Vec<Vec<f64>> = (0..FINE)
            .map(|phase| {
                let mut w: Vec<f64> = (0..2 * HALF)
                    .map(|k| kernel(phase as f64 / FINE as f64 - (k as f64 - (HALF as f64 - 1.0))))
                    .collect();
                let sum: f64 = w.iter().sum();
                w.iter_mut().for_each(|w| *w /= sum);
                w
            })
            .collect();
        let kernel: Vec<[f64; FINE]> = (0..2 * HALF).map(|k| core::array::from_fn(|p| phases[p][k])).collect();
        // Three more samples on either side for the polynomial.
        let around = continued(samples, 3 + HALF);
        let fine = around.windows(2 * HALF).skip(1).flat_map(|x| weighted(&kernel, x)).collect();
        Self { start_s, rate: FINE as f64 / step_s, fine }
    }

    /// Its value at a time, s; the ends' values beyond them.
    pub fn value(&self, time: f64) -> f64 {
        let x = (time - self.start_s) * self.rate + (3 * FINE) as f64;
        let last = self.fine.len().saturating_sub(4) as f64;
        let x = x.clamp(2.0, last.max(2.0));
        let base = (x.floor()).min(last - 1.0).max(2.0);
        let u = x - base;
        let i = base as usize;
        let Some(y) = self.fine.get(i - 2..i + 4) else { return 0.0 };
        // Lagrange's polynomial through the points −2 … 3.
        let (a, b, c, d, e, f) = (u + 2.0, u + 1.0, u, u - 1.0, u - 2.0, u - 3.0);
        y[0] * (b * c * d * e * f) / -120.0
            + y[1] * (a * c * d * e * f) / 24.0
            + y[2] * (a * b * d * e * f) / -12.0
            + y[3] * (a * b * c * e * f) / 12.0
            + y[4] * (a * b * c * d * f) / -24.0
            + y[5] * (a * b * c * d * e) / 120.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tones_up_to_two_thirds_of_nyquist_come_back_between_the_samples() {
        let step = 1.0 / 610.0;
        for f in [3.0, 68.0, 150.0, 200.0] {
            let x = |t: f64| (core::f64::consts::TAU * f * t).sin() + 0.2;
            let samples: Vec<f64> = (0..1000).map(|i| x(2.0 + i as f64 * step)).collect();
            let b = BandLimited::new(&samples, 2.0, step);
            let (mut worst, mut linear) = (0.0_f64, 0.0_f64);
            for k in 0..5000 {
                let at = 100.0 + k as f64 * 0.157;
                let t = 2.0 + at * step;
                worst = worst.max((b.value(t) - x(t)).abs());
                let (i, u) = (at as usize, at.fract());
                linear = linear.max((samples[i] * (1.0 - u) + samples[i + 1] * u - x(t)).abs());
            }
            assert!(worst < 2e-4 && worst < 0.01 * linear.max(1e-3), "{f}: {worst:e} {linear:e}");
        }
    }

    #[test]
    fn ends_and_nothing_are_quiet() {
        assert_eq!(BandLimited::new(&[], 0.0, 1.0).value(0.3), 0.0);
        let ramp: Vec<f64> = (0..100).map(|i| 3.0 + 0.5 * f64::from(i)).collect();
        let b = BandLimited::new(&ramp, 0.0, 1.0);
        for t in [0.0, 0.3, 50.7, 98.9, 99.0] {
            assert!((b.value(t) - (3.0 + 0.5 * t)).abs() < 1e-4, "{t} {}", b.value(t));
        }
        assert!(b.value(1e9).is_finite() && b.value(-1e9).is_finite());
    }
}

//! One FIR low-pass and its matched derivative: smooth angle and angular velocity from the same
//! counts.
//!
//! The kernel is a windowed sinc, h(t) = 2 f_c sinc(2 f_c t) · z I₁(z)/(β I₁(β)), z =
//! β√(1−(t/a)²), |t| ≤ a, and the derivative kernel is its exact time derivative h′(t), so that
//! velocity and angle have passed through the same transfer function up to a factor iω: products of
//! the two (`φ̇ cos Δ`) then keep their phase. The window is Kaiser's with I₁ in place of I₀: it
//! vanishes at its ends, where Kaiser's own jump would put an error of 1e-3 into the derivative. β
//! and a follow Kaiser's formulas for 120 dB (the ripple of the pass band, 1e-6 then, goes into the
//! parameters as it is), a lengthened by a fifth for the wider main lobe (J. F. Kaiser,
//! "Nonrecursive digital filter design using the I₀-sinh window function", 1974).
//!
//! Units: hertz and seconds. Output sample i belongs to input sample i; the first and last
//! [`Kernel::reach`] samples have no output. Limits: the pass band must end below 0.45 of the
//! sampling rate.

use super::fast_convolution::Output;

/// Attenuation of the stop band, dB.
const STOP_BAND_DB: f64 = 120.0;

/// Low-pass kernel and its derivative.
#[derive(Clone, Debug)]
pub struct Kernel {
    /// Smoothing weights for lags −reach…reach; even, sum 1.
    smooth: Vec<f64>,
    /// Derivative weights for the same lags, 1/s; odd.
    slope: Vec<f64>,
    /// End of the flat pass band, Hz.
    pub pass_hz: f64,
    /// Start of the stop band, Hz.
    pub stop_hz: f64,
}

/// Modified Bessel function of the first kind of order 0 or 1, by its power series (converges fast
/// for |x| < 20).
fn bessel_i(order: u32, x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let mut term = if order == 0 { 1.0 } else { 0.5 * x };
    let mut sum = term;
    let mut k = 1.0;
    while term.abs() > 1e-17 * sum.abs() && k < 200.0 {
        term *= quarter / (k * (k + f64::from(order)));
        sum += term;
        k += 1.0;
    }
    sum
}

/// Greatest reach, samples: hours at 500 Hz. A band so narrow that more were needed lies below 1e-6
/// of the rate.
const LONGEST_REACH: f64 = (1_u32 << 22) as f64;

impl Kernel {
    /// Designs the pair for a sampling step, flat to `pass_hz` and stopping from `stop_hz`.
    pub fn design(step_s: f64, pass_hz: f64, stop_hz: f64) -> Self {
        let cut = 0.5 * (pass_hz + stop_hz);
        let width = (stop_hz - pass_hz).max(1e-9 / step_s);
        let beta = 0.1102 * (STOP_BAND_DB - 8.7);
        // Kaiser: number of steps N = (A − 7.95) / (14.36 Δf / f_s), half of it on each side, and a
        // fifth more.
        let reach = (0.6 * (STOP_BAND_DB - 7.95) / (14.36 * width * step_s)).ceil().clamp(2.0, LONGEST_REACH) as usize;
        let half = (reach as f64 + 1.0) * step_s;
        let i1_beta = bessel_i(1, beta);
        let omega = core::f64::consts::TAU * cut;
        let mut smooth = Vec::with_capacity(2 * reach + 1);
        let mut slope = Vec::with_capacity(2 * reach + 1);
        for lag in -(reach as i64)..=reach as i64 {
            let t = lag as f64 * step_s;
            let (sinc, sinc_slope) = if lag == 0 {
                (2.0 * cut, 0.0)
            } else {
                let x = omega * t;
                let s = x.sin() / (core::f64::consts::PI * t);
                (s, (omega * x.cos() / core::f64::consts::PI - s) / t)
            };
            let u = t / half;
            let root = (1.0 - u * u).sqrt();
            let window = root * bessel_i(1, beta * root) / i1_beta;
            // d(z I₁)/dz = z I₀.
            let window_slope = -bessel_i(0, beta * root) * beta * u / (half * i1_beta);
            smooth.push(sinc * window * step_s);
            slope.push((sinc_slope * window + sinc * window_slope) * step_s);
        }
        let sum: f64 = smooth.iter().sum();
        smooth.iter_mut().for_each(|h| *h /= sum);
        // A ramp must have slope one: Σ h′(s)·(−s) = 1.
        let ramp: f64 = slope.iter().enumerate().map(|(k, h)| -h * (k as f64 - reach as f64) * step_s).sum();
        slope.iter_mut().for_each(|h| *h /= ramp);
        Self { smooth, slope, pass_hz, stop_hz }
    }

    /// Samples needed on either side of an output.
    pub fn reach(&self) -> usize {
        self.smooth.len() / 2
    }

    /// Weights of an output, for lags −reach…reach.
    pub(super) fn weights(&self, output: Output) -> &[f64] {
        match output {
            Output::Smooth => &self.smooth,
            Output::Slope => &self.slope,
        }
    }

    /// Smoothed signal and its time derivative at the inputs `reach … len − reach`; both are
    /// `input.len() − 2·reach` long (empty where the input is too short). `input` may be a large
    /// unwrapped angle: the symmetry of the kernels is used, so that a constant adds no rounding
    /// error to the derivative.
    pub fn apply(&self, input: &[f64], smooth: &mut Vec<f64>, slope: &mut Vec<f64>) {
        let reach = self.reach();
        smooth.clear();
        slope.clear();
        if input.len() <= 2 * reach {
            return;
        }
        let n = input.len() - 2 * reach;
        smooth.resize(n, 0.0);
        slope.resize(n, 0.0);
        let centre = self.smooth[reach];
        for (y, x) in smooth.iter_mut().zip(&input[reach..]) {
            *y = centre * x;
        }
        // Lag by lag over blocks that stay in the first-level cache: the inner loops vectorise.
        const BLOCK: usize = 1024;
        for start in (0..n).step_by(BLOCK) {
            let end = (start + BLOCK).min(n);
            let (y, v) = (&mut smooth[start..end], &mut slope[start..end]);
            for lag in 1..=reach {
                let (h, d) = (self.smooth[reach + lag], self.slope[reach + lag]);
                let earlier = &input[start + reach - lag..end + reach - lag];
                let later = &input[start + reach + lag..end + reach + lag];
                for (((y, v), a), b) in y.iter_mut().zip(v.iter_mut()).zip(earlier).zip(later) {
                    *y += h * (a + b);
                    // Convolution: output(t) = Σ h′(s) x(t − s), h′ odd.
                    *v += d * (a - b);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn response(frequency: f64) -> (f64, f64) {
        let (step, n) = (2e-3, 3000);
        let kernel = Kernel::design(step, 60.0, 90.0);
        let omega = core::f64::consts::TAU * frequency;
        let x: Vec<f64> = (0..n).map(|i| 1e4 + (omega * i as f64 * step).cos()).collect();
        let (mut y, mut v) = (vec![], vec![]);
        kernel.apply(&x, &mut y, &mut v);
        let r = kernel.reach();
        let worst_y = y
            .iter()
            .enumerate()
            .fold(0.0_f64, |m, (i, y)| m.max((y - 1e4 - (omega * (i + r) as f64 * step).cos()).abs()));
        let worst_v = v
            .iter()
            .enumerate()
            .fold(0.0_f64, |m, (i, v)| m.max((v + omega * (omega * (i + r) as f64 * step).sin()).abs() / omega));
        (worst_y, worst_v)
    }

    #[test]
    fn the_pass_band_is_flat_in_angle_and_velocity() {
        for f in [0.3, 5.0, 17.3, 40.0, 60.0] {
            let (y, v) = response(f);
            assert!(y < 3e-4 && v < 3e-4, "{f} Hz: {y:e} {v:e}");
        }
    }

    #[test]
    fn the_stop_band_is_shut() {
        let (y, v) = response(95.0);
        assert!((y - 1.0).abs() < 3e-4 && (v - 1.0).abs() < 2e-3, "{y} {v}");
    }

    #[test]
    fn a_ramp_has_its_slope() {
        let kernel = Kernel::design(2e-3, 40.0, 60.0);
        let x: Vec<f64> = (0..500).map(|i| 1e5 + 7.0 * i as f64 * 2e-3).collect();
        let (mut y, mut v) = (vec![], vec![]);
        kernel.apply(&x, &mut y, &mut v);
        assert!(v.iter().all(|v| (v - 7.0).abs() < 1e-7));
        assert!((y[0] - x[kernel.reach()]).abs() < 1e-9);
    }

    #[test]
    fn too_short_an_input_gives_nothing() {
        let kernel = Kernel::design(2e-3, 40.0, 60.0);
        let (mut y, mut v) = (vec![1.0], vec![1.0]);
        kernel.apply(&[0.0; 8], &mut y, &mut v);
        assert!(y.is_empty() && v.is_empty());
    }
}

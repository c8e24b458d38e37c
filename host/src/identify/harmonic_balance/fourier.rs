//! Fourier series of one orbit of n samples over k drive periods.
//!
//! Sub-harmonic j has the frequency j/k in τ. Coefficients are c_j = (1/n) Σ_i x_i e^{−2πi·ij/n}:
//! the mean is c_0, the cosine's coefficient 2 Re c_j, the sine's −2 Im c_j. Derivatives multiply
//! by i j/k; at j = n/2 the first one is zero.

use std::sync::Arc;

use rustfft::num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

/// Transforms of one length.
#[derive(Clone)]
pub struct Fourier {
    n: usize,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

impl Fourier {
    /// Transforms of length `n` (at least 1).
    pub fn new(planner: &mut FftPlanner<f64>, n: usize) -> Self {
        let n = n.max(1);
        Self { n, forward: planner.plan_fft_forward(n), inverse: planner.plan_fft_inverse(n) }
    }

    /// Coefficients c_0 … c_{n−1}.
    pub fn coefficients(&self, x: impl Iterator<Item = Complex64>) -> Vec<Complex64> {
        let scale = 1.0 / self.n as f64;
        let mut z: Vec<Complex64> = x.map(|x| x * scale).collect();
        z.resize(self.n, Complex64::default());
        self.forward.process(&mut z);
        z
    }

    /// Coefficients of a real series.
    pub fn of_real(&self, x: &[f64]) -> Vec<Complex64> {
        self.coefficients(x.iter().map(|x| Complex64::new(*x, 0.0)))
    }

    /// The series of given coefficients.
    pub fn series(&self, mut c: Vec<Complex64>) -> Vec<Complex64> {
        self.inverse.process(&mut c);
        c
    }

    /// Signed index of bin b.
    fn index(&self, b: usize) -> f64 {
        if 2 * b > self.n { b as f64 - self.n as f64 } else { b as f64 }
    }

    /// Sets all bins above sub-harmonic `keep` to zero.
    pub fn cut(&self, c: &mut [Complex64], keep: usize) {
        for (b, c) in c.iter_mut().enumerate() {
            if self.index(b).abs() > keep as f64 {
                *c = Complex64::default();
            }
        }
    }

    /// A real series without what is above sub-harmonic `keep`.
    pub fn low_pass(&self, x: &[f64], keep: usize) -> Vec<f64> {
        if 2 * keep >= self.n {
            return x.to_vec();
        }
        let mut c = self.of_real(x);
        self.cut(&mut c, keep);
        self.series(c).into_iter().map(|z| z.re).collect()
    }

    /// Coefficients of the derivative in τ, the orbit lasting `periods` drive periods.
    pub fn derivative(&self, c: &[Complex64], periods: f64) -> Vec<Complex64> {
        c.iter()
            .enumerate()
            .map(
                |(b, c)| {
                    if 2 * b == self.n {
                        Complex64::default()
                    } else {
                        c * Complex64::new(0.0, self.index(b) / periods)
                    }
                },
            )
            .collect()
    }

    /// Coefficients of the second derivative in τ.
    pub fn second_derivative(&self, c: &[Complex64], periods: f64) -> Vec<Complex64> {
        c.iter().enumerate().map(|(b, c)| -c * (self.index(b) / periods).powi(2)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn fourier(n: usize) -> Fourier {
        Fourier::new(&mut FftPlanner::new(), n)
    }

    fn noise(n: usize) -> Vec<f64> {
        (0..n).map(|i| ((i * i * 31 + 7 * i) % 101) as f64 / 50.0 - 1.0).collect()
    }

    #[test]
    fn coefficients_are_those_of_a_naive_transform() {
        for n in [1, 2, 7, 60, 101] {
            let x = noise(n);
            for (j, c) in fourier(n).of_real(&x).iter().enumerate() {
                let naive: Complex64 = (0..n)
                    .map(|i| x[i] * Complex64::from_polar(1.0 / n as f64, -TAU * (i * j % n) as f64 / n as f64))
                    .sum();
                assert!((c - naive).norm() < 1e-12, "{n} {j}: {c} {naive}");
            }
        }
    }

    #[test]
    fn derivatives_of_a_tone_are_exact() {
        let (n, k) = (90, 3.0);
        let t = |i: usize| TAU * k * i as f64 / n as f64;
        let f = fourier(n);
        let x: Vec<f64> = (0..n).map(|i| 0.4 + (t(i) / 3.0).sin() - 2.0 * (5.0 * t(i) / 3.0).cos()).collect();
        let c = f.of_real(&x);
        let (rate, accel) = (f.series(f.derivative(&c, k)), f.series(f.second_derivative(&c, k)));
        for i in 0..n {
            let (a, b) = (t(i) / 3.0, 5.0 * t(i) / 3.0);
            assert!((rate[i].re - (a.cos() / 3.0 + 10.0 / 3.0 * b.sin())).abs() < 1e-12);
            assert!((accel[i].re - (-a.sin() / 9.0 + 50.0 / 9.0 * b.cos())).abs() < 1e-12);
        }
    }

    /// (3.27): the product of band-limited factors is the convolution of their coefficients, and
    /// its low sub-harmonics hold nothing folded down as long as three factors end below a fifth of
    /// the sampling rate.
    #[test]
    fn products_of_filtered_factors_are_convolutions() {
        let n = 60;
        let keep = n / 5;
        let f = fourier(n);
        let factors: Vec<Vec<f64>> = [0, 13, 29].iter().map(|s| f.low_pass(&noise(n + s)[*s..], keep)).collect();
        let product: Vec<f64> = (0..n).map(|i| factors.iter().map(|x| x[i]).product()).collect();
        let c: Vec<Vec<Complex64>> = factors.iter().map(|x| f.of_real(x)).collect();
        let at = |c: &[Complex64], j: i64| {
            if j.unsigned_abs() as usize <= keep { c[j.rem_euclid(n as i64) as usize] } else { Complex64::default() }
        };
        let reach = keep as i64;
        for (j, got) in f.of_real(&product).iter().enumerate().take(keep) {
            // Linear, not circular: no index wraps around.
            let direct: Complex64 = (-reach..=reach)
                .flat_map(|a| (-reach..=reach).map(move |b| (a, b)))
                .map(|(a, b)| at(&c[0], a) * at(&c[1], b) * at(&c[2], j as i64 - a - b))
                .sum();
            assert!((got - direct).norm() < 1e-12, "{j}: {got} {direct}");
        }
    }
}

//! Power spectral density by Welch's method, and the lines in it.
//!
//! One-sided density of a series x sampled at f_s, averaged over K half-overlapping pieces of L
//! samples, each with its mean removed and a periodic Hann window w applied: P(f_m) = c_m / (K f_s
//! Σ w²) Σ_k |Σ_n w_n x_{k,n} e^{−2πi mn/L}|², f_m = m f_s/L, c = 2 but for f = 0 and the Nyquist
//! frequency, where it is 1; so Σ P Δf is the mean square of the windowed pieces. Unit: that of x
//! squared, per Hz. A line between two bins is found from the ratio of the two largest (exact for
//! one line under a Hann window): with r = √(P_{m±1}/P_m), δ = (2r − 1)/(1 + r) bins, amplitude A =
//! (2/L) |X_m|·(1 − δ²)/sinc δ. Reference: Welch 1967; Harris 1978.
//!
//! Limits: lines closer than two bins are one; 1/f drift stronger than a line within a few bins
//! hides it.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

use crate::statistics::median;

/// A spectrum that cannot be computed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// No stretch holds one piece.
    #[error("the longest stretch has {longest} samples and one piece has {piece}")]
    TooShort {
        /// Samples in the longest stretch.
        longest: usize,
        /// Samples in a piece.
        piece: usize,
    },
    /// A piece of fewer than eight samples, or a rate that is not positive.
    #[error("a piece of {piece} samples at {rate_hz} Hz has no spectrum (8 samples and a rate above 0 are needed)")]
    Settings {
        /// Samples in a piece.
        piece: usize,
        /// Sampling rate, Hz.
        rate_hz: f64,
    },
}

/// A one-sided power spectral density.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Density {
    /// Spacing of the bins, Hz.
    pub bin_hz: f64,
    /// Equivalent noise bandwidth of the window, Hz (1.5 bins for Hann).
    pub noise_bandwidth_hz: f64,
    /// Number of pieces averaged.
    pub averages: usize,
    /// Samples in a piece.
    pub piece: usize,
    /// Density at 0, bin_hz, 2 bin_hz, … in unit²/Hz.
    pub density: Vec<f64>,
}

impl Density {
    /// Frequency of bin m, Hz.
    pub fn frequency(&self, m: usize) -> f64 {
        m as f64 * self.bin_hz
    }

    /// Mean square between two frequencies (both bins included), unit².
    pub fn power(&self, from_hz: f64, to_hz: f64) -> f64 {
        self.density
            .iter()
            .enumerate()
            .filter(|(m, _)| (from_hz..=to_hz).contains(&self.frequency(*m)))
            .map(|(_, p)| p * self.bin_hz)
            .sum()
    }
}

/// A line in a spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Interpolated frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude of the sinusoid that would make this line, in the series' unit.
    pub amplitude: f64,
    /// Density at the line's bin, unit²/Hz.
    pub density: f64,
    /// That density over the median of its surroundings.
    pub prominence: f64,
}

/// The periodic Hann window w_n = sin²(πn/L).
pub fn hann(length: usize) -> Vec<f64> {
    (0..length).map(|n| (PI * n as f64 / length as f64).sin().powi(2)).collect()
}

/// The largest length not above `length` whose only prime factors are 2, 3 and 5 (fast to
/// transform); 1 for 0.
pub fn fast_length(length: usize) -> usize {
    (1..=length)
        .rev()
        .find(|&n| {
            let mut rest = n;
            for p in [2, 3, 5] {
                while rest % p == 0 {
                    rest /= p;
                }
            }
            rest == 1
        })
        .unwrap_or(1)
}

/// Welch's one-sided density over several unbroken stretches of one series; no piece spans two
/// stretches.
///
/// # Errors
/// [`SpectrumError`] where no stretch holds one piece of `piece` samples, or the settings make no
/// sense.
pub fn welch(stretches: &[&[f64]], rate_hz: f64, piece: usize) -> Result<Density, SpectrumError> {
    if piece < 8 || !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err(SpectrumError::Settings { piece, rate_hz });
    }
    let longest = stretches.iter().map(|s| s.len()).max().unwrap_or(0);
    if longest < piece {
        return Err(SpectrumError::TooShort { longest, piece });
    }
    let window = hann(piece);
    let window_power: f64 = window.iter().map(|w| w * w).sum();
    let window_sum: f64 = window.iter().sum();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(piece);
    let (mut input, mut output) = (transform.make_input_vec(), transform.make_output_vec());
    let mut scratch = transform.make_scratch_vec();
    let mut density = vec![0.0; output.len()];
    let mut averages = 0usize;
    for stretch in stretches.iter().filter(|s| s.len() >= piece) {
        for start in (0..=stretch.len() - piece).step_by((piece / 2).max(1)) {
            let part = &stretch[start..start + piece];
            let mean = part.iter().sum::<f64>() / piece as f64;
            for ((i, x), w) in input.iter_mut().zip(part).zip(&window) {
                *i = (x - mean) * w;
            }
            if transform.process_with_scratch(&mut input, &mut output, &mut scratch).is_err() {
                return Err(SpectrumError::Settings { piece, rate_hz });
            }
            for (d, z) in density.iter_mut().zip(&output) {
                *d += z.norm_sqr();
            }
            averages += 1;
        }
    }
    let last = density.len() - 1;
    for (m, d) in density.iter_mut().enumerate() {
        let sides = if m == 0 || (piece.is_multiple_of(2) && m == last) { 1.0 } else { 2.0 };
        *d *= sides / (averages as f64 * rate_hz * window_power);
    }
    Ok(Density {
        bin_hz: rate_hz / piece as f64,
        noise_bandwidth_hz: rate_hz * window_power / (window_sum * window_sum),
        averages,
        piece,
        density,
    })
}

/// Median of the density around bin m (± `half` bins, the line's own three left out).
pub fn surroundings(density: &[f64], m: usize, half: usize) -> f64 {
    let from = m.saturating_sub(half).max(1);
    let to = (m + half).min(density.len().saturating_sub(1));
    let mut around: Vec<f64> = (from..=to).filter(|&i| i.abs_diff(m) > 2).map(|i| density[i]).collect();
    median(&mut around)
}

/// The ratio to its median that an averaged periodogram of Gaussian noise exceeds with probability
/// `p` in one bin: χ² with ν = 2·36K²/(19K − 1)·½ degrees of freedom (Welch's count for
/// half-overlapping Hann pieces), by Wilson and Hilferty's cube root.
pub fn threshold(averages: usize, p: f64) -> f64 {
    let k = averages.max(1) as f64;
    let freedom = if averages <= 1 { 2.0 } else { 36.0 * k * k / (19.0 * k - 1.0) };
    let z = {
        // Abramowitz and Stegun 26.2.23, |error| < 4.5e-4.
        let t = (-2.0 * p.clamp(1e-300, 0.5).ln()).sqrt();
        t - (2.515_517 + 0.802_853 * t + 0.010_328 * t * t)
            / (1.0 + 1.432_788 * t + 0.189_269 * t * t + 0.001_308 * t.powi(3))
    };
    let v = 2.0 / (9.0 * freedom);
    ((1.0 - v + z * v.sqrt()) / (1.0 - v)).powi(3)
}

/// The line at bin m, whether it stands out or not.
pub fn line_at(spectrum: &Density, m: usize) -> Option<Line> {
    let density = *spectrum.density.get(m)?;
    let prominence = density / surroundings(&spectrum.density, m, 24).max(f64::MIN_POSITIVE);
    let (offset, amplitude) = refine(spectrum, m);
    Some(Line { frequency_hz: (m as f64 + offset) * spectrum.bin_hz, amplitude, density, prominence })
}

/// Refines the local maximum at bin m: (offset δ in bins within ±½, amplitude).
fn refine(spectrum: &Density, m: usize) -> (f64, f64) {
    let d = &spectrum.density;
    let here = d[m].sqrt();
    let left = if m > 0 { d[m - 1].sqrt() } else { 0.0 };
    let right = d.get(m + 1).map_or(0.0, |p| p.sqrt());
    if here == 0.0 {
        return (0.0, 0.0);
    }
    let (side, r) = if right >= left { (1.0, right / here) } else { (-1.0, left / here) };
    let delta = ((2.0 * r - 1.0) / (1.0 + r)).clamp(0.0, 0.5);
    let sinc = if delta == 0.0 { 1.0 } else { (PI * delta).sin() / (PI * delta) };
    let amplitude = (2.0 * d[m] * spectrum.noise_bandwidth_hz).sqrt() * (1.0 - delta * delta) / sinc;
    (side * delta, amplitude)
}

/// Lines that stand out of their surroundings, strongest first, at most `most`.
///
/// A line is a local maximum above the median of the ± 24 bins around it by the factor that noise
/// exceeds anywhere in the spectrum once in a thousand spectra. The three lowest bins, which the
/// removed mean distorts, have none.
pub fn lines(spectrum: &Density, most: usize) -> Vec<Line> {
    let d = &spectrum.density;
    let limit = threshold(spectrum.averages, 1e-3 / d.len().max(1) as f64);
    let mut found = Vec::new();
    for m in 3..d.len().saturating_sub(1) {
        if !(d[m] > d[m - 1] && d[m] >= d[m + 1]) {
            continue;
        }
        found.extend(line_at(spectrum, m).filter(|l| l.prominence > limit));
    }
    found.sort_by(|a, b| b.density.total_cmp(&a.density));
    // A side lobe of a strong line is not a line: Hann's first is 31.5 dB below the main lobe,
    // within four bins.
    let mut kept: Vec<Line> = Vec::new();
    for line in found {
        let shadowed = kept.iter().any(|k| {
            (k.frequency_hz - line.frequency_hz).abs() < 4.5 * spectrum.bin_hz && line.density < 2e-3 * k.density
        });
        if !shadowed && kept.len() < most {
            kept.push(line);
        }
    }
    kept
}

/// One Fourier sum (2/Σw) Σ w_n (x_n − x̄) e^{−2πi f n/f_s} under a Hann window: complex amplitude
/// at any frequency. Its modulus is the amplitude of a sinusoid at that frequency; the phase refers
/// to the first sample.
pub fn amplitude_at(x: &[f64], rate_hz: f64, frequency_hz: f64) -> Complex<f64> {
    if x.is_empty() {
        return Complex::new(0.0, 0.0);
    }
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let mut sum = Complex::new(0.0, 0.0);
    let mut weight = 0.0;
    for (n, (x, w)) in x.iter().zip(hann(x.len())).enumerate() {
        let turns = (frequency_hz / rate_hz * n as f64).fract();
        let (s, c) = (TAU * turns).sin_cos();
        sum += Complex::new(c, -s) * (w * (x - mean));
        weight += w;
    }
    if weight > 0.0 { sum * (2.0 / weight) } else { sum }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let unit = |rng: &mut ChaCha8Rng| rng.next_u64() as f64 / u64::MAX as f64;
        (0..n).map(|_| (-2.0 * unit(&mut rng).max(1e-300).ln()).sqrt() * (TAU * unit(&mut rng)).cos()).collect()
    }

    #[test]
    fn one_piece_equals_a_fourier_sum_written_out() {
        let (n, rate) = (60, 12.0);
        let x = noise(n, 1);
        let got = welch(&[&x], rate, n).unwrap();
        let mean = x.iter().sum::<f64>() / n as f64;
        let w: Vec<f64> = (0..n).map(|i| 0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()).collect();
        let power: f64 = w.iter().map(|w| w * w).sum();
        for m in 0..=n / 2 {
            let (mut re, mut im) = (0.0, 0.0);
            for i in 0..n {
                let angle = TAU * (m * i) as f64 / n as f64;
                re += w[i] * (x[i] - mean) * angle.cos();
                im += w[i] * (x[i] - mean) * angle.sin();
            }
            let sides = if m == 0 || m == n / 2 { 1.0 } else { 2.0 };
            let want = sides * (re * re + im * im) / (rate * power);
            assert!((got.density[m] - want).abs() < 1e-12 * (1.0 + want), "bin {m}: {} {want}", got.density[m]);
        }
        assert!((got.noise_bandwidth_hz - 1.5 * rate / n as f64).abs() < 1e-12);
    }

    #[test]
    fn parseval_holds_for_odd_and_even_pieces() {
        for n in [500, 501] {
            let x = noise(n, 2);
            let got = welch(&[&x], 250.0, n).unwrap();
            let mean = x.iter().sum::<f64>() / n as f64;
            let w = hann(n);
            let weighted: f64 = x.iter().zip(&w).map(|(x, w)| (w * (x - mean)).powi(2)).sum();
            let want = weighted / w.iter().map(|w| w * w).sum::<f64>();
            let all: f64 = got.density.iter().map(|p| p * got.bin_hz).sum();
            assert!((all / want - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn white_noise_has_its_level() {
        let (rate, sigma) = (100.0, 3.0);
        let x: Vec<f64> = noise(200_000, 3).iter().map(|x| sigma * x).collect();
        let got = welch(&[&x], rate, 500).unwrap();
        let inner = &got.density[2..got.density.len() - 2];
        let mean = inner.iter().sum::<f64>() / inner.len() as f64;
        let want = 2.0 * sigma * sigma / rate;
        assert!((mean / want - 1.0).abs() < 0.01, "{mean} {want}");
        assert!(lines(&got, 20).is_empty(), "noise alone has no lines: {:?}", lines(&got, 20));
    }

    #[test]
    fn a_sinusoid_between_bins_has_its_frequency_and_amplitude() {
        let rate = 500.0;
        for f in [4.93, 5.0, 5.013, 7.777] {
            let x: Vec<f64> = (0..30_000).map(|i| 0.25 * (TAU * f * i as f64 / rate + 0.7).cos() + 3.0).collect();
            let spectrum = welch(&[&x], rate, 6000).unwrap();
            let line = lines(&spectrum, 5)[0];
            assert!((line.frequency_hz - f).abs() < 2e-4 * spectrum.bin_hz.max(1.0), "{f}: {}", line.frequency_hz);
            assert!((line.amplitude / 0.25 - 1.0).abs() < 2e-3, "{f}: {}", line.amplitude);
            let z = amplitude_at(&x, rate, f);
            assert!((z.norm() - 0.25).abs() < 1e-4 && (z.arg() - 0.7).abs() < 1e-3);
        }
    }

    #[test]
    fn two_lines_in_noise_are_both_found_over_two_stretches() {
        let rate = 500.0;
        let e = noise(40_000, 4);
        let x: Vec<f64> = (0..40_000)
            .map(|i| {
                let t = i as f64 / rate;
                (TAU * 2.5 * t).sin() + 0.2 * (TAU * 5.0 * t).sin() + 0.3 * e[i]
            })
            .collect();
        let spectrum = welch(&[&x[..21_000], &x[21_000..]], rate, 5000).unwrap();
        assert_eq!(spectrum.averages, 7 + 6);
        let found = lines(&spectrum, 12);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!((found[0].frequency_hz - 2.5).abs() < 0.01 && (found[0].amplitude - 1.0).abs() < 0.02);
        assert!((found[1].frequency_hz - 5.0).abs() < 0.01 && (found[1].amplitude - 0.2).abs() < 0.02);
    }

    #[test]
    fn thresholds_are_quantiles() {
        // One periodogram is exponential: P(x > r·median) = 2^-r.
        let r = threshold(1, 2f64.powi(-12));
        assert!((r - 12.0).abs() < 1.2, "{r}");
        assert!(threshold(50, 1e-6) < threshold(8, 1e-6));
    }

    #[test]
    fn bad_requests_are_errors() {
        let x = [0.0; 10];
        assert_eq!(welch(&[&x], 10.0, 16), Err(SpectrumError::TooShort { longest: 10, piece: 16 }));
        assert!(matches!(welch(&[&x], 0.0, 8), Err(SpectrumError::Settings { .. })));
        assert!(matches!(welch(&[&x], 1.0, 4), Err(SpectrumError::Settings { .. })));
    }

    #[test]
    fn fast_lengths_have_small_factors() {
        assert_eq!(fast_length(13), 12);
        assert_eq!(fast_length(6000), 6000);
        assert_eq!(fast_length(0), 1);
    }
}

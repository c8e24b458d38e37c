//! The sensors' noise and the frequency above which a record holds nothing else.
//!
//! The power spectral density of the angle is estimated from its second difference (which whirling
//! leaves stationary), S_φ(f) = S_ΔΔφ(f) / |2 sin(π f Δt)|⁴, averaged over Hann windows that overlap
//! by half and reach to both ends of a short record (Welch 1967). Noise of encoders is close to
//! white, so that its level is the median of S_φ over the top of the band, over what the median of
//! such an estimate is beside its mean ((1 − 2/9ν)³ for χ² of ν degrees of freedom, Wilson and
//! Hilferty 1931: 0.89 for three windows); the signal ends where S_φ, averaged over a few bins, last
//! exceeds that level by a factor.

use realfft::RealFftPlanner;

/// What the spectrum says about noise and signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of white noise on each sample, rad.
    pub sigma: f64,
    /// Standard error of its square, as a share of it.
    pub square_error: f64,
    /// Highest frequency at which the signal stands above the noise, Hz.
    pub signal_end_hz: f64,
    /// Highest frequency at which its density is a hundred times the noise's, Hz.
    pub clear_end_hz: f64,
    /// Frequency below which lie 99 % of the acceleration's power (of the part above the noise),
    /// Hz.
    pub acceleration_99_hz: f64,
}

/// Ratio of signal to noise density at which the signal is taken to end.
const ABOVE: f64 = 3.0;
/// Ratio up to which the sign of a velocity is beyond doubt most of the time.
const CLEAR: f64 = 100.0;

/// Estimates noise and the end of the signal from unbroken stretches of one angle, sampled at
/// `step_s`. `None` where no stretch has 64 samples.
pub fn estimate<'a>(stretches: impl Iterator<Item = &'a [f64]> + Clone, step_s: f64) -> Option<Noise> {
    let longest = stretches.clone().map(<[f64]>::len).max().unwrap_or(0);
    if longest < 64 {
        return None;
    }
    let size = 2048.min(1 << (longest - 2).ilog2());
    let mut planner = RealFftPlanner::<f64>::new();
    let fft = planner.plan_fft_forward(size);
    let window: Vec<f64> =
        (0..size).map(|i| 0.5 - 0.5 * (core::f64::consts::TAU * i as f64 / size as f64).cos()).collect();
    let power: f64 = window.iter().map(|w| w * w).sum();
    let (mut input, mut output) = (fft.make_input_vec(), fft.make_output_vec());
    let mut density = vec![0.0; size / 2 + 1];
    let (mut count, mut shared) = (0.0, 0.0);
    // A few hundred windows settle the level; more of a long record add nothing.
    let total: usize = stretches.clone().map(<[f64]>::len).sum();
    let stride = (size / 2).max(total / 400);
    for x in stretches {
        let starts = starts(x.len(), size, stride);
        for &start in &starts {
            for i in 0..size {
                let k = start + i;
                input[i] = (x[k] - 2.0 * x[k + 1] + x[k + 2]) * window[i];
            }
            if fft.process(&mut input, &mut output).is_ok() {
                for (d, z) in density.iter_mut().zip(&output) {
                    *d += z.norm_sqr() / power;
                }
                count += 1.0;
            }
        }
        shared += shared_by(&starts, &window, power);
    }
    if count == 0.0 {
        return None;
    }
    // Variance per bin of white noise of unit variance is 1 here, so that `angle` is a noise
    // variance bin by bin.
    let angle: Vec<f64> = density
        .iter()
        .enumerate()
        .map(|(k, d)| {
            let shape = (2.0 * (core::f64::consts::PI * k as f64 / size as f64).sin()).powi(4);
            if k == 0 { f64::INFINITY } else { d / count / shape }
        })
        .collect();
    let mut top: Vec<f64> = angle[size * 3 / 10..size * 19 / 40].to_vec();
    top.sort_by(f64::total_cmp);
    // Degrees of freedom of a bin; neighbours share a bin and a half.
    let freedom: f64 = 2.0 * count * count / shared;
    let floor = top[top.len() / 2] / (1.0 - 2.0 / (9.0 * freedom)).powi(3);
    let square_error = (core::f64::consts::FRAC_PI_2 * 2.0 / freedom * 1.5 / top.len() as f64).sqrt();
    let bin_hz = 1.0 / (size as f64 * step_s);
    let reach = 4;
    let end = |ratio: f64| {
        (1 + reach..size / 2 - reach)
            .rev()
            .find(|&k| angle[k - reach..=k + reach].iter().sum::<f64>() / (2 * reach + 1) as f64 > ratio * floor)
            .unwrap_or(1)
    };
    let (last, clear) = (end(ABOVE), end(CLEAR));
    // The acceleration's power is that of the second difference, up to a factor, where the signal
    // is.
    let whole: f64 = density[1..=last].iter().sum();
    let mut sum = 0.0;
    let busy = (1..=last)
        .find(|&k| {
            sum += density[k];
            sum >= 0.99 * whole
        })
        .unwrap_or(last);
    Some(Noise {
        sigma: floor.sqrt(),
        square_error,
        signal_end_hz: last as f64 * bin_hz,
        clear_end_hz: clear as f64 * bin_hz,
        acceleration_99_hz: busy as f64 * bin_hz,
    })
}

/// Where windows of some samples begin in a stretch: a stride apart where that leaves out at most an
/// eighth of it at its end; otherwise evenly over all of it, at most a stride apart, and one in its
/// middle where it is little longer.
fn starts(samples: usize, size: usize, stride: usize) -> Vec<usize> {
    let Some(last) = samples.checked_sub(size + 2) else { return Vec::new() };
    if 8 * (last % stride) <= samples {
        return (0..=last / stride).map(|i| i * stride).collect();
    }
    if 2 * last < stride {
        return vec![last / 2];
    }
    let steps = last.div_ceil(stride);
    (0..=steps).map(|i| i * last / steps).collect()
}

/// Σ ρ² over all pairs of windows, with ρ = Σ wᵢ wᵢ₊ₛ/Σ wᵢ² of two that begin s samples apart: the
/// mean of K periodograms has 2 K²/Σ ρ² degrees of freedom (Welch 1967).
fn shared_by(starts: &[usize], window: &[f64], power: f64) -> f64 {
    let correlation =
        |apart: usize| window.iter().zip(window.iter().skip(apart)).map(|(a, b)| a * b).sum::<f64>() / power;
    let one = |(i, start): (usize, &usize)| {
        let next = starts[i + 1..].iter().map(|s| s - start).take_while(|apart| *apart < window.len());
        1.0 + 2.0 * next.map(|apart| correlation(apart).powi(2)).sum::<f64>()
    };
    starts.iter().enumerate().map(one).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn finds_the_level_of_white_noise_and_the_end_of_a_tone() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let step = 2e-3;
        let x: Vec<f64> = (0..40_000)
            .map(|i| {
                let t = i as f64 * step;
                30.0 * t + (core::f64::consts::TAU * 23.0 * t).sin() + 0.01 * (rng.random::<f64>() - 0.5)
            })
            .collect();
        let noise = estimate(std::iter::once(&x[..]), step).unwrap();
        let expected = 0.01 / 12f64.sqrt();
        assert!((noise.sigma / expected - 1.0).abs() < 0.05, "{} {expected}", noise.sigma);
        assert!((noise.signal_end_hz - 23.0).abs() < 3.0, "{}", noise.signal_end_hz);
    }

    #[test]
    fn quantisation_is_noise_of_a_step_over_root_twelve() {
        let step = 2e-3;
        let q = 1.0 / 4096.0;
        let x: Vec<f64> = (0..60_000)
            .map(|i| {
                let t = i as f64 * step;
                let v = 5.0 * (6.1 * t).sin() + 3.0 * (17.3 * t).cos();
                (v / q).floor() * q + 0.5 * q
            })
            .collect();
        let noise = estimate(std::iter::once(&x[..]), step).unwrap();
        assert!((noise.sigma / (q / 12f64.sqrt()) - 1.0).abs() < 0.2, "{}", noise.sigma);
    }

    /// Over 200 records of few windows the level has no bias, and its error is the one told.
    #[test]
    fn the_level_of_a_short_record_is_right_within_its_error() {
        for samples in [700, 5000, 9000] {
            let squares: Vec<(f64, f64)> = (0..200)
                .map(|seed| {
                    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
                    let x: Vec<f64> = (0..samples).map(|_| rng.random::<f64>() - 0.5).collect();
                    let noise = estimate(std::iter::once(&x[..]), 5e-3).unwrap();
                    (12.0 * noise.sigma * noise.sigma, noise.square_error)
                })
                .collect();
            let mean = squares.iter().map(|s| s.0).sum::<f64>() / 200.0;
            let scatter = (squares.iter().map(|s| (s.0 - mean).powi(2)).sum::<f64>() / 199.0).sqrt();
            let told = squares[0].1;
            assert!((mean - 1.0).abs() < 0.25 * told + 0.005, "{samples}: {mean}, {told}");
            assert!((0.75..1.3).contains(&(scatter / told)), "{samples}: {scatter}, {told}");
        }
    }

    #[test]
    fn windows_lie_over_all_of_a_stretch() {
        assert_eq!(starts(624, 512, 256), [55]);
        assert_eq!(starts(767, 512, 256), [0, 253]);
        assert_eq!(starts(2050, 2048, 1024), [0]);
        assert!(starts(513, 512, 256).is_empty());
        assert_eq!(starts(30_000, 2048, 1024).last(), Some(&27_648));
        assert_eq!(starts(560, 512, 256), [0]);
    }

    /// Noise that falls along a record counts as much as it lasts.
    #[test]
    fn the_quiet_end_of_a_short_record_counts() {
        let mut squares = 0.0;
        for seed in 0..100 {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let size = |i: usize| if i < 380 { 1.5 } else { 0.5 };
            let x: Vec<f64> = (0..760).map(|i| size(i) * (rng.random::<f64>() - 0.5)).collect();
            squares += 12.0 * estimate(std::iter::once(&x[..]), 1e-2).unwrap().sigma.powi(2) / 100.0;
        }
        // The first window alone, which ends at 512, has 2.2.
        assert!((squares - 1.25).abs() < 0.2, "{squares}");
    }

    #[test]
    fn a_short_record_gives_no_estimate() {
        assert!(estimate(std::iter::once(&[0.0; 10][..]), 2e-3).is_none());
    }
}

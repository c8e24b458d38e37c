//! Decomposition of whirling angles on the circle: z = e^{iφ} instead of φ.
//!
//! An unwrapped angle that whirls drifts, its variance grows with the record's length and one mode
//! seems to hold everything; a wrapped one jumps. z does neither: |z| = 1 whatever the number of
//! turns. S = Z Zᴴ/m about the mean is Hermitian, its eigenvalues are real and its eigenvectors are
//! complex modes. A complex Hermitian problem of size n is the real symmetric one [[A, −B], [B, A]]
//! of size 2n with every eigenvalue twice; one eigenvector of each pair is kept. The phase of a
//! mode: its largest entry is real and positive.

use nalgebra::DMatrix;

use super::eigen;
use super::streaming::Accumulator;

/// A decomposition on the circle.
#[derive(Clone, Debug, PartialEq)]
pub struct CircularPod {
    /// Mean of each z, real and imaginary part: its length is 0 for an angle that visits all
    /// directions alike, 1 at rest.
    pub mean: Vec<(f64, f64)>,
    /// Shares of the energy, largest first.
    pub energy: Vec<f64>,
    /// Real parts of the modes.
    pub real: Vec<Vec<f64>>,
    /// Imaginary parts of the modes.
    pub imaginary: Vec<Vec<f64>>,
}

/// Cosines and sines of angles (rad, wrapped or unwrapped): n channels become 2n, all cosines
/// first.
pub fn on_circle(angles: &[&[f64]]) -> Vec<Vec<f64>> {
    let of = |f: fn(f64) -> f64| angles.iter().map(move |x| x.iter().map(|a| f(*a)).collect());
    of(f64::cos).chain(of(f64::sin)).collect()
}

/// Decomposes angles (rad, wrapped or unwrapped), one slice of equal length for each channel.
pub fn decompose(angles: &[&[f64]]) -> CircularPod {
    let mut sums = Accumulator::new(2 * angles.len());
    sums.add(&on_circle(angles).iter().map(Vec::as_slice).collect::<Vec<_>>());
    from_sums(&sums)
}

/// The decomposition of what [`on_circle`] made of the angles.
pub fn from_sums(sums: &Accumulator) -> CircularPod {
    let n = sums.mean().len() / 2;
    if n == 0 || sums.count() == 0 {
        return CircularPod { mean: Vec::new(), energy: Vec::new(), real: Vec::new(), imaginary: Vec::new() };
    }
    let mean = (0..n).map(|k| (sums.mean()[k], sums.mean()[n + k])).collect();
    let covariance = sums.covariance();
    // z_j z_k* = (c_j c_k + s_j s_k) + i (s_j c_k − c_j s_k).
    let a = covariance.view((0, 0), (n, n)) + covariance.view((n, n), (n, n));
    let cross = covariance.view((n, 0), (n, n));
    let b = cross - cross.transpose();
    let mut both = DMatrix::zeros(2 * n, 2 * n);
    both.view_mut((0, 0), (n, n)).copy_from(&a);
    both.view_mut((n, n), (n, n)).copy_from(&a);
    both.view_mut((0, n), (n, n)).copy_from(&-&b);
    both.view_mut((n, 0), (n, n)).copy_from(&b);
    // Numbers up to 1: always finite.
    let Some((values, vectors)) = eigen::symmetric(&both) else {
        return CircularPod { mean, energy: Vec::new(), real: Vec::new(), imaginary: Vec::new() };
    };
    let total: f64 = values.iter().map(|v| v.max(0.0)).sum::<f64>() / 2.0;
    let mut out = CircularPod { mean, energy: Vec::new(), real: Vec::new(), imaginary: Vec::new() };
    for k in 0..2 * n {
        if out.real.len() == n {
            break;
        }
        let column = vectors.column(k);
        let mut v: Vec<(f64, f64)> = (0..n).map(|j| (column[j], column[n + j])).collect();
        // (x, y) and (−y, x) are one complex vector times i: what an earlier one already holds is
        // taken out.
        for (re, im) in out.real.iter().zip(&out.imaginary) {
            let (mut p, mut q) = (0.0, 0.0);
            for j in 0..n {
                p += re[j] * v[j].0 + im[j] * v[j].1;
                q += re[j] * v[j].1 - im[j] * v[j].0;
            }
            for j in 0..n {
                v[j].0 -= p * re[j] - q * im[j];
                v[j].1 -= p * im[j] + q * re[j];
            }
        }
        let norm = v.iter().map(|z| z.0 * z.0 + z.1 * z.1).sum::<f64>().sqrt();
        if norm < 1e-6 {
            continue;
        }
        let largest = v
            .iter()
            .copied()
            .fold((0.0_f64, 0.0_f64), |l, z| if z.0.hypot(z.1) > l.0.hypot(l.1) * (1.0 + 1e-9) { z } else { l });
        let turn = largest.0.hypot(largest.1) * norm;
        let (tc, ts) = (largest.0 / turn, -largest.1 / turn);
        out.real.push(v.iter().map(|z| z.0 * tc - z.1 * ts).collect());
        out.imaginary.push(v.iter().map(|z| z.0 * ts + z.1 * tc).collect());
        let value = values[k].max(0.0);
        out.energy.push(if total > 0.0 { value / total } else { 0.0 });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whirling_keeps_its_modes_whatever_the_number_of_turns() {
        // Arm 2 whirls, arm 1 swings a little: in unwrapped angles everything would be arm 2's
        // drift.
        let record = |m: usize| -> (Vec<f64>, Vec<f64>) {
            let t = |i: usize| i as f64 * 0.05;
            ((0..m).map(|i| 1.0 * t(i).sin()).collect(), (0..m).map(|i| 3.0 * t(i) + 0.5 * (t(i)).cos()).collect())
        };
        let (a, b) = record(12_566);
        let long = decompose(&[&a, &b]);
        let short = decompose(&[&a[..2513], &b[..2513]]);
        assert!((long.energy[0] - short.energy[0]).abs() < 2e-3, "{:?} {:?}", long.energy, short.energy);
        assert!((long.energy.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        // The second arm visits all directions: variance 1; the first 1 − J0(1)² = 0.4145.
        assert!((long.energy[0] - 1.0 / 1.4145).abs() < 2e-3, "{:?}", long.energy);
        let wrapped: Vec<f64> = b.iter().map(|x| x.rem_euclid(std::f64::consts::TAU)).collect();
        assert!((decompose(&[&a, &wrapped]).energy[0] - long.energy[0]).abs() < 1e-12);
    }

    #[test]
    fn a_common_rotation_with_a_lag_is_one_complex_mode() {
        let a: Vec<f64> = (0..6283).map(|i| f64::from(i) * 0.01).collect();
        let b: Vec<f64> = a.iter().map(|x| x - 0.7).collect();
        let pod = decompose(&[&a, &b]);
        assert!(pod.energy[0] > 1.0 - 1e-9);
        let (re, im) = (pod.real[0][1], pod.imaginary[0][1]);
        let lag = im.atan2(re) - pod.imaginary[0][0].atan2(pod.real[0][0]);
        assert!((lag + 0.7).abs() < 1e-6, "{lag}");
    }
}

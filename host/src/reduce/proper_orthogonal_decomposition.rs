//! Proper orthogonal decomposition (the seed's (5.1)–(5.6)): the directions in which a record of
//! many channels moves most.
//!
//! X (n channels × m samples) about its mean; S = X Xᵀ/m; the modes are the eigenvectors of S, the
//! values λ its eigenvalues, and λ_i/Σλ is a mode's share of the energy. With masses, M^½ X is
//! decomposed and the modes are returned as M^−½ u, so that they are orthonormal with respect to M
//! and linear normal modes where the motion is linear.
//!
//! Three ways to the same numbers: the eigenvectors of S (n ≤ m), Sirovich's method of snapshots
//! from XᵀX (n > m; L. Sirovich, *Quarterly of Applied Mathematics* 45, 1987), or the singular
//! values of X through a QR factorisation, which resolve modes below 1e-8 of the first one's
//! amplitude where the squares do not. The sign of a mode: its largest entry is positive.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::eigen;
use super::gram::{FEW, gram, gram_of, product};

/// Share of the energy that the kept modes hold unless another is asked for.
pub const KEPT_ENERGY: f64 = 0.999;

/// How the decomposition is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Route {
    /// Covariance of the channels or of the snapshots, whichever is smaller.
    #[default]
    Covariance,
    /// Singular values of the record itself.
    Svd,
}

/// A decomposition.
#[derive(Clone, Debug, PartialEq)]
pub struct Pod {
    /// Mean of each channel.
    pub mean: Vec<f64>,
    /// Proper orthogonal values, largest first, in the channels' unit squared.
    pub values: Vec<f64>,
    /// Shares of the energy, largest first; they sum to 1 (all 0 for a record without motion).
    pub energy: Vec<f64>,
    /// Modes in the same order, one entry a channel, of unit length (with respect to the masses,
    /// where there are some).
    pub modes: Vec<Vec<f64>>,
}

impl Pod {
    /// How many modes hold at least this share of the energy.
    pub fn holding(&self, share: f64) -> usize {
        let mut sum = 0.0;
        for (i, e) in self.energy.iter().enumerate() {
            sum += e;
            if sum >= share {
                return i + 1;
            }
        }
        self.energy.len()
    }

    /// Modes whose value exceeds the rounding of the arithmetic: the rank that the record shows.
    pub fn rank(&self) -> usize {
        let first = self.values.first().copied().unwrap_or(0.0);
        self.values.iter().filter(|v| **v > 1e-12 * first && **v > 0.0).count()
    }
}

/// Decomposes a record: one slice of equal length for each channel. `masses`: one for each channel,
/// or none.
///
/// Channels of unequal length are cut to the shortest. An empty record gives no mode.
pub fn decompose(channels: &[&[f64]], masses: Option<&[f64]>, route: Route) -> Pod {
    let n = channels.len();
    let m = channels.iter().map(|c| c.len()).min().unwrap_or(0);
    let root = |i: usize| masses.and_then(|w| w.get(i)).map_or(1.0, |w| w.sqrt());
    let mean: Vec<f64> = channels.par_iter().map(|c| c[..m].iter().sum::<f64>() / m.max(1) as f64).collect();
    if n == 0 || m == 0 {
        return Pod { mean, values: Vec::new(), energy: Vec::new(), modes: Vec::new() };
    }
    if route == Route::Covariance && n <= m.min(FEW) {
        let squares = gram_of(m, n, |channel, first, to| {
            let (mean, root, from) = (mean[channel], root(channel), &channels[channel][first..]);
            to.iter_mut().zip(from).for_each(|(to, from)| *to = (from - mean) * root);
        });
        let (values, vectors) = eigenvectors(&(squares / m as f64));
        return ordered(mean, &values, &vectors, root);
    }
    let mut x = DMatrix::zeros(m, n);
    x.as_mut_slice().par_chunks_mut(m).enumerate().for_each(|(i, to)| {
        let (mean, root) = (mean[i], root(i));
        to.iter_mut().zip(channels[i]).for_each(|(to, from)| *to = (from - mean) * root);
    });
    let (values, vectors) = match route {
        Route::Svd => {
            let r = if m > n { x.qr().r() } else { x };
            let svd = r.svd(false, true);
            let vt = svd.v_t.unwrap_or_else(|| DMatrix::zeros(0, n));
            (svd.singular_values.iter().map(|s| s * s / m as f64).collect(), vt.transpose())
        }
        Route::Covariance if n <= m => eigenvectors(&(gram(&x) / m as f64)),
        Route::Covariance => {
            // Snapshots: XᵀX v = m λ v over the m samples, then u = X v/√(m λ).
            let turned = x.transpose();
            let (values, v) = eigenvectors(&(gram(&turned) / m as f64));
            let mut u = product(&turned, &v);
            let first = values.first().copied().unwrap_or(0.0);
            for (value, mut column) in values.iter().zip(u.column_iter_mut()) {
                let norm = column.norm();
                if *value > 1e-14 * first && norm > 0.0 {
                    column /= norm;
                } else {
                    column.fill(0.0);
                }
            }
            (values, u)
        }
    };
    ordered(mean, &values, &vectors, root)
}

/// Eigenvalues and eigenvectors; none of them where squares of the record's values leave the range
/// of the arithmetic.
fn eigenvectors(covariance: &DMatrix<f64>) -> (Vec<f64>, DMatrix<f64>) {
    eigen::symmetric(covariance).unwrap_or_else(|| (Vec::new(), DMatrix::zeros(covariance.nrows(), 0)))
}

/// A decomposition from a covariance that was accumulated elsewhere (see [`super::streaming`]).
pub fn from_covariance(mean: Vec<f64>, covariance: DMatrix<f64>, masses: Option<&[f64]>) -> Pod {
    let root = |i: usize| masses.and_then(|w| w.get(i)).map_or(1.0, |w| w.sqrt());
    let mut scaled = covariance;
    for i in 0..scaled.nrows() {
        for j in 0..scaled.ncols() {
            scaled[(i, j)] *= root(i) * root(j);
        }
    }
    let (values, vectors) = eigenvectors(&scaled);
    ordered(mean, &values, &vectors, root)
}

fn ordered(mean: Vec<f64>, values: &[f64], vectors: &DMatrix<f64>, root: impl Fn(usize) -> f64 + Sync) -> Pod {
    let mut order: Vec<usize> = (0..values.len()).filter(|&k| vectors.column(k).norm() > 0.5).collect();
    order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    // Rounding may leave a value just below 0.
    let sorted: Vec<f64> = order.iter().map(|k| values[*k].max(0.0)).collect();
    let total: f64 = sorted.iter().sum();
    let energy = sorted.iter().map(|v| if total > 0.0 { v / total } else { 0.0 }).collect();
    let modes = order
        .par_iter()
        .map(|k| {
            let mode: Vec<f64> = vectors.column(*k).iter().enumerate().map(|(i, u)| u / root(i)).collect();
            let largest =
                mode.iter().copied().fold(0.0_f64, |l, u| if u.abs() > l.abs() * (1.0 + 1e-9) { u } else { l });
            let sign = if largest < 0.0 { -1.0 } else { 1.0 };
            mode.into_iter().map(|u| sign * u).collect()
        })
        .collect();
    Pod { mean, values: sorted, energy, modes }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(m: usize) -> Vec<Vec<f64>> {
        // Two orthogonal directions in three channels with amplitudes 3 and 0.1, at frequencies
        // that average out.
        let (a, b) = ([2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0], [1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0]);
        (0..3)
            .map(|c| {
                (0..m)
                    .map(|i| {
                        let t = std::f64::consts::TAU * i as f64 / m as f64;
                        5.0 + 3.0 * a[c] * (3.0 * t).cos() + 0.1 * b[c] * (5.0 * t).sin()
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn finds_directions_and_shares_by_every_route() {
        let x = record(600);
        let channels: Vec<&[f64]> = x.iter().map(Vec::as_slice).collect();
        for route in [Route::Covariance, Route::Svd] {
            let pod = decompose(&channels, None, route);
            assert!((pod.energy[0] - 9.0 / 9.01).abs() < 1e-12 && (pod.values[1] - 0.005).abs() < 1e-12, "{pod:?}");
            assert!((pod.modes[0][0] - 2.0 / 3.0).abs() < 1e-9 && (pod.modes[1][2] * 1.5).abs() - 1.0 < 1e-9);
            assert_eq!((pod.holding(0.99), pod.holding(0.9999), pod.rank()), (1, 2, 2), "{route:?}");
            assert!((pod.mean[0] - 5.0).abs() < 1e-12);
        }
    }

    #[test]
    fn snapshots_agree_with_channels() {
        // More channels than samples.
        let wide: Vec<Vec<f64>> =
            (0..40).map(|c| (0..12).map(|i| ((c * i) as f64 * 0.37).sin() + (c as f64 * 0.1)).collect()).collect();
        let channels: Vec<&[f64]> = wide.iter().map(Vec::as_slice).collect();
        let (a, b) = (decompose(&channels, None, Route::Covariance), decompose(&channels, None, Route::Svd));
        for k in 0..8 {
            assert!((a.values[k] / b.values[k] - 1.0).abs() < 1e-8, "{k}");
            let dot: f64 = a.modes[k].iter().zip(&b.modes[k]).map(|(x, y)| x * y).sum();
            assert!((dot - 1.0).abs() < 1e-8, "{k}: {dot}");
        }
    }

    #[test]
    fn both_routes_agree_on_many_channels() {
        // Enough columns for several blocks, no two directions alike.
        let x: Vec<Vec<f64>> = (0..300)
            .map(|c: usize| {
                (0..700_usize)
                    .map(|i| {
                        let noise = ((i * 2_654_435_761 + c * 40_503) % 1000) as f64 * 1e-3;
                        (0.0137 * i as f64 + 0.1 * c as f64).sin() + 0.1 * noise
                    })
                    .collect()
            })
            .collect();
        let channels: Vec<&[f64]> = x.iter().map(Vec::as_slice).collect();
        let (a, b) = (decompose(&channels, None, Route::Covariance), decompose(&channels, None, Route::Svd));
        for k in 0..300 {
            assert!((a.energy[k] - b.energy[k]).abs() < 1e-13, "{k}: {} {}", a.energy[k], b.energy[k]);
        }
        for k in 0..2 {
            let dot: f64 = a.modes[k].iter().zip(&b.modes[k]).map(|(x, y)| x * y).sum();
            assert!((dot - 1.0).abs() < 1e-10, "{k}: {dot}");
        }
    }

    #[test]
    fn masses_turn_modes_into_normal_modes() {
        // Masses 1 and 4, springs such that the normal modes are not orthogonal in displacement.
        let modes = [[1.0, 0.5], [1.0, -0.5]];
        let x: Vec<Vec<f64>> = (0..2)
            .map(|c| {
                (0..5000)
                    .map(|i| {
                        let t = std::f64::consts::TAU * f64::from(i) / 5000.0;
                        modes[0][c] * (7.0 * t).cos() + 0.4 * modes[1][c] * (12.0 * t).cos()
                    })
                    .collect()
            })
            .collect();
        let channels: Vec<&[f64]> = x.iter().map(Vec::as_slice).collect();
        let pod = decompose(&channels, Some(&[1.0, 4.0]), Route::Covariance);
        assert!((pod.modes[0][1] / pod.modes[0][0] - 0.5).abs() < 1e-9, "{:?}", pod.modes);
        assert!((pod.modes[1][1] / pod.modes[1][0] + 0.5).abs() < 1e-9);
    }

    #[test]
    fn empty_and_still_records_give_no_wrong_mode() {
        assert!(decompose(&[], None, Route::Covariance).modes.is_empty());
        assert!(decompose(&[&[], &[]], None, Route::Svd).modes.is_empty());
        let still = decompose(&[&[1.0; 9], &[2.0; 9]], None, Route::Covariance);
        assert_eq!((still.energy.iter().sum::<f64>(), still.rank()), (0.0, 0));
    }
}

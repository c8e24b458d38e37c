//! Whether two clouds of points come from one distribution: the energy distance (Székely and
//! Rizzo 2004) and its permutation test.
//!
//! E = 2 ⟨|x − y|⟩ − ⟨|x − x′|⟩ − ⟨|y − y′|⟩ over all pairs: zero for one distribution, positive
//! otherwise. Points of a chaotic series resemble those just before them, so the test exchanges
//! whole blocks of consecutive points between the two clouds, seeded: p is the share of exchanges
//! (with what was found among them) that give at least as large an E.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Most points of each cloud.
pub const MOST_POINTS: usize = 1500;
/// Exchanges.
const PERMUTATIONS: usize = 999;
/// Autocorrelation below which points count as unrelated.
const UNRELATED: f64 = 0.1;

/// The distance of two clouds and how likely it is by chance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EnergyTest {
    /// Energy distance, in units of the features.
    pub distance: f64,
    /// Probability of at least this distance where both clouds come from one distribution.
    pub p_value: f64,
    /// Points in each block that is exchanged as a whole.
    pub block: usize,
    /// Points of the two clouds.
    pub points: [usize; 2],
    /// Exchanges tried.
    pub permutations: usize,
}

/// Compares two series of points (features of equal scale). None where either has fewer than four
/// blocks.
pub fn energy_test(x: &[Vec<f64>], y: &[Vec<f64>], seed: u64) -> Option<EnergyTest> {
    let (x, y) = (&x[..x.len().min(MOST_POINTS)], &y[..y.len().min(MOST_POINTS)]);
    let block = (2 * decorrelation(x).max(decorrelation(y))).max(2);
    let blocks: Vec<&[Vec<f64>]> = x.chunks_exact(block).chain(y.chunks_exact(block)).collect();
    let first = x.len() / block;
    let second = blocks.len() - first;
    if first < 4 || second < 4 {
        return None;
    }
    let n = blocks.len();
    // Sums of distances between blocks: exchanges need no more.
    let mut between = vec![0.0; n * n];
    for a in 0..n {
        for b in a..n {
            let sum: f64 = blocks[a].iter().flat_map(|p| blocks[b].iter().map(move |q| distance(p, q))).sum();
            between[a * n + b] = sum;
            between[b * n + a] = sum;
        }
    }
    let energy = |of_first: &[bool]| {
        let (mut inner, mut outer, mut cross) = (0.0, 0.0, 0.0);
        for a in 0..n {
            for b in 0..n {
                let d = between[a * n + b];
                match (of_first[a], of_first[b]) {
                    (true, true) => inner += d,
                    (false, false) => outer += d,
                    (true, false) => cross += d,
                    (false, true) => {}
                }
            }
        }
        let (n, m) = ((first * block) as f64, (second * block) as f64);
        2.0 * cross / (n * m) - inner / (n * n) - outer / (m * m)
    };
    let mut labels: Vec<bool> = (0..n).map(|i| i < first).collect();
    let found = energy(&labels);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut larger = 0;
    for _ in 0..PERMUTATIONS {
        labels.shuffle(&mut rng);
        larger += usize::from(energy(&labels) >= found * (1.0 - 1e-12));
    }
    Some(EnergyTest {
        distance: found,
        p_value: (1 + larger) as f64 / (1 + PERMUTATIONS) as f64,
        block,
        points: [first * block, second * block],
        permutations: PERMUTATIONS,
    })
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// The largest lag, over the features, at which the autocorrelation first falls below [`UNRELATED`]
/// (or two standard errors of no correlation at all, where that is more); at most a sixteenth of
/// the series, so that at least eight blocks are left, whose exchanges are still thousands: a
/// chaotic motion may dwell near an orbit for long.
fn decorrelation(x: &[Vec<f64>]) -> usize {
    let most = (x.len() / 16).max(1);
    let unrelated = UNRELATED.max(2.0 / (x.len().max(1) as f64).sqrt());
    let features = x.first().map_or(0, Vec::len);
    (0..features)
        .map(|f| {
            let mean = x.iter().map(|p| p[f]).sum::<f64>() / x.len() as f64;
            let power: f64 = x.iter().map(|p| (p[f] - mean).powi(2)).sum();
            let related = |lag: usize| {
                let sum: f64 = x.iter().zip(&x[lag.min(x.len())..]).map(|(a, b)| (a[f] - mean) * (b[f] - mean)).sum();
                power > 0.0 && sum / power > unrelated
            };
            (1..most).find(|l| !related(*l)).unwrap_or(most)
        })
        .max()
        .unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    /// A series whose points resemble their forerunners (correlation 0.8 a step), of a given mean.
    fn series(seed: u64, n: usize, mean: f64) -> Vec<Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut x = 0.0;
        (0..n)
            .map(|_| {
                x = 0.8 * x + rng.random_range(-1.0..1.0);
                vec![x + mean]
            })
            .collect()
    }

    #[test]
    fn correlated_series_of_one_distribution_are_rarely_told_apart_and_others_always() {
        let mut rejected = 0;
        for seed in 0..60 {
            let t = energy_test(&series(seed, 800, 0.0), &series(1000 + seed, 800, 0.0), 7).unwrap();
            assert!(t.block >= 4, "{t:?}");
            rejected += usize::from(t.p_value < 0.05);
        }
        // 3 expected; points taken as independent would give about 20.
        assert!(rejected <= 9, "{rejected}");
        let t = energy_test(&series(1, 800, 0.0), &series(2, 800, 1.5), 7).unwrap();
        assert!(t.p_value < 0.01, "{t:?}");
    }

    #[test]
    fn the_distance_of_two_points_is_known() {
        // Two clouds, each one repeated point, 3 apart: E = 2·3.
        let at = |x: f64| vec![vec![x]; 40];
        let t = energy_test(&at(0.0), &at(3.0), 1).unwrap();
        assert!((t.distance - 6.0).abs() < 1e-12);
        assert!(energy_test(&at(0.0)[..3], &at(1.0), 1).is_none());
        assert!(energy_test(&[], &[], 1).is_none());
    }
}

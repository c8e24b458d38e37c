//! Whether a cloud of points is like others that come from one distribution: the energy distance
//! (Székely and Rizzo 2004).
//!
//! E = 2 ⟨|x − y|⟩ − ⟨|x − x′|⟩ − ⟨|y − y′|⟩ over all pairs: zero for one distribution, positive
//! otherwise. Points of a chaotic series resemble those before them, for as long as the motion
//! dwells near an orbit: how far two series of one system are from each other is told by other
//! series of it alone, as long as they are, which its model makes. With s the mean distance of each
//! of K such series from the rest and s₀ that of the one in question, (ln s₀ − m)/(d √(1 + 1/K)) is
//! Student's t of K − 1 degrees of freedom, m and d the mean and the scatter of ln s.

use nalgebra::DMatrix;
use rayon::prelude::*;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Records of a model beside which one stands.
pub const RECORDS: usize = 12;
/// Most periods of the drive of each.
pub const MOST_PERIODS: f64 = 300.0;
/// Fewest points of a series.
const FEWEST_POINTS: usize = 10;

/// Where a series stands among others of one distribution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Among {
    /// Its mean energy distance from the others, in units of the features.
    pub distance: f64,
    /// Probability that one of the others is as far from the rest.
    pub p_value: f64,
    /// Points that are exchanged as a whole: those of a record.
    pub block: usize,
    /// Points of the series, and of each of the others.
    pub points: [usize; 2],
    /// Others, each of which takes its place once.
    pub permutations: usize,
}

/// Compares a series of points (features of equal scale) with others, of which as many points count
/// as the shortest has. None with fewer than three others or ten points.
pub fn among(of: &[Vec<f64>], others: &[Vec<Vec<f64>>]) -> Option<Among> {
    let shortest = others.iter().map(Vec::len).min()?.min(of.len());
    if others.len() < 3 || shortest < FEWEST_POINTS {
        return None;
    }
    let all: Vec<&[Vec<f64>]> =
        core::iter::once(of).chain(others.iter().map(Vec::as_slice)).map(|c| &c[..shortest]).collect();
    let n = all.len();
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|a| (a..n).map(move |b| (a, b))).collect();
    let mean = |&(a, b): &(usize, usize)| {
        let sum: f64 = all[a].iter().flat_map(|p| all[b].iter().map(move |q| distance(p, q))).sum();
        sum / (shortest * shortest) as f64
    };
    let found: Vec<f64> = pairs.par_iter().map(mean).collect();
    let mut between = DMatrix::zeros(n, n);
    for (&(a, b), d) in pairs.iter().zip(&found) {
        (between[(a, b)], between[(b, a)]) = (*d, *d);
    }
    let from_others = |a: usize| {
        let of = |b: usize| 2.0 * between[(a, b)] - between[(a, a)] - between[(b, b)];
        (1..n).filter(|b| *b != a).map(of).sum::<f64>() / (1..n).filter(|b| *b != a).count() as f64
    };
    let (own, logs) = (from_others(0), (1..n).map(|a| from_others(a).max(f64::MIN_POSITIVE).ln()).collect::<Vec<_>>());
    let k = logs.len() as f64;
    let m = logs.iter().sum::<f64>() / k;
    let scatter = (logs.iter().map(|l| (l - m).powi(2)).sum::<f64>() / (k - 1.0)).sqrt();
    let t = (own.max(f64::MIN_POSITIVE).ln() - m) / (scatter * (1.0 + 1.0 / k).sqrt());
    let student = StudentsT::new(0.0, 1.0, k - 1.0).ok()?;
    t.is_finite().then(|| Among {
        distance: own,
        p_value: student.sf(t),
        block: shortest,
        points: [shortest; 2],
        permutations: others.len(),
    })
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

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

    /// Of series that resemble their forerunners for long, one of the same kind has any probability,
    /// one of another a small one.
    #[test]
    fn a_series_among_its_like_has_any_probability_and_another_a_small_one() {
        let others = |seed: u64| (1..=12).map(|k| series(seed + 100 * k, 300, 0.0)).collect::<Vec<_>>();
        let p = |seed: u64| among(&series(seed, 300, 0.0), &others(seed)).unwrap().p_value;
        let all: Vec<f64> = (0..60).map(p).collect();
        let below = |limit: f64| all.iter().filter(|p| **p < limit).count();
        assert!(below(0.05) <= 8 && (15..=45).contains(&below(0.5)), "{} {}", below(0.05), below(0.5));
        let found = among(&series(1, 300, 1.5), &others(7)).unwrap();
        assert!(found.distance > 0.2 && found.p_value < 0.01, "{found:?}");
        assert!(among(&series(1, 9, 0.0), &others(7)).is_none());
        assert!(among(&series(1, 300, 0.0), &others(7)[..2]).is_none());
    }

    #[test]
    fn the_distance_of_two_points_is_known() {
        // Clouds of one repeated point each: at 3 from others at 0, 1 and 2, on the average 2·2; of
        // these the mean distances from the rest are 3, 2 and 3.
        let at = |x: f64| vec![vec![x]; 40];
        let found = among(&at(3.0), &[at(0.0), at(1.0), at(2.0)]).unwrap();
        assert!(
            (found.distance - 4.0).abs() < 1e-12 && (found.points, found.permutations) == ([40; 2], 3),
            "{found:?}"
        );
    }
}

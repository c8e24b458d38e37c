//! Average mutual information of a series with itself at a lag, (2.18): I(t) = Σ_{a,b} P_AB(a, b)
//! log₂ [P_AB(a, b) / (P_A(a) P_B(b))], in bits; A the samples s(i), B the samples s(i + t).
//!
//! Probabilities are shares in equal bins over the circle or over the span. The time delay of an
//! embedding is the first lag at which I has a minimum. Where the minima are shallow (in the seed's
//! own case 5, 15, 18 and 24, Fig. 3.2) the first one is an accident of the bins:
//! [`Minimum::depth`] says how far I rises after each before it falls below it again, in units of
//! its fall from I(1) to its least value, and [`recommended`] takes the first that is deeper than a
//! threshold.
//!
//! Bias: with N pairs and B bins, independent samples give about (B − 1)²/(2 N ln 2) bits instead
//! of 0 (Miller 1955); [`Information::bias`] states it. Cost: one increment of a table a pair;
//! several lags at a time, so that two increments of the same cell never follow each other. Memory:
//! bounded, but for one byte a sample.

use rayon::prelude::*;
use serde::Serialize;

use super::observable::Observable;

/// Most bins an axis.
pub const MOST_BINS: usize = 64;
/// Lags counted in one pass over the samples.
const TOGETHER: usize = 4;
/// Samples between two emptyings of the 16-bit tables.
const BLOCK: usize = 65_535;

/// I(t) at lags 1 … n.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Information {
    /// Bits at lags 1, 2, …; none beyond the longest stretch.
    pub bits: Vec<f64>,
    /// Bins an axis.
    pub bins: usize,
    /// Bits that independent samples would give.
    pub bias: f64,
}

/// A local minimum of I.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Minimum {
    /// Lag, samples.
    pub lag: usize,
    /// I there, bits.
    pub bits: f64,
    /// Rise from it to the highest value before I falls below it again, over I(1) − min I.
    pub depth: f64,
}

/// I at lags 1 … `lags` with `bins` (2 … 64) bins.
pub fn average_mutual_information(series: &Observable, lags: usize, bins: usize) -> Information {
    let bins = bins.clamp(2, MOST_BINS);
    let longest = series.stretches.iter().map(|r| r.len()).max().unwrap_or(0);
    let lags = lags.min(longest.saturating_sub(1));
    // The first of a pair in the upper bits of the cell's number, the second in the lower six.
    let cells: Vec<u8> = series.values.iter().map(|v| ((v * bins as f32) as usize).min(bins - 1) as u8).collect();
    let groups: Vec<usize> = (1..=lags).step_by(TOGETHER).collect();
    let bits: Vec<f64> = groups
        .par_iter()
        .flat_map_iter(|first| {
            let counts = joint(&cells, series, *first);
            let wanted = TOGETHER.min(lags + 1 - first);
            counts.into_iter().take(wanted).map(|c| information(&c)).collect::<Vec<f64>>()
        })
        .collect();
    let pairs = series.stretches.iter().map(|r| r.len().saturating_sub(lags)).sum::<usize>().max(1);
    let occupied = {
        let mut seen = [false; MOST_BINS];
        cells.iter().for_each(|c| seen[usize::from(*c) % MOST_BINS] = true);
        seen.iter().filter(|s| **s).count().max(1)
    };
    let bias = ((occupied - 1) as f64).powi(2) / (2.0 * pairs as f64 * std::f64::consts::LN_2);
    Information { bits, bins, bias }
}

/// Joint counts at [`TOGETHER`] lags from `first` on; 64 × 64 cells each.
fn joint(cells: &[u8], series: &Observable, first: usize) -> Vec<Vec<u64>> {
    const CELLS: usize = MOST_BINS * MOST_BINS;
    let mut total = vec![vec![0u64; CELLS]; TOGETHER];
    let mut table = vec![[0u16; CELLS]; TOGETHER];
    let mut since = 0;
    for r in &series.stretches {
        let x = &cells[r.clone()];
        let all = x.len().saturating_sub(first + TOGETHER - 1);
        let mut from = 0;
        while from < all {
            let to = (from + BLOCK - since).min(all);
            if let [t0, t1, t2, t3] = &mut table[..] {
                let ahead = |k: usize| &x[from + first + k..to + first + k];
                let later = ahead(0).iter().zip(ahead(1)).zip(ahead(2)).zip(ahead(3));
                for (a, (((b0, b1), b2), b3)) in x[from..to].iter().zip(later) {
                    let row = usize::from(*a) << 6;
                    let cell = |b: &u8| (row | usize::from(*b)) % CELLS;
                    t0[cell(b0)] = t0[cell(b0)].wrapping_add(1);
                    t1[cell(b1)] = t1[cell(b1)].wrapping_add(1);
                    t2[cell(b2)] = t2[cell(b2)].wrapping_add(1);
                    t3[cell(b3)] = t3[cell(b3)].wrapping_add(1);
                }
            }
            since += to - from;
            from = to;
            if since == BLOCK {
                empty(&mut table, &mut total);
                since = 0;
            }
        }
        // The last pairs of a stretch, which the longer lags of this pass no longer have.
        for k in 0..TOGETHER {
            for i in all..x.len().saturating_sub(first + k) {
                total[k][(usize::from(x[i]) << 6) | usize::from(x[i + first + k])] += 1;
            }
        }
    }
    empty(&mut table, &mut total);
    total
}

fn empty<const N: usize>(table: &mut [[u16; N]], total: &mut [Vec<u64>]) {
    for (t, sum) in table.iter_mut().zip(total) {
        for (c, s) in t.iter_mut().zip(sum) {
            *s += u64::from(*c);
            *c = 0;
        }
    }
}

/// (2.18) from joint counts: log₂ N + Σ n_ab log₂ n_ab/N − Σ n_a log₂ n_a/N − Σ n_b log₂ n_b/N.
fn information(counts: &[u64]) -> f64 {
    let (mut rows, mut columns, mut joint) = ([0u64; MOST_BINS], [0u64; MOST_BINS], 0.0);
    let weighted = |n: u64| if n > 0 { n as f64 * (n as f64).log2() } else { 0.0 };
    for (a, row) in counts.chunks_exact(MOST_BINS).enumerate() {
        for (b, n) in row.iter().enumerate().filter(|(_, n)| **n > 0) {
            rows[a] += n;
            columns[b] += n;
            joint += weighted(*n);
        }
    }
    let total = rows.iter().sum::<u64>() as f64;
    if total == 0.0 {
        return 0.0;
    }
    let margins = rows.iter().chain(&columns).map(|n| weighted(*n)).sum::<f64>();
    (total.log2() + (joint - margins) / total).max(0.0)
}

/// All local minima, in order of the lag, with their depths.
pub fn minima(bits: &[f64]) -> Vec<Minimum> {
    let least = bits.iter().copied().fold(f64::INFINITY, f64::min);
    let fall = bits.first().map_or(0.0, |b| b - least);
    (1..bits.len().saturating_sub(1))
        .filter(|&i| bits[i] < bits[i - 1] && bits[i] <= bits[i + 1])
        .map(|i| {
            let rise = bits[i..].iter().take_while(|b| **b >= bits[i]).fold(bits[i], |h, b| h.max(*b)) - bits[i];
            Minimum { lag: i + 1, bits: bits[i], depth: if fall > 0.0 { rise / fall } else { 0.0 } }
        })
        .collect()
}

/// The first minimum deeper than `threshold`; the first of all where none is.
pub fn recommended(minima: &[Minimum], threshold: f64) -> Option<Minimum> {
    minima.iter().find(|m| m.depth >= threshold).or(minima.first()).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Straight from (2.18).
    fn naive(x: &[f64], lag: usize, bins: usize) -> f64 {
        let bin = |v: f64| ((v * bins as f64) as usize).min(bins - 1);
        let n = (x.len() - lag) as f64;
        let mut p = vec![vec![0.0; bins]; bins];
        for i in 0..x.len() - lag {
            p[bin(x[i])][bin(x[i + lag])] += 1.0 / n;
        }
        let pa: Vec<f64> = p.iter().map(|r| r.iter().sum()).collect();
        let pb: Vec<f64> = (0..bins).map(|b| p.iter().map(|r| r[b]).sum()).collect();
        let mut sum = 0.0;
        for a in 0..bins {
            for b in 0..bins {
                if p[a][b] > 0.0 {
                    sum += p[a][b] * (p[a][b] / (pa[a] * pb[b])).log2();
                }
            }
        }
        sum
    }

    fn logistic(n: usize) -> Vec<f64> {
        std::iter::successors(Some(0.3), |x: &f64| Some(3.9 * x * (1.0 - x))).take(n).collect()
    }

    #[test]
    fn agrees_with_the_definition() {
        let mut x = logistic(3000);
        x[0] = 0.0;
        x[1] = 1.0;
        for bins in [5, 32, 64] {
            let found = average_mutual_information(&Observable::number(&[&x], 0.0, 0), 7, bins);
            for lag in 1..=7 {
                // Single precision moves a value or two to the next bin.
                assert!((found.bits[lag - 1] - naive(&x, lag, bins)).abs() < 2e-3, "{bins} {lag}");
            }
        }
    }

    #[test]
    fn long_series_fill_the_small_tables_many_times() {
        // 200 000 samples of one value and then another: counts far beyond 16 bits in one cell.
        let mut x = vec![0.25; 100_000];
        x.extend(vec![0.75; 100_000]);
        let o = Observable::angle(&[&x.iter().map(|v| v * std::f64::consts::TAU).collect::<Vec<_>>()], 0.0, 0);
        let found = average_mutual_information(&o, 5, 2);
        for lag in 1..=5 {
            assert!((found.bits[lag - 1] - naive(&x, lag, 2)).abs() < 1e-9);
        }
    }

    #[test]
    fn pairs_never_straddle_a_gap_and_short_stretches_are_no_trouble() {
        let x = logistic(2001);
        let parts: Vec<&[f64]> = vec![&x[..1000], &x[1000..1003], &[], &x[1003..]];
        let found = average_mutual_information(&Observable::number(&parts, 0.0, 0), 6, 16);
        assert_eq!(found.bits.len(), 6);
        let none = average_mutual_information(&Observable::number(&[&[1.0]], 0.0, 0), 6, 16);
        assert!(none.bits.is_empty() && minima(&none.bits).is_empty());
        let one = Observable::number(&[&x], 0.0, 0);
        assert!((found.bits[0] - average_mutual_information(&one, 6, 16).bits[0]).abs() < 0.01);
    }

    #[test]
    fn a_sine_has_its_first_minimum_at_a_quarter_period_and_noise_no_information() {
        let mut state = 1u64;
        let noise: Vec<f64> = (0..50_000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 33) as f64
            })
            .collect();
        // Without noise a sine is known from any lag, and its minima are the bins' alone.
        let x: Vec<f64> =
            (0..40_000).map(|i| (i as f64 * std::f64::consts::TAU / 100.3).sin() + 2e-10 * noise[i]).collect();
        let bits = average_mutual_information(&Observable::number(&[&x], 0.0, 0), 40, 16).bits;
        let least = recommended(&minima(&bits), 0.05).unwrap();
        assert!((21..=29).contains(&least.lag), "{least:?}");
        let found = average_mutual_information(&Observable::number(&[&noise], 0.0, 0), 3, 64);
        assert!(found.bits.iter().all(|b| (b / found.bias - 1.0).abs() < 0.1), "{found:?}");
    }

    #[test]
    fn minima_know_their_depth() {
        let bits = [5.0, 4.0, 3.9, 3.95, 3.0, 1.0, 3.0, 2.0, 4.0];
        let found = minima(&bits);
        assert_eq!(found.iter().map(|m| m.lag).collect::<Vec<_>>(), [3, 6, 8]);
        assert!((found[0].depth - 0.0125).abs() < 1e-12 && (found[1].depth - 0.75).abs() < 1e-12);
        assert_eq!(recommended(&found, 0.1).unwrap().lag, 6);
        assert_eq!(recommended(&found, 0.9).unwrap().lag, 3);
    }
}

//! Rows that are there twice, or not at all, under times that were numbered anew.
//!
//! In smooth motion an increment is the mean of its neighbours: with d_k the increment of channel
//! k, v_k = (d_k before + d_k behind)/2 and s_k the median size of the second differences, ρ = Σ
//! d_k v_k/s_k² / Σ v_k²/s_k² is 1, and scatters by (Σ v_k²/s_k²)^{−½}. A row that is there twice
//! has ρ = 0 with every increment exactly zero, one that is missing ρ = 2, m missing ones 1 + m.
//! Rows with Σ v²/s² ≥ [`CLEAR`]² are counted; what one smooth motion makes of ρ has one maximum,
//! so that without a fault there are no more rows near 2 than halfway between 1 and 2.

use super::trace::Trace;
use crate::statistics::median;

/// Velocity over scatter from which a row is counted: ρ is then known to 1/15 (one standard
/// deviation).
const CLEAR: f64 = 15.0;
/// Half width of what counts as a whole number.
const WIDTH: f64 = 0.2;
/// Of a long record blocks of so many rows are looked at, about so many rows in all.
const BLOCK: usize = 256;
const ENOUGH: usize = 30_000;
/// Fewest rows for a verdict: 2⁻²⁰ by chance.
const FEWEST: usize = 20;

/// What was found: how many, and the first row (stretch, sample).
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    pub rows: usize,
    pub first: (usize, usize),
    /// Rows that were clear enough to look at.
    pub looked_at: usize,
}

/// Rows doubled and rows missing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RowSteps {
    pub doubled: Option<Found>,
    pub missing: Option<Found>,
}

/// Looks at all channels together.
pub fn look(traces: &[Trace<'_>]) -> RowSteps {
    let scales: Vec<f64> = traces.iter().map(scale).collect();
    let stretches = traces.first().map_or(0, |t| t.stretches.len());
    let every = (traces.first().map_or(0, Trace::len) / ENOUGH).max(1);
    let (mut doubled, mut missing) = ((0, (0, 0)), (0, (0, 0)));
    let (mut below, mut above, mut looked_at) = (0usize, 0usize, 0usize);
    for stretch in 0..stretches {
        let n = traces[0].stretches[stretch].len();
        for i in (2..n.saturating_sub(1)).filter(|i| (i / BLOCK).is_multiple_of(every)) {
            let (mut product, mut square) = (0.0, 0.0);
            let (mut still, mut still_before, mut still_behind) = (true, true, true);
            for (t, scale) in traces.iter().zip(&scales) {
                let s = &t.stretches[stretch];
                let (a, b, c, d) = (s.at(i - 2), s.at(i - 1), s.at(i), s.at(i + 1));
                let (v, step) = (0.5 * ((b - a) + (d - c)) / scale, (c - b) / scale);
                product += step * v;
                square += v * v;
                still &= c == b;
                // Behind a row that is there twice, or before it, the neighbours' mean says
                // nothing.
                (still_before, still_behind) = (still_before && b == a, still_behind && d == c);
            }
            if square.is_nan() || square < CLEAR * CLEAR || still_before || still_behind {
                continue;
            }
            looked_at += 1;
            let ratio = product / square;
            let count = |of: &mut (usize, (usize, usize))| {
                if of.0 == 0 {
                    of.1 = (stretch, i);
                }
                of.0 += 1;
            };
            if still {
                count(&mut doubled);
            } else if ratio > 2.0 - WIDTH && (ratio - ratio.round()).abs() < WIDTH {
                count(&mut missing);
            } else if (ratio - 0.5).abs() < WIDTH {
                below += 1;
            } else if (ratio - 1.5).abs() < WIDTH {
                above += 1;
            }
        }
    }
    let verdict = |(rows, first): (usize, (usize, usize)), between: usize| {
        (rows >= FEWEST && rows > 4 * between).then_some(Found { rows, first, looked_at })
    };
    RowSteps { doubled: verdict(doubled, below), missing: verdict(missing, above) }
}

/// Median size of the second differences, not below what quantisation leaves.
fn scale(trace: &Trace<'_>) -> f64 {
    let stride = (trace.len() / 4096).max(1);
    let mut sizes = Vec::new();
    for s in &trace.stretches {
        for i in (1..s.len().saturating_sub(1)).step_by(stride) {
            sizes.push((s.at(i - 1) - 2.0 * s.at(i) + s.at(i + 1)).abs());
        }
    }
    median(&mut sizes).max(0.7 * trace.quantum).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::super::trace::Samples;
    use super::*;

    fn motion() -> [Vec<i32>; 2] {
        let of = |a: f64, w: f64| (0..20_000).map(|i| (a * (w * f64::from(i)).sin()) as i32).collect();
        [of(900.0, 0.04), of(1500.0, 0.031)]
    }

    fn of(x: &[Vec<i32>; 2], rows: &[usize]) -> RowSteps {
        let picked: Vec<Vec<i32>> = x.iter().map(|c| rows.iter().map(|&i| c[i]).collect()).collect();
        look(&picked.iter().map(|c| Trace::new(vec![Samples::Counts(c)])).collect::<Vec<_>>())
    }

    #[test]
    fn rows_that_are_missing_or_doubled_are_counted() {
        let x = motion();
        let all: Vec<usize> = (0..20_000).collect();
        assert_eq!(of(&x, &all), RowSteps::default());
        let fewer: Vec<usize> = all.iter().copied().filter(|i| i % 23 != 7).collect();
        let found = of(&x, &fewer);
        assert!(found.doubled.is_none() && found.missing.is_some_and(|f| f.rows > 300 && f.first.1 < 200));
        let more: Vec<usize> = all.iter().flat_map(|&i| vec![i; 1 + usize::from(i % 97 == 5)]).collect();
        let found = of(&x, &more);
        assert!(found.missing.is_none() && found.doubled.is_some_and(|f| f.rows > 100));
    }
}

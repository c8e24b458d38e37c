//! Limits of numbers that are asked for, as they are told and as they are taken.
//!
//! A number that was printed may be typed again: 0.534 for 0.53404538939 s. Such a one is the limit
//! itself, not beyond it; and limits are told with few digits, rounded to the side that is allowed.

use super::format::{exponent, rounded, shortest};

/// Fewest digits with which limits are told, and with which a number stands for one.
const FEWEST: usize = 3;
/// Most digits that are printed of a number.
const MOST: usize = 10;

/// The number that was asked for where it lies within limits, the limit for one that is the limit
/// as it is printed; none beyond.
pub fn within(asked: f64, low: f64, high: f64) -> Option<f64> {
    if asked >= low && asked <= high {
        return Some(asked);
    }
    let as_printed = |limit: f64| (FEWEST..=MOST).any(|digits| rounded(limit, digits) == asked);
    [low, high].into_iter().find(|limit| as_printed(*limit))
}

/// Limits that are not below 0 in words, each rounded to the side that is allowed: `0.535 to 20.8`.
pub fn range(low: f64, high: f64) -> String {
    let both = |digits: usize| (away(low, digits, 1.0), away(high, digits, -1.0));
    let (low, high) = (FEWEST..=MOST).map(both).find(|(low, high)| low <= high).unwrap_or((low, high));
    format!("{} to {}", shortest(low), shortest(high))
}

/// A number rounded to so many digits, up for a side of 1, down for one of −1.
fn away(x: f64, digits: usize, side: f64) -> f64 {
    let near = rounded(x, digits);
    if side * (near - x) >= 0.0 || !x.is_finite() {
        return near;
    }
    rounded(near + side * 10f64.powi(exponent(near, digits) + 1 - digits as i32), digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_that_was_printed_is_taken() {
        let (low, high) = (0.534_045_393_858_477_9, 20.8779);
        for printed in [0.534, 0.534_045, 0.534_045_39] {
            assert_eq!(within(printed, low, high), Some(low), "{printed}");
        }
        assert_eq!([20.9, 20.88].map(|printed| within(printed, low, high)), [Some(high); 2]);
        assert_eq!(within(1.0, low, high), Some(1.0));
        assert_eq!([0.53, 0.5339, 21.0, f64::NAN].map(|asked| within(asked, low, high)), [None; 4]);
    }

    #[test]
    fn limits_are_told_as_they_are_allowed() {
        assert_eq!(range(0.534_045_393_858_477_9, 20.8779), "0.535 to 20.8");
        assert_eq!(range(0.064, 100_000.0), "0.064 to 100000");
        assert_eq!(range(0.999_9, 1.000_1), "1 to 1");
        assert_eq!(range(0.0, 5.28e-5), "0 to 0.0000528");
        for limits in [(0.099_961, 0.1), (5.281e-5, 5.349e-4)] {
            let told = range(limits.0, limits.1);
            let (low, high) = told.split_once(" to ").unwrap();
            assert!(low.parse::<f64>().unwrap() >= limits.0 && high.parse::<f64>().unwrap() <= limits.1, "{told}");
        }
    }
}

//! What every room takes from statistics.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Half width of a 95 % interval in standard errors, z₀.₉₇₅: what docs and results say by name, and
/// by which Student's quantiles are told as standard errors.
pub const Z95: f64 = 1.96;

/// What one more number of the normal distribution of some is at most, with a probability of 99.9 %:
/// m + t₀.₉₉₉ s √(1 + 1/n), Student's t of n − 1 degrees of freedom; infinite of fewer than two.
pub fn one_more(all: &[f64]) -> f64 {
    let n = all.len() as f64;
    let Ok(student) = StudentsT::new(0.0, 1.0, n - 1.0) else { return f64::INFINITY };
    let mean = all.iter().sum::<f64>() / n;
    let variance = all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean + student.inverse_cdf(0.999) * (variance * (1.0 + 1.0 / n)).sqrt()
}

/// The median; 0 of nothing. The slice is reordered.
pub fn median(x: &mut [f64]) -> f64 {
    quantile(x, 0.5)
}

/// The quantile p, 0 to 1 (the sample at ⌊p n⌋); 0 of nothing. The slice is reordered.
pub fn quantile(x: &mut [f64], p: f64) -> f64 {
    if x.is_empty() {
        return 0.0;
    }
    let k = ((x.len() as f64 * p) as usize).min(x.len() - 1);
    *x.select_nth_unstable_by(k, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_more_of_few_numbers_may_be_far() {
        // t₀.₉₉₉ of three degrees of freedom is 10.2145.
        let found = one_more(&[1.0, 2.0, 3.0, 4.0]);
        assert!((found - (2.5 + 10.2145 * (5.0 / 3.0 * 1.25_f64).sqrt())).abs() < 1e-3, "{found}");
        assert_eq!(one_more(&[1.0]), f64::INFINITY);
    }
}

//! What every room takes from statistics.

/// Half width of a 95 % interval in standard errors, z₀.₉₇₅: what docs and results say by name, and
/// by which Student's quantiles are told as standard errors.
pub const Z95: f64 = 1.96;

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

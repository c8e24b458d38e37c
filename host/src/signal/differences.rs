//! Rates of a sampled series by differences.

/// Rate at sample `i` over `reach` samples to either side, over fewer at the ends; 0 of a single
/// sample.
pub fn rate(x: &[f64], i: usize, reach: usize, step_s: f64) -> f64 {
    let (a, b) = (i.saturating_sub(reach), (i + reach).min(x.len().saturating_sub(1)));
    if b > a { (x[b] - x[a]) / ((b - a) as f64 * step_s) } else { 0.0 }
}

/// Rates at all samples, over one sample to either side.
pub fn rates(x: &[f64], step_s: f64) -> Vec<f64> {
    (0..x.len()).map(|i| rate(x, i, 1, step_s)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_have_one_side_and_a_single_sample_no_rate() {
        let x = [0.0, 1.0, 4.0, 9.0, 16.0];
        assert_eq!(rates(&x, 0.5), [2.0, 4.0, 8.0, 12.0, 14.0]);
        assert_eq!([rate(&x, 0, 2, 0.5), rate(&x, 2, 2, 0.5), rate(&x, 4, 2, 0.5)], [4.0, 8.0, 12.0]);
        assert_eq!(rates(&[3.0], 0.5), [0.0]);
    }
}

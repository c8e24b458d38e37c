//! How large a statistic gets by chance, from the statistic's own values at places without a
//! suspect.
//!
//! Real motion has heavier tails than Gaussian noise. The survival function is taken as ln S(z) =
//! −(z/a)^k through the 90 % and the 99 % quantile (Weibull): k = ln 2 / ln(q₉₉/q₉₀), held to [½,
//! 2]; the limit at probability p is q₉₉ (ln p / ln 0.01)^{1/k}. Gaussian noise gives 7.5 standard
//! deviations at p = 3·10⁻¹¹, exponential tails 12.

use crate::statistics::quantile;

/// Probability with which a record without a fault is to pass a limit.
const FAMILY: f64 = 1e-6;

/// The limit for `trials` looks, from values at chance places (at least [`FEWEST`]).
pub fn limit(values: &mut [f64], trials: usize) -> Option<f64> {
    if values.len() < FEWEST {
        return None;
    }
    let (q90, q99) = (quantile(values, 0.9), quantile(values, 0.99));
    let k = if q90 > 0.0 && q99 > q90 { (2f64.ln() / (q99 / q90).ln()).clamp(0.5, 2.0) } else { 2.0 };
    let p = FAMILY / trials.max(1) as f64;
    Some(q99 * (p.ln() / 0.01f64.ln()).powf(1.0 / k))
}

/// Fewest values that tell a tail.
pub const FEWEST: usize = 60;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heavier_tails_have_higher_limits() {
        let uniform = |i: usize| (i as f64 + 0.5) / 1000.0;
        let mut exponential: Vec<f64> = (0..1000).map(|i| -uniform(i).ln()).collect();
        let mut gaussian: Vec<f64> = (0..1000).map(|i| (-2.0 * uniform(i).ln()).sqrt()).collect();
        let e = limit(&mut exponential, 30_000).unwrap();
        let g = limit(&mut gaussian, 30_000).unwrap();
        assert!((22.0..28.0).contains(&e) && (6.0..8.0).contains(&g), "{e} {g}");
        assert!(limit(&mut [1.0; 10], 1).is_none());
    }
}

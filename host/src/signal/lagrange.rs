//! Lagrange's interpolation: the polynomial of degree n − 1 through n values.

/// Weights w_j of the values x_j at `places` t_j in the polynomial through them at a place t:
/// w_j = Π_{i ≠ j} (t − t_i)/(t_j − t_i), so that the value there is Σ w_j x_j. Places differ.
pub fn weights(places: &[f64], at: f64) -> impl Iterator<Item = f64> + '_ {
    (0..places.len()).map(move |j| {
        let others = places.iter().enumerate().filter(|(i, _)| *i != j);
        others.map(|(_, t)| (at - t) / (places[j] - t)).product()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_met_between_uneven_places() {
        let cubic = |t: f64| 2.0 - t + 0.5 * t * t - 0.25 * t.powi(3);
        let places = [-1.0, 0.5, 1.0, 3.0];
        let found: f64 = weights(&places, 2.0).zip(places).map(|(w, t)| w * cubic(t)).sum();
        assert!((found - cubic(2.0)).abs() < 1e-12, "{found}");
        assert_eq!(weights(&places, 1.0).collect::<Vec<_>>(), [0.0, 0.0, 1.0, 0.0]);
    }
}

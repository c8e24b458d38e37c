//! Choices of a survey, with bounds on its work.

use serde::Serialize;

use crate::error::{BadInput, Result};

/// Choices, with bounds on the work.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Bins an axis of the mutual information. Default 64.
    pub bins: usize,
    /// A minimum shallower than this share of the fall of I is weak. Default 0.05.
    pub weak: f64,
    /// Highest embedding dimension. Default 10.
    pub dimensions: usize,
    /// Share of false neighbours at which a dimension suffices. Default 0.02.
    pub false_share: f64,
    /// Tolerance e of (3.24). Default 0.05.
    pub tolerance: f64,
    /// Longest period of an orbit, drive periods. Default 16.
    pub longest: usize,
    /// Seed of the dither of quantised values. Default 1.
    pub seed: u64,
    /// Most samples used at all. Default 1 000 000.
    pub most_samples: usize,
    /// Most vectors of false neighbours. Default 10 000.
    pub most_neighbours: usize,
    /// Most vectors of the correlation dimension. Default 20 000.
    pub most_vectors: usize,
    /// Most pairs followed for the divergence. Default 60 000.
    pub most_pairs: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            bins: 64,
            weak: 0.05,
            dimensions: 10,
            false_share: 0.02,
            tolerance: 0.05,
            longest: 16,
            seed: 1,
            most_samples: 1_000_000,
            most_neighbours: 10_000,
            most_vectors: 20_000,
            most_pairs: 60_000,
        }
    }
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the field, its value and what it may be.
    pub fn validate(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("bins", self.bins as f64, 2.0, 64.0),
            ("weak", self.weak, 0.0, 1.0),
            ("dimensions", self.dimensions as f64, 1.0, 20.0),
            ("false_share", self.false_share, 0.0, 1.0),
            ("tolerance", self.tolerance, 1e-6, 0.5),
            ("longest", self.longest as f64, 1.0, 64.0),
            ("most_samples", self.most_samples as f64, 1000.0, 1e9),
            ("most_neighbours", self.most_neighbours as f64, 100.0, 1e9),
            ("most_vectors", self.most_vectors as f64, 100.0, 1e9),
            ("most_pairs", self.most_pairs as f64, 100.0, 1e9),
        ] {
            if !(value >= least && value <= most) {
                return Err(BadInput::new(value.to_string(), format!("a value from {least} to {most}")).at(name));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_choice_is_named() {
        assert!(Settings::default().validate().is_ok());
        let error = Settings { tolerance: f64::NAN, ..Settings::default() }.validate().unwrap_err().to_string();
        assert!(error.contains("tolerance") && error.contains("NaN"), "{error}");
        assert!(Settings { bins: 1, ..Settings::default() }.validate().is_err());
    }
}

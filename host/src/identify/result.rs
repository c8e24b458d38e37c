//! What an identification gives.

use serde::Serialize;

use super::judgement::BESIDE_NOISE;
use super::prepared::Geometry;
use super::{harmonic_balance, noise_bias, regression, shooting, slips};
use crate::model::parameter::Parameter;
use crate::record::Record;
use crate::warning::Warning;

/// What was used of the record.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecordUse {
    /// Samples.
    pub samples: usize,
    /// Samples missing.
    pub lost: u64,
    /// Unbroken stretches.
    pub segments: usize,
}

impl RecordUse {
    /// All of these records.
    pub(crate) fn of(records: &[Record]) -> Self {
        Self {
            samples: records.iter().map(Record::samples).sum(),
            lost: records.iter().map(|r| r.losses.lost()).sum(),
            segments: records.iter().map(|r| r.segments.len()).sum(),
        }
    }
}

/// How the numbers came about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Details {
    /// Length of a window, s.
    pub window_s: f64,
    /// Number of windows.
    pub windows: usize,
    /// Highest frequency of the test functions, Hz.
    pub max_frequency_hz: f64,
    /// Pass band of the low-pass, Hz.
    pub pass_hz: f64,
    /// Start of its stop band, Hz.
    pub stop_hz: f64,
    /// Pass band of the low-pass for signs of velocities, Hz.
    pub sign_pass_hz: f64,
    /// Standard deviation of each sensor's noise, in SI units: rad for angles, m for positions.
    pub noise_rad: Vec<f64>,
    /// Bias by that noise, taken off each coefficient (in the order of `correlation_names`).
    pub noise_bias: Vec<f64>,
    /// Condition number of each equation (columns scaled).
    pub condition: Vec<f64>,
    /// Correlation of residuals between windows that do not overlap (a periodic record: near 1).
    pub repetition: f64,
    /// Blocks of the jackknife; 0 where there are too few windows.
    pub jackknife_blocks: usize,
    /// Misfit of the ties between the coefficients and its degrees of freedom, where physical
    /// parameters were fitted.
    pub ties_misfit: Option<(f64, usize)>,
    /// ε of each equation in records that the identified model makes itself, with the noise of
    /// sensors and inputs; empty where they could not be made.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub expected_error: Vec<f64>,
    /// Weighted residual power over that of such records in the same rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_over_noise: Option<f64>,
    /// Up to how much that ratio may be by chance.
    #[serde(skip)]
    pub by_chance: f64,
    /// Inputs whose noise is hidden by what they show, so that it is in neither of the two.
    #[serde(skip)]
    pub hidden_noise: Vec<String>,
    /// Share of the right-hand side that the model leaves, over all samples, of each equation of a
    /// model file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub balance_error: Vec<f64>,
}

impl Details {
    /// How the weak form's numbers came about: from so many windows, with each sensor's noise, the
    /// bias taken off, and the weighted rms of the residuals.
    pub(super) fn of(
        solution: &regression::Solution,
        count: usize,
        geometry: &Geometry,
        noise_rad: Vec<f64>,
        bias: Option<(&noise_bias::Bias, f64)>,
    ) -> Self {
        let Geometry { windows, kernels, .. } = geometry;
        Self {
            window_s: windows.length_s,
            windows: count,
            max_frequency_hz: windows.frequencies as f64 / windows.length_s,
            pass_hz: kernels.full.pass_hz,
            stop_hz: kernels.full.stop_hz,
            sign_pass_hz: kernels.clear.pass_hz,
            noise_rad,
            noise_bias: bias.map_or_else(Vec::new, |(b, _)| b.value.iter().copied().collect()),
            condition: solution.condition.clone(),
            repetition: solution.repetition,
            jackknife_blocks: solution.blocks,
            ties_misfit: None,
            expected_error: bias.map_or_else(Vec::new, |(b, _)| b.error.clone()),
            residual_over_noise: bias.map(|(b, left)| (left / b.noise).powi(2)).filter(|r| r.is_finite()),
            by_chance: bias.map_or(1.0, |(b, _)| b.by_chance),
            hidden_noise: Vec::new(),
            balance_error: Vec::new(),
        }
    }
}

/// Residuals of one equation, for figure 3.14: at most 2000 dots.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Residuals {
    /// Spacing of the test functions' frequencies, Hz.
    pub frequency_step_hz: f64,
    /// Rms residual at each frequency (index 0 is frequency 0).
    pub rms: Vec<f64>,
    /// [frequency index, prediction, residual] of each dot.
    pub dots: Vec<(usize, f64, f64)>,
}

/// Result of an identification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Identification {
    /// Model.
    pub model: String,
    /// Method.
    pub method: String,
    /// Parameters: coefficients in the order of (3.4), then physical ones.
    pub parameters: Vec<Parameter>,
    /// ε = ‖e‖∞/‖q̂‖∞ of each equation; with the weak form's own coefficients where the balance of a
    /// coarse record is off with those of multiple shooting, which follows it.
    pub identification_error: Vec<f64>,
    /// Balance equations used.
    pub equations_used: usize,
    /// Balance equations dropped.
    pub equations_dropped: usize,
    /// Sets of coefficients that this record does not tell apart.
    pub groups_not_separable: Vec<Vec<String>>,
    /// What was used of the record.
    pub record: RecordUse,
    /// Correlation matrix of the coefficients `correlation_names`.
    pub correlation: Vec<Vec<f64>>,
    /// Names of its rows.
    pub correlation_names: Vec<String>,
    /// How the numbers came about.
    pub details: Details,
    /// How multiple shooting came about them, where it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shooting: Option<shooting::Details>,
    /// Zeros of the sensors that show angles, where shooting sought them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub zeros: Vec<shooting::zeros::ZeroOffset>,
    /// Why these are the weak form's numbers, where no method was asked for: see [`super::best`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_by_shooting: Option<String>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
    /// Residuals, equation by equation.
    pub residuals: Vec<Residuals>,
    /// Slips of single counts that shooting found and that still stand in the record.
    #[serde(skip)]
    pub slips: Vec<slips::Placed>,
    /// What a harmonic balance tells beside the parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub balance: Option<harmonic_balance::account::Account>,
}

/// The bound on ε beyond which an identification is called unsatisfactory (section 3: 10 %).
pub const ERROR_BOUND: f64 = 0.10;

impl Identification {
    /// A parameter by name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|p| p.name == name)
    }

    /// The bound of each equation's ε: [`ERROR_BOUND`], or, where that is more, what the sensors'
    /// noise makes of it with as much beside it as is taken for noise elsewhere.
    pub fn error_bounds(&self) -> Vec<f64> {
        let beyond = (BESIDE_NOISE * self.details.by_chance.max(1.0)).sqrt();
        let of_noise = |e: usize| self.details.expected_error.get(e).copied().filter(|e| e.is_finite()).unwrap_or(0.0);
        (0..self.identification_error.len()).map(|e| ERROR_BOUND.max(beyond * of_noise(e))).collect()
    }

    /// Whether every equation's ε keeps its bound.
    pub fn within_bound(&self) -> bool {
        self.identification_error.iter().zip(self.error_bounds()).all(|(e, bound)| *e <= bound)
    }
}

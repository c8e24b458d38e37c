//! What a validation gives: each comparison of the record with the model's own, and the checks that
//! are made of them.

use serde::Serialize;

use super::horizon::Horizon;
use super::natural_frequencies::NaturalFrequencies;
use super::sections::SectionComparison;
use crate::phase_space::bifurcation::Column;
use crate::phase_space::orbit_refinement::RefinedOrbit;
use crate::phase_space::survey::{Lyapunov, PhaseSpace};
use crate::warning::Warning;

/// Outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// No check failed.
    Passed,
    /// A check failed.
    Failed,
}

/// A coordinate as pages label it.
#[derive(Clone, Debug, PartialEq)]
pub struct Labelled {
    /// Its name.
    pub name: String,
    /// SI unit of its values; 1 where it has none.
    pub unit: String,
    /// Whether it is an angle, whose whole turns are no difference.
    pub is_angle: bool,
    /// Whether it goes beyond half a turn.
    pub turns: bool,
}

/// One comparison that can fail.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Name.
    pub name: &'static str,
    /// Whether record and model agree.
    pub passed: bool,
    /// What was compared, with the numbers.
    pub message: String,
}

/// Horizons on the record and on the model's own record.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HorizonComparison {
    /// Angle by which a prediction may be off, degrees.
    pub tolerance_deg: f64,
    /// The same in words: of an angle, or of the range of what is none.
    #[serde(skip)]
    pub within: String,
    /// Length of the stretch to which initial states are fitted, s.
    pub fit_s: f64,
    /// Longest prediction, s.
    pub longest_s: f64,
    /// On the measured record.
    pub measured: Horizon,
    /// On the model's own record.
    pub simulated: Horizon,
    /// Medians in Lyapunov times of the model (measured, simulated); none where the model is not
    /// chaotic.
    pub median_lyapunov_times: Option<[f64; 2]>,
}

impl HorizonComparison {
    /// Both medians in Lyapunov times of the model, where it is chaotic.
    pub(super) fn lyapunov_times(&self, exponent: Option<&ExponentComparison>) -> Option<[f64; 2]> {
        let l = exponent.filter(|l| l.model > 3.0 * l.model_std_error && l.model > 0.0)?;
        Some([self.measured.median() * l.model, self.simulated.median() * l.model])
    }
}

/// A value in both records.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// In the measured record.
    pub measured: f64,
    /// Its standard error.
    pub measured_std_error: f64,
    /// In the model's own record.
    pub simulated: f64,
    /// Its standard error.
    pub simulated_std_error: f64,
}

impl Pair {
    /// The largest exponents of two records, 1/s.
    pub(super) fn of_exponents(measured: Option<&Lyapunov>, simulated: Option<&Lyapunov>) -> Option<Self> {
        let (a, b) = (measured?, simulated?);
        Some(Self {
            measured: a.per_second,
            measured_std_error: a.std_error,
            simulated: b.per_second,
            simulated_std_error: b.std_error,
        })
    }

    /// The correlation dimensions of two records.
    pub(super) fn of_dimensions(measured: &PhaseSpace, simulated: &PhaseSpace) -> Option<Self> {
        let (a, b) = (measured.correlation_dimension.as_ref()?, simulated.correlation_dimension.as_ref()?);
        Some(Self {
            measured: a.dimension?,
            measured_std_error: a.std_error,
            simulated: b.dimension?,
            simulated_std_error: b.std_error,
        })
    }

    /// Difference in standard errors.
    pub fn deviation(&self) -> f64 {
        (self.measured - self.simulated).abs() / self.measured_std_error.hypot(self.simulated_std_error)
    }
}

/// The largest exponent, 1/s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ExponentComparison {
    /// From the model's variational equations.
    pub model: f64,
    /// Its standard error.
    pub model_std_error: f64,
    /// From the two records.
    pub records: Option<Pair>,
}

/// An orbit of the record, and what became of it on the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OrbitComparison {
    /// Period, drive periods.
    pub period: usize,
    /// Time at which its best closing stretch starts, s.
    pub start_s: f64,
    /// Closing error in the record, share of the span.
    pub closing: f64,
    /// The model's orbit; none where Newton's method found none near it.
    pub refined: Option<RefinedOrbit>,
}

/// Periodic orbits side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Orbits {
    /// Tolerance of the extraction, share of the span.
    pub tolerance: f64,
    /// Distinct orbits of each period 1, 2, … in the measured record.
    pub measured: Vec<usize>,
    /// The same in the model's own.
    pub simulated: Vec<usize>,
    /// The record's best closing ones, refined on the model.
    pub refined: Vec<OrbitComparison>,
    /// Unit of how far these moved; 1 where the coordinates are in several.
    #[serde(skip)]
    pub unit: String,
}

/// A bifurcation diagram of the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bifurcation {
    /// Parameter, `drive` for all of the base's motion.
    pub parameter: String,
    /// Factor on its identified value, column by column.
    pub factor: Vec<f64>,
    /// Section of each.
    pub columns: Vec<Column>,
    /// The model's coordinates.
    #[serde(skip)]
    pub of: Vec<Labelled>,
}

/// A validation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// Whether any check failed.
    pub verdict: Verdict,
    /// The checks that could be made.
    pub checks: Vec<Check>,
    /// The model's name.
    pub model: String,
    /// How it was identified.
    pub method: String,
    /// Length of the record that the model made, s.
    pub simulated_s: f64,
    /// Prediction horizons.
    pub horizon: HorizonComparison,
    /// Poincaré sections (driven, not periodic).
    pub sections: Vec<SectionComparison>,
    /// Largest exponent (driven).
    pub lyapunov: Option<ExponentComparison>,
    /// Correlation dimension.
    pub correlation_dimension: Option<Pair>,
    /// Periodic orbits (driven).
    pub orbits: Option<Orbits>,
    /// Natural frequencies.
    pub natural_frequencies: Option<NaturalFrequencies>,
    /// Bifurcation diagram, where one was asked for.
    pub bifurcation: Option<Bifurcation>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

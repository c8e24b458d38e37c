//! Phase space of a record: delays, dimensions, sections, exponents, periodic orbits. Method
//! section 2.
//!
//! One algorithm a file; [`survey::survey`] runs them over a record for `whirl inspect`.

pub mod average_mutual_information;
pub mod bifurcation;
pub mod correlation_dimension;
pub mod embedding;
pub mod false_nearest_neighbours;
pub mod free_orbit;
pub mod local_sheet;
pub mod lyapunov_exponent;
pub mod model_exponent;
pub mod neighbours;
pub mod observable;
pub mod orbit_catalogue;
pub mod orbit_refinement;
pub mod poincare_section;
pub mod shift_map;
pub mod survey;
mod survey_exponent;
pub mod survey_settings;
pub mod survey_text;
pub mod survey_warnings;
pub mod tangent_exponent;
#[cfg(test)]
pub(crate) mod test_series;
pub mod unstable_periodic_orbit;

//! What every room takes from the normal distribution.

/// Half width of a 95 % interval in standard errors, z₀.₉₇₅: what docs and results say by name, and
/// by which Student's quantiles are told as standard errors.
pub const Z95: f64 = 1.96;

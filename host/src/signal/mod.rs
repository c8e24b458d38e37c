//! Signal processing of evenly spaced samples.

pub mod spectrum;

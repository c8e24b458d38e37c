//! From counts to smooth angles and velocities: low-pass, differentiation, noise, spectrum.

pub mod angles;
pub mod band;
pub mod band_limited;
pub mod differences;
pub mod fast_convolution;
pub mod lagrange;
pub mod low_pass;
pub mod noise;
pub mod sin_cos;
pub mod spectrum;

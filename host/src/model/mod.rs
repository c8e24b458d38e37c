//! Equations of motion in the form that identification uses: linear in their unknown coefficients.

pub mod double_pendulum;
pub mod weak;

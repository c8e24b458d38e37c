//! The weak form of an equation of motion, linear in its unknown coefficients.
//!
//! Each equation reads Σ_j λ_j ∫ w X_j dt = ∫ w Y dt for every test function w that vanishes with
//! its first derivatives at both ends of a window. A term X_j that contains derivatives which the
//! record does not give is written as a sum of total derivatives, X = Σ_k c_k dᵖs_k/dtᵖ, of series
//! s_k that angles and velocities give; integrating by parts, ∫ w dᵖs/dtᵖ = (−1)ᵖ ∫ w⁽ᵖ⁾ s. A
//! [`Part`] is one such c, p and s.

/// Mean of sign v over one sampling step around a sample at which the velocity is `v` and changes
/// by `step` a step: clamp(2v/|step|, −1, 1). Sums over samples then follow the instant of reversal
/// to second order, where the plain sign is off by up to half a step. sign 0 = 0.
pub fn mean_sign(v: f64, step: f64) -> f64 {
    if 2.0 * v.abs() < step.abs() {
        2.0 * v / step.abs()
    } else if v > 0.0 {
        1.0
    } else if v < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// Mean of |x| over one sampling step around a sample at which x changes by `step` a step:
/// (x² + step²/4)/|step| where it passes zero within the step. Its derivative by x is
/// [`mean_sign`], so that a corner and its place are told from the same rows.
pub fn mean_abs(x: f64, step: f64) -> f64 {
    if 2.0 * x.abs() < step.abs() { (x * x + 0.25 * step * step) / step.abs() } else { x.abs() }
}

/// How many time derivatives of the series the term contains; they are moved to the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// ∫ w s.
    Value,
    /// ∫ w ṡ = −∫ ẇ s.
    First,
    /// ∫ w s̈ = ∫ ẅ s.
    Second,
}

/// factor · dᵖ/dtᵖ of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Index of the series.
    pub series: usize,
    /// p.
    pub order: Order,
    /// Factor.
    pub factor: f64,
}

/// One unknown coefficient and what it multiplies.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Name of the coefficient.
    pub name: String,
    /// Unit of the coefficient.
    pub unit: &'static str,
    /// What it multiplies, as a sum.
    pub parts: Vec<Part>,
}

/// One equation: Σ λ_j X_j = Y.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Equation {
    /// Left-hand side.
    pub terms: Vec<Term>,
    /// Right-hand side Y.
    pub target: Vec<Part>,
}

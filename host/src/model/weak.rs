//! The weak form of an equation of motion, linear in its unknown coefficients.
//!
//! Each equation reads Σ_j λ_j ∫ w X_j dt = ∫ w Y dt for every test function w that vanishes with its first derivatives
//! at both ends of a window. A term X_j that contains derivatives which the record does not give is written as a sum of
//! total derivatives, X = Σ_k c_k dᵖs_k/dtᵖ, of series s_k that angles and velocities give; integrating by parts,
//! ∫ w dᵖs/dtᵖ = (−1)ᵖ ∫ w⁽ᵖ⁾ s. A [`Part`] is one such c, p and s.

use std::sync::Arc;

/// Everything that a series may depend on at one instant. Angles are absolute, rad; rates rad/s.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// φ1, φ2 as measured (not smoothed), rad.
    pub raw: [f64; 2],
    /// φ1, φ2 smoothed, rad.
    pub phi: [f64; 2],
    /// φ̇1, φ̇2, rad/s.
    pub rate: [f64; 2],
    /// φ̇1, φ̇2 smoothed to the band in which the signal stands clear of noise: for laws that jump where a velocity
    /// changes sign. A noisy sign is wrong whenever the velocity is small for a while, which weakens the column and makes its
    /// coefficient too large (by 0.7 % for C11 at 1024 counts and 8 f_e).
    pub clear_rate: [f64; 2],
    /// Change of `clear_rate` over one sampling step, rad/s: where within a step a velocity changes sign.
    pub clear_step: [f64; 2],
    /// sin φ1, sin φ2.
    pub sin: [f64; 2],
    /// cos φ1, cos φ2.
    pub cos: [f64; 2],
    /// sin τ of the drive.
    pub sin_tau: f64,
    /// cos τ of the drive.
    pub cos_tau: f64,
    /// Time, s.
    pub time: f64,
}

impl Sample {
    /// sin Δ, Δ = φ2 − φ1.
    pub fn sin_delta(&self) -> f64 {
        self.sin[1] * self.cos[0] - self.cos[1] * self.sin[0]
    }

    /// cos Δ, Δ = φ2 − φ1.
    pub fn cos_delta(&self) -> f64 {
        self.cos[1] * self.cos[0] + self.sin[1] * self.sin[0]
    }
}

/// Mean of sign v over one sampling step around a sample at which the velocity is `v` and changes by `step` a step:
/// clamp(2v/|step|, −1, 1). Sums over samples then follow the instant of reversal to second order, where the plain sign is off by up to half a
/// step. sign 0 = 0.
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

/// A run of samples, quantity by quantity: what simple series are made of, many samples at a time.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    /// φ1, φ2 as measured (not smoothed), rad.
    pub raw: [&'a [f64]; 2],
    /// φ̇1, φ̇2, rad/s.
    pub rate: [&'a [f64]; 2],
    /// See [`Sample::clear_rate`].
    pub clear_rate: [&'a [f64]; 2],
    /// See [`Sample::clear_step`].
    pub clear_step: [&'a [f64]; 2],
    /// sin φ1, sin φ2.
    pub sin: [&'a [f64]; 2],
    /// sin Δ and cos Δ, Δ = φ2 − φ1.
    pub delta: [&'a [f64]; 2],
    /// sin τ and cos τ of the drive.
    pub tau: [&'a [f64]; 2],
    /// The samples one by one; empty unless some series needs them.
    pub samples: &'a [Sample],
}

impl<'a> Block<'a> {
    /// A run of which only the samples one by one are known.
    pub fn of_samples(samples: &'a [Sample]) -> Self {
        let none: [&[f64]; 2] = [&[], &[]];
        Self { raw: none, rate: none, clear_rate: none, clear_step: none, sin: none, delta: none, tau: none, samples }
    }
}

/// A quantity evaluated at every sample.
pub type Series = Arc<dyn Fn(&Sample) -> f64 + Send + Sync>;

/// The same for many samples at once.
pub type Column = Arc<dyn Fn(&[Sample], &mut [f64]) + Send + Sync>;

/// A quantity along a record.
#[derive(Clone)]
pub enum Signal {
    /// From each sample.
    Each(Column),
    /// From a run of samples.
    Run(fn(&Block<'_>, &mut [f64])),
}

impl Signal {
    /// Its values over a run of samples.
    pub fn evaluate(&self, block: &Block<'_>, out: &mut [f64]) {
        match self {
            Self::Each(f) => f(block.samples, out),
            Self::Run(f) => f(block, out),
        }
    }
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
    /// Index into [`WeakModel::series`].
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

/// A system of equations over shared series.
#[derive(Clone, Default)]
pub struct WeakModel {
    /// Name for results.
    pub name: String,
    /// The series, each evaluated once a sample.
    pub series: Vec<Signal>,
    /// Names of the series: one name, one series.
    keys: Vec<String>,
    /// The equations.
    pub equations: Vec<Equation>,
    /// Coefficients whose column is a harmonic of order k of an angle as measured, with that k: white noise of variance σ² shrinks
    /// the column by exp(−k²σ²/2) on average.
    pub attenuation: Vec<(String, f64)>,
}

impl WeakModel {
    /// factor · dᵖ/dtᵖ of a series, which is added if its key is new.
    pub fn part(
        &mut self,
        key: &str,
        series: impl Fn(&Sample) -> f64 + Send + Sync + 'static,
        order: Order,
        factor: f64,
    ) -> Part {
        self.add(key, order, factor, || {
            Signal::Each(Arc::new(move |samples: &[Sample], out: &mut [f64]| {
                for (s, o) in samples.iter().zip(out) {
                    *o = series(s);
                }
            }))
        })
    }

    /// The same with a series that is made a run of samples at a time.
    pub fn run(&mut self, key: &str, series: fn(&Block<'_>, &mut [f64]), order: Order, factor: f64) -> Part {
        self.add(key, order, factor, || Signal::Run(series))
    }

    fn add(&mut self, key: &str, order: Order, factor: f64, series: impl FnOnce() -> Signal) -> Part {
        let index = self.keys.iter().position(|k| k == key).unwrap_or_else(|| {
            self.series.push(series());
            self.keys.push(key.to_owned());
            self.series.len() - 1
        });
        Part { series: index, order, factor }
    }

    /// Whether some series is made sample by sample.
    pub fn needs_samples(&self) -> bool {
        self.series.iter().any(|s| matches!(s, Signal::Each(_)))
    }
}

//! Choices of the harmonic balance: every one that the seed studies.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::error::{BadInput, Result};

/// What is expanded in sub-harmonics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Orbits {
    /// Extracted unstable periodic orbits (chapters 2 and 3).
    Unstable {
        /// e of (3.24), share of the data's span.
        tolerance: f64,
        /// Longest period, drive periods.
        longest: usize,
        /// Delay T_d, samples; none: the first clear minimum of the average mutual information.
        delay: Option<usize>,
    },
    /// Consecutive pieces of so many drive periods, closed or not (chapter 4).
    Pieces {
        /// n.
        periods: usize,
    },
}

/// Where velocities and accelerations come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Differentiation {
    /// The Fourier series of the angle without its rotation (2.10), (2.11).
    #[default]
    Fourier,
    /// The Fourier series of z = exp(iθ): θ′ = Im z̄ z′, θ″ = Im z̄ z″ (section 4.3.1).
    Circle,
    /// Five-point differences (3.29), (3.30), which do not see where the orbit fails to close.
    FivePoint,
}

/// Which sub-harmonics of an orbit of period k are balanced; index j stands for j f_e/k.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Subharmonics {
    /// All up to so many times the drive frequency (the seed: 1, M_k ≤ k).
    UpTo(f64),
    /// So many a drive period, those that are largest in the acceleration's spectrum below three
    /// times the drive frequency.
    Largest(usize),
    /// The first so many harmonics of the drive only.
    Harmonics(usize),
}

/// The optimisation driven by residuals (section 3.4.5).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Optimisation {
    /// β: rows with a residual above (1 − β) e_max are dropped. Default 0.05.
    pub beta: f64,
    /// ε at which it stops. Default 0.10.
    pub bound: f64,
    /// Most rounds. Default 200.
    pub rounds: usize,
}

impl Default for Optimisation {
    fn default() -> Self {
        Self { beta: 0.05, bound: super::super::ERROR_BOUND, rounds: 200 }
    }
}

/// Function series for the single pendulum's unknown functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// cos kθ, sin kθ up to this order K.
    Harmonic(usize),
    /// Linear interpolation between so many nodes, evenly over the circle from −π on.
    Interpolation(usize),
}

/// The second step for small dampings (3.35) to (3.38).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnergyBalance {
    /// Dampings stay those of the harmonic balance.
    #[default]
    None,
    /// Each equation by itself, conservative terms taken to vanish: the seed's.
    Equations,
    /// The sum J_o1·(first)·φ1′ + J_o2·(second)·φ2′, in which the coupling cancels; energies at
    /// both ends as measured.
    Coupled,
}

/// All choices.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Orbits or pieces.
    pub orbits: Orbits,
    /// Differentiation.
    pub differentiation: Differentiation,
    /// Cut-off of the low-pass on every factor before products are formed, as a share of the
    /// sampling rate; none: no low-pass.
    pub low_pass: Option<f64>,
    /// Sub-harmonics.
    pub subharmonics: Subharmonics,
    /// Whether the mean (j = 0) is balanced too.
    pub mean_row: bool,
    /// Optimisation; none: all rows are kept.
    pub optimisation: Option<Optimisation>,
    /// Function series (single pendulum).
    pub basis: Basis,
    /// Coefficients that are taken as known, such as the dampings.
    pub known: BTreeMap<String, f64>,
    /// Energy balance.
    pub energy_balance: EnergyBalance,
}

impl Settings {
    /// The frequency method: pieces of `periods` drive periods, everything else as the seed has it.
    pub fn frequency(periods: usize) -> Self {
        Self {
            orbits: Orbits::Pieces { periods },
            differentiation: Differentiation::Fourier,
            low_pass: Some(0.2),
            subharmonics: Subharmonics::UpTo(1.0),
            mean_row: true,
            optimisation: Some(Optimisation::default()),
            basis: Basis::Harmonic(1),
            known: BTreeMap::new(),
            energy_balance: EnergyBalance::None,
        }
    }

    /// The method of extracted orbits at a tolerance, everything else as the seed has it.
    pub fn orbits(tolerance: f64) -> Self {
        Self { orbits: Orbits::Unstable { tolerance, longest: 16, delay: None }, ..Self::frequency(100) }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the option, its value and what it may be.
    pub fn validate(&self) -> Result<()> {
        let check = |option: &str, value: f64, low: f64, high: f64| {
            if value >= low && value <= high {
                return Ok(());
            }
            Err(BadInput::new(value.to_string(), format!("a value from {low} to {high}")).at(option.to_owned()))
        };
        match self.orbits {
            Orbits::Unstable { tolerance, longest, delay } => {
                check("--tolerance", tolerance, 1e-4, 0.5)?;
                check("--longest-period", longest as f64, 1.0, 64.0)?;
                check("--delay", delay.unwrap_or(1) as f64, 1.0, 1e5)?;
            }
            Orbits::Pieces { periods } => check("--piece-periods", periods as f64, 1.0, 1e4)?,
        }
        check("--low-pass", self.low_pass.unwrap_or(0.2), 1e-3, 0.5)?;
        match self.subharmonics {
            Subharmonics::UpTo(f) => check("--subharmonics up-to", f, 0.05, 20.0)?,
            Subharmonics::Largest(n) | Subharmonics::Harmonics(n) => {
                check("--subharmonics largest or harmonics", n as f64, 1.0, 20.0)?;
            }
        }
        match self.basis {
            Basis::Harmonic(k) => check("--basis harmonic", k as f64, 1.0, 12.0)?,
            Basis::Interpolation(n) => check("--basis interpolation", n as f64, 3.0, 64.0)?,
        }
        if let Some(o) = self.optimisation {
            check("--beta", o.beta, 1e-6, 0.9)?;
            check("--error-bound", o.bound, 1e-9, 10.0)?;
            check("--rounds", o.rounds as f64, 1.0, 1e5)?;
        }
        if let Some((name, value)) = self.known.iter().find(|(_, v)| !v.is_finite()) {
            return Err(BadInput::new(value.to_string(), "a number").at(format!("--known-coefficient {name}")));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_out_of_range_are_named() {
        assert!(Settings::frequency(100).validate().is_ok() && Settings::orbits(0.05).validate().is_ok());
        let cases: [(&str, Settings); 4] = [
            ("--piece-periods", Settings::frequency(0)),
            ("--tolerance", Settings::orbits(f64::NAN)),
            ("--low-pass", Settings { low_pass: Some(0.7), ..Settings::frequency(1) }),
            ("--basis", Settings { basis: Basis::Interpolation(2), ..Settings::frequency(1) }),
        ];
        for (name, settings) in cases {
            assert!(settings.validate().unwrap_err().to_string().contains(name), "{name}");
        }
    }
}

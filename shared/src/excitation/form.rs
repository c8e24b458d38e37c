//! The form of the motion: several sines, or a table.

use serde::{Deserialize, Serialize};

use super::{Table, WHOLE};
use crate::waveform::{cos_sin, fixed, rounded};

/// Most components of a form.
pub const MOST_COMPONENTS: usize = 6;

/// What gives the displacement at a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape<'a> {
    /// A sum of sines.
    Sines(&'a Form),
    /// A table.
    Table(&'a Table),
}

impl Default for Shape<'_> {
    fn default() -> Self {
        Self::Sines(&Form::SINE)
    }
}

impl Shape<'_> {
    /// Displacement at an amplitude (nm) and a phase (turns · 2⁻³²), nm: see [`Form::displacement`]
    /// and [`Table::displacement`].
    #[must_use]
    pub fn displacement(&self, amplitude_nanometre: u32, phase: u32) -> i32 {
        match self {
            Self::Sines(form) => form.displacement(amplitude_nanometre, phase),
            Self::Table(table) => table.displacement(amplitude_nanometre, phase),
        }
    }
}

/// A component of a form; one whose share is 0 ends the list of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Component {
    /// h_k: its frequency in those of the phase.
    pub harmonic: u8,
    /// s_k: its share of the amplitude, in 1/[`WHOLE`].
    pub share: u16,
    /// ψ_k, turns · 2⁻¹⁶.
    pub phase: u16,
}

/// The form of the base's motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Form(pub [Component; MOST_COMPONENTS]);

impl Default for Form {
    fn default() -> Self {
        Self::SINE
    }
}

impl Form {
    /// cos φ.
    pub const SINE: Self = {
        let mut form = [Component { harmonic: 0, share: 0, phase: 0 }; MOST_COMPONENTS];
        form[0] = Component { harmonic: 1, share: WHOLE, phase: 0 };
        Self(form)
    };

    /// The components that there are.
    pub fn components(&self) -> impl Iterator<Item = &Component> {
        self.0.iter().take_while(|component| component.share > 0)
    }

    /// Displacement at an amplitude (nm) and a phase (turns · 2⁻³²), nm: rounded once, half away
    /// from zero; saturates at ±(2³¹ − 1).
    #[must_use]
    pub fn displacement(&self, amplitude_nanometre: u32, phase: u32) -> i32 {
        // Below 2⁶³ where the shares are at most 1 together.
        rounded(self.components().fold(0, |sum: i64, component| {
            let amplitude = i64::from(component.amplitude(amplitude_nanometre));
            sum.saturating_add(amplitude * fixed(cos_sin(component.angle(phase)).0))
        }))
    }

    /// Σ s_k h_k² in 1/[`WHOLE`]: what a form's acceleration is of that of a sine, at most.
    #[must_use]
    pub fn sharpness(&self) -> u64 {
        self.components().map(|c| u64::from(c.share) * u64::from(c.harmonic).pow(2)).sum()
    }

    /// Greatest harmonic.
    #[must_use]
    pub fn highest(&self) -> u8 {
        self.components().map(|component| component.harmonic).max().unwrap_or(0)
    }

    pub(super) fn is_possible(&self) -> bool {
        let sum: u32 = self.components().map(|component| u32::from(component.share)).sum();
        (1..=u32::from(WHOLE)).contains(&sum) && self.components().all(|component| component.harmonic > 0)
    }
}

impl Component {
    /// a_k = a s_k, nm, rounded down: together they are at most a.
    #[must_use]
    pub fn amplitude(&self, amplitude_nanometre: u32) -> u32 {
        let product = u64::from(amplitude_nanometre) * u64::from(self.share) / u64::from(WHOLE);
        u32::try_from(product).unwrap_or(u32::MAX)
    }

    /// h_k φ + ψ_k, turns · 2⁻³².
    #[must_use]
    pub const fn angle(&self, phase: u32) -> u32 {
        phase.wrapping_mul(self.harmonic as u32).wrapping_add((self.phase as u32) << 16)
    }
}

//! What the base is commanded to do beside one sine: tick by tick, in integers, alike everywhere.
//!
//! ```text
//! y = Σ a_k cos(h_k φ + ψ_k),   a_k = a s_k,   Σ s_k ≤ 1
//! ```
//!
//! φ is the phase accumulator ([`crate::waveform`]), a the amplitude, on its way along ramps; the
//! *form* are the components with harmonic h_k, share s_k and phase ψ_k. |y| ≤ a, whatever the
//! phases. One component of harmonic 1, share 1 and phase 0 is the sine, bit for bit. In the place of
//! the components a [`Table`] may give y/a at any phase.
//!
//! The frequency *glides*: φ's increment changes every [`STAIR`] ticks, so that it is constant in
//! each block of samples and the blocks tell φ at every tick, whatever a host knows of the glide.
//! With k of K stairs gone it is lo + (hi − lo) k/K, or lo (hi/lo)^(k/K), rounded; the power is
//! 2^(k/K · log₂(hi/lo)), logarithm and power by squares and roots of 62 binary places. The
//! frequency's steps are (f₁ − f₀) [`STAIR`]/(f_s T) of a linear glide in T seconds.
//!
//! The amplitude goes in *steps*: along a list, each held for so long. Glide and holding go on only
//! while the amplitude is where it was sent.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::frame::{BLOCK_LEN, Command, ShakerLimits};

mod course;
mod form;
mod table;

pub use course::Course;
pub use form::{Component, Form, MOST_COMPONENTS, Shape};
pub use table::{CHUNK, Extent, POINTS, Table, TableName};

/// Most amplitudes in a list.
pub const MOST_STEPS: usize = 8;
/// A share of 1.
pub const WHOLE: u16 = 1 << 15;
/// Ticks for which a gliding frequency stays.
pub const STAIR: u32 = BLOCK_LEN as u32;
/// Shortest and longest glide from one frequency to the other, ms.
pub const GLIDE_MS: [u32; 2] = [100, 3_600_000];
/// Shortest and longest holding of an amplitude, ms.
pub const HOLD_MS: [u32; 2] = [100, 3_600_000];

/// How a frequency glides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Law {
    /// It stays.
    #[default]
    Steady,
    /// By as many hertz in every second.
    Linear,
    /// By the same factor in every second.
    Logarithmic,
}

/// A glide of the frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Glide {
    /// How.
    pub law: Law,
    /// Back again, and so on; otherwise the frequency stays where it has come to.
    pub back: bool,
    /// Where to, mHz.
    pub to_millihertz: u32,
    /// Time of one way, ms.
    pub ms: u32,
}

/// What the base is commanded to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Excitation {
    /// Frequency of the phase at the start, mHz.
    pub frequency_millihertz: u32,
    /// How it goes on.
    pub glide: Glide,
    /// Amplitudes one after the other, µm.
    pub amplitudes_micrometre: [u32; MOST_STEPS],
    /// How many of them count; the last one stays.
    pub steps: u8,
    /// Time for which each is held, ms.
    pub hold_ms: u32,
    /// The form.
    pub form: Form,
    /// It begins when the trigger input says so.
    pub on_trigger: bool,
    /// The table that takes the place of the form; none where it has no points.
    pub table: TableName,
}

/// A part of an excitation that is prepared before it is started: commands stay short so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Part {
    /// All anew: one sine, no amplitude, a frequency that stays, no trigger.
    Anew,
    /// A component of the form.
    Component {
        /// From 0; those before it are there already.
        place: u8,
        /// The component.
        component: Component,
    },
    /// An amplitude; as many count as have been given.
    Amplitude {
        /// From 0.
        place: u8,
        /// Amplitude, µm.
        micrometre: u32,
    },
    /// Time for which each amplitude is held.
    Hold {
        /// ms.
        ms: u32,
    },
    /// How the frequency goes on.
    Glide(Glide),
    /// It begins at the trigger.
    OnTrigger,
    /// Points of a table, for whatever excitation names it; refused while one waits for its trigger.
    Points {
        /// The first of them, in units of [`CHUNK`].
        place: u8,
        /// Control points, in 1/[`WHOLE`].
        points: [i16; CHUNK],
    },
    /// The table that is there moves the base, if it is the one that is named.
    Table(TableName),
}

/// Most commands of an excitation, beside those of a table's points ([`Table::parts`]).
pub const MOST_COMMANDS: usize = 6 + MOST_COMPONENTS + MOST_STEPS;

/// Why an excitation is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// An amplitude: the greatest one, µm.
    Amplitude(u32),
    /// The frequency of the phase: least or greatest, mHz; of the highest component it is within
    /// the shaker's.
    Frequency(u32),
    /// An amplitude, for the acceleration at the highest frequency: the greatest one, µm.
    Acceleration(u32),
    /// The time of a glide: shortest or longest, ms.
    GlideTime(u32),
    /// The time of holding: shortest or longest, ms.
    HoldTime(u32),
    /// The number of amplitudes: least or greatest.
    Steps(u32),
    /// The form: components with a harmonic above 0 whose shares are together above 0 and at most
    /// this; with a table it is the sine, whose frequency stays.
    Form(u32),
    /// The number of a table's points: least or greatest.
    Points(u32),
    /// The points that are there are not those of the table that is named: their check.
    Table(u32),
}

impl Refusal {
    /// The limit, in the unit of its kind.
    #[must_use]
    pub const fn limit(self) -> u32 {
        match self {
            Self::Amplitude(limit)
            | Self::Frequency(limit)
            | Self::Acceleration(limit)
            | Self::GlideTime(limit)
            | Self::HoldTime(limit)
            | Self::Steps(limit)
            | Self::Form(limit)
            | Self::Points(limit)
            | Self::Table(limit) => limit,
        }
    }
}

/// The bound that a value is beyond.
fn beyond(found: u32, [min, max]: [u32; 2]) -> Option<u32> {
    if found < min { Some(min) } else { (found > max).then_some(max) }
}

impl Excitation {
    /// A sine of constant frequency and amplitude.
    #[must_use]
    pub const fn sine(amplitude_micrometre: u32, frequency_millihertz: u32) -> Self {
        let mut amplitudes_micrometre = [0; MOST_STEPS];
        amplitudes_micrometre[0] = amplitude_micrometre;
        Self {
            frequency_millihertz,
            glide: Glide { law: Law::Steady, back: false, to_millihertz: 0, ms: 0 },
            amplitudes_micrometre,
            steps: 1,
            hold_ms: 0,
            form: Form::SINE,
            on_trigger: false,
            table: TableName::NONE,
        }
    }

    /// Puts a part in, or points into the table.
    ///
    /// # Errors
    /// The last place, where there is none such.
    pub fn put(&mut self, part: Part, table: &mut Table) -> Result<(), u32> {
        match part {
            Part::Anew => *self = Self { steps: 0, ..Self::sine(0, 0) },
            Part::Component { place, component } => {
                let last = MOST_COMPONENTS as u32 - 1;
                *self.form.0.get_mut(usize::from(place)).ok_or(last)? = component;
            }
            Part::Amplitude { place, micrometre } => {
                let last = MOST_STEPS as u32 - 1;
                *self.amplitudes_micrometre.get_mut(usize::from(place)).ok_or(last)? = micrometre;
                self.steps = self.steps.max(place + 1);
            }
            Part::Hold { ms } => self.hold_ms = ms,
            Part::Glide(glide) => self.glide = glide,
            Part::OnTrigger => self.on_trigger = true,
            Part::Points { place, points } => return table.put(place, &points),
            Part::Table(name) => self.table = name,
        }
        Ok(())
    }

    /// The commands that prepare and start it; the points of its table come before.
    #[must_use]
    pub fn commands(&self) -> Vec<Command, MOST_COMMANDS> {
        let places = || 0_u8..;
        let components = self.form.components().filter(|_| self.form != Form::SINE);
        let components = components.zip(places()).map(|(c, place)| Part::Component { place, component: *c });
        let amplitudes = self.amplitudes().iter().zip(places());
        let amplitudes = amplitudes.map(|(a, place)| Part::Amplitude { place, micrometre: *a });
        let parts = core::iter::once(Part::Anew)
            .chain(components)
            .chain(amplitudes)
            .chain((self.hold_ms > 0).then_some(Part::Hold { ms: self.hold_ms }))
            .chain((self.glide.law != Law::Steady).then_some(Part::Glide(self.glide)))
            .chain(self.on_trigger.then_some(Part::OnTrigger))
            .chain(self.table.is_some().then_some(Part::Table(self.table)));
        let start = Command::Excite { frequency_millihertz: self.frequency_millihertz };
        // There is room for all.
        parts.map(Command::Prepare).chain(core::iter::once(start)).collect()
    }

    /// Whether it is a sine whose frequency stays, at whatever amplitudes: what the device's own
    /// identification assumes.
    #[must_use]
    pub fn is_sine(&self) -> bool {
        self.form == Form::SINE && self.glide.law == Law::Steady && !self.table.is_some()
    }

    /// Whether it is a sine of one frequency and one amplitude.
    #[must_use]
    pub fn is_constant(&self) -> bool {
        self.is_sine() && self.steps == 1
    }

    /// The amplitudes that count, µm.
    #[must_use]
    pub fn amplitudes(&self) -> &[u32] {
        self.amplitudes_micrometre.get(..usize::from(self.steps)).unwrap_or(&self.amplitudes_micrometre)
    }

    /// Greatest frequency of the phase, mHz.
    #[must_use]
    pub fn greatest_frequency(&self) -> u32 {
        if self.glide.law == Law::Steady {
            self.frequency_millihertz
        } else {
            self.frequency_millihertz.max(self.glide.to_millihertz)
        }
    }

    /// Why a shaker of these limits must not do it; none where it may. Amplitude, highest frequency
    /// and acceleration Σ a_k (2π h_k f)² are bounded for the sum, whatever the phases.
    ///
    /// The order of the checks: form, steps, amplitude, frequency, acceleration, times. What its
    /// table must keep is checked by [`Extent::refusal`].
    #[must_use]
    pub fn refusal(&self, limits: &ShakerLimits) -> Option<Refusal> {
        let alone = self.form == Form::SINE && self.glide.law == Law::Steady;
        if !self.form.is_possible() || (self.table.is_some() && !alone) {
            return Some(Refusal::Form(u32::from(WHOLE)));
        }
        if let Some(limit) = beyond(u32::from(self.steps), [1, MOST_STEPS as u32]) {
            return Some(Refusal::Steps(limit));
        }
        let most = self.amplitudes().iter().copied().max().unwrap_or(0);
        if let Some(limit) = beyond(most, [0, limits.amplitude_micrometre]) {
            return Some(Refusal::Amplitude(limit));
        }
        let band = [1, limits.frequency_millihertz / u32::from(self.form.highest()).max(1)];
        let glides = self.glide.law != Law::Steady;
        let frequencies = [Some(self.frequency_millihertz), glides.then_some(self.glide.to_millihertz)];
        if let Some(limit) = frequencies.into_iter().flatten().find_map(|f| beyond(f, band)) {
            return Some(Refusal::Frequency(limit));
        }
        let limit = amplitude_limit(limits.acceleration_millimetre_per_s2, self.greatest_frequency(), &self.form);
        if most > limit && !self.table.is_some() {
            return Some(Refusal::Acceleration(limit));
        }
        if let Some(limit) = beyond(self.glide.ms, GLIDE_MS).filter(|_| glides) {
            return Some(Refusal::GlideTime(limit));
        }
        beyond(self.hold_ms, HOLD_MS).filter(|_| self.steps > 1).map(Refusal::HoldTime)
    }
}

/// Greatest amplitude in µm at which a form's acceleration a Σ s_k (2π h_k f)² keeps within a limit
/// in mm/s², rounded down.
#[must_use]
pub fn amplitude_limit(acceleration_millimetre_per_s2: u32, frequency_millihertz: u32, form: &Form) -> u32 {
    // a = A/(2πf)²: 10³ µm a mm and 10⁶ mHz² a Hz² over 4π² make 10⁹/4π² = 25 330 295.91.
    let numerator = u128::from(acceleration_millimetre_per_s2) * 25_330_295 * u128::from(WHOLE);
    let square = u128::from(frequency_millihertz).pow(2) * u128::from(form.sharpness());
    u32::try_from(numerator / square.max(1)).unwrap_or(u32::MAX)
}

/// Ticks of a time, at least 1.
#[must_use]
pub fn ticks(ms: u32, sample_rate_millihertz: u32) -> u32 {
    let ticks = u64::from(ms) * u64::from(sample_rate_millihertz) / 1_000_000;
    u32::try_from(ticks).unwrap_or(u32::MAX).max(1)
}

#[cfg(test)]
mod tests;

//! What a user asks of the shaker beyond one sine, and what the device is told: sweeps, several
//! sines, steps of amplitude ([`whirl_shared::excitation`]).

use core::fmt;
use core::str::FromStr;
use std::path::PathBuf;

use whirl_shared::excitation::{Component, Excitation, Form, GLIDE_MS, Glide, Law, MOST_COMPONENTS, MOST_STEPS, WHOLE};

use super::table::Read;
use crate::error::{BadInput, Result};

/// Frequencies from one to another, `2..8`, Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// At the start, Hz.
    pub from_hz: f64,
    /// At the end, Hz.
    pub to_hz: f64,
}

impl FromStr for Band {
    type Err = String;

    fn from_str(text: &str) -> core::result::Result<Self, String> {
        let ends = text.split_once("..").and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        let Some((from_hz, to_hz)) = ends else {
            return Err(format!("found {text}, expected two frequencies in Hz, such as 2..8"));
        };
        Ok(Self { from_hz, to_hz })
    }
}

impl fmt::Display for Band {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.from_hz, self.to_hz)
    }
}

/// What is asked for; by default one sine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Excite {
    /// The frequency glides from one to the other.
    pub sweep: Option<Band>,
    /// In this time, s.
    pub sweep_s: Option<f64>,
    /// By the same factor in every second, not by as many hertz.
    pub logarithmic: bool,
    /// Back again, and so on.
    pub back: bool,
    /// Harmonics of the drive's frequency that sound together.
    pub multisine: Vec<u8>,
    /// A file of one period of the displacement, `capture::table`.
    pub table: Option<PathBuf>,
    /// Amplitudes one after the other, m.
    pub amplitude_steps_m: Vec<f64>,
    /// Time for which each is held, s.
    pub hold_s: Option<f64>,
    /// It begins at the device's trigger input.
    pub on_trigger: bool,
}

/// Shortest holding of an amplitude that a capture is sure to see, s.
const HOLD_S: f64 = 0.5;

/// A number of a value's thousandths, which the wire carries; no other is taken.
fn thousandths(value: f64, option: &str, expected: &str, range: [u32; 2]) -> Result<u32> {
    let scaled = value * 1e3;
    let whole = scaled.round();
    if !((scaled - whole).abs() <= 1e-6 && (f64::from(range[0])..=f64::from(range[1])).contains(&whole)) {
        return Err(BadInput::new(value.to_string(), expected).at(option).remedy("Correct the option"));
    }
    // Within 32 bits, see above.
    Ok(whole as u32)
}

impl Excite {
    /// Whether more than one sine at one amplitude is asked for.
    pub fn is_asked(&self) -> bool {
        *self != Self::default()
    }

    /// What the device is told, at an amplitude (µm) and a frequency (mHz) of the drive.
    ///
    /// # Errors
    /// Names the option, the value found and the one expected.
    pub(super) fn excitation(&self, amplitude_micrometre: u32, frequency_millihertz: u32) -> Result<Excitation> {
        let mut excitation = Excitation::sine(amplitude_micrometre, frequency_millihertz);
        excitation.on_trigger = self.on_trigger;
        if self.table.is_some() && (self.sweep.is_some() || !self.multisine.is_empty()) {
            let with = if self.sweep.is_some() { "--sweep" } else { "--multisine" };
            return Err(BadInput::new(format!("--table with {with}"), "one of them").at("--table").remedy(
                "A table is played at the drive's frequency, and is all that the base does: leave one of them out",
            ));
        }
        match self.sweep {
            Some(band) => self.glide(band, &mut excitation)?,
            None if self.sweep_s.is_some() || self.logarithmic || self.back => {
                return Err(BadInput::new("no --sweep", "the frequencies of the sweep that this is to be of")
                    .at("--sweep-s, --sweep-log, --sweep-back")
                    .remedy("Add --sweep F0..F1"));
            }
            None => {}
        }
        if !self.multisine.is_empty() {
            excitation.form = multisine(&self.multisine)?;
        }
        self.steps(&mut excitation)?;
        Ok(excitation)
    }

    /// The table that moves the base.
    ///
    /// # Errors
    /// A file that holds none: its line, what was found and what is expected.
    pub(super) fn table(&self) -> Result<Option<Read>> {
        self.table.as_deref().map(Read::of_file).transpose()
    }

    fn glide(&self, band: Band, excitation: &mut Excitation) -> Result<()> {
        let hertz =
            |value| thousandths(value, "--sweep", "frequencies above 0 in steps of 0.001 Hz", [1, 4_000_000_000]);
        excitation.frequency_millihertz = hertz(band.from_hz)?;
        let Some(seconds) = self.sweep_s else {
            return Err(BadInput::new("--sweep without its time", "--sweep-s S")
                .at("--sweep-s")
                .remedy("Add the time from one frequency to the other, in seconds"));
        };
        excitation.glide = Glide {
            law: if self.logarithmic { Law::Logarithmic } else { Law::Linear },
            back: self.back,
            to_millihertz: hertz(band.to_hz)?,
            ms: thousandths(seconds, "--sweep-s", "0.1 to 3600 s, in milliseconds", GLIDE_MS)?,
        };
        Ok(())
    }

    fn steps(&self, excitation: &mut Excitation) -> Result<()> {
        let steps = &self.amplitude_steps_m;
        let bad = |found: String, expected: String| {
            Err(BadInput::new(found, expected).at("--amplitude-steps").remedy("Correct the option"))
        };
        if steps.is_empty() {
            return match self.hold_s {
                Some(s) => bad(format!("--hold-s {s} without it"), "the amplitudes that are to be held".to_owned()),
                None => Ok(()),
            };
        }
        if steps.len() > MOST_STEPS {
            return bad(format!("{} amplitudes", steps.len()), format!("at most {MOST_STEPS}"));
        }
        for (place, &metres) in excitation.amplitudes_micrometre.iter_mut().zip(steps) {
            *place =
                thousandths(metres * 1e3, "--amplitude-steps", "amplitudes in m, in steps of 1e-6", [0, 2_000_000])?;
        }
        // At most as many as there are places.
        excitation.steps = steps.len() as u8;
        excitation.hold_ms = match self.hold_s {
            Some(s) if s >= HOLD_S => thousandths(s, "--hold-s", "0.5 to 3600 s, in milliseconds", [500, 3_600_000])?,
            Some(s) => return bad(format!("--hold-s {s}"), format!("{HOLD_S} s or more")),
            None => return bad("amplitudes without --hold-s".to_owned(), "the time for which each is held".to_owned()),
        };
        Ok(())
    }

    /// The options by which a command line asks for the same.
    pub(super) fn options(&self) -> Vec<String> {
        let mut words = Vec::new();
        let mut put = |option: &str, value: Option<String>| {
            if let Some(value) = value {
                words.extend([option.to_owned(), value]);
            }
        };
        let list = |values: Vec<String>| (!values.is_empty()).then(|| values.join(","));
        put("--sweep", self.sweep.map(|band| band.to_string()));
        put("--sweep-s", self.sweep_s.map(|s| s.to_string()));
        put("--multisine", list(self.multisine.iter().map(u8::to_string).collect()));
        put("--table", self.table.as_ref().map(|path| path.display().to_string()));
        put("--amplitude-steps", list(self.amplitude_steps_m.iter().map(f64::to_string).collect()));
        put("--hold-s", self.hold_s.map(|s| s.to_string()));
        for (option, on) in
            [("--sweep-log", self.logarithmic), ("--sweep-back", self.back), ("--on-trigger", self.on_trigger)]
        {
            words.extend(on.then(|| option.to_owned()));
        }
        words
    }
}

/// Harmonics of equal share with M. R. Schroeder's phases, ψ_k = −π k (k − 1)/N for the k-th of N:
/// the crest is low. Source: IEEE Trans. Information Theory 16 (1970) 85.
fn multisine(harmonics: &[u8]) -> Result<Form> {
    let bad = |found: String, expected: String| {
        Err(BadInput::new(found, expected).at("--multisine").remedy("Such as --multisine 1,2,3"))
    };
    if harmonics.len() > MOST_COMPONENTS {
        return bad(format!("{} harmonics", harmonics.len()), format!("at most {MOST_COMPONENTS}"));
    }
    if let Some(n) =
        harmonics.iter().enumerate().find_map(|(i, n)| (*n == 0 || harmonics[..i].contains(n)).then_some(n))
    {
        return bad(format!("harmonic {n}"), "whole numbers from 1 on, each once".to_owned());
    }
    // At most six.
    let all = harmonics.len() as u32;
    let mut form = Form([Component::default(); MOST_COMPONENTS]);
    for ((component, &harmonic), k) in form.0.iter_mut().zip(harmonics).zip(0..) {
        // Turns · 2⁻¹⁶ behind: k (k − 1)/2N.
        let behind: u32 = k * (k + 1) * 32_768 / all;
        let share = WHOLE / all as u16;
        *component = Component { harmonic, share, phase: (behind as u16).wrapping_neg() };
    }
    Ok(form)
}

/// In words, for people.
pub(super) fn words(e: &Excitation) -> String {
    let thousandths = |n: u32| f64::from(n) / 1000.0;
    let mut text = e.amplitudes().iter().map(|a| thousandths(*a).to_string()).collect::<Vec<_>>().join(", ");
    text.push_str(&format!(" mm at {} Hz", thousandths(e.frequency_millihertz)));
    if e.glide.law != Law::Steady {
        let law = if e.glide.law == Law::Linear { "linearly" } else { "logarithmically" };
        let back = if e.glide.back { " and back" } else { "" };
        text.push_str(&format!(
            " {law} to {} Hz in {} s{back}",
            thousandths(e.glide.to_millihertz),
            thousandths(e.glide.ms)
        ));
    }
    if e.form != Form::SINE {
        let all: Vec<String> = e.form.components().map(|c| c.harmonic.to_string()).collect();
        text.push_str(&format!(", harmonics {}", all.join(", ")));
    }
    if e.table.is_some() {
        text.push_str(&format!(", a table of {} points ({:08x})", e.table.points, e.table.check));
    }
    if e.steps > 1 {
        text.push_str(&format!(", each for {} s", thousandths(e.hold_ms)));
    }
    text
}

#[cfg(test)]
#[path = "excite_tests.rs"]
mod tests;

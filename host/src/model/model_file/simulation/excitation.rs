//! Inputs of a simulated system: harmonic, random, multisine, impulses (once or periodic), and sums
//! of them.
//!
//! Random and multisine inputs have random phases from the seed and are band-limited; an impulse is
//! amplitude · cos²(πt/width) over its width. All are smooth in time, so that what is sampled is
//! what acted.

use core::f64::consts::{PI, TAU};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

use crate::error::{BadInput, Result};

/// Most lines of a random input.
const MOST_LINES: f64 = 4000.0;

/// One part of an input, SI.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Excitation {
    /// A constant.
    Constant {
        /// Value.
        amplitude: f64,
    },
    /// amplitude · sin(2π f t + phase).
    Harmonic {
        /// Amplitude.
        amplitude: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Phase, rad.
        #[serde(default)]
        phase_rad: f64,
    },
    /// Random phases on lines 1/(2 · length of the record) apart: does not repeat within the
    /// record.
    Random {
        /// Root mean square.
        rms: f64,
        /// Lowest frequency, Hz.
        #[serde(default)]
        from_hz: f64,
        /// Highest frequency, Hz.
        to_hz: f64,
    },
    /// Random phases on lines one over the period apart.
    Multisine {
        /// Root mean square.
        rms: f64,
        /// Lowest frequency, Hz.
        #[serde(default)]
        from_hz: f64,
        /// Highest frequency, Hz.
        to_hz: f64,
        /// Period, s.
        period_s: f64,
    },
    /// amplitude · cos²(π(t − at)/width) for |t − at| < width/2, again every period if one is
    /// given.
    Impulse {
        /// Height.
        amplitude: f64,
        /// Width of the base, s.
        width_s: f64,
        /// Time of the first, s.
        #[serde(default)]
        at_s: f64,
        /// Period, s.
        #[serde(default)]
        period_s: Option<f64>,
    },
}

/// An input in continuous time.
#[derive(Clone, Debug, Default)]
pub struct Signal {
    constant: f64,
    /// Amplitude, angular frequency, phase.
    lines: Vec<[f64; 3]>,
    /// Amplitude, width, time, period (infinite for one).
    impulses: Vec<[f64; 4]>,
}

impl Signal {
    /// The sum of some parts over a record of `length_s`; `stream` keeps inputs apart.
    ///
    /// # Errors
    /// A value out of range, without file and place.
    pub fn new(parts: &[Excitation], length_s: f64, rate_hz: f64, seed: u64, stream: u64) -> Result<Self> {
        let mut out = Self::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(0x1000 + stream);
        let finite = |name: &str, x: f64, low: f64, high: f64| {
            if x >= low && x <= high {
                Ok(())
            } else {
                Err(BadInput::new(format!("{name} = {x}"), format!("a value from {low} to {high}")))
            }
        };
        for part in parts {
            match *part {
                Excitation::Constant { amplitude } => {
                    finite("amplitude", amplitude, -1e12, 1e12)?;
                    out.constant += amplitude;
                }
                Excitation::Harmonic { amplitude, frequency_hz, phase_rad } => {
                    finite("amplitude", amplitude, -1e12, 1e12)?;
                    finite("frequency_hz", frequency_hz, 0.0, 0.5 * rate_hz)?;
                    finite("phase_rad", phase_rad, -1e6, 1e6)?;
                    out.lines.push([amplitude, TAU * frequency_hz, phase_rad]);
                }
                Excitation::Random { rms, from_hz, to_hz } => {
                    let spacing = (0.5 / length_s).max((to_hz - from_hz) / MOST_LINES);
                    finite("rms", rms, 0.0, 1e12)?;
                    finite("to_hz", to_hz, from_hz.max(0.0), 0.5 * rate_hz)?;
                    out.band(rms, from_hz, to_hz, spacing, &mut rng);
                }
                Excitation::Multisine { rms, from_hz, to_hz, period_s } => {
                    finite("rms", rms, 0.0, 1e12)?;
                    finite("to_hz", to_hz, from_hz.max(0.0), 0.5 * rate_hz)?;
                    finite("period_s", period_s, 2.0 / rate_hz, MOST_LINES / (to_hz - from_hz).max(1e-9))?;
                    out.band(rms, from_hz, to_hz, 1.0 / period_s, &mut rng);
                }
                Excitation::Impulse { amplitude, width_s, at_s, period_s } => {
                    finite("amplitude", amplitude, -1e12, 1e12)?;
                    finite("width_s", width_s, 2.0 / rate_hz, 1e6)?;
                    finite("at_s", at_s, -1e9, 1e9)?;
                    let period = period_s.unwrap_or(f64::INFINITY);
                    finite("period_s", period, width_s, f64::INFINITY)?;
                    out.impulses.push([amplitude, width_s, at_s, period]);
                }
            }
        }
        Ok(out)
    }

    /// Lines of random phase, `spacing` Hz apart; frequencies of a random input are dithered within
    /// their spacing where it is finer than a period, which a multisine's are not, being multiples
    /// of it.
    fn band(&mut self, rms: f64, from_hz: f64, to_hz: f64, spacing: f64, rng: &mut ChaCha8Rng) {
        let (first, last) = ((from_hz / spacing).ceil().max(1.0), (to_hz / spacing).floor());
        let count = (last - first + 1.0).max(1.0);
        let amplitude = rms * (2.0 / count).sqrt();
        // At most a few thousand lines: the cast is exact.
        for k in 0..count as u32 {
            let f = (first + f64::from(k)) * spacing;
            self.lines.push([amplitude, TAU * f, TAU * rng.random::<f64>()]);
        }
    }

    /// Its value at a time, s.
    pub fn value(&self, time: f64) -> f64 {
        let lines: f64 = self.lines.iter().map(|[a, w, p]| a * (w * time + p).sin()).sum();
        let impulses: f64 = self
            .impulses
            .iter()
            .map(|[a, width, at, period]| {
                let d = time - at;
                let d = if period.is_finite() { d - period * (d / period).round() } else { d };
                if d.abs() < 0.5 * width { a * (PI * d / width).cos().powi(2) } else { 0.0 }
            })
            .sum();
        self.constant + lines + impulses
    }

    /// Whether its evaluation takes many sines, so that it is better tabled.
    pub fn is_long(&self) -> bool {
        self.lines.len() > 20
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(toml: &str) -> Result<Signal> {
        #[derive(Deserialize)]
        struct File {
            x: Vec<Excitation>,
        }
        let file: File = toml::from_str(toml).map_err(|e| BadInput::new(e.message().to_owned(), ""))?;
        Signal::new(&file.x, 20.0, 100.0, 3, 0)
    }

    #[test]
    fn random_inputs_have_their_rms_and_impulses_their_shape() {
        let s = signal("x = [{ kind = \"random\", rms = 2.0, to_hz = 10.0 }]").unwrap();
        let mean: f64 = (0..4000).map(|i| s.value(f64::from(i) * 0.01).powi(2)).sum::<f64>() / 4000.0;
        assert!((mean.sqrt() / 2.0 - 1.0).abs() < 0.05, "{mean}");
        let s =
            signal("x = [{ kind = \"multisine\", rms = 1.0, from_hz = 1.0, to_hz = 5.0, period_s = 2.0 }]").unwrap();
        assert!((s.value(0.3) - s.value(2.3)).abs() < 1e-9 && s.lines.len() == 9);
        let s =
            signal("x = [{ kind = \"impulse\", amplitude = 3.0, width_s = 0.1, at_s = 1.0, period_s = 5.0 }]").unwrap();
        assert!((s.value(6.0) - 3.0).abs() < 1e-9 && s.value(6.06) == 0.0);
        assert!(signal("x = [{ kind = \"random\", rms = 2.0, to_hz = 80.0 }]").is_err());
        assert!(signal("x = [{ kind = \"wobble\" }]").is_err());
    }
}

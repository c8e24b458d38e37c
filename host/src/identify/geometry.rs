//! Windows and low-passes, from the settings, the rig and the coordinates' spectra.
//!
//! Under a drive windows of 20 T, test functions up to 2 f_e, the low-pass up to 1.15 times where
//! the signal sinks into the noise, a quarter of the sampling rate at most; when free all of it
//! from the motion ([`super::free_geometry`], up to 0.12 and 0.3 of the rate). Where no motion
//! stands above the noise there is nothing to choose by: windows of 4 s, test functions up to f_99,
//! a sixteenth of the rate at most, the low-pass as under a drive. A free system with measured
//! inputs may need more of the band, since a resonance may lie close to the Nyquist frequency: test
//! functions go up to a fifth of the rate and the pass band to two fifths.
//!
//! What is asked for may go farther than what is chosen: test functions up to an eighth of the rate
//! (a quarter with inputs), the pass band up to two fifths. A window has 32 samples at least. What
//! a free system's record is too short for is fitted to it ([`super::short_record`]).

use super::Settings;
use super::free_geometry::{Kind, choose, narrowest_hz, within_gaps};
use super::prepared::Geometry;
use super::short_record;
use super::windows::{Kernels, Windows};
use crate::error::{BadInput, Result};
use crate::rig::{Drive, Rig};
use crate::signal::band::Band;
use crate::signal::low_pass::Kernel;
use crate::signal::noise::Noise;
use crate::wording::format::shortest;
use crate::wording::limits;

/// Most frequencies of the test functions.
const MOST_FREQUENCIES: usize = 400;
/// Length of a window in periods of the drive.
pub(super) const DRIVE_PERIODS: f64 = 20.0;
/// Fewest samples of a window.
pub(super) const FEWEST_SAMPLES: f64 = 32.0;
/// End of the pass band over where the signal sinks into the noise, and over the highest test
/// frequency: products of the regressors must keep everything up to there.
pub(super) const PASS_OVER_END: f64 = 1.15;
pub(super) const PASS_OVER_TOP: f64 = 1.5;
/// Start of the stop band over the end of the pass band, width of the transition over the highest
/// test frequency, and the share of the sampling rate at which it starts at the latest.
const STOP_OVER_PASS: f64 = 1.5;
const TRANSITION_OVER_TOP: f64 = 2.5;
pub(super) const LATEST_STOP: f64 = 0.45;

/// Length of a window under a drive, s.
pub(super) fn drive_window_s(drive: Drive) -> f64 {
    DRIVE_PERIODS / drive.frequency_hz
}

/// Where the stop band begins, Hz, `narrowest` the least width of the transition.
fn stop_hz(pass: f64, top: f64, narrowest: f64, rate: f64) -> f64 {
    let wide = (STOP_OVER_PASS * pass).max(pass + TRANSITION_OVER_TOP * top).max(pass + narrowest);
    wide.min(LATEST_STOP * rate)
}

/// What windows and low-passes follow from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chosen {
    /// Sampling step, s.
    pub(super) step_s: f64,
    /// Length of a window, s.
    pub(super) length_s: f64,
    /// Highest test frequency, Hz.
    pub(super) top_hz: f64,
    /// End of the pass band, Hz.
    pub(super) pass_hz: f64,
    /// Where the motion stands clear of the noise, Hz.
    pub(super) clear_end_hz: f64,
    /// Most that a pass band is raised to for the test functions, Hz.
    pub(super) least_pass_hz: f64,
    /// Least width of the transition, Hz.
    pub(super) narrowest_hz: f64,
    /// Period of the drive or of the motion, s.
    pub(super) period_s: f64,
}

impl Chosen {
    /// Windows and low-passes.
    pub(super) fn geometry(&self) -> Geometry {
        let Self { step_s, length_s, top_hz: top, pass_hz: pass, narrowest_hz, period_s, .. } = *self;
        let frequencies = ((top * length_s).round() as usize).clamp(2, MOST_FREQUENCIES);
        let rate = 1.0 / step_s;
        let stop = stop_hz(pass, top, narrowest_hz, rate);
        let clear = self.clear_end_hz.max((PASS_OVER_TOP * top).min(self.least_pass_hz).min(pass)).min(pass);
        let kernels = Kernels {
            full: Kernel::design(step_s, pass, stop),
            clear: Kernel::design(step_s, clear, (clear + stop - pass).min(0.48 * rate)),
        };
        let windows = Windows { length_s, hop_s: 0.5 * length_s, frequencies };
        Geometry { windows, kernels, period_s }
    }
}

/// Chooses.
///
/// # Errors
/// A setting out of range.
pub fn geometry(
    rig: &Rig,
    settings: &Settings,
    noises: &[Option<Noise>],
    inputs: bool,
    step_s: f64,
    band: Option<Band>,
    stretches_s: &[f64],
) -> Result<Geometry> {
    let rate = 1.0 / step_s;
    let check = |option: &str, value: Option<f64>, low: f64, high: f64| {
        let Some(asked) = value else { return Ok(None) };
        limits::within(asked, low, high).map(Some).ok_or_else(|| {
            let unit = if option.ends_with("-hz") { "Hz" } else { "s" };
            let expected = format!("a value from {} {unit}", limits::range(low, high));
            BadInput::new(format!("{} {unit}", shortest(asked)), expected)
                .at(option.to_owned())
                .remedy("Give a value in that range, or leave the option out: it is then chosen by the record")
        })
    };
    let greatest = |f: fn(&Noise) -> f64| noises.iter().flatten().map(f).fold(0.0_f64, f64::max);
    let wide = inputs && rig.drive.is_none();
    let most_top = if wide { rate / 5.0 } else { rate / 16.0 };
    let wanted = greatest(|n| n.acceleration_99_hz);
    let default_window = match rig.drive {
        Some(d) => drive_window_s(d),
        None if inputs => (30.0 / wanted.max(1e-9 * rate).min(most_top)).min(4.0),
        None => 4.0,
    };
    let asked = check("--window-s", settings.window_s, FEWEST_SAMPLES * step_s, 1e5)?;
    let kind = if wide { Kind::WithInputs(wanted) } else { Kind::Free };
    let free = band.filter(|_| rig.drive.is_none()).map(|b| choose(&b, stretches_s, rate, asked, kind));
    let whole = || within_gaps(default_window.max(FEWEST_SAMPLES * step_s), stretches_s, rate);
    let length_s = asked.or(free.map(|f| f.length_s)).unwrap_or_else(whole);
    // Eight test functions at least; in a window too short for them, those that the rate allows.
    let free_top = wanted.min(most_top).max((8.0 / length_s).min(rate / if wide { 4.0 } else { 8.0 }));
    let top = check(
        "--max-frequency-hz",
        settings.max_frequency_hz,
        2.0 / length_s,
        if wide { rate / 4.0 } else { rate / 8.0 },
    )?
    .unwrap_or_else(|| rig.drive.map_or(free.map_or(free_top, |f| f.top_hz), |d| 2.0 * d.frequency_hz));
    let least_pass_hz = if wide { 0.3 } else { 0.15 } * rate;
    let least = (PASS_OVER_TOP * top).min(least_pass_hz);
    let default_pass = match free {
        Some(f) => f.pass_hz.max(PASS_OVER_TOP * top).min(kind.most()[1] * rate),
        None => (PASS_OVER_END * greatest(|n| n.signal_end_hz)).max(least).min(if wide { 0.4 } else { 0.25 } * rate),
    };
    let pass = check("--pass-hz", settings.pass_hz, 1.0 / length_s, 0.4 * rate)?.unwrap_or(default_pass);
    let dominant_s = band.map_or(length_s / DRIVE_PERIODS, |b| 1.0 / b.dominant_hz);
    let period_s = rig.drive.map_or(dominant_s, |d| 1.0 / d.frequency_hz);
    let chosen = Chosen {
        step_s,
        length_s,
        top_hz: top,
        pass_hz: pass,
        clear_end_hz: greatest(|n| n.clear_end_hz),
        least_pass_hz,
        narrowest_hz: free.map_or(0.0, |_| narrowest_hz(stretches_s)),
        period_s,
    };
    // Windows under a drive are whole numbers of its periods.
    if rig.drive.is_some() {
        return Ok(chosen.geometry());
    }
    let fitted = short_record::fitted(&chosen, settings, stretches_s);
    // What stands for a period goes with the window.
    let period_s = band.map_or(fitted.windows.length_s / DRIVE_PERIODS, |_| period_s);
    Ok(Geometry { period_s, ..fitted })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn short_windows_and_low_rates_have_a_geometry_or_are_refused() {
        let mut rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/single-pendulum.toml")).unwrap();
        rig.drive = None;
        for rate in [2.0, 20.0, 64.0, 100.0, 1e4] {
            rig.sample_rate_hz = rate;
            for busy in [0.0, 0.3 * rate, f64::NAN] {
                let noise = Noise {
                    sigma: 1e-3,
                    square_error: 0.1,
                    signal_end_hz: busy,
                    clear_end_hz: busy,
                    acceleration_99_hz: busy,
                };
                for window_s in [None, Some(0.5), Some(1.0), Some(3.0)] {
                    let settings = Settings { window_s, ..Settings::default() };
                    match geometry(&rig, &settings, &[Some(noise), None], false, 1.0 / rate, None, &[]) {
                        Ok(Geometry { windows, kernels, .. }) => {
                            assert!(windows.frequencies >= 2 && windows.length_s >= 32.0 / rate, "{rate} {window_s:?}");
                            assert!(
                                windows.frequencies as f64 / windows.length_s <= 0.15 * rate,
                                "{rate} {window_s:?}"
                            );
                            assert!(kernels.full.stop_hz <= 0.45 * rate + 1e-9, "{rate} {window_s:?}");
                        }
                        Err(e) => {
                            assert!(window_s.unwrap() < 32.0 / rate && e.to_string().contains("--window-s"), "{e}")
                        }
                    }
                }
            }
        }
    }
}

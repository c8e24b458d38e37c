//! Settings that a plan looks at: a grid of drive frequencies, Hz, and amplitudes (factors on the
//! model's, or m) within the limits on both and on the base's acceleration (2π f)² a, m/s²; poses
//! of a free system, rad or m.

use super::Task;
use crate::error::{BadInput, Result};
use crate::model::identified::IdentifiedModel;
use crate::plan::Setting;
use crate::rig::Rig;
use crate::system::library::Pendulum;

/// Frequencies and amplitudes of the map (by hand).
const GRID: [usize; 2] = [8, 6];
/// Where nothing else is said: frequencies and amplitudes beside those of the model, and
/// acceleration (by hand).
const AROUND: [[f64; 2]; 2] = [[0.6, 1.6], [0.5, 1.6]];
const HARDER: f64 = 1.6;
/// Steps of frequencies, Hz, and amplitudes, m, in which a plan is written (by hand).
const FREQUENCY_STEP_HZ: f64 = 0.01;
const AMPLITUDE_STEP_M: f64 = 1e-5;
/// Poses from which a free system is let go, as angles (by hand).
const POSE_GRID: [f64; 6] = [0.6, 1.2, 1.8, 2.4, 2.8, -2.0];

/// The base's amplitude, m: the rig file's, or as identified.
pub(super) fn amplitude_m(rig: &Rig, model: &IdentifiedModel) -> Option<f64> {
    let drive = rig.drive?;
    let value = |n: &str| model.parameter(n).map(|p| p.value);
    let found = || Some(model.found_with.get("a_c")?.hypot(*model.found_with.get("a_s")?));
    let identified = || {
        // a = B_23 l, with l = B_22 Ω²/g the second arm's lever over its inertia.
        let built_in = model.system.pendulum() == Some(Pendulum::Double);
        let lever = value("B22")? * rig.omega().powi(2) / rig.known.get("g").copied().unwrap_or(crate::rig::GRAVITY);
        built_in.then_some(value("B23")?.hypot(value("B24")?) / lever.abs())
    };
    drive.amplitude_m.or_else(found).or_else(identified).filter(|a| a.is_finite() && *a > 0.0)
}

impl Task<'_> {
    fn setting(&self, frequency_hz: f64, amplitude_factor: f64) -> Setting {
        Setting {
            frequency_hz: Some(frequency_hz),
            amplitude_factor: Some(amplitude_factor),
            amplitude_m: self.amplitude_m.map(|a| a * amplitude_factor),
            pose: None,
        }
    }

    /// The same in steps that a device takes and a person reads, inside the limits.
    fn rounded(&self, frequency_hz: f64, amplitude_factor: f64) -> Setting {
        let down = |x: f64, step: f64| (x / step + 1e-6).floor() * step;
        let frequency_hz = (1e3 * down(frequency_hz, FREQUENCY_STEP_HZ)).round() / 1e3;
        match self.amplitude_m {
            Some(a) => {
                let step = AMPLITUDE_STEP_M.min(0.01 * a * amplitude_factor);
                let in_m = down(a * amplitude_factor, step);
                Setting { amplitude_m: Some(in_m), ..self.setting(frequency_hz, in_m / a) }
            }
            None => self.setting(frequency_hz, amplitude_factor),
        }
    }

    /// The setting of the model.
    pub fn unchanged(&self) -> Setting {
        self.rig.drive.map_or_else(Setting::default, |d| self.setting(d.frequency_hz, 1.0))
    }

    /// Settings of the drive within the limits.
    ///
    /// # Errors
    /// Limits in m where the model's amplitude is not known.
    pub fn grid(&self) -> Result<Vec<Setting>> {
        let Some(drive) = self.rig.drive else { return Ok(Vec::new()) };
        let limits = &self.settings.limits;
        let around = |x: f64, [low, high]: [f64; 2]| [low * x, high * x];
        let frequencies = limits.frequency_hz.unwrap_or_else(|| around(drive.frequency_hz, AROUND[0]));
        let amplitudes = match (limits.amplitude_m, self.amplitude_m, limits.amplitude_factor) {
            (Some([low, high]), Some(a), _) => [low / a, high / a],
            (Some(_), None, _) => {
                return Err(BadInput::new(
                    "amplitude_m, where the amplitude of the model is not known",
                    "amplitude_factor",
                )
                .at("--limits")
                .remedy("Give amplitude_factor in the limits file, or amplitude_m in the rig file's [drive]"));
            }
            (None, _, factor) => factor.unwrap_or(AROUND[1]),
        };
        // What the shaker does now and a little more, unless something is said.
        let now = drive.frequency_hz.powi(2);
        let most = match (limits.acceleration_m_s2, self.amplitude_m) {
            (Some(most), Some(a)) => most / (a * core::f64::consts::TAU.powi(2) * now),
            (Some(_), None) => {
                return Err(BadInput::new(
                    "acceleration_m_s2, where the amplitude of the model is not known",
                    "amplitude_factor",
                )
                .at("--limits")
                .remedy("Give amplitude_m in the rig file's [drive]"));
            }
            _ => HARDER,
        };
        let hard = |f: f64, a: f64| a * f * f / now;
        let mut out = Vec::new();
        for f in spaced(frequencies, GRID[0]) {
            let within = spaced(amplitudes, GRID[1]).into_iter().filter(|a| hard(f, *a) <= most * (1.0 + 1e-9));
            out.extend(within.map(|a| self.rounded(f, a)));
        }
        Ok(out)
    }

    /// Poses of a free system, spread over all of its coordinates.
    ///
    /// # Errors
    /// A model of another rig.
    pub fn poses(&self) -> Result<Vec<Setting>> {
        let own = self.at(&Setting::default())?;
        let Some(bound) = own.rig.bound.as_deref() else { return Ok(Vec::new()) };
        let circle = bound.model.circle();
        let of = |k: usize, i: usize| {
            let x = POSE_GRID[(k / POSE_GRID.len().pow(i as u32)) % POSE_GRID.len()];
            if circle[i] { x } else { 0.1 * x }
        };
        let count = POSE_GRID.len().pow(circle.len().min(3) as u32);
        let all = (0..count).map(|k| (0..circle.len()).map(|i| of(k, i)).collect());
        Ok(all.map(|pose| Setting { pose: Some(pose), ..Setting::default() }).collect())
    }
}

/// Evenly spaced numbers.
fn spaced([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    let step = if count > 1 { (high - low) / (count - 1) as f64 } else { 0.0 };
    (0..count).map(|k| low + k as f64 * step).collect()
}

//! What an explanation of a model file tells: units, horizon, parameters, values of effects.

use super::Setting;
use super::candidates::Candidate;
use super::fit::Held;
use super::round::Round;
use crate::effects::written::balance_scale;
use crate::error::{BadInput, Result};
use crate::explain::Settings;
use crate::explain::explanation::{Explanation, Found, InUnit};
use crate::identify::Parameter;
use crate::identify::general;
use crate::identify::general::stretches::Stretch;
use crate::model::model_file::units;
use crate::rig::Rig;
use crate::rig::measures::Bound;

/// Horizon of the gap.
pub fn horizon(rig: &Rig, settings: &Settings, stretches: &[Stretch]) -> Result<f64> {
    let default = rig.drive.map_or(0.2, |d| 1.0 / d.frequency_hz);
    let step = 1.0 / rig.sample_rate_hz;
    let longest = stretches.iter().map(|s| s.len() as f64 * s.step_s).fold(0.0, f64::max);
    match settings.horizon_s {
        Some(h) if !(h >= 8.0 * step && h <= longest) => {
            Err(BadInput::new(h.to_string(), format!("seconds from {} to {longest}", 8.0 * step)).at("--horizon"))
        }
        h => Ok(h.unwrap_or(default).max(8.0 * step)),
    }
}

/// Rms velocity of each coordinate, by differences over five samples.
pub fn speeds(stretches: &[Stretch]) -> Vec<f64> {
    let n = stretches.first().map_or(0, |s| s.coordinates.len());
    (0..n)
        .map(|k| {
            let (mut sum, mut count) = (0.0, 0.0);
            for s in stretches {
                for w in s.coordinates[k].windows(6).step_by(5) {
                    sum += ((w[5] - w[0]) / (5.0 * s.step_s)).powi(2);
                    count += 1.0;
                }
            }
            (sum / f64::max(count, 1.0)).sqrt().max(f64::MIN_POSITIVE)
        })
        .collect()
}

/// SI unit of a coordinate.
fn si_unit(rig: &Rig, bound: &Bound, coordinate: usize) -> String {
    let row = (0..bound.sensors.len()).find(|&r| bound.shown[(r, coordinate)] != 0.0).unwrap_or(0);
    match rig.channel[bound.sensors[row]].unit.as_str() {
        "count" | "deg" => "rad",
        "mm" | "um" => "m",
        "mV" => "V",
        other => other,
    }
    .to_owned()
}

/// Whether each coordinate is a length or an angle.
pub fn moves(rig: &Rig, bound: &Bound) -> Vec<bool> {
    (0..bound.model.coordinates.len()).map(|k| matches!(si_unit(rig, bound, k).as_str(), "rad" | "m")).collect()
}

/// The unit in which simulation errors are told: degrees where everything is an angle.
pub struct Unit {
    /// Its name.
    pub name: String,
    /// How many of it an SI unit is.
    pub factor: f64,
}

impl Unit {
    /// For a rig.
    pub fn of(rig: &Rig, bound: &Bound) -> Self {
        let units: Vec<String> = (0..bound.model.coordinates.len()).map(|k| si_unit(rig, bound, k)).collect();
        match units.first() {
            Some(first) if units.iter().all(|u| u == first) => {
                let degrees = first == "rad";
                Self {
                    name: if degrees { "deg".to_owned() } else { first.clone() },
                    factor: if degrees { 180.0 / core::f64::consts::PI } else { 1.0 },
                }
            }
            _ => Self { name: "SI".to_owned(), factor: 1.0 },
        }
    }
}

impl Unit {
    /// One noise floor, the rms noise of the sensors; none where they have no unit in common.
    pub fn noise(&self, sigma: &[f64]) -> Option<InUnit> {
        let rms = (sigma.iter().map(|s| s * s).sum::<f64>() / sigma.len() as f64).sqrt() * self.factor;
        let unit = if self.name == "deg" { "°".to_owned() } else { self.name.clone() };
        (self.name != "SI" && rms.is_finite() && rms > 0.0).then_some(InUnit { value: rms, unit })
    }
}

/// The model's own coefficients with what was chosen.
pub fn read_parameters(setting: &Setting<'_>, round: &Round, chosen: &[Candidate], result: &mut Explanation) {
    let model = &*setting.bound.model;
    let units = setting.split.units(&general::units_of(model, setting.rig, setting.bound));
    let names = setting.split.names();
    result.parameters.clear();
    for group in &round.groups {
        for (i, name) in group.names.iter().enumerate() {
            if !result.parameters.iter().any(|p| p.name == *name) {
                result.parameters.push(Parameter {
                    name: name.clone(),
                    value: group.own.fit.all[i],
                    std_error: group.own.fit.covariance[(i, i)].max(0.0).sqrt(),
                    unit: names.iter().position(|n| n == name).map_or_else(String::new, |i| units[i].clone()),
                });
            }
        }
    }
    let mut behind: Vec<usize> = round.groups.iter().map(|g| g.names.len()).collect();
    // What a given model brought stands before what was found.
    let given = chosen.len() - result.effects.len();
    for (k, c) in chosen.iter().enumerate() {
        let g = round.group_of(c);
        let from = behind[g];
        behind[g] += c.columns.len();
        if let Some(found) = k.checked_sub(given).and_then(|k| result.effects.get_mut(k)) {
            put_value(c, &round.groups[g].own, from, scale_of(setting, c), found);
        }
    }
}

/// Value, standard error and parameters of an effect whose strengths stand at `from`; `scale`: see [`scale_of`].
pub fn put_value(c: &Candidate, held: &Held, from: usize, scale: f64, found: &mut Found) {
    let fit = &held.fit;
    let k: Vec<f64> = (0..c.columns.len()).map(|i| fit.all[from + i]).collect();
    let error = |i: usize| fit.covariance[(from + i, from + i)].max(0.0).sqrt();
    found.parameters = c.shape.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect();
    (found.value, found.std_error) = match k[..] {
        [s, o] => {
            found.parameters.insert("psi".to_owned(), o.atan2(s));
            let size = s.hypot(o);
            let spread = if size > 0.0 { ((s * error(0)).hypot(o * error(1))) / size } else { error(0) };
            (size, spread)
        }
        _ => (k[0], error(0)),
    };
    (found.value, found.std_error) = (scale * found.value, scale.abs() * found.std_error);
    found.strengths = k;
}

/// What turns the strength of an effect into the unit that it is told in. Its column is in seconds; an equation whose primes are derivatives by the
/// drive's phase is 1/Ω² (or 1/Ω) of one in seconds.
pub fn scale_of(setting: &Setting<'_>, c: &Candidate) -> f64 {
    let model = &*setting.bound.model;
    balance_scale(model, setting.rig.omega(), c.equation)
}

/// Unit of an effect's strength.
pub fn unit_of(setting: &Setting<'_>, c: &Candidate) -> String {
    let model = &*setting.bound.model;
    let (coordinates, inputs) = general::channel_units(model, setting.rig, setting.bound);
    let balance = model.in_seconds(&model.equations[c.equation].balance, setting.rig.omega());
    units::coefficient(&balance, &c.columns[0], &coordinates, &inputs, true)
}

//! `[plant]` of a rig file: the truth of a simulated rig. Read by `simulate` and `demo` alone.

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::Rig;
use crate::error::{BadInput, Result};
use crate::wording::toml_words;

/// Parameters of the simulated double pendulum, SI. `e1` and `m1` enter as their product and in
/// J_o1 only.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// Mass of arm 1, kg.
    pub m1: f64,
    /// Joint 1 to the centroid of arm 1, m.
    pub e1: f64,
    /// Joint 1 to joint 2, m.
    pub l1: f64,
    /// Mass of arm 2, kg.
    pub m2: f64,
    /// Joint 2 to the centroid of arm 2, m.
    pub e2: f64,
    /// Moment of inertia J_o1 = J_c1 + m1 e1² + m2 l1², kg m².
    #[serde(rename = "J_o1")]
    pub j_o1: f64,
    /// Moment of inertia J_o2 = J_c2 + m2 e2², kg m².
    #[serde(rename = "J_o2")]
    pub j_o2: f64,
    /// Coulomb friction torque of joint 1, N m.
    #[serde(default)]
    pub tau_c1: f64,
    /// Viscous friction of joint 2, N m s.
    #[serde(default)]
    pub c_r2: f64,
    /// Gravity, m/s².
    #[serde(default = "gravity")]
    pub g: f64,
    /// Amplitude of the base, m.
    #[serde(default)]
    pub amplitude_m: f64,
    /// What the base does of the amplitude that a simulated device commands.
    #[serde(default = "one")]
    pub shaker_gain: f64,
    /// Phase ψ of the base: y = a cos(τ − ψ), rad.
    #[serde(default)]
    pub phase_rad: f64,
    /// φ1, φ2 (rad), φ̇1, φ̇2 (rad/s) at the start.
    #[serde(default)]
    pub initial: [f64; 4],
    /// Time simulated before recording starts, s.
    #[serde(default)]
    pub settle_s: f64,
    /// The sensor of the base's motion, for a rig with a channel that measures it.
    #[serde(default)]
    pub base: BasePlant,
}

fn gravity() -> f64 {
    super::GRAVITY
}

/// What the simulated sensor of the base's motion is like, in the unit m or m/s² of its channel.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BasePlant {
    /// What it shows of 1.
    #[serde(default = "one")]
    pub gain: f64,
    /// What it shows at 0.
    #[serde(default)]
    pub offset: f64,
    /// Standard deviation of its noise.
    #[serde(default)]
    pub noise: f64,
}

impl Default for BasePlant {
    /// A sensor without errors.
    fn default() -> Self {
        Self { gain: 1.0, offset: 0.0, noise: 0.0 }
    }
}

fn one() -> f64 {
    1.0
}

impl BasePlant {
    /// Refuses what no sensor is.
    pub(super) fn check(&self, rig: &Rig) -> Result<()> {
        for (key, value, good) in [
            ("gain", self.gain, self.gain != 0.0),
            ("offset", self.offset, true),
            ("noise", self.noise, self.noise >= 0.0),
        ] {
            if !(good && value.abs() <= 1e6) {
                return Err(BadInput::new(
                    value.to_string(),
                    "a finite number, a gain other than 0, a noise of 0 or more",
                )
                .in_file(&rig.path)
                .at(format!("plant.base.{key}")));
            }
        }
        Ok(())
    }
}

/// Reads `[plant]` from a rig's text; `example` is a rig file that has one.
///
/// # Errors
/// No table, or one with other keys or kinds of values.
pub(super) fn table<T: DeserializeOwned>(rig: &Rig, example: &str) -> Result<T> {
    #[derive(Deserialize)]
    struct File<T> {
        plant: Option<T>,
    }
    // As a part of the file, so that a wrong value is told with its line.
    let file: File<T> = toml::from_str(&rig.text).map_err(|e| {
        let told = toml_words::told(&e, &rig.text, "[plant]", "docs/rig-file.md");
        let place = format!("[plant], {}", told.place.as_deref().unwrap_or_default());
        BadInput { place: Some(place), ..told }.in_file(&rig.path)
    })?;
    file.plant.ok_or_else(|| {
        BadInput::new("no [plant]", "the simulated rig's parameters")
            .in_file(&rig.path)
            .at("[plant]")
            .remedy(format!("Add a [plant] table, or use {example}"))
    })
}

/// Refuses quantities that are not above 0.
///
/// # Errors
/// The first of them.
pub(super) fn positive(rig: &Rig, quantities: &[(&str, f64)]) -> Result<()> {
    match quantities.iter().find(|(_, x)| !super::QUANTITIES.contains(x)) {
        Some((key, x)) => Err(out_of_range(rig, key, *x, "a value above 0 (1e-30 to 1e30)")),
        None => Ok(()),
    }
}

/// Refuses quantities below 0.
///
/// # Errors
/// The first of them.
pub(super) fn not_negative(rig: &Rig, quantities: &[(&str, f64)]) -> Result<()> {
    match quantities.iter().find(|(_, x)| *x != 0.0 && !super::QUANTITIES.contains(x)) {
        Some((key, x)) => Err(out_of_range(rig, key, *x, "a value of 0 or more (1e-30 to 1e30)")),
        None => Ok(()),
    }
}

pub(super) fn out_of_range(rig: &Rig, key: &str, value: f64, expected: &str) -> BadInput {
    BadInput::new(value.to_string(), expected).in_file(&rig.path).at(format!("plant.{key}"))
}

impl Plant {
    /// True value of a parameter that an identification names (coefficients of (3.4) at angular
    /// frequency `omega`, and physical parameters); `None` for a name that the plant does not have.
    /// Only for the truth beside an answer that is already there.
    pub fn truth(&self, name: &str, omega: f64) -> Option<f64> {
        let p = self;
        let (h, s1, s2) = (p.m2 * p.e2 * p.l1, p.m1 * p.e1 + p.m2 * p.l1, p.m2 * p.e2);
        let (cos, sin) = (p.phase_rad.cos(), p.phase_rad.sin());
        let second = omega * omega;
        Some(match name {
            "B11" => h / p.j_o1,
            "B12" => p.g * s1 / (p.j_o1 * second),
            "B13" => -p.amplitude_m * s1 / p.j_o1 * cos,
            "B14" => -p.amplitude_m * s1 / p.j_o1 * sin,
            "B15" => p.amplitude_m * s1 / p.j_o1,
            "B21" => h / p.j_o2,
            "B22" => p.g * s2 / (p.j_o2 * second),
            "B23" => -p.amplitude_m * s2 / p.j_o2 * cos,
            "B24" => -p.amplitude_m * s2 / p.j_o2 * sin,
            "B25" => p.amplitude_m * s2 / p.j_o2,
            "B16" => s1 / (p.base.gain * p.j_o1 * second),
            "B26" => s2 / (p.base.gain * p.j_o2 * second),
            "base_gain" => p.base.gain,
            "C11" => p.tau_c1 / (p.j_o1 * second),
            "C12" => p.c_r2 / (p.j_o1 * omega),
            "C2" => p.c_r2 / (p.j_o2 * omega),
            "J_o1" => p.j_o1,
            "J_o2" => p.j_o2,
            "m1e1" => p.m1 * p.e1,
            "l1" => p.l1,
            "m2" => p.m2,
            "e2" => p.e2,
            "g" => p.g,
            "a" => p.amplitude_m,
            "psi" => p.phase_rad,
            "coulomb-friction@joint1" => p.tau_c1,
            "viscous-friction@joint2" => p.c_r2,
            "tau_c1" => p.tau_c1,
            "c_r2" => p.c_r2,
            _ => return None,
        })
    }

    /// Reads `[plant]` from a rig's text.
    ///
    /// # Errors
    /// Names the key, the value found and the one expected.
    pub fn of(rig: &Rig) -> Result<Self> {
        let plant: Self = table(rig, "rigs/chaotic.toml")?;
        let p = &plant;
        positive(rig, &[("m1", p.m1), ("l1", p.l1), ("m2", p.m2), ("J_o1", p.j_o1), ("J_o2", p.j_o2)])?;
        let others = [
            ("e1", p.e1),
            ("e2", p.e2),
            ("tau_c1", p.tau_c1),
            ("c_r2", p.c_r2),
            ("amplitude_m", p.amplitude_m),
            ("shaker_gain", p.shaker_gain),
            ("settle_s", p.settle_s),
            ("g", p.g),
        ];
        not_negative(rig, &others)?;
        plant.base.check(rig)?;
        let h = plant.m2 * plant.e2 * plant.l1;
        if h * h >= plant.j_o1 * plant.j_o2 {
            return Err(BadInput::new(
                format!("J_o1·J_o2 = {:e}", plant.j_o1 * plant.j_o2),
                format!("more than (m2 e2 l1)² = {:e}", h * h),
            )
            .in_file(&rig.path)
            .at("[plant]")
            .remedy("These masses and moments of inertia cannot belong to two rigid arms"));
        }
        if plant.initial.iter().any(|x| !x.is_finite()) || !plant.phase_rad.is_finite() {
            return Err(BadInput::new("a value that is not finite", "finite numbers")
                .in_file(&rig.path)
                .at("plant.initial or plant.phase_rad"));
        }
        if plant.settle_s > 3600.0 {
            return Err(out_of_range(rig, "settle_s", plant.settle_s, "at most 3600 s"));
        }
        Ok(plant)
    }
}

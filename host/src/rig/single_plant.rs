//! `[plant]` of a rig with a single pendulum: the truth of a simulated rig. Read by `simulate`
//! alone.

use serde::Deserialize;

use super::plant::{BasePlant, not_negative, out_of_range, positive, table};
use super::{Direction, Rig};
use crate::error::Result;

/// Parameters of the simulated single pendulum, SI. `e1` and `m1` enter as their product.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SinglePlant {
    /// Mass, kg.
    pub m1: f64,
    /// Joint to centroid, m.
    pub e1: f64,
    /// Moment of inertia about the joint, kg m².
    #[serde(rename = "J_o1")]
    pub j_o1: f64,
    /// Viscous friction of the joint, N m s.
    #[serde(default)]
    pub c_r1: f64,
    /// Coulomb friction torque of the joint, N m.
    #[serde(default)]
    pub tau_c1: f64,
    /// Gravity, m/s².
    #[serde(default = "gravity")]
    pub g: f64,
    /// Amplitude of the base, m.
    #[serde(default)]
    pub amplitude_m: f64,
    /// Lag ψ of the base, rad.
    #[serde(default)]
    pub phase_rad: f64,
    /// θ (rad), θ̇ (rad/s) at the start.
    #[serde(default)]
    pub initial: [f64; 2],
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

impl SinglePlant {
    /// True value of a parameter that an identification names, at angular frequency `omega` and
    /// this direction of the drive. Only for the truth beside an answer that is already there.
    pub fn truth(&self, name: &str, omega: f64, direction: Option<Direction>) -> Option<f64> {
        let moment = self.m1 * self.e1 / self.j_o1;
        let size = moment * self.amplitude_m;
        // Horizontal: x_b = a sin(τ − ψ), term −f sin(τ − ψ) cos θ. Vertical: y = a cos(τ − ψ),
        // term −f cos(τ − ψ) sin θ.
        let (cos, sin) = (self.phase_rad.cos(), self.phase_rad.sin());
        let along = |name: &'static str, wanted: Direction, value: f64| match direction {
            None => (name, None),
            Some(d) => (name, Some(if d == wanted { value } else { 0.0 })),
        };
        let table = [
            ("c_r", Some(self.c_r1 / (self.j_o1 * omega))),
            ("C11", Some(self.tau_c1 / (self.j_o1 * omega * omega))),
            ("q_cos", Some(0.0)),
            ("q_sin", Some(moment * self.g / (omega * omega))),
            along("p_cos", Direction::Horizontal, -size * cos),
            along("n_cos", Direction::Horizontal, size * sin),
            along("p_sin", Direction::Vertical, -size * sin),
            along("n_sin", Direction::Vertical, -size * cos),
            ("u_sin", Some(moment / (self.base.gain * omega * omega))),
            ("u_cos", Some(moment / (self.base.gain * omega * omega))),
            ("base_gain", Some(self.base.gain)),
            ("J_o1", Some(self.j_o1)),
            ("m1e1", Some(self.m1 * self.e1)),
            ("a", Some(self.amplitude_m)),
            ("c_r1", Some(self.c_r1)),
            ("tau_c1", Some(self.tau_c1)),
        ];
        table.iter().find(|(n, _)| *n == name).and_then(|(_, v)| *v)
    }

    /// Reads `[plant]` from a rig's text.
    ///
    /// # Errors
    /// Names the key, the value found and the one expected.
    pub fn of(rig: &Rig) -> Result<Self> {
        let plant: Self = table(rig, "rigs/single-pendulum.toml")?;
        plant.base.check(rig)?;
        let p = &plant;
        positive(rig, &[("m1", p.m1), ("J_o1", p.j_o1)])?;
        let others = [("e1", p.e1), ("c_r1", p.c_r1), ("tau_c1", p.tau_c1), ("g", p.g), ("amplitude_m", p.amplitude_m)];
        not_negative(rig, &others)?;
        if !(0.0..=3600.0).contains(&p.settle_s) {
            return Err(out_of_range(rig, "settle_s", p.settle_s, "0 to 3600 s"));
        }
        if let Some(x) = p.initial.into_iter().chain([p.phase_rad]).find(|x| !x.is_finite()) {
            return Err(out_of_range(rig, "initial or phase_rad", x, "finite numbers"));
        }
        Ok(plant)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn the_shipped_rig_is_the_seeds_pendulum() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/single-pendulum.toml")).unwrap();
        let plant = SinglePlant::of(&rig).unwrap();
        let truth = |n: &str| plant.truth(n, rig.omega(), rig.drive.map(|d| d.direction)).unwrap();
        for (name, want) in [("c_r", 0.036), ("q_sin", 1.44), ("p_cos", -1.52)] {
            assert!((truth(name) / want - 1.0).abs() < 1e-4, "{name} {}", truth(name));
        }
        assert_eq!(truth("n_sin"), 0.0);
        let (head, plant) = rig.text.split_once("[plant]").unwrap();
        let text = format!("{head}[plant]{}", plant.replacen("m1 = 0.1", "m1 = -0.1", 1));
        let broken = Rig::parse(&text, Path::new("x.toml")).unwrap();
        assert!(SinglePlant::of(&broken).unwrap_err().to_string().contains("plant.m1"));
    }
}

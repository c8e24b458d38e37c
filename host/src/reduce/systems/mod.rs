//! Conservative systems whose equations are known: the full models that reduced ones are compared
//! with.
//!
//! Each is written from its mass matrix and potential, apart from the simulator's plants. A new
//! one: one file and one line in [`SYSTEMS`].

pub mod beam;
pub mod chain;
pub mod mass_pendulum;
pub mod two_mass;

/// A conservative system: ½ ẋᵀM(x)ẋ + V(x), rest at x = 0.
pub trait Mechanical: Send + Sync {
    /// Names of the coordinates, as a rig file's `measures`.
    fn coordinates(&self) -> Vec<String>;

    /// M(x), row by row, n × n.
    fn mass(&self, x: &[f64]) -> Vec<f64>;

    /// V(x), zero at rest.
    fn potential(&self, x: &[f64]) -> f64;

    /// ∂V/∂x.
    fn gradient(&self, x: &[f64]) -> Vec<f64>;

    /// ẍ of the free motion.
    fn acceleration(&self, x: &[f64], v: &[f64], out: &mut [f64]);

    /// Whether M does not depend on x: then the free acceleration does not depend on the
    /// velocities.
    fn constant_mass(&self) -> bool {
        false
    }

    /// Number of coordinates.
    fn size(&self) -> usize {
        self.coordinates().len()
    }

    /// Kinetic plus potential energy.
    fn energy(&self, x: &[f64], v: &[f64]) -> f64 {
        let (m, n) = (self.mass(x), x.len());
        let kinetic: f64 = (0..n).map(|i| (0..n).map(|j| v[i] * m[i * n + j] * v[j]).sum::<f64>()).sum();
        0.5 * kinetic + self.potential(x)
    }
}

/// A system that can be chosen by a rig file's `model`.
pub struct SystemKind {
    /// Its id.
    pub id: &'static str,
    /// What it is, with its equations.
    pub about: &'static str,
    /// Makes it.
    pub make: fn() -> Box<dyn Mechanical>,
    /// The same as a system file, its numbers as parameters: to copy and change.
    pub file: fn() -> String,
}

/// The systems by name.
pub static SYSTEMS: &[SystemKind] = &[two_mass::KIND, mass_pendulum::KIND, chain::KIND, beam::KIND];

/// The shipped system file of a name.
fn shipped(name: &str) -> String {
    crate::system::library::text(name).unwrap_or_default().to_owned()
}

/// The system with this id.
pub fn by_id(id: &str) -> Option<Box<dyn Mechanical>> {
    SYSTEMS.iter().find(|s| s.id == id).map(|s| (s.make)())
}

#[cfg(test)]
pub(crate) mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::model_file::toml_place::Source;

    #[test]
    fn each_has_a_system_file_of_its_coordinates() {
        for kind in SYSTEMS {
            let source = Source { text: (kind.file)(), path: Path::new("s.toml").to_path_buf() };
            let model = crate::system::model_of(source, None, 1.0).unwrap_or_else(|e| panic!("{}: {e}", kind.id));
            let names: Vec<String> = model.coordinates.iter().map(|c| c.name.clone()).collect();
            assert_eq!(names, (kind.make)().coordinates(), "{}", kind.id);
        }
    }

    /// The acceleration satisfies the Lagrangian's own equation, by differences of the energy along
    /// the motion, and the gradient is the potential's.
    #[test]
    fn accelerations_and_gradients_follow_from_energy() {
        for kind in SYSTEMS {
            let system = (kind.make)();
            let n = system.size();
            let x: Vec<f64> = (0..n).map(|i| 0.3 + 0.2 * (i as f64 * 1.3).sin()).collect();
            let v: Vec<f64> = (0..n).map(|i| 0.5 * (i as f64 * 0.9).cos()).collect();
            let mut a = vec![0.0; n];
            system.acceleration(&x, &v, &mut a);
            let h = 1e-6;
            let moved = |sign: f64| {
                let q: Vec<f64> = (0..n).map(|i| x[i] + sign * h * v[i]).collect();
                let w: Vec<f64> = (0..n).map(|i| v[i] + sign * h * a[i]).collect();
                system.energy(&q, &w)
            };
            let size = system.energy(&x, &v).abs();
            assert!(((moved(1.0) - moved(-1.0)) / (2.0 * h)).abs() < 1e-6 * size, "{}", kind.id);
            let g = system.gradient(&x);
            for i in 0..n {
                let (mut up, mut down) = (x.clone(), x.clone());
                up[i] += h;
                down[i] -= h;
                let slope = (system.potential(&up) - system.potential(&down)) / (2.0 * h);
                assert!(
                    (slope - g[i]).abs() < 1e-6 * (1.0 + g.iter().fold(0.0_f64, |m, v| m.max(v.abs()))),
                    "{}",
                    kind.id
                );
            }
        }
    }
}

//! Two masses on springs, the first with a hardening spring to the ground (the seed's (5.9)):
//! x1″ = −2x1 + x2 − x1³, x2″ = x1 − 2x2. Dimensionless: both masses and all linear springs are 1.

use crate::plant_oscillator::Oscillator;

/// The five releases from rest of the seed's section 5.3.2, (x1, x2).
pub const RELEASES: [[f64; 2]; 5] = [[1.0, 1.3833], [1.5, 2.9250], [1.75, 4.0365], [2.0, 5.4667], [3.0, 17.0]];

/// The plant. States x1, x2, x1′, x2′.
#[derive(Clone, Copy, Debug, Default)]
pub struct TwoMass;

impl Oscillator<4> for TwoMass {
    fn rate(&self, _t: f64, y: &[f64; 4]) -> [f64; 4] {
        let [x1, x2, v1, v2] = *y;
        // Spring to the ground with its cubic part, spring between the masses, spring to the other
        // wall.
        let ground = x1 + x1 * x1 * x1;
        let between = x2 - x1;
        [v1, v2, between - ground, -between - x2]
    }

    fn energy(&self, y: &[f64; 4]) -> f64 {
        let [x1, x2, v1, v2] = *y;
        let stretch = x2 - x1;
        0.5 * (v1 * v1 + v2 * v2 + x1 * x1 + stretch * stretch + x2 * x2) + 0.25 * x1.powi(4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant_oscillator::record;

    #[test]
    fn keeps_its_energy_and_the_in_phase_mode_of_small_motion() {
        let plant = TwoMass;
        let states = record(&plant, [3.0, 17.0, 0.0, 0.0], 0.1, 2000).unwrap();
        let start = plant.energy(&states[0]);
        assert!(states.iter().all(|s| (plant.energy(s) / start - 1.0).abs() < 1e-8));
        // Both masses alike swing at 1 rad/s when the motion is small.
        let small = record(&plant, [1e-4, 1e-4, 0.0, 0.0], 0.05, 200).unwrap();
        for (i, s) in small.iter().enumerate() {
            let want = 1e-4 * (0.05 * i as f64).cos();
            assert!((s[0] - want).abs() < 1e-9 && (s[1] - want).abs() < 1e-9);
        }
    }
}

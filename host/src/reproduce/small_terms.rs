//! Section 6.2's small terms: a small cubic stiffness by harmonic balance, and by multiplying with
//! x (6.3).

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustfft::FftPlanner;
use whirl_hil_sim::plant_small_term::SmallTerm;

use super::{Item, Reproduction, Row};
use crate::error::{BadInput, Result};
use crate::identify::energy_balance::{ForcedOrbit, small_stiffness};
use crate::identify::harmonic_balance::fourier::Fourier;

/// Items of this file.
pub static ITEMS: &[Item] = &[Item {
    id: "equation-6.3",
    about: "forced oscillator: a small cubic stiffness by harmonic balance and by (6.3)",
    run: equation_6_3,
}];

/// k, c, a.
const TRUTH: [f64; 3] = [1.0, 0.05, 0.01];
/// Samples a period.
const SAMPLES: usize = 200;

/// Six steady orbits below and above the resonance; `noise`: uniform, share of each orbit's largest
/// displacement.
fn orbits(noise: f64, seed: u64) -> Result<Vec<ForcedOrbit>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    [(0.6, 0.6), (0.8, 0.4), (0.9, 0.2), (1.15, 0.3), (1.3, 0.7), (1.6, 1.5)]
        .iter()
        .map(|(omega, force)| {
            let plant =
                SmallTerm { stiffness: TRUTH[0], friction: TRUTH[1], cubic: TRUTH[2], force: *force, omega: *omega };
            let failed = |e: whirl_hil_sim::integrator::IntegrationError| BadInput::new(e.to_string(), "an oscillator");
            let (mut x, force) = plant.steady(SAMPLES).map_err(failed)?;
            let largest = x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            if noise > 0.0 {
                x.iter_mut().for_each(|x| *x += noise * largest * random.random_range(-1.0..1.0));
            }
            Ok(ForcedOrbit { x, force, period: std::f64::consts::TAU / omega })
        })
        .collect()
}

/// k, c, a by harmonic balance of the first five harmonics and the mean.
fn harmonic(orbits: &[ForcedOrbit]) -> Option<[f64; 3]> {
    let mut rows: Vec<[f64; 4]> = Vec::new();
    for o in orbits {
        let fourier = Fourier::new(&mut FftPlanner::new(), o.x.len());
        let scale = std::f64::consts::TAU / o.period;
        let x = fourier.of_real(&o.x);
        let (rate, accel) = (fourier.derivative(&x, 1.0), fourier.second_derivative(&x, 1.0));
        let cube = fourier.of_real(&o.x.iter().map(|x| x.powi(3)).collect::<Vec<_>>());
        let force = fourier.of_real(&o.force);
        for j in 0..=5 {
            let part = |f: fn(&rustfft::num_complex::Complex64) -> f64| {
                [f(&x[j]), scale * f(&rate[j]), f(&cube[j]), f(&force[j]) - scale * scale * f(&accel[j])]
            };
            rows.push(part(|z| z.re));
            if j > 0 {
                rows.push(part(|z| z.im));
            }
        }
    }
    let a = DMatrix::from_fn(rows.len(), 3, |r, c| rows[r][c]);
    let b = DVector::from_fn(rows.len(), |r, _| rows[r][3]);
    let x = a.svd(true, true).solve(&b, 1e-12).ok()?;
    Some([x[0], x[1], x[2]])
}

fn equation_6_3() -> Result<Reproduction> {
    let mut rows = Vec::new();
    for (noise, label) in [(0.0, "no noise"), (0.01, "1 % noise")] {
        let orbits = orbits(noise, 1)?;
        let found = harmonic(&orbits).ok_or_else(|| BadInput::new("orbits that determine nothing", "k, c and a"))?;
        for (name, (found, truth)) in ["k", "c", "a"].into_iter().zip(found.into_iter().zip(TRUTH)) {
            rows.push(Row::new(format!("{name}, harmonic balance, {label}"), "", None, Some(found), Some(truth)));
        }
        for (how, k) in [("k from the harmonic balance", found[0]), ("k known", TRUTH[0])] {
            let small = small_stiffness(&orbits, k, 3);
            let name = format!("a by (6.3), {how}, {label}");
            rows.push(Row::new(name, "", None, small.map(|s| s.0), Some(TRUTH[2])));
            rows.push(Row::new("its standard error", "", None, small.map(|s| s.1), None));
        }
    }
    Ok(Reproduction {
        id: "equation-6.3".into(),
        title: "ẍ + kx + cẋ + a x³ = F cos ωt: a small a from six steady orbits".into(),
        rows,
        notes: vec![
            "The seed proposes (6.3) and prints no numbers. It needs no acceleration, but k must be known better than a x²: what (6.3) gains depends on where k comes from."
                .into(),
        ],
        panels: Default::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_find_the_small_term_without_noise() {
        let orbits = orbits(0.0, 1).unwrap();
        let found = harmonic(&orbits).unwrap();
        for (found, truth) in found.iter().zip(TRUTH) {
            assert!((found / truth - 1.0).abs() < 1e-4, "{found} {truth}");
        }
        let (a, _) = small_stiffness(&orbits, TRUTH[0], 3).unwrap();
        assert!((a / TRUTH[2] - 1.0).abs() < 1e-5, "{a}");
    }
}

//! The method on plants that share nothing with it.

use std::f64::consts::TAU;

use rustfft::FftPlanner;
use whirl_hil_sim::plant_oscillator::record;
use whirl_hil_sim::plant_single_pendulum::SinglePendulum;
use whirl_hil_sim::{Simulation, SimulationSettings};

use super::settings::{Basis, Differentiation, Optimisation, Subharmonics};
use super::*;
use crate::model::double_pendulum::DAMPINGS;
use crate::signal::angles::Phase;

/// The seed's single pendulum, `periods` drive periods of 25 samples, after 20 of settling.
fn single(periods: usize) -> Stretch {
    let step = TAU / 25.0;
    let states = record(&SinglePendulum::default(), [0.3, 0.5], step, 25 * (periods + 20)).unwrap();
    let phi: Vec<f64> = states[500..].iter().map(|s| s[0]).collect();
    stretch(step, Phase::Clock(1.0), vec![phi])
}

fn stretch(step_s: f64, phase: Phase, coordinates: Vec<Vec<f64>>) -> Stretch {
    Stretch {
        start_s: 0.0,
        step_s,
        coordinates,
        inputs: Vec::new(),
        phase,
        amplitude_nm: None,
        history: None,
        base: None,
    }
}

/// What the encoders of the double pendulum show.
fn relative() -> DMatrix<f64> {
    DMatrix::from_row_slice(2, 2, &[1.0, 0.0, -1.0, 1.0])
}

fn double(seconds: f64) -> Stretch {
    let mut rig = Simulation::new(&SimulationSettings { settle_s: 10.0, ..SimulationSettings::default() }).unwrap();
    let n = (500.0 * seconds) as usize;
    let (mut phi, mut turns) = (vec![Vec::new(); 2], Vec::with_capacity(n));
    for _ in 0..n {
        let s = rig.next_sample().unwrap();
        phi[0].push(s.angles[0]);
        phi[1].push(s.angles[0] + s.angles[1]);
        turns.push(s.phase);
    }
    stretch(2e-3, Phase::Device(turns), phi)
}

fn value(b: &Balance, name: &str) -> (f64, f64) {
    let i = b.names.iter().position(|n| n == name).unwrap();
    (b.values[i], b.covariance[(i, i)].sqrt())
}

#[test]
fn pieces_of_the_single_pendulum_give_its_coefficients() {
    let segment = single(600);
    let found = orbits::find(&[segment], &DMatrix::identity(1, 1), &[true], 25.0, &Orbits::Pieces { periods: 30 });
    assert_eq!(found.orbits.len(), 19);
    let equations = equations::single_pendulum(&["c_r"], Basis::Harmonic(1));
    let settings = Settings { energy_balance: EnergyBalance::Coupled, ..Settings::frequency(30) };
    let b = balance(&found.orbits, &equations, &settings).unwrap();
    // The jump at the ends of a piece leaves some per cent.
    for (name, truth, tolerance) in [("p_cos", -1.52, 0.05), ("q_sin", 1.44, 0.03), ("c_r", 0.036, 0.004)] {
        assert!((value(&b, name).0 - truth).abs() < tolerance, "{name} {:?}", value(&b, name));
    }
    // What is known is kept, and is no unknown any more.
    let known = Settings { known: [("c_r".to_owned(), 0.036)].into(), ..settings };
    let b = balance(&found.orbits, &equations, &known).unwrap();
    assert!(!b.names.contains(&"c_r".to_owned()) && b.names.len() == 6);
}

#[test]
fn five_point_pieces_of_the_double_pendulum_are_free_of_the_jump() {
    let segment = double(120.0);
    let system = System { pendulum: Pendulum::Double, dampings: DAMPINGS[..2].iter().collect() };
    let found = orbits::find(&[segment], &relative(), &[true; 2], 100.0, &Orbits::Pieces { periods: 30 });
    let mut settings = Settings {
        differentiation: Differentiation::FivePoint,
        optimisation: None,
        energy_balance: EnergyBalance::Coupled,
        ..Settings::frequency(30)
    };
    let b = balance(&found.orbits, &equations(&system, &settings), &settings).unwrap();
    let truth = |name: &str| match name {
        "B11" => 0.113_218_7,
        "B12" => 0.070_850_7,
        "B21" => 1.681_577,
        "B22" => 0.263_216,
        "B13" => -0.110_664,
        "B23" => -0.411_126,
        "C11" => 1.019_98e-3,
        "C12" => 3.265_47e-3,
        "C2" => 0.048_500_2,
        _ => 0.0,
    };
    for name in ["B11", "B12", "B13", "B21", "B22", "B23"] {
        let (found, _) = value(&b, name);
        assert!((found / truth(name) - 1.0).abs() < 0.005, "{name} {found}");
    }
    for name in ["C11", "C12", "C2"] {
        let (found, error) = value(&b, name);
        assert!((found / truth(name) - 1.0).abs() < 0.05, "{name} {found} ± {error}");
    }
    // Coupled dampings obey the tie by construction.
    let tie = value(&b, "C12").0 / value(&b, "C2").0 * value(&b, "B21").0 / value(&b, "B11").0;
    assert!((tie - 1.0).abs() < 1e-9, "{tie}");
    // With the Fourier series, the jump spoils B21, as in the seed's chapter 4 run again.
    settings.differentiation = Differentiation::Fourier;
    settings.energy_balance = EnergyBalance::None;
    let b = balance(&found.orbits, &equations(&system, &settings), &settings).unwrap();
    assert!((value(&b, "B21").0 / 1.681_577 - 1.0).abs() > 0.2, "{:?}", value(&b, "B21"));
}

/// Without low-pass, high-frequency noise is folded into low sub-harmonics of products (3.26),
/// (3.27).
#[test]
fn the_low_pass_keeps_noise_out_of_products() {
    let clean = double(20.0);
    let mut noisy = clean.clone();
    let count = TAU / 1024.0;
    noisy.coordinates.iter_mut().flatten().for_each(|x| *x = ((*x / count).floor() + 0.5) * count);
    let equations = equations::double_pendulum(&[]);
    let cut = |s: &Stretch| Orbit::cut(s, 100, 20, 100.0, 0.0).unwrap();
    // Rms error of the coupling's column over its low sub-harmonics.
    let error = |low_pass| {
        let settings = Settings { low_pass, ..Settings::frequency(20) };
        let column = |s: &Stretch| {
            let rows = rows::expand(0, &cut(s), &equations, &settings).rows.remove(1);
            (0..rows.len()).map(|r| rows.row(r)[0]).collect::<Vec<_>>()
        };
        column(&clean).iter().zip(column(&noisy)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    assert!(error(None) > 2.0 * error(Some(0.1)), "{} {}", error(None), error(Some(0.1)));
}

#[test]
fn sets_of_subharmonics_are_what_they_are_called() {
    let segment = single(100);
    let found = orbits::find(&[segment], &DMatrix::identity(1, 1), &[true], 25.0, &Orbits::Pieces { periods: 10 });
    let orbit = &found.orbits[0];
    let equations = equations::single_pendulum(&["c_r"], Basis::Harmonic(1));
    let ids = |subharmonics, mean_row| {
        let settings = Settings { subharmonics, mean_row, ..Settings::frequency(10) };
        let rows = rows::expand(0, orbit, &equations, &settings).rows.remove(0);
        let mut j: Vec<usize> = rows.ids.iter().map(|i| i.subharmonic).collect();
        j.dedup();
        j
    };
    assert_eq!(ids(Subharmonics::UpTo(1.0), true), (0..=10).collect::<Vec<_>>());
    assert_eq!(ids(Subharmonics::Harmonics(3), true), [0, 10, 20, 30]);
    let largest = ids(Subharmonics::Largest(1), false);
    assert_eq!(largest.len(), 10);
    // They carry more of the acceleration than the first ten.
    let fourier = fourier::Fourier::new(&mut FftPlanner::new(), orbit.len());
    let m = orbit::motion(orbit, &fourier, Differentiation::Fourier, None, [true; 2]);
    let accel: Vec<f64> = m.states.iter().map(|s| s.accel[0]).collect();
    let c = fourier.of_real(&accel);
    let power = |j: &[usize]| j.iter().map(|j| c[*j].norm_sqr()).sum::<f64>();
    assert!(power(&largest) >= power(&(1..=10).collect::<Vec<_>>()));
}

#[test]
fn extracted_orbits_close_and_interpolation_follows_the_true_functions() {
    let segment = single(1200);
    let what = Orbits::Unstable { tolerance: 0.03, longest: 12, delay: Some(5) };
    let found = orbits::find(&[segment], &DMatrix::identity(1, 1), &[true], 25.0, &what);
    assert!(found.orbits.len() >= 5, "{}", found.orbits.len());
    for o in &found.orbits {
        let x = &o.phi[0][orbit::MARGIN..];
        let jump = x[o.len()] - x[0];
        assert!((jump - TAU * (jump / TAU).round()).abs() < 0.03 * TAU, "{jump}");
    }
    let settings = Settings {
        basis: Basis::Interpolation(8),
        optimisation: Some(Optimisation::default()),
        ..Settings::orbits(0.03)
    };
    let equations = equations::single_pendulum(&["c_r"], settings.basis);
    let b = balance(&found.orbits, &equations, &settings).unwrap();
    let functions = account::functions(&equations, &b);
    let q = functions.iter().find(|f| f.name == "q").unwrap();
    for (x, y) in q.angle.iter().zip(&q.value) {
        assert!((y - 1.44 * x.sin()).abs() < 0.35, "{x} {y}");
    }
    assert!(q.std_error.iter().all(|e| e.is_finite() && *e > 0.0));
}

//! The polar model against shooting, and against a Duffing oscillator's energy.

use super::super::normal_mode::{family, linear_mode};
use super::super::systems::by_id;
use super::*;

/// Nodes from the full system's own periodic motions, resolved into harmonics over one period.
fn exact_nodes(id: &str, energies: &[f64], major: &[f64]) -> Vec<Node> {
    let system = by_id(id).unwrap();
    family(&*system, energies)
        .iter()
        .map(|m| {
            let n = system.size();
            let period = TAU / m.omega;
            let samples = 64;
            let mut x = vec![vec![0.0; n]; 16];
            for i in 0..samples {
                let t = period * i as f64 / samples as f64;
                let at = super::super::normal_mode::flow(&*system, &m.rest, &vec![0.0; n], t).unwrap();
                for (k, x) in x.iter_mut().enumerate() {
                    for c in 0..n {
                        x[c] += 2.0 / samples as f64 * at[c] * (k as f64 * TAU * i as f64 / samples as f64).cos();
                    }
                }
            }
            x[0].iter_mut().for_each(|v| *v = 0.0);
            let a: f64 = x[1].iter().zip(major).map(|(x, p)| x * p).sum();
            let shape = x.iter().map(|x| x.iter().map(|v| v / a).collect()).collect();
            Node { amplitude: a, omega: m.omega, error: 1e-9, shape, spread: vec![0.0; n] }
        })
        .collect()
}

#[test]
fn the_variational_frequency_is_the_shooting_one_and_energy_is_the_actions() {
    let system = by_id("mass-pendulum").unwrap();
    let energies: Vec<f64> = [25.0, 90.0, 190.0, 330.0, 480.0].to_vec();
    let major = [0.2838, 0.9589];
    let nodes = exact_nodes("mass-pendulum", &energies, &major);
    let (omega, shape) = linear_mode(&*system).unwrap();
    let polar = model(&nodes, &major, Some((omega, shape))).unwrap();
    for member in family(&*system, &[40.0, 140.0, 260.0, 400.0]) {
        let a = polar.amplitude_at(&*system, member.energy).unwrap();
        let omega = polar.variational_omega(&*system, a).unwrap();
        assert!((omega / member.omega - 1.0).abs() < 2e-5, "{} {}", omega, member.omega);
        assert!((polar.omega(a) / member.omega - 1.0).abs() < 4e-4);
    }
}

#[test]
fn nodes_between_releases_are_the_full_systems_motions() {
    // Two masses: releases at amplitudes 1.5 and 17, the mode's shape turning by a quarter in
    // between.
    let system = by_id("two-mass").unwrap();
    let major = [0.141, 0.990];
    let nodes = exact_nodes("two-mass", &[1.8, 14.6, 267.0], &major);
    let linear = linear_mode(&*system);
    let (polar, all) = model_with(&nodes, &major, &*system, linear.clone()).unwrap();
    assert!(all.len() >= 8 && all[..3] == nodes, "{}", all.len());
    let interpolated = model(&nodes, &major, linear).unwrap();
    let mut worst = [0.0_f64; 2];
    // The last release lies on an asymmetric branch; below it the mode is the symmetric one.
    for member in family(&*system, &[3.0, 7.7, 30.0, 70.0]) {
        for ((model, nodes), worst) in [(&polar, &all), (&interpolated, &nodes)].iter().zip(&mut worst) {
            let a = model.amplitude_at(&*system, member.energy).unwrap();
            let omega = model.corrected_omega(&*system, nodes, a).unwrap();
            *worst = worst.max((omega / member.omega - 1.0).abs());
        }
    }
    assert!(worst[0] < 5e-6 && worst[1] > 1e-4, "{worst:?}");
}

#[test]
fn a_duffing_oscillators_energy_follows_from_displacements_alone() {
    // x″ + x + x³ = 0: E(rest) = x²/2 + x⁴/4 against ∫ω dI.
    let member = |x0: f64| -> Node {
        let n = 4096;
        let mut y = vec![x0, 0.0];
        let mut f = |_: f64, y: &[f64], d: &mut [f64]| {
            d[0] = y[1];
            d[1] = -y[0] - y[0].powi(3);
        };
        // Quarter period by bisection on x = 0.
        let mut step = 0.1;
        let mut at = |t: f64| {
            y = vec![x0, 0.0];
            super::super::integrate::advance(&mut f, &mut y, 0.0, t, 1e-12, &mut step);
            y[0]
        };
        let (mut low, mut high) = (0.0, 2.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if at(middle) > 0.0 { low = middle } else { high = middle }
        }
        let period = 4.0 * low;
        let _ = n;
        let mut x = vec![vec![0.0]; 12];
        for i in 0..64 {
            let v = at(period * f64::from(i) / 64.0);
            for (k, x) in x.iter_mut().enumerate() {
                x[0] += 2.0 / 64.0 * v * (k as f64 * TAU * f64::from(i) / 64.0).cos();
            }
        }
        x[0][0] = 0.0;
        let a = x[1][0];
        let shape = x.iter().map(|x| vec![x[0] / a]).collect();
        Node { amplitude: a, omega: TAU / period, error: 1e-9, shape, spread: vec![0.0] }
    };
    let nodes: Vec<Node> = [0.2, 0.5, 0.9, 1.4, 2.0].iter().map(|x| member(*x)).collect();
    let polar = model(&nodes, &[1.0], Some((1.0, vec![1.0]))).unwrap();
    for x0 in [0.3_f64, 0.7, 1.2, 1.8] {
        let a = polar.amplitude_of(&[x0]).unwrap();
        let energy = polar.energies(&[a], None)[0];
        let want = 0.5 * x0 * x0 + 0.25 * x0.powi(4);
        assert!((energy / want - 1.0).abs() < 2e-3, "{x0}: {energy} {want}");
    }
}

#[test]
fn even_harmonics_of_few_releases_are_fitted_to_them_alone() {
    // Seven motions of a symmetric mode, three of them releases with a tenth of even harmonics
    // beside it; the third harmonic calls for a high degree.
    let node = |a: f64, even: f64| Node {
        amplitude: a,
        omega: 1.0 + 0.01 * a,
        error: 1e-9,
        shape: vec![vec![0.0], vec![1.0], vec![even], vec![(0.9 * a).sin()]],
        spread: vec![0.0],
    };
    let nodes: Vec<Node> = (1..=7).map(|i| node(f64::from(i), if i % 3 == 1 { 0.1 } else { 0.0 })).collect();
    let polar = super::fitting::model_of(&nodes, &[1.0], None, 6, Some(false)).unwrap();
    assert!(polar.beside && polar.shape[3][0].len() > 4, "{polar:?}");
    for a in [1.0, 2.5, 4.0, 7.0] {
        assert!((polar.harmonics(a)[2][0] / a - 0.1).abs() < 1e-9, "{a}: {:?}", polar.harmonics(a));
    }
}

//! Accuracy of the polar model: frequency over the releases' energies, releases left out, histories
//! over ten periods, noise and its standard errors. Truth: the full system's normal mode by
//! shooting.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::chapter5::{Case, mass_pendulum, two_mass};
use super::chapter5_beyond::beam;
use super::chapter5_histories::{blind_history_error, polar_history_error};
use super::{Item, Reproduction, Row};
use crate::error::{BadInput, Result};
use crate::reduce::normal_mode::{self, Member};
use crate::reduce::polar::{self, Node, Polar};
use crate::reduce::release_fit;
use crate::reduce::standard_error::{self, Evaluation};
use crate::reduce::systems::Mechanical;
use crate::statistics::Z95;

/// Items of this file.
pub static ITEMS: &[Item] = &[Item {
    id: "reduction-accuracy",
    about: "two masses, mass–pendulum, beam: error of frequency, releases left out, histories, 1 % noise",
    run: accuracy,
}];

/// Draws of noise, and of how many of them intervals are asked.
const DRAWS: u64 = 21;
const INTERVALS: u64 = 7;

fn broken(what: &str) -> BadInput {
    BadInput::new(format!("the simulated releases of the {what} could not be reduced"), "")
}

/// Errors of frequency at the energies of these members.
fn errors(system: &dyn Mechanical, polar: &Polar, nodes: Option<&[Node]>, members: &[&Member]) -> Option<f64> {
    let mut worst = 0.0_f64;
    for m in members {
        let a = polar.amplitude_at(system, m.energy)?;
        let omega = match nodes {
            Some(nodes) => polar.corrected_omega(system, nodes, a)?,
            None => polar.omega(a),
        };
        worst = worst.max((omega / m.omega - 1.0).abs());
    }
    Some(worst)
}

/// Models of the same releases.
struct Models {
    /// Of the releases alone.
    plain: Polar,
    /// With the equations known, and all of its nodes.
    informed: (Polar, Vec<Node>),
    /// Those of the releases.
    nodes: Vec<Node>,
}

/// Models of the releases with noise of this share of each channel's rms; releases not used by the
/// case are not used here.
fn noisy(case: &Case, noise: f64, seed: u64) -> Option<Models> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut nodes = Vec::new();
    let major = &case.pod.modes[0];
    for record in case.used.iter().map(|i| &case.records[*i]) {
        let channels: Vec<Vec<f64>> = record
            .iter()
            .map(|x| {
                let rms = (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
                // Box and Muller.
                x.iter()
                    .map(|x| {
                        let (u, v): (f64, f64) =
                            (random.random_range(f64::MIN_POSITIVE..1.0), random.random_range(0.0..TAU));
                        x + noise * rms * (-2.0 * u.ln()).sqrt() * v.cos()
                    })
                    .collect()
            })
            .collect();
        let channels: Vec<&[f64]> = channels.iter().map(Vec::as_slice).collect();
        nodes.push(Node::of(&release_fit::fit(&channels, case.step, major)?, major));
    }
    let linear = normal_mode::linear_mode(&*case.system);
    let known = polar::model_with(&nodes, major, &*case.system, linear.clone())?;
    Some(Models { plain: polar::model(&nodes, major, linear)?, informed: known, nodes })
}

/// Of so many draws, at the releases: whether the frequency's 95 % interval holds the mode's,
/// [held, asked].
fn held(case: &Case, models: &Models) -> Option<[[u32; 2]; 2]> {
    let Models { plain, informed: known, nodes } = models;
    let mut count = [[0; 2]; 2];
    let linear = normal_mode::linear_mode(&*case.system);
    let blind = Evaluation { system: None, masses: None, linear: linear.as_ref(), corrected: false, between: &[] };
    let informed =
        Evaluation { system: Some(&*case.system), corrected: true, between: &known.1[nodes.len()..], ..blind };
    for (count, (model, how)) in count.iter_mut().zip([(plain, blind), (&known.0, informed)]) {
        let curve = standard_error::of(model, nodes, how).curve;
        for i in &case.used {
            // The motion on the mode at the release's own amplitude has its own frequency: the
            // noise-free fit's.
            let fit = &case.fits[*i];
            let a: f64 = fit.cosine[1].iter().zip(&case.pod.modes[0]).map(|(x, p)| x * p).sum();
            let near = curve.iter().min_by(|p, q| (p.amplitude - a).abs().total_cmp(&(q.amplitude - a).abs()))?;
            let omega =
                if how.system.is_some() { model.corrected_omega(&*case.system, &known.1, a)? } else { model.omega(a) };
            count[0] += u32::from((omega - fit.omega).abs() < Z95 * TAU * near.std_error_hz);
            count[1] += 1;
        }
    }
    Some(count)
}

fn median(mut x: Vec<f64>) -> Option<f64> {
    x.sort_by(f64::total_cmp);
    x.get(x.len() / 2).copied()
}

/// Greatest error at each release but the ends that its model was made without: from displacements
/// only, with the equations known.
fn left_out(
    system: &dyn Mechanical,
    nodes: &[Node],
    major: &[f64],
    members: &[&Member],
) -> Option<Vec<(usize, f64, f64)>> {
    (1..nodes.len().saturating_sub(1))
        .map(|out| {
            let mut rest = nodes.to_vec();
            rest.remove(out);
            let linear = normal_mode::linear_mode(system);
            let blind = polar::model(&rest, major, linear.clone())?;
            let (known, all) = polar::model_with(&rest, major, system, linear)?;
            let at = &members[out..=out];
            Some((out, errors(system, &blind, None, at)?, errors(system, &known, Some(&all), at)?))
        })
        .collect()
}

fn pair(name: &str, what: &str, blind: Option<f64>, known: Option<f64>) -> Row {
    Row::new(format!("{name}: {what}"), "", None, blind, Some(0.0)).ours(known)
}

fn small(name: &str, case: &Case, rows: &mut Vec<Row>) -> Result<()> {
    let system = &*case.system;
    let used: Vec<&Member> = case.used.iter().map(|i| &case.members[*i]).collect();
    rows.push(pair(
        name,
        "error of frequency over the releases",
        errors(system, &case.polar, None, &used),
        errors(system, &case.known, Some(&case.all), &used),
    ));
    for (out, blind, known) in left_out(system, &case.nodes, &case.pod.modes[0], &used).ok_or_else(|| broken(name))? {
        let what = format!("the same at release {}, left out", case.used[out] + 1);
        rows.push(pair(name, &what, Some(blind), Some(known)));
    }
    for i in 0..case.records.len() {
        let what = format!("error over ten periods, release {}", i + 1);
        rows.push(pair(name, &what, blind_history_error(case, i), polar_history_error(case, i)));
    }
    let (mut blind, mut known, mut count) = (Vec::new(), Vec::new(), [[0; 2]; 2]);
    for seed in 0..DRAWS {
        let models = noisy(case, 0.01, seed).ok_or_else(|| broken(&format!("{name} with noise, draw {seed}")))?;
        let of = |what: &str| broken(&format!("{name} with noise, draw {seed}: {what}"));
        blind.push(errors(system, &models.plain, None, &used).ok_or_else(|| of("frequency"))?);
        known.push(
            errors(system, &models.informed.0, Some(&models.informed.1), &used)
                .ok_or_else(|| of("variational frequency"))?,
        );
        if seed >= INTERVALS {
            continue;
        }
        let held = held(case, &models).ok_or_else(|| of("standard errors"))?;
        for (count, held) in count.iter_mut().zip(held) {
            (count[0], count[1]) = (count[0] + held[0], count[1] + held[1]);
        }
    }
    rows.push(pair(name, "1 % noise, median of 21 draws", median(blind), median(known)));
    let share = |c: [u32; 2]| Some(100.0 * f64::from(c[0]) / f64::from(c[1]));
    let what = format!("{name}: 1 % noise, 7 draws, 95 % intervals that hold the release's frequency");
    rows.push(Row::new(what, "%", None, share(count[0]), Some(95.0)).ours(share(count[1])));
    Ok(())
}

fn accuracy() -> Result<Reproduction> {
    let mut rows = Vec::new();
    for (name, case) in [("two masses", two_mass()?), ("mass–pendulum", mass_pendulum()?)] {
        small(name, case, &mut rows)?;
    }
    let case = beam()?;
    let members = normal_mode::family(&*case.system, &[0.20557, 0.84545, 2.09678, 4.24112]);
    let of = left_out(&*case.system, &case.nodes, &case.polar.major, &members.iter().collect::<Vec<_>>());
    for (out, blind, known) in of.ok_or_else(|| broken("beam"))? {
        let what = format!("error of frequency at release {}, left out", out + 1);
        rows.push(pair("beam", &what, Some(blind), Some(known)));
    }
    Ok(Reproduction {
        id: "reduction-accuracy".into(),
        title: "Relative errors of the polar model: frequency at the releases' energies, and all coordinates over ten periods.".into(),
        rows,
        notes: vec![
            "Reproduced: from displacements only; polar: equations known. The two masses' fourth release lies where the mode is unstable and is in no model; their fifth is off the symmetric mode, whose frequency at that energy is the true one.".into(),
            "The chain's models are made of decays, whose windows overlap: none of them can be left out.".into(),
        ],
        panels: Default::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accuracy_meets_its_bounds() {
        let r = accuracy().unwrap();
        let of = |start: &str, end: &str| {
            r.rows.iter().find(|r| r.quantity.starts_with(start) && r.quantity.ends_with(end)).unwrap().clone()
        };
        for (system, blind, known) in [("two masses", 5e-4, 2e-4), ("mass–pendulum", 5e-4, 2e-5)] {
            let row = of(system, "over the releases");
            assert!(row.reproduced.unwrap() < blind && row.ours.unwrap() < known, "{row:?}");
            let row = of(system, "draws");
            assert!(row.reproduced.unwrap() < 1e-3 && row.ours.unwrap() < 1e-3, "{row:?}");
            let row = of(system, "release's frequency");
            assert!(row.reproduced.unwrap() > 85.0 && row.ours.unwrap() > 85.0, "{row:?}");
        }
        // A release left out changes the frequency by less than 5e-5 where the equations are known.
        for row in r.rows.iter().filter(|r| r.quantity.ends_with("left out")) {
            assert!(row.ours.unwrap() < 5e-5, "{row:?}");
        }
        // Twice what is attained elsewhere; the two masses' fourth release is unstable.
        let bounds = [
            ("two masses", [2e-3, 1e-3, 1e-2, 1.0, 1e-3]),
            ("mass–pendulum", [2.5e-3, 1.5e-3, 2.6e-3, 6.4e-3, 1.3e-3]),
        ];
        for (system, bounds) in bounds {
            for (i, bound) in bounds.iter().enumerate() {
                let row = of(system, &format!("ten periods, release {}", i + 1));
                assert!(row.reproduced.unwrap() < *bound, "{row:?}");
                assert!(row.ours.unwrap() < *bound, "{row:?}");
            }
        }
    }
}

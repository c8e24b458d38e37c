//! Beyond chapter 5: the chain of 60 masses and the clamped beam, free (backbones) and forced
//! (response with its folds). References: shooting, and harmonic balance with continuation.

use std::f64::consts::PI;

use whirl_hil_sim::plant_beam;
use whirl_hil_sim::plant_chain;
use whirl_hil_sim::plant_oscillator::record;

use super::{Item, Reproduction, Row};
use crate::error::{BadInput, Result};
use crate::reduce::decay;
use crate::reduce::forced_response::{self, ForcedResponse, Forcing};
use crate::reduce::harmonic_balance::{self, Continuation};
use crate::reduce::normal_mode;
use crate::reduce::polar::{self, Node, Polar};
use crate::reduce::proper_orthogonal_decomposition::{Route, decompose};
use crate::reduce::release_fit;
use crate::reduce::systems::{self, Mechanical};
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};

/// Items of this file.
pub static ITEMS: &[Item] = &[
    Item {
        id: "chain-backbone",
        about: "chain of 60 masses: frequency against energy from four decays",
        run: || backbone("chain-backbone", &chain()?),
    },
    Item {
        id: "chain-forced",
        about: "chain of 60 masses, forced and damped: response and folds, reduced and full",
        run: || forced("chain-forced", &chain()?),
    },
    Item {
        id: "beam-backbone",
        about: "clamped beam that stretches: frequency against energy from four releases",
        run: || backbone("beam-backbone", &beam()?),
    },
    Item {
        id: "beam-forced",
        about: "clamped beam, forced and damped: response and folds, reduced and full",
        run: || forced("beam-forced", &beam()?),
    },
];

/// A system of many degrees of freedom with its model.
pub(super) struct Large {
    pub(super) system: Box<dyn Mechanical>,
    pub(super) polar: Polar,
    pub(super) nodes: Vec<Node>,
    pub(super) linear: (f64, Vec<f64>),
    /// Force on the first linear mode, such that the upper fold lies well within the model's range.
    forcing: Forcing,
    /// What a POD alone says: Galerkin's projection of mass and potential on the first proper
    /// orthogonal mode, as a model of its own.
    galerkin: Vec<f64>,
}

fn broken(what: &str) -> BadInput {
    BadInput::new(format!("the simulated releases of the {what} could not be reduced"), "")
}

/// `[release][channel][sample]` to modes and nodes; `windows`: the releases decay.
fn nodes(records: &[Vec<Vec<f64>>], step: f64, windows: bool) -> Option<(Vec<f64>, Vec<Node>)> {
    let n = records.first()?.len();
    let whole: Vec<Vec<f64>> = (0..n).map(|c| records.iter().flat_map(|r| r[c].iter().copied()).collect()).collect();
    let pod = decompose(&whole.iter().map(Vec::as_slice).collect::<Vec<_>>(), None, Route::Covariance);
    let major = pod.modes.into_iter().next()?;
    let mut nodes = Vec::new();
    for record in records {
        let channels: Vec<&[f64]> = record.iter().map(Vec::as_slice).collect();
        let fit = release_fit::fit(&channels, step, &major)?;
        if windows {
            nodes.extend(decay::windows(&channels, step, fit.omega, &major).iter().map(|w| Node::of(w, &major)));
        } else {
            nodes.push(Node::of(&fit, &major));
        }
    }
    Some((major, nodes))
}

/// Step of the records.
const STEP: f64 = 0.1;

fn large(id: &str, records: &[Vec<Vec<f64>>], windows: bool, force: f64) -> Option<Large> {
    let system = systems::by_id(id)?;
    let (major, nodes) = nodes(records, STEP, windows)?;
    let linear = normal_mode::linear_mode(&*system)?;
    let polar = polar::model(&nodes, &major, Some(linear.clone()))?;
    let forcing = Forcing { amplitude: force, shape: linear.1.clone(), damping: 0.01 };
    Some(Large { system, polar, nodes, linear, forcing, galerkin: major })
}

/// Four decays on the first linear mode from centre amplitudes 1.1, 0.8, 0.5, 0.25, ζ 0.5 %, 30
/// linear periods, ten samples a second.
fn chain() -> Result<Large> {
    let plant = plant_chain::Chain::default();
    let records: Option<Vec<Vec<Vec<f64>>>> = [1.1, 0.8, 0.5, 0.25]
        .iter()
        .map(|a| {
            let states = record(&plant, plant_chain::Chain::release(*a), STEP, 1885).ok()?;
            Some((0..plant_chain::MASSES).map(|c| states.iter().map(|y| y[c]).collect()).collect())
        })
        .collect();
    records.and_then(|r| large("chain", &r, true, 0.055)).ok_or_else(|| broken("chain"))
}

/// Four releases from rest on the nonlinear mode at 1.00, 1.96, 2.91 and 3.86 √(I/A), free of
/// damping, 16 linear periods.
pub(super) fn beam() -> Result<Large> {
    let plant = plant_beam::Beam::default();
    let system = systems::by_id("clamped-beam").ok_or_else(|| broken("beam"))?;
    let records: Option<Vec<Vec<Vec<f64>>>> = normal_mode::family(&*system, &[0.20557, 0.84545, 2.09678, 4.24112])
        .iter()
        .map(|m| {
            let mut start = [0.0; plant_beam::STATES];
            start[..plant_beam::MODES].copy_from_slice(&m.rest);
            let states = record(&plant, start, STEP, 1000).ok()?;
            Some((0..plant_beam::MODES).map(|c| states.iter().map(|y| y[c]).collect()).collect())
        })
        .collect();
    records.and_then(|r| large("clamped-beam", &r, false, 0.024)).ok_or_else(|| broken("beam"))
}

/// Angular frequency at this energy of the motion along one straight mode: quarter period by
/// quadrature, x = p y, y = y0 sin θ.
fn straight(system: &dyn Mechanical, mode: &[f64], energy: f64) -> Option<f64> {
    let at = |y: f64| mode.iter().map(|p| p * y).collect::<Vec<f64>>();
    let mass: f64 = {
        let m = system.mass(&at(0.0));
        let n = mode.len();
        (0..n).map(|i| (0..n).map(|j| mode[i] * m[i * n + j] * mode[j]).sum::<f64>()).sum()
    };
    let most = polar::bisect(|y| system.potential(&at(y)), energy, 100.0)?;
    let steps = 400;
    let quarter: f64 = (0..steps)
        .map(|i| {
            let theta = (f64::from(i) + 0.5) * 0.5 * PI / f64::from(steps);
            let left = energy - system.potential(&at(most * theta.sin()));
            most * theta.cos() * (0.5 * mass / left).sqrt() * 0.5 * PI / f64::from(steps)
        })
        .sum();
    Some(0.5 * PI / quarter)
}

fn backbone(id: &str, case: &Large) -> Result<Reproduction> {
    let system = &*case.system;
    let [low, high] = case.polar.range;
    let low = low.max(0.1 * high);
    let energies: Vec<f64> = (0..=12)
        .map(|i| system.potential(&case.polar.displacement(low * (high / low).powf(f64::from(i) / 12.0), 0.0)))
        .collect();
    let members = normal_mode::family(system, &energies);
    let mut rows = Vec::new();
    let mut worst = [0.0_f64; 4];
    let mut curves: [Vec<f64>; 4] = Default::default();
    for m in &members {
        let a = case.polar.amplitude_at(system, m.energy).ok_or_else(|| broken("system"))?;
        let found = [
            straight(system, &case.linear.1, m.energy),
            straight(system, &case.galerkin, m.energy),
            Some(case.polar.omega(a)),
            case.polar.variational_omega(system, a),
        ];
        for ((worst, curve), omega) in worst.iter_mut().zip(&mut curves).zip(found) {
            let omega = omega.ok_or_else(|| broken("system"))?;
            *worst = worst.max((omega / m.omega - 1.0).abs());
            curve.push(omega);
        }
        let row = Row::new(format!("ω at energy {:.4}", m.energy), "", None, found[1], Some(m.omega));
        rows.push(row.ours(found[3]));
    }
    for (i, name) in
        ["linear mode alone", "proper orthogonal mode alone", "polar, displacements only"].iter().enumerate()
    {
        rows.push(Row::new(format!("greatest error of ω: {name}"), "", None, Some(worst[i]), Some(0.0)));
    }
    rows.push(Row::new("greatest error of ω: polar, equations known", "", None, None, Some(0.0)).ours(Some(worst[3])));
    let mut panel = Panel::new("", Axis::log("energy"), Axis::linear("frequency / (rad/s)"));
    let energy: Vec<f64> = members.iter().map(|m| m.energy).collect();
    let full: Vec<f64> = members.iter().map(|m| m.omega).collect();
    panel.series.push(Series::new("full system", Shape::Line, energy.clone(), full).colour(5));
    panel.series.push(Series::new("POD alone", Shape::Line, energy.clone(), curves[1].clone()).colour(0));
    panel.series.push(Series::new("polar model", Shape::BigDots, energy, curves[3].clone()).colour(2));
    Ok(Reproduction {
        id: id.into(),
        title: "Frequency against energy at rest: full system by shooting, proper orthogonal mode alone, polar model.".into(),
        rows,
        notes: vec!["Reproduced: Galerkin's projection on the proper orthogonal mode. Energies within an internal resonance (the beam's third mode at five times the first) have no member of the family and are left out.".into()],
        panels: (vec![panel], 1, 320.0),
    })
}

/// The reduced and the full response of a case.
fn responses(case: &Large) -> Option<(ForcedResponse, ForcedResponse, ForcedResponse)> {
    let system = &*case.system;
    let known = forced_response::response(&case.polar, Some(system), None, &case.forcing);
    let blind = forced_response::response(&case.polar, None, None, &case.forcing);
    let top = known.folds.first()?;
    let settings = Continuation {
        harmonic: if system.size() > 20 { 3 } else { 5 },
        from: 0.95 * case.linear.0,
        to: 1.02 * top.omega,
        scale: [top.amplitude, top.omega - case.linear.0],
        step: 0.02,
    };
    let full = harmonic_balance::response(system, &case.forcing, &case.polar.major, &settings)?;
    Some((known, blind, full))
}

fn forced(id: &str, case: &Large) -> Result<Reproduction> {
    let (known, blind, full) = responses(case).ok_or_else(|| broken("forced system"))?;
    if full.folds.len() != 2 || known.folds.len() != 2 || blind.folds.len() != 2 {
        return Err(broken("forced system"));
    }
    let mut rows = vec![
        Row::new("folds found", "", None, Some(blind.folds.len() as f64), Some(full.folds.len() as f64))
            .ours(Some(known.folds.len() as f64)),
    ];
    for (i, name) in ["upper fold", "lower fold"].iter().enumerate() {
        let (k, b, f) = (known.folds[i], blind.folds[i], full.folds[i]);
        rows.push(
            Row::new(format!("{name}, frequency"), "rad/s", None, Some(b.omega), Some(f.omega)).ours(Some(k.omega)),
        );
        rows.push(
            Row::new(format!("{name}, amplitude"), "", None, Some(b.amplitude), Some(f.amplitude))
                .ours(Some(k.amplitude)),
        );
        for (what, of) in
            [("frequency", (|p: &forced_response::Point| p.omega) as fn(&_) -> f64), ("amplitude", |p| p.amplitude)]
        {
            let error = |p: &forced_response::Point| Some((of(p) / of(&f) - 1.0).abs());
            rows.push(Row::new(format!("{name}, error of {what}"), "", None, error(&b), Some(0.0)).ours(error(&k)));
        }
    }
    let mut panel = Panel::new("", Axis::linear("frequency of the force / (rad/s)"), Axis::linear("amplitude"));
    for (name, r, shape, colour) in [("full system", &full, Shape::Line, 5), ("polar model", &known, Shape::Dots, 2)] {
        let near = r.curve.iter().filter(|p| p.omega > 0.95 * case.linear.0 && p.omega < 1.02 * full.folds[0].omega);
        let (x, y) = near.map(|p| (p.omega, p.amplitude)).unzip();
        panel.series.push(Series::new(name, shape, x, y).colour(colour));
    }
    let (x, y) = full.folds.iter().map(|p| (p.omega, p.amplitude)).unzip();
    panel.series.push(Series::new("folds", Shape::BigDots, x, y).colour(1));
    Ok(Reproduction {
        id: id.into(),
        title: "Forced, damped response: full system by harmonic balance with continuation, polar model in closed form.".into(),
        rows,
        notes: vec!["Reproduced: from displacements only (unit masses); polar: equations known. Amplitude: first harmonic of the major coordinate.".into()],
        panels: (vec![panel], 1, 320.0),
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn the_beams_backbone_and_folds_meet_their_bounds() {
        let case = beam().unwrap();
        let free = backbone("beam-backbone", &case).unwrap();
        let last = |r: &Reproduction, end: &str| r.rows.iter().find(|r| r.quantity.ends_with(end)).unwrap().clone();
        assert!(last(&free, "equations known").ours.unwrap() < 1e-4, "{free:?}");
        assert!(last(&free, "displacements only").reproduced.unwrap() < 5e-4, "{free:?}");
        assert!(last(&free, "mode alone").reproduced.unwrap() > 2e-3);
        let forced = forced("beam-forced", &case).unwrap();
        assert!(last(&forced, "upper fold, error of frequency").ours.unwrap() < 2e-5, "{forced:?}");
        assert!(last(&forced, "upper fold, error of amplitude").ours.unwrap() < 1e-4, "{forced:?}");
        assert!(last(&forced, "lower fold, error of frequency").ours.unwrap() < 2e-5, "{forced:?}");
    }

    /// The response is the plant's own: integrated in time from the model's state for some hundred
    /// periods, below the upper fold.
    #[test]
    fn the_plant_answers_the_force_as_the_model_says() {
        let case = beam().unwrap();
        let model = forced_response::response(&case.polar, Some(&*case.system), None, &case.forcing);
        let at = model.curve.iter().rfind(|p| p.lag < 1.2 && p.amplitude > 1.0).copied().unwrap();
        let mut plant = plant_beam::Beam::default();
        plant.damping = case.forcing.damping;
        plant.force = (case.forcing.amplitude, at.omega);
        let x = |t: f64| case.polar.displacement(at.amplitude, at.omega * t - at.lag);
        let (now, h) = (x(0.0), 1e-4);
        let (after, before) = (x(h), x(-h));
        let mut start = [0.0; plant_beam::STATES];
        for i in 0..plant_beam::MODES {
            start[i] = now[i];
            start[plant_beam::MODES + i] = (after[i] - before[i]) / (2.0 * h);
        }
        let periods = 150;
        let states = record(&plant, start, TAU / at.omega / 16.0, 16 * periods).unwrap();
        // First harmonic of the last ten periods.
        let (mut c, mut s) = (0.0, 0.0);
        for (i, y) in states.iter().enumerate().skip(16 * (periods - 10)) {
            let major: f64 = (0..plant_beam::MODES).map(|j| y[j] * case.polar.major[j]).sum();
            let (sin, cos) = (TAU * i as f64 / 16.0).sin_cos();
            c += major * cos / 80.0;
            s += major * sin / 80.0;
        }
        assert!((c.hypot(s) / at.amplitude - 1.0).abs() < 1e-3, "{} {at:?}", c.hypot(s));
        assert!((s.atan2(c) - at.lag).abs() < 3e-3, "{} {at:?}", s.atan2(c));
    }

    #[test]
    fn the_chains_backbone_follows_from_four_decays() {
        let case = chain().unwrap();
        // The full system's by shooting (`whirl reproduce chain-backbone` makes it anew).
        let (energy, omega) = (8.8999, 1.127_510);
        let a = case.polar.amplitude_at(&*case.system, energy).unwrap();
        let found = case.polar.variational_omega(&*case.system, a).unwrap();
        assert!((found / omega - 1.0).abs() < 1e-5, "{found}");
        assert!((case.polar.omega(a) / omega - 1.0).abs() < 5e-4);
    }
}

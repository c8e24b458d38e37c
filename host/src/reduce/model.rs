//! The model that a constraint asks for, its frequency–energy curve beside the full system's, and
//! its errors.

use serde::Serialize;

use super::added_constraint::{self, ConstraintModel, Function};
use super::forced;
use super::judge;
use super::normal_mode::{self, Member};
use super::polar::{self, Node, Polar};
use super::proper_orthogonal_decomposition::Pod;
use super::release_fit::{MOST_SAMPLES, ReleaseFit};
use super::releases::{self, Entry, Gathered, Release};
use super::standard_error;
use super::systems::{self, Mechanical};
use super::{Constraint, Frame, ReduceSettings, Reduction};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::warning::Warning;

/// Floquet multiplier from which a mode is called unstable.
const UNSTABLE: f64 = 1.02;

/// A model in the result.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
pub enum Model {
    /// The action–angle model.
    Polar(Polar),
    /// A model in the major coordinate and its rate.
    Polynomial(ConstraintModel),
}

/// Frequency (Hz) against energy.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrequencyEnergy {
    /// The full system: its normal mode by shooting where the equations are known, the measured
    /// releases otherwise.
    pub full: Vec<[f64; 2]>,
    /// The reduced model.
    pub reduced: Vec<[f64; 2]>,
    /// Where `full` comes from: `shooting`, `releases`, or nothing.
    pub source: &'static str,
    /// Unit of the energy.
    pub energy_unit: &'static str,
}

/// Errors of the model.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Error {
    /// Greatest relative error of the frequency over the releases' energies, against the full
    /// system (or against the releases used).
    pub frequency: Option<f64>,
    /// Greatest relative error at a release that was left out in making the model.
    pub left_out: Option<f64>,
    /// For each release the relative error of all coordinates over ten periods (or the record, if
    /// shorter).
    pub time_history: Vec<Option<f64>>,
    /// Amplitudes (first harmonic of the major coordinate) between which the model may be used.
    pub range: Option<[f64; 2]>,
    /// For the polynomial models: whether every release simulated over the range comes back.
    pub stable: Option<bool>,
}

/// What the figures show.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plots {
    /// Each used release: time, measured major coordinate, the model's.
    pub histories: Vec<[Vec<f64>; 3]>,
    /// Each release: measured minor against major coordinate, then the model's.
    pub shapes: Vec<[Vec<f64>; 4]>,
}

/// A model that can be released.
pub(super) enum Made<'a> {
    /// The model, its nodes (the releases' first; none for decays), the system.
    Polar(Polar, Vec<Node>, Option<&'a dyn Mechanical>),
    Polynomial(ConstraintModel),
}

impl Made<'_> {
    pub(super) fn omega(&self, a: f64) -> Option<f64> {
        match self {
            Self::Polar(p, nodes, Some(system)) => p.corrected_omega(*system, nodes, a),
            Self::Polar(p, _, None) => Some(p.omega(a)).filter(|w| *w > 0.0),
            Self::Polynomial(m) => m.behaviour(a).map(|b| b.omega),
        }
    }

    pub(super) fn rest(&self, a: f64) -> Vec<f64> {
        match self {
            Self::Polar(p, ..) => p.displacement(a, 0.0),
            Self::Polynomial(m) => m.displacement(a, 0.0),
        }
    }

    /// Coordinates over time from rest at amplitude a.
    pub(super) fn history(&self, a: f64, phase: f64, step: f64, count: usize) -> Option<Vec<Vec<f64>>> {
        match self {
            Self::Polar(p, ..) => {
                let omega = self.omega(a)?;
                let x = p.harmonics(a);
                Some(
                    (0..count)
                        .map(|i| {
                            let phi = phase + omega * i as f64 * step;
                            let mut at = vec![0.0; x[0].len()];
                            for (k, x) in x.iter().enumerate() {
                                let c = (k as f64 * phi).cos();
                                at.iter_mut().zip(x).for_each(|(o, v)| *o += c * v);
                            }
                            at
                        })
                        .collect(),
                )
            }
            Self::Polynomial(m) => {
                let states = m.simulate(a, step, count);
                (states.len() == count).then(|| states.iter().map(|s| m.displacement(s[0], s[1])).collect())
            }
        }
    }
}

/// What a model is made of and judged by.
pub(super) struct Evidence<'a> {
    /// The records.
    pub gathered: &'a Gathered,
    /// The releases in them, fitted.
    pub entries: &'a [Entry],
    /// Which of them the model is made with.
    pub used: &'a [usize],
    /// Whether they are periodic motions of a family.
    pub periodic: bool,
    /// Orthonormal modes, as many as move.
    pub basis: &'a [Vec<f64>],
    /// The first of them: the major coordinate.
    pub major: &'a [f64],
    /// The system, where its equations are known and fit the record.
    pub system: Option<&'a dyn Mechanical>,
    /// Motions of its normal mode at the releases' energies.
    pub branch: &'a [Option<Member>],
    /// Masses of the channels.
    pub masses: Option<&'a [f64]>,
}

/// Builds the whole result from the decomposition.
pub(super) fn build(
    gathered: &Gathered,
    pod: Pod,
    kept: usize,
    mut frame: Frame,
    rig: &Rig,
    settings: &ReduceSettings,
) -> Result<Reduction> {
    let major = unit(&pod.modes[0]);
    let entries = releases::entries(gathered, &major);
    let endless = gathered.releases.iter().filter(|r| r[0].len() > MOST_SAMPLES).count();
    if endless > 0 {
        frame.warnings.push(Warning::new(
            "long-stretches",
            format!("{endless} stretches of more than {MOST_SAMPLES} samples are not looked at as releases"),
            "Cut the free swings out of the record",
        ));
    }
    let periodic = releases::periodic(&entries);
    let mut described: Vec<Release> = entries.iter().map(|e| releases::describe(gathered, e, &major)).collect();
    for (r, _) in described.iter_mut().zip(&entries).filter(|(_, e)| e.decaying) {
        r.remarks.insert(0, "decaying");
    }
    let system = known_system(rig, gathered);
    let mut branch: Vec<Option<Member>> = vec![None; described.len()];
    if let Some(system) = &system
        && periodic
    {
        branch = compare_with_full(&**system, gathered, &mut described, &entries);
    }
    let system = system.filter(|_| branch.iter().any(Option::is_some));
    // The windows of a decay speak for themselves in the table; dozens of warnings would not be
    // read.
    for (r, _) in described.iter().zip(&entries).filter(|(r, e)| !r.remarks.is_empty() && periodic && !e.decaying) {
        frame.warnings.push(remark_warning(r));
    }
    let used: Vec<usize> = (0..described.len()).filter(|i| described[*i].used).collect();
    let constraint = constraint_of(settings, periodic, &described)?;
    let basis: Vec<Vec<f64>> = complete(&pod.modes, pod.rank());
    let masses = settings.masses.as_deref();
    let evidence = Evidence {
        gathered,
        entries: &entries,
        used: &used,
        periodic,
        basis: &basis,
        major: &major,
        system: system.as_deref(),
        branch: &branch,
        masses,
    };
    let made = make(constraint, &evidence);
    if made.is_none() && periodic {
        frame.warnings.push(Warning::new(
            "no-model",
            "no stable model was found from these releases",
            "Record more releases over the range of amplitudes, or use another --constraint",
        ));
    }
    let mut reduction = Reduction { constraint, releases: described, ..super::without_model(frame, pod, kept) };
    if settings.force.is_some() && !matches!(made, Some(Made::Polar(..))) {
        return Err(super::forced_needs_polar());
    }
    if let Some(made) = made {
        judge::judge(&mut reduction, &made, &evidence);
        reduction.model = Some(match made {
            Made::Polar(mut p, all, system) => {
                let nodes: Vec<Node> = used.iter().map(|i| Node::of(&entries[*i].fit, &major)).collect();
                let linear = system.and_then(normal_mode::linear_mode);
                let (corrected, between) = (!all.is_empty(), all.get(nodes.len()..).unwrap_or(&[]));
                let how = standard_error::Evaluation { system, masses, linear: linear.as_ref(), corrected, between };
                let errors = standard_error::of(&p, &nodes, how);
                p.omega_squared_std_error = errors.omega_squared;
                reduction.frequency_amplitude = errors.curve;
                if let Some(force) = &settings.force {
                    let warnings = &mut reduction.warnings;
                    reduction.forced = Some(forced::make(force, &p, &major, &entries, system, masses, warnings)?);
                }
                Model::Polar(p)
            }
            Made::Polynomial(m) => Model::Polynomial(m),
        });
    }
    Ok(reduction)
}

/// The constraint that was asked for, or the one that the releases allow.
///
/// # Errors
/// One that was asked for and that they do not allow.
fn constraint_of(settings: &ReduceSettings, periodic: bool, releases: &[Release]) -> Result<Constraint> {
    let used: Vec<&Release> = releases.iter().filter(|r| r.used).collect();
    let amplitudes_differ = used.iter().any(|r| (r.amplitude / used[0].amplitude - 1.0).abs() > 1e-3);
    let constraint =
        settings.constraint.unwrap_or(if periodic && amplitudes_differ { Constraint::Polar } else { Constraint::None });
    if constraint != Constraint::None && (!periodic || used.is_empty()) {
        return Err(BadInput::new(
            "no release that swings periodically for three periods or more",
            "releases close to periodic, for this constraint",
        )
        .at("--constraint")
        .remedy("Use --constraint none, or record free swings released on one mode"));
    }
    if constraint == Constraint::Polar && !amplitudes_differ {
        return Err(BadInput::new("releases of one amplitude", "at least two releases of different amplitude")
            .at("--constraint")
            .remedy("Record further releases, each at another amplitude"));
    }
    Ok(constraint)
}

fn unit(mode: &[f64]) -> Vec<f64> {
    let norm = mode.iter().map(|x| x * x).sum::<f64>().sqrt();
    mode.iter().map(|x| x / norm).collect()
}

/// Orthonormal modes, as many as move; mass-weighted ones are turned orthonormal in displacement.
fn complete(modes: &[Vec<f64>], rank: usize) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for mode in &modes[..rank.min(modes.len())] {
        let mut v = mode.clone();
        for u in &out {
            let dot: f64 = v.iter().zip(u).map(|(a, b)| a * b).sum();
            v.iter_mut().zip(u).for_each(|(a, b)| *a -= dot * b);
        }
        if v.iter().any(|x| x.abs() > 1e-9) {
            out.push(unit(&v));
        }
    }
    out
}

/// The rig file's system where it is one whose equations are known and its coordinates are
/// measured, in their order.
fn known_system(rig: &Rig, gathered: &Gathered) -> Option<Box<dyn Mechanical>> {
    systems::by_id(&rig.model).filter(|s| s.coordinates() == gathered.names)
}

/// Energies, normal-mode members and Floquet multipliers for the releases. All none where the
/// equations do not fit the record.
fn compare_with_full(
    system: &dyn Mechanical,
    gathered: &Gathered,
    described: &mut [Release],
    entries: &[Entry],
) -> Vec<Option<Member>> {
    let energies: Vec<f64> = entries
        .iter()
        .map(|Entry { release, fit, beyond_noise, .. }| {
            // At rest at phase 0 where the motion is on a mode; for others the first sample, from
            // rest, is the better witness.
            let n = gathered.names.len();
            let rest: Vec<f64> = (0..n).map(|c| fit.motion(c, 0.0)[0]).collect();
            let first: Vec<f64> = (0..n).map(|c| gathered.releases[*release][c][0]).collect();
            system.potential(if *beyond_noise < releases::PERIODIC { &rest } else { &first })
        })
        .collect();
    let family = normal_mode::family(system, &energies);
    let mut out = vec![None; described.len()];
    for (i, e) in energies.iter().enumerate() {
        let Some(member) = family.iter().find(|m| (m.energy / e - 1.0).abs() < 1e-12) else { continue };
        if (member.omega / entries[i].fit.omega - 1.0).abs() > 0.02 {
            continue;
        }
        let release = &mut described[i];
        release.energy = Some(*e);
        if system.size() <= 8 {
            release.floquet = normal_mode::multipliers(system, member).and_then(|m| m.first().copied());
        }
        if release.floquet.is_some_and(|f| f > UNSTABLE) {
            release.remarks.push("unstable");
            release.used = false;
        }
        out[i] = Some(member.clone());
    }
    out
}

fn remark_warning(r: &Release) -> Warning {
    let who = format!("release {} of {} (amplitude {:.4})", r.segment + 1, r.file, r.amplitude);
    let mut what: Vec<String> = Vec::new();
    for remark in &r.remarks {
        what.push(match *remark {
            "off-mode" => format!(
                "leaves {:.1} % beyond the sensors' noise that is not periodic: it is off the mode",
                100.0 * r.beyond_noise
            ),
            "unstable" => {
                format!("lies where the mode is unstable (Floquet multiplier {:.2})", r.floquet.unwrap_or(f64::NAN))
            }
            "growing" => "departs from its periodic motion as time goes on".to_owned(),
            "asymmetric" => format!("is asymmetric (even harmonics {:.1} %)", 100.0 * r.even_harmonics),
            _ => format!("does not pass through rest (parts out of phase {:.1} %)", 100.0 * r.out_of_phase),
        });
    }
    let advice = if r.used {
        "It is used; see whether its neighbours agree"
    } else {
        "It is left out of the model; release it closer to the mode"
    };
    Warning::new("release", format!("{who} {}", what.join(" and ")), advice)
}

/// The model of a constraint; none where there is no periodic motion to make it of.
fn make<'a>(constraint: Constraint, evidence: &Evidence<'a>) -> Option<Made<'a>> {
    let Evidence { entries, used, periodic, basis, major, system, .. } = *evidence;
    if !periodic || used.is_empty() {
        return None;
    }
    let fits: Vec<&ReleaseFit> = used.iter().map(|i| &entries[*i].fit).collect();
    if constraint == Constraint::Polar {
        let nodes: Vec<Node> = fits.iter().map(|f| Node::of(f, major)).collect();
        let linear = system.and_then(normal_mode::linear_mode);
        let decays = entries.iter().any(|e| e.decaying);
        // Nodes of decays scatter, and leave no gaps: then the variational frequency stands alone.
        return match system {
            Some(system) if !decays => {
                polar::model_with(&nodes, major, system, linear).map(|(p, all)| Made::Polar(p, all, Some(system)))
            }
            _ => polar::model(&nodes, major, linear)
                .map(|p| Made::Polar(p, if decays { Vec::new() } else { nodes }, system)),
        };
    }
    let (orbits, time_unit) = added_constraint::orbits(&fits, basis, true);
    // Free motion is reversible: terms even in velocity only.
    let even = |y, velocity| Function::Monomial { y, velocity, z: 0 };
    let surface = [even(1, 0), even(2, 0), even(3, 0), even(0, 2), even(1, 2)];
    let (constraint, equation) = match constraint {
        Constraint::None => (Vec::new(), vec![even(1, 0), even(2, 0), even(3, 0)]),
        Constraint::Type1 => (surface.to_vec(), vec![even(1, 0), even(2, 0), even(3, 0)]),
        _ => (surface.to_vec(), added_constraint::type2_equation(true)),
    };
    added_constraint::select(&orbits, basis, time_unit, &constraint, &equation).map(|(m, _)| Made::Polynomial(m))
}

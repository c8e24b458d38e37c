//! What a reduced model is worth: its frequency–energy curve beside the full system's, its errors,
//! and what the figures show of them.

use std::f64::consts::TAU;

use super::model::{Made, Plots};
use super::normal_mode::{self, Member};
use super::polar::{self, Node, Polar};
use super::release_fit::ReleaseFit;
use super::releases::Gathered;
use super::systems::Mechanical;
use super::{ReduceSettings, Reduction};

/// Points of a frequency–energy curve, besides the releases.
const CURVE: usize = 24;
/// Periods over which time histories are compared.
const HISTORY: f64 = 10.0;

/// Greatest relative error of the variational frequency at a release that the model was made
/// without, its ends excepted (beyond them a model is not to be used). None for fewer than four
/// releases, and for decays, whose windows overlap.
fn left_out(polar: &Polar, nodes: &[Node], system: &dyn Mechanical) -> Option<f64> {
    let mut nodes = nodes.to_vec();
    nodes.sort_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
    if nodes.len() < 4 {
        return None;
    }
    (1..nodes.len() - 1)
        .map(|i| {
            let mut rest = nodes.clone();
            let node = rest.remove(i);
            let linear = normal_mode::linear_mode(system, 0);
            let (model, all) = polar::model_with(&rest, &polar.major, system, linear)?;
            Some((model.corrected_omega(system, &all, node.amplitude)? / node.omega - 1.0).abs())
        })
        .collect::<Option<Vec<f64>>>()
        .map(|e| e.into_iter().fold(0.0, f64::max))
}

/// Fills in the frequency–energy curve, the errors and the figures.
pub(super) fn judge(
    out: &mut Reduction,
    made: &Made<'_>,
    gathered: &Gathered,
    with_fit: &[(usize, &ReleaseFit)],
    branch: &[Option<Member>],
    basis: &[Vec<f64>],
    system: Option<&dyn Mechanical>,
    settings: &ReduceSettings,
) {
    let major = &basis[0];
    let dot = |x: &[f64], p: &[f64]| x.iter().zip(p).map(|(a, b)| a * b).sum::<f64>();
    // Amplitude of each release in the model's own measure.
    let amplitudes: Vec<f64> = with_fit
        .iter()
        .enumerate()
        .map(|(i, (_, fit))| match made {
            Made::Polar(..) => out.releases[i].amplitude,
            Made::Polynomial(_) => (0..major.len()).map(|c| fit.motion(c, 0.0)[0] * major[c]).sum(),
        })
        .collect();
    let used: Vec<usize> = (0..amplitudes.len()).filter(|i| out.releases[*i].used).collect();
    let low = used.iter().map(|i| amplitudes[*i]).fold(f64::INFINITY, f64::min);
    let high = used.iter().map(|i| amplitudes[*i]).fold(0.0, f64::max);
    let grid: Vec<f64> = (0..=CURVE).map(|i| low * (high / low).powf(i as f64 / CURVE as f64)).collect();
    out.error.range = Some(match made {
        Made::Polar(p, ..) => p.range,
        Made::Polynomial(_) => [low, high],
    });
    if let Made::Polar(p, nodes, system) = made {
        // The releases' nodes stand before those from the equations.
        let measured = &nodes[..nodes.len().min(used.len())];
        out.error.left_out = system.and_then(|s| left_out(p, measured, s)).or(p.left_out);
    } else {
        out.error.stable = Some(grid.iter().all(|a| made.omega(*a).is_some()));
    }
    match system {
        Some(system) => {
            let mut energies: Vec<f64> = grid.iter().map(|a| system.potential(&made.rest(*a))).collect();
            energies.extend(out.releases.iter().filter_map(|r| r.energy));
            energies.sort_by(f64::total_cmp);
            energies.dedup();
            let family = normal_mode::family(system, 0, &energies);
            let mut worst: Option<f64> = None;
            for m in &family {
                out.frequency_energy.full.push([m.energy, m.omega / TAU]);
                let a = polar::bisect(|a| system.potential(&made.rest(a)), m.energy, 1.5 * high);
                let Some(omega) = a.and_then(|a| made.omega(a)) else { continue };
                out.frequency_energy.reduced.push([m.energy, omega / TAU]);
                if branch.iter().flatten().any(|b| (b.energy / m.energy - 1.0).abs() < 1e-12) {
                    let error = (omega / m.omega - 1.0).abs();
                    worst = Some(worst.map_or(error, |w| w.max(error)));
                }
            }
            out.error.frequency = worst;
            out.frequency_energy.source = "shooting";
            out.frequency_energy.energy_unit = "the full system's";
        }
        None => {
            let masses = settings.masses.as_deref();
            let energy = |a: &[f64]| -> Vec<f64> {
                match made {
                    Made::Polar(p, ..) => p.energies(a, masses),
                    // Of the major coordinate's equation, at rest: −∫ÿ dy.
                    Made::Polynomial(m) => a
                        .iter()
                        .map(|a| {
                            let n = 200;
                            let h = a / f64::from(n);
                            -(0..n).map(|i| m.acceleration((f64::from(i) + 0.5) * h, 0.0) * h).sum::<f64>()
                                * m.time_unit.powi(2)
                        })
                        .collect(),
                }
            };
            let mut worst = 0.0_f64;
            let mut order = used.clone();
            order.sort_by(|a, b| amplitudes[*a].total_cmp(&amplitudes[*b]));
            let at_releases = energy(&order.iter().map(|i| amplitudes[*i]).collect::<Vec<_>>());
            for (i, e) in order.iter().zip(at_releases) {
                out.releases[*i].energy = Some(e);
                out.frequency_energy.full.push([e, with_fit[*i].1.omega / TAU]);
                worst = match made.omega(amplitudes[*i]) {
                    Some(omega) => worst.max((omega / with_fit[*i].1.omega - 1.0).abs()),
                    None => f64::INFINITY,
                };
            }
            for (a, e) in grid.iter().zip(energy(&grid)) {
                if let Some(omega) = made.omega(*a) {
                    out.frequency_energy.reduced.push([e, omega / TAU]);
                }
            }
            // A model that meets its nodes says nothing by meeting them: a release left out does.
            let told = out.error.left_out.or(matches!(made, Made::Polynomial(_)).then_some(0.0));
            out.error.frequency = told.filter(|_| worst.is_finite()).map(|l| worst.max(l));
            out.frequency_energy.source = "releases";
            out.frequency_energy.energy_unit =
                if masses.is_some() { "kg × (channel's unit/s)²" } else { "(channel's unit/s)², unit masses" };
        }
    }
    out.error.time_history = vec![None; with_fit.len()];
    for (i, (r, fit)) in with_fit.iter().enumerate() {
        // A window of a decay has no ten periods of one amplitude.
        if out.releases[i].remarks.contains(&"decaying") {
            continue;
        }
        let x = &gathered.releases[*r];
        let length = x[0].len();
        // Polynomial models start from rest: at the first phase 0 in the record.
        let turns_to_rest = (-fit.phase / TAU).rem_euclid(1.0);
        let mut offset = (turns_to_rest * TAU / fit.omega / gathered.step).round() as usize;
        if turns_to_rest > 0.999 {
            offset = 0;
        }
        let count = ((HISTORY * TAU / fit.omega / gathered.step) as usize).min(length.saturating_sub(offset));
        let phase = fit.phase + fit.omega * offset as f64 * gathered.step;
        let a = match made {
            Made::Polar(..) => amplitudes[i],
            Made::Polynomial(_) => dot(&x.iter().map(|c| c[offset.min(length - 1)]).collect::<Vec<_>>(), major),
        };
        let Some(model) = made.history(a, phase, gathered.step, count) else { continue };
        // The release's mean is its own matter where the model knows none.
        let (mut e, mut s) = (0.0, 0.0);
        for (k, at) in model.iter().enumerate() {
            for c in 0..x.len() {
                e += (at[c] - x[c][offset + k]).powi(2);
                s += x[c][offset + k].powi(2);
            }
        }
        out.error.time_history[i] = (s > 0.0).then(|| (e / s).sqrt());
        plot(&mut out.plots, gathered, x, &model, basis, offset, (3.0 * TAU / fit.omega / gathered.step) as usize);
    }
}

fn plot(
    plots: &mut Plots,
    gathered: &Gathered,
    x: &[Vec<f64>],
    model: &[Vec<f64>],
    basis: &[Vec<f64>],
    offset: usize,
    count: usize,
) {
    let project = |at: &dyn Fn(usize) -> f64, p: &[f64]| -> f64 { p.iter().enumerate().map(|(c, p)| p * at(c)).sum() };
    let count = count.min(model.len());
    let mut history = [Vec::new(), Vec::new(), Vec::new()];
    let mut shape = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
    for k in 0..count {
        let (measured, of_model) = (|c: usize| x[c][offset + k], |c: usize| model[k][c]);
        history[0].push(k as f64 * gathered.step);
        history[1].push(project(&measured, &basis[0]));
        history[2].push(project(&of_model, &basis[0]));
        shape[0].push(project(&measured, &basis[0]));
        shape[2].push(project(&of_model, &basis[0]));
        if let Some(minor) = basis.get(1) {
            shape[1].push(project(&measured, minor));
            shape[3].push(project(&of_model, minor));
        }
    }
    plots.histories.push(history);
    plots.shapes.push(shape);
}

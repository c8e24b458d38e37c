//! What a reduced model is worth: its frequency–energy curve beside the full system's, its errors,
//! and what the figures show of them.

use std::f64::consts::TAU;

use super::Reduction;
use super::model::{Evidence, Made, Plots};
use super::normal_mode::{self, Member};
use super::polar::{self, Node, Polar};
use super::releases::Entry;
use super::systems::Mechanical;

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
            let linear = normal_mode::linear_mode(system);
            let (model, all) = polar::model_with(&rest, &polar.major, system, linear)?;
            Some((model.corrected_omega(system, &all, node.amplitude)? / node.omega - 1.0).abs())
        })
        .collect::<Option<Vec<f64>>>()
        .map(|e| e.into_iter().fold(0.0, f64::max))
}

/// Fills in the frequency–energy curve, the errors and the figures.
pub(super) fn judge(out: &mut Reduction, made: &Made<'_>, evidence: &Evidence<'_>) {
    let amplitudes = Amplitudes::of(out, made, evidence);
    out.error.range = Some(match made {
        Made::Polar(p, ..) => p.range,
        Made::Polynomial(_) => [amplitudes.low, amplitudes.high],
    });
    if let Made::Polar(p, nodes, system) = made {
        // The releases' nodes stand before those from the equations.
        let measured = &nodes[..nodes.len().min(evidence.used.len())];
        out.error.left_out = system.and_then(|s| left_out(p, measured, s)).or(p.left_out);
    } else {
        out.error.stable = Some(amplitudes.grid.iter().all(|a| made.omega(*a).is_some()));
    }
    match evidence.system {
        Some(system) => against_equations(out, made, evidence.branch, system, &amplitudes),
        None => against_releases(out, made, evidence, &amplitudes),
    }
    time_histories(out, made, evidence, &amplitudes);
}

/// Amplitudes in the model's own measure.
struct Amplitudes {
    /// Of each release.
    releases: Vec<f64>,
    /// The least and the greatest that the model was made with.
    low: f64,
    high: f64,
    /// Points of a curve between them.
    grid: Vec<f64>,
}

impl Amplitudes {
    fn of(out: &Reduction, made: &Made<'_>, evidence: &Evidence<'_>) -> Self {
        let major = &evidence.basis[0];
        let measure = |(i, entry): (usize, &Entry)| match made {
            Made::Polar(..) => out.releases[i].amplitude,
            Made::Polynomial(_) => (0..major.len()).map(|c| entry.fit.motion(c, 0.0)[0] * major[c]).sum(),
        };
        let releases: Vec<f64> = evidence.entries.iter().enumerate().map(measure).collect();
        let used = || evidence.used.iter().map(|i| releases[*i]);
        let (low, high) = (used().fold(f64::INFINITY, f64::min), used().fold(0.0, f64::max));
        let grid = (0..=CURVE).map(|i| low * (high / low).powf(i as f64 / CURVE as f64)).collect();
        Self { releases, low, high, grid }
    }
}

/// Frequency against energy beside the full system's normal mode, and the greatest error at the
/// releases' energies (`branch`: the mode's motions there).
fn against_equations(
    out: &mut Reduction,
    made: &Made<'_>,
    branch: &[Option<Member>],
    system: &dyn Mechanical,
    amplitudes: &Amplitudes,
) {
    let mut energies: Vec<f64> = amplitudes.grid.iter().map(|a| system.potential(&made.rest(*a))).collect();
    energies.extend(out.releases.iter().filter_map(|r| r.energy));
    energies.sort_by(f64::total_cmp);
    energies.dedup();
    let mut worst: Option<f64> = None;
    for m in &normal_mode::family(system, &energies) {
        out.frequency_energy.full.push([m.energy, m.omega / TAU]);
        let a = polar::bisect(|a| system.potential(&made.rest(a)), m.energy, 1.5 * amplitudes.high);
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

/// Energies of a model at amplitudes, where no equations are known.
fn energies(made: &Made<'_>, amplitudes: &[f64], masses: Option<&[f64]>) -> Vec<f64> {
    match made {
        Made::Polar(p, ..) => p.energies(amplitudes, masses),
        // Of the major coordinate's equation, at rest: −∫ÿ dy.
        Made::Polynomial(m) => amplitudes
            .iter()
            .map(|a| {
                let n = 200;
                let h = a / f64::from(n);
                -(0..n).map(|i| m.acceleration((f64::from(i) + 0.5) * h, 0.0) * h).sum::<f64>() * m.time_unit.powi(2)
            })
            .collect(),
    }
}

/// Frequency against energy beside the releases' own.
fn against_releases(out: &mut Reduction, made: &Made<'_>, evidence: &Evidence<'_>, amplitudes: &Amplitudes) {
    let masses = evidence.masses;
    let mut worst = 0.0_f64;
    let mut order = evidence.used.to_vec();
    order.sort_by(|a, b| amplitudes.releases[*a].total_cmp(&amplitudes.releases[*b]));
    let at_releases: Vec<f64> = order.iter().map(|i| amplitudes.releases[*i]).collect();
    for (i, e) in order.iter().zip(energies(made, &at_releases, masses)) {
        let measured = evidence.entries[*i].fit.omega;
        out.releases[*i].energy = Some(e);
        out.frequency_energy.full.push([e, measured / TAU]);
        worst = match made.omega(amplitudes.releases[*i]) {
            Some(omega) => worst.max((omega / measured - 1.0).abs()),
            None => f64::INFINITY,
        };
    }
    for (a, e) in amplitudes.grid.iter().zip(energies(made, &amplitudes.grid, masses)) {
        if let Some(omega) = made.omega(*a) {
            out.frequency_energy.reduced.push([e, omega / TAU]);
        }
    }
    // A model that meets its nodes says nothing by meeting them: a release left out does.
    let independent = out.error.left_out.or(matches!(made, Made::Polynomial(_)).then_some(0.0));
    out.error.frequency = independent.filter(|_| worst.is_finite()).map(|l| worst.max(l));
    out.frequency_energy.source = "releases";
    out.frequency_energy.energy_unit =
        if masses.is_some() { "kg × (channel's unit/s)²" } else { "(channel's unit/s)², unit masses" };
}

/// The model's motion beside each release's over ten periods.
fn time_histories(out: &mut Reduction, made: &Made<'_>, evidence: &Evidence<'_>, amplitudes: &Amplitudes) {
    let Evidence { gathered, entries, basis, .. } = *evidence;
    let (major, step) = (&basis[0], gathered.step);
    out.error.time_history = vec![None; entries.len()];
    for (i, Entry { release, fit, .. }) in entries.iter().enumerate() {
        // A window of a decay has no ten periods of one amplitude.
        if out.releases[i].remarks.contains(&"decaying") {
            continue;
        }
        let x = &gathered.releases[*release];
        let length = x[0].len();
        // Polynomial models start from rest: at the first phase 0 in the record.
        let turns_to_rest = (-fit.phase / TAU).rem_euclid(1.0);
        let mut offset = (turns_to_rest * TAU / fit.omega / step).round() as usize;
        if turns_to_rest > 0.999 {
            offset = 0;
        }
        let count = ((HISTORY * TAU / fit.omega / step) as usize).min(length.saturating_sub(offset));
        let phase = fit.phase + fit.omega * offset as f64 * step;
        let at_rest = |c: &Vec<f64>| c[offset.min(length - 1)];
        let a = match made {
            Made::Polar(..) => amplitudes.releases[i],
            Made::Polynomial(_) => x.iter().map(at_rest).zip(major).map(|(a, b)| a * b).sum(),
        };
        let Some(model) = made.history(a, phase, step, count) else { continue };
        let both = Histories { measured: x, offset, model: &model, step };
        out.error.time_history[i] = both.error();
        both.plot(&mut out.plots, basis, (3.0 * TAU / fit.omega / step) as usize);
    }
}

/// A release and the model's motion.
struct Histories<'a> {
    /// `[channel][sample]`.
    measured: &'a [Vec<f64>],
    /// The sample with which the model begins.
    offset: usize,
    /// `[sample][channel]`.
    model: &'a [Vec<f64>],
    /// Sampling step, s.
    step: f64,
}

impl Histories<'_> {
    /// Relative error of all channels. The release's mean is its own matter where the model knows
    /// none.
    fn error(&self) -> Option<f64> {
        let (mut e, mut s) = (0.0, 0.0);
        for (k, at) in self.model.iter().enumerate() {
            for (x, y) in self.measured.iter().zip(at) {
                e += (y - x[self.offset + k]).powi(2);
                s += x[self.offset + k].powi(2);
            }
        }
        (s > 0.0).then(|| (e / s).sqrt())
    }

    /// The first samples in the coordinates of the modes.
    fn plot(&self, plots: &mut Plots, basis: &[Vec<f64>], count: usize) {
        let project =
            |at: &dyn Fn(usize) -> f64, p: &[f64]| -> f64 { p.iter().enumerate().map(|(c, p)| p * at(c)).sum() };
        let mut history = [Vec::new(), Vec::new(), Vec::new()];
        let mut shape = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
        for k in 0..count.min(self.model.len()) {
            let (measured, of_model) = (|c: usize| self.measured[c][self.offset + k], |c: usize| self.model[k][c]);
            history[0].push(k as f64 * self.step);
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
}

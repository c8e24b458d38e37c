//! Where what is left sits: the residual of each equation of motion against the position and
//! velocity of every joint, the velocity of every arm, the drive's phase and time.
//!
//! r_e = D_e (Σ λ X − Y) with smoothed coordinates, rates and accelerations, a force or torque
//! where the equation's inertia D_e is known. Bins and bands are those of [`super::residual_map`].

use nalgebra::DVector;

use super::axes;
use super::given;
use super::power::{Power, Repeats};
use super::residual_map::{Map, Residual, Where, together};
use super::setting::{Lines, Setting};
use super::state::State;
use crate::effects::on_a_frame;
use crate::effects::written::{balance_scale, balance_unit as unit_of};
use crate::identify::balance_error::strong_series;
use crate::identify::stretches::Stretch;
use crate::identify::units::channel_units;
use crate::model::model_file::Space;
use crate::model::model_file::expression::{Node, add, multiply, number};
use crate::model::model_file::tape::Tape;
use crate::signal::spectrum;
use crate::system::mechanism::{Mechanism, at};
use crate::system::polynomial::Polynomial;

/// The residual of every equation with coefficients `x`.
fn residuals(setting: &Setting<'_>, state: &State, x: &DVector<f64>) -> Vec<Node> {
    let model = setting.model();
    let omega = setting.rig.omega();
    let mut k = state.values.len();
    let values = setting.own.coefficients(&x.as_slice()[..k], 0);
    let places = model.term_places();
    let mut out: Vec<Node> = model
        .equations
        .iter()
        .zip(&places)
        .map(|(e, at)| {
            let balance = multiply(number(-1.0), model.in_seconds(&e.balance, omega));
            let terms = e.terms.iter().zip(at);
            terms.fold(balance, |sum, (t, &i)| add(sum, multiply(number(values[i]), model.in_seconds(&t.of, omega))))
        })
        .collect();
    for chosen in &state.chosen {
        for column in chosen.candidate.columns(setting, state) {
            if !chosen.candidate.is_applied() {
                for (e, of) in column {
                    out[e] = add(out[e].clone(), multiply(number(x[k]), of));
                }
            }
            k += 1;
        }
    }
    out
}

/// Unit of what stands on the right-hand side of a written equation, in seconds.
pub fn balance_unit(setting: &Setting<'_>, equation: usize) -> String {
    let (coordinates, inputs) = channel_units(setting.model(), setting.rig, setting.whole);
    unit_of(setting.model(), setting.rig.omega(), equation, &coordinates, &inputs)
}

/// Least and greatest value of an expression over the record.
pub fn range(setting: &Setting<'_>, state: &State, of: &Node) -> (f64, f64) {
    let tape = Tape::new(core::slice::from_ref(of));
    let kernels = &setting.geometry.kernels;
    let all = state.stretches.iter().flat_map(|s| strong_series(s, s.len(), &tape, kernels, &setting.circle)).flatten();
    all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

/// Most lines of an equation's residual, and how far they stand above their surroundings: noise has
/// some that do, which the decision passes over.
const MOST_LINES: usize = 4;
const PROMINENT: f64 = 8.0;

/// The most prominent lines of a series up to a frequency, Hz.
fn lines_of(series: &[f64], rate_hz: f64, most_hz: f64) -> Vec<f64> {
    // One piece, so that lines are as narrow as the record allows.
    let Ok(density) = spectrum::welch(&[series], rate_hz, spectrum::fast_length(series.len())) else {
        return Vec::new();
    };
    let d = &density.density;
    let peaks = (3..d.len().saturating_sub(1)).filter(|&m| d[m] > d[m - 1] && d[m] >= d[m + 1]);
    let mut found: Vec<spectrum::Line> = peaks
        .take_while(|m| density.frequency(*m) < most_hz)
        .filter_map(|m| spectrum::line_at(&density, m))
        .filter(|l| l.prominence > PROMINENT)
        .collect();
    found.sort_by(|a, b| b.prominence.total_cmp(&a.prominence));
    found.iter().take(MOST_LINES).map(|l| l.frequency_hz).collect()
}

/// Pieces of a series whose spectra are averaged where what rings is looked for, and most
/// frequencies that are returned.
const PIECES: usize = 12;
const MOST_RINGS: usize = 3;

/// Where a series rings, Hz: the peaks that stand highest above their surroundings within half
/// their frequency. There always are some; the decision passes over those of noise.
fn rings_of(series: &[f64], rate_hz: f64, most_hz: f64) -> Vec<f64> {
    let piece = spectrum::fast_length(series.len() / PIECES);
    let Ok(density) = spectrum::welch(&[series], rate_hz, piece) else { return Vec::new() };
    let d = &density.density;
    let mut found: Vec<(f64, f64)> = (3..d.len().saturating_sub(1))
        .take_while(|m| density.frequency(*m) < most_hz)
        .filter(|&m| d[m] > d[m - 1] && d[m] >= d[m + 1])
        .map(|m| (d[m] / spectrum::surroundings(d, m, (m / 2).max(6)).max(f64::MIN_POSITIVE), density.frequency(m)))
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.iter().take(MOST_RINGS).map(|f| f.1).collect()
}

/// Frequencies, Hz, of lines in what is left of the longest stretch, up to where the low-pass lets
/// motion through; none where no effect asks for them.
pub fn lines(setting: &Setting<'_>, state: &State) -> Lines {
    let longest = state.stretches.iter().max_by_key(|s| s.len()).filter(|_| setting.looks_at_lines());
    let (mut out, Some(stretch)) = (Lines::default(), longest) else { return Lines::default() };
    let left = residuals(setting, state, &given::coefficients(state));
    let omega = setting.rig.omega();
    let of_frame = |m: &Mechanism| on_a_frame::shaken(m, &state.physical.values, omega, &left);
    let frame = setting.mechanism().map_or_else(Vec::new, of_frame);
    let tape = Tape::new(&[&left[..], &frame].concat());
    let kernels = &setting.geometry.kernels;
    let (rate_hz, most_hz) = (1.0 / stretch.step_s, kernels.full.pass_hz);
    for (k, series) in strong_series(stretch, stretch.len(), &tape, kernels, &setting.circle).iter().enumerate() {
        if k < left.len() {
            out.of_forces.extend(lines_of(series, rate_hz, most_hz));
        } else {
            out.of_frame.extend(rings_of(series, rate_hz, most_hz));
        }
    }
    // One that rings faster than is seen only yields.
    out.of_frame.extend((!frame.is_empty()).then_some(most_hz));
    let apart_hz = |pieces: usize| pieces as f64 / (stretch.len() as f64 * stretch.step_s);
    for (list, apart_hz) in [(&mut out.of_forces, apart_hz(1)), (&mut out.of_frame, apart_hz(2 * PIECES))] {
        list.sort_by(f64::total_cmp);
        list.dedup_by(|a, b| (*a - *b).abs() < apart_hz);
    }
    out
}

/// What turns each equation into the unit that its residual is told in: its inertia where that is
/// known.
fn scales(setting: &Setting<'_>, state: &State) -> Vec<(f64, String)> {
    let Some(mechanism) = setting.mechanism() else { return Vec::new() };
    let of = |(e, (coordinate, inertia)): (usize, &(usize, Polynomial))| {
        let circle = setting.model().coordinates[*coordinate].space == Space::Circle;
        let known = !state.physical.open.get(e).copied().unwrap_or(true);
        let inertia = at(inertia, &state.physical.values);
        match (circle, known) {
            _ if setting.is_written() => {
                let scale = balance_scale(setting.model(), setting.rig.omega(), e);
                (if known { inertia } else { scale }, balance_unit(setting, e))
            }
            (true, true) => (inertia, "N m".to_owned()),
            (true, false) => (1.0, "rad/s²".to_owned()),
            (false, true) => (inertia, "N".to_owned()),
            (false, false) => (1.0, "m/s²".to_owned()),
        }
    };
    mechanism.scales.iter().enumerate().map(of).collect()
}

/// Maps of all equations against all coordinates, and against frequency where the rows are known,
/// and the places where they clearly disagree, largest first.
pub fn maps(
    setting: &Setting<'_>,
    state: &State,
    x: &DVector<f64>,
    repeats: &Repeats,
    rows: Option<&Power>,
) -> (Vec<Map>, Vec<Where>) {
    let axes = axes::all(setting);
    let nodes: Vec<Node> = axes.iter().map(|a| a.of.clone()).collect();
    let scales = scales(setting, state);
    let residuals: Vec<Node> =
        residuals(setting, state, x).into_iter().zip(&scales).map(|(r, s)| multiply(number(s.0), r)).collect();
    let count = residuals.len();
    let tape = Tape::new(&[residuals, nodes].concat());
    let kernels = &setting.geometry.kernels;
    let all = |stretches: &[Stretch]| -> Vec<Vec<f64>> {
        let parts: Vec<Vec<Vec<f64>>> =
            stretches.iter().map(|s| strong_series(s, s.len(), &tape, kernels, &setting.circle)).collect();
        (0..tape.len()).map(|k| parts.iter().flat_map(|p| p[k].iter().copied()).collect()).collect()
    };
    let (values, clean) = (all(&state.stretches), all(&repeats.truth));
    let mut noise: Vec<Vec<Vec<f64>>> = vec![Vec::new(); count];
    for measured in &repeats.measured {
        let noisy = all(measured);
        for (e, noise) in noise.iter_mut().enumerate() {
            noise.push(noisy[e].iter().zip(&clean[e]).map(|(a, b)| a - b).collect());
        }
    }
    let (mut maps, mut places) = (Vec::new(), Vec::new());
    for (e, (_, unit)) in scales.iter().enumerate() {
        let residual = Residual { equation: e + 1, unit, values: &values[e], noise: &noise[e] };
        residual.against(&axes, &values[count..], &clean[count..], &mut maps, &mut places);
    }
    let by_frequency = |power: &Power| power.by_frequency(setting.geometry.windows.length_s, &scales);
    let (more, lines) = rows.map(by_frequency).unwrap_or_default();
    maps.extend(more);
    (maps, together(places, lines))
}

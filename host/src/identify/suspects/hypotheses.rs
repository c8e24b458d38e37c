//! What is tried on a record that its equations do not fit, and where the search for a number
//! begins.

use core::f64::consts::{PI, TAU};

use super::scene::Scene;
use super::undo::Undo;
use crate::model::model_file::Space;
use crate::rig::Channel;
use crate::rig::computed::share_a_column;

/// Counts a turn that encoders are sold with, lines and their quadrature.
pub(crate) const COUNTS: [u32; 32] = [
    100, 128, 200, 250, 256, 360, 400, 500, 512, 600, 720, 800, 1000, 1024, 1200, 1250, 1440, 1600, 1800, 2000, 2048,
    2400, 2500, 3600, 4000, 4096, 5000, 7200, 8000, 8192, 10_000, 16_384,
];
/// Steps of a search on either side.
const STEPS: i32 = 12;
/// Turns that a step of the search moves an angle or the drive's phase at most: an eighth leaves
/// the equations within a Gauss–Newton step.
const TURN_STEP: f64 = 0.25;
/// Coarsest step of a scale.
const SCALE_STEP: f64 = 0.02;
/// Lags that are tried, samples.
const LAGS: [f64; 8] = [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0, 25.0];
/// Longest lag that is looked at, samples.
const MOST_LAG: f64 = 64.0;

/// Names of the signals and what the rig file says of them: sensors, then inputs.
pub(super) fn channels(scene: &Scene) -> Vec<&Channel> {
    scene.bound.sensors.iter().chain(&scene.bound.inputs).map(|&i| &scene.rig.channel[i]).collect()
}

/// Whether a sensor shows angles alone.
pub(super) fn is_angle(scene: &Scene, sensor: usize) -> bool {
    let coordinates = &scene.bound.model.coordinates;
    (0..coordinates.len()).all(|k| scene.bound.shown[(sensor, k)] == 0.0 || coordinates[k].space == Space::Circle)
}

/// Sensors taken one by one, and all together.
fn sets(sensors: usize) -> Vec<Vec<usize>> {
    let mut out: Vec<Vec<usize>> = (0..sensors).map(|i| vec![i]).collect();
    if sensors > 1 {
        out.push((0..sensors).collect());
    }
    out
}

/// Statements of the rig file that are wrong as a whole: exchanged, reversed, relative, another
/// unit or number of counts.
pub(super) fn statements(scene: &Scene) -> Vec<Undo> {
    let n = scene.sensors.sigma.len();
    let channels = channels(scene);
    let mut out = Vec::new();
    for a in 0..channels.len() {
        // Amperes taken for counts would leave a motion that is nothing but noise, which any
        // equations fit; and a sine in the place of a motion fits all that have a stiffness: an input
        // is not taken for one.
        let of_its_kind = |b: &usize| channels[*b].unit == channels[a].unit && (a < n) == (*b < n);
        for b in (a + 1..channels.len()).filter(of_its_kind) {
            out.push(Undo::Exchange(a, b, channels[b].scale() / channels[a].scale()));
        }
    }
    out.extend((0..n).map(Undo::Reverse));
    for a in (0..n).filter(|a| is_angle(scene, *a)) {
        for b in (0..n).filter(|b| *b != a && is_angle(scene, *b)) {
            // What shows a difference may be absolute, and what shows one angle may be relative.
            let relative = scene.bound.shown.row(a).iter().filter(|x| **x != 0.0).count() > 1;
            out.push(Undo::Against(a, b, if relative { -1.0 } else { 1.0 }));
        }
    }
    for set in sets(n) {
        let all = |f: &dyn Fn(&Channel) -> bool| set.iter().all(|&i| f(channels[i]));
        for (unit, factor) in [("rad", 180.0 / PI), ("deg", PI / 180.0), ("mm", 1e-3), ("m", 1e3)] {
            if all(&|c| c.unit == unit) {
                out.push(Undo::Unit(set.clone(), factor));
            }
        }
        let counts = channels[set[0]].counts_per_turn.unwrap_or(0);
        if counts > 0 && all(&|c| c.counts_per_turn == Some(counts)) {
            let quarters = [4, 2].into_iter().filter(|k| counts.is_multiple_of(*k)).map(|k| counts / k);
            let multiples = [2, 4].into_iter().filter_map(|k| counts.checked_mul(k));
            let near = COUNTS.into_iter().filter(|c| (0.4..2.5).contains(&(f64::from(*c) / f64::from(counts))));
            let mut list: Vec<u32> = quarters.chain(multiples).chain(near).filter(|c| *c != counts).collect();
            list.sort_unstable();
            list.dedup();
            out.extend(list.into_iter().map(|c| Undo::Scale(set.clone(), f64::from(c) / f64::from(counts))));
        }
    }
    if let Some(drive) = scene.rig.drive.filter(|_| scene.bound.model.uses_phase()) {
        let omega = TAU * drive.frequency_hz;
        out.extend([1.0, -0.5].map(|f| Undo::Drive(f * omega)));
    }
    out
}

/// Steps of a search to either side.
fn around() -> impl Iterator<Item = f64> + Clone {
    (1..=STEPS).flat_map(|k| [f64::from(k), -f64::from(k)])
}

/// Kinds of mistakes that are a number, each with the number that changes nothing.
pub(super) fn kinds(scene: &Scene) -> Vec<Undo> {
    let mut out = Vec::new();
    if scene.bound.model.uses_phase() && scene.rig.drive.is_some() {
        out.push(Undo::Drive(0.0));
    }
    let most_s = MOST_LAG * scene.stretches.first().map_or(0.0, |s| s.step_s);
    let channels = channels(scene);
    let own = (1..channels.len()).filter(|&k| !share_a_column(channels[0], channels[k]));
    out.extend(own.map(|signal| Undo::Lag { signal, delay_s: 0.0, drift: 0.0, most_s }));
    let angles = |set: &Vec<usize>| set.iter().all(|&i| is_angle(scene, i));
    out.extend(sets(scene.sensors.sigma.len()).into_iter().filter(angles).map(|set| Undo::Scale(set, 1.0)));
    out
}

/// Places at which the search for a drive frequency or a lag begins.
pub(super) fn search_time(scene: &Scene) -> Vec<Undo> {
    let span_s = scene.span_s();
    let step_s = scene.stretches.first().map_or(0.0, |s| s.step_s);
    kinds(scene)
        .iter()
        .flat_map(|kind| match kind {
            Undo::Drive(_) => around().map(|k| kind.at(&[k * TURN_STEP * TAU / span_s])).collect(),
            Undo::Lag { .. } => LAGS
                .iter()
                .flat_map(|d| [[*d, 0.0], [-d, 0.0], [0.0, *d], [0.0, -d]])
                .map(|[d, e]| kind.at(&[d * step_s, e * step_s / span_s]))
                .collect(),
            _ => Vec::new(),
        })
        .collect()
}

/// Places at which the search for a scale begins.
pub(super) fn search_scale(scene: &Scene) -> Vec<Undo> {
    kinds(scene)
        .iter()
        .flat_map(|kind| match kind {
            Undo::Scale(set, _) => {
                let step = scale_step(scene, set);
                around().map(|k| kind.at(&[(k * step).exp()])).collect()
            }
            _ => Vec::new(),
        })
        .collect()
}

/// Step of a search for the scale of some sensors.
fn scale_step(scene: &Scene, set: &[usize]) -> f64 {
    let turns = set.iter().map(|&i| range(scene, i)).fold(0.0, f64::max) / TAU;
    (TURN_STEP / turns.max(1e-9)).min(SCALE_STEP)
}

/// Farthest that a sensor gets from its zero, rad.
fn range(scene: &Scene, sensor: usize) -> f64 {
    scene.stretches.iter().flat_map(|s| s.sensors(&scene.bound)[sensor].clone()).fold(0.0, |m, x| f64::max(m, x.abs()))
}

/// Steps by which derivatives are taken for the numbers of an undoing, and the largest step of a
/// search.
pub(super) fn small(scene: &Scene, undo: &Undo) -> Option<(Vec<f64>, Vec<f64>, Vec<f64>)> {
    let span_s = scene.span_s();
    let step_s = scene.stretches.first()?.step_s;
    match undo {
        Undo::Scale(set, f) => {
            let most = scale_step(scene, set);
            Some((vec![*f], vec![1e-3 * most], vec![f * most]))
        }
        Undo::Drive(rate) => Some((vec![*rate], vec![1e-3 * TAU / span_s], vec![TURN_STEP * TAU / span_s])),
        Undo::Lag { delay_s, drift, .. } => {
            let most = 4.0 * step_s;
            Some((vec![*delay_s, *drift], vec![0.1 * step_s, 0.1 * step_s / span_s], vec![most, most / span_s]))
        }
        _ => None,
    }
}

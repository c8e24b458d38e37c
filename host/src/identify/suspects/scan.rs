//! Of which frequencies a drive may be, by the equations of motion alone.
//!
//! Chaos may leave a drive no line at all in the motion, or one lower than that at 5.5 times its
//! frequency. Its force is in the equations nevertheless: fitted with it they leave a thousand
//! times less (in power) than beside it. Over a span S that shows within ±1/(4 S), so that a few
//! windows are searched with a coarse comb, and the best of it in ever more windows with finer
//! ones.

use core::f64::consts::TAU;

use rayon::prelude::*;

use super::scene::{Noise, Scene};
use super::undo::Undo;
use super::{Footing, WINDOWS};
use crate::record::Record;
use crate::rig::Rig;

/// Windows of each round, and how many frequencies go on from it.
const ROUNDS: [(usize, usize); 4] = [(3, 12), (8, 6), (24, 4), (WINDOWS, 3)];
/// Steps of a comb in one over the span; the last one's.
const STEP: f64 = 0.25;
const LAST_STEP: f64 = 0.05;

/// Frequencies (Hz) of a drive with which the equations leave least, the best first, and how finely
/// the record tells them apart; `rig` has any drive.
pub fn drive_frequencies(record: &Record, rig: &Rig, on: &Footing, range_hz: [f64; 2]) -> Option<(Vec<f64>, f64)> {
    let stated = rig.drive?.frequency_hz;
    let whole = Scene::in_windows(core::slice::from_ref(record), rig, &on.settings).ok()?;
    let [from, to] = range_hz;
    let mut found: Vec<f64> = Vec::new();
    let mut reach = 0.0;
    for (windows, go_on) in ROUNDS {
        let scene = whole.first(windows);
        let span = scene.span_s();
        let noise = scene.misfit()?.noise;
        let step = STEP / span;
        let comb: Vec<f64> = if found.is_empty() {
            (0..=((to - from) / step) as usize).map(|i| from + i as f64 * step).collect()
        } else {
            found.iter().flat_map(|f| around(*f, reach, step)).collect()
        };
        found = lowest(&tried(&scene, &noise, &comb, stated), go_on, step);
        reach = step;
    }
    let scene = whole.first(WINDOWS);
    let noise = scene.misfit()?.noise;
    let step = LAST_STEP / scene.span_s();
    let best = |f: &f64| {
        let tried = tried(&scene, &noise, &around(*f, reach, step), stated);
        tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let mut last: Vec<(f64, f64)> = found.iter().filter_map(best).collect();
    last.sort_by(|a, b| a.1.total_cmp(&b.1));
    Some((last.into_iter().map(|l| l.0).collect(), step))
}

fn around(f: f64, reach: f64, step: f64) -> Vec<f64> {
    let n = (reach / step).ceil() as i32;
    (-n..=n).map(|i| f + f64::from(i) * step).filter(|f| *f > 0.0).collect()
}

/// What the equations leave with a drive of each frequency.
fn tried(scene: &Scene, noise: &Noise, comb: &[f64], stated_hz: f64) -> Vec<(f64, f64)> {
    let one = |f: &f64| {
        let moved = scene.with(&Undo::Drive(TAU * (f - stated_hz)));
        Some((*f, moved.misfit_beside(noise)?.log))
    };
    comb.par_iter().filter_map(one).collect()
}

/// The frequencies that leave least, none within two steps of a better one.
fn lowest(tried: &[(f64, f64)], most: usize, step: f64) -> Vec<f64> {
    let mut order = tried.to_vec();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut out: Vec<f64> = Vec::new();
    for (f, _) in order {
        if out.len() < most && !out.iter().any(|o| (o - f).abs() < 2.5 * step) {
            out.push(f);
        }
    }
    out
}

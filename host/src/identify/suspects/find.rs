//! The mistake whose undoing removes the residual.
//!
//! Every statement of [`super::hypotheses`] is undone in turn on the record's first windows and
//! the equations are refitted; where none does, numbers are searched for (a frequency, a lag, a
//! scale), first near where they stand, then on a grid. The best of each kind goes through Gauss
//! and Newton's steps on all windows. What an effect that the model lacks leaves is not what
//! another scale or an exchanged channel would take away: an undoing is believed that leaves at
//! most [`SOLVED`] of the misfit, or less than half where every other kind leaves at least twice
//! that.

use rayon::prelude::*;

use super::hypotheses::{COUNTS, channels, kinds, search_scale, search_time, small, statements};
use super::scene::{Misfit, Scene};
use super::undo::Undo;
use super::{CLEAN, FEW};
use crate::wording::format::Z95;

/// Fall of the mean of ln r² from which a reversed channel fits better than as it stands (by hand).
const FITS_BETTER: f64 = 0.1;
/// Share of the misfit that may be left.
const SOLVED: f64 = 0.2;
/// The same where all other kinds leave at least twice as much.
const ALONE: f64 = 0.5;
/// Logarithm of a power by which what is left lies above the noise of other sensors however large
/// the coefficients come out (by hand).
const FAR: f64 = 3.0;
/// Kinds that are tried on all windows.
const FINALISTS: usize = 4;
/// Steps of Gauss and Newton.
const ROUNDS: usize = 5;
/// Share of the misfit within which two undoings are the same.
const SAME: f64 = 0.02;

/// Logarithm of a scale within which an effect may look like it.
const NEAR: f64 = 0.3;

/// What was found.
pub(super) struct Finding {
    /// What removes the residual.
    pub undo: Undo,
    /// Standard errors of its numbers.
    pub errors: Vec<f64>,
    /// Others that do as well.
    pub also: Vec<Undo>,
    /// What the equations leave with it undone.
    pub after: Misfit,
}

/// An undoing that was tried.
struct Tried {
    undo: Undo,
    errors: Vec<f64>,
    left: Misfit,
}

fn try_all(list: Vec<Undo>, left: impl Fn(&Undo) -> Option<Misfit> + Sync) -> Vec<Tried> {
    let tried: Vec<Option<Tried>> =
        list.into_par_iter().map(|undo| Some(Tried { left: left(&undo)?, errors: Vec::new(), undo })).collect();
    tried.into_iter().flatten().collect()
}

/// What is left with a statement undone: beside the noise that its sensors have then, where it is not
/// far above any that they could have.
fn stated_otherwise(scene: &Scene, before: &Misfit, undo: &Undo) -> Option<Misfit> {
    let there = scene.with(undo);
    let fitted = there.fitted()?;
    let roughly = there.misfit_of(&fitted, Some(&before.noise))?;
    let sizes = there.sensors.sigma.iter().zip(&scene.sensors.sigma);
    let change = sizes.map(|(now, then)| 2.0 * (now / then).ln().abs()).fold(0.0, f64::max);
    if roughly.log > before.log.max(0.0) + change + FAR { Some(roughly) } else { there.misfit_of(&fitted, None) }
}

/// The undoing that removes the residual, if one does.
pub(super) fn find(scene: &Scene, base: &Misfit) -> Option<Finding> {
    let few = scene.first(FEW);
    let before = few.misfit()?;
    let solved = |tried: &[Tried]| tried.iter().any(|t| t.left.log <= SOLVED * before.log);
    let mut tried = try_all(statements(&few), |undo| stated_otherwise(&few, &before, undo));
    // Of odd equations a reversed channel's have the same solution with other signs: what differs
    // is the noise that was drawn.
    let fits_better =
        |t: &Tried| !matches!(t.undo, Undo::Reverse(_)) || t.left.residual < before.residual - FITS_BETTER;
    tried.retain(fits_better);
    if !solved(&tried) {
        // A number that is off by little is found from where it stands.
        let near = kinds(&few)
            .into_par_iter()
            .map(|undo| refine(&few, Tried { undo, errors: Vec::new(), left: before.clone() }));
        tried.extend(near.collect::<Vec<_>>().into_iter().flatten());
    }
    for next in [search_time, search_scale] {
        if !solved(&tried) {
            // A few per cent or samples change the noise by as little.
            tried.extend(try_all(next(&few), |undo| few.with(undo).misfit_beside(&before.noise)));
        }
    }
    tried.sort_by(|a, b| a.left.log.total_cmp(&b.left.log));
    let mut finalists: Vec<Tried> = Vec::new();
    for t in tried {
        if finalists.len() < FINALISTS && !finalists.iter().any(|f| f.undo.same_kind(&t.undo)) {
            finalists.push(t);
        }
    }
    let refined = |scene: &Scene, all: Vec<Tried>| -> Vec<Tried> {
        let all: Vec<Option<Tried>> = all.into_par_iter().map(|t| refine(scene, t)).collect();
        all.into_iter().flatten().collect()
    };
    // What takes too little away of a few windows will not take enough of all: there it is what the
    // others are held against.
    let may_solve = |t: &Tried| t.left.log <= ALONE * before.log + 0.5 * CLEAN;
    let (finalists, weaker): (Vec<Tried>, Vec<Tried>) = refined(&few, finalists).into_iter().partition(may_solve);
    let mut last = refined(scene, finalists);
    last.sort_by(|a, b| a.left.log.total_cmp(&b.left.log));
    let mut last = last.into_iter();
    let best = last.next()?;
    let share = best.left.log / base.log;
    let (also, others): (Vec<Tried>, Vec<Tried>) = last.partition(|t| t.left.log - best.left.log < SAME * base.log);
    let of_few = weaker.iter().map(|t| t.left.log / before.log).fold(1.0, f64::min);
    let next = others.first().map_or(1.0, |t| t.left.log / base.log).min(of_few);
    (share <= SOLVED || (share <= ALONE && next >= 2.0 * share)).then(|| Finding {
        also: also.into_iter().map(|t| t.undo).collect(),
        undo: best.undo,
        errors: best.errors,
        after: best.left,
    })
}

/// Whether a scale that was searched for near the stated one is all that is wrong: a mistake leaves
/// what the sensors' noise leaves, or is a number of counts that encoders have. What leaves more may
/// be an effect, of which a scale takes a part.
pub(super) fn is_whole(scene: &Scene, found: &Finding) -> bool {
    let Undo::Scale(list, factor) = &found.undo else { return true };
    let error = found.errors.first().map_or(0.0, |e| Z95 * e);
    let channels = channels(scene);
    let usual = |i: &usize| {
        let near = |n: u32| COUNTS.iter().any(|c| (f64::from(*c) / f64::from(n) - factor).abs() <= error.max(1e-3));
        channels[*i].counts_per_turn.is_some_and(near)
    };
    found.after.log <= 0.5 * CLEAN || factor.abs().ln().abs() > NEAR || list.iter().all(usual)
}

/// Gauss and Newton's steps, shortened where they lead uphill; what has no number is only tried on
/// this scene.
fn refine(scene: &Scene, start: Tried) -> Option<Tried> {
    let Some((mut x, step, most)) = small(scene, &start.undo) else {
        return Some(Tried { left: scene.with(&start.undo).misfit()?, ..start });
    };
    let there = scene.with(&start.undo.at(&x));
    let mut fitted = there.fitted()?;
    let mut best = Tried { left: there.misfit_of(&fitted, None)?, ..start };
    let noise = best.left.noise.clone();
    for _ in 0..ROUNDS {
        let Some((change, errors)) = scene.step(&best.undo, &x, &step, &fitted) else { break };
        best.errors = errors;
        let longest = change.iter().zip(&most).map(|(c, m)| (c / m).abs()).fold(1.0, f64::max);
        let mut factor = 1.0 / longest;
        let mut better = None;
        for _ in 0..3 {
            let next: Vec<f64> = x.iter().zip(&change).map(|(x, c)| x + factor * c).collect();
            let undo = best.undo.at(&next);
            let there = scene.with(&undo);
            let left = there.fitted().and_then(|f| Some((there.misfit_of(&f, Some(&noise))?, f)));
            if let Some((left, fitted)) = left.filter(|(m, _)| m.log < best.left.log) {
                better = Some((next, undo, left, fitted));
                break;
            }
            factor *= 0.3;
        }
        let Some((next, undo, left, there)) = better else { break };
        let gain = best.left.log - left.log;
        (x, best.undo, best.left, fitted) = (next, undo, left, there);
        if gain < 1e-3 {
            break;
        }
    }
    best.left = scene.with(&best.undo).misfit_of(&fitted, None)?;
    Some(best)
}

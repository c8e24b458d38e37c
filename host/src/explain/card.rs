//! The card of an explanation: see [`crate::report::card`].

use std::collections::BTreeSet;
use std::path::Path;

use super::engine::changed::Changed;
use super::engine::residual_map::Where;
use super::explanation::{Found, Limit, Refused};
use super::gap::{AtHorizon, Miss};
use super::locking::LOCKS_LATER;
use super::reason::{Criterion, Reason, seconds_of};
use super::{DecidedBy, Explanation, Step, Verdict};
use crate::effects::text_of;
use crate::export::written_out::{WrittenOut, written_out};
use crate::identify::Parameter;
use crate::model::identified::IdentifiedModel;
use crate::motion::Motion;
use crate::report::card::{Card, CardRow, GapBar};
use crate::rig::Rig;
use crate::system::library::Pendulum;
use crate::wording::format::{Z95, plus_minus, quantity, significant};
use crate::wording::names;

/// Most candidates that were close of which it is told why they were not taken.
const MOST_REFUSED: usize = 3;
/// Most detection limits that are told.
const MOST_LIMITS: usize = 6;
/// Most places where what is left sits.
const MOST_PLACES: usize = 2;

/// The card of an explanation of a rig.
pub fn card(e: &Explanation, rig: &Rig) -> Card {
    let mut out = Card { verdict: sentence(e), ..Card::default() };
    if e.verdict != Verdict::NotDecidable {
        out.equations = e.model.as_ref().and_then(|m| equations(m, rig));
        out.parameters = parameters(e, out.equations.as_ref(), rig);
        out.remarks = (e.verdict == Verdict::Unexplained).then(|| OFF_BY_MORE.to_owned()).into_iter().collect();
        out.gap = gap(e);
        out.picture = e.prediction.clone();
        let test = |f: &Found| format!("{}: {}.", names::capitalised(&names::effect(&f.name())), f.confirm);
        out.confirm = e.effects.iter().filter(|f| !f.confirm.is_empty()).map(test).collect();
    }
    out.undecided = undecided(e);
    out
}

/// The equations of a model with its numbers in them; none where it cannot be written out.
pub fn equations(model: &IdentifiedModel, rig: &Rig) -> Option<WrittenOut> {
    let motion = Motion::of(model, Path::new(""), Some(rig), 0.0).ok()?;
    let mut out = written_out(&motion)?;
    let divided = match rig.pendulum() {
        Some(Pendulum::Single) => Some("The coefficients"),
        _ => out.multiplies.contains_key("B11").then_some("B and C"),
    };
    if let Some(divided) = divided {
        let powers = if rig.drive.is_some() { " and Ω² (viscous friction: Ω), and have no unit" } else { "" };
        out.notes.push(format!("{divided} are torques divided by the arm's moment of inertia{powers}."));
    }
    Some(out)
}

/// What intervals are not, where something is missing.
const OFF_BY_MORE: &str = "Something is still missing, which moves these values: they may be off by more than their intervals, which hold the \
    scatter along the record alone.";

/// What a number of noise floors is a multiple of.
const NOISE: &str = " times the sensors' noise";

/// Power over that of the noise from which its limit is not told.
const FAR: f64 = 1e4;

/// Times its limit up to which what decides is little beside the noise (by hand).
const LITTLE: f64 = 1.5;

/// How far predictions miss, in a sentence.
fn told(miss: &Miss) -> String {
    match miss {
        Miss::Floors(_) => format!("{}{NOISE}", miss.number()),
        // Told in the sensors' own unit where the noise says nothing.
        Miss::Own { .. } | Miss::Diverged => miss.to_string(),
    }
}

/// The horizon that tells what has changed, and the gap before and after; what was fitted again is
/// not told as a change where nothing is missing.
fn changed(e: &Explanation) -> Option<AtHorizon> {
    e.gap.telling().filter(|_| e.gap.steps.len() > 1 && e.verdict != Verdict::NothingMissing)
}

/// The powers that stand in an effect's unit.
fn of_unit(f: &Found) -> String {
    let told = |(name, x): (&String, &f64)| {
        let error = f.parameter_std_errors.get(name).map_or(0.0, |e| Z95 * e);
        f.unit.contains(&format!("^{name}")).then(|| format!(" with {name} = {}", plus_minus(*x, error)))
    };
    f.parameters.iter().filter_map(told).collect()
}

/// What was found, one sentence.
fn sentence(e: &Explanation) -> String {
    let found: Vec<String> = e
        .effects
        .iter()
        .enumerate()
        .map(|(k, f)| {
            // A share has no unit.
            let unit = if f.unit == "1" { "" } else { &f.unit };
            let value = plus_minus(f.value, Z95 * f.std_error);
            let told = format!("{}, {value} {unit}{}", names::effect(&f.name()), of_unit(f));
            // Said once.
            format!("{}{}", told.trim_end(), if k == 0 { " (± is 95 %)" } else { "" })
        })
        .collect();
    let found = if found.len() > 1 { found.join("; ") } else { found.concat() };
    let steps = &e.gap.steps;
    let over = |horizon_s: f64| format!("predictions over {} s", seconds_of(horizon_s));
    let change = match (changed(e), steps.last()) {
        (Some(AtHorizon { horizon_s, before, after }), _) => {
            let over = over(horizon_s);
            let (before, after) = (e.gap.miss_beside(before, after), e.gap.miss_beside(after, before));
            // The same words are not said twice.
            let before = match (&before, &after) {
                (Miss::Floors(_), Miss::Floors(_)) | (Miss::Own { .. }, Miss::Own { .. }) => before.number(),
                _ => told(&before),
            };
            format!("{over} miss by {} instead of {before}", told(&after))
        }
        (_, Some(last)) => format!("{} miss by {}", over(e.gap.horizon_s), told(&e.gap.miss(last.value))),
        _ => String::new(),
    };
    match e.verdict {
        Verdict::Explained => {
            let it = if e.effects.len() == 1 { "it" } else { "them" };
            let number = other_number(e).map_or_else(String::new, |d| format!(": {}", beside_limit(d)));
            format!(
                "The model lacks {found}; with {it}, {change}, and nothing but noise is left{number}.{}",
                rests_on(e)
            )
        }
        Verdict::NothingMissing => {
            let why = match &e.decided_by {
                None => format!("{change}, which is noise alone"),
                Some(d) if matches!(d.what, Criterion::Gap { .. }) => beside_limit(d),
                Some(d) => format!("{}, and {change}", beside_limit(d)),
            };
            format!("Nothing is missing: {why}.{}", rests_on(e))
        }
        Verdict::Unexplained => {
            let far = if found.is_empty() { String::new() } else { format!(" Found so far: {found}; {change}.") };
            if let Some(changed) = depends_on_time(e) {
                let stands_in = if far.is_empty() { "" } else { " What was found so far may only stand in for that." };
                return format!("What is missing depends on time: {}.{far}{stands_in}", changed.told());
            }
            let is_of_shapes = |d: &DecidedBy| matches!(d.what, Criterion::Shape | Criterion::Pieces);
            let number = e.decided_by.as_ref().filter(|d| d.value > d.limit && !is_of_shapes(d));
            let why = number.map_or_else(|| without_number(&e.reason), beside_limit);
            // A shape that is the reason is not said twice.
            let said = number.is_none() && matches!(e.reason, Reason::Shape { .. });
            let shape = e.unknown.as_ref().filter(|_| !said).map_or_else(String::new, |u| format!("; {}", u.told()));
            let little = number.filter(|d| d.value < LITTLE * d.limit);
            let little =
                little.map_or("", |_| " It is little beside the noise: a longer or quieter record may name it.");
            format!(
                "Something is missing for which no name was found in the list of effects: {why}{shape}.{little}{far}"
            )
        }
        Verdict::NotDecidable => {
            let why = e.reason.to_string();
            format!("This record cannot decide what the model lacks: {}.", why.trim_end_matches('.'))
        }
    }
}

/// The number that decided, where it is not the one that tells what has changed.
fn other_number(e: &Explanation) -> Option<&DecidedBy> {
    let told_s = changed(e).map_or(e.gap.horizon_s, |c| c.horizon_s);
    e.decided_by.as_ref().filter(|d| d.what != Criterion::Gap { horizon_s: told_s })
}

/// What a verdict rests on, where that is a part of the record.
fn rests_on(e: &Explanation) -> &'static str {
    if e.warnings.iter().any(|w| w.id == LOCKS_LATER) {
        " This rests on the record's beginning, before or while the motion locked to its drive: one orbit tells no effects apart."
    } else {
        ""
    }
}

/// How what is left depends on time, where it does.
fn depends_on_time(e: &Explanation) -> Option<&Changed> {
    match &e.reason {
        Reason::Excess { changed, .. } => changed.as_ref(),
        _ => None,
    }
}

/// A number beside its limit.
fn beside_limit(d: &DecidedBy) -> String {
    let (value, limit) = (significant(d.value, 3), significant(d.limit, 3));
    match d.what {
        Criterion::Gap { horizon_s } => format!(
            "predictions over {} s miss by {value} times the sensors' noise (up to {limit} would be noise)",
            seconds_of(horizon_s)
        ),
        // So far from noise that how far tells nothing.
        Criterion::Power | Criterion::PowerOfWhole if d.value > FAR => {
            format!("what is left is far above the sensors' noise ({} times, rms)", significant(d.value.sqrt(), 2))
        }
        Criterion::Power | Criterion::PowerOfWhole => {
            format!("what is left has {value} times the power of the sensors' noise (up to {limit} would be noise)")
        }
        Criterion::Shape | Criterion::Pieces => format!("{}: {value} (limit {limit})", d.what),
    }
}

/// What made an `unexplained` verdict where no number is above its limit.
fn without_number(reason: &Reason) -> String {
    match reason {
        Reason::Shape { shape, .. } => shape.told(),
        Reason::Patched { patch, .. } => patch.to_string(),
        Reason::Excess { residual, shape: Some(shape), .. } => format!("{residual}; {}", shape.told()),
        Reason::Excess { .. } | Reason::Noise(_) | Reason::Undecidable(_) | Reason::Unjudged => reason.to_string(),
    }
}

/// The model's own parameters, then effects, before and after.
fn parameters(e: &Explanation, equations: Option<&WrittenOut>, rig: &Rig) -> Vec<CardRow> {
    let row = |p: &Parameter| {
        let before = e.parameters_before.iter().find(|b| b.name == p.name).map(|b| (b.value, b.std_error));
        let found = e.effects.iter().find(|f| f.name() == p.name);
        let row = CardRow::of(p, equations, rig);
        let after = found.map_or(row.after, |f| (f.value, f.std_error));
        match p.name.contains('@') {
            true => CardRow {
                symbol: String::new(),
                plain: names::capitalised(&names::effect(&p.name)),
                before,
                after,
                ..row
            },
            false => CardRow { before, after, ..row },
        }
    };
    e.parameters.iter().map(row).collect()
}

/// Models and their gaps at the horizon of the sentence: at the shortest each step, at a longer one
/// before and after.
fn steps(e: &Explanation) -> (f64, Vec<(String, f64)>) {
    let of = |s: &Step| (s.told("with"), s.value);
    let all: Vec<(String, f64)> = e.gap.steps.iter().map(of).collect();
    let (Some(over), [first, .., last]) = (changed(e).filter(|c| c.horizon_s > e.gap.horizon_s), &all[..]) else {
        return (e.gap.horizon_s, all);
    };
    let after = if all.len() > 2 { "with all of these".to_owned() } else { last.0.clone() };
    (over.horizon_s, vec![(first.0.clone(), over.before), (after, over.after)])
}

/// The gap before and after, in noise floors and, where the sensors have one unit, in that.
fn gap(e: &Explanation) -> (String, Vec<GapBar>) {
    let (horizon_s, steps) = steps(e);
    let misses: Vec<Miss> = steps.iter().map(|s| e.gap.miss(s.1)).collect();
    // Said once, above all.
    let many = !misses.is_empty() && misses.iter().all(|m| matches!(m, Miss::Own { .. }));
    let floors = if many { e.gap.noise() } else { "1 noise floor is what the sensors' noise alone leaves".to_owned() };
    let heading =
        format!("How far predictions over {} s miss, where they were not fitted ({floors})", seconds_of(horizon_s));
    let bar = |((name, value), miss): (&(String, f64), &Miss)| {
        let own = e.gap.floor_in.as_ref().map(|floor| quantity(value * floor.value, &floor.unit, 3));
        let also = own.map_or_else(String::new, |own| format!(", {}", own.replace(" °", "°")));
        let label = match miss {
            Miss::Floors(_) => format!("{miss}{also}"),
            Miss::Own { .. } if many => miss.number(),
            // Of a miss that is told in the sensors' unit there is no second number.
            Miss::Own { .. } | Miss::Diverged => miss.to_string(),
        };
        GapBar { name: name.clone(), value: *value, label }
    };
    (heading, steps.iter().zip(&misses).map(bar).collect())
}

/// Share of a stretch below which its edge is 0, but for rounding.
const DIRT: f64 = 1e-9;

/// A place whose edges at 0 are 0.
pub(super) fn clean(place: &Where) -> Where {
    let edge = |x: f64| if x.abs() < DIRT * (place.to - place.from).abs() { 0.0 } else { x };
    Where { from: edge(place.from), to: edge(place.to), ..place.clone() }
}

/// The command that prints the laboratory tests of an effect and of those that it is not told from;
/// of a user's own, their file has them.
fn laboratory(f: &Found) -> String {
    let id = |name: &String| name.split('@').next().unwrap_or_default().to_owned();
    let mut ids: Vec<String> = core::iter::once(&f.id).chain(&f.indistinguishable_from).map(id).collect();
    ids.retain(|id| text_of(id).is_some());
    let mut seen = BTreeSet::new();
    ids.retain(|id| seen.insert(id.clone()));
    match &ids[..] {
        [] => String::new(),
        [one] => format!(" (`whirl list effects --show {one}` prints it)"),
        _ => format!(" (`whirl list effects --show ID` prints it, ID being {})", ids.join(", ")),
    }
}

/// What could not be decided, and what to do for it.
fn undecided(e: &Explanation) -> Vec<String> {
    let mut out = Vec::new();
    for f in e.effects.iter().filter(|f| !f.indistinguishable_from.is_empty()) {
        let others: Vec<String> = f.indistinguishable_from.iter().map(|n| names::effect(n)).collect();
        // An effect of a user's own file may have no test.
        let has_test = !f.confirm.is_empty() || text_of(&f.id).is_some();
        let test = if has_test { "the laboratory test of each does" } else { "only a test in the laboratory does" };
        out.push(format!(
            "This record does not tell {} from {}: {test}{}.",
            names::effect(&f.name()),
            names::listed(&others),
            laboratory(f)
        ));
    }
    for p in e.parameters.iter().filter(|p| p.std_error.is_infinite()) {
        out.push(format!(
            "{} cannot be determined from this record alone: record a motion of larger amplitude.",
            p.name
        ));
    }
    out.extend(smaller(e));
    if e.verdict == Verdict::Unexplained {
        for w in e.r#where.iter().take(MOST_PLACES) {
            // Where few values are the noise's share of them is not known.
            let noise = if w.band > 0.0 {
                format!(", where noise would be within ± {}", w.residual(w.band))
            } else {
                String::new()
            };
            let (at, value) = (clean(w).stretch(), w.residual(w.value));
            out.push(format!("What is left sits in equation {} at {at}: {value}{noise}.", w.equation));
        }
        // What was tried and did not hold before what chance may have made.
        let mut refused: Vec<&Refused> = e.refused.iter().collect();
        refused.sort_by_key(|r| r.is_by_chance());
        for r in refused.into_iter().take(MOST_REFUSED) {
            let name = names::effect(&r.name());
            out.push(format!("Close, but not taken: {name} ({}).", r.why));
        }
        let law = "Describe a law of your own in a file and try it with --effects FILE.toml, or record slower and larger motions.";
        out.push(depends_on_time(e).map_or_else(|| law.to_owned(), Changed::advice));
    }
    out
}

/// That what is too small to be named may be there all the same.
fn smaller(e: &Explanation) -> Option<String> {
    let size = |l: &Limit| match l.unit.as_str() {
        "1" | "" => format!("{} (no unit)", quantity(l.value, "", 2)),
        unit => quantity(l.value, unit, 2),
    };
    let one = |l: &Limit| format!("{} of {}", names::effect(&l.name()), size(l));
    let limits: Vec<String> = e.detection_limits.iter().take(MOST_LIMITS).map(one).collect();
    let others = e.detection_limits.len() - limits.len();
    let others =
        if others > 0 { format!(" (of {others} more: `detection_limits` with --json)") } else { String::new() };
    (!limits.is_empty()).then(|| {
        format!(
            "What is smaller may be there all the same. 95 of 100 such records would have shown {}{others}.",
            limits.join("; ")
        )
    })
}

#[cfg(test)]
#[path = "card_tests.rs"]
mod tests;

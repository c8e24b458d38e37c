//! The card of an explanation: see [`crate::report::card`].

use std::collections::BTreeSet;
use std::path::Path;

use super::explanation::Found;
use super::gap::Miss;
use super::reason::{Criterion, Reason};
use super::{DecidedBy, Explanation, Step, Verdict};
use crate::effects::text_of;
use crate::export::written_out::{WrittenOut, written_out};
use crate::identify::Parameter;
use crate::model::identified::IdentifiedModel;
use crate::motion::Motion;
use crate::report::card::{Card, CardRow, GapBar};
use crate::rig::Rig;
use crate::wording::format::{Z95, plus_minus, quantity, rounded, shortest, significant};
use crate::wording::names;

/// Most candidates that were close of which it is told why they were not taken.
const MOST_REFUSED: usize = 3;
/// Most places where what is left sits.
const MOST_PLACES: usize = 2;

/// The card of an explanation of a rig.
pub fn card(e: &Explanation, rig: &Rig) -> Card {
    let mut out = Card { verdict: sentence(e), ..Card::default() };
    if e.verdict != Verdict::NotDecidable {
        out.equations = e.model.as_ref().and_then(|m| equations(m, rig));
        out.parameters = parameters(e, out.equations.as_ref(), rig);
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
    if out.multiplies.contains_key("B11") {
        let powers = if rig.drive.is_some() { " and Ω² (viscous friction: Ω), and have no unit" } else { "" };
        out.notes.push(format!("B and C are torques divided by the arm's moment of inertia{powers}."));
    }
    Some(out)
}

/// What a number of noise floors is a multiple of.
const NOISE: &str = " times the sensors' noise";

/// Power over that of the noise from which its limit is not told.
const FAR: f64 = 1e4;

/// How far predictions miss, in a sentence.
fn told(miss: &Miss) -> String {
    match miss {
        Miss::Floors(_) => format!("{}{NOISE}", miss.number()),
        // Told in the sensors' own unit where the noise says nothing.
        Miss::Own { .. } | Miss::Diverged => miss.to_string(),
    }
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
            let told = format!("{}, {} {unit}", names::effect(&f.name()), plus_minus(f.value, Z95 * f.std_error));
            // Said once.
            format!("{}{}", told.trim_end(), if k == 0 { " (± is 95 %)" } else { "" })
        })
        .collect();
    let found = if found.len() > 1 { found.join("; ") } else { found.concat() };
    let steps = &e.gap.steps;
    let over = format!("predictions over {} s", shortest(rounded(e.gap.horizon_s, 4)));
    let change = match (steps.first(), steps.last()) {
        (Some(first), Some(last)) if steps.len() > 1 => {
            let (before, after) = (e.gap.miss(first.value), e.gap.miss(last.value));
            // The same words are not said twice.
            let before = match (&before, &after) {
                (Miss::Floors(_), Miss::Floors(_)) | (Miss::Own { .. }, Miss::Own { .. }) => before.number(),
                _ => told(&before),
            };
            format!("{over} miss by {} instead of {before}", told(&after))
        }
        (_, Some(last)) => format!("{over} miss by {}", told(&e.gap.miss(last.value))),
        _ => String::new(),
    };
    match e.verdict {
        Verdict::Explained => {
            let it = if e.effects.len() == 1 { "it" } else { "them" };
            format!("The model lacks {found}; with {it}, {change}, and nothing but noise is left.")
        }
        Verdict::NothingMissing => format!("Nothing is missing: {change}, which is noise alone."),
        Verdict::Unexplained => {
            let far = if found.is_empty() { String::new() } else { format!(" Found so far: {found}; {change}.") };
            let number = e.decided_by.as_ref().filter(|d| d.value > d.limit);
            let why = number.map_or_else(|| without_number(&e.reason), above);
            // A shape that is the reason is not said twice.
            let said = number.is_none() && matches!(e.reason, Reason::Shape { .. });
            let shape = e.unknown.as_ref().filter(|_| !said).map_or_else(String::new, |u| format!("; {}", u.told()));
            format!("Something is missing that has no name in the list of effects: {why}{shape}.{far}")
        }
        Verdict::NotDecidable => {
            let why = e.reason.to_string();
            format!("This record cannot decide what the model lacks: {}.", why.trim_end_matches('.'))
        }
    }
}

/// A number above its limit.
fn above(d: &DecidedBy) -> String {
    let (value, limit) = (significant(d.value, 3), significant(d.limit, 3));
    match d.what {
        Criterion::Gap { horizon_s } => format!(
            "predictions over {} s miss by {value} times the sensors' noise (up to {limit} would be noise)",
            significant(horizon_s, 4)
        ),
        // So far from noise that how far tells nothing.
        Criterion::Power | Criterion::PowerOfWhole if d.value > FAR => {
            format!("what is left is far above the sensors' noise ({} times, rms)", significant(d.value.sqrt(), 2))
        }
        Criterion::Power | Criterion::PowerOfWhole => {
            format!("what is left has {value} times the power of the sensors' noise (up to {limit} would be noise)")
        }
    }
}

/// What made an `unexplained` verdict where no number is above its limit.
fn without_number(reason: &Reason) -> String {
    match reason {
        Reason::Shape { shape, .. } => shape.told(),
        Reason::Patched { patch, .. } => patch.to_string(),
        Reason::Excess { residual, shape: Some(shape) } => format!("{residual}; {}", shape.told()),
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

/// The gap at each step, in noise floors and, where the sensors have one unit, in that.
fn gap(e: &Explanation) -> (String, Vec<GapBar>) {
    let misses: Vec<Miss> = e.gap.steps.iter().map(|s| e.gap.miss(s.value)).collect();
    // Said once, above all.
    let many = !misses.is_empty() && misses.iter().all(|m| matches!(m, Miss::Own { .. }));
    let floors = if many { e.gap.noise() } else { "1 noise floor is what the sensors' noise alone leaves".to_owned() };
    let heading = format!(
        "How far predictions over {} s miss, where they were not fitted ({floors})",
        shortest(rounded(e.gap.horizon_s, 4))
    );
    let bar = |(step, miss): (&Step, &Miss)| {
        let own = e.gap.floor_in.as_ref().map(|floor| quantity(step.value * floor.value, &floor.unit, 3));
        let also = own.map_or_else(String::new, |own| format!(", {}", own.replace(" °", "°")));
        let label = match miss {
            Miss::Floors(_) => format!("{miss}{also}"),
            Miss::Own { .. } if many => miss.number(),
            // Of a miss that is told in the sensors' unit there is no second number.
            Miss::Own { .. } | Miss::Diverged => miss.to_string(),
        };
        GapBar { name: step.told("with"), value: step.value, label }
    };
    (heading, e.gap.steps.iter().zip(&misses).map(bar).collect())
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
        out.push(format!(
            "This record does not tell {} from {}: the laboratory test of each does{}.",
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
    if e.verdict == Verdict::Unexplained {
        for w in e.r#where.iter().take(MOST_PLACES) {
            out.push(format!(
                "What is left sits in equation {} at {}: {}, where noise would be within ± {}.",
                w.equation,
                w.stretch(),
                w.residual(w.value),
                w.residual(w.band)
            ));
        }
        for r in e.refused.iter().take(MOST_REFUSED) {
            let name = names::effect(&r.name());
            out.push(format!("Close, but not taken: {name} ({}).", r.why));
        }
        out.push("Describe a law of your own in a file and try it with --effects FILE.toml, or record slower and larger motions.".to_owned());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::engine::unknown::Unknown;
    use super::super::explanation::InUnit;
    use super::super::reason::{Patch, Residual, Undecidable};
    use super::*;

    fn explained() -> Explanation {
        let mut e = Explanation::new(0.2, Vec::new());
        e.verdict = Verdict::Explained;
        let mut found = Found::empty("quadratic-drag", "arm2", "N m s²".to_owned());
        (found.value, found.std_error) = (2e-7, 2e-11);
        found.confirm = "repeat with a paper sail".to_owned();
        found.indistinguishable_from = vec!["viscous-friction@joint1".to_owned()];
        e.effects.push(found);
        let step = |added: Option<&str>, value| Step { added: added.map(str::to_owned), value };
        e.gap.floor_in = Some(InUnit { value: 0.02, unit: "°".to_owned() });
        e.gap.steps = vec![step(None, 4.5), step(Some("quadratic-drag@arm2"), 1.0)];
        let p = |value, std_error| Parameter { name: "C2".to_owned(), value, std_error, unit: "1".to_owned() };
        e.parameters = vec![p(0.048493, 5.6e-6)];
        e.parameters_before = vec![p(0.05455, 4e-5)];
        e
    }

    fn rig() -> Rig {
        Rig::parse(include_str!("../../../rigs/chaotic.toml"), Path::new("rig.toml")).unwrap()
    }

    #[test]
    fn the_sentence_says_what_and_by_how_much() {
        let card = card(&explained(), &rig());
        assert_eq!(
            card.verdict,
            "The model lacks quadratic drag on arm 2, (2.0000 ± 0.0004)·10⁻⁷ N m s² (± is 95 %); with it, predictions over 0.2 s miss by 1.00 times \
             the sensors' noise instead of 4.50, and nothing but noise is left."
        );
        let mut share = explained();
        "1".clone_into(&mut share.effects[0].unit);
        let told = super::card(&share, &rig()).verdict;
        assert!(told.contains("on arm 2, (2.0000 ± 0.0004)·10⁻⁷ (± is 95 %); with it"), "{told}");
        let row = &card.parameters[0];
        assert_eq!((row.before, row.after, row.unit.as_str()), (Some((0.05455, 4e-5)), (0.048493, 5.6e-6), ""));
        assert!(row.plain.contains("viscous friction in joint 2"));
        let labels: Vec<&str> = card.gap.1.iter().map(|b| b.label.as_str()).collect();
        assert_eq!(labels, ["4.50 noise floors, 0.0900°", "1.00 noise floors, 0.0200°"]);
        assert_eq!(card.confirm, ["Quadratic drag on arm 2: repeat with a paper sail."]);
        let told = "from viscous friction in joint 1: the laboratory test of each does (`whirl list effects --show ID` prints it, ID being \
                    quadratic-drag, viscous-friction).";
        assert!(card.undecided[0].ends_with(told), "{:?}", card.undecided);
    }

    fn residual() -> Residual {
        Residual { power: 0.99, own: None, horizon_s: 0.2, gap: Miss::Floors(1.0), longer: None, whole: None }
    }

    fn shape(at: &str) -> Unknown {
        Unknown {
            at: at.to_owned(),
            against: "angle of joint2".to_owned(),
            against_unit: "rad",
            unit: "N m".to_owned(),
            points: Vec::new(),
            held_out_gain: 0.02,
        }
    }

    fn open(what: Criterion, value: f64, reason: Reason) -> Explanation {
        let mut e = explained();
        (e.verdict, e.reason) = (Verdict::Unexplained, reason);
        e.decided_by = Some(DecidedBy { what, value, limit: 1.3 });
        e
    }

    #[test]
    fn an_open_verdict_tells_the_number_that_decided_it() {
        let excess = || Reason::Excess { residual: residual(), shape: None };
        for (what, value, words) in [
            (
                Criterion::Gap { horizon_s: 0.4 },
                2.11,
                "predictions over 0.4000 s miss by 2.11 times the sensors' noise (up to 1.30 would be noise).",
            ),
            (
                Criterion::Power,
                2.11,
                "what is left has 2.11 times the power of the sensors' noise (up to 1.30 would be noise).",
            ),
            (Criterion::PowerOfWhole, 1e6, "what is left is far above the sensors' noise (1000 times, rms)."),
        ] {
            let told = card(&open(what, value, excess()), &rig()).verdict;
            assert!(told.contains(words), "{told}");
        }
        // Where no number is above its limit none is given as the cause.
        let reason = Reason::Shape { residual: residual(), shape: shape("joint2") };
        let mut e = open(Criterion::Gap { horizon_s: 0.2 }, 1.0, reason);
        e.unknown = Some(shape("joint2"));
        let told = card(&e, &rig()).verdict;
        assert!(told.contains("a torque at joint2 that depends on") && !told.contains("0.99"), "{told}");
        assert_eq!(told.matches("joint2 takes away").count(), 1, "{told}");
        let effects = vec!["backlash".to_owned(), "cogging".to_owned()];
        let patch = Patch { place: "joint2".to_owned(), effects, is_bend: false };
        e.reason = Reason::Patched { residual: residual(), patch };
        let told = card(&e, &rig()).verdict;
        assert!(
            told.contains(": it took backlash, cogging to get there: one shape of joint2's position")
                && !told.contains("0.99"),
            "{told}"
        );
        assert!(told.contains("; a torque at joint2 that depends on the angle of joint2 takes away 2.0 %"), "{told}");
    }

    /// Names and units are the user's: one that reads like a piece of a sentence is told whole.
    #[test]
    fn the_card_goes_by_values_and_not_by_words() {
        let name = "x, but y: no effect of the list accounts for it";
        let reason = Reason::Shape { residual: residual(), shape: shape(name) };
        let told = card(&open(Criterion::Power, 1.0, reason), &rig()).verdict;
        assert!(told.contains(&format!("effects: a torque at {name} that depends on")), "{told}");
        let patch = Patch { place: name.to_owned(), effects: vec!["gap over 1 s, cogging".to_owned()], is_bend: false };
        let told = card(&open(Criterion::Power, 1.0, Reason::Patched { residual: residual(), patch }), &rig()).verdict;
        assert!(
            told.contains(&format!("effects: it took gap over 1 s, cogging to get there: one shape of {name}'s")),
            "{told}"
        );
        let mut e = explained();
        e.gap.floor_in = Some(InUnit { value: 0.5, unit: "noise floors".to_owned() });
        (e.gap.steps[0].value, e.gap.steps[1].value) = (800.0, 400.0);
        let card = card(&e, &rig());
        let words = "miss by 200 noise floors (the sensors' noise is 0.500 noise floors) instead of 400 noise floors,";
        assert!(card.verdict.contains(words), "{}", card.verdict);
        let labels: Vec<&str> = card.gap.1.iter().map(|b| b.label.as_str()).collect();
        assert_eq!(labels, ["400 noise floors", "200 noise floors"]);
    }

    #[test]
    fn what_cannot_be_decided_has_no_numbers() {
        let mut e = explained();
        (e.verdict, e.reason) = (Verdict::NotDecidable, Reason::Undecidable(Undecidable::Locked));
        e.effects.clear();
        let card = card(&e, &rig());
        assert_eq!(
            card.verdict,
            "This record cannot decide what the model lacks: the motion repeats (locked to the drive): one orbit cannot tell effects apart. \
             Change the drive until the motion is chaotic: `whirl plan` proposes settings."
        );
        assert!(card.parameters.is_empty() && card.gap.1.is_empty() && card.equations.is_none());
    }
}

//! Tests of the card of an explanation.

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
    let mut power = explained();
    "N m (s/rad)^p".clone_into(&mut power.effects[0].unit);
    power.effects[0].parameters = [("p".to_owned(), 1.95), ("q".to_owned(), 2.0)].into();
    power.effects[0].parameter_std_errors = [("p".to_owned(), 0.07)].into();
    let told = super::card(&power, &rig()).verdict;
    assert!(told.contains("N m (s/rad)^p with p = 1.95 ± 0.14 (± is 95 %); with it"), "{told}");
    let mut locks = explained();
    locks.warnings.push(crate::warning::Warning::new(LOCKS_LATER, "", ""));
    let told = super::card(&locks, &rig()).verdict;
    assert!(
        told.contains(
            "noise is left. This rests on the record's beginning, before or while the motion locked to its drive"
        ),
        "{told}"
    );
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

#[test]
fn what_is_too_small_to_be_named_may_be_there() {
    let mut e = explained();
    let limit = |(k, id): (usize, &str)| Limit {
        id: id.to_owned(),
        at: "joint1".to_owned(),
        value: 1.5e-6 * (k + 1) as f64,
        unit: "N m".to_owned(),
    };
    let ids = ["coulomb-friction", "a", "b", "c", "d", "e", "f", "g"];
    e.detection_limits = ids.into_iter().enumerate().map(limit).collect();
    e.detection_limits[1].unit = "1".to_owned();
    let told = card(&e, &rig()).undecided.pop().unwrap();
    assert!(told.contains("·10⁻⁶ (no unit); b "), "{told}");
    let first = quantity(1.5e-6, "N m", 2);
    assert!(told.contains(&format!("would have shown Coulomb friction in joint 1 of {first}; a")), "{told}");
    assert!(told.ends_with("(of 2 more: `detection_limits` with --json)."), "{told}");
}

fn residual() -> Residual {
    Residual { power: 0.99, own: None, horizon_s: 0.2, gap: Miss::Floors(1.0), longer: None, whole: None }
}

fn shape(at: &str) -> Unknown {
    Unknown {
        at: at.to_owned(),
        against: "angle of joint2".to_owned(),
        against_unit: "rad".to_owned(),
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

/// What is still missing moves parameters, whatever their scatter.
#[test]
fn intervals_of_a_model_that_misses_something_are_told_for_what_they_are() {
    let e = open(Criterion::Power, 3.0, Reason::Excess { residual: residual(), shape: None, changed: None });
    assert!(card(&e, &rig()).text().contains("Something is still missing, which moves these values"));
    assert!(!card(&explained(), &rig()).text().contains("still missing"));
}

/// Whatever the horizon of the gap: the JSON tells the same number.
#[test]
fn a_verdict_of_noise_tells_the_number_that_decided_it() {
    let decided = |verdict: Verdict, what: Criterion, value: f64| {
        let mut e = explained();
        (e.verdict, e.decided_by) = (verdict, Some(DecidedBy { what, value, limit: 1.3 }));
        card(&e, &rig()).verdict
    };
    let longer = Criterion::Gap { horizon_s: 1.068 };
    assert_eq!(
        decided(Verdict::NothingMissing, longer, 1.0005),
        "Nothing is missing: predictions over 1.068 s miss by 1.00 times the sensors' noise (up to 1.30 would be noise)."
    );
    assert_eq!(
        decided(Verdict::NothingMissing, Criterion::Power, 1.11),
        "Nothing is missing: what is left has 1.11 times the power of the sensors' noise (up to 1.30 would be noise), and predictions over 0.2 s \
         miss by 1.00 times the sensors' noise."
    );
    let told = decided(Verdict::Explained, longer, 1.2);
    assert!(
        told.ends_with(
            "noise is left: predictions over 1.068 s miss by 1.20 times the sensors' noise (up to 1.30 would be noise)."
        ),
        "{told}"
    );
    let same = decided(Verdict::Explained, Criterion::Gap { horizon_s: 0.2 }, 1.0);
    assert!(same.ends_with("instead of 4.50, and nothing but noise is left."), "{same}");
}

#[test]
fn an_open_verdict_tells_the_number_that_decided_it() {
    let excess = || Reason::Excess { residual: residual(), shape: None, changed: None };
    for (what, value, words) in [
        (
            Criterion::Gap { horizon_s: 0.4 },
            2.11,
            "predictions over 0.4 s miss by 2.11 times the sensors' noise (up to 1.30 would be noise).",
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

/// When something changed is told first, and what to do about that.
#[test]
fn what_changed_in_the_middle_is_told_first() {
    let changed =
        Changed { at_s: 29.94, within_s: [27.38, 32.5], drifts: false, powers: [1.0, 300.0], apart: None, most: 1.05 };
    let reason = Reason::Excess { residual: residual(), shape: None, changed: Some(changed) };
    let mut e = open(Criterion::Power, 150.0, reason);
    let told = card(&e, &rig());
    let first = "What is missing depends on time: before about t = 29.94 s the model leaves nothing but noise, after it \
                 300 times the power of the sensors' noise: something in the rig changed then.";
    assert!(told.verdict.starts_with(first), "{}", told.verdict);
    assert!(told.verdict.ends_with("What was found so far may only stand in for that."), "{}", told.verdict);
    let advice = told.undecided.last().unwrap();
    assert!(advice.contains("`--to 27.38` and with `--from 32.5`") && !advice.contains("larger"), "{advice}");
    e.effects.clear();
    assert!(card(&e, &rig()).verdict.ends_with("changed then."));
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
         Change the drive until the motion repeats no more, or record how it settles: `whirl plan` proposes settings."
    );
    assert!(card.parameters.is_empty() && card.gap.1.is_empty() && card.equations.is_none());
}

#[test]
fn an_edge_that_is_0_but_for_rounding_is_told_as_0() {
    let place = |from: f64, to: f64| {
        let (against, units) = ("angle of pivot".to_owned(), ("rad".to_owned(), String::new()));
        clean(&Where { equation: 1, against, from, to, value: 0.0037, band: 0.0, units }).stretch()
    };
    assert_eq!(place(-0.524, -1.67e-16), "angle of pivot -0.524 … 0 rad".replace('-', "−"));
    assert_eq!(place(1e-9, 2e-9), "angle of pivot 1.00·10⁻⁹ … 2.00·10⁻⁹ rad");
}

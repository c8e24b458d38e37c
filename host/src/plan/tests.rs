use std::path::Path;

use super::*;
use crate::explain::engine::expected::Separation;
use crate::model::identified::System;
use crate::rig::plant::Plant;

fn rig() -> Rig {
    Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml")).unwrap()
}

/// The rig's plant as if it had been identified.
fn model(rig: &Rig) -> IdentifiedModel {
    let plant = Plant::of(rig).unwrap();
    let parameter = |name: &str| {
        let value = plant.truth(name, rig.omega()).unwrap();
        Parameter { name: name.to_owned(), value, std_error: 1e-5, unit: "1".to_owned() }
    };
    let names = ["B11", "B12", "B13", "B14", "C11", "C12", "B21", "B22", "B23", "B24", "C2"];
    IdentifiedModel {
        name: rig.name.clone(),
        system: System::BuiltIn("double-pendulum".to_owned()),
        method: "shooting".to_owned(),
        drive_frequency_hz: rig.drive.map(|d| d.frequency_hz),
        nominal: ["coulomb-friction@joint1", "viscous-friction@joint2"].map(str::to_owned).to_vec(),
        parameters: names.map(parameter).to_vec(),
        effects: Vec::new(),
        found_with: [("g".to_owned(), 9.81), ("record_s".to_owned(), 40.0)].into(),
    }
}

fn settings(tell: &[&str], limits: Limits) -> Settings<'static> {
    let goals = Goals { tell: tell.iter().map(|n| (*n).to_owned()).collect(), precise: Vec::new() };
    Settings { goals, sizes: Vec::new(), limits, record: None, budget: 1, seed: 1 }
}

/// Draws whose effect stands so many standard errors from its rival.
fn draws(deviations: &[f64]) -> Vec<Expected> {
    let one = |deviations: &f64| Expected {
        parameters: vec![Parameter { name: "C2".to_owned(), value: 0.05, std_error: 1e-4, unit: "1".to_owned() }],
        separations: vec![Separation {
            effect: "play@joint1".to_owned(),
            from: Some("backlash@joint1".to_owned()),
            deviations: *deviations,
        }],
        windows: (20, 1.0),
    };
    deviations.iter().map(one).collect()
}

const GOALS: [&str; 2] = ["play@joint1", "backlash@joint1"];

#[test]
fn what_is_wrong_at_every_setting_is_told() {
    let rig = rig();
    // Samples at 500 Hz do not resolve them.
    let limits = Limits { frequency_hz: Some([60.0, 70.0]), amplitude_factor: Some([1e-3, 2e-3]), ..Limits::default() };
    let e = plan(&rig, &model(&rig), &settings(&[], limits), &|_, _| {}).unwrap_err();
    assert_eq!((e.file.as_ref(), e.place.as_deref(), e.found.as_str()), (None, Some("frequency_hz"), "60"), "{e}");
    assert!(e.expected.contains("50 Hz") && e.remedy.contains("--limits"), "{e}");
}

#[test]
fn an_error_beside_a_setting_that_can_be_looked_at_is_none() {
    let error = |found: &str| Some(BadInput::new(found, "").remedy("Do it"));
    let of = |errors: &[Option<BadInput>]| all_failed(errors).map_err(|e| (e.found, e.remedy));
    assert_eq!(of(&[error("first"), error("second")]), Err(("first".to_owned(), "Do it".to_owned())));
    assert_eq!(of(&[error("first"), None]), Ok(()));
    assert_eq!(of(&[]), Ok(()));
    let (found, errors) = apart(vec![Ok(Some(1)), Err(BadInput::new("x", "")), Ok(None)]);
    assert_eq!(
        (found, errors.iter().map(Option::is_some).collect()),
        (vec![Some(1), None, None], vec![false, true, false])
    );
}

#[test]
fn one_draw_is_behind_what_pays_for_a_bound() {
    let rig = rig();
    let settings = settings(&GOALS, Limits::default());
    let task = Task::new(&rig, &model(&rig), &settings).unwrap();
    let [few, many] = [1.2, 1.1].map(|factor| Setting { amplitude_factor: Some(factor), ..task.unchanged() });
    // The one draw would need the shorter record, by itself.
    let mut all = vec![(few.clone(), draws(&[9.0])), (many.clone(), draws(&[5.0, 6.0, 7.0, 6.0]))];
    sort(&task, &mut all);
    assert_eq!(all[0].0, many);
    let [bounded, one] = [0, 1].map(|k: usize| task.proposal(&all[k].0, &all[k].1, None));
    assert!(bounded.decides && !bounded.is_one_draw(), "{bounded:?}");
    assert!(!one.decides && one.is_one_draw(), "{one:?}");
    assert_eq!((bounded.goals[0].draws, bounded.separations[0].draws), (4, 4));
    assert_eq!((one.goals[0].draws, one.separations[0].draws), (1, 1));
    assert!(one.goals[0].seconds < bounded.goals[0].seconds);
    // Without goals as well.
    let settings = self::settings(&[], Limits::default());
    let task = Task::new(&rig, &model(&rig), &settings).unwrap();
    let mut all = vec![(few, draws(&[9.0])), (many.clone(), draws(&[5.0, 6.0]))];
    sort(&task, &mut all);
    assert_eq!(all[0].0, many);
}

#[test]
fn one_draw_is_told_without_a_bound() {
    let rig = rig();
    let settings = settings(&GOALS, Limits::default());
    let task = Task::new(&rig, &model(&rig), &settings).unwrap();
    let told = |deviations: &[f64]| {
        let other = Setting { amplitude_factor: Some(1.1), ..task.unchanged() };
        let best = task.proposal(&other, &draws(deviations), None);
        let plan = Plan {
            rig: rig.name.clone(),
            goals: settings.goals.clone(),
            best: Some(best.clone()),
            unchanged: Some(task.proposal(&task.unchanged(), &draws(&[9.0]), Some(best.seconds))),
            others: vec![task.proposal(&task.unchanged(), &draws(&[9.0]), None)],
            wider: 1.0,
            map: Vec::new(),
            seed: 1,
        };
        (presentation::line(&plan).unwrap(), presentation::human(&plan))
    };
    let (line, human) = told(&[9.0]);
    assert!(line.contains("standard errors (one draw); as it is set now"), "{line}");
    assert!(!human.contains("97.5 %") && human.contains("not certain: it rests on one draw"), "{human}");
    assert!(human.contains("by one draw\n"), "{human}");
    assert!(
        line.contains("a record as long would tell it from backlash@joint1 at 9.0 standard errors (one draw)"),
        "{line}"
    );
    assert!(human.contains("in one draw"), "{human}");
    let (line, human) = told(&[9.0, 8.0, 10.0]);
    assert!(line.contains("standard errors; as it is") && line.ends_with(" (one draw)"), "{line}");
    assert_eq!(human.matches("97.5 %").count(), 1, "{human}");
}

#[test]
fn lengths_are_rounded_up_and_releases_counted() {
    let told = [40.2, 236.9, 240.0, 13_000.0, 2.97e6].map(presentation::length);
    assert_eq!(told, ["40 s", "4.0 minutes", "4.0 minutes", "3.7 hours", "34.4 days"]);
    let release = Setting { pose: Some(vec![1.0]), frequency_hz: None, amplitude_m: None, amplitude_factor: None };
    assert_eq!(presentation::lasting(&release, 1800.0), "90 times, for 20 s each");
    assert_eq!(presentation::lasting(&release, 15.0), "for 15 s");
    assert_eq!(presentation::lasting(&Setting { pose: None, ..release }, 1800.0), "for 30.0 minutes");
}

//! Tests of the words of reasons.

use super::super::gap::InUnit;
use super::*;

fn residual() -> Residual {
    Residual { power: 1.004, own: None, horizon_s: 0.2, gap: Miss::Floors(1.0), longer: None, whole: None }
}

fn shape() -> Unknown {
    Unknown {
        at: "joint2".to_owned(),
        against: "drive phase".to_owned(),
        against_unit: "rad".to_owned(),
        unit: "N m".to_owned(),
        points: Vec::new(),
        held_out_gain: 0.124,
    }
}

/// The words of a value, which are its JSON as well.
fn words(of: &(impl Display + Serialize)) -> String {
    assert_eq!(serde_json::to_value(of).unwrap(), serde_json::Value::String(of.to_string()));
    of.to_string()
}

/// Others read these in the JSON.
#[test]
fn what_was_compared_has_its_words() {
    assert_eq!(words(&Criterion::Gap { horizon_s: 1.0 / 3.0 }), "gap over 0.3333 s, noise floors");
    assert_eq!(words(&Criterion::Power), "power of what is left over that of the sensors' noise");
    assert_eq!(
        words(&Criterion::PowerOfWhole),
        "power of what one simulation of the whole record leaves over that of the sensors' noise"
    );
}

#[test]
fn what_is_left_has_its_words() {
    let noise = "what is left has 1.00 times the power that the sensors' noise gives, and predictions over 0.2 s miss by 1.00 noise floors";
    let torque =
        "a torque at joint2 that depends on the drive phase takes away 12 % of what is left where it was not fitted";
    let none = "no effect of the list accounts for it";
    let effects = || vec!["backlash".to_owned(), "cogging".to_owned()];
    let changed =
        Changed { at_s: 30.0, within_s: [28.0, 32.0], drifts: false, powers: [1.0, 90.0], apart: None, most: 1.05 };
    let excess = |shape, changed| Reason::Excess { residual: residual(), shape, changed };
    let patch = Patch { place: "joint1".to_owned(), effects: effects(), is_bend: false };
    let bend = Patch { place: "encoder1".to_owned(), effects: effects(), is_bend: true };
    for (reason, sentence) in [
        (Reason::Unjudged, String::new()),
        (Reason::Noise(residual()), noise.to_owned()),
        (excess(None, None), format!("{noise}; {none}")),
        (excess(Some(shape()), None), format!("{noise}; {torque}: {none}")),
        (excess(Some(shape()), Some(changed.clone())), format!("{noise}; it depends on time: {}", changed.told())),
        (Reason::Shape { residual: residual(), shape: shape() }, format!("{noise}, but {torque}: {none}")),
        (
            Reason::Patched { residual: residual(), patch: bend },
            format!(
                "{noise}, but it took backlash, cogging at encoder1 to get there, which nearly cancel: one bend of its scale that has no name in the list"
            ),
        ),
        (
            Reason::Patched { residual: residual(), patch },
            format!(
                "{noise}, but it took backlash, cogging to get there: one shape of joint1's position that has no name in the list"
            ),
        ),
    ] {
        assert_eq!(words(&reason), sentence);
    }
}

#[test]
fn what_it_is_held_against_is_told_with_it() {
    let floor = InUnit { value: 1e-7, unit: "m".to_owned() };
    let far = Residual {
        power: 12_345.0,
        own: Some(OwnRecords { mean: 1.0, most: 1.08, left_out: 1 }),
        gap: Miss::Own { value: 9.1e-3, floor },
        longer: Some((0.8, Miss::Diverged)),
        ..residual()
    };
    assert_eq!(
        words(&Reason::Noise(far)),
        "what is left has 12345 times the power that the sensors' noise gives, and predictions over 0.2 s miss by 9.10 mm (the sensors' noise is 100 nm) \
         (in records that the model itself makes it is 1.00, and up to 1.08 would be chance; one window that cannot be followed even there is left out), \
         over 0.8 s by no prediction: the fit diverged"
    );
    let fast = words(&Reason::Noise(Residual { horizon_s: 1.068e-5, ..residual() }));
    assert!(fast.contains("predictions over 0.00001068 s miss"), "{fast}");
    let whole = Residual { whole: Some((1.5, 1.128)), ..residual() };
    let told = words(&Reason::Noise(whole));
    assert!(
        told.ends_with(
            "1.00 noise floors, but one simulation of the whole record leaves 1.50 times the noise's power (up to 1.13 would be chance)"
        ),
        "{told}"
    );
}

#[test]
fn why_nothing_can_be_decided_has_its_words() {
    let of = |of_forces, windows, least_s| Undecidable::FewWindows { of_forces, windows, window_s: 2.5, least_s };
    let few = |of_forces, windows| of(of_forces, windows, Some(25.0));
    let own = |criterion, inputs: &[&str]| Undecidable::OwnRecords {
        criterion,
        value: 60.0,
        inputs: inputs.iter().map(|i| (*i).to_owned()).collect(),
    };
    let fault = Undecidable::Fault { text: "It is at fault".to_owned(), advice: "Record again".to_owned() };
    for (why, sentence) in [
        (few(false, 1), "1 whole window is too few to hold some back (2.5 s each): record at least 25 s"),
        (
            of(false, 4, None),
            "4 whole windows are too few to hold some back (2.5 s each): the motion is over, and a longer record of it would tell no more. \
             Record several releases, or with a higher sampling rate",
        ),
        (
            few(true, 4),
            "the model follows no part of the record, so that nothing can be predicted: see `whirl inspect` for the channels, and check units and \
             signs in the rig file; for its forces 4 whole windows are too few to hold some back (2.5 s each): record at least 25 s",
        ),
        (
            own(Criterion::Power, &[]),
            "what is left has 60.0 times the power of the sensors' noise, and records that the model itself makes are no better: what is missing \
             cannot be told from what the fit does not follow. Sample faster, or hold the model against a second record (`whirl validate`)",
        ),
        (
            own(Criterion::Gap { horizon_s: 0.2 }, &["current", "voltage"]),
            "predictions miss by 60.0 noise floors, and the noise of the measured current and voltage leaves about as much in records that the \
             model itself makes: what is fainter cannot be told. Measure current and voltage with less noise",
        ),
        (fault, "It is at fault. Record again"),
    ] {
        assert_eq!(words(&Reason::Undecidable(why)), sentence);
    }
}

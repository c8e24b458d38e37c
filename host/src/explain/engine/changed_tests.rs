//! Tests of the words of what changed.

use super::*;

fn changed(powers: [f64; 2], apart: Option<f64>, drifts: bool) -> Changed {
    Changed { at_s: 29.9371, within_s: [27.38, 32.5], drifts, powers, apart, most: 1.05 }
}

#[test]
fn the_words_say_when_and_what_to_do() {
    let step = changed([1.02, 9.3e4], None, false);
    assert_eq!(
        step.told(),
        "before about t = 29.94 s the model leaves nothing but noise, after it 305 times the sensors' noise (rms): \
         something in the rig changed then"
    );
    assert!(step.advice().contains("`--to 27.38` and with `--from 32.5`"), "{}", step.advice());
    assert!(changed([700.0, 1.0], None, false).told().starts_with("after about t = 29.94 s the model leaves nothing"));
    let both = changed([500.0, 700.0], Some(1.01), false).told();
    assert_eq!(
        both,
        "before about t = 29.94 s the model leaves 500 times the power of the sensors' noise, after it 700 times the \
         power of the sensors' noise, and with parameters of its own for each part nothing but noise: something in the \
         rig changed then"
    );
    let drift = changed([50.0, 67.0], Some(17.0), true).told();
    assert!(drift.contains("67.0 times the power") && drift.ends_with("something in the rig drifts along the record"));
}

/// Of a clock that counts from 1970, and of a motion of microseconds.
#[test]
fn instants_are_told_as_finely_as_windows_are_long() {
    assert_eq!(time(1_700_000_029.937, 100.0), "1700000030");
    assert_eq!(time(1.234_567e-3, 2e-5), "0.0012346");
}

#[test]
fn the_warning_says_whose_the_parameters_are() {
    let step = changed([1.02, 9.3e4], None, false);
    let one = step.warning([0.9999, 0.5], false);
    assert_eq!(one.id, "depends-on-time");
    assert!(one.text.contains("of the part before t = 29.94 s: windows after it miss"), "{}", one.text);
    assert!(step.warning([1e-4, 0.5], false).text.contains("of the part after t = 29.94 s: windows before it miss"));
    for between in [step.warning([0.5, 0.5], false), step.warning([0.9999, 0.5], true)] {
        assert!(between.text.contains("but lie between"), "{}", between.text);
    }
}

#[test]
fn time_stands_before_other_places() {
    let place = |against: &str, from: f64, equation: usize| Where {
        equation,
        against: against.to_owned(),
        from,
        to: from + 5.0,
        value: 2.0,
        band: 1.0,
        units: ("Hz".to_owned(), "N m".to_owned()),
    };
    let mut places = vec![place("frequency", 0.0, 1), place("time", 10.0, 1), place("time", 40.0, 2)];
    put_first(&mut places, [30.0, 60.0]);
    assert_eq!((places.len(), places[0].equation, places[0].against.as_str()), (4, 2, "time"));
    assert_eq!(places[0].stretch(), "time 30.0 … 60.0 s");
    let mut others = vec![place("frequency", 0.0, 1)];
    put_first(&mut others, [30.0, 60.0]);
    assert_eq!((others[0].equation, others[0].units.1.as_str()), (1, "N m"));
    put_first(&mut Vec::new(), [30.0, 60.0]);
}

//! What options make of an excitation, and what is refused.

use core::f64::consts::TAU;

use super::*;

fn asked(change: impl Fn(&mut Excite)) -> Result<Excitation> {
    let mut excite = Excite::default();
    change(&mut excite);
    excite.excitation(5_000, 4_000)
}

#[test]
fn options_become_what_the_device_is_told() {
    assert_eq!(asked(|_| {}).unwrap(), Excitation::sine(5_000, 4_000));
    let sweep =
        asked(|e| (e.sweep, e.sweep_s, e.logarithmic, e.back) = ("2..8.5".parse().ok(), Some(60.0), true, true));
    let glide = Glide { law: Law::Logarithmic, back: true, to_millihertz: 8_500, ms: 60_000 };
    assert_eq!(sweep.unwrap(), Excitation { glide, ..Excitation::sine(5_000, 2_000) });
    let steps = asked(|e| (e.amplitude_steps_m, e.hold_s, e.on_trigger) = (vec![0.004, 0.0085], Some(2.5), true));
    let steps = steps.unwrap();
    assert_eq!((steps.amplitudes(), steps.hold_ms, steps.on_trigger), (&[4_000, 8_500][..], 2_500, true));
    assert_eq!(words(&steps), "4, 8.5 mm at 4 Hz, each for 2.5 s");
}

#[test]
fn what_cannot_be_names_its_option() {
    let band = |text: &str| text.parse::<Band>().ok();
    for (refused, part) in [
        (asked(|e| e.sweep = band("2..8")), "--sweep-s"),
        (asked(|e| e.sweep_s = Some(3.0)), "--sweep"),
        (asked(|e| (e.sweep, e.sweep_s) = (band("2..8.0001"), Some(3.0))), "0.001 Hz"),
        (asked(|e| (e.sweep, e.sweep_s) = (band("0..8"), Some(3.0))), "above 0"),
        (asked(|e| (e.sweep, e.sweep_s) = (band("2..8"), Some(0.05))), "0.1 to 3600 s"),
        (asked(|e| e.multisine = vec![1, 2, 1]), "harmonic 1"),
        (asked(|e| e.multisine = vec![0]), "harmonic 0"),
        (asked(|e| e.multisine = vec![1, 2, 3, 4, 5, 6, 7]), "at most 6"),
        (asked(|e| e.amplitude_steps_m = vec![0.001; 9]), "at most 8"),
        (asked(|e| e.amplitude_steps_m = vec![0.001; 2]), "--hold-s"),
        (asked(|e| (e.amplitude_steps_m, e.hold_s) = (vec![0.001; 2], Some(0.2))), "0.5 s or more"),
        (asked(|e| (e.amplitude_steps_m, e.hold_s) = (vec![-0.001], Some(2.0))), "amplitudes in m"),
        (asked(|e| e.hold_s = Some(2.0)), "--amplitude-steps"),
        (asked(|e| (e.table, e.multisine) = (Some("t".into()), vec![1])), "--table with --multisine"),
        (
            asked(|e| (e.table, e.sweep, e.sweep_s) = (Some("t".into()), band("2..8"), Some(3.0))),
            "--table with --sweep",
        ),
    ] {
        let text = refused.unwrap_err().to_string();
        assert!(text.contains(part), "{text} has no {part}");
    }
    assert_eq!(["2", "a..b", "2..", ""].map(|text| text.parse::<Band>().is_ok()), [false; 4]);
}

#[test]
fn schroeder_s_phases_keep_the_crest_low() {
    let crest = |form: &Form| {
        let greatest = (0..4_096_u32).map(|i| form.displacement(1_000_000, i << 20).unsigned_abs()).max().unwrap();
        let rms: f64 = form.components().map(|c| (1e6 * f64::from(c.share) / 32_768.0).powi(2) / 2.0).sum();
        f64::from(greatest) / rms.sqrt()
    };
    for harmonics in [&[1, 2, 3][..], &[1, 2, 3, 4, 5], &[1, 2, 3, 4, 5, 6]] {
        let schroeder = multisine(harmonics).unwrap();
        let mut alike = schroeder;
        alike.0.iter_mut().for_each(|c| c.phase = 0);
        // All in step: √(2N).
        assert!((crest(&alike) - (2.0 * harmonics.len() as f64).sqrt()).abs() < 0.01);
        assert!(crest(&schroeder) < 0.9 * crest(&alike), "{} {}", crest(&schroeder), crest(&alike));
        let total: u32 = schroeder.components().map(|c| u32::from(c.share)).sum();
        assert!((32_763..=32_768).contains(&total));
    }
    let third = multisine(&[1, 2, 3]).unwrap().0[2];
    // −π · 3 · 2/3: a whole turn behind.
    assert!((TAU * f64::from(third.phase) / 65_536.0).cos() > 0.999_999);
}

#[test]
fn a_continuation_asks_for_the_same() {
    let mut excite = Excite { sweep: "2..8".parse().ok(), sweep_s: Some(60.0), back: true, ..Excite::default() };
    assert_eq!(excite.options(), ["--sweep", "2..8", "--sweep-s", "60", "--sweep-back"]);
    excite = Excite { multisine: vec![1, 3], amplitude_steps_m: vec![0.004], hold_s: Some(1.0), ..Excite::default() };
    assert_eq!(excite.options(), ["--multisine", "1,3", "--amplitude-steps", "0.004", "--hold-s", "1"]);
    excite = Excite { table: Some("a b.csv".into()), ..Excite::default() };
    assert_eq!(excite.options(), ["--table", "a b.csv"]);
    assert!(excite.is_asked() && !Excite::default().is_asked());
}

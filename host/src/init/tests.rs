//! Tests of drafts from small files; whole records are in the end-to-end tests.

use super::*;
use crate::record::{Column, Segment};

fn drafted(name: &str, text: &str, system: Option<&str>) -> Result<Draft> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    let settings = Settings {
        system: system.map(str::to_owned),
        output: folder.path().join("rig.toml"),
        needs_system: true,
        ..Settings::default()
    };
    draft(&path, &settings)
}

fn rows(n: usize, f: impl Fn(f64) -> String) -> String {
    (0..n).map(|i| f(i as f64) + "\n").collect()
}

fn channel<'a>(draft: &'a Draft, name: &str) -> &'a DraftChannel {
    draft.channels.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no {name}"))
}

#[test]
fn units_come_from_names_and_values() {
    let text = format!(
        "time_ms,x_mm,Force (N),note,row\n{}",
        rows(3000, |i| format!("{},{:.3},{:.3},a,{i}", 2.0 * i, 10.0 * (0.02 * i).sin(), (0.05 * i).cos()))
    );
    let d = drafted("a.csv", &text, Some("positioning-drive")).unwrap();
    assert_eq!((d.sample_rate_hz, d.time.column.as_deref(), d.time.unit.as_deref()), (500.0, Some("time_ms"), None));
    assert_eq!((channel(&d, "x_mm").unit.as_str(), channel(&d, "x_mm").measures.as_str()), ("mm", "q"));
    assert_eq!((channel(&d, "Force (N)").unit.as_str(), channel(&d, "Force (N)").measures.as_str()), ("N", "force"));
    let unused: Vec<&str> = d.unused.iter().map(|s| s.of.as_str()).collect();
    assert_eq!(unused, ["note", "row"]);
    let rig = d.rig().unwrap();
    assert_eq!((rig.channel.len(), rig.sample_rate_hz), (2, 500.0));
}

#[test]
fn a_time_without_name_or_unit_is_found_and_marked() {
    let text = rows(3000, |i| format!("{},{:.4}", 2000.0 * i, (0.02 * i).sin()));
    let d = drafted("bare.csv", &text, Some("positioning-drive")).unwrap_err().to_string();
    assert!(d.contains("a column for") && d.contains("--map"), "{d}");
    let text = rows(3000, |i| format!("{},{:.4},{:.3}", 2000.0 * i, (0.02 * i).sin(), (0.07 * i).cos()));
    let d = drafted("bare.csv", &text, Some("positioning-drive")).unwrap();
    assert_eq!((d.time.column.as_deref(), d.time.unit.as_deref(), d.sample_rate_hz), (Some("c1"), None, 0.0005));
    assert!(d.why_time.iter().any(|s| s.check && s.taken_for == "the time"));
    assert!(d.channels.iter().all(|c| c.unit == "1" && c.why.iter().any(|s| s.check)));
    // Seconds, as every command reads it.
    let text = write::text(&d);
    assert!(
        text.contains("# CHECK: a time in s: no unit")
            && text.contains("500 Hz in us: ")
            && text.contains("--time c1:us"),
        "{text}"
    );
}

#[test]
fn a_time_whose_rate_in_seconds_no_rig_has_is_in_another_unit() {
    let text = rows(3000, |i| format!("{},{:.4},{:.3}", 2e6 * i, (0.02 * i).sin(), (0.07 * i).cos()));
    let d = drafted("bare.csv", &text, Some("positioning-drive")).unwrap();
    assert_eq!((d.time.unit.as_deref(), d.sample_rate_hz), (Some("ns"), 500.0));
    assert!(write::text(&d).contains("# CHECK: a time in ns"));
}

/// As PASCO's Capstone names them.
#[test]
fn units_stand_before_what_a_run_is_called() {
    let text = format!(
        "Time (s) Run 8,Position (m) Run 8,Force (N) Run 8\n{}",
        rows(3000, |i| format!("{:.3},{:.3},{:.3}", 0.002 * i, (0.02 * i).sin(), (0.05 * i).cos()))
    );
    for text in [text.clone(), text.replace("Position (m)", "Pull (N)").replace("Force (N)", "Way (m)")] {
        let d = drafted("a.csv", &text, Some("positioning-drive")).unwrap();
        let of = |measures: &str| d.channels.iter().find(|c| c.measures == measures).unwrap();
        assert!(of("q").name.contains("(m)") && of("force").name.contains("(N)"), "{:?}", d.channels);
        assert_eq!(
            (of("q").unit.as_str(), of("force").unit.as_str(), d.time.column.as_deref()),
            ("m", "N", Some("Time (s) Run 8"))
        );
    }
}

#[test]
fn a_map_may_compute_a_channel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bob.csv");
    let at = |i: f64| 0.6 * (0.03 * i).cos();
    let text = format!("t,x,y\n{}", rows(3000, |i| format!("{:.3},{:.5},{:.5}", 0.01 * i, at(i).sin(), -at(i).cos())));
    std::fs::write(&path, text).unwrap();
    let with = |map: &str| {
        let choices = Choices { map: vec![crate::rig::choices::pair(map).unwrap()], ..Choices::default() };
        let output = folder.path().join("rig.toml");
        draft(&path, &Settings { choices, output, needs_system: true, ..Settings::default() })
    };
    let d = with("theta1==atan2(x,-y)").unwrap();
    assert_eq!(d.model.as_deref(), Some("single-pendulum"));
    let c = channel(&d, "=atan2(x,-y)");
    assert_eq!((c.measures.as_str(), c.unit.as_str()), ("theta1", "rad"));
    assert!(d.unused.iter().any(|s| s.of == "x" && s.why == "stands in =atan2(x,-y)"), "{:?}", d.unused);
    let wrong = with("theta1==atan2(z,-y)").unwrap_err().to_string();
    assert!(wrong.contains('z'), "{wrong}");
}

#[test]
fn counts_of_a_rail_are_mapped_to_a_displacement() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cart.csv");
    let cart = |i: f64| (900.0 * (0.02 * i).sin()).floor();
    let row =
        |i: f64| format!("{},{},{},{:.3}", 10.0 * i, cart(i), (600.0 * (0.03 * i).cos()).floor(), (0.02 * i).cos());
    std::fs::write(&path, format!("millis,cart_counts,pend_counts,force_N\n{}", rows(3000, row))).unwrap();
    let with = |map: &str| {
        let choices = Choices { map: vec![crate::rig::choices::pair(map).unwrap()], ..Choices::default() };
        let system = Some("cart-pendulum".to_owned());
        let output = folder.path().join("rig.toml");
        draft(&path, &Settings { choices, system, output, needs_system: true, ..Settings::default() })
    };
    for (map, name) in [("x=cart_counts", "cart_counts"), ("x==cart_counts*22.7e-6", "=cart_counts*22.7e-6")] {
        let d = with(map).unwrap();
        assert_eq!(d.sample_rate_hz, 100.0);
        let c = channel(&d, name);
        assert_eq!((c.measures.as_str(), c.unit.as_str(), c.counts_per_turn), ("x", "m", None));
        assert!(c.why.iter().any(|s| s.check), "{:?}", c.why);
    }
}

#[test]
fn a_sensors_voltage_is_mapped_to_an_angle_with_a_gain_to_check() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scope.csv");
    let volt = |i: f64| 2.5 + (0.8 * (-i / 900.0).exp() * (0.05 * i).sin() * 100.0).round() / 100.0;
    std::fs::write(
        &path,
        format!("t,CH1 (Volt),y_mm\n{}", rows(3000, |i| format!("{},{:.2},{}", 0.01 * i, volt(i), i.sin()))),
    )
    .unwrap();
    let with = |map: &str, system: &str| {
        let choices = Choices { map: vec![crate::rig::choices::pair(map).unwrap()], ..Choices::default() };
        let output = folder.path().join("rig.toml");
        let system = Some(system.to_owned());
        draft(&path, &Settings { choices, system, output, needs_system: true, ..Settings::default() })
    };
    let d = with("theta1=CH1 (Volt)", "single-pendulum").unwrap();
    let c = channel(&d, "CH1 (Volt)");
    assert_eq!((c.measures.as_str(), c.unit.as_str(), c.gain), ("theta1", "deg", Some(36.0)));
    assert!(
        c.why.iter().any(|s| s.check && s.why.contains("10 V a turn") && s.why.contains("gain, and offset")),
        "{c:?}"
    );
    assert_eq!(d.rig().unwrap().channel[0].gain, Some(36.0));
    // What is no sensor's voltage must be what it is mapped to, and the message says what else
    // there is.
    let e = with("theta1=y_mm", "single-pendulum").unwrap_err().to_string();
    assert!(
        e.contains("found y_mm, a displacement, expected a column for theta1, an angle") && e.contains("gain what one"),
        "{e}"
    );
}

#[test]
fn a_cart_and_a_force_are_no_double_pendulum_without_a_word() {
    let cart = |i: f64| (9000.0 * (0.02 * i).sin()).floor();
    let row =
        |i: f64| format!("{},{},{},{:.3}", 0.002 * i, cart(i), (600.0 * (0.03 * i).cos()).floor(), (0.02 * i).cos());
    let text = |names: &str| format!("t,{names}\n{}", rows(3000, row));
    let e = drafted("a.csv", &text("cart_counts,pend_counts,force_N"), None).unwrap_err().to_string();
    assert!(e.contains("--system: found 3 channels: cart_counts") && e.contains("cart-pendulum"), "{e}");
    let d = drafted("a.csv", &text("enc_a,enc_b,force_N"), None).unwrap();
    let model = d.why_model.iter().find(|s| s.of == "model" && s.check).unwrap();
    assert!(model.why.contains("has no place for force_N") && model.why.contains("--system"), "{model:?}");
    // Numbers that few encoders have are to be checked at least.
    let is_doubted = |c: &DraftChannel| c.why.iter().any(|w| w.check && w.taken_for.ends_with("counts a turn"));
    let is_common = |c: &DraftChannel| c.counts_per_turn.is_some_and(|n| (400..=131_072).contains(&n));
    assert!(d.channels.iter().all(|c| is_common(c) || is_doubted(c)), "{:?}", d.channels);
}

#[test]
fn a_gyroscopes_rate_is_no_angle_and_what_to_do_is_told() {
    let row = |i: f64| format!("{},{:.4}", 0.005 * i, (0.02 * i).sin());
    let e = drafted("a.csv", &format!("Time (s),Gyroscope z (rad/s)\n{}", rows(3000, row)), None).unwrap_err();
    let e = e.to_string();
    assert!(
        e.contains("expected a column of an angle or a displacement") && e.contains("its sum over the rows"),
        "{e}"
    );
}

/// A channel of that name and nothing else.
pub(super) fn channel_of(name: &str) -> DraftChannel {
    DraftChannel {
        name: name.to_owned(),
        measures: String::new(),
        unit: "deg".to_owned(),
        counts_per_turn: None,
        gain: None,
        why: Vec::new(),
    }
}

/// A draft of nothing but channels.
pub(super) fn draft_of(channels: Vec<DraftChannel>) -> Draft {
    Draft {
        record: PathBuf::new(),
        at: PathBuf::new(),
        name: String::new(),
        model: None,
        why_model: Vec::new(),
        sample_rate_hz: 1.0,
        time: TimeChoice::default(),
        why_time: Vec::new(),
        drive: None,
        channels,
        unused: Vec::new(),
        stored: None,
    }
}

#[test]
fn a_rate_is_not_rounded_beyond_what_is_told_as_another() {
    let mut segment = Segment::new(0.0, 1.0 / 1945.88, vec![Column::Values(vec![0.0; 20])]);
    segment.jitter_s = 0.3 * segment.step_s;
    let record = Record { sample_rate_hz: 1945.88, segments: vec![segment], ..Record::default() };
    let rate = raw::nice_rate(&record);
    assert!((rate / 1945.88 - 1.0).abs() < crate::identify::suspects::RATE, "{rate}");
}

#[test]
fn the_truth_of_a_simulated_rig_stays_out() {
    let text = "name = \"x\"\n[plant]\nm1 = 1\n[[plant.input]]\nb = 2\n[known]\nm2 = 3\n";
    assert_eq!(without_plant(text), "name = \"x\"\n[known]\nm2 = 3\n");
}

#[test]
fn numbers_are_rounded_within_their_error() {
    assert_eq!(raw::nice(499.999_97, 1e-6), 500.0);
    assert_eq!(raw::nice(610.351_6, 1e-8), 610.351_6);
    assert_eq!(raw::nice(5.000_21, 1e-4), 5.0);
}

#[test]
fn what_a_column_is_called_cannot_break_the_file() {
    let name = "a\"b = # [x]";
    let text = format!(
        "t;{}\n{}",
        "angle 'q' # [x] (deg)",
        rows(3000, |i| format!("{};{:.4}", 0.01 * i, 40.0 * (0.03 * i).sin()))
    );
    let d = drafted("odd.csv", &text, None).unwrap();
    assert_eq!(d.rig().unwrap().channel[0].name, "angle 'q' # [x] (deg)");
    let mut d = d;
    d.channels[0].name = name.to_owned();
    d.name = "two\nlines".to_owned();
    assert_eq!(d.rig().unwrap().channel[0].name, name);
}

#[test]
fn names_that_are_not_utf8_are_told_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("latin.csv");
    let text = format!("Zeit [us];Weg [mm]\n{}", rows(50, |i| format!("{};{:.3}", 2000.0 * i, (0.3 * i).sin())));
    std::fs::write(&path, &text).unwrap();
    assert_eq!(garbled_names(&path), None);
    let latin: Vec<u8> = text.bytes().enumerate().map(|(i, b)| if i == 6 { 0xb5 } else { b }).collect();
    std::fs::write(&path, latin).unwrap();
    let told = garbled_names(&path).unwrap();
    assert!(told.id == "names-not-utf8" && told.advice.contains("iconv -f latin1 -t utf8"), "{told:?}");
}

#[test]
fn a_word_for_a_missing_value_is_a_gap_and_another_word_is_told_with_its_line() {
    let text = |word: &str, line: usize| {
        let cell = |i: f64| if i as usize + 2 == line { word.to_owned() } else { format!("{:.4}", (0.02 * i).sin()) };
        format!("t,x_mm,force_N\n{}", rows(3000, |i| format!("{},{},{:.3}", 0.002 * i, cell(i), (0.07 * i).cos())))
    };
    for word in ["NA", "-", "n/a", "null", "#N/A", "NaN", "None", "-nan(ind)", ""] {
        for line in [3, 20, 200] {
            let d = drafted("a.csv", &text(word, line), Some("positioning-drive")).unwrap();
            assert_eq!(channel(&d, "x_mm").measures, "q", "{word} in line {line}");
        }
    }
    for line in [20, 200] {
        let e = drafted("a.csv", &text("broken", line), Some("positioning-drive")).unwrap_err().to_string();
        assert!(e.contains(&format!("line {line}")) && e.contains("found \"broken\", expected a number. Mend"), "{e}");
    }
    // A column of remarks is none of numbers.
    let plain = text("", 0);
    let noted: String =
        plain.lines().enumerate().map(|(i, l)| format!("{l},{}\n", if i % 3 == 0 { "1" } else { "ok" })).collect();
    let d = drafted("a.csv", &noted, Some("positioning-drive")).unwrap();
    assert!(d.unused.iter().any(|s| s.why.contains("are no numbers")), "{:?}", d.unused);
}

#[test]
fn a_name_that_two_columns_have_is_told() {
    let head = |names: &str| {
        let row =
            |i: f64| format!("{},{:.4},{:.3},{:.3}", 0.002 * i, (0.02 * i).sin(), (0.07 * i).cos(), (0.05 * i).cos());
        format!("{names}\n{}", rows(3000, row))
    };
    let d = drafted("a.csv", &head("t,x_mm,y,y"), None).unwrap_err().to_string();
    assert!(d.contains("1 channel"), "{d}");
    let e = drafted("a.csv", &head("t,x,x,x"), None).unwrap_err().to_string();
    assert!(e.contains("x: 3 columns have this name in the header: rename them"), "{e}");
}

#[test]
fn a_column_in_a_unit_of_another_kind_is_left_out_and_marked() {
    let text = |head: &str, more: bool| {
        let row = |i: f64| {
            let push = if more { format!(",{:.3}", (0.03 * i).cos()) } else { String::new() };
            format!("{},{:.3},{:.3},{:.2}{push}", 0.002 * i, (0.02 * i).sin(), 9.0 * (0.05 * i).cos(), (0.07 * i).cos())
        };
        format!("{head}\n{}", rows(3000, row))
    };
    let e = drafted("a.csv", &text("t,x_mm,theta_deg,I / mA", false), Some("cart-pendulum")).unwrap_err().to_string();
    assert!(e.contains("I / mA (a measured quantity in A)"), "{e}");
    assert!(e.contains("expected a column for force, a measured quantity in N"), "{e}");
    let d = drafted("a.csv", &text("t,x_mm,theta_deg,I / mA,push", true), Some("cart-pendulum")).unwrap();
    assert_eq!(channel(&d, "push").measures, "force");
    let left = d.unused.iter().find(|s| s.of == "I / mA").unwrap();
    assert!(left.check && left.why.contains("its unit A is none of force"), "{left:?}");
}

/// A model file of one displacement.
const SPRING: &str = "name = \"s\"\ntime = \"s\"\ncoordinates = [{ name = \"x\", space = \"R\" }]\n\
    [[equation]]\nbalance = \"-x''\"\nterms = { k = \"x\", c = \"x'\", o = \"1\" }\n";

fn of_spring(text: &str) -> Result<Draft> {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("spring.toml");
    std::fs::write(&model, SPRING).unwrap();
    drafted("a.csv", text, model.to_str())
}

#[test]
fn whole_numbers_are_counts_only_where_something_says_so() {
    let text = |name: &str, size: f64| {
        let at = |i: f64| size * (-i / 600.0).exp() * (0.03 * i).sin();
        format!("t,{name}\n{}", rows(3000, |i| format!("{:.3},{}", 0.01 * i, at(i).round())))
    };
    for name in ["enc_a", "MotorEncoder", "ticks 1", "pos_raw", "theta"] {
        let d = drafted("a.csv", &text(name, 500.0), Some("single-pendulum")).unwrap();
        assert_eq!(channel(&d, name).unit, "count", "{name}");
    }
    for name in ["x", "Pixel (X) [px]", "level"] {
        let d = of_spring(&text(name, 100.0)).unwrap();
        let c = channel(&d, name);
        assert_eq!((c.unit.as_str(), c.measures.as_str(), c.counts_per_turn), ("1", "x", None), "{name}");
        assert!(c.why.iter().any(|s| s.check), "{name}: {:?}", c.why);
        // Nothing says what they are, and so not which system they are of.
        assert!(drafted("a.csv", &text(name, 100.0), None).unwrap_err().to_string().contains("--system"), "{name}");
    }
    // More levels than a converter has.
    let d = drafted("a.csv", &text("ch_a", 60_000.0), Some("single-pendulum")).unwrap();
    assert!(channel(&d, "ch_a").why.iter().any(|s| s.why.starts_with("whole numbers from")));
    // A system whose only quantity is an angle makes them an encoder's.
    let d = drafted("a.csv", &text("x", 500.0), Some("single-pendulum")).unwrap();
    let c = channel(&d, "x");
    assert!(c.unit == "count" && c.counts_per_turn.is_some(), "{c:?}");
}

#[test]
fn of_more_columns_than_a_system_needs_those_are_meant_that_move_most() {
    let head = |names: &str, sizes: [f64; 3]| {
        let of = |k: usize, i: f64| sizes[k] * ((0.02 + 0.01 * k as f64) * i).sin();
        let row = |i: f64| format!("{:.3},{:.4},{:.4},{:.4}", 0.01 * i, of(0, i), of(1, i), of(2, i));
        format!("{names}\n{}", rows(3000, row))
    };
    let d = of_spring(&head("t,Pixel (X) [px],X Position [mm],Y Position [cm]", [300.0, 4.0, 3.3])).unwrap();
    let told = d.why_model.iter().find(|s| s.of == "Y Position [cm]").unwrap();
    assert!(d.channels.len() == 1 && d.channels[0].name == "Y Position [cm]" && d.channels[0].measures == "x");
    assert!(
        told.check && told.why.contains("X Position [mm] may be meant as well") && told.why.contains("--map x="),
        "{told:?}"
    );
    // A capacitor's voltage is no temperature.
    let d = of_spring(&head("t,V_R,V_C,T_C", [0.07, 1.3, 40.0])).unwrap();
    assert_eq!(d.channels[0].name, "V_C");
    assert!(d.unused.iter().any(|s| s.of == "T_C" && s.why.contains("rate or another quantity")), "{:?}", d.unused);
    // As many as are needed stand in their order, and nothing is to be checked of that.
    let d = drafted("a.csv", &head("t,x_mm,theta_deg,push_N", [4.0, 30.0, 9.0]), Some("cart-pendulum")).unwrap();
    assert!(d.why_model.iter().all(|s| !s.check), "{:?}", d.why_model);
}

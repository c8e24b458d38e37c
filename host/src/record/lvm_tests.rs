use super::super::{Column, Record};
use super::*;

const HEAD: &str = "LabVIEW Measurement\t\r\nWriter_Version\t2\r\nReader_Version\t2\r\nSeparator\tTab\r\nDecimal_Separator\t.\r\n\
    Multi_Headings\tYes\r\nX_Columns\tOne\r\nTime_Pref\tAbsolute\r\nDate\t2026/11/23\r\nTime\t12:00:00.1234567890123456789\r\n\
    ***End_of_Header***\t\r\n\t\r\n";

fn segment(time: &str, titles: &str) -> String {
    format!(
        "Channels\t2\t\t\t\r\nSamples\t50\t50\t\r\nDate\t2026/11/23\t2026/11/23\t\r\nTime\t{time}\t{time}\t\r\nX_Dimension\tTime\tTime\t\r\n\
         X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t\r\nDelta_X\t0.010000\t0.010000\t\r\n***End_of_Header***\t\t\t\r\n{titles}\r\n"
    )
}

fn swing(i: usize) -> f64 {
    ((i as f64 * 0.07).sin() * 1e6).round() / 1e6
}

fn rows(n: std::ops::Range<usize>, row: impl Fn(usize, f64, f64) -> String) -> String {
    let from = n.start;
    n.map(|i| row(i - from, (i - from) as f64 * 0.01, swing(i)) + "\r\n").collect()
}

fn read(text: &str, name: &str) -> Result<Record> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.lvm");
    std::fs::write(&path, text).unwrap();
    let rig = format!(
        "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"{name}\"\nmeasures = \"q\"\nunit = \"mm\"\n"
    );
    Record::read(&path, &Rig::parse(&rig, Path::new("rig.toml")).unwrap(), &ReadOptions::default())
}

#[test]
fn one_column_of_times_none_and_one_a_channel() {
    let want = Column::Values((0..60).map(swing).collect());
    let one = format!("{HEAD}{}", segment("12:00:00.5", "X_Value\tAngle\tForce\tComment"));
    let one =
        one + &rows(0..60, |i, t, x| format!("{t:.6}\t{x:.6}\t1.5{}", if i == 0 { "\tbegun by hand" } else { "" }));
    let none = one.replace("X_Columns\tOne", "X_Columns\tNo");
    let none = none.lines().map(|l| match l.split_once('\t') {
        Some((t, rest)) if t.contains("0.") => format!("\t{rest}\r\n"),
        _ => format!("{l}\r\n"),
    });
    let none: String = none.collect();
    let comma = one.replace("Decimal_Separator\t.", "Decimal_Separator\t,").replace("0.", "0,").replace("1.5", "1,5");
    let multi = format!("{HEAD}{}", segment("12:00:00.5", "X_Value\tAngle\tX_Value\tForce\tComment"))
        .replace("X_Columns\tOne", "X_Columns\tMulti");
    let multi = multi + &rows(0..60, |_, t, x| format!("{t:.6}\t{x:.6}\t{t:.6}\t1.5"));
    for text in [&one, &none, &comma, &multi] {
        let r = read(text, "Angle").unwrap_or_else(|e| panic!("{e}: {text}"));
        assert_eq!((r.samples(), &r.segments[0].columns[0]), (60, &want), "{text}");
        assert!((r.segments[0].step_s - 0.01).abs() < 1e-9);
    }
    let listed = super::super::formats::columns;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("r.lvm"), &multi).unwrap();
    let names = listed(&folder.path().join("r.lvm"), &Default::default()).unwrap();
    assert_eq!(names.iter().map(|l| l.name.as_str()).collect::<Vec<_>>(), ["X_Value", "Angle", "Force"]);
    // Other rates side by side.
    let message = read(&multi.replace("0.300000\t1.5", "0.305\t1.5"), "Angle").unwrap_err().to_string();
    assert!(message.contains("line ") && message.contains("sampled together"), "{message}");
}

#[test]
fn segments_stand_where_their_clock_says() {
    let titles = "X_Value\tAngle\tForce\tComment";
    let first =
        format!("{HEAD}{}", segment("12:00:00.5", titles)) + &rows(0..50, |_, t, x| format!("{t:.6}\t{x:.6}\t2"));
    let text = first.clone()
        + "\r\n"
        + &segment("12:00:02.5", titles)
        + &rows(200..260, |_, t, x| format!("{t:.6}\t{x:.6}\t2"));
    let r = read(&text, "Angle").unwrap();
    assert_eq!((r.samples(), r.segments.len(), r.losses.gaps), (110, 2, 1));
    assert!((r.segments[1].start_s - 2.0).abs() < 1e-9, "{}", r.segments[1].start_s);
    assert_eq!(r.segments[1].columns[0], Column::Values((200..260).map(swing).collect()));
    let message = read(&(first + &segment("12:00:02.5", "X_Value\tOther\tForce")), "Angle").unwrap_err().to_string();
    assert!(message.contains("a segment of the columns \"Other, Force\""), "{message}");
}

#[test]
fn mistakes_name_their_line() {
    let text = format!("{HEAD}{}", segment("12:00:00.5", "X_Value\tAngle\tForce\tComment"));
    let text = text + &rows(0..50, |_, t, x| format!("{t:.6}\t{x:.6}\t2"));
    let line = text.lines().position(|l| l.starts_with("0.300000")).unwrap() + 1;
    for (from, to, parts) in [
        ("0.300000\t", "0.300000\tabc", &["column Angle", "a number"][..]),
        ("0.300000\t", "0.300000\t1\t2\t3\t", &["6 cells"]),
    ] {
        let message = read(&text.replace(from, to), "Angle").unwrap_err().to_string();
        assert!(parts.iter().all(|p| message.contains(p)), "{message}");
        assert!(message.contains(&format!("line {line}")), "{line}: {message}");
    }
    let message = read(HEAD, "Angle").unwrap_err().to_string();
    assert!(message.contains("after 1 lines") && message.contains("export it as CSV"), "{message}");
    let message = read(&text.replace("X_Columns\tOne", "X_Columns\tTwo"), "Angle").unwrap_err().to_string();
    assert!(message.contains("One, Multi or No"), "{message}");
}

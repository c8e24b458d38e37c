//! Tests of what is said of CSV files whose mistake shows its cause.

use super::*;

const RIG: &str = "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n\
    [[channel]]\nname = \"count1\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n\
    [[channel]]\nname = \"angle\"\nmeasures = \"theta2\"\nunit = \"rad\"\n";

fn read(bytes: &[u8]) -> Result<Record> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    std::fs::write(&path, bytes).unwrap();
    Record::read(&path, &Rig::parse(RIG, Path::new("rig.toml")).unwrap(), &ReadOptions::default())
}

#[test]
fn a_last_number_that_may_be_cut_is_left_out() {
    let body = |last: &str| {
        let rows = (0..50).map(|i| format!("{:.3},{},{:.3}\n", 0.002 * f64::from(i), 3 * i, 0.5 + 1e-3 * f64::from(i)));
        let text: String = rows.collect();
        let (head, _) = text.trim_end().rsplit_once(',').unwrap();
        format!("t,count1,angle\n{head},{last}")
    };
    for (last, samples) in [("0.549", 50), ("0.54", 49), ("0", 49), ("-0.549", 50), ("99999", 49)] {
        let r = read(body(last).as_bytes()).unwrap();
        let told = r.warnings.iter().find(|w| w.id == "no-line-feed").unwrap();
        assert_eq!((r.samples(), told.text.contains("left out")), (samples, samples == 49), "{last}: {told:?}");
    }
    assert_eq!(read((body("0.5") + "\n").as_bytes()).unwrap().samples(), 50);
}

#[test]
fn a_cause_that_shows_is_named() {
    let rows = |f: &dyn Fn(usize) -> String| (0..40).map(|i| f(i) + "\n").collect::<String>();
    let clock = |i: usize| if i < 20 { format!("23:59:59.{:03}", 980 + i) } else { format!("00:00:00.{:03}", i - 20) };
    let timed = format!("t,count1,angle\n{}", rows(&|i| format!("{},1,0.{i}", clock(i))));
    let comma = format!("t,count1,angle\n{}", rows(&|i| format!("\"0,{:03}\",1,0.{i}", 2 * i)));
    let cell = format!("t,count1,angle\n{}", rows(&|i| format!("0.{:03},1,\"0,{i}\"", 2 * i)));
    let old = rows(&|i| format!("0.{:03},1,0.{i}", 2 * i)).replace('\n', "\r");
    for (text, parts) in [
        (timed, ["\"00:00:00.000\" behind a later time of day", "The clock passed midnight"]),
        (comma, ["found \"0,000\"", "A decimal comma is not read where commas stand"]),
        (cell, ["line 2, column angle", "A decimal comma is not read where commas stand"]),
        (format!("t,count1,angle\r{old}"), ["a carriage return alone", "tr '"]),
    ] {
        let e = read(text.as_bytes()).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(parts.iter().all(|p| e.contains(p)), "{e}");
    }
    for marked in [true, false] {
        let units = format!("{}t,count1\n0,1\n", if marked { "\u{feff}" } else { "" });
        let bytes: Vec<u8> = units.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let e = read(&bytes).unwrap_err().to_string();
        assert!(e.contains("text in UTF-16") && e.contains("Save it as UTF-8") && e.contains("iconv -f UTF-16"), "{e}");
    }
}

#[test]
fn what_an_instrument_writes_above_its_rows_is_understood() {
    let rows = |f: &dyn Fn(usize) -> String| (0..40).map(|i| f(i) + "\n").collect::<String>();
    // No time but for a line that says how far apart the rows are.
    let values = rows(&|i| format!("{},0.{i:02}", (i * i) % 7));
    let scope = format!("Scope,X\nSampling Period,2.000E-03,\nMode,Fast,\ncount1,angle\n{values}");
    let r = read(scope.as_bytes()).unwrap();
    assert!(r.samples() == 40 && (r.segments[0].step_s - 0.002).abs() < 1e-12, "{:?}", r.segments[0].step_s);
    assert!(
        r.warnings.iter().any(|w| w.id == "head-passed-over" && w.text.contains("0.002 s apart")),
        "{:?}",
        r.warnings
    );
    // A first line with the channels' names that is not the header row.
    let dated = rows(&|i| format!("5/7/2021  09:59:46.{:03}000,{},0.{i:02}", 2 * i, (i * i) % 7));
    let waves = "waveform,count1,angle\nt0,5/7/2021  09:59:46.000000,5/7/2021  09:59:46.000000\ndelta t,2E-3,2E-3\n\n";
    let r = read(format!("{waves}time,count1,angle\n{dated}").as_bytes()).unwrap();
    assert!(r.samples() == 40 && (r.segments[0].step_s - 0.002).abs() < 1e-9, "{:?}", r.segments[0].step_s);
}

#[test]
fn a_column_that_does_not_increase_is_not_proposed_as_the_time() {
    let told = |head: &str, row: &dyn Fn(usize) -> String| {
        let text = format!("{head}\n{}", (0..40).map(|i| row(i) + "\n").collect::<String>());
        read(text.as_bytes()).unwrap_err().to_string()
    };
    let e = told("count1,angle", &|i| format!("{},0.{i:02}", i / 3));
    assert!(e.contains("If the column angle holds the time"), "{e}");
    let e = told("count1,angle", &|i| format!("{},0.7", i / 3));
    assert!(e.contains("No column increases from row to row") && !e.contains("--time"), "{e}");
    let e = told("count1,angle,clock", &|i| format!("{i},0.7,{}", 2 * i));
    assert!(e.contains("--time \"clock\""), "{e}");
}

//! Every state that an interrupted capture may leave, and every command that may follow.

use std::path::Path;

use super::fake_device::{Fake, Fault, count};
use super::*;
use crate::capture::journal::{HEADER_LIMIT, header};
use crate::record::{Column, ReadOptions, Record};

/// A capture of four seconds, the bytes of its record and of its journal.
fn whole() -> (Run, Vec<u8>, Vec<u8>) {
    let run = Run::new(false, 4.0);
    run.capture(&mut Fake::new()).unwrap();
    let (record, journal) = (std::fs::read(&run.settings.output).unwrap(), journal_of(&run).unwrap());
    std::fs::remove_file(path_of(&run.settings.output)).unwrap();
    std::fs::remove_file(&run.settings.output).unwrap();
    (run, record, journal)
}

fn journal_of(run: &Run) -> Option<Vec<u8>> {
    std::fs::read(path_of(&run.settings.output)).ok()
}

/// Bytes of a journal's first line.
fn first_line(journal: &[u8]) -> usize {
    header(&journal[..journal.len().min(HEADER_LIMIT)], Path::new("j")).unwrap().unwrap().1
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Left {
    Nothing,
    CutLine,
    NoSample,
    Samples,
}

/// Puts a state into the folder.
fn put(run: &Run, record: Option<&[u8]>, left: Left, journal: &[u8]) {
    let (at, frames) = (&run.settings.output, path_of(&run.settings.output));
    let _ = (std::fs::remove_file(at), std::fs::remove_file(&frames));
    if let Some(bytes) = record {
        std::fs::write(at, bytes).unwrap();
    }
    let line = first_line(journal);
    let kept = match left {
        Left::Nothing => return,
        Left::CutLine => line / 2,
        Left::NoSample => line + 40,
        Left::Samples => journal.len() * 2 / 3,
    };
    std::fs::write(frames, &journal[..kept]).unwrap();
}

/// Each sample is what the device had at its tick.
fn check(record: &Record) {
    for s in &record.segments {
        let Column::Counts(c) = &s.columns[0] else { panic!() };
        assert!(c.iter().enumerate().all(|(i, c)| *c == count(s.first_tick + i as i64)));
    }
}

#[test]
fn every_state_has_a_way_on() {
    let (mut run, record, journal) = whole();
    run.settings.keep_frames = false;
    let at = run.settings.output.clone();
    let read = |run: &Run| Record::read(&at, &run.rig, &ReadOptions::default());
    for (kind, bytes) in
        [("none", None), ("empty", Some(0)), ("part", Some(record.len() / 2)), ("whole", Some(record.len()))]
    {
        for left in [Left::Nothing, Left::CutLine, Left::NoSample, Left::Samples] {
            let state = format!("record {kind}, journal {left:?}");
            let bytes = bytes.map(|n| &record[..n]);
            // Identify, and whatever else reads it.
            put(&run, bytes, left, &journal);
            let told = read(&run).err().map(|e| e.to_string());
            assert_eq!(told.is_none(), kind == "whole", "{state}: {told:?}");
            if let (Left::Samples, Some(told)) = (left, told) {
                assert!(told.contains("--from file:") && told.contains(".frames"), "{state}: {told}");
            }
            // Capture again.
            let again = run.capture(&mut Fake::new());
            if left == Left::Samples {
                let told = again.unwrap_err().to_string();
                for part in ["did not end", "whirl capture --resume --from tcp:fake:1", "--from file:", "or delete"] {
                    assert!(told.contains(part), "{state}: {told}");
                }
                assert!(!told.contains('\n') && std::fs::read(&at).ok().as_deref() == bytes, "{state}");
                assert_eq!(journal_of(&run).unwrap(), journal[..journal.len() * 2 / 3], "{state}");
            } else {
                let done = again.unwrap();
                let replaced = done.warnings.iter().any(|w| w.id == "empty-journal");
                assert_eq!((done.losses.received, replaced), (2000, left != Left::Nothing), "{state}");
                assert!(journal_of(&run).is_none(), "{state}");
            }
            // Resume: the device has gone on.
            put(&run, bytes, left, &journal);
            run.settings.resume = true;
            let resumed = run.capture(&mut Fake::at(1900, 1, 0));
            run.settings.resume = false;
            if left == Left::Nothing {
                assert!(resumed.unwrap_err().to_string().contains("nothing to resume"), "{state}");
                assert!(std::fs::read(&at).ok().as_deref() == bytes, "{state}");
            } else {
                let done = resumed.unwrap();
                assert!(done.complete && done.losses.received + done.losses.lost() == 2000, "{state}: {done:?}");
                assert_eq!(done.losses.gaps, u64::from(left == Left::Samples), "{state}");
                assert!(journal_of(&run).is_none(), "{state}");
                check(&read(&run).unwrap());
            }
            // Make the record.
            put(&run, bytes, left, &journal);
            let settings = CaptureSettings::new(format!("file:{}", path_of(&at).display()), &at);
            let made = super::super::run(&settings, &run.rig, &mut |_| {});
            match left {
                Left::Samples => {
                    let done = made.unwrap();
                    assert!(done.losses.received > 1000 && done.frames.is_none(), "{state}: {done:?}");
                    assert!(journal_of(&run).is_none(), "{state}");
                    check(&read(&run).unwrap());
                }
                _ => {
                    let told = made.unwrap_err().to_string();
                    let part = match left {
                        Left::Nothing => "wire's bytes",
                        Left::CutLine => "capture again, which replaces this file",
                        _ => "or capture again, which replaces it",
                    };
                    assert!(told.contains(part), "{state}: {told}");
                    assert!(std::fs::read(&at).ok().as_deref() == bytes, "{state}");
                }
            }
        }
    }
}

#[test]
fn a_journal_cut_anywhere_is_made_a_record_and_resumed() {
    let (mut run, _, journal) = whole();
    run.settings.keep_frames = false;
    let frames = path_of(&run.settings.output);
    for k in 0..40 {
        // Everywhere, its first line included, and never at the same place in a frame.
        let cut = 1 + k * (journal.len() - 2) / 39;
        std::fs::write(&frames, &journal[..cut]).unwrap();
        let copy = run.settings.output.with_file_name("copy.frames");
        std::fs::copy(&frames, &copy).unwrap();
        let made = run.settings.output.with_file_name("made.parquet");
        let settings = CaptureSettings::new(format!("file:{}", copy.display()), &made);
        let before = super::super::run(&settings, &run.rig, &mut |_| {}).map_or(0, |done| done.losses.received);
        run.settings.resume = true;
        // Every second time the device has restarted meanwhile.
        let mut later = if k % 2 == 0 { Fake::at(2000, 1, 0) } else { Fake::at(130, 2, 0) };
        let done = run.capture(&mut later).unwrap();
        run.settings.resume = false;
        assert!(done.losses.received >= before, "{cut}: {done:?}");
        // A device that has restarted has at least its own ticks missing: they may reach beyond the
        // end.
        let fits = k % 2 == 0 || before < 1850;
        if fits {
            assert!(done.complete && !frames.exists(), "{cut}: {done:?}");
            assert_eq!(done.losses.received + done.losses.lost(), 2000, "{cut}: {done:?}");
        }
        let record = run.read();
        let all: Vec<i64> =
            record.segments.iter().flat_map(|s| (0..s.len()).map(|i| s.first_tick + i as i64)).collect();
        if before > 0 {
            let first = Record::read(&made, &run.rig, &ReadOptions::default()).unwrap();
            let had: Vec<i64> =
                first.segments.iter().flat_map(|s| (0..s.len()).map(|i| s.first_tick + i as i64)).collect();
            assert!(all.starts_with(&had), "{cut}");
            let boot = record.segments.last().unwrap().boot;
            assert!(!fits || boot == k as u32 % 2, "{cut}: boot {boot}");
        }
    }
}

#[test]
fn a_record_of_another_rig_source_or_drive_is_not_gone_on_with() {
    let (mut run, _, journal) = whole();
    run.settings.resume = true;
    let state = |run: &Run| put(run, None, Left::Samples, &journal);
    let told = |run: &Run| run.capture(&mut Fake::at(1900, 1, 0)).unwrap_err().to_string();
    state(&run);
    run.rig.channel[1].measures = "phi2".to_owned();
    let text = told(&run);
    assert!(text.contains("phi2") && text.contains("theta2") && text.contains("interrupted"), "{text}");
    run.rig = rig(true);
    let text = told(&run);
    assert!(text.contains("15.5 mm at 5 Hz") && text.contains("no drive"), "{text}");
    run.rig = rig(false);
    let settings = CaptureSettings { from: "serial:/dev/ttyACM0".into(), ..run.settings.clone() };
    let text = live::run(&settings, &run.rig, &mut Fake::new(), None, &mut |_| {}).unwrap_err().to_string();
    assert!(text.contains("serial:/dev/ttyACM0") && text.contains("tcp:fake:1"), "{text}");
    assert_eq!(journal_of(&run).unwrap(), journal[..journal.len() * 2 / 3]);
    // Its own terms hold.
    run.settings.seconds = Some(1.0);
    let done = run.capture(&mut Fake::at(1900, 1, 0)).unwrap();
    assert!(done.warnings.iter().any(|w| w.id == "resumed" && w.text.contains("not --seconds 1")), "{done:?}");
    assert_eq!(done.losses.received + done.losses.lost(), 2000);
}

#[test]
fn a_capture_that_lost_its_device_is_gone_on_with() {
    let mut run = Run::new(false, 8.0);
    run.settings.reconnect_s = 0.3;
    run.settings.keep_frames = false;
    let e = run.capture(&mut Fake::with(&[(1500, Fault::Unplug(u32::MAX))])).unwrap_err().to_string();
    assert!(e.contains("whirl capture --resume --from tcp:fake:1 --rig rig.toml -o"), "{e}");
    run.settings.resume = true;
    let done = run.capture(&mut Fake::at(2600, 1, 0)).unwrap();
    assert!(done.complete && done.losses.gaps == 1 && done.losses.lost() > 1000, "{done:?}");
    assert!(done.warnings[0].id == "resumed" && journal_of(&run).is_none());
    check(&run.read());
}

#[test]
fn a_csv_that_was_cut_behind_a_line_is_known_by_its_journal() {
    let mut run = Run::new(false, 4.0);
    run.settings.output.set_extension("csv");
    run.capture(&mut Fake::new()).unwrap();
    let whole = std::fs::read_to_string(&run.settings.output).unwrap();
    let read = |recover: bool| {
        let options = ReadOptions { recover, ..ReadOptions::default() };
        Record::read(&run.settings.output, &run.rig, &options).map_err(|e| e.to_string())
    };
    // A whole record beside a journal that was kept is whole.
    assert!(journal_of(&run).is_some());
    let samples = read(false).unwrap().samples();
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let cut = lines.len() * 2 / 3;
    std::fs::write(&run.settings.output, lines[..cut].concat()).unwrap();
    let e = read(false).unwrap_err();
    for part in ["the record of an interrupted capture", "whirl capture --from file:", "makes it whole", "--recover"] {
        assert!(e.contains(part), "{part}: {e}");
    }
    assert!(e.contains(&format!("{} ticks more", samples - (cut - 1))), "{e}");
    let record = read(true).unwrap();
    assert_eq!(record.samples(), cut - 1);
    assert!(record.warnings.iter().any(|w| w.id == "recovered"), "{:?}", record.warnings);
    // Without the journal nobody can tell.
    std::fs::remove_file(path_of(&run.settings.output)).unwrap();
    assert_eq!(read(false).unwrap().samples(), cut - 1);
}

#[test]
fn the_commands_after_an_interruption_have_the_options_of_the_capture() {
    let settings = CaptureSettings {
        effects: vec!["quadratic-drag@arm2=2e-7".to_owned()],
        rows: true,
        amplitude_m: Some(0.0155),
        ..CaptureSettings::new("sim:3", "r.parquet")
    };
    let options = interrupted::options(&settings);
    let next = interrupted::NextStep {
        source: "sim:3",
        options: &options,
        rig: Path::new("my rig.toml"),
        record: Path::new("r.parquet"),
    };
    assert_eq!(
        next.resume(),
        "`whirl capture --resume --from sim:3 --effect quadratic-drag@arm2=2e-7 --rows --amplitude-m 0.0155 --rig 'my rig.toml' -o r.parquet`"
    );
    let terms = journal::Terms { options, ..journal::Terms::default() };
    let json = serde_json::to_string(&terms).unwrap();
    assert_eq!(serde_json::from_str::<journal::Terms>(&json).unwrap(), terms);
    let still = CaptureSettings { drive: false, ..CaptureSettings::new("sim", "r.parquet") };
    assert_eq!(interrupted::options(&still), ["--no-drive"]);
}

//! Devices and wires that do what they should not: each ends in bounded time and memory with one
//! clear message, or with a record.

use std::time::{Duration, Instant};

use super::hostile_device::Wire;
use super::*;
use crate::record::{ReadOptions, Record};

/// Each kind, and what it ends with: nothing for a record, or part of the message.
const KINDS: &[(&str, &str)] = &[
    ("zeros", "lost for"),
    ("ones", "no new sample|lost for"),
    ("noise", "lost for"),
    ("zeros from the start", "noise"),
    ("noise from the start", "noise"),
    ("answers only", "no new sample"),
    ("statuses only", "no new sample"),
    ("statuses without end", "no new sample"),
    ("one block again and again", "no new sample"),
    ("the last second again and again", "no new sample"),
    ("cut frames", "no new sample"),
    ("a restart at each block", ""),
    ("a restart now and then", ""),
    ("hellos of ever other boots", "no new sample"),
    ("hellos of one boot", "no new sample"),
    ("another protocol later", "protocol 99"),
    ("another encoder later", "1000 as the device says"),
    ("one jump of the clock", ""),
    ("one jump of the clock by 24 days", ""),
    ("a jump at each block", ""),
    // Each hello tells of a restart.
    ("a clock that runs backwards", ""),
    ("escapes in lines", ""),
    ("lines without end", "no new sample"),
    ("no zero at all", "no new sample|lost for"),
    ("half of the bits", "no new sample"),
    ("each byte twice", "no new sample"),
    ("every second frame", ""),
    ("pieces of a second in reverse", ""),
    ("a piece of a second too late", ""),
    ("counters that jump", ""),
    ("rows that nobody asked for", "no new sample"),
    ("extreme counts", ""),
    ("old bytes first", ""),
    ("an old hello first", "answers nothing"),
    ("sequence numbers at random", ""),
    ("silence", "lost for"),
    ("an end", "lost for"),
    ("errors", "lost for"),
];

#[test]
fn hostile_wires_end_in_bounded_time_with_one_message() {
    for (i, (kind, told)) in KINDS.iter().enumerate() {
        for seed in 1..4 {
            hostile(kind, told, 100 * i as u32 + seed);
        }
    }
}

/// Captures from a hostile wire and checks how that ends.
fn hostile(kind: &'static str, told: &str, seed: u32) {
    let mut run = Run::new(false, 20.0);
    run.settings.reconnect_s = 5.0;
    run.settings.handshake_s = 3.0;
    let mut wire = Wire::new(kind, seed);
    let (mut notices, begun) = (Vec::new(), Instant::now());
    let settings = CaptureSettings { from: "tcp:hostile:1".into(), ..run.settings.clone() };
    let result = live::run(&settings, &run.rig, &mut wire, None, &mut |p| notices.extend(p.notices.clone()));
    let reads = wire.state.lock().unwrap().reads;
    assert!(reads < 3000 && begun.elapsed() < Duration::from_secs(20), "{kind}: {reads} reads, {:?}", begun.elapsed());
    let journal = std::fs::metadata(path_of(&run.settings.output)).map_or(0, |m| m.len());
    assert!(journal < 3 << 20, "{kind}: a journal of {journal} bytes");
    assert!(notices.len() < 120 && notices.iter().all(|n| !n.chars().any(char::is_control)), "{kind}: {notices:?}");
    match &result {
        Ok(done) => {
            assert!(told.is_empty(), "{kind}: {done:?}");
            let l = &done.losses;
            assert_eq!(l.received + l.lost(), done.last_tick.abs_diff(done.first_tick) + 1, "{kind}: {l:?}");
            assert!(done.warnings.len() < 20, "{kind}: {:?}", done.warnings);
            assert!(done.warnings.iter().all(|w| !w.text.chars().any(char::is_control)), "{kind}: {:?}", done.warnings);
            if kind == "a piece of a second too late" {
                // It is waited for as what is sent again.
                assert!(l.late >= 480 && (l.dropped_late, l.lost()) == (0, 0), "{l:?}");
            }
            if kind.starts_with("old bytes") {
                assert_eq!((l.restarts, l.lost(), done.first_tick < 2000), (0, 0, true), "{done:?}");
            }
        }
        Err(e) => {
            let text = e.to_string();
            assert!(!told.is_empty() && told.split('|').any(|part| text.contains(part)), "{kind}: {text}");
            assert!(!text.chars().any(char::is_control), "{kind}: {text}");
        }
    }
    if told == "no new sample" {
        assert!(notices.iter().any(|n| n.contains("no new sample")), "{kind}: {notices:?}");
    }
    if run.settings.output.exists() {
        let record = Record::read(&run.settings.output, &run.rig, &ReadOptions::default());
        assert!(record.is_ok() || kind == "counters that jump", "{kind}: {record:?}");
        run.replay_is_identical();
    }
}

//! What was captured before the program was killed is readable.

use std::process::Stdio;
use std::time::{Duration, Instant};

use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;

use super::program::{command, done, rig_file, whirl};

#[test]
fn a_capture_that_was_killed_leaves_what_it_had() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 0.0")]);
    let mut child = command()
        .current_dir(at)
        .args("capture --from sim --rig rig.toml --seconds 36000 -o r.parquet".split(' '))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let journal = at.join("r.parquet.frames");
    let start = Instant::now();
    while std::fs::metadata(&journal).map_or(0, |m| m.len()) < 300_000 {
        assert!(start.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let bytes = std::fs::metadata(&journal).unwrap().len();

    // A further capture does not run over it.
    let refused = whirl(at, "capture --from sim --rig rig.toml --seconds 1 -o r.parquet");
    assert_eq!(refused.status, 2, "{refused:?}");
    assert!(refused.stderr.contains("r.parquet.frames") && refused.stderr.contains("--from file:"), "{refused:?}");
    assert_eq!(std::fs::metadata(&journal).unwrap().len(), bytes);

    done(at, "capture --from file:r.parquet.frames --rig rig.toml -o again.parquet");
    let rig = Rig::read(at.join("rig.toml")).unwrap();
    let record = Record::read(at.join("again.parquet"), &rig, &ReadOptions::default()).unwrap();
    // About 8.6 bytes a sample; the frame in which the program died may be cut.
    assert!(record.samples() as u64 > bytes / 12, "{} samples of {bytes} bytes", record.samples());
    assert_eq!((record.segments.len(), record.losses.lost()), (1, 0));
    done(at, "identify again.parquet --rig rig.toml");
}

#[test]
fn captures_killed_at_forty_moments_lose_nothing() {
    use rayon::prelude::*;
    let whole = whirl_tests::killed::Whole::new(std::path::Path::new(env!("CARGO_BIN_EXE_whirl-under-test")), 30.0);
    let left: Vec<_> = (0..40_u64).into_par_iter().map(|seed| whole.kill(seed)).collect();
    // Not all at the same kind of moment.
    assert!(left.iter().filter(|k| k.samples > 0).count() >= 10, "{left:?}");
}

/// Sends a signal to a capture that has recorded for a while; its status and standard error.
#[cfg(unix)]
fn signalled(folder: &std::path::Path, signal: &str, arguments: &str) -> (Option<i32>, String) {
    let mut child = command()
        .current_dir(folder)
        .args(arguments.split(' '))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let journal = folder.join("r.parquet.frames");
    let start = Instant::now();
    while std::fs::metadata(&journal).map_or(0, |m| m.len()) < 60_000 {
        assert!(start.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(5));
    }
    let sent = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[cfg(unix)]
#[test]
fn signals_end_a_capture_in_order() {
    for signal in ["-INT", "-TERM", "-HUP"] {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 0.0")]);
        // Without an end of its own, this is its end.
        let capture = "capture --from sim --rig rig.toml -o r.parquet --json out.json";
        let (status, told) = signalled(at, signal, capture);
        assert_eq!(status, Some(0), "{signal}: {told}");
        let out = super::program::json(&at.join("out.json"));
        assert_eq!((out["complete"].as_bool(), out["losses"]["lost_on_link"].as_u64()), (Some(true), Some(0)), "{out}");
        assert!(!at.join("r.parquet.frames").exists(), "{signal}");
        let rig = Rig::read(at.join("rig.toml")).unwrap();
        let record = Record::read(at.join("r.parquet"), &rig, &ReadOptions::default()).unwrap();
        assert_eq!(Some(record.samples() as u64), out["losses"]["received"].as_u64());
        std::fs::remove_file(at.join("r.parquet")).unwrap();
        std::fs::remove_file(at.join("r.parquet.estimates.jsonl")).unwrap();
        // Before its end, it says how to go on, and is not what was asked for.
        let (status, told) = signalled(at, signal, &format!("{capture} --seconds 36000 --strict"));
        assert_eq!(status, Some(1), "{signal}: {told}");
        assert!(told.contains("whirl capture --resume --from sim --rig rig.toml -o r.parquet"), "{signal}: {told}");
        assert!(told.contains("fewer samples came than were asked for"), "{signal}: {told}");
        let out = super::program::json(&at.join("out.json"));
        assert_eq!(out["complete"].as_bool(), Some(false), "{out}");
        let record = Record::read(at.join("r.parquet"), &rig, &ReadOptions::default()).unwrap();
        assert_eq!(Some(record.samples() as u64), out["losses"]["received"].as_u64());
        assert!(at.join("r.parquet.frames").exists(), "{signal}");
        // The command that it names ends it.
        done(at, "capture --from file:r.parquet.frames --rig rig.toml -o r.parquet");
        assert!(!at.join("r.parquet.frames").exists(), "{signal}");
    }
}

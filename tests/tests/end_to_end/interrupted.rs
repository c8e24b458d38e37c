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

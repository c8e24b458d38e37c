//! Tests of the journal's file.

use super::*;

fn terms() -> Terms {
    Terms { source: "sim".into(), seconds: Some(2.5), from_drive: Some((15_525, 5000)), ..Default::default() }
}

#[test]
fn terms_come_back_and_a_journal_is_never_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let record = dir.path().join("r.parquet");
    let path = path_of(&record);
    let mut journal = Journal::create(&record, &terms()).unwrap();
    journal.write(&[1, 2, 0, 3]).unwrap();
    // While it is written, nobody else may have it.
    assert!(is_busy(&path));
    assert!(Journal::take_up(&path).err().unwrap().to_string().contains("under way"));
    journal.finish(End::Left).unwrap();
    assert!(!is_busy(&path));
    let bytes = std::fs::read(&path).unwrap();
    let (read, at) = header(&bytes, &record).unwrap().unwrap();
    assert_eq!((read, &bytes[at..]), (terms(), &[1u8, 2, 0, 3][..]));
    assert!(Journal::create(&record, &Terms::default()).is_err());
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    // It goes on behind its end, and is gone at the end.
    let mut journal = Journal::take_up(&path).unwrap();
    journal.write(&[0, 9]).unwrap();
    assert!(std::fs::read(&path).unwrap().ends_with(&[1, 2, 0, 3, 0, 9]));
    journal.finish(End::Removed).unwrap();
    assert!(!path.exists());
    assert!(header(b"\x05raw bytes\0", &record).unwrap().is_none());
    assert!(header(b"whirl-frames 1 {\"seconds\":-1}\0", &record).is_err());
    assert!(header(b"whirl-frames 1 {", &record).is_err());
}

#[test]
fn a_start_is_known_wherever_it_was_cut() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.frames");
    let json = serde_json::to_string(&terms()).unwrap();
    let whole = [MAGIC, json.as_bytes(), b"\0"].concat();
    for length in 0..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert_eq!(terms_of(&path).unwrap(), Start::Cut, "{length}");
    }
    std::fs::write(&path, &whole).unwrap();
    assert_eq!(terms_of(&path).unwrap(), Start::Terms(Box::new(terms())));
    // Whatever does not begin so is the wire's, with a zero in it or without: nobody replaces it.
    for raw in [&b"\x05\x01\0"[..], b"\x05\x01", b"whirl-frames 2 {"] {
        std::fs::write(&path, raw).unwrap();
        assert_eq!(terms_of(&path).unwrap(), Start::Raw, "{raw:?}");
    }
    // Nor is a first line that is longer than any a capture writes a start that was cut.
    std::fs::write(&path, [MAGIC, &vec![b' '; HEADER_LIMIT]].concat()).unwrap();
    assert!(terms_of(&path).unwrap_err().to_string().contains("no end of the first line"));
}

/// A journal on a pipe, which takes every byte and cannot be synced, as a disk that fails; and the
/// pipe's other end.
#[cfg(target_os = "linux")]
fn on_a_disk_that_fails() -> (Journal, std::io::PipeReader) {
    let (other, pipe) = std::io::pipe().unwrap();
    let file = File::from(std::os::fd::OwnedFd::from(pipe));
    (Journal::of(PathBuf::from("r.frames"), file).unwrap(), other)
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fails_is_told_at_the_next_write_though_the_write_went_well() {
    let (mut journal, _pipe) = on_a_disk_that_fails();
    let start = std::time::Instant::now();
    let told = loop {
        match journal.write(&[1]) {
            Err(e) => break e.to_string(),
            Ok(()) => assert!(start.elapsed() < Duration::from_secs(30), "nothing is told"),
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(told.contains("r.frames") && told.contains("Free space on the disk"), "{told}");
}

#[cfg(target_os = "linux")]
#[test]
fn what_was_written_is_brought_to_the_disk_at_the_end_and_after_each_write() {
    // At the end at once, not after half a second.
    let (mut journal, _pipe) = on_a_disk_that_fails();
    journal.sync.end = None;
    assert!(journal.sync.fault().is_some());
    // Its thread has ended: what a write leaves to be done is still to be seen.
    journal.sync.dirty.store(false, Ordering::Release);
    journal.write(&[1]).unwrap();
    assert!(journal.sync.dirty.load(Ordering::Acquire));
}

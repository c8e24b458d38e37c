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
    journal.finish(true).unwrap();
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
    journal.finish(false).unwrap();
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
    std::fs::write(&path, b"\x05\x01\0").unwrap();
    assert_eq!(terms_of(&path).unwrap(), Start::Raw);
}

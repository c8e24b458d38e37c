//! Links that are unplugged: what the device still has is in the record.

use whirl_shared::codec::Decoder;
use whirl_shared::frame::DeviceMessage;

use super::*;
use crate::record::Column;

/// What is unplugged while the device's samples are of some ticks, and faulty otherwise.
struct Line {
    /// Ticks from and to which it is out.
    out_at: Vec<(u32, u32)>,
    out: bool,
    decoder: Decoder<DeviceMessage>,
    faults: FaultyLink,
    up: rand_chacha::ChaCha8Rng,
    up_rate: f64,
}

struct Plug {
    inner: Box<dyn Link>,
    line: Arc<Mutex<Line>>,
    rest: Vec<u8>,
}

impl Link for Plug {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.is_empty() {
            let n = self.inner.read(buffer)?;
            let line = &mut *self.line.lock().unwrap();
            // Frame by frame, as the device sends them.
            for frame in buffer[..n].split_inclusive(|byte| *byte == 0) {
                for &byte in frame {
                    if let Some(Ok(envelope)) = line.decoder.push(byte)
                        && let DeviceMessage::Samples(block) = envelope.message
                    {
                        line.out = line.out_at.iter().any(|(from, to)| (*from..*to).contains(&block.first_tick));
                    }
                }
                if line.out {
                    line.faults.unplug()
                } else {
                    line.faults.replug()
                }
                self.rest.extend(line.faults.push(frame));
            }
            if self.rest.is_empty() {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        let n = self.rest.len().min(buffer.len());
        buffer[..n].copy_from_slice(&self.rest[..n]);
        self.rest.drain(..n);
        Ok(n)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let line = &mut *self.line.lock().unwrap();
        if line.out {
            return Ok(());
        }
        let up_rate = line.up_rate;
        let damaged = |byte: &u8| match f64::from(line.up.next_u32()) < up_rate * 4_294_967_296.0 {
            true => *byte ^ 1,
            false => *byte,
        };
        self.inner.write_all(&bytes.iter().map(damaged).collect::<Vec<_>>())
    }
}

/// A capture of `seconds` of the rig that swings by itself, its record, and what the link says is
/// missing in it.
fn capture(
    seconds: f64,
    out_at: &[(u32, u32)],
    faults: FaultSettings,
    up_rate: f64,
) -> (CaptureOutcome, Record, Vec<u32>) {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 0.0");
    let line = Arc::new(Mutex::new(Line {
        out_at: out_at.to_vec(),
        out: false,
        decoder: Decoder::new(),
        faults: FaultyLink::new(faults, 3),
        up: rand_chacha::ChaCha8Rng::seed_from_u64(3),
        up_rate,
    }));
    let wrap = |inner| {
        line.lock().unwrap().faults.reopened();
        Box::new(Plug { inner, line: line.clone(), rest: vec![] }) as Box<dyn Link>
    };
    let mut source = Behind { inner: Simulated::new(&rig, &[], Some(3), None).unwrap(), wrap };
    let mut settings = CaptureSettings::new("sim", dir.path().join("r.parquet"));
    settings.seconds = Some(seconds);
    settings.drive = false;
    settings.keep_frames = true;
    let done = run_from(&settings, &rig, &mut source, &mut |_| {}).unwrap();
    let record = Record::read(&done.record, &rig, &ReadOptions::default()).unwrap();
    let l = &done.losses;
    assert_eq!((record.samples() as u64, &record.losses), (l.received, l));
    assert_eq!(l.received + l.lost(), done.last_tick.abs_diff(done.first_tick) + 1);
    let line = &mut *line.lock().unwrap();
    line.faults.finish();
    let within = |tick: &u32| (done.first_tick..=done.last_tick).contains(&i64::from(*tick));
    let taken: Vec<u32> = line.faults.report().missing().into_iter().filter(within).collect();
    let mut missing = Vec::new();
    for pair in record.segments.windows(2) {
        missing.extend(pair[0].first_tick + pair[0].len() as i64..pair[1].first_tick);
    }
    assert!(missing.iter().copied().eq(taken.iter().map(|t| i64::from(*t))), "{} {}", missing.len(), taken.len());
    // The journal gives the same record once more.
    let again = dir.path().join("again.parquet");
    let frames = journal::path_of(&settings.output);
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(again).unwrap());
    (done, record, taken)
}

fn counts(record: &Record) -> Vec<Vec<i32>> {
    let of = |column: &Column| if let Column::Counts(counts) = column { counts.clone() } else { panic!() };
    record.segments[0].columns.iter().map(of).collect()
}

#[test]
fn after_ten_seconds_without_a_link_nothing_is_missing() {
    let none = FaultSettings::default();
    let (_, whole, _) = capture(40.0, &[], none, 0.0);
    let (done, record, missing) = capture(40.0, &[(5_000, 10_000)], none, 0.0);
    let l = &done.losses;
    assert_eq!((l.received, l.lost(), l.gaps, missing.len()), (20_000, 0, 0, 0), "{l:?}");
    assert!((4_990..=5_020).contains(&l.restored) && done.complete && done.reconnections > 0, "{done:?}");
    // Sample by sample the record of a link that held.
    assert_eq!((record.segments.len(), record.segments[0].first_tick), (1, whole.segments[0].first_tick));
    assert!(counts(&record) == counts(&whole) && record.segments[0].phase == whole.segments[0].phase);
    let warnings: Vec<_> = done.warnings.iter().map(|w| w.id).collect();
    assert_eq!(warnings, ["no-new-samples", "reconnected"]);
}

#[test]
fn seventeen_seconds_are_not_too_long_for_what_a_nucleo_board_keeps() {
    let (done, record, _) = capture(60.0, &[(5_000, 13_500)], FaultSettings::default(), 0.0);
    assert_eq!((done.losses.received, done.losses.lost(), record.segments.len()), (30_000, 0, 1), "{done:?}");
}

#[test]
fn of_a_longer_outage_exactly_what_the_device_no_longer_has_is_missing() {
    let (done, record, missing) = capture(120.0, &[(5_000, 25_000)], FaultSettings::default(), 0.0);
    let l = &done.losses;
    // It keeps 1024 blocks of ten, of which some are overwritten while the others are sent.
    let kept = 20_000 - missing.len();
    assert!((8_600..=10_240).contains(&kept) && l.restored >= kept as u64, "{kept} {l:?}");
    assert_eq!((l.lost(), l.received), (missing.len() as u64, 60_000 - missing.len() as u64));
    // The oldest of them are; what was overwritten while it was sent makes further gaps.
    assert!((4_990..=5_000).contains(&missing[0]) && record.segments[0].len() >= 4_900, "{missing:?}");
    assert!(missing[9_000] == missing[0] + 9_000 && l.gaps < 600, "{l:?}");
    assert!(done.warnings.iter().any(|w| w.id == "samples-lost"), "{:?}", done.warnings);
}

#[test]
fn an_outage_over_the_end_is_made_good_before_the_capture_ends() {
    let (done, record, _) = capture(30.0, &[(13_000, 16_000)], FaultSettings::default(), 0.0);
    assert_eq!((done.losses.received, done.losses.lost(), done.complete), (15_000, 0, true), "{:?}", done.losses);
    assert_eq!(record.segments.len(), 1);
}

#[test]
fn what_is_sent_again_may_be_lost_damaged_and_doubled_too() {
    let faults = FaultSettings {
        drop_frame: 0.03,
        duplicate_frame: 0.03,
        truncate_frame: 0.01,
        reorder_frames: 0.02,
        flip_byte: 2e-4,
        drop_byte: 2e-4,
        ..FaultSettings::default()
    };
    let (done, _, missing) = capture(120.0, &[(4_000, 9_000), (30_000, 32_000)], faults, 0.01);
    let l = &done.losses;
    // An unplugging of 14 s, and thousands of frames that the link lost besides; a last gap may
    // stay.
    assert!(l.restored > 8_000 && missing.len() < 50 && l.bad_frames > 100 && l.duplicates > 500, "{l:?}");
}

//! Captures of a simulated rig that is moved by more than one sine.

use whirl_shared::excitation::{Excitation, Law};
use whirl_shared::waveform::phase_increment;

use super::*;

#[test]
fn a_sweep_is_in_the_record_and_its_metadata_to_the_last_bit() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("chaotic.toml", "settle_s = 1.0");
    let mut settings = CaptureSettings::new("sim", dir.path().join("sweep.parquet"));
    settings.seconds = Some(6.0);
    settings.keep_frames = true;
    settings.amplitude_m = Some(0.01);
    settings.excite =
        Excite { sweep: "3..6".parse().ok(), sweep_s: Some(2.0), back: true, logarithmic: true, ..Excite::default() };
    let done = run(&settings, &rig, &mut |_| {}).unwrap();
    assert_eq!((done.losses.received, done.losses.lost(), done.complete), (3_000, 0, true), "{done:?}");
    assert_eq!(done.warnings.iter().map(|w| w.id).collect::<Vec<_>>(), ["base-not-measured"]);
    let record = Record::read(&done.record, &rig, &ReadOptions::default()).unwrap();
    let told: Excitation = record.metadata.as_ref().and_then(|m| m.excitation).unwrap();
    assert_eq!((told.glide.law, told.glide.back, told.amplitudes()), (Law::Logarithmic, true, &[10_000][..]));
    let phase = record.segments[0].phase.as_ref().unwrap();
    let steps: Vec<u32> = phase.windows(2).map(|w| w[1].wrapping_sub(w[0])).collect();
    let [least, most] = [3_000, 6_000].map(|f| phase_increment(f, 500_000).unwrap());
    assert_eq!((steps.iter().min(), steps.iter().max()), (Some(&least), Some(&most)));
    // Whole stairs of ten, but for both ends of the record.
    let stairs: Vec<usize> = steps.chunk_by(|a, b| a == b).map(<[u32]>::len).collect();
    assert!(stairs[1..stairs.len() - 1].iter().all(|n| *n == 10 || *n == 20), "{stairs:?}");
    // The journal gives the same record.
    let mut frames = settings.output.clone().into_os_string();
    frames.push(".frames");
    let again = dir.path().join("again.parquet");
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(again).unwrap());
    // What was commanded is no measured base.
    let identified = crate::identify::identify(&[record], &rig, &crate::identify::Settings::default());
    let error = identified.unwrap_err().to_string();
    assert!(error.contains("measures = \"base\""), "{error}");
}

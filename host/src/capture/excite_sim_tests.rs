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

#[test]
fn a_table_is_in_the_record_and_moves_the_measured_base() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig("measured-base.toml", "settle_s = 0.5");
    let file = dir.path().join("table.csv");
    let points: Vec<f64> = (0..40).map(|j| 0.003 * f64::from((j - 20_i32).abs() - 5) / 15.0).collect();
    std::fs::write(&file, points.iter().map(|y| format!("{y}\n")).collect::<String>()).unwrap();
    let mut settings = CaptureSettings::new("sim", dir.path().join("table.parquet"));
    settings.seconds = Some(2.0);
    settings.keep_frames = true;
    settings.amplitude_m = Some(0.006);
    settings.excite = Excite { table: Some(file.clone()), ..Excite::default() };
    let done = run(&settings, &rig, &mut |_| {}).unwrap();
    assert_eq!((done.losses.received, done.losses.lost()), (1_000, 0), "{done:?}");
    assert!(done.warnings.is_empty() && done.level.is_none(), "{done:?}");
    let record = Record::read(&done.record, &rig, &ReadOptions::default()).unwrap();
    let table = record.metadata.as_ref().and_then(crate::record::Metadata::table).unwrap();
    let segment = &record.segments[0];
    let (phase, amplitude) = (segment.phase.as_ref().unwrap(), segment.amplitude_nm.as_ref().unwrap());
    let motion: Vec<f64> =
        phase.iter().zip(amplitude).map(|(p, a)| f64::from(table.displacement(*a, *p)) * 1e-9).collect();
    // From −2 to 6 mm, through the points that are samples of it.
    let greatest = motion.iter().copied().fold(0.0, f64::max);
    assert!((greatest - 0.006).abs() < 0.000_05, "{greatest}");
    // The sensor shows 1.01 of it from 3 mm on, with 5 µm of noise, in µm; its counts wrap nowhere here.
    let shown: Vec<f64> = match &segment.columns[2] {
        crate::record::Column::Counts(counts) => counts.iter().map(|n| f64::from(*n) * 5.0).collect(),
        crate::record::Column::Values(values) => values.clone(),
    };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (offset, middle) = (mean(&shown), mean(&motion));
    let both: Vec<[f64; 2]> = shown.iter().zip(&motion).map(|(a, b)| [a - offset, b - middle]).collect();
    let gain = both.iter().map(|[a, b]| a * b).sum::<f64>() / both.iter().map(|[_, b]| b * b).sum::<f64>();
    assert!((gain / 1.01e6 - 1.0).abs() < 1e-3, "{gain}");
    let away = both.iter().map(|[a, b]| (a / gain - b).abs()).fold(0.0, f64::max);
    assert!(away < 4e-5, "{away} m");
    // The journal gives the same record.
    let again = dir.path().join("again.parquet");
    let frames = journal::path_of(&settings.output);
    run(&CaptureSettings::new(format!("file:{}", frames.display()), &again), &rig, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(again).unwrap());
    // As it stands; what it is not is refused before anything moves.
    settings.amplitude_m = None;
    let Some(target) = target(&settings, &rig).unwrap() else { panic!() };
    assert!((3_100..3_130).contains(&target.0.amplitudes_micrometre[0]) && target.1 == Some(table), "{target:?}");
    settings.excite.multisine = vec![1, 2];
    let error = run(&settings, &rig, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("--table with --multisine"), "{error}");
    settings.excite.multisine.clear();
    std::fs::write(&file, "0.1\n".repeat(120) + "0.0\n").unwrap();
    settings.output = dir.path().join("none.parquet");
    let error = run(&settings, &rig, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("a table of 121 points at 5 Hz") && error.contains("fewer points"), "{error}");
}

#[test]
fn an_amplitude_is_levelled_before_the_record_begins() {
    let dir = tempfile::tempdir().unwrap();
    let weak = rig("measured-base.toml", "settle_s = 0.5\nshaker_gain = 0.85");
    let mut settings = CaptureSettings::new("sim", dir.path().join("level.parquet"));
    settings.seconds = Some(2.0);
    settings.keep_frames = true;
    settings.amplitude_m = Some(0.01);
    settings.level = true;
    let mut notices = Vec::new();
    let done = run(&settings, &weak, &mut |p| notices.extend(p.notices.clone())).unwrap();
    let level = done.level.unwrap();
    assert!(notices.iter().any(|text: &String| text.contains("amplitude levelled: ")), "{notices:?}");
    // The sensor shows 1.01.
    assert!((level.gain - 0.85 * 1.01).abs() < 1e-3 && (level.measured_m - 0.01).abs() < 5e-5, "{level:?}");
    assert!((level.commanded_m * 0.85 * 1.01 - 0.01).abs() < 5e-5 && level.wanted_m == 0.01, "{level:?}");
    assert_eq!((done.losses.received, done.losses.lost(), done.complete), (1_000, 0, true), "{done:?}");
    let record = Record::read(&done.record, &weak, &ReadOptions::default()).unwrap();
    assert_eq!(record.metadata.as_ref().and_then(|m| m.level), Some(level));
    let commanded = (level.commanded_m * 1e9).round() as u32;
    assert!(record.segments[0].amplitude_nm.as_ref().unwrap().iter().all(|a| *a == commanded));
    // The journal gives the same record, and a file is not levelled again.
    let again = dir.path().join("again.parquet");
    let frames = journal::path_of(&settings.output);
    let from = format!("file:{}", frames.display());
    run(&CaptureSettings::new(from.clone(), &again), &weak, &mut |_| {}).unwrap();
    assert!(std::fs::read(&settings.output).unwrap() == std::fs::read(&again).unwrap());
    let replayed = CaptureSettings { level: true, ..CaptureSettings::new(from, &again) };
    let error = run(&replayed, &weak, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("a file's amplitude is what it was"), "{error}");
    // Resumed, it goes on with what was found.
    settings.keep_frames = false;
    settings.resume = true;
    let on = run(&settings, &weak, &mut |_| {}).unwrap();
    assert_eq!(on.level, Some(level));
    settings.resume = false;
    // What cannot be.
    settings.output = dir.path().join("none.parquet");
    let refused = |settings: &CaptureSettings, rig: &Rig, part: &str| {
        let error = run(settings, rig, &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(part), "{error} has no {part}");
        assert!(!settings.output.exists() && !journal::path_of(&settings.output).exists(), "{part}");
    };
    let far = rig("measured-base.toml", "settle_s = 0.5\nshaker_gain = 0.4");
    refused(&settings, &far, "measured 4.0");
    refused(&settings, &rig("chaotic.toml", "settle_s = 0.5"), "a rig whose base is not measured");
    let with = |change: &dyn Fn(&mut CaptureSettings)| {
        let mut other = settings.clone();
        change(&mut other);
        other
    };
    refused(&with(&|s| s.excite.multisine = vec![1, 2]), &weak, "one sine of one amplitude");
    refused(&with(&|s| s.excite.on_trigger = true), &weak, "one sine of one amplitude");
    refused(&with(&|s| s.amplitude_m = Some(0.0)), &weak, "one above 0");
    refused(&with(&|s| (s.drive, s.amplitude_m) = (false, None)), &weak, "no drive");
    refused(&with(&|s| s.wait_for_drive = false), &weak, "--from-first-sample");
}

//! A drive that is not what it is assumed to be: a strong second harmonic, an amplitude that
//! drifts. Without a channel of the base's own motion something is missing; with it nothing is, and
//! the parameters are right.

use std::path::{Path, PathBuf};

use whirl::capture::{CaptureSettings, run};
use whirl::explain::{Settings, Verdict, explain};
use whirl::identify::{Settings as IdentifySettings, identify};
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;
use whirl::rig::plant::Plant;
use whirl_firmware::Settings as DeviceSettings;
use whirl_hil_sim::emulated::{Script, on_this_machine};
use whirl_hil_sim::shaker::Hum;
use whirl_hil_sim::{BaseQuantity, BaseSettings, RigSettings};
use whirl_shared::frame::{BaseKind, BaseSensor};

const MISSES_SOMETHING: &str = "model-misses-something";
const EFFECTS: [&str; 2] = ["drive-harmonic-2@drive=0.1,phase=2.5", "amplitude-drift@drive=0.06"];

/// The shipped rig, with changes in its text.
fn rig(changes: &[(&str, &str)]) -> Rig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/measured-base.toml");
    let mut text = std::fs::read_to_string(&path).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    Rig::parse(&text, &path).unwrap()
}

/// Takes the channel away.
fn blind() -> Rig {
    let channel = "[[channel]]\nname = \"base (5 um)\"\nmeasures = \"base\"\nunit = \"um\"\ngain = 5.0           # a count of the sensor\n";
    rig(&[(channel, "")])
}

/// The same sensor as an accelerometer, which shows gravity, too.
fn accelerometer() -> Rig {
    rig(&[
        ("unit = \"um\"\ngain = 5.0 ", "unit = \"m/s2\"\ngain = 0.0024 "),
        ("offset = 0.003", "offset = 9.9"),
        ("noise = 5e-6", "noise = 0.02"),
    ])
}

fn simulated(rig: &Rig, effects: &[&str], seconds: f64, folder: &Path) -> PathBuf {
    let file = folder.join("record.parquet");
    let effects: Vec<String> = effects.iter().map(|e| (*e).to_owned()).collect();
    whirl::simulate::record(rig, &effects, seconds, 1, &file, &indicatif::ProgressBar::hidden()).unwrap();
    file
}

fn read(file: &Path, rig: &Rig) -> Record {
    Record::read(file, rig, &ReadOptions::default()).unwrap()
}

/// Every parameter within three standard errors of the truth, what was known aside.
fn assert_true(record: Record, rig: &Rig) {
    let plant = Plant::of(rig).unwrap();
    let found = identify(&[record], rig, &IdentifySettings::default()).unwrap();
    assert!(found.warnings.iter().all(|w| w.id != MISSES_SOMETHING), "{:?}", found.warnings);
    let names: Vec<&str> = found.parameters.iter().map(|p| p.name.as_str()).collect();
    for name in ["B11", "B12", "B16", "B21", "B22", "B26", "C11", "C12", "C2", "base_gain", "J_o1"] {
        assert!(names.contains(&name), "{name} is not in {names:?}");
    }
    // Amplitude and phase of the drive come from the channel.
    for name in ["B13", "B14", "B15", "a", "psi"] {
        assert!(!names.contains(&name), "{name} is in {names:?}");
    }
    for p in &found.parameters {
        let truth = plant.truth(&p.name, rig.omega()).unwrap();
        println!("{} {} ± {} ({:+.2})", p.name, p.value, p.std_error, (p.value - truth) / p.std_error);
    }
    for p in &found.parameters {
        let truth = plant.truth(&p.name, rig.omega()).unwrap();
        assert!((p.value - truth).abs() < 3.0 * p.std_error, "{p:?}: true {truth}");
        assert!(
            p.name.starts_with('C') || p.name.contains('c') || (p.value / truth - 1.0).abs() < 2e-3,
            "{p:?} {truth}"
        );
    }
}

#[test]
fn a_drive_that_is_not_a_sine_is_known_where_it_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let (seeing, blind) = (rig(&[]), blind());
    let file = simulated(&seeing, &EFFECTS, 50.0, folder.path());
    // The same record, of which the channel is not read.
    let without = identify(&[read(&file, &blind)], &blind, &IdentifySettings::default()).unwrap();
    assert!(without.warnings.iter().any(|w| w.id == MISSES_SOMETHING), "{:?}", without.warnings);
    let alone = Settings { most_effects: Some(0), ..Settings::default() };
    let missed = explain(&[read(&file, &blind)], &blind, &alone).unwrap();
    assert_ne!(missed.verdict, Verdict::NothingMissing, "{}", missed.reason);
    assert!(missed.gap.steps[0].value > 2.0, "{:?}", missed.gap.steps);

    assert_true(read(&file, &seeing), &seeing);
    let e = explain(&[read(&file, &seeing)], &seeing, &Settings::default()).unwrap();
    assert_eq!(e.verdict, Verdict::NothingMissing, "{} {:?}", e.reason, e.effects);
    assert!(e.effects.is_empty() && e.gap.steps[0].value < 1.1, "{:?}", e.gap.steps);
    let names: Vec<&str> = e.parameters.iter().map(|p| p.name.as_str()).collect();
    assert!(names.contains(&"B16") && names.contains(&"B26") && !names.contains(&"B13"), "{names:?}");
}

#[test]
fn an_accelerometer_does_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let rig = accelerometer();
    let file = simulated(&rig, &EFFECTS, 60.0, folder.path());
    assert_true(read(&file, &rig), &rig);
}

/// Mains' hum of the shaker's amplifier is no harmonic of the drive; where it is measured it is
/// known.
#[test]
fn hum_that_is_measured_leaves_nothing_missing_and_every_parameter_right() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(&[("settle_s = 20.0", "settle_s = 5.0")]);
    let sensor =
        BaseSettings { quantity: BaseQuantity::Counted, scale: 5e-6, gain: 1.01, offset: 0.003, noise: 5e-6, seed: 3 };
    let base = BaseSensor { kind: BaseKind::Encoder, scale: 5_000_000 };
    let device = DeviceSettings { base, ..RigSettings::default().device };
    let hum = Hum { amplitude_m: 1e-4, frequency_hz: 50.3 };
    let settings = RigSettings { hum, base: Some(sensor), device, seed: Some(3), ..RigSettings::default() };
    let frames = on_this_machine(&settings, &Script::new().drive(0, 35_000, 400, 15_525, 5_000), 35_000).unwrap();
    let file = folder.path().join("hum.frames");
    std::fs::write(&file, frames).unwrap();
    let capture = CaptureSettings::new(format!("file:{}", file.display()), folder.path().join("hum.parquet"));
    let done = run(&capture, &rig, &mut |_| {}).unwrap();
    assert_true(read(&done.record, &rig), &rig);
    let e = explain(&[read(&done.record, &rig)], &rig, &Settings::default()).unwrap();
    assert_eq!((e.verdict, e.effects.len()), (Verdict::NothingMissing, 0), "{}", e.reason);
}

/// What is hidden in the arms is found beside a base that is measured.
#[test]
fn a_hidden_effect_is_named_under_a_drive_that_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(&[]);
    let file = simulated(&rig, &[EFFECTS[0], EFFECTS[1], "quadratic-drag@arm2=2e-7"], 50.0, folder.path());
    let e = explain(&[read(&file, &rig)], &rig, &Settings::default()).unwrap();
    assert_eq!(e.verdict, Verdict::Explained, "{}", e.reason);
    let named: Vec<String> = e.effects.iter().map(|f| format!("{}@{}", f.id, f.at)).collect();
    assert_eq!(named, ["quadratic-drag@arm2"]);
    let f = &e.effects[0];
    assert!((f.value - 2e-7).abs() < 5.0 * f.std_error && f.unit == "N m s²", "{f:?}");
}

#[test]
fn a_capture_has_the_column_and_the_device_is_held_against_the_rig_file() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig(&[("settle_s = 20.0", "settle_s = 2.0")]);
    let mut settings = CaptureSettings::new("sim:5", folder.path().join("captured.parquet"));
    settings.seconds = Some(60.0);
    let done = run(&settings, &rig, &mut |_| {}).unwrap();
    assert_eq!((done.losses.received, done.losses.lost()), (30_000, 0), "{done:?}");
    assert_true(read(&done.record, &rig), &rig);
}

/// Three encoders on three arms: as many channels as the device says.
#[test]
fn a_triple_pendulum_is_captured_from_a_device_with_three_encoders() {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/triple-pendulum.toml")).unwrap();
    let mut settings = CaptureSettings::new("sim", folder.path().join("triple.parquet"));
    settings.seconds = Some(30.0);
    let done = run(&settings, &rig, &mut |_| {}).unwrap();
    assert_eq!((done.losses.received, done.losses.lost()), (15_000, 0), "{done:?}");
    let record = read(&done.record, &rig);
    assert_eq!((record.channels.len(), record.segments.len(), record.segments[0].len()), (3, 1, 15_000));
    let found = identify(&[record], &rig, &IdentifySettings::default()).unwrap();
    let line = |name: &str| rig.text.lines().find_map(|l| l.strip_prefix(&format!("{name} = "))?.parse::<f64>().ok());
    assert_eq!(found.correlation_names.len(), 14);
    for name in &found.correlation_names {
        let (p, truth) = (found.parameter(name).unwrap(), line(name).unwrap());
        assert!((p.value - truth).abs() < 4.0 * p.std_error, "{p:?}: true {truth}");
    }
}

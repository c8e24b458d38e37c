//! Inspection of a driven double pendulum integrated here (Runge and Kutta, fourth order), apart
//! from every other model.

use std::f64::consts::TAU;
use std::path::Path;

use super::*;
use crate::record::{Column, Segment};

/// Counts of the rig of `rigs/chaotic.toml` at a drive amplitude, viscous joints (`friction` that
/// of joint 1, N m s), 500 Hz.
pub fn counts(seconds: f64, amplitude: f64, drive_hz: f64, friction: f64) -> [Vec<i32>; 2] {
    let (j1, j2, h, s1, s2) =
        (5.99e-4, 4.033e-5, 0.040 * 0.0267 * 0.0635, 0.1362 * 0.0127 + 0.040 * 0.0635, 0.040 * 0.0267);
    let w = TAU * drive_hz;
    let rates = |t: f64, x: [f64; 4]| {
        let pull = 9.81 - amplitude * w * w * (w * t).cos();
        let (s, c) = (x[1] - x[0]).sin_cos();
        let joint = 6.145e-5 * (x[3] - x[2]);
        let b1 = h * x[3] * x[3] * s - s1 * pull * x[0].sin() - friction * x[2] + joint;
        let b2 = -h * x[2] * x[2] * s - s2 * pull * x[1].sin() - joint;
        let (m, det) = (h * c, j1 * j2 - h * h * c * c);
        [x[2], x[3], (j2 * b1 - m * b2) / det, (j1 * b2 - m * b1) / det]
    };
    let dt = 0.001;
    let mut x = [0.3, 2.0, 0.0, 0.0];
    let mut out = [Vec::new(), Vec::new()];
    let settle = 25.0;
    let steps = ((seconds + settle) / dt).round() as usize;
    for n in 0..steps {
        let t = n as f64 * dt - settle;
        if n.is_multiple_of(2) && t >= -1e-9 {
            for (column, angle) in out.iter_mut().zip([x[0], x[1] - x[0]]) {
                column.push((angle / TAU * 4096.0).floor() as i32);
            }
        }
        let at = |k: [f64; 4], f: f64| std::array::from_fn(|i| x[i] + f * dt * k[i]);
        let k1 = rates(t, x);
        let k2 = rates(t + 0.5 * dt, at(k1, 0.5));
        let k3 = rates(t + 0.5 * dt, at(k2, 0.5));
        let k4 = rates(t + dt, at(k3, 1.0));
        x = std::array::from_fn(|i| x[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    out
}

/// The defaults, with few vectors: these tests run without optimisation.
fn settings() -> InspectSettings {
    let phase_space = survey::Settings {
        most_neighbours: 2000,
        most_vectors: 2000,
        most_pairs: 4000,
        dimensions: 6,
        ..survey::Settings::default()
    };
    InspectSettings { phase_space, ..InspectSettings::default() }
}

fn rig(drive_hz: f64) -> Rig {
    let text = include_str!("../../../rigs/chaotic.toml")
        .replace("frequency_hz = 5.0", &format!("frequency_hz = {drive_hz:?}"));
    Rig::parse(&text, Path::new("rig.toml")).unwrap()
}

fn record(rig: &Rig, columns: [Vec<i32>; 2]) -> Record {
    let segment = Segment::new(0.0, 0.002, columns.into_iter().map(Column::Counts).collect());
    Record::of("folder/made.csv", rig, vec![segment])
}

/// The record with samples `from..to` taken out.
fn with_gap(mut record: Record, from: usize, to: usize) -> Record {
    let whole = record.segments.remove(0);
    record.segments = vec![whole.rows(0..from), whole.rows(to..whole.len())];
    record.losses.received -= (to - from) as u64;
    record.losses.lost_on_link += (to - from) as u64;
    record.losses.gaps = 1;
    record
}

#[test]
fn a_chaotic_record_is_described() {
    let rig = rig(5.0);
    let record = with_gap(record(&rig, counts(60.0, 0.015_525, 5.0, 2e-4)), 20_000, 20_137);
    let found = inspect(&record, &rig, &settings()).unwrap();
    assert_eq!(found.coordinates.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["theta1", "theta2", "phi2"]);
    assert_eq!(found.periodicity.kind, Kind::ChaoticOrTransient);
    assert_eq!((found.record.segments, found.record.lost, found.record.gaps[0].samples), (2, 137, 137));
    assert!((found.record.gaps[0].length_s - 138.0 * 0.002).abs() < 1e-9);
    let drive = found.drive.as_ref().unwrap();
    assert_eq!(drive.agrees, Some(true), "{drive:?}");
    assert!((drive.line_hz.unwrap() - 5.0).abs() < 0.01);
    for c in &found.coordinates[..2] {
        assert!((c.noise / c.quantisation_noise - 1.0).abs() < 0.3, "{}: {} {}", c.name, c.noise, c.quantisation_noise);
        assert!(c.rms_speed > 1.0 && c.spectrum.as_ref().unwrap().averages >= 8);
    }
    let text = text::text(&found);
    assert!(
        text.contains("29\u{202f}863 samples at 500 Hz") && text.contains("lost       137: 137 missing rows"),
        "{text}"
    );
    assert!(text.contains("5 Hz stated, ") && text.lines().count() == 13, "{text}");
    let space = &found.phase_space;
    assert_eq!(space.coordinates.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["theta1", "theta2"]);
    assert!(space.coordinates.iter().all(|c| (3..=100).contains(&c.delay) && c.mutual_information.bits.len() == 100));
    // About 0.79 a drive period by the difference of two integrations.
    let (value, error) = space.lyapunov.as_ref().map(|l| (l.per_second / 5.0, l.std_error / 5.0)).unwrap();
    assert!((value - 0.79).abs() < 3.0 * error && error < 0.25, "{value} {error}");
    let orbits = space.orbits.as_ref().unwrap();
    assert!(
        orbits.orbits.len() > 3 && orbits.orbits.iter().all(|o| o.error < 0.05 && o.turns.len() == 2),
        "{orbits:?}"
    );
    let json = serde_json::to_string(&found).unwrap();
    assert!(json.len() < 1_000_000 && !json.contains("[plant]"), "{}", json.len());
}

#[test]
fn a_wrong_drive_frequency_is_noticed() {
    let columns = counts(120.0, 0.015_525, 5.0, 2e-4);
    for (stated, right) in [(5.0, true), (5.3, false), (4.98, false)] {
        let rig = rig(stated);
        let found = inspect(&record(&rig, columns.clone()), &rig, &settings()).unwrap();
        let drive = found.drive.unwrap();
        assert_eq!(drive.agrees, Some(right), "{drive:?}");
        assert!((drive.line_hz.or(drive.other_hz).unwrap() - 5.0).abs() < 0.003, "{drive:?}");
        assert_eq!(found.warnings.iter().any(|w| w.id == "drive-frequency"), !right);
    }
}

#[test]
fn a_locked_record_and_one_at_rest_are_noticed() {
    let rig = rig(5.0);
    for (friction, period) in [(3e-3, 1), (1e-3, 2)] {
        let locked = record(&rig, counts(20.0, 0.0115, 5.0, friction));
        let found = inspect(&locked, &rig, &settings()).unwrap();
        assert_eq!((found.periodicity.kind, found.periodicity.period), (Kind::Periodic, Some(period)));
        assert!(found.warnings.iter().any(|w| w.id == "locked"));
    }
    let still = [vec![100; 30_000], vec![-7; 30_000]];
    let found = inspect(&record(&rig, still), &rig, &settings()).unwrap();
    assert_eq!(found.periodicity.kind, Kind::AtRest);
    assert!(found.coordinates[0].spectrum.is_none());
    assert!(found.phase_space.coordinates.is_empty() && found.phase_space.lyapunov.is_none());
    assert!(found.warnings.iter().any(|w| w.id == "at-rest"));
}

#[test]
fn too_short_a_record_names_both_lengths() {
    let rig = rig(5.0);
    let short = record(&rig, [vec![0; 1999], vec![0; 1999]]);
    let error = inspect(&short, &rig, &settings()).unwrap_err().to_string();
    assert!(error.contains("made.csv") && error.contains("1999 samples") && error.contains("2000 samples"), "{error}");
    let gapped = with_gap(record(&rig, [vec![0; 3500], vec![0; 3500]]), 1500, 1600);
    let error = inspect(&gapped, &rig, &settings()).unwrap_err().to_string();
    assert!(error.contains("longest unbroken stretch: found 1900 samples"), "{error}");
    let mut none = record(&rig, [vec![], vec![]]);
    none.segments.clear();
    assert!(inspect(&none, &rig, &settings()).is_err());
    let bad = InspectSettings { period_tolerance: f64::NAN, ..settings() };
    assert!(inspect(&short, &rig, &bad).unwrap_err().to_string().contains("period_tolerance"));
}

#[test]
fn an_inconsistent_record_is_refused() {
    let rig = rig(5.0);
    let mut uneven = record(&rig, [vec![0; 3000], vec![0; 2999]]);
    assert!(inspect(&uneven, &rig, &settings()).unwrap_err().to_string().contains("count2"));
    uneven.segments[0].columns = vec![Column::Values(vec![f64::NAN; 3000]), Column::Counts(vec![0; 3000])];
    assert!(inspect(&uneven, &rig, &settings()).unwrap_err().to_string().contains("count1"));
}

#[test]
fn the_devices_phase_gives_the_drive_outright() {
    let rig = rig(5.0);
    let mut r = record(&rig, counts(10.0, 0.015_525, 5.0, 2e-4));
    let step = (5.0 / 500.0 * 2f64.powi(32)).round() as u32;
    r.segments[0].phase = Some((0..r.segments[0].len() as u32).map(|i| i.wrapping_mul(step)).collect());
    let found = inspect(&r, &rig, &settings()).unwrap();
    assert!((found.drive.unwrap().phase_hz.unwrap() - 5.0).abs() < 1e-6);
    assert_eq!(found.record.phase_jitter, Some(0.0));
    // One passage of the section each period but those within a slope's width of the ends.
    assert!((48..=50).contains(&found.plots[0].section_x.len()), "{}", found.plots[0].section_x.len());
}

#[test]
fn a_report_of_an_inspection_is_small_complete_and_the_same_every_time() {
    let rig = rig(5.0);
    let found = inspect(&record(&rig, counts(40.0, 0.015_525, 5.0, 2e-4)), &rig, &settings()).unwrap();
    let mut results = crate::report::Results::new();
    results.add(found);
    let page = crate::report::Report::of("double pendulum", "made.csv", &results).render().unwrap();
    for id in ["record", "losses", "histories", "portraits", "spectra", "phase-space"] {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    assert!(page.len() < 1_500_000, "{}", page.len());
    assert_eq!(page.matches("<figure>").count(), 10);
    assert!(!page.contains("NaN"));
    assert_eq!(page, crate::report::Report::of("double pendulum", "made.csv", &results).render().unwrap());
}

/// A free motion that dies away has neither exponent nor attractor; one that goes on may.
#[test]
fn what_dies_away_has_no_exponent() {
    let text = "name = \"p\"\nmodel = \"single-pendulum\"\nsample_rate_hz = 100.0\n\
                [[channel]]\nname = \"a\"\nmeasures = \"theta1\"\nunit = \"rad\"\n";
    let rig = Rig::parse(text, Path::new("rig.toml")).unwrap();
    let found = |rate: f64| {
        let swing = (0..6000).map(|i| {
            let t = 0.01 * f64::from(i);
            (1e4 * (-rate * t).exp() * (TAU * 0.9 * t).sin()).round() / 1e4
        });
        let segment = Segment::new(0.0, 0.01, vec![Column::Values(swing.collect())]);
        motion_of(&Record::of("made.csv", &rig, vec![segment]), &rig, &settings()).unwrap()
    };
    let dying = found(0.02);
    assert!(dying.phase_space.dies_away && dying.phase_space.lyapunov.is_none());
    assert!(dying.phase_space.correlation_dimension.is_none());
    let told = text::text(&dying);
    assert!(told.contains("exponent   none: the motion dies away"), "{told}");
    let steady = found(0.0);
    assert!(!steady.phase_space.dies_away && !text::text(&steady).contains("dies away"));
    // That no delay is clear is no warning.
    assert!(dying.warnings.is_empty(), "{:?}", dying.warnings);
}

/// A record of the axis that a force moves: force amplitude, and a noise of both channels beside
/// which the last digit is small.
fn pushed(amplitude: f64) -> Inspection {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    let channel =
        |name: &str, unit: &str| format!("[[channel]]\nname = \"{name}\"\nmeasures = \"{name}\"\nunit = \"{unit}\"\n");
    let head = "name = \"axis\"\nmodel = \"positioning-drive\"\nsample_rate_hz = 100.0\n";
    std::fs::write(&path, format!("{head}{}{}", channel("q", "mm"), channel("force", "N"))).unwrap();
    let rig = Rig::read(&path).unwrap();
    let rows = (0..1200).map(|i| (0.01 * f64::from(i), 0.01 * (7919.3 * f64::from(i)).sin()));
    let rounded = |x: f64, digits: f64| (x * digits).round() / digits;
    let q = rows.clone().map(|(t, e)| rounded(3.0 * (TAU * 1.3 * t).sin() + (TAU * 0.47 * t).cos() + e, 1e2));
    let force = rows.map(|(t, e)| rounded(amplitude * ((TAU * 1.3 * t).cos() + (TAU * 0.47 * t).sin() + e), 1e2));
    let columns = vec![Column::Values(q.collect()), Column::Values(force.collect())];
    let record = Record::of("made.csv", &rig, vec![Segment::new(0.0, 0.01, columns)]);
    inspect(&record, &rig, &settings()).unwrap()
}

#[test]
fn a_measured_input_that_moves_is_what_drives() {
    let found = pushed(2.0);
    assert!(text::sentence(&found).contains("its motion: driven by the measured force"), "{}", text::sentence(&found));
    assert_eq!(text::motion(&pushed(0.0)), "free, no drive");
    // The last digit of a file says nothing of a sensor.
    let force = &found.coordinates[1];
    assert!(force.step > 0.0 && force.noise > 2.0 * force.quantisation_noise, "{force:?}");
    assert!(found.warnings.iter().all(|w| w.id != "noisy-channel"), "{:?}", found.warnings);
}

#[test]
fn a_sensor_that_counts_is_told_from_the_last_digit_of_a_file() {
    let motion = |step: f64, space: motion::Space| motion::Motion {
        name: "x".into(),
        unit: "rad".into(),
        space,
        derived: false,
        step,
        quantisation_noise: step / 12f64.sqrt(),
        stretches: Vec::new(),
    };
    let channel = |unit: &str| crate::rig::Channel::new("x", unit);
    let circle = motion::Space::S1;
    assert!(motion::counts(&channel("rad"), &motion(TAU / 4096.0, circle)));
    assert!(motion::counts(&channel("count"), &motion(TAU / 4096.0, circle)));
    assert!(!motion::counts(&channel("rad"), &motion(1.001e-4, circle)));
    assert!(!motion::counts(&channel("deg"), &motion(1e-3_f64.to_radians(), circle)));
    assert!(!motion::counts(&channel("rad"), &motion(0.0, circle)));
    assert!(!motion::counts(&channel("m"), &motion(1.22e-6, motion::Space::R)));
}

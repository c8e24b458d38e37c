//! `reduce` on records with faults, and on measured ones: an answer or a message, never a wrong mode.

use std::fmt::Write;
use std::io::Write as _;
use std::path::Path;

use super::*;
use crate::record::ReadOptions;

/// A rig of so many channels in metres.
fn rig(channels: usize, rate: f64) -> String {
    let mut text = format!("name = \"test\"\nmodel = \"two-mass\"\nsample_rate_hz = {rate:?}\n");
    for i in 0..channels {
        let _ = write!(text, "[[channel]]\nname = \"x{i}\"\nmeasures = \"x{i}\"\nunit = \"m\"\n");
    }
    text
}

fn csv(rows: impl Iterator<Item = Vec<f64>>, step: f64) -> String {
    let mut text = String::new();
    for (i, row) in rows.enumerate() {
        if i == 0 {
            text.push('t');
            (0..row.len()).for_each(|c| text.push_str(&format!(",x{c}")));
            text.push('\n');
        }
        let _ = write!(text, "{:.6}", i as f64 * step);
        row.iter().for_each(|x| {
            let _ = write!(text, ",{x:?}");
        });
        text.push('\n');
    }
    text
}

fn reduced(rig: &str, records: &[&Path], settings: &ReduceSettings) -> Result<Reduction> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    std::fs::write(&path, rig).unwrap();
    let rig = Rig::read(&path)?;
    let records: Vec<Record> =
        records.iter().map(|p| Record::read(p, &rig, &ReadOptions::default())).collect::<Result<_>>()?;
    reduce(&records, &rig, settings)
}

/// Reduces CSV texts.
fn of(channels: usize, texts: &[String]) -> Result<Reduction> {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<_> = texts
        .iter()
        .enumerate()
        .map(|(i, text)| {
            let path = folder.path().join(format!("{i}.csv"));
            std::fs::write(&path, text).unwrap();
            path
        })
        .collect();
    reduced(
        &rig(channels, 10.0),
        &paths.iter().map(std::path::PathBuf::as_path).collect::<Vec<_>>(),
        &ReduceSettings::default(),
    )
}

/// One swing of amplitude a, the second channel half of the first, both with a third harmonic.
fn swing(a: f64, i: usize) -> [f64; 2] {
    let phi = (1.0 + 0.01 * a * a) * i as f64 * 0.1;
    let x = a * (phi.cos() + 0.01 * a * a * (3.0 * phi).cos());
    [x, 0.5 * x]
}

fn warned(r: &Reduction, code: &str) -> bool {
    r.warnings.iter().any(|w| w.kind == code)
}

#[test]
fn releases_of_unequal_length_make_one_model() {
    let text = |a: f64, m: usize| csv((0..m).map(|i| swing(a, i).to_vec()), 0.1);
    let r = of(2, &[text(0.5, 900), text(1.0, 300), text(1.5, 500)]).unwrap();
    assert_eq!((r.releases.len(), r.rank, r.constraint), (3, 1, Constraint::Polar));
    assert!((r.modes[0][1] / r.modes[0][0] - 0.5).abs() < 1e-9);
    for (release, a) in r.releases.iter().zip([0.5_f64, 1.0, 1.5]) {
        let want = (1.0 + 0.01 * a * a) / std::f64::consts::TAU;
        assert!((release.frequency_hz / want - 1.0).abs() < 1e-6, "{release:?}");
    }
    // Of two releases none can be left out: nothing is said of the error.
    let r = of(2, &[text(0.5, 900), text(1.0, 300)]).unwrap();
    assert!(r.model.is_some() && r.error.frequency.is_none() && r.error.range.is_some());
}

#[test]
fn a_constant_channel_takes_no_part() {
    let r = of(3, &[csv((0..600).map(|i| [&swing(1.0, i)[..], &[0.25]].concat()), 0.1)]).unwrap();
    assert!(warned(&r, "dead-channel"), "{:?}", r.warnings);
    assert!(r.modes[0][2].abs() < 1e-12 && r.rank == 1 && (r.energy[0] - 1.0).abs() < 1e-12, "{r:?}");
    let still = of(2, &[csv((0..100).map(|_| vec![1.0, 2.0]), 0.1)]).unwrap_err();
    assert!(still.to_string().contains("nothing moves"), "{still}");
}

#[test]
fn fewer_samples_than_channels_are_told_and_bound_the_rank() {
    let r = of(6, &[csv((0..4).map(|i| (0..6).map(|c| ((i * i + 3 * c * i) as f64).sin()).collect()), 0.1)]).unwrap();
    assert!(warned(&r, "few-samples"), "{:?}", r.warnings);
    assert!(r.rank <= 3 && r.kept <= r.rank && r.model.is_none(), "{r:?}");
}

#[test]
fn not_a_number_is_a_gap_and_does_not_reach_the_modes() {
    let clean = csv((0..900).map(|i| swing(1.0, i).to_vec()), 0.1);
    let holed = csv((0..900).map(|i| if i % 300 == 200 { vec![f64::NAN, 1.0] } else { swing(1.0, i).to_vec() }), 0.1);
    let (clean, holed) = (of(2, &[clean]).unwrap(), of(2, &[holed]).unwrap());
    // Four stretches; the last holds 1.6 periods, too few for a frequency.
    assert_eq!(holed.releases.len(), 3);
    assert!((clean.modes[0][0] - holed.modes[0][0]).abs() < 1e-9);
    assert!(holed.energy.iter().chain(holed.modes.iter().flatten()).all(|x| x.is_finite()));
    assert!(!holed.warnings.is_empty());
}

/// The folder of measured records, or none, which is told.
fn measured() -> Option<std::path::PathBuf> {
    let folder = std::env::var_os("WHIRL_RECORDS").map(std::path::PathBuf::from);
    if folder.is_none() {
        let _ = writeln!(std::io::stderr(), "measured beam and triple pendulum: did not run, WHIRL_RECORDS is not set");
    }
    folder
}

#[test]
fn the_measured_beams_identical_points_are_named() {
    let Some(folder) = measured() else { return };
    let record = folder.join("beam/displacements.csv.gz");
    let r = reduced(&rig(15, 15_000.0), &[&record], &ReduceSettings::default()).unwrap();
    assert_eq!(r.channel_faults, [ChannelFault::Copy { channel: 8, of: 7, identical: true }]);
    assert!(warned(&r, "copied-channel") && r.rank == 14 && r.kept == 3, "{} {}", r.rank, r.kept);
    // Translation, rotation, first bending: 0, 1, 2 changes of sign along the beam.
    for (mode, changes) in r.modes.iter().zip(0..3) {
        assert_eq!(mode.windows(2).filter(|w| w[0] * w[1] < 0.0).count(), changes, "{mode:?}");
    }
}

#[test]
fn the_measured_triple_pendulum_has_the_known_energies() {
    let Some(folder) = measured() else { return };
    let text = rig(3, 1000.0).replace("\"m\"", "\"rad\"");
    let text = (0..3).fold(text, |t, i| t.replace(&format!("\"x{i}\""), &format!("\"phi{}\"", i + 1)));
    let r = reduced(&text, &[&folder.join("multiarm/triple.csv.gz")], &ReduceSettings::default()).unwrap();
    for (found, known) in r.energy.iter().zip([0.8916, 0.1069, 0.00151]) {
        assert!((found / known - 1.0).abs() < 5e-3, "{:?}", r.energy);
    }
    assert!(r.model.is_none() && r.modes_imaginary.is_none());
}

//! `reduce` on records with faults, and on measured ones: an answer or a message, never a wrong
//! mode.

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
    r.warnings.iter().any(|w| w.id == code)
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

/// A record read whole and block by block.
fn both_ways(rig: &str, texts: &[String], settings: &ReduceSettings) -> (Reduction, Reduction) {
    let folder = tempfile::tempdir().unwrap();
    let rig = Rig::parse(rig, Path::new("rig.toml")).unwrap();
    let options = ReadOptions::default();
    let paths: Vec<_> = (0..texts.len()).map(|i| folder.path().join(format!("{i}.csv"))).collect();
    paths.iter().zip(texts).for_each(|(path, text)| std::fs::write(path, text).unwrap());
    let records: Vec<Record> = paths.iter().map(|p| Record::read(p, &rig, &options).unwrap()).collect();
    let whole = reduce(&records, &rig, settings).unwrap();
    assert!(!long::is_long(&paths, &rig).unwrap());
    let (streamed, lost) = long::reduce(&paths, &rig, &options, settings, &|_| {}).unwrap();
    assert_eq!(lost, records.iter().map(|r| r.losses.lost()).sum::<u64>());
    (whole, streamed)
}

fn same_modes(whole: &Reduction, streamed: &Reduction) {
    assert_eq!((whole.kept, whole.rank, whole.samples), (streamed.kept, streamed.rank, streamed.samples));
    assert_eq!(whole.channel_faults, streamed.channel_faults);
    assert_eq!(whole.coordinates, streamed.coordinates);
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-10);
    assert!(close(&whole.energy, &streamed.energy), "{:?} {:?}", whole.energy, streamed.energy);
    for k in 0..whole.kept {
        assert!(close(&whole.modes[k], &streamed.modes[k]), "{k}");
    }
    // All that is told of the whole record but what belongs to a model is told of the streamed one
    // too. Only a record that is read as a whole is looked over for faults.
    let listed = |id: &str| id.ends_with("channel") && id != "dead-channel" || id == "gaps" || id == "nan-is-gap";
    for w in whole.warnings.iter().filter(|w| listed(w.id)) {
        assert!(streamed.warnings.contains(w), "{w:?}");
    }
    assert!(warned(streamed, "taken-block-by-block") && !warned(whole, "taken-block-by-block"));
}

#[test]
fn a_record_taken_block_by_block_has_the_whole_ones_modes() {
    // Five channels, of which one is dead and one a copy; gaps, holes and a single sample between
    // two gaps; several blocks.
    let row = |i: usize| {
        let t = i as f64 * 0.1;
        // It drifts, so that no release is looked for.
        let (a, b) = (0.1 * t + (0.7 * t).sin(), 0.2 * (1.9 * t).cos());
        let hole = if i % 30_011 == 17 { f64::NAN } else { a - b };
        vec![1e3 + a + b, a - 2.0 * b, 0.25, hole, 2.0 * (a - 2.0 * b) - 1.0]
    };
    let text = csv((0..120_000).map(row), 0.1);
    let lines = text.lines().enumerate().filter(|(i, _)| !matches!(i, 501..=507 | 509..=600 | 70_000));
    let cut: String = lines.map(|(_, l)| format!("{l}\n")).collect();
    let (whole, streamed) = both_ways(&rig(5, 10.0), &[cut, text], &ReduceSettings::default());
    assert_eq!(whole.channel_faults.len(), 2);
    assert!(warned(&whole, "gaps") && warned(&streamed, "short-stretches"));
    same_modes(&whole, &streamed);
    assert!(streamed.model.is_none() && streamed.releases.is_empty());
}

#[test]
fn whirling_angles_taken_block_by_block_are_decomposed_on_the_circle() {
    let angles = rig(2, 10.0).replace("\"m\"", "\"rad\"").replacen("\"x0\"\nunit", "\"theta1\"\nunit", 1).replacen(
        "\"x1\"\nunit",
        "\"theta2\"\nunit",
        1,
    );
    // The second arm, relative to the first, turns over now and then and is wrapped.
    let row = |i: usize| {
        let t = i as f64 * 0.1;
        let second = 3.0 * (0.05 * t).sin() + 0.02 * t;
        vec![0.8 * (0.3 * t).sin(), second.sin().atan2(second.cos())]
    };
    let text = csv((0..280_000).map(row), 0.1);
    let (whole, streamed) = both_ways(&angles, &[text], &ReduceSettings::default());
    assert_eq!(whole.coordinates, ["phi1", "phi2"]);
    assert!(whole.modes_imaginary.is_some() && streamed.modes_imaginary.is_some());
    same_modes(&whole, &streamed);
}

#[test]
fn a_constraint_is_refused_for_records_taken_block_by_block() {
    let settings = ReduceSettings { constraint: Some(Constraint::Polar), ..ReduceSettings::default() };
    let rig = Rig::parse(&rig(2, 10.0), Path::new("rig.toml")).unwrap();
    let none: [&Path; 0] = [];
    let error = long::reduce(&none, &rig, &ReadOptions::default(), &settings, &|_| {}).unwrap_err().to_string();
    assert!(error.contains("block by block") && error.contains("--constraint"), "{error}");
}

/// q″ + 0.8 q³ + q: what two channels x and x/2 of x″ + x + x³ make of it along their mode, q =
/// √1.25 x.
struct Duffing;

impl systems::Mechanical for Duffing {
    fn coordinates(&self) -> Vec<String> {
        vec!["q".into()]
    }
    fn mass(&self, _: &[f64]) -> Vec<f64> {
        vec![1.0]
    }
    fn potential(&self, x: &[f64]) -> f64 {
        0.5 * x[0] * x[0] + 0.2 * x[0].powi(4)
    }
    fn gradient(&self, x: &[f64]) -> Vec<f64> {
        vec![x[0] + 0.8 * x[0].powi(3)]
    }
    fn acceleration(&self, x: &[f64], _: &[f64], out: &mut [f64]) {
        out[0] = -x[0] - 0.8 * x[0].powi(3);
    }
}

/// Decays of x″ + 0.01 x′ + x + x³ from rest, a little noise on them.
fn decays() -> Vec<String> {
    [1.4, 0.35]
        .iter()
        .map(|start| {
            let (mut y, mut h) = (vec![*start, 0.0], 0.1);
            let rows = (0..1800_usize).map(|i| {
                let noise = |k: usize| 1e-5 * (((i * 7919 + k * 104_729) % 1000) as f64 / 500.0 - 1.0);
                let row = vec![y[0] + noise(0), 0.5 * y[0] + noise(1)];
                let mut f = |_: f64, y: &[f64], d: &mut [f64]| {
                    d[0] = y[1];
                    d[1] = -0.01 * y[1] - y[0] - y[0].powi(3);
                };
                assert!(integrate::advance(&mut f, &mut y, 0.0, 0.1, 1e-11, &mut h));
                row
            });
            csv(rows, 0.1)
        })
        .collect()
}

fn with_force(texts: &[String], force: Force) -> Result<Reduction> {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<_> = (0..texts.len()).map(|i| folder.path().join(format!("{i}.csv"))).collect();
    paths.iter().zip(texts).for_each(|(path, text)| std::fs::write(path, text).unwrap());
    let settings = ReduceSettings { force: Some(force), ..ReduceSettings::default() };
    let paths: Vec<&Path> = paths.iter().map(std::path::PathBuf::as_path).collect();
    reduced(&rig(2, 10.0), &paths, &settings)
}

#[test]
fn decays_give_damping_and_the_forced_response_with_its_folds() {
    let r = with_force(&decays(), Force { amplitude: 0.011, shape: None, damping: None }).unwrap();
    let found = r.forced.unwrap();
    let damping = found.damping_found.unwrap();
    assert!((damping.value - 0.01).abs() < 4.0 * damping.std_error + 2e-5, "{damping:?}");
    let forcing = forced_response::Forcing { amplitude: 0.011, shape: vec![1.0], damping: 0.01 };
    let settings = harmonic_balance::Continuation { harmonic: 7, from: 0.9, to: 1.6, scale: [1.0, 0.3], step: 0.02 };
    let full = harmonic_balance::response(&Duffing, &forcing, &[1.0], &settings).unwrap();
    assert_eq!((found.folds.len(), full.folds.len()), (2, 2), "{:?}", found.folds);
    for (ours, theirs) in found.folds.iter().zip(&full.folds) {
        let frequency = theirs.omega / std::f64::consts::TAU;
        assert!((ours.frequency_hz / frequency - 1.0).abs() < 2e-3, "{ours:?} {theirs:?}");
        assert!((ours.amplitude / theirs.amplitude - 1.0).abs() < 1e-2, "{ours:?} {theirs:?}");
    }
    // Stable up to the upper fold, unstable to the lower one, stable from there on.
    let flips: Vec<bool> = found.curve.windows(2).filter(|w| w[0].stable != w[1].stable).map(|w| w[1].stable).collect();
    assert!(found.curve[0].stable && flips == [false, true], "{flips:?}");
    assert!(found.peak.unwrap().amplitude >= found.folds[0].amplitude && found.backbone.len() > 50);
    // The model itself has standard errors, at every amplitude.
    assert!(!r.frequency_amplitude.is_empty());
    for p in &r.frequency_amplitude {
        assert!(p.std_error_hz > 0.0 && p.std_error_hz < 1e-3 * p.frequency_hz, "{p:?}");
    }
    let Some(Model::Polar(polar)) = r.model else { panic!("no polar model") };
    assert_eq!(polar.omega_squared.len(), polar.omega_squared_std_error.len());
}

#[test]
fn a_force_that_makes_no_sense_is_told() {
    let of =
        |amplitude, shape, damping| with_force(&decays(), Force { amplitude, shape, damping }).unwrap_err().to_string();
    assert!(of(0.0, None, None).contains("--force"));
    assert!(of(0.01, None, Some(-1.0)).contains("--damping"));
    assert!(of(0.01, Some(vec![1.0]), None).contains("--force-shape"));
    assert!(of(0.01, Some(vec![1.0, -2.0]), None).contains("--force-shape"), "across the mode");
    assert!(of(1e-12, None, None).contains("Raise the force"));
    // Swings that do not decay have no damping to take.
    let text = |a: f64| csv((0..900).map(|i| swing(a, i).to_vec()), 0.1);
    let force = Force { amplitude: 0.01, shape: None, damping: None };
    assert!(
        with_force(&[text(0.5), text(1.0), text(1.5)], force.clone()).unwrap_err().to_string().contains("--damping")
    );
    assert!(with_force(&[text(0.5)], force).unwrap_err().to_string().contains("no polar model"));
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

#[test]
fn a_measured_input_is_no_coordinate() {
    let rig = "name = \"axis\"\nmodel = \"positioning-drive\"\nsample_rate_hz = 100.0\n\
        [[channel]]\nname = \"x0\"\nmeasures = \"force\"\nunit = \"N\"\n\
        [[channel]]\nname = \"x1\"\nmeasures = \"q\"\nunit = \"m\"\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    let row = |i: u32| vec![50.0 * (0.31 * f64::from(i)).cos(), (0.07 * f64::from(i)).sin()];
    std::fs::write(&path, csv((0..2000).map(row), 0.01)).unwrap();
    let r = reduced(rig, &[&path], &ReduceSettings::default()).unwrap();
    assert_eq!((r.coordinates.as_slice(), r.units.as_slice()), (&["q".to_owned()][..], &["m".to_owned()][..]));
    assert_eq!(r.modes.len(), 1);
    let rig_path = folder.path().join("rig.toml");
    std::fs::write(&rig_path, rig).unwrap();
    let rig = Rig::read(&rig_path).unwrap();
    let (l, _) = long::reduce(&[&path], &rig, &ReadOptions::default(), &ReduceSettings::default(), &|_| {}).unwrap();
    assert_eq!((l.coordinates, l.modes.len()), (r.coordinates, 1));
}

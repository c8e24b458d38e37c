//! Against records made by the model's own flow.

use std::path::Path;

use super::super::cut::Cut;
use super::super::forcing::{Additions, Forcing};
use super::*;
use crate::explain::ranking::solve;
use crate::identify::stretches::Stretch;
use crate::identify::track;
use crate::model::flow::{Flow, Work};
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::tape::Registers;
use crate::signal::angles::Phase;

const TEXT: &str = "name = \"m\"\ncoordinates = [{ name = \"x\", space = \"R\" }]\n\
    [[equation]]\nbalance = \"-x''\"\nterms = { c = \"x'\", d = \"sign(x')\", k = \"x\", k3 = \"x^3\" }\n";
const STEP_S: f64 = 0.02;
const COUNT: usize = 400;

fn solution(motion: &EquationsOfMotion, p: &[f64], start: [f64; 2]) -> Vec<f64> {
    let outside = crate::model::flow::Outside::drive(0.0, 0.0, 0.0);
    let flow = Flow::new(motion, p, outside, STEP_S / 4.0);
    let mut work = Work::plain(motion);
    work.set(&start);
    let mut out = start.to_vec();
    for k in 1..COUNT {
        assert!(flow.carry(&mut work, (k - 1) as f64 * STEP_S, STEP_S));
        out.extend_from_slice(work.state());
    }
    out
}

fn record(seen: &[f64]) -> Stretch {
    Stretch {
        start_s: 0.0,
        step_s: STEP_S,
        coordinates: vec![seen.iter().step_by(2).copied().collect()],
        inputs: Vec::new(),
        phase: Phase::Clock(0.0),
        amplitude_nm: None,
        history: None,
        base: None,
    }
}

/// A record of slightly other coefficients from a slightly other state: one linearised step
/// about the model's own motion finds both, to second order in how far they are off; and about
/// a path that is no solution of the model at all, once it has been moved.
#[test]
fn one_step_finds_what_the_record_was_made_with() {
    let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
    let motion = EquationsOfMotion::new(&model, 1.0).unwrap();
    let (p, off) = ([0.1, 0.05, 4.0, 2.0], [1e-5, 2e-5, -3e-5, 4e-5]);
    let truth: Vec<f64> = p.iter().zip(off).map(|(a, b)| a + b).collect();
    let seen = solution(&motion, &truth, [1.0 + 1e-5, -0.2]);
    let stretch = record(&seen);
    let between = track::ExogenousInputs::new(&stretch, 0.0);
    let terms: Additions = model.equations[0].terms.iter().enumerate().map(|(k, t)| (k, 0, t.of.clone())).collect();
    let forcing = Forcing::new(&model, 1.0, &p, &[], 4, &terms);
    let measured =
        Measured { values: stretch.coordinates[0].clone(), shown: &[vec![1.0]], sigma: &[1e-6], laws: Vec::new() };
    let exogenous = WindowInputs { stretch: &stretch, between: &between, first: 0, omega: 0.0, points: 1 };
    let own = solution(&motion, &p, [1.0, -0.2]);
    // A path with defects everywhere.
    let bent: Vec<f64> = own.iter().enumerate().map(|(i, x)| x + 1e-3 * (0.7 * i as f64).sin()).collect();
    for (path, passes, segment) in [(own, 1, COUNT), (bent, 3, 33)] {
        let (mut states, mut found) = (path, p.to_vec());
        for _ in 0..passes {
            let linear =
                Linear::new(&states, &exogenous, VectorField { motion: &motion, parameters: &p }, &[]).unwrap();
            let driven = forcing.on(&linear.points, &linear.accelerations, &exogenous);
            let alpha = driven.all().unwrap();
            let mut registers = Registers::default();
            let between = |points, to: &mut Vec<f64>| driven.between(points, &mut registers, to);
            let layout = Layout::new(4, &[]);
            let cut = Cut { blocks: 1, segment };
            let (normal, blocks) = linear.normal(&states, between, &layout, &measured, cut).unwrap();
            assert_eq!(blocks[0].segments.len(), COUNT / segment);
            // Blocks of a window add up to it, wherever it is cut.
            let between = |points, to: &mut Vec<f64>| driven.between(points, &mut registers, to);
            let (same, parts) =
                linear.normal(&states, between, &layout, &measured, Cut { blocks: 7, segment: 20 }).unwrap();
            assert_eq!((same.rows, parts.len()), (normal.rows, 7));
            let solved = same.solved().unwrap();
            let mut sum = parts[0].of_window.left_by(&solved).unwrap();
            parts[1..].iter().for_each(|b| sum.add(&b.of_window.left_by(&solved).unwrap()));
            let all = |g: &crate::explain::engine::shooting::gram::Gram| g.chosen(&[0, 1, 2, 3]);
            let (whole, parted) = (all(&normal.reduced().unwrap()), all(&sum));
            assert!((&whole - parted).amax() < 1e-7 * whole.amax());
            let step = solve(&normal.reduced().unwrap().chosen(&[0, 1, 2, 3])).unwrap();
            found = step.iter().zip(&p).map(|(s, p)| s + p).collect();
            let start = normal.start(&step).unwrap();
            states = linear.moved(&states, &alpha, &start, &step, &measured).0;
        }
        for k in 0..4 {
            // Columns are integrated by the trapezoidal rule, and reversals fall between
            // samples.
            assert!((found[k] - truth[k]).abs() < 0.03 * off[k].abs(), "{passes} {k}: {found:?} {truth:?}");
        }
    }
}

/// What is left, held against a column instant for instant, adds up to the column's product with it
/// in the normal equations without the initial state: with one point to a sample and with several.
#[test]
fn the_adjoint_gives_the_products_with_what_is_left() {
    let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
    let motion = EquationsOfMotion::new(&model, 1.0).unwrap();
    let p = [0.1, 0.0, 4.0, 2.0];
    let own = solution(&motion, &p, [1.0, -0.2]);
    // What no state explains.
    let seen: Vec<f64> = own.iter().enumerate().map(|(i, x)| x + 1e-3 * (0.37 * i as f64).sin()).collect();
    let stretch = record(&seen);
    let between = track::ExogenousInputs::new(&stretch, 0.0);
    let terms: Additions = model.equations[0].terms.iter().enumerate().map(|(k, t)| (k, 0, t.of.clone())).collect();
    let forcing = Forcing::new(&model, 1.0, &p, &[], 4, &terms);
    let measured =
        Measured { values: stretch.coordinates[0].clone(), shown: &[vec![0.7]], sigma: &[1e-3], laws: Vec::new() };
    for points in [1, 3] {
        let exogenous = WindowInputs { stretch: &stretch, between: &between, first: 0, omega: 0.0, points };
        let field = VectorField { motion: &motion, parameters: &p };
        let linear = Linear::new(&own, &exogenous, field, &[]).unwrap();
        let driven = forcing.on(&linear.points, &linear.accelerations, &exogenous);
        let (alpha, layout) = (driven.all().unwrap(), Layout::new(0, &[1, 1, 1, 1]));
        let mut registers = Registers::default();
        let mut fit = |states: &[f64]| {
            let between = |points, to: &mut Vec<f64>| driven.between(points, &mut registers, to);
            linear.normal(states, between, &layout, &measured, Cut { blocks: 1, segment: COUNT }).unwrap().0
        };
        let start = fit(&own).start(&DVector::zeros(0)).unwrap();
        let (settled, _) = linear.moved(&own, &alpha, &start, &DVector::zeros(4), &measured);
        let products = linear.products(&settled, &alpha, 1, 4, &measured);
        let gram = fit(&own).reduced().unwrap();
        for (column, found) in (1..4).zip(&products) {
            let (wanted, found) = (gram.chosen(&[column])[(0, 1)], found.iter().sum::<f64>());
            assert!((found - wanted).abs() < 1e-7 * wanted.abs(), "{points} {column}: {found} {wanted}");
        }
    }
}

/// Where the state and the columns grow by 10⁹ along one direction, what is left of the columns'
/// products without it is that of an orthogonal basis of the state, row by row.
#[test]
fn digits_outlast_what_grows() {
    let model = ModelFile::parse(TEXT, Path::new("m.toml")).unwrap();
    let motion = EquationsOfMotion::new(&model, 1.0).unwrap();
    let p = [0.1, 0.05, -9.0, 0.0];
    let path: Vec<f64> = (0..COUNT)
        .map(|k| k as f64 * STEP_S)
        .flat_map(|t| [t.sin() + 0.3 * (2.3 * t).sin(), t.cos() + 0.69 * (2.3 * t).cos()])
        .collect();
    let stretch = record(&path);
    let between = track::ExogenousInputs::new(&stretch, 0.0);
    let terms: Additions = model.equations[0].terms.iter().enumerate().map(|(k, t)| (k, 0, t.of.clone())).collect();
    let forcing = Forcing::new(&model, 1.0, &p, &[], 4, &terms);
    let measured =
        Measured { values: stretch.coordinates[0].clone(), shown: &[vec![1.0]], sigma: &[1e-3], laws: Vec::new() };
    let exogenous = WindowInputs { stretch: &stretch, between: &between, first: 0, omega: 0.0, points: 1 };
    let field = VectorField { motion: &motion, parameters: &p };
    let linear = Linear::new(&path, &exogenous, field, &[]).unwrap();
    let driven = forcing.on(&linear.points, &linear.accelerations, &exogenous);
    let alpha = driven.all().unwrap();
    let along = Along { alpha: &alpha, columns: 4, measured: &measured, samples: 0..COUNT, last: COUNT - 1 };
    let (rows, _) = linear.head(&path, &Strip { lead: 2, columns: 0..4, trail: 1 }, &along);
    let rows = rows.transpose();
    assert!(rows.columns(0, 2).amax() > 1e9 * rows.row(0).amax());
    // The state's columns are nearly one: an orthogonal basis of one and what is left of the other.
    let basis = rows.columns(0, 2).into_owned().qr().q();
    let project = |x: DMatrix<f64>| &x - &basis * (basis.transpose() * &x);
    let left = project(project(rows.columns(2, 5).into_owned()));
    let wanted = left.transpose() * &left;
    for layout in [Layout::new(4, &[]), Layout::new(0, &[4])] {
        let mut registers = Registers::default();
        let between = |points, to: &mut Vec<f64>| driven.between(points, &mut registers, to);
        let cut = Cut { blocks: 1, segment: 20 };
        let (normal, blocks) = linear.normal(&path, between, &layout, &measured, cut).unwrap();
        let (all, alone) = (normal.reduced().unwrap(), blocks[0].alone.reduced().unwrap());
        let (all, alone) = (all.chosen(&[0, 1, 2, 3]), alone.chosen(&[0, 1, 2, 3]));
        for (i, j) in (0..5).flat_map(|i| (0..5).map(move |j| (i, j))) {
            let size = (wanted[(i, i)] * wanted[(j, j)]).sqrt();
            assert!((all[(i, j)] - wanted[(i, j)]).abs() < 1e-6 * size, "{i} {j}: {all} {wanted}");
            assert!((alone[(i, j)] - wanted[(i, j)]).abs() < 1e-6 * size);
        }
    }
}

use super::*;
use crate::model::model_file::expression::{add, call, divide, multiply, subtract, symbol};

/// (v − |v| z)/d.
fn dahl(d: f64) -> Memory {
    let (v, z) = (symbol(Symbol::Rate(0)), symbol(Symbol::State(0)));
    Memory::new(vec![divide(subtract(v.clone(), multiply(call(Function::Abs, v), z)), number(d))])
}

fn swing(count: usize, step_s: f64) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let at = |i: usize| 3.0 * i as f64 * step_s;
    let x = (0..count).map(|i| at(i).sin()).collect();
    let v = (0..count).map(|i| 3.0 * at(i).cos()).collect();
    (vec![x], vec![v])
}

/// Dahl's law has the closed solution z = s − (s − z₀) exp(−|x − x₀|/d) from one reversal to
/// the next.
#[test]
fn dahls_friction_follows_its_closed_solution_however_stiff() {
    let step_s = 0.005;
    let (x, v) = swing(2000, step_s);
    let course = Course::new(x.clone(), v.clone(), step_s, vec![false]);
    for (d, most) in [(0.3, 1e-4), (0.02, 1e-4), (1e-6, 1e-9)] {
        let z = dahl(d).follow(&course).unwrap().remove(0);
        let (mut from, mut start, mut sign) = (x[0][0], 0.0, 1.0);
        for i in 0..2000 {
            if v[0][i] * sign < 0.0 {
                // The reversal lies at ± 1.
                start = sign - (sign - start) * (-(sign - from) * sign / d).exp();
                (from, sign) = (sign, -sign);
            }
            let expected = sign - (sign - start) * (-(x[0][i] - from) * sign / d).exp();
            let near = (x[0][i].abs() - 1.0).abs() < 2e-4;
            assert!((z[i] - expected).abs() < if near { 0.2 } else { most }, "{d} {i}: {} {expected}", z[i]);
        }
    }
}

/// Stretches between missing samples may be of one, or of none.
#[test]
fn one_sample_alone_has_a_state() {
    for count in [0, 1, 2] {
        let (x, v) = swing(count, 0.01);
        let course = Course::new(x.clone(), v.clone(), 0.01, vec![false]);
        let z = dahl(0.1).follow(&course).unwrap().remove(0);
        assert!(z.len() == count && z.iter().all(|z| z.is_finite()), "{count}: {z:?}");
    }
}

/// Play of 0.2 under sin 3t: z stands for 0.4 of the way after a reversal, then follows 0.2 behind.
#[test]
fn play_follows_at_its_distance_from_where_it_is_taken_along() {
    let (x, v, z) = (symbol(Symbol::Coordinate(0)), symbol(Symbol::Rate(0)), symbol(Symbol::State(0)));
    let sign = |a: Node| call(Function::Sign, a);
    let over = subtract(multiply(sign(v.clone()), subtract(x, z)), number(0.2));
    let law = multiply(v, multiply(number(0.5), add(number(1.0), sign(over))));
    let step_s = 0.005;
    let (x, v) = swing(2000, step_s);
    let course = Course::new(x.clone(), v.clone(), step_s, vec![false]);
    let z = Memory::new(vec![law]).follow(&course).unwrap().remove(0);
    let mut expected = 0.0_f64;
    for (i, z) in z.iter().enumerate() {
        expected = expected.clamp(x[0][i] - 0.2, x[0][i] + 0.2);
        // A sample is 0.015 of the way, a sixteenth of it 9e-4.
        assert!((z - expected).abs() < 4e-5, "{i}: {z} {expected}");
    }
}

/// z′ = v − z/T is a high-pass of the position; fast ones settle at T v.
#[test]
fn relaxation_is_a_high_pass() {
    let law = |t: f64| {
        Memory::new(vec![subtract(symbol(Symbol::Rate(0)), multiply(number(1.0 / t), symbol(Symbol::State(0))))])
    };
    assert!((law(0.2).settles_s() - 0.2).abs() < 1e-15 && dahl(0.1).settles_s().is_infinite());
    let (x, v) = swing(4000, 0.005);
    let course = Course::new(x.clone(), v.clone(), 0.005, vec![false]);
    for (t, most) in [(0.2, 1e-5), (1e-5, 2e-4)] {
        let z = law(t).follow(&course).unwrap().remove(0);
        for i in 3000..4000 {
            let a = 0.015 * i as f64;
            let w = 3.0 * t;
            let expected = (w * w * a.sin() + w * a.cos()) / (1.0 + w * w);
            assert!((z[i] - expected).abs() < most * w.max(0.01), "{t} {i}: {} {expected}", z[i]);
        }
    }
}

/// Two states that swing, and one that runs away.
#[test]
fn several_states_swing_and_what_runs_away_is_refused() {
    let z = |k| symbol(Symbol::State(k));
    let two = Memory::new(vec![z(1), add(multiply(number(-400.0), z(0)), symbol(Symbol::Rate(0)))]);
    let (x, v) = swing(1000, 0.005);
    let course = Course::new(x.clone(), v.clone(), 0.005, vec![false]);
    let out = two.follow(&course).unwrap();
    // z″ + 400 z = 3 cos 3t from rest.
    for i in 0..1000 {
        let t = 0.005 * i as f64;
        let expected = 3.0 / 391.0 * ((3.0 * t).cos() - (20.0 * t).cos());
        assert!((out[0][i] - expected).abs() < 1e-5, "{i}: {} {expected}", out[0][i]);
    }
    assert!(Memory::new(vec![add(number(1.0), multiply(number(1e4), z(0)))]).follow(&course).is_none());
}

/// Followed with the motion, a state is what it is along the motion that was found.
#[test]
fn a_state_followed_with_the_motion_is_that_along_it() {
    use crate::model::integrate::{Outside, Settings, solve};
    use crate::model::model_file::ModelFile;
    use crate::model::model_file::equations_of_motion::EquationsOfMotion;
    use crate::model::model_file::expression::Expression;
    struct Nothing;
    impl Outside for Nothing {
        fn tau(&self, _: f64) -> f64 {
            0.0
        }
        fn inputs(&self, _: f64, _: &mut [f64]) {}
    }
    let text = "name = \"m\"\ncoordinates = [{ name = \"x\", space = \"R\" }]\n\
        [[equation]]\nbalance = \"-x''\"\nterms = { k = \"x\" }\n";
    let model = ModelFile::parse(text, std::path::Path::new("m.toml")).unwrap();
    let state = std::sync::Arc::new(Expression::Memory(std::sync::Arc::new(dahl(0.05)), 0));
    let terms = [(0, "F".to_owned(), state)];
    let motion = EquationsOfMotion::with_columns(&model, 1.0, &terms).unwrap();
    assert_eq!(motion.hidden().len(), 1);
    let step_s = 0.005;
    let settings = Settings { start_s: 0.0, step_s, count: 1000, tolerance: 1e-10, inputs: 0, finest: 400.0 };
    let initial = motion.with_states(&[1.0, 0.0], &[]);
    let all = solve(&motion, &[9.0, 1.2], &initial, &Nothing, &settings).unwrap();
    let column = |k: usize| vec![all.iter().map(|y| y[k]).collect::<Vec<f64>>()];
    let course = Course::new(column(0), column(2), step_s, vec![false]);
    let z = dahl(0.05).follow(&course).unwrap().remove(0);
    for (i, y) in all.iter().enumerate() {
        // y holds x, what nothing depends on, v, z.
        assert!((y[3] - z[i]).abs() < 2e-3, "{i}: {y:?} {}", z[i]);
    }
    let size = |from: usize| all[from..].iter().fold(0.0_f64, |m, y| m.max(y[0].abs()));
    assert!(size(800) < 0.6 * size(0), "friction takes energy away");
}

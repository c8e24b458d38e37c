use super::super::parser::{Names, parse};
use super::*;

#[test]
fn blocks_points_and_trees_agree() {
    let names = Names { coordinates: vec!["q".into()], inputs: vec!["u".into()] };
    let texts = [
        "sin(q)*cos(q) + cos(q)^2 - q^3/(1 + q*q)",
        "tanh(u)*exp(-q^2)*abs(2 + q') + sqrt(2 + sin(q)) - log(3 + cos(u)) + tan(q/9)",
        "(2 + cos(q))^u + q^-3 + q^5",
        "4",
        "q''*u",
    ];
    let nodes: Vec<Node> = texts.iter().map(|t| parse(t, &names).unwrap()).collect();
    let tape = Tape::new(&nodes);
    let count = 1000;
    let of = |s: Symbol, i: usize| {
        let k = match s {
            Symbol::Coordinate(_) => 0.7,
            Symbol::Rate(_) => 1.1,
            Symbol::Acceleration(_) => 0.3,
            _ => 2.3,
        };
        (0.01 * k * i as f64 + k).sin() + 0.1
    };
    let data: Vec<Vec<f64>> = tape.symbols().iter().map(|s| (0..count).map(|i| of(*s, i)).collect()).collect();
    let columns: Vec<&[f64]> = data.iter().map(Vec::as_slice).collect();
    let out = tape.run(&columns, count);
    let (mut registers, mut one) = (Vec::new(), vec![0.0; nodes.len()]);
    for i in 0..count {
        let values: Vec<f64> = tape.symbols().iter().map(|s| of(*s, i)).collect();
        tape.at(&values, &mut registers, &mut one);
        for (k, e) in nodes.iter().enumerate() {
            let expected = e.value(&|s| of(s, i));
            assert!((out[k][i] - expected).abs() <= 1e-12 * expected.abs(), "{}", texts[k]);
            assert!((one[k] - expected).abs() <= 1e-12 * expected.abs(), "{}", texts[k]);
        }
    }
    // Sine and cosine of q are computed once.
    assert_eq!(tape.operations.iter().filter(|o| matches!(o, Operation::SinCos(_))).count(), 2);
}

/// States side by side are those of other windows: one does not blur the sign of another.
#[test]
fn of_points_that_are_no_neighbours_a_sign_is_that_of_the_point() {
    let names = Names { coordinates: vec!["q".into()], inputs: vec![] };
    let nodes = ["(abs(q) - 0.5)*(1 + sign(abs(q) - 0.5))", "sign(q)"].map(|t| parse(t, &names).unwrap());
    let tape = Tape::new(&nodes);
    let q: Vec<f64> = (0..ABREAST).map(|i| (7.3 * i as f64).sin()).collect();
    let mut registers = Registers::default();
    tape.over(&[&q], ABREAST, &mut registers);
    for (k, node) in nodes.iter().enumerate() {
        for (i, x) in q.iter().enumerate() {
            assert_eq!(tape.output(k, &registers)[i], node.value(&|_| *x), "{k} {i} {x}");
        }
    }
}

#[test]
fn a_sign_is_its_mean_over_a_step_across_blocks() {
    let names = Names { coordinates: vec!["q".into()], inputs: vec![] };
    let tape = Tape::new(&[parse("sign(q')", &names).unwrap()]);
    // Crosses zero at sample 256.25, where two blocks meet.
    let v: Vec<f64> = (0..600).map(|i| 0.5 * (i as f64 - 256.25)).collect();
    let out = tape.run(&[&v], 600);
    assert_eq!((out[0][255], out[0][257]), (-1.0, 1.0));
    assert!((out[0][256] + 0.5).abs() < 1e-12, "{}", out[0][256]);
    // The sum then follows the reversal to a fraction of a step.
    assert!((out[0].iter().sum::<f64>() - (343.25 - 256.75)).abs() < 1e-9);
}

/// ∫ |v| of a straight line through zero, which a sum of plain values misses by up to an eighth
/// of a step; and the difference by the corner's place is the mean of the sign.
#[test]
fn an_absolute_value_is_its_mean_over_a_step() {
    let names = Names { coordinates: vec!["q".into()], inputs: vec![] };
    let nodes = ["abs(q')", "abs(q' + 0.001) - abs(q' - 0.001)", "sign(q')"].map(|t| parse(t, &names).unwrap());
    let tape = Tape::new(&nodes);
    let v: Vec<f64> = (0..600).map(|i| 0.5 * (i as f64 - 256.25)).collect();
    let out = tape.run(&[&v], 600);
    // From half a step before the first sample to half a step after the last.
    let area = 0.5 * 0.5 * (256.75_f64.powi(2) + 343.25_f64.powi(2));
    assert!((out[0].iter().sum::<f64>() - area).abs() < 1e-9);
    assert!(v.iter().map(|v| v.abs()).sum::<f64>() < area - 0.03);
    let apart = |i: usize| (out[1][i] / 0.002 - out[2][i]).abs();
    assert!((0..600).all(|i| apart(i) < 1e-9), "{:?}", (0..600).map(apart).fold(0.0, f64::max));
}

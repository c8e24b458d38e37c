use super::*;
use crate::model::dynamics::Switch;
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::{EquationsOfMotion, wrapped};

/// q̈ = −k q − c v − μ sign v + F cos τ; parameters k, c, μ, F.
struct Block(Vec<Switch>);

impl Block {
    fn new() -> Self {
        Self(vec![Switch::of_rates(vec![1.0])])
    }
}

impl Dynamics for Block {
    fn degrees_of_freedom(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        4
    }
    fn switches(&self) -> &[Switch] {
        &self.0
    }
    fn acceleration_held(&self, here: Here<'_>, out: &mut [f64]) -> bool {
        let Here { parameters: p, q, v, at, signs: s } = here;
        out[0] = -p[0] * q[0] - p[1] * v[0] - p[2] * s[0] + p[3] * at.tau.cos();
        out[0].is_finite()
    }
    fn linearise_held(&self, here: Here<'_>, out: Linearisation<'_>) -> bool {
        let Here { parameters: p, q, v, at, signs: s } = here;
        out.partials.copy_from_slice(&[-p[0], -p[1], -q[0], -v[0], -s[0], at.tau.cos()]);
        self.acceleration_held(here, out.acceleration)
    }
}

fn positions(p: &[f64], state: &[f64], omega: f64, step: f64, spacing: f64, count: usize) -> Vec<f64> {
    let block = Block::new();
    let flow = Flow::new(&block, p, Outside::drive(0.0, 0.0, omega), step);
    let mut work = Work::plain(&block);
    work.set(state);
    let mut out = Vec::new();
    assert!(flow.samples(&mut work, 0.0, spacing, count, |_, s| out.push(s[0])));
    out
}

#[test]
fn an_oscillator_follows_its_formula_between_steps_too() {
    let (k, c) = (9.0_f64, 0.4);
    let x = positions(&[k, c, 0.0, 0.0], &[1.0, 0.0], 0.0, 0.05, 0.013, 500);
    let w = (k - 0.25 * c * c).sqrt();
    for (i, x) in x.iter().enumerate() {
        let t = i as f64 * 0.013;
        let exact = (-0.5 * c * t).exp() * ((w * t).cos() + 0.5 * c / w * (w * t).sin());
        assert!((x - exact).abs() < 2e-7, "{t} {x} {exact}");
    }
}

/// Dry friction takes 2μ/k off the amplitude at each reversal, and the block rests where the spring
/// no longer overcomes it.
#[test]
fn dry_friction_takes_two_mu_over_k_each_half_turn_and_then_sticks() {
    let (k, mu) = (4.0, 0.5);
    let x = positions(&[k, 0.0, mu, 0.0], &[1.05, 0.0], 0.0, 0.07, std::f64::consts::FRAC_PI_2, 12);
    // Reversals at 1.05, −0.80, 0.55, −0.30, 0.05: there 4·0.05 < 0.5.
    for (x, exact) in x.iter().zip([1.05, -0.80, 0.55, -0.30, 0.05, 0.05, 0.05]) {
        assert!((x - exact).abs() < 1e-6, "{x} {exact}");
    }
    // Derivatives after three reversals: x = −(A − 6 μ/k), so ∂x/∂A = −1, ∂x/∂μ = 6/k.
    let block = Block::new();
    let p = [k, 0.0, mu, 0.0];
    let flow = Flow::new(&block, &p, Outside::drive(0.0, 0.0, 0.0), 0.07);
    let mut work = Work::by_all(&block);
    work.set(&[1.05, 0.0]);
    assert!(flow.carry(&mut work, 0.0, 1.5 * std::f64::consts::PI));
    let d = work.derivatives();
    assert!((d[0] + 1.0).abs() < 1e-4 && (d[4] - 6.0 / k).abs() < 1e-4, "{d:?}");
    // At rest for good nothing moves it but its last stop: x = A − 8 μ/k.
    assert!(flow.carry(&mut work, 0.0, 3.0));
    let d = work.derivatives();
    assert!((d[0] - 1.0).abs() < 1e-4 && (d[4] + 8.0 / k).abs() < 1e-4 && d[6].abs() < 1e-9, "{d:?}");
}

#[test]
fn stick_and_slip_agree_with_steps_a_hundred_times_smaller_and_derivatives_with_differences() {
    let p = [9.0, 0.1, 2.0, 6.0];
    let coarse = positions(&p, &[0.3, 0.0], 1.3, 0.02, 0.1, 400);
    let fine = positions(&p, &[0.3, 0.0], 1.3, 0.0002, 0.1, 400);
    let rested = coarse.windows(2).filter(|w| (w[1] - w[0]).abs() < 1e-9).count();
    assert!(rested > 20, "{rested}");
    for (a, b) in coarse.iter().zip(&fine) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
    let block = Block::new();
    let flow = Flow::new(&block, &p, Outside::drive(0.0, 0.0, 1.3), 0.02);
    let mut work = Work::by_all(&block);
    work.set(&[0.3, 0.0]);
    let mut rows = Vec::new();
    assert!(flow.samples(&mut work, 0.0, 0.1, 400, |_, s| rows.push(s.to_vec())));
    for k in 0..4 {
        let moved = |d: f64| {
            let mut q = p;
            q[k] += d;
            positions(&q, &[0.3, 0.0], 1.3, 0.002, 0.1, 400)
        };
        let (a, b) = (moved(1e-4), moved(-1e-4));
        for i in [50, 133, 277, 399] {
            let difference = (a[i] - b[i]) / 2e-4;
            assert!((rows[i][3 + k] - difference).abs() < 2e-3, "{k} {i} {} {difference}", rows[i][3 + k]);
        }
    }
}

/// A block on a belt, at a steady speed and at one that is measured, seen from the laboratory and
/// from the belt, where friction turns at rest: z = x − ∫ speed.
#[test]
fn a_block_sticks_to_a_belt_and_slips_as_seen_from_the_belt() {
    let model = |balance: &str, stretch: &str, rate: &str, inputs: &str| {
        let text = format!(
            "name = \"m\"\n{inputs}coordinates = [{{ name = \"x\", space = \"R\" }}]\n[[equation]]\n\
             balance = \"{balance}\"\nterms = {{ k = \"{stretch}\", m = \"sign({rate})\", d = \"{rate}\" }}\n"
        );
        let file = ModelFile::parse(&text, std::path::Path::new("m.toml")).unwrap();
        EquationsOfMotion::new(&file, 1.0).unwrap()
    };
    let p = [9.0, 2.0, 0.1];
    let wavy = |t: f64, u: &mut [f64]| u[0] = 0.3 + 0.1 * (2.0 * t).sin();
    let cases: [(f64, [&str; 4], [&str; 4]); 2] = [
        (0.0, ["-x''", "x", "x' - 0.3", ""], ["-x''", "x + 0.3*tau", "x'", ""]),
        (
            0.05,
            ["-x''", "x", "2*x' - 2*belt", "inputs = [\"belt\"]\n"],
            ["-x'' - 0.2*cos(2*tau)", "x + 0.3*tau + 0.05 - 0.05*cos(2*tau)", "2*x'", ""],
        ),
    ];
    for (wave, lab, belt) in cases {
        let [lab, belt] = [lab, belt].map(|[a, b, c, d]| model(a, b, c, d));
        assert_eq!((lab.switches().len(), belt.switches().len()), (1, 1));
        let run = |motion: &EquationsOfMotion, start: f64, p: &[f64]| {
            let inputs = (motion.switches()[0].inputs.len() == 1).then_some(Inputs { count: 1, at: &wavy });
            let outside = Outside { inputs, ..Outside::drive(0.0, 0.0, 1.0) };
            let mut work = Work::by_all(motion);
            work.set(&[0.02, start]);
            let mut out = Vec::new();
            assert!(
                Flow::new(motion, p, outside, 0.01).samples(&mut work, 0.0, 0.05, 200, |_, s| out.push(s.to_vec()))
            );
            out
        };
        let (x, z) = (run(&lab, 0.0, &p), run(&belt, -0.3, &p));
        let carried = |t: f64| 0.3 * t + wave * (1.0 - (2.0 * t).cos());
        let carries: Vec<f64> = (0..200).map(|i| carried(0.05 * i as f64)).collect();
        let stuck = z.windows(2).filter(|w| (w[1][0] - w[0][0]).abs() < 1e-9).count();
        assert!((8..180).contains(&stuck), "{stuck}");
        for ((x, z), c) in x.iter().zip(&z).zip(&carries) {
            assert!((x[0] - z[0] - c).abs() < 2e-6, "{} {} {c}", x[0], z[0]);
            for (a, b) in x[1..].iter().zip(&z[1..]) {
                assert!((a - b).abs() < 2e-4 * (1.0 + b.abs()), "{x:?} {z:?}");
            }
        }
    }
}

fn written(space: &str, terms: &str) -> EquationsOfMotion {
    let text = format!(
        "name = \"m\"\ncoordinates = [{{ name = \"x\", space = \"{space}\" }}]\n[[equation]]\n\
         balance = \"-x''\"\nterms = {{ {terms} }}\n"
    );
    EquationsOfMotion::new(&ModelFile::parse(&text, std::path::Path::new("m.toml")).unwrap(), 1.0).unwrap()
}

/// A mass between two stops: free flight, then half a period on a spring, and back. Steps as long as
/// a quarter of that, which no corner may stand in.
#[test]
fn a_mass_between_stops_follows_its_formula_and_so_do_its_derivatives() {
    let motion = written("R", "k = \"x - (abs(x + 0.3) - abs(x - 0.3))/2\"");
    assert_eq!((motion.corners().len(), motion.goes_abreast()), (2, true));
    let (k, b, v) = (4.0_f64, 0.3, 0.7);
    let p = [k];
    let flow = Flow::new(&motion, &p, Outside::drive(0.0, 0.0, 1.0), 0.05);
    let mut work = Work::by_all(&motion);
    work.set(&[0.0, v]);
    let w = k.sqrt();
    let (to_stop, on_it) = (b / v, core::f64::consts::PI / w);
    let exact = |t: f64| {
        let in_half = t % (2.0 * to_stop + on_it);
        let sense = if ((t / (2.0 * to_stop + on_it)) as u32).is_multiple_of(2) { 1.0 } else { -1.0 };
        let held = in_half - to_stop;
        sense
            * if held < 0.0 {
                v * in_half
            } else if held < on_it {
                b + v / w * (w * held).sin()
            } else {
                b - v * (held - on_it)
            }
    };
    let mut last = Vec::new();
    assert!(flow.samples(&mut work, 0.0, 0.037, 200, |i, s| {
        assert!((s[0] - exact(0.037 * i as f64)).abs() < 1e-6, "{i} {} {}", s[0], exact(0.037 * i as f64));
        last = s.to_vec();
    }));
    let near = |start: &[f64], k: f64| {
        let mut work = Work::plain(&motion);
        work.set(start);
        let mut at = 0.0;
        let p = [k];
        let flow = Flow::new(&motion, &p, Outside::drive(0.0, 0.0, 1.0), 0.01);
        assert!(flow.samples(&mut work, 0.0, 0.037, 200, |_, s| at = s[0]));
        at
    };
    let d = 1e-5;
    let by_place = (near(&[d, v], k) - near(&[-d, v], k)) / (2.0 * d);
    let by_rate = (near(&[0.0, v + d], k) - near(&[0.0, v - d], k)) / (2.0 * d);
    let by_k = (near(&[0.0, v], k + d) - near(&[0.0, v], k - d)) / (2.0 * d);
    for (found, want) in last[1..].iter().zip([by_place, by_rate, by_k]) {
        assert!((found - want).abs() < 1e-3 * (1.0 + want.abs()), "{last:?} {by_place} {by_rate} {by_k}");
    }
}

/// Stops of a joint that turns over: counted from the turn that it is in, a force that jumps among
/// them.
#[test]
fn corners_of_a_joint_that_turns_over_are_found_in_every_turn() {
    let terms = "k = \"abs(wrap(x) - 1) + abs(wrap(x) + 2)\", s = \"sign(wrap(x) - 2)\"";
    let motion = written("S1", terms);
    assert_eq!((motion.corners().len(), motion.seams().len()), (3, 1));
    let run = |step: f64, p: [f64; 2]| {
        let mut work = Work::by_all(&motion);
        work.set(&[0.4, 5.0]);
        let mut out = Vec::new();
        let flow = Flow::new(&motion, &p, Outside::drive(0.0, 0.0, 1.0), step);
        assert!(flow.samples(&mut work, 0.0, 0.11, 60, |_, s| out.push(s.to_vec())));
        out
    };
    let (coarse, fine) = (run(0.05, [0.1, 0.4]), run(0.0005, [0.1, 0.4]));
    assert!(coarse.last().unwrap()[0].abs() > 10.0, "{coarse:?}");
    for (a, b) in coarse.iter().zip(&fine) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + b.abs())), "{a:?} {b:?}");
    }
    let (ahead, behind) = (run(0.01, [0.1, 0.4 + 1e-5]), run(0.01, [0.1, 0.4 - 1e-5]));
    for ((a, b), c) in ahead.iter().zip(&behind).zip(&coarse) {
        assert!(((a[0] - b[0]) / 2e-5 - c[4]).abs() < 1e-4 * (1.0 + c[4].abs()), "{a:?} {b:?} {c:?}");
    }
}

/// A force of one size towards the middle: passes of it come faster and faster, to rest.
#[test]
fn what_comes_to_rest_about_a_corner_is_followed() {
    let motion = written("R", "f = \"sign(x)\", c = \"x'\"");
    let p = [2.0, 0.8];
    let flow = Flow::new(&motion, &p, Outside::drive(0.0, 0.0, 1.0), 0.02);
    let mut work = Work::by_all(&motion);
    work.set(&[0.5, 0.0]);
    let mut last = 0.0;
    assert!(flow.samples(&mut work, 0.0, 0.02, 1000, |_, s| last = s[0]));
    assert!(last.abs() < 1e-3, "{last}");
}

#[test]
fn what_has_no_solution_is_said() {
    let block = Block::new();
    let p = [9.0, 0.1, f64::NAN, 6.0];
    let mut work = Work::plain(&block);
    work.set(&[0.3, 1.0]);
    assert!(!Flow::new(&block, &p, Outside::drive(0.0, 0.0, 1.0), 0.1).carry(&mut work, 0.0, 1.0));
    let p = [-1e300, 0.0, 0.0, 0.0];
    work.set(&[1e200, 1.0]);
    assert!(!Flow::new(&block, &p, Outside::drive(0.0, 0.0, 1.0), 0.1).carry(&mut work, 0.0, 1.0));
}

/// The double pendulum beside hil-sim's plant, which has other equations (in physical units) and
/// another integrator.
#[test]
fn the_double_pendulum_follows_the_simulated_plant() {
    use crate::model::double_pendulum::DAMPINGS;
    use crate::model::double_pendulum_dynamics::DoublePendulum;
    use crate::rig::Rig;
    use crate::rig::plant::Plant;
    use core::f64::consts::TAU;

    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml");
    let rig = Rig::read(path).unwrap();
    let plant = Plant::of(&rig).unwrap();
    let d = DoublePendulum::new(rig.omega(), true, &[&DAMPINGS[0], &DAMPINGS[1]]);
    let p: Vec<f64> = d.names().iter().map(|n| plant.truth(n, rig.omega()).unwrap()).collect();
    let mut settings = crate::simulate::settings(&rig, &[], 10.0, 1).unwrap();
    settings.counts_per_turn = [1 << 20; 2];
    settings.seed = None;
    settings.settle_s = 0.0;
    let mut simulation = whirl_hil_sim::Simulation::new(&settings).unwrap();
    let count = 500;
    let mut flown = Vec::new();
    let flow = Flow::new(&d, &p, Outside::drive(0.0, 0.0, rig.omega()), 2e-3);
    let mut work = Work::plain(&d);
    work.set(&plant.initial);
    assert!(flow.samples(&mut work, 0.0, 2e-3, count, |_, s| flown.push([s[0], s[1] - s[0]])));
    let scale = TAU / f64::from(1 << 20);
    for (i, f) in flown.iter().enumerate() {
        let s = simulation.next_sample().unwrap();
        for k in 0..2 {
            let seen = (f64::from(s.counts[k]) + 0.5) * scale;
            // A second of chaos (e⁴) on half a count and the integrators' tolerances.
            assert!((f[k] - seen).abs() < 1e-5, "sample {i}, encoder {}: {} {seen}", k + 1, f[k]);
        }
    }
}

/// A spring of third order in a joint that whirls: its torque jumps where the angle turns over, its
/// potential does not, so that energy is kept; derivatives are those by differences, and steps side
/// by side those that are taken alone.
#[test]
fn what_jumps_where_an_angle_turns_over_is_located_with_its_derivatives() {
    let text = "name = \"m\"\ncoordinates = [{ name = \"y\", space = \"S1\" }]\n\
        [[equation]]\nbalance = \"-y''\"\nterms = { k = \"wrap(y)^3\" }\n";
    let model = ModelFile::parse(text, std::path::Path::new("m.toml")).unwrap();
    let motion = EquationsOfMotion::new(&model, 1.0).unwrap();
    assert_eq!(motion.seams(), [vec![1.0]]);
    let stiffness = 0.7;
    let reached = |start: [f64; 2], seconds: f64| {
        let p = [stiffness];
        let flow = Flow::new(&motion, &p, Outside::drive(0.0, 0.0, 0.0), 0.01);
        let mut work = Work::by_state(&motion);
        work.set(&start);
        assert!(flow.carry(&mut work, 0.0, seconds));
        [work.state(), work.derivatives()].concat()
    };
    let energy = |y: f64, v: f64| 0.5 * v * v + 0.25 * stiffness * wrapped(y).powi(4);
    for start in [[0.4, 9.0], [0.4, -9.0], [3.0, 6.2]] {
        let end = reached(start, 3.0);
        assert!((end[0] - start[0]).abs() > 4.0 * core::f64::consts::PI, "whirls: {end:?}");
        assert!((energy(end[0], end[1]) / energy(start[0], start[1]) - 1.0).abs() < 1e-7, "{start:?} {end:?}");
        for k in 0..2 {
            let side = |h: f64| {
                let mut moved = start;
                moved[k] += h;
                reached(moved, 3.0)
            };
            let (ahead, behind) = (side(1e-5), side(-1e-5));
            for i in 0..2 {
                let (by, wanted) = (end[2 + 2 * i + k], (ahead[i] - behind[i]) / 2e-5);
                assert!((by - wanted).abs() < 1e-4 * wanted.abs().max(1.0), "{start:?} {i} {k}: {by} {wanted}");
            }
        }
    }
    let starts: Vec<[f64; 2]> = (0..8).map(|i| [2.9 + 0.06 * f64::from(i), if i < 5 { 9.0 } else { -9.0 }]).collect();
    let mut steps = abreast::Steps::new(&motion);
    steps.set(starts.iter().map(|s| &s[..]));
    let outside = abreast::Outside { omega: 0.0, inputs: 0, at: &|_, _| {} };
    let field = abreast::VectorField { motion: &motion, parameters: &[stiffness] };
    steps.carry(field, |_| (0.0, 0.0), &outside, 0.01);
    for (i, start) in starts.iter().enumerate() {
        for (c, x) in reached(*start, 0.01).into_iter().enumerate() {
            assert!((steps.value(c, i) - x).abs() <= 1e-11 * x.abs().max(1.0), "{start:?} {c}");
        }
    }
}

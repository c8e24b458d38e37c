//! Elements with a memory: against their differential equations, against closed motions, and where
//! they are known laws.

use core::f64::consts::PI;

use super::*;

/// An element as its equations have it: dz/dt of (z, x, v), torque of (z, v).
struct Written {
    effect: &'static str,
    rate: fn(f64, f64, f64) -> f64,
    torque: fn(f64, f64) -> f64,
}

/// dz/dt of the LuGre element below.
fn lugre_rate(z: f64, v: f64) -> f64 {
    v - v.abs() * z / (0.06 * (1.0 + 0.7 * (-(v / 2.0).powi(2)).exp()))
}

const WRITTEN: [Written; 5] = [
    Written {
        effect: "dahl-friction@joint=4e-4,d=0.05",
        rate: |z, _, v| (v - v.abs() * z) / 0.05,
        torque: |z, _| -4e-4 * z,
    },
    Written { effect: "relaxation@joint=3e-3,T_r=0.15", rate: |z, _, v| v - z / 0.15, torque: |z, _| -3e-3 * z },
    Written {
        effect: "hysteresis@joint=6e-3,b=8,c=0.6",
        rate: |z, _, v| v - 8.0 * (v.abs() * z + 0.6 * v * z.abs()),
        torque: |z, _| -6e-3 * z,
    },
    Written {
        effect: "play@joint=3e-3,b=0.2",
        rate: |z, x, v| if v.signum() * (x - z) > 0.2 { v } else { 0.0 },
        torque: |z, _| -3e-3 * z,
    },
    Written {
        effect: "lugre-friction@joint=8e-3,s1=2e-5,d=0.06,v_s=2,r=0.7",
        rate: |z, _, v| lugre_rate(z, v),
        torque: |z, v| -8e-3 * z - 2e-5 * lugre_rate(z, v),
    },
];

impl Written {
    fn at(&self, joint: &str) -> String {
        self.effect.replacen("joint", joint, 1)
    }

    /// z after a short time, from x and v at its start, middle and end (Runge and Kutta's rule; the
    /// play as its bounds).
    fn next(&self, z: f64, [start, middle, end]: [[f64; 2]; 3], h: f64) -> f64 {
        if self.effect.starts_with("play") {
            return [start, middle, end].iter().fold(z, |z, [x, _]| z.clamp(x - 0.2, x + 0.2));
        }
        let rate = |z: f64, [x, v]: [f64; 2]| (self.rate)(z, x, v);
        let k1 = rate(z, start);
        let k2 = rate(z + 0.5 * h * k1, middle);
        let k3 = rate(z + 0.5 * h * k2, middle);
        let k4 = rate(z + h * k3, end);
        z + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    }
}

/// A free swing over `seconds` in steps of `h`: states and energies.
fn swing_from(start: State, effects: &[&str], h: f64, seconds: f64) -> Vec<(State, f64)> {
    let mut plant = plant(&frictionless(), effects, start);
    let count = (seconds / h).round() as usize;
    (0..count)
        .map(|_| {
            let now = (plant.state(), plant.energy());
            plant.advance(&BaseMotion::REST, h).unwrap();
            now
        })
        .collect()
}

fn swing(effects: &[&str], h: f64, seconds: f64) -> Vec<(State, f64)> {
    swing_from([1.2, 0.9, 0.0, 0.0], effects, h, seconds)
}

/// What the energy loses is the work of the torque, z followed along the motion by small steps.
#[test]
fn every_element_takes_the_work_of_its_law_from_both_arms() {
    let h = 1e-4;
    for law in &WRITTEN {
        for joint in ["joint1", "joint2"] {
            let all = swing_from([0.1, 0.0, 9.0, -12.0], &[&law.at(joint)], h, 2.0);
            let place = |y: &State| if joint == "joint1" { [y[0], y[2]] } else { [y[1] - y[0], y[3] - y[2]] };
            let (mut z, mut work, mut reversals) = (0.0, 0.0, 0);
            let power = |z: f64, [_, v]: [f64; 2]| -(law.torque)(z, v) * v;
            for three in all.windows(3).step_by(2) {
                let at = [0, 1, 2].map(|i| place(&three[i].0));
                let next = law.next(z, at, 2.0 * h);
                work += h * (power(z, at[0]) + power(next, at[2]));
                z = next;
                reversals += u32::from(at[0][1] * at[2][1] < 0.0);
            }
            let lost = all[0].1 - all[(all.len() - 1) / 2 * 2].1;
            assert!(reversals > 2 && lost.abs() > 1e-5, "{}: {reversals} {lost}", law.at(joint));
            assert!((lost - work).abs() < 1e-4 * lost.abs(), "{}: {lost} {work}", law.at(joint));
        }
    }
}

/// A single pendulum by Runge and Kutta's rule in small steps, with its element at joint 1: angle
/// and rate after `seconds`.
fn single_by_small_steps(law: &Written, parameters: &Parameters, start: [f64; 2], seconds: f64) -> [f64; 2] {
    let h = 2e-5;
    let ([mut x, mut v], mut z) = (start, 0.0);
    let bounded = law.effect.starts_with("play");
    for _ in 0..(seconds / h).round() as u32 {
        // The play's z is known from where the step began.
        let z_at = |z: f64, x: f64| if bounded { z.clamp(x - 0.2, x + 0.2) } else { z };
        let rates = |x: f64, v: f64, z: f64| {
            let gravity = -parameters.s1() * parameters.g * x.sin();
            let z_rate = if bounded { 0.0 } else { (law.rate)(z, x, v) };
            [v, (gravity + (law.torque)(z_at(z, x), v)) / parameters.j_o1, z_rate]
        };
        let a = rates(x, v, z);
        let b = rates(x + 0.5 * h * a[0], v + 0.5 * h * a[1], z + 0.5 * h * a[2]);
        let c = rates(x + 0.5 * h * b[0], v + 0.5 * h * b[1], z + 0.5 * h * b[2]);
        let d = rates(x + h * c[0], v + h * c[1], z + h * c[2]);
        let step = [0, 1, 2].map(|i| h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]));
        (x, v) = (x + step[0], v + step[1]);
        z = z_at(z + step[2], x);
    }
    [x, v]
}

#[test]
fn every_element_moves_a_single_pendulum_as_its_equations_do() {
    let parameters = Parameters::single(0.2, 0.05, 2e-3, 0.0, 9.81);
    for law in &WRITTEN {
        for start in [[0.1, 9.0], [-0.15, 13.0]] {
            let want = single_by_small_steps(law, &parameters, start, 2.0);
            let mut plant = plant(&parameters, &[&law.at("joint1")], [start[0], 0.0, start[1], 0.0]);
            for _ in 0..1_000 {
                plant.advance(&BaseMotion::REST, TICK).unwrap();
            }
            let y = plant.state();
            assert!((y[0] - want[0]).abs() < 1e-7 && (y[2] - want[1]).abs() < 1e-6, "{}: {y:?} {want:?}", law.effect);
            assert_eq!((y[1], y[3]), (0.0, 0.0), "{}", law.effect);
        }
    }
}

/// An element in both joints, in ticks and in half ticks at a thousandth of the tolerance.
#[test]
fn half_the_step_gives_the_same_motion() {
    for law in &WRITTEN {
        let effects = [law.at("joint1"), law.at("joint2")];
        let mut coarse = plant(&frictionless(), &effects.each_ref().map(String::as_str), [0.1, 0.0, 6.0, -12.0]);
        let mut fine = coarse.clone();
        fine.tolerance = 1e-14;
        let mut worst = 0.0_f64;
        for _ in 0..1_500 {
            coarse.advance(&BaseMotion::REST, TICK).unwrap();
            for _ in 0..2 {
                fine.advance(&BaseMotion::REST, 0.5 * TICK).unwrap();
            }
            for i in 0..4 {
                worst = worst.max((coarse.state()[i] - fine.state()[i]).abs() / (1.0 + fine.state()[i].abs()));
            }
        }
        assert!(worst < 1e-8, "{}: {worst:e}", law.effect);
    }
}

/// Greatest difference of angles between two free swings.
fn apart(start: State, one: &str, other: &str) -> f64 {
    let [a, b] = [one, other].map(|effect| swing_from(start, &[effect], 0.01, 2.0));
    let differences = a.iter().zip(&b).map(|((a, _), (b, _))| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()));
    differences.fold(0.0, f64::max)
}

#[test]
fn in_their_limits_they_are_known_laws() {
    // From x = 0, so that what a spring shows is what it gained.
    let start = [0.0, 0.0, 6.0, -8.0];
    for joint in ["joint1", "joint2"] {
        let spring = format!("torsion-spring@{joint}=4e-3");
        for (other, within) in [
            ("hysteresis@joint=4e-3,b=0", 1e-9),
            ("hysteresis@joint=4e-3,b=1e-9,c=-0.5", 1e-6),
            ("play@joint=4e-3,b=0", 1e-9),
            ("play@joint=4e-3,b=1e-8", 1e-6),
            ("relaxation@joint=4e-3,T_r=1e6", 1e-4),
        ] {
            let other = other.replacen("joint", joint, 1);
            let difference = apart(start, &spring, &other);
            assert!(difference < within, "{other}: {difference:e}");
        }
        for (one, other, within) in [
            ("dahl-friction@joint=4e-4,d=0.05", "lugre-friction@joint=8e-3,d=0.05,r=0", 1e-8),
            ("dahl-friction@joint=4e-4,d=0.05", "hysteresis@joint=8e-3,b=20,c=0", 1e-10),
            // A spring that gives way at once is viscous friction k T.
            ("viscous-friction@joint=1e-5", "relaxation@joint=0.1,T_r=1e-4", 1e-3),
        ] {
            let [one, other] = [one, other].map(|effect| effect.replacen("joint", joint, 1));
            let difference = apart(start, &one, &other);
            assert!(difference < within, "{other}: {difference:e}");
        }
    }
    // Where the elements do something at all.
    assert!(apart(start, "relaxation@joint1=4e-3", "torsion-spring@joint1=4e-3") > 0.1);
    assert!(apart(start, "viscous-friction@joint2=1e-5", "viscous-friction@joint2=0") > 0.1);
}

/// One arm without gravity, J = 2e-3 kg m².
fn floating(effect: &str, start: [f64; 2]) -> Plant {
    let parameters = Parameters::single(0.2, 0.05, 2e-3, 0.0, 0.0);
    plant(&parameters, &[effect], [start[0], 0.0, start[1], 0.0])
}

/// J θ″ = −k z, z′ = θ′ − z/T, so that z″ + z′/T + (k/J) z = 0 and θ = θ₀ + z + ∫ z dt/T, through
/// many turns.
#[test]
fn a_spring_behind_a_damper_follows_its_closed_motion() {
    let (k, time, j, v) = (0.02_f64, 0.4, 2e-3, 60.0);
    let decay = 0.5 / time;
    let omega = (k / j - decay * decay).sqrt();
    let mut plant = floating("relaxation@joint1=0.02,T_r=0.4", [0.7, v]);
    for tick in 1..=2_000 {
        plant.advance(&BaseMotion::REST, TICK).unwrap();
        let t = f64::from(tick) * TICK;
        let (sin, cos) = (omega * t).sin_cos();
        let z = v / omega * (-decay * t).exp() * sin;
        let integral = v / omega * (omega - (-decay * t).exp() * (decay * sin + omega * cos)) / (k / j);
        let want = 0.7 + z + integral / time;
        assert!((plant.state()[0] - want).abs() < 1e-8 * want, "{t}: {} {want}", plant.state()[0]);
    }
    assert!(plant.state()[0] > 4.0 * PI);
}

/// Free through the play, then an oscillator about its edge, wound up over several turns; back
/// through the play under the torque that z keeps.
#[test]
fn play_winds_up_over_whole_turns() {
    let (k, b, j, v) = (0.02_f64, 0.5, 2e-3, 60.0);
    let omega = (k / j).sqrt();
    let mut plant = floating("play@joint1=0.02,b=0.5", [0.0, v]);
    let (free, turn) = (b / v, b / v + 0.5 * PI / omega);
    let z = v / omega;
    // The torque −k z through 2 b.
    let back = turn + (4.0 * b * j / (k * z)).sqrt();
    assert!(z > 2.0 * 2.0 * PI);
    for tick in 1..=1_000 {
        plant.advance(&BaseMotion::REST, TICK).unwrap();
        let t = f64::from(tick) * TICK;
        let want = if t < free {
            v * t
        } else if t < turn {
            b + z * (omega * (t - free)).sin()
        } else if t < back {
            b + z - 0.5 * k * z / j * (t - turn).powi(2)
        } else {
            let rate = k * z / j * (back - turn);
            // z follows x + b: an oscillator about −b.
            let since = omega * (t - back);
            -b + z * since.cos() - rate / omega * since.sin()
        };
        if t < back + 0.4 {
            assert!((plant.state()[0] - want).abs() < 1e-8 * z, "{t}: {} {want}", plant.state()[0]);
        }
    }
}

/// With a presliding distance far below the motion it is Coulomb's friction; whole turns do not
/// matter.
#[test]
fn a_short_presliding_distance_is_coulombs_friction() {
    let coulomb = swing(&["coulomb-friction@joint2=2e-4"], 0.01, 1.0);
    let dahl = swing(&["dahl-friction@joint2=2e-4,d=1e-5"], 0.01, 1.0);
    for ((a, _), (b, _)) in coulomb.iter().zip(&dahl) {
        assert!((a[1] - b[1]).abs() < 2e-3, "{a:?} {b:?}");
    }
    for law in &WRITTEN {
        let turned = |turns: f64| {
            let start = [0.3 + turns * core::f64::consts::TAU, 0.1, 40.0, -3.0];
            let mut plant = plant(&frictionless(), &[&law.at("joint1")], start);
            plant.advance(&BaseMotion::REST, 0.5).unwrap();
            plant.state()
        };
        let (a, b) = (turned(0.0), turned(3.0));
        assert!((a[2] - b[2]).abs() + (a[3] - b[3]).abs() < 1e-5, "{}: {a:?} {b:?}", law.effect);
    }
}

#[test]
fn a_driven_rig_bears_them_all_beside_friction_that_sticks() {
    let laws: [Vec<String>; 2] =
        ["joint1", "joint2"].map(|joint| WRITTEN[1..].iter().map(|law| law.at(joint)).collect());
    let mut effects: Vec<&str> = laws.iter().flatten().map(String::as_str).collect();
    effects.extend(["coulomb-friction@joint1=5e-3", "coulomb-friction@joint2=1e-3"]);
    let mut plant = plant(&Parameters::PRINTED, &effects, [0.3, 2.0, 0.0, 0.0]);
    let mut drive = Drive::new(0.0155);
    let mut sticks = 0;
    for tick in 0..2_000 {
        plant.advance(&drive.next(), TICK).unwrap_or_else(|e| panic!("tick {tick}: {e}"));
        sticks += u32::from(plant.friction().contains(&Some(Dry::Stick)));
    }
    assert!(sticks > 20, "{sticks}");
}

/// A joint that is held gives way when what its relaxing spring leaves of the pull exceeds the
/// friction.
#[test]
fn a_held_joint_is_released_by_a_spring_that_relaxes() {
    // The pull of gravity at 0.3 rad is 0.029 N m; the spring holds against it with k z exp(−t/T).
    let parameters = Parameters { tau_c1: 0.02, ..Parameters::single(0.2, 0.05, 2e-3, 0.0, 9.81) };
    let mut plant = plant(&parameters, &["relaxation@joint1=0.5,T_r=0.5"], [0.3, 0.0, 0.0, 0.0]);
    plant.mode.since[0].states[0] = -0.05;
    plant.settle_contacts(&BaseMotion::REST);
    let pull = parameters.s1() * parameters.g * f64::sin(0.3);
    let release = 0.5 * (0.5 * 0.05 / (pull - 0.02)).ln();
    assert!((0.1..2.0).contains(&release));
    for (after, moves) in [(release - 1e-6, false), (2e-3, true)] {
        plant.advance(&BaseMotion::REST, after).unwrap();
        assert_eq!(plant.state()[0] != 0.3, moves, "{:?}", plant.state());
    }
}

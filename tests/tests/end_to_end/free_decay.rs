//! Swings that die: nothing drives them, and their laws of damping differ only in how fast the swing
//! shrinks at which size. The plant is written out here.

use std::fmt::Write;
use std::path::Path;

use super::program::{done, json};

/// A pendulum let go at rest: θ̈ = −ω² sin θ − c θ̇ − d θ̇|θ̇| − τ sign θ̇, held where gravity does not
/// overcome τ; with noise on what is seen.
#[derive(Clone, Copy)]
struct Swing {
    omega_squared: f64,
    c: f64,
    d: f64,
    tau: f64,
    from: f64,
    noise: f64,
    /// Of the noise.
    seed: u32,
}

impl Swing {
    /// So many seconds at 100 Hz, in degrees.
    fn write(&self, path: &Path, seconds: usize) {
        let acceleration = |x: f64, v: f64, sign: f64| {
            -self.omega_squared * x.sin() - self.c * v - self.d * v * v.abs() - self.tau * sign
        };
        let (mut x, mut v, mut held) = (self.from, 0.0_f64, false);
        let mut sign = -self.from.signum();
        let mut seed = self.seed;
        let mut uniform = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
        };
        let mut text = "t,angle_deg\n".to_owned();
        let h = 1e-5;
        for i in 0..100 * seconds {
            let noise = self.noise * (0..12).map(|_| uniform()).sum::<f64>();
            writeln!(text, "{:.2},{:.4}", i as f64 / 100.0, (x + noise).to_degrees()).unwrap();
            for _ in 0..1000 {
                if held {
                    break;
                }
                // The midpoint rule, whose error goes with (ω h)², at most 5e-9.
                let half = v + 0.5 * h * acceleration(x, v, sign);
                let middle = acceleration(x + 0.5 * h * v, half, sign);
                (x, v) = (x + h * half, v + h * middle);
                if v * sign < 0.0 {
                    let pull = -self.omega_squared * x.sin();
                    held = pull.abs() <= self.tau;
                    (v, sign) = (0.0, pull.signum());
                }
            }
        }
        std::fs::write(path, text).unwrap();
    }
}

const RIG: &str = "name = \"swing\"\nmodel = \"single-pendulum\"\n[[channel]]\nname = \"angle_deg\"\nmeasures = \"theta1\"\nunit = \"deg\"\n";

/// What is found in such a swing: verdict, and effects with value and standard error.
fn explained(at: &Path, swing: &Swing, seconds: usize) -> (String, Vec<(String, f64, f64)>) {
    swing.write(&at.join("swing.csv"), seconds);
    std::fs::write(at.join("rig.toml"), RIG).unwrap();
    done(at, "explain swing.csv --rig rig.toml --json e.json --force");
    let e = json(&at.join("e.json"));
    let number = |x: &serde_json::Value| x.as_f64().unwrap();
    let effects = e["effects"].as_array().unwrap().iter();
    let of =
        |f: &serde_json::Value| (f["id"].as_str().unwrap().to_owned(), number(&f["value"]), number(&f["std_error"]));
    (e["verdict"].as_str().unwrap().to_owned(), effects.map(of).collect())
}

/// It comes to rest within the record; what friction holds there is no motion.
#[test]
fn friction_and_drag_of_a_swing_that_comes_to_rest_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let swing = Swing { omega_squared: 46.0, c: 0.006, d: 0.03, tau: 0.28, from: 2.4, noise: 3e-4, seed: 9 };
    let (verdict, effects) = explained(folder.path(), &swing, 50);
    assert_eq!(verdict, "explained", "{effects:?}");
    for (id, truth) in [("coulomb-friction", swing.tau), ("quadratic-drag", swing.d)] {
        let Some((_, value, error)) = effects.iter().find(|e| e.0 == id) else { panic!("{effects:?}") };
        assert!((value - truth).abs() < 3.0 * error, "{id}: {value} ± {error}");
    }
    assert_eq!(effects.len(), 2, "{effects:?}");
}

/// A small swing whose friction no window by itself tells from a viscous one.
#[test]
fn what_shows_only_over_the_whole_swing_is_not_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let swing = Swing { omega_squared: 11.3, c: 0.0095, d: 0.03, tau: 0.034, from: 0.53, noise: 6.6e-4, seed: 9 };
    let (verdict, effects) = explained(folder.path(), &swing, 20);
    assert!(verdict == "unexplained" || !effects.is_empty(), "{verdict} {effects:?}");
    // With viscous friction alone nothing is missing.
    let viscous = Swing { c: 0.076, d: 0.0, tau: 0.0, ..swing };
    assert_eq!(explained(folder.path(), &viscous, 20), ("nothing-missing".to_owned(), Vec::new()));
}

/// Faint laws that stand some thirty standard errors from nothing by the bound of Cramér and Rao
/// over the whole swing, and within two over a tenth of it.
#[test]
fn faint_frictions_of_a_whole_swing_are_named() {
    // One record of several names another law and lists the right one as not told apart.
    let plain = Swing { omega_squared: 30.0, c: 0.05, d: 0.0, tau: 0.0, from: 1.0, noise: 1e-3, seed: 1 };
    let hidden = [
        ("quadratic-drag", Swing { d: 1e-3, ..plain }, 1e-3),
        ("coulomb-friction", Swing { tau: 0.01, ..plain }, 0.01),
    ];
    for (id, swing, truth) in hidden {
        let folder = tempfile::tempdir().unwrap();
        let (verdict, effects) = explained(folder.path(), &swing, 24);
        let [(found, value, error)] = &effects[..] else { panic!("{id}: {verdict} {effects:?}") };
        assert_eq!((verdict.as_str(), found.as_str()), ("explained", id));
        assert!((value - truth).abs() < 3.0 * error && *error < 0.06 * truth, "{id}: {value} ± {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(explained(folder.path(), &plain, 24), ("nothing-missing".to_owned(), Vec::new()));
}

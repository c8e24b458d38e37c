//! A mass on a hardening spring under a measured force, integrated here: forces in steps, forces held
//! from each sample to the next, and a spring behind a damper that the equations lack.

use std::fmt::Write;
use std::path::Path;

use serde_json::Value;

use super::program::{done, json};

const MODEL: &str = r#"name = "isolator"
coordinates = [{ name = "x", space = "R" }]
inputs = ["f"]
[[equation]]
balance = "f"
terms = { m = "x''", c = "x'", k = "x", k3 = "x^3" }
"#;

const M: f64 = 2.0;
const C: f64 = 3.0;
const K: f64 = 800.0;
const K3: f64 = 2e5;
/// Steps of the integration to a sample.
const STEPS: u32 = 20;

/// Numbers between −1 and 1.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        2.0 * f64::from(self.0 >> 8) / f64::from(1 << 24) - 1.0
    }
}

/// Writes a record of the isolator under a force by time, held or not, with the strength and the time
/// of a relaxation; noise of 5 µm and 1 mN.
fn record(at: &Path, rate: u32, seconds: u32, force: impl Fn(f64) -> f64, [relaxation, settles]: [f64; 2]) {
    std::fs::write(at.join("isolator.toml"), MODEL).unwrap();
    let channel = |name: &str, unit: &str| format!("{{ name = \"{name}\", measures = \"{name}\", unit = \"{unit}\" }}");
    let channels = [channel("x", "m"), channel("f", "N")].join(", ");
    let rig =
        format!("name = \"isolator\"\nmodel = \"isolator.toml\"\nsample_rate_hz = {rate}.0\nchannel = [{channels}]\n");
    std::fs::write(at.join("rig.toml"), rig).unwrap();
    let (dt, mut random) = (1.0 / f64::from(rate), Random(7));
    let h = dt / f64::from(STEPS);
    let mut y = [0.0_f64; 3];
    let mut text = String::from("t,x,f\n");
    for i in 0..rate * seconds {
        let t = f64::from(i) * dt;
        // Uniform noise.
        let (x, f) = (y[0] + 8.7e-6 * random.next(), force(t) + 1.7e-3 * random.next());
        writeln!(text, "{t:.4},{x:.6},{f:.4}").unwrap();
        for k in 0..STEPS {
            // A force that jumps at a sample is what it is within the step.
            let middle = t + (f64::from(k) + 0.5) * h;
            let of = |share: f64| force(middle + (share - 0.5) * h * (1.0 - 1e-4));
            let rates = |f: f64, y: [f64; 3]| {
                let spring = K * y[0] + K3 * y[0].powi(3) + relaxation * y[2];
                [y[1], (f - C * y[1] - spring) / M, y[1] - y[2] / settles]
            };
            let ahead = |y: [f64; 3], by: f64, r: [f64; 3]| [y[0] + by * r[0], y[1] + by * r[1], y[2] + by * r[2]];
            let a = rates(of(0.0), y);
            let b = rates(of(0.5), ahead(y, 0.5 * h, a));
            let c = rates(of(0.5), ahead(y, 0.5 * h, b));
            let d = rates(of(1.0), ahead(y, h, c));
            for (n, y) in y.iter_mut().enumerate() {
                *y += h / 6.0 * (a[n] + 2.0 * b[n] + 2.0 * c[n] + d[n]);
            }
        }
    }
    std::fs::write(at.join("r.csv"), text).unwrap();
}

fn tones(t: f64) -> f64 {
    let all = [(4.0, 0.71, 0.2), (3.5, 1.93, 1.1), (3.0, 2.87, 2.3), (2.5, 3.71, 0.7), (2.0, 5.13, 4.0)];
    all.iter().map(|(a, f, p)| a * (std::f64::consts::TAU * f * t + p).sin()).sum()
}

fn explained(at: &Path) -> Value {
    done(at, "explain r.csv --rig rig.toml --json e.json");
    json(&at.join("e.json"))
}

/// Every parameter within four standard errors.
fn parameters_are_right(e: &Value) {
    for (name, truth) in [("m", M), ("c", C), ("k", K), ("k3", K3)] {
        let p = e["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * error, "{name}: {value} ± {error}");
    }
}

/// Half a sample early, as a signal without jumps would be, it had been a delay, a relaxation and a
/// damping that grows.
#[test]
fn a_force_in_steps_acts_as_it_is_held() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut random = Random(3);
    let levels: Vec<f64> = (0..240).map(|_| 10.0 * random.next()).collect();
    record(at, 200, 60, |t| levels[(t / 0.25 + 1e-9) as usize % levels.len()], [0.0, 1.0]);
    let e = explained(at);
    assert_eq!(e["verdict"], "nothing-missing", "{} {}", e["reason"], e["effects"]);
    parameters_are_right(&e);
}

#[test]
fn an_output_that_is_held_from_each_sample_to_the_next_is_told_and_taken_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    record(at, 200, 60, |t| tones((t * 200.0 + 1e-7).floor() / 200.0), [0.0, 1.0]);
    let e = explained(at);
    assert_eq!(e["verdict"], "nothing-missing", "{} {}", e["reason"], e["effects"]);
    let told = e["warnings"].as_array().unwrap().iter().find(|w| w["id"] == "input-held").unwrap();
    assert_eq!(told["channel"], "f", "{told}");
    parameters_are_right(&e);
}

/// Its state had been followed along straight lines of the rate, and a scale error of the sensor
/// made up for what these miss.
#[test]
fn a_relaxation_at_a_hundred_hertz_comes_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    record(at, 100, 60, tones, [60.0, 0.3]);
    let e = explained(at);
    let names: Vec<&str> = e["effects"].as_array().unwrap().iter().map(|f| f["id"].as_str().unwrap()).collect();
    assert_eq!((e["verdict"].as_str(), &names[..]), (Some("explained"), &["relaxation"][..]), "{}", e["reason"]);
    let f = &e["effects"][0];
    let (value, error) = (f["value"].as_f64().unwrap(), f["std_error"].as_f64().unwrap());
    assert!((value - 60.0).abs() < 4.0 * error && error < 1.0, "{value} ± {error}");
}

//! Commands as functions: a CSV as a lab's own program writes it, `init`, `identify`, and the
//! answer for people and as JSON.
//!
//! `cargo run --release -p whirl-cli --example own_file_to_answer`

use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::Path;

use whirl::api::{self, Called, Error};

/// Calls a command with the words that would stand behind `whirl`.
fn call(words: &str) -> Result<Called, Error> {
    let words: Vec<OsString> = words.split_whitespace().map(OsString::from).collect();
    api::call(&words)
}

/// A pendulum that swings freely from 2 rad, θ″ = −45 sin θ − 0.05 θ′, in steps of 0.1 ms, written
/// every 2 ms.
fn record() -> String {
    let (mut angle, mut rate, h) = (2.0_f64, 0.0_f64, 1e-4);
    let acceleration = |angle: f64, rate: f64| -45.0 * angle.sin() - 0.05 * rate;
    let mut text = "time (ms);Angle (deg)\n".to_owned();
    for i in 0..8000 {
        // Writing into memory cannot fail.
        let _ = writeln!(text, "{};{:.4}", 2 * i, angle.to_degrees());
        for _ in 0..20 {
            let middle = (angle + 0.5 * h * rate, rate + 0.5 * h * acceleration(angle, rate));
            (angle, rate) = (angle + h * middle.1, rate + h * acceleration(middle.0, middle.1));
        }
    }
    text
}

fn run(folder: &Path) -> Result<String, Box<dyn std::error::Error>> {
    let (csv, rig) = (folder.join("run.csv"), folder.join("rig.toml"));
    std::fs::write(&csv, record())?;
    // What it took each column for, and why.
    println!("{}", call(&format!("init {} -o {}", csv.display(), rig.display()))?.said.text);
    let answer = call(&format!("identify {} --rig {}", csv.display(), rig.display()))?;
    println!("{}", answer.said.text);
    // The same without computing again, as a page for a browser.
    let page = folder.join("identify.html");
    answer.write(&["--report".into(), page.clone().into()])?;
    println!("{} kB of report", std::fs::metadata(&page)?.len() / 1000);
    answer.said.json.ok_or_else(|| "identify gives JSON".into())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join(format!("whirl-example-own-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let json = run(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    println!("{} characters of JSON", json?.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    /// q_sin is g over the pendulum's length, 45 s⁻².
    #[test]
    fn it_finds_the_pendulum() {
        let folder = tempfile::tempdir().unwrap();
        let json: serde_json::Value = serde_json::from_str(&super::run(folder.path()).unwrap()).unwrap();
        let all = json["parameters"].as_array().unwrap();
        let found = all.iter().find(|p| p["name"] == "q_sin").unwrap()["value"].as_f64().unwrap();
        assert!((found / 45.0 - 1.0).abs() < 2e-3, "{found}");
        super::main().unwrap();
    }
}

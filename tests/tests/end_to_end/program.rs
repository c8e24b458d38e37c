//! Running the program.

use std::path::Path;
use std::process::{Command, Output};

use whirl_tests::repository;

/// The program, not yet started.
pub fn command() -> Command {
    Command::new(env!("CARGO_BIN_EXE_whirl-under-test"))
}

/// What a run gave.
#[derive(Debug)]
pub struct Run {
    /// Exit status.
    pub status: i32,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl From<Output> for Run {
    fn from(output: Output) -> Self {
        Self {
            status: output.status.code().expect("no signal ended the program"),
            stdout: String::from_utf8(output.stdout).expect("UTF-8"),
            stderr: without_progress(&String::from_utf8(output.stderr).expect("UTF-8")),
        }
    }
}

/// What is told but for how far long work has come, which depends on the machine.
fn without_progress(stderr: &str) -> String {
    let seconds = |line: &str| Some(line.strip_suffix(" s)")?.rsplit_once('(')?.1.parse::<u64>().is_ok());
    stderr.split_inclusive('\n').filter(|line| !seconds(line.trim_end()).unwrap_or(false)).collect()
}

/// Runs the program in a folder; arguments are split at blanks.
pub fn whirl(folder: &Path, arguments: &str) -> Run {
    command().current_dir(folder).args(arguments.split_whitespace()).output().expect("the program starts").into()
}

/// As [`whirl`], and it must end with status 0; its standard output.
pub fn done(folder: &Path, arguments: &str) -> String {
    let run = whirl(folder, arguments);
    assert_eq!(run.status, 0, "{arguments}: {run:?}");
    run.stdout
}

/// A JSON file.
pub fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("a JSON file")).expect("JSON")
}

/// Holds identified parameters against what they are: within five standard errors, which are 0.02 %
/// of it at most.
pub fn are(found: &serde_json::Value, truth: &[(&str, f64)]) {
    for (name, truth) in truth {
        let p = found["parameters"].as_array().unwrap().iter().find(|p| p["name"] == *name).unwrap();
        let (value, error) = (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap());
        assert!((value - truth).abs() < 5.0 * error, "{name}: {value} ± {error}");
        assert!(error < 2e-4 * truth.abs(), "{name}: {value} ± {error}");
    }
}

/// Copies a shipped rig file, with replacements, into a folder.
pub fn rig_file(folder: &Path, shipped: &str, name: &str, replacements: &[(&str, &str)]) {
    let mut text = std::fs::read_to_string(repository("rigs").join(shipped)).expect("a shipped rig file");
    for (from, to) in replacements {
        assert!(text.contains(from), "{shipped} has no {from}");
        text = text.replace(from, to);
    }
    std::fs::write(folder.join(name), text).expect("a rig file");
}

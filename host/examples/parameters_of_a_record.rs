//! The library's own types: a rig file, a record, an identification, each parameter with its 95 %
//! interval.
//!
//! `cargo run --release -p whirl-cli --example parameters_of_a_record [RECORD RIG.toml]`; without
//! arguments it takes a record of the shipped rig that it simulates first.

use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use whirl::error::Result;
use whirl::identify::{self, Settings};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl::simulate;

fn run(record: &Path, rig: &Rig) -> Result<usize> {
    let record = Record::read(record, rig, &ReadOptions::default())?;
    println!("{} samples at {} Hz, {} missing", record.samples(), record.sample_rate_hz, record.losses.lost());
    let found = identify::weak_form(&[record], rig, &Settings::default())?;
    for p in &found.parameters {
        println!("{:>6} = {:.6} ± {:.6} {}", p.name, p.value, 1.96 * p.std_error, p.unit);
    }
    for warning in &found.warnings {
        println!("{}. {}", warning.text, warning.advice);
    }
    Ok(found.parameters.len())
}

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    if let [record, rig] = &arguments[..] {
        return run(record, &Rig::read(rig)?).map(drop);
    }
    let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml"))?;
    let record = std::env::temp_dir().join(format!("whirl-example-{}.parquet", std::process::id()));
    simulate::record(&rig, &[], 24.0, 1, &record, &ProgressBar::hidden())?;
    let done = run(&record, &rig);
    // A leftover in the temporary folder is no reason to fail.
    let _ = std::fs::remove_file(&record);
    done.map(drop)
}

#[cfg(test)]
mod tests {
    #[test]
    fn it_runs() {
        super::main().unwrap();
    }
}

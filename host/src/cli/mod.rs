//! Commands: one file each, each with its arguments and `run()`; one line each in the enum `Command`.
//!
//! Exit status: 0 done; 1 done and the answer is negative; 2 bad input or usage, with one message on standard error.

mod capture;
mod completions;
mod demo;
mod device;
mod device_list;
mod device_set;
mod explain;
mod export;
mod flash;
mod flash_image;
mod identify;
mod identify_balance;
mod inspect;
mod list;
mod man;
pub mod output;
mod outputs;
pub mod progress;
mod reduce;
#[cfg(feature = "sim")]
mod reproduce;
mod simulate;
mod simulate_model;
mod validate;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::error::{BadInput, Result, tell};
use crate::record::Record;
use crate::record::cut::Part;
use crate::record::formats::ReadOptions;
use crate::rig::Rig;
use crate::warning::Warning;
use output::{Output, Replace};
use outputs::Outputs;

/// From encoder counts to a trusted equation of motion, and to the physical effect that the model is missing.
#[derive(Debug, Parser)]
#[command(name = "whirl", version, about, max_term_width = 110, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to use (0: one for each core). Results do not depend on it.
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// No progress bars.
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The whole line with nothing plugged in: simulated rig, firmware logic, frames, capture, identification, one report.
    Demo(demo::Arguments),
    /// A record of a simulated rig, with effects put in if asked, or of an identified model.
    Simulate(simulate::Arguments),
    /// Records from a rig, surviving unplugging, accounting for every sample.
    Capture(capture::Arguments),
    /// Rates, losses, spectra, phase portraits, periodicity of a record.
    Inspect(inspect::Arguments),
    /// Parameters with standard errors.
    Identify(identify::Arguments),
    /// Whether an identified model moves as the measured system does.
    Validate(validate::Arguments),
    /// Where simulation and measurement disagree, which effect is missing, the gap before and after.
    Explain(explain::Arguments),
    /// An identified model as readable code, with its units, parameters and effects.
    Export(export::Arguments),
    /// Ports and boards; a board's settings, kept in its flash; its zero.
    Device(device::Arguments),
    /// Builds a board's firmware and flashes it through a debug probe.
    Flash(flash::Arguments),
    /// Modes, a reduced-order model, its frequency–energy curve.
    Reduce(reduce::Arguments),
    /// The dissertation's tables and figures: printed, reproduced, true, side by side.
    #[cfg(feature = "sim")]
    Reproduce(reproduce::Arguments),
    /// What can be chosen: models, effects, boards, methods.
    List(list::Arguments),
    /// Completions for a shell.
    Completions(completions::Arguments),
    /// Manual pages.
    Man(man::Arguments),
}

/// Whether a command's answer is positive (exit status 0) or negative (1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Done.
    Positive,
    /// Done, and the answer is negative.
    Negative,
}

impl Answer {
    /// The negative answer, said with its reason, where a warning says that the answer cannot stand.
    fn that_stands(warnings: &[Warning]) -> Self {
        let reasons: Vec<&str> = warnings.iter().filter(|w| w.invalidates).map(|w| w.id).collect();
        if reasons.is_empty() {
            return Self::Positive;
        }
        tell(format_args!("this answer cannot stand: {} (see the warnings)", reasons.join(", ")));
        Self::Negative
    }

    /// Positive where both are.
    fn and(self, other: Self) -> Self {
        if self == Self::Positive { other } else { self }
    }
}

/// Records and the rig that they belong to: what most commands begin with.
#[derive(Clone, Debug, Args)]
struct Records {
    /// Records: whirl's Parquet, CSV (also gzipped) with a header row and a column t in seconds, NumPy's .npz, MATLAB's .mat.
    #[arg(required = true, value_name = "REC")]
    records: Vec<PathBuf>,
    /// Rig file.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Read what is whole of a truncated or damaged file; the rest is a gap.
    #[arg(long)]
    recover: bool,
    /// Make an uneven clock even, by cubics between the samples.
    #[arg(long)]
    resample: bool,
    /// Use the record from this time of its own t on, s.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Use the record up to this time of its own t, s.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to: Option<f64>,
    /// Exit with status 1 where samples are missing.
    #[arg(long)]
    strict: bool,
}

impl Records {
    /// Which part of each record is used.
    fn part(&self) -> Part {
        Part { from_s: self.from, to_s: self.to }
    }

    /// The rig, and what the command reads and writes as far as the options of all commands say.
    fn begin(&self, out: &Output, replace: Option<Replace>) -> Result<(Rig, Outputs)> {
        let rig = Rig::read(&self.rig)?;
        let files = Outputs::of(out, replace).reads(&self.records).reads_rig(&rig);
        Ok((rig, files))
    }

    /// Reads the records.
    fn read_for(&self, rig: &Rig) -> Result<Vec<Record>> {
        let (options, part) = (self.options(), self.part());
        part.validate()?;
        let read = |path: &PathBuf| {
            let mut record = Record::read(path, rig, &options)?;
            record.cut(&part).map(|()| record)
        };
        self.records.iter().map(read).collect()
    }

    /// How they are read.
    fn options(&self) -> ReadOptions {
        ReadOptions { recover: self.recover, resample: self.resample }
    }

    /// What an analysis ends with that failed: where the record itself is at fault, its warnings say why, and the answer is negative.
    fn failed(&self, records: &[Record], error: BadInput, out: &Output) -> Result<Answer> {
        let warnings: Vec<Warning> = records.iter().flat_map(|r| r.warnings.clone()).collect();
        if !warnings.iter().any(|w| w.invalidates) {
            return Err(error);
        }
        output::print_warnings(&warnings);
        out.write_json(&serde_json::json!({ "parameters": [], "warnings": warnings, "error": error.to_string() }))?;
        tell(error);
        Ok(Answer::that_stands(&warnings))
    }

    /// The answer for complete records, or the negative one under `--strict` where samples are missing.
    fn answer(&self, records: &[Record]) -> Answer {
        self.answer_for(records.iter().map(|r| r.losses.lost()).sum())
    }

    /// The same for so many missing samples.
    fn answer_for(&self, lost: u64) -> Answer {
        if self.strict && lost > 0 {
            tell_missing(lost);
            return Answer::Negative;
        }
        Answer::Positive
    }
}

/// Says that samples are missing where none may.
fn tell_missing(lost: u64) {
    let (samples, are) = if lost == 1 { ("sample", "is") } else { ("samples", "are") };
    tell(format_args!("{lost} {samples} {are} missing (--strict)"));
}

/// Parses, runs, reports.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    progress::set_quiet(cli.quiet);
    match run(cli).and_then(|answer| output::all_said().map(|()| answer)) {
        Ok(Answer::Positive) => ExitCode::SUCCESS,
        Ok(Answer::Negative) => ExitCode::from(1),
        Err(error) => {
            // Whatever was printed so far comes first.
            let _ = std::io::stdout().flush();
            tell(error);
            ExitCode::from(2)
        }
    }
}

fn run(cli: Cli) -> Result<Answer> {
    if cli.threads > 1024 {
        return Err(BadInput::new(cli.threads.to_string(), "at most 1024").at("--threads"));
    }
    if cli.threads > 0 {
        rayon::ThreadPoolBuilder::new()
            .num_threads(cli.threads)
            .build_global()
            .map_err(|e| BadInput::new(e.to_string(), "threads to work with").at("--threads"))?;
    }
    match cli.command {
        Command::Demo(a) => demo::run(&a),
        Command::Simulate(a) => simulate::run(&a),
        Command::Capture(a) => capture::run(&a),
        Command::Inspect(a) => inspect::run(&a),
        Command::Identify(a) => identify::run(&a),
        Command::Validate(a) => validate::run(&a),
        Command::Explain(a) => explain::run(&a),
        Command::Export(a) => export::run(&a),
        Command::Device(a) => device::run(&a),
        Command::Flash(a) => flash::run(&a),
        Command::Reduce(a) => reduce::run(&a),
        #[cfg(feature = "sim")]
        Command::Reproduce(a) => reproduce::run(&a),
        Command::List(a) => list::run(&a),
        Command::Completions(a) => completions::run(&a),
        Command::Man(a) => man::run(&a),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn no_command_has_two_options_of_one_name() {
        super::Cli::command().debug_assert();
    }
}

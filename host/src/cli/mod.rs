//! Commands: one file each, each with its arguments and `run()`; one line each in the enum
//! `Command`.
//!
//! Exit status: 0 done; 1 done and the answer is negative; 2 bad input or usage, with one message
//! on standard error.

mod batch;
pub(crate) mod called;
mod capture;
mod capture_plan;
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
mod init;
mod inspect;
mod list;
mod man;
mod numbers;
pub mod output;
mod outputs;
mod plan;
pub mod progress;
mod reduce;
mod reproduce;
mod simulate;
mod simulate_model;
mod single;
mod usage;
mod validate;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{ArgMatches, Args, CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::error::{BadInput, Result, tell};
use crate::record::Record;
use crate::record::cut::Part;
use crate::record::formats::ReadOptions;
use crate::record::names::{TimeChoice, own_time};
use crate::rig::Rig;
use crate::rig::choices::{self, Choices};
use crate::warning::Warning;
use crate::wording::names::inside;
use output::{Output, Replace};
use outputs::Outputs;

/// From encoder counts to a trusted equation of motion, and to the physical effect that the model
/// is missing.
#[derive(Debug, Parser)]
#[command(name = "whirl", version, about, max_term_width = 110, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to use (0: one for each core). Results do not depend on it.
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    threads: usize,
    /// No progress, neither bars nor lines.
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The whole line with nothing plugged in: simulated rig, firmware logic, frames, capture,
    /// identification, one report.
    Demo(demo::Arguments),
    /// A record of a simulated rig, with effects put in if asked, or of an identified model.
    Simulate(simulate::Arguments),
    /// Records from a rig, surviving unplugging, accounting for every sample.
    Capture(capture::Arguments),
    /// A commented rig file from what a record shows: columns, units, rate, resolution, drive.
    Init(init::Arguments),
    /// Rates, losses, spectra, phase portraits, periodicity of a record.
    Inspect(inspect::Arguments),
    /// Parameters with standard errors.
    Identify(identify::Arguments),
    /// Whether an identified model moves as the measured system does.
    Validate(validate::Arguments),
    /// Where simulation and measurement disagree, which effect is missing, the gap before and
    /// after.
    Explain(explain::Arguments),
    /// Many records, one row each, in one table.
    #[command(subcommand)]
    Batch(Box<batch::What>),
    /// An identified model as readable code, with its units, parameters and effects.
    Export(export::Arguments),
    /// Ports and boards; a board's settings, kept in its flash; its zero.
    Device(device::Arguments),
    /// Builds a board's firmware and flashes it through a debug probe.
    Flash(flash::Arguments),
    /// The next experiment: what to set, how long, and what it will tell.
    Plan(plan::Arguments),
    /// Modes, a reduced-order model, its frequency–energy curve.
    Reduce(reduce::Arguments),
    /// The dissertation's tables and figures: printed, reproduced, true, side by side.
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
    /// The negative answer, said with its reason, where a warning says that the answer cannot
    /// stand.
    fn that_stands(warnings: &[Warning]) -> Self {
        Judgement::of(warnings).tell()
    }

    /// Positive where both are.
    fn and(self, other: Self) -> Self {
        if self == Self::Positive { other } else { self }
    }
}

/// Whether an answer is negative, and what is said where it is, not yet said.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Judgement {
    negative: bool,
    reasons: Vec<String>,
}

impl Judgement {
    /// Negative, for a reason that the answer itself may give already.
    fn negative(reason: Option<String>) -> Self {
        Self { negative: true, reasons: reason.into_iter().collect() }
    }

    /// Negative where a warning says that the answer cannot stand.
    fn of(warnings: &[Warning]) -> Self {
        // The first words of each, up to the end of a sentence: all of them stand in the warning.
        let words = |w: &Warning| match w.text.split(". ").flat_map(|part| part.split([':', ';'])).next() {
            Some(words) if words.contains(' ') => inside(words.trim_end_matches('.')),
            _ => inside(&w.text),
        };
        let reasons: Vec<String> = warnings.iter().filter(|w| w.invalidates).map(words).collect();
        if reasons.is_empty() {
            return Self::default();
        }
        Self::negative(Some(format!("this answer cannot stand: {} (see the warnings)", reasons.join("; "))))
    }

    /// Negative where either is.
    fn and(mut self, other: Self) -> Self {
        self.negative |= other.negative;
        self.reasons.extend(other.reasons);
        self
    }

    /// Says it.
    fn tell(self) -> Answer {
        self.reasons.iter().for_each(tell);
        if self.negative { Answer::Negative } else { Answer::Positive }
    }
}

/// Which column is what, beside the rig file.
#[derive(Clone, Debug, Default, Args)]
struct Columns {
    /// The column of the time, its unit behind a colon where it needs one (clock:ms).
    #[arg(long, value_name = "COLUMN")]
    time: Option<String>,
    /// The column that shows a quantity, such as theta1="Angle (deg)"; may be given several times.
    #[arg(long, value_name = "MEASURE=COLUMN", value_parser = choices::pair)]
    map: Vec<(String, String)>,
}

impl Columns {
    fn choices(&self) -> Choices {
        Choices { time: self.time.clone(), map: self.map.clone() }
    }

    /// A column of the time is not named in vain.
    fn check(&self, record: &Record) -> Result<()> {
        if record.has_own_time() { own_time(self.time.as_deref(), &record.path) } else { Ok(()) }
    }
}

/// Records and the rig that they belong to: what most commands begin with.
#[derive(Clone, Debug, Args)]
struct Records {
    /// Records: Parquet, CSV (also gzipped), NumPy's .npz and .npy, MATLAB's .mat, HDF5, LabVIEW's
    /// .lvm.
    #[arg(required = true, value_name = "REC")]
    records: Vec<PathBuf>,
    #[command(flatten)]
    columns: Columns,
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
    fn begin(&self, rig: &Path, out: &Output, replace: Option<Replace>) -> Result<(Rig, Outputs)> {
        let rig = self.rig(rig)?;
        let files = Outputs::of(out, replace).reads(&self.records).reads_rig(&rig);
        Ok((rig, files))
    }

    /// The rig, with what the command line says of columns.
    fn rig(&self, rig: &Path) -> Result<Rig> {
        Rig::read_for(rig, &self.columns.choices(), &mut |time| self.rate(time))
    }

    /// The rate of the first record, Hz, rounded as far as its clock allows: for a rig file that
    /// says none.
    fn rate(&self, time: &TimeChoice) -> Result<Option<f64>> {
        crate::init::rate_of(&self.records[0], time, &self.options()).map(Some)
    }

    /// Reads the records.
    fn read_for(&self, rig: &Rig) -> Result<Vec<Record>> {
        let (options, part) = (self.options(), self.part());
        part.validate()?;
        let read = |path: &PathBuf| {
            let mut record = Record::read(path, rig, &options)?;
            self.columns.check(&record)?;
            record.cut(&part).map(|()| record)
        };
        self.records.iter().map(read).collect()
    }

    /// How they are read.
    fn options(&self) -> ReadOptions {
        ReadOptions { recover: self.recover, resample: self.resample }
    }

    /// What an analysis ends with that failed: where the record itself is at fault, its warnings
    /// say why, and the answer is negative.
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

    /// The answer for complete records, or the negative one under `--strict` where samples are
    /// missing.
    fn answer(&self, records: &[Record]) -> Answer {
        self.answer_for(records.iter().map(|r| r.losses.lost()).sum())
    }

    /// The same for so many missing samples.
    fn answer_for(&self, lost: u64) -> Answer {
        self.judge(lost).tell()
    }

    /// Negative under `--strict` where samples are missing.
    fn judge(&self, lost: u64) -> Judgement {
        if !self.strict || lost == 0 {
            return Judgement::default();
        }
        let (samples, are) = if lost == 1 { ("sample", "is") } else { ("samples", "are") };
        Judgement::negative(Some(format!("{lost} {samples} {are} missing (--strict)")))
    }
}

/// The command line with all its subcommands.
fn command() -> clap::Command {
    let all = Cli::command().mut_subcommand("batch", batch::without_single_outputs);
    // They say that there is none.
    let all = all.mut_subcommands(|c| match WITHOUT_REPORT.contains(&c.get_name()) {
        true => c.mut_arg("report", |a| a.hide(true)),
        false => c,
    });
    numbers::below_0(all)
}

/// Commands of whose answer there is no report.
const WITHOUT_REPORT: [&str; 5] = ["simulate", "init", "export", "list", "flash"];

/// Parses, runs, reports.
pub fn main() -> ExitCode {
    let parsed = command().try_get_matches().and_then(|m| Ok((Cli::from_arg_matches(&m)?, m)));
    let (cli, matches) = match parsed {
        Ok(parsed) => parsed,
        Err(e) if usage::is_asked(&e) => e.exit(),
        Err(e) => {
            let words: Vec<String> = std::env::args_os().skip(1).map(|a| a.to_string_lossy().into_owned()).collect();
            tell(usage::told(&e, &words));
            return ExitCode::from(2);
        }
    };
    progress::set_quiet(cli.quiet);
    match run(cli, &matches).and_then(|answer| output::all_said().map(|()| answer)) {
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

fn run(cli: Cli, matches: &ArgMatches) -> Result<Answer> {
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
        Command::Init(a) => init::run(&a),
        Command::Inspect(a) => inspect::run(&a),
        Command::Identify(a) => single::run(&a),
        Command::Validate(a) => single::run(&a),
        Command::Explain(a) => single::run(&a),
        Command::Batch(a) => batch::run(&a, matches),
        Command::Export(a) => export::run(&a),
        Command::Device(a) => device::run(&a),
        Command::Flash(a) => flash::run(&a),
        Command::Plan(a) => plan::run(&a),
        Command::Reduce(a) => reduce::run(&a),
        Command::Reproduce(a) => reproduce::run(&a),
        Command::List(a) => list::run(&a),
        Command::Completions(a) => completions::run(&a),
        Command::Man(a) => man::run(&a),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_command_has_two_options_of_one_name() {
        super::command().debug_assert();
    }

    #[test]
    fn a_command_without_a_report_names_none_in_its_help() {
        for name in ["simulate", "init", "export", "list", "flash", "identify"] {
            let mut all = super::command();
            let help = all.find_subcommand_mut(name).unwrap().render_long_help().to_string();
            assert_eq!(help.contains("--report"), name == "identify", "{name}");
        }
    }
}

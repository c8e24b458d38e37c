//! `whirl simulate`: a record of a simulated rig, with effects put in if asked; with `--model`, of
//! an identified model.

use std::path::{Path, PathBuf};

use clap::Args;

use super::output::{Output, Replace};
use super::outputs::Outputs;
use super::{Answer, Columns};
use crate::error::{BadInput, Result};
use crate::record::writer::check_ending;
use crate::rig::Rig;
use crate::simulate::{Summary, own_effects};
use crate::wording::format::{count, shortest};

/// Arguments of `simulate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Rig file with a [plant]; with --model, the rig whose channels the record has (no [plant] is
    /// read then).
    #[arg(long, value_name = "RIG.toml", required_unless_present = "model")]
    pub(super) rig: Option<PathBuf>,
    /// Identified model to simulate, by `identify -o` or `explain -o`.
    #[arg(long, value_name = "MODEL.toml")]
    pub(super) model: Option<PathBuf>,
    /// With --model: begin in the state of this record, with its drive's phase and its inputs.
    #[arg(long, value_name = "REC", requires = "model")]
    pub(super) from: Option<PathBuf>,
    #[command(flatten)]
    pub(super) columns: Columns,
    /// With --from: time of the record at which to begin, s.
    #[arg(long, value_name = "S", requires = "from", allow_negative_numbers = true)]
    pub(super) start: Option<f64>,
    /// With --model: coordinates, then rates a second, in SI units (default: angles 1 rad, others
    /// 0.1, at rest).
    #[arg(
        long,
        value_name = "Q,…,V,…",
        requires = "model",
        conflicts_with = "from",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(super) initial: Vec<f64>,
    /// Effect to put in (may be given several times); `whirl list effects` shows them.
    #[arg(long = "effect", value_name = "ID@PLACE=VALUE[,name=value]", conflicts_with = "model")]
    effects: Vec<String>,
    /// Length of the record, s (with --from: to that record's end where nothing is said;
    /// with --model alone 10 s).
    #[arg(long, value_name = "S", required_unless_present = "model")]
    pub(super) seconds: Option<f64>,
    /// Seed of the initial state.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Record: Parquet, or CSV by extension (.csv, .csv.gz).
    #[arg(short, long, value_name = "REC")]
    pub(super) output: PathBuf,
    #[command(flatten)]
    pub(super) replace: Replace,
    #[command(flatten)]
    pub(super) out: Output,
}

/// Simulates and writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    arguments.out.tell_no_report("a simulated record", "`whirl inspect` writes one of the record");
    let named = [("--time", arguments.columns.time.is_some()), ("--map", !arguments.columns.map.is_empty())];
    if let Some((option, _)) = named.iter().find(|n| n.1 && arguments.from.is_none()) {
        return Err(BadInput::new("no record", "the record whose column it names")
            .at(*option)
            .remedy("Add --from REC"));
    }
    if let Some(model) = &arguments.model {
        return super::simulate_model::run(arguments, model);
    }
    let (Some(path), Some(seconds)) = (&arguments.rig, arguments.seconds) else {
        return Err(BadInput::new("neither --rig with --seconds nor --model", "one of them").at("simulate"));
    };
    plant(arguments, &Rig::read(path)?, seconds)
}

/// Simulates a rig's plant.
fn plant(arguments: &Arguments, rig: &Rig, seconds: f64) -> Result<Answer> {
    Outputs::of(&arguments.out, Some(arguments.replace)).reads_rig(rig).record("-o", &arguments.output).check()?;
    check_ending(&arguments.output)?;
    if let Some(bound) = &rig.bound {
        return model_file(arguments, rig, bound, seconds);
    }
    let (effects, seed) = (&arguments.effects, arguments.seed);
    let summary = if own_effects::are_asked(rig, effects) {
        own_effects::record(rig, effects, seconds, seed, &arguments.output)?
    } else {
        let bar = super::progress::bar("simulating", 0);
        crate::simulate::record(rig, effects, seconds, seed, &arguments.output, &bar)?
    };
    arguments.out.write_json_with(&summary, &[])?;
    let taken: String = crate::simulate::taken_for(&arguments.effects).iter().map(|t| format!("{t}\n")).collect();
    arguments.out.say(&format!("{}{taken}", said(&summary, &arguments.output)));
    Ok(Answer::Positive)
}

/// What was simulated, for people: effects with all their parameters, those by default too.
fn said(summary: &Summary, output: &Path) -> String {
    let effects =
        if summary.effects.is_empty() { String::new() } else { format!(", with {}", summary.effects.join("; ")) };
    let (samples, seconds) = (count(summary.samples), shortest(summary.seconds));
    format!("{samples} samples ({seconds} s) in {}{effects}\n", output.display())
}

/// Simulates a model file.
fn model_file(
    arguments: &Arguments,
    rig: &Rig,
    bound: &crate::rig::measures::ObservedModel,
    seconds: f64,
) -> Result<Answer> {
    let samples = crate::model::model_file::simulation::record(
        rig,
        bound,
        &arguments.effects,
        seconds,
        arguments.seed,
        &arguments.output,
    )?;
    let seconds = samples as f64 / rig.sample_rate_hz;
    let summary = Summary { samples, seconds, seed: arguments.seed, effects: arguments.effects.clone() };
    arguments.out.write_json_with(&summary, &[])?;
    arguments.out.say(&said(&summary, &arguments.output));
    Ok(Answer::Positive)
}

//! `whirl plan`: the next experiment: what to set, how long, and what it will tell.

use std::path::PathBuf;

use clap::Args;

use super::output::{Output, Replace, print_warnings};
use super::outputs::Outputs;
use super::{Answer, Judgement, progress};
use crate::error::{BadInput, Result};
use crate::files::write_file;
use crate::identify::best::best;
use crate::identify::{self, model_file, shooting};
use crate::model::identified::IdentifiedModel;
use crate::model::refused;
use crate::plan::goals::{Goals, Limits, Precise, Tell};
use crate::plan::{Settings, check_rig, plan, presentation};
use crate::record::{ReadOptions, Record};
use crate::rig::Rig;
use crate::warning::Warning;

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Rig file.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Identified model, by `identify -o` or `explain -o`: what is planned for [default: what
    /// `identify` makes of `--record`].
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Effects to tell from one another: one of them in the model, or of the size that it would
    /// have.
    #[arg(long, value_name = "ID@PLACE[=VALUE]", value_delimiter = ',', value_parser = Tell::parse)]
    tell: Vec<Tell>,
    /// Parameters and the 95 % interval wanted, such as C11=0.5%.
    #[arg(long, value_name = "NAME=X%", value_delimiter = ',', value_parser = Precise::parse)]
    precise: Vec<Precise>,
    /// What the rig may be set to (docs/plan.md) [default: near the model's own drive, at most 1.6
    /// times its acceleration].
    #[arg(long, value_name = "FILE.toml")]
    limits: Option<PathBuf>,
    /// A record of the rig: its channels' noise is that of the next (needed where channels do not
    /// count).
    #[arg(long, value_name = "REC")]
    record: Option<PathBuf>,
    /// Settings that are simulated and looked at.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=500))]
    budget: u16,
    /// Seed of what is drawn.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The plan, for `whirl capture --plan`.
    #[arg(short, long, value_name = "PLAN.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// The model that is planned for, and what makes it doubtful.
fn model(arguments: &Arguments, rig: &Rig, record: Option<&Record>) -> Result<(IdentifiedModel, Vec<Warning>)> {
    match (&arguments.model, record) {
        (Some(path), _) => {
            let model = IdentifiedModel::read(path)?;
            refused::other_system(&model, path, rig).map(|()| (model, Vec::new()))
        }
        (None, Some(record)) => {
            let bar = progress::bar("identifying the record", 0);
            let (weak, choices) = (identify::Settings::default(), shooting::Settings::default());
            let found = best(std::slice::from_ref(record), rig, &weak, &choices, &bar);
            bar.finish_and_clear();
            let found = found?;
            // What is planned for a model that misses something is no better than the model.
            let grave: Vec<Warning> = found.warnings.iter().filter(|w| w.invalidates).cloned().collect();
            print_warnings(&grave);
            Ok((model_file::identified_model(&found, rig)?, grave))
        }
        (None, None) => {
            Err(BadInput::new("no model and no record", "an identified model of this rig, or a record of it")
                .at("--model")
                .remedy(format!(
                    "Name a record (--record REC), or identify one first: whirl identify REC --rig {} -o MODEL.toml",
                    arguments.rig.display()
                )))
        }
    }
}

/// Plans.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let rig = Rig::read(&arguments.rig)?;
    let inputs = arguments.model.iter().chain(&arguments.limits).chain(&arguments.record);
    let files = Outputs::of(&arguments.out, Some(arguments.replace)).reads_rig(&rig).reads(inputs);
    files.result("-o", arguments.output.as_ref()).check()?;
    check_rig(&rig)?;
    let limits = arguments.limits.as_ref().map(|p| Limits::read(p)).transpose()?.unwrap_or_default();
    let record = arguments.record.as_ref().map(|p| Record::read(p, &rig, &ReadOptions::default())).transpose()?;
    let (model, warnings) = model(arguments, &rig, record.as_ref())?;
    let settings = Settings {
        goals: Goals {
            tell: arguments.tell.iter().map(|t| t.name.clone()).collect(),
            precise: arguments.precise.clone(),
        },
        sizes: arguments.tell.clone(),
        limits,
        record: record.as_ref(),
        budget: usize::from(arguments.budget),
        seed: arguments.seed,
    };
    let bar = progress::bar("simulating settings", 0);
    let found = plan(&rig, &model, &settings, &|done, all| {
        bar.set_length(all);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let found = found?;
    if let Some(path) = &arguments.output {
        write_file(path, presentation::to_toml(&found).as_bytes())?;
    }
    arguments.out.write_json_with(&found, &warnings)?;
    arguments.out.say(&presentation::human(&found));
    let reason = match &found.best {
        Some(best) if best.decides => return Ok(Answer::Positive),
        Some(best) if best.is_one_draw() => "whether the planned record reaches every goal rests on one draw",
        _ => "no planned record reaches every goal",
    };
    Ok(Judgement::negative(Some(reason.to_owned())).tell())
}

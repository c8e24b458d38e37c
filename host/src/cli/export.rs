//! `whirl export`: an identified model as readable code.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::Answer;
use super::output::{Output, Replace};
use super::outputs::Outputs;
use crate::error::{BadInput, Result};
use crate::export::{LANGUAGES, code, language};
use crate::files::write_file;
use crate::model::identified::IdentifiedModel;
use crate::model::refused;
use crate::motion::{Effect, Motion};
use crate::rig::Rig;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Identified model, by `identify -o` or `explain -o`.
    #[arg(value_name = "MODEL.toml")]
    model: PathBuf,
    /// Language.
    #[arg(long, value_name = "LANGUAGE", value_parser = clap::builder::PossibleValuesParser::new(LANGUAGES.iter().map(|l| l.id())))]
    to: String,
    /// Rig file on which the model was identified: units of what is no angle; effects on bodies of
    /// one's own, effects of one's own need it.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Code.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// What was written.
#[derive(Debug, Serialize)]
struct Summary {
    model: String,
    language: &'static str,
    file: PathBuf,
    coordinates: Vec<String>,
    inputs: Vec<String>,
    parameters: Vec<String>,
    effects: Vec<String>,
}

/// Reads, prints, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    arguments.out.tell_no_report("code", "`whirl identify` and `whirl explain` write one of the model");
    let rig = arguments.rig.as_ref().map(Rig::read).transpose()?;
    let mut files = Outputs::of(&arguments.out, Some(arguments.replace)).reads([&arguments.model]);
    if let Some(rig) = &rig {
        files = files.reads_rig(rig);
    }
    files.result("-o", Some(&arguments.output)).check()?;
    let language = language(&arguments.to)?;
    let model = IdentifiedModel::read(&arguments.model)?;
    rig.as_ref().map_or(Ok(()), |rig| refused::other_system(&model, &arguments.model, rig))?;
    // What is wrong in the model has no file yet.
    let of_model = |e: BadInput| e.in_file(&arguments.model);
    let motion = Motion::of(&model, &arguments.model, rig.as_ref(), 0.0).map_err(of_model)?;
    let text = code(&motion, language, &arguments.output).map_err(of_model)?;
    write_file(&arguments.output, text.as_bytes())?;
    let summary = Summary {
        model: motion.name.clone(),
        language: language.id(),
        file: arguments.output.clone(),
        coordinates: motion.file.coordinates.iter().map(|c| c.name.clone()).collect(),
        inputs: motion.file.inputs.clone(),
        parameters: motion.coefficients.iter().map(|p| p.name.clone()).collect(),
        effects: motion.effects.iter().map(Effect::name).collect(),
    };
    arguments.out.write_json_with(&summary, &[])?;
    let effects =
        if summary.effects.is_empty() { String::new() } else { format!(", with {}", summary.effects.join(", ")) };
    arguments.out.say(&format!(
        "{} as {} in {}: {} parameters{effects}\n",
        summary.model,
        language.about(),
        arguments.output.display(),
        summary.parameters.len()
    ));
    Ok(Answer::Positive)
}

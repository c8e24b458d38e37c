//! `whirl simulate`: a record of a simulated rig, with effects put in if asked.

use std::path::PathBuf;

use clap::Args;

use super::Answer;
use super::output::{Output, Replace};
#[cfg(feature = "sim")]
use super::outputs::Outputs;
use crate::error::Result;
use crate::rig::Rig;

/// Arguments of `simulate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Rig file with a [plant].
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Effect to put in (may be given several times); `whirl list effects` shows them.
    #[arg(long = "effect", value_name = "ID@PLACE=VALUE[,name=value]")]
    effects: Vec<String>,
    /// Length of the record, s.
    #[arg(long, value_name = "S")]
    seconds: f64,
    /// Seed of the initial state.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Record: Parquet, or CSV by extension (.csv, .csv.gz).
    #[arg(short, long, value_name = "REC")]
    output: PathBuf,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// Simulates and writes.
#[cfg(feature = "sim")]
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let rig = Rig::read(&arguments.rig)?;
    Outputs::of(&arguments.out, Some(arguments.replace)).reads_rig(&rig).record("-o", &arguments.output).check()?;
    if let Some(bound) = &rig.bound {
        return model_file(arguments, &rig, bound);
    }
    let summary = crate::simulate::record(
        &rig,
        &arguments.effects,
        arguments.seconds,
        arguments.seed,
        &arguments.output,
        &super::progress::bar("simulating", 0),
    )?;
    arguments.out.write_json(&summary)?;
    arguments.out.say(&format!(
        "{} samples ({} s) in {}\n",
        summary.samples,
        summary.seconds,
        arguments.output.display()
    ));
    Ok(Answer::Positive)
}

/// Simulates a model file.
#[cfg(feature = "sim")]
fn model_file(arguments: &Arguments, rig: &Rig, bound: &crate::rig::measures::Bound) -> Result<Answer> {
    use crate::model::model_file::simulation::Extra;
    let derived = bound.model.mechanism.as_ref().is_some_and(|m| m.file.as_ref().is_some_and(|f| !f.written));
    let id = |text: &String| text.split('@').next().unwrap_or_default().to_owned();
    let listed = arguments.effects.iter().all(|t| {
        let (id, own) = (id(t), rig.effects.iter());
        crate::effects::catalogue().iter().any(|e| e.id == id) || own.into_iter().any(|e| e.id == id)
    });
    let placed = rig.drive.is_some() && listed && crate::effects::written::applies(&bound.model);
    let put_in;
    let extra = if derived || placed {
        Extra::Effects(&arguments.effects)
    } else {
        put_in = crate::explain::model_file::put_in::terms(&bound.model, rig.omega(), &arguments.effects)?;
        Extra::Terms(&put_in.terms, &put_in.strengths)
    };
    let samples = crate::model::model_file::simulation::record(
        rig,
        bound,
        extra,
        arguments.seconds,
        arguments.seed,
        &arguments.output,
    )?;
    let seconds = samples as f64 / rig.sample_rate_hz;
    let summary =
        crate::simulate::Summary { samples, seconds, seed: arguments.seed, effects: arguments.effects.clone() };
    arguments.out.write_json(&summary)?;
    arguments.out.say(&format!("{samples} samples ({seconds} s) in {}\n", arguments.output.display()));
    Ok(Answer::Positive)
}

/// Says that this build has no simulator.
#[cfg(not(feature = "sim"))]
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let _ = (
        Rig::read(&arguments.rig)?,
        &arguments.effects,
        arguments.seconds,
        arguments.seed,
        &arguments.output,
        &arguments.out,
        &arguments.replace,
    );
    Err(crate::error::BadInput::new("a build without the feature `sim`", "one with it")
        .remedy("Build with `cargo build --release` (feature sim is on by default)"))
}

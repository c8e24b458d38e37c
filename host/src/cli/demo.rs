//! `whirl demo`: the whole line with nothing plugged in, from a simulated rig through the firmware's logic to one report.
//!
//! The rig hides an effect that the identified model does not have. Its truth is read once, after every answer is there, for the report's
//! last table.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Answer;
use super::output::{Output, Replace};
use super::outputs::Outputs;
use super::progress::during;
use crate::capture::CaptureSettings;
use crate::error::{BadInput, Result};
use crate::explain::{Settings as ExplainSettings, explain};
use crate::identify::model_file::identified_model;
use crate::identify::{Settings, identify, presentation};
use crate::inspect::{InspectSettings, inspect};
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::record::formats::ReadOptions;
use crate::reduce::{ReduceSettings, reduce};
use crate::report::sections::truth::Truth;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::rig::plant::Plant;
use crate::validate::{Beside, Settings as ValidateSettings, validate};

/// The simulated rig.
const RIG: &str = include_str!("../../rigs/chaotic.toml");
/// The effect that the simulated rig hides.
const HIDDEN: &str = "quadratic-drag@arm2=2e-7";
/// Length of the record, s.
const SECONDS: f64 = 120.0;

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder for the report and the record.
    #[arg(short, long, value_name = "DIR", default_value = "whirl-demo")]
    output: PathBuf,
    /// Seed of the simulated rig.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Machine-readable results.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
}

/// Whether a record is one of this demo's, which the seed makes again.
fn is_a_demo_s(record: &Path) -> bool {
    crate::record::metadata(record).is_some_and(|m| m.rig == RIG && m.source.starts_with("sim:"))
}

/// Runs the line.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let out = Output { json: arguments.json.clone(), report: None };
    let folder = &arguments.output;
    std::fs::create_dir_all(folder)
        .map_err(|e| BadInput::io(folder, &e).at("-o").remedy("Name a folder that can be written to"))?;
    let rig = Rig::parse(RIG, Path::new("rigs/chaotic.toml"))?;
    let (record_path, report) = (folder.join("record.parquet"), folder.join("report.html"));
    let of = if is_a_demo_s(&record_path) { Outputs::again } else { Outputs::record };
    of(Outputs::of(&out, Some(arguments.replace)), "-o", &record_path).result("-o", Some(&report)).check()?;
    out.say(&format!("capture: {SECONDS} s of the simulated rig, through the firmware's logic and the wire format\n"));
    let settings = CaptureSettings {
        seconds: Some(SECONDS),
        ..CaptureSettings::new(format!("sim:{}", arguments.seed), record_path.clone())
    };
    let hidden = [HIDDEN.to_owned()];
    let captured = super::capture::from_simulated(&settings, &rig, &hidden, &mut *super::progress::of_capture())?;
    out.say(&super::capture::human(&captured));
    let record = Record::read(&record_path, &rig, &ReadOptions::default())?;
    let inspection = during("1 of 6: inspecting the record", || inspect(&record, &rig, &InspectSettings::default()))?;
    out.say(&format!("\ninspect\n{}", crate::inspect::text::text(&inspection)));
    let records = [record];
    let identified = during("2 of 6: identifying the parameters", || identify(&records, &rig, &Settings::default()))?;
    out.say(&format!("\nidentify\n{}", super::identify::human(&identified)));
    let check = |what: &'static str, model: &IdentifiedModel| {
        let beside = Beside { inspection: Some(&inspection), ..Beside::default() };
        during(what, || validate(&records, &rig, model, beside, &ValidateSettings::default()))
    };
    let validated = check("3 of 6: validating the model", &identified_model(&identified, &rig)?)?;
    out.say(&format!("\nvalidate\n{}", crate::validate::presentation::human(&validated)));
    let reduced = during("4 of 6: reducing", || reduce(&records, &rig, &ReduceSettings::default()))?;
    out.say(&format!("\nreduce\n{}", super::reduce::human(&reduced)));
    let looking = "5 of 6: looking for the effect that is missing";
    let explained = during(looking, || explain(&records, &rig, &ExplainSettings::default()))?;
    out.say(&format!("\nexplain\n{}", crate::explain::presentation::human(&explained)));
    let explained_model = explained.model.as_ref().filter(|m| !m.effects.is_empty());
    let again = explained_model.map(|model| check("6 of 6: validating the model with it", model)).transpose()?;
    if let Some(again) = &again {
        out.say(&format!(
            "\nvalidate the model with what was missing\n{}",
            crate::validate::presentation::human(again)
        ));
    }

    // Every answer is there: now the truth may be read, for the last table.
    let plant = Plant::of(&rig)?;
    let truth = |name: &str| plant.truth(name, rig.omega());
    let mut results = Results::new();
    results
        .add(presentation::table(&identified, "", &|_| None))
        .add(presentation::residuals(&identified))
        .add(validated.clone())
        .add(explained.clone())
        .add(inspection.clone())
        .add(reduced.clone())
        .add(Truth { table: presentation::table(&identified, "", &truth), hidden: hidden.to_vec() });
    if let Some(again) = &again {
        results.add(again.clone());
    }
    let mut page = Report::of(
        "whirl demo",
        "a simulated double pendulum on a shaker, from encoder edges to the effect that the model is missing",
        &results,
    );
    page.fact("Rig", &rig.name)
        .fact(
            "Record",
            format!("{} s, {} samples, {} missing", SECONDS, captured.losses.received, captured.losses.lost()),
        )
        .fact("Firmware", &captured.firmware);
    page.write(&report)?;
    out.write_json(&serde_json::json!({
        "capture": captured, "inspect": inspection, "identify": identified, "validate": validated, "reduce": reduced,
        "explain": explained, "validate_explained": again
    }))?;
    out.say(&format!("\nreport: {}\n", report.display()));
    Ok(Answer::Positive)
}

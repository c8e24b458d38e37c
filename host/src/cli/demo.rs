//! `whirl demo`: the whole line with nothing plugged in, from a simulated rig through the
//! firmware's logic to one report.
//!
//! The rig hides an effect that the identified model does not have. Its truth is read once, after
//! every answer is there, for the report's last table.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Answer;
use super::output::{Output, Replace};
use super::outputs::Outputs;
use super::progress::step;
use crate::capture::CaptureSettings;
use crate::error::{BadInput, Result};
use crate::explain::card::card as explain_card;
use crate::explain::ledger::checksum;
use crate::explain::{Explanation, Settings as ExplainSettings, explain};
use crate::identify::card::card as identify_card;
use crate::identify::model_file::identified_model;
use crate::identify::{Identification, Settings, identify, presentation};
use crate::inspect::{InspectSettings, inspect};
use crate::model::identified::IdentifiedModel;
use crate::plan::{self, Plan};
use crate::record::Record;
use crate::record::formats::ReadOptions;
use crate::reduce::{ReduceSettings, reduce};
use crate::report::sections::parameters::{Parameter, ParameterTable};
use crate::report::sections::provenance::Provenance;
use crate::report::sections::truth::Truth;
use crate::report::sections::warnings::Warnings;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::rig::plant::Plant;
use crate::validate::{Settings as ValidateSettings, Supplements, validate};
use crate::warning::Warning;

/// The simulated rig.
const RIG: &str = include_str!("../../rigs/chaotic.toml");
/// The effect that the simulated rig hides.
const HIDDEN: &str = "quadratic-drag@arm2=2e-7";
/// Length of the record, s.
const SECONDS: f64 = 120.0;
/// Settings that are looked at for the next experiment: few, a demonstration is to be short.
const PLANNED: usize = 1;

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

/// Warnings of the answer, then those of the model as it was, which the answer has dealt with.
fn warnings(explained: &Explanation, identified: &Identification) -> Vec<Warning> {
    let dealt_with = |w: &Warning| Warning {
        text: format!("Of the model as it was, before anything was added: {}", w.text),
        advice: if explained.effects.is_empty() {
            w.advice.clone()
        } else {
            "The answer above is what came of it".to_owned()
        },
        ..w.clone()
    };
    let earlier = identified.warnings.iter().filter(|w| !explained.warnings.contains(w)).map(dealt_with);
    explained.warnings.iter().cloned().chain(earlier).collect()
}

/// All parameters beside the truth: those of the model with what was missing where it was found,
/// and that last.
fn last_table(
    explained: &Explanation,
    identified: &Identification,
    truth: &dyn Fn(&str) -> Option<f64>,
) -> ParameterTable {
    if explained.effects.is_empty() {
        return presentation::table(identified, "", truth);
    }
    let truth = |name: &str| truth(name).or_else(|| HIDDEN.strip_prefix(name)?.strip_prefix('=')?.parse().ok());
    // A name that the rig does not have is told above the table alone.
    let all = explained.parameters.iter().filter(|p| !p.name.contains('@') || truth(&p.name).is_some());
    let beside = |p: &crate::identify::Parameter| Parameter {
        name: p.name.clone(),
        value: p.value,
        std_error: p.std_error,
        unit: p.unit.clone(),
        truth: truth(&p.name),
    };
    ParameterTable { heading: String::new(), parameters: all.map(beside).collect(), notes: Vec::new() }
}

/// The next experiment with the simulated rig: what tells most of all parameters in the same time. To
/// tell the effect from every other would take as long as all the rest of the demonstration.
fn next_experiment(rig: &Rig, model: &IdentifiedModel, seed: u64) -> Result<Plan> {
    let settings = plan::Settings {
        goals: plan::goals::Goals::default(),
        sizes: Vec::new(),
        limits: plan::goals::Limits::default(),
        record: None,
        budget: PLANNED,
        seed,
    };
    plan::plan(rig, model, &settings, &|_, _| {})
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
    let settings = CaptureSettings {
        seconds: Some(SECONDS),
        ..CaptureSettings::new(format!("sim:{}", arguments.seed), record_path.clone())
    };
    let hidden = [HIDDEN.to_owned()];
    let captured = super::capture::from_simulated(&settings, &rig, &hidden, &mut *super::progress::of_capture())?;
    let mut line = format!(
        "capture: {SECONDS} s of the simulated rig, through the firmware's logic and the wire format\n{}",
        super::capture::human(&captured)
    );
    let record = Record::read(&record_path, &rig, &ReadOptions::default())?;
    let inspection = step("1 of 7: inspecting the record", || inspect(&record, &rig, &InspectSettings::default()))?;
    line += &format!("\ninspect\n{}", crate::inspect::text::text(&inspection));
    let records = [record];
    let identified = step("2 of 7: identifying the parameters", || identify(&records, &rig, &Settings::default()))?;
    line += &format!("\nidentify\n{}", super::identify::human(&identified, &identify_card(&identified, &rig)));
    let own_model = identified_model(&identified, &rig)?;
    let check = |what: &'static str, model: &IdentifiedModel| {
        let supplements = Supplements { inspection: Some(&inspection), ..Supplements::default() };
        step(what, || validate(&records, &rig, model, supplements, &ValidateSettings::default()))
    };
    let validated = check("3 of 7: validating the model", &own_model)?;
    line += &format!("\nvalidate\n{}", crate::validate::presentation::human(&validated));
    let reduced = step("4 of 7: reducing", || reduce(&records, &rig, &ReduceSettings::default()))?;
    line += &format!("\nreduce\n{}", super::reduce::human(&reduced));
    let looking = "5 of 7: looking for the effect that is missing";
    let explained = step(looking, || explain(&records, &rig, &ExplainSettings::default()))?;
    let card = explain_card(&explained, &rig);
    let explained_model = explained.model.as_ref().filter(|m| !m.effects.is_empty());
    let again = explained_model.map(|model| check("6 of 7: validating the model with it", model)).transpose()?;
    if let Some(again) = &again {
        line += &format!("\nvalidate the model with what was missing\n{}", crate::validate::presentation::human(again));
    }
    let planned = step("7 of 7: planning the next experiment", || {
        next_experiment(&rig, explained_model.unwrap_or(&own_model), arguments.seed)
    })?;
    line += &format!("\nplan\n{}", plan::presentation::human(&planned));
    // The answer first, then the line that led to it.
    out.say(&format!("{}\nThe line that led to it\n{line}", crate::explain::presentation::human(&explained, &card)));

    // Every answer is there: now the truth may be read, for the last table.
    let plant = Plant::of(&rig)?;
    let truth = |name: &str| plant.truth(name, rig.omega());
    let mut results = Results::new();
    results
        .add(card.clone())
        .add(presentation::table(
            &identified,
            "The model as identified, before anything was added; its intervals do not yet hold what it lacks",
            &|_| None,
        ))
        .add(presentation::residuals(&identified))
        .add(validated.clone())
        .add(explained.clone())
        .add(inspection.clone())
        .add(reduced.clone())
        .add(Warnings { warnings: warnings(&explained, &identified) })
        .add(planned.clone())
        .add(Truth { table: last_table(&explained, &identified, &truth), hidden: hidden.to_vec() })
        .add(
            Provenance::of("demo")
                .with("seed", arguments.seed)
                .with("rig file", rig.path.display())
                .with("hidden effect", HIDDEN)
                .with("firmware", &captured.firmware)
                .with("record", format!("record.parquet (CRC-32 {:08x})", checksum(&records[0]))),
        );
    if let Some(again) = &again {
        results.add(again.clone());
    }
    let page = Report::of(
        "whirl demo",
        "a simulated double pendulum on a shaker, from encoder edges to the effect that the model is missing",
        &results,
    );
    page.write(&report)?;
    out.write_json(&serde_json::json!({
        "capture": captured, "inspect": inspection, "identify": identified, "validate": validated, "reduce": reduced,
        "explain": explained, "validate_explained": again, "plan": planned
    }))?;
    // The answer has scrolled away.
    let next = plan::presentation::headline(&planned);
    out.say(&format!("\nIn short: {}\n{next}\nreport: {}\n", card.verdict, report.display()));
    Ok(Answer::Positive)
}

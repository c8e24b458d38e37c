//! `whirl inspect`: rates, losses, spectra, phase portraits, periodicity of a record.

use std::path::{Path, PathBuf};

use clap::Args;

use super::output::{Output, Replace, command_line, print_warnings};
use super::outputs::Outputs;
use super::{Answer, Records};
use crate::error::{BadInput, Result};
use crate::init::{Settings, draft, garbled_names, write};
use crate::inspect::{InspectSettings, Inspection, inspect};
use crate::record::Record;
use crate::record::formats::ReadOptions;
use crate::report::card::Card;
use crate::report::sections::provenance::Provenance;
use crate::report::sections::warnings::Warnings;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::names::capitalised;

/// Arguments of `inspect`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Rig file [default: the one that the record carries, or what its columns show, as
    /// `whirl init` would write it].
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// Writes the inspection report of a record that was made just now. Where it cannot be inspected
/// (too short, say), the report says so, and so does a warning: the record stands all the same.
///
/// # Errors
/// A file that cannot be written.
pub fn report_of(record: &Path, rig: &Rig, report: &Path) -> Result<Option<Warning>> {
    let mut results = Results::new();
    let read = Record::read(record, rig, &ReadOptions::default());
    let warning = match read.and_then(|read| inspect(&read, rig, &InspectSettings::default())) {
        Ok(inspection) => {
            let verdict = crate::inspect::text::sentence(&inspection);
            results.add(Card { verdict, ..Card::default() }).add(inspection);
            None
        }
        Err(e) => Some(Warning::new(
            "not-inspected",
            format!(
                "the record is written, but cannot be inspected: {}",
                BadInput { remedy: String::new(), ..e.clone() }
            ),
            if e.remedy.is_empty() { "Record for longer".to_owned() } else { e.remedy },
        )),
    };
    if let Some(w) = &warning {
        let verdict = format!("{}.", capitalised(&w.text));
        results.add(Card { verdict, ..Card::default() }).add(Warnings { warnings: vec![w.clone()] });
    }
    Report::of(format!("Inspection: {}", rig.name), record.display().to_string(), &results).write(report)?;
    Ok(warning)
}

/// The rig of a record for which no rig file is given: what it is taken for is said first.
fn assumed(arguments: &Arguments) -> Result<Rig> {
    let records = &arguments.records;
    let settings = Settings {
        choices: records.columns.choices(),
        options: records.options(),
        output: PathBuf::from("rig.toml"),
        ..Settings::default()
    };
    print_warnings(garbled_names(&records.records[0]).as_slice());
    let draft = draft(&records.records[0], &settings)?;
    arguments.out.say(&format!("{}\n", write::human(&draft)));
    draft.rig()
}

/// Reads, inspects, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let rig = match &arguments.rig {
        Some(path) => {
            let (rig, files) = arguments.records.begin(path, &arguments.out, Some(arguments.replace))?;
            files.check()?;
            rig
        }
        None => {
            Outputs::of(&arguments.out, Some(arguments.replace)).reads(&arguments.records.records).check()?;
            assumed(arguments)?
        }
    };
    let records = arguments.records.read_for(&rig)?;
    let all: Result<Vec<Inspection>> = super::progress::during("inspecting", || {
        records.iter().map(|r| inspect(r, &rig, &InspectSettings::default())).collect()
    });
    let inspections = match all {
        Ok(inspections) => inspections,
        Err(error) => return arguments.records.failed(&records, error, &arguments.out),
    };
    let mut results = Results::new();
    let mut text = String::new();
    for i in &inspections {
        print_warnings(&i.warnings);
        text.push_str(&crate::inspect::text::text(i));
        results.add(Card { verdict: crate::inspect::text::sentence(i), ..Card::default() });
        results.add(i.clone());
    }
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        results.add(Provenance::of(&command_line()).with("rig file", rig.path.display()).records(&records));
        Report::of(format!("Inspection: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    // One record, one object; several, a list of them.
    match &inspections[..] {
        [one] => arguments.out.write_json(one)?,
        several => arguments.out.write_json_list(several)?,
    }
    arguments.out.say(&text);
    let all: Vec<_> = inspections.into_iter().flat_map(|i| i.warnings).collect();
    Ok(Answer::that_stands(&all).and(arguments.records.answer(&records)))
}

//! `whirl validate`: whether an identified model moves as the measured system does.

use std::path::PathBuf;

use clap::Args;

use super::batch::{Parts, Single};
use super::output::{Output, Replace, command_line, print_warnings};
use super::{Analysed, Answer, Judgement, Records};
use crate::batch::answers;
use crate::batch::row::Row;
use crate::error::Result;
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::report::sections::provenance::Provenance;
use crate::report::sections::warnings::Warnings;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::validate::card::card;
use crate::validate::{Beside, Settings, Validation, Verdict, presentation, validate};
use crate::warning::Warning;

/// Arguments of `validate`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Rig file (`whirl init` writes one from a record).
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Identified model, by `identify -o` or `explain -o`.
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Free vibration of the same arms, for the natural frequencies.
    #[arg(long, value_name = "REC")]
    free: Option<PathBuf>,
    /// Angle by which a prediction may be off, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 30.0)]
    tolerance_deg: f64,
    /// Most starts of predictions.
    #[arg(long, value_name = "N", default_value_t = 60)]
    starts: usize,
    /// Seed of the permutation test.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Bifurcation diagram over a factor on a parameter (drive: on all of the base's motion), such as drive=0.5:1.5.
    #[arg(long, value_name = "NAME=LOW:HIGH", value_parser = range)]
    bifurcation: Option<(String, f64, f64)>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// Greatest factor of a bifurcation diagram: a motion a hundred times as fast is still integrated in its time.
const MOST_TIMES: f64 = 100.0;

/// NAME=LOW:HIGH.
fn range(text: &str) -> std::result::Result<(String, f64, f64), String> {
    let parse = || {
        let (name, ends) = text.split_once('=')?;
        let (low, high) = ends.split_once(':')?;
        Some((name.to_owned(), low.parse().ok()?, high.parse().ok()?))
    };
    let (name, low, high): (String, f64, f64) =
        parse().ok_or_else(|| format!("\"{text}\" is not NAME=LOW:HIGH, such as drive=0.5:1.5"))?;
    match [low, high].iter().find(|f| !(-MOST_TIMES..=MOST_TIMES).contains(*f)) {
        None => Ok((name, low, high)),
        Some(f) => Err(format!("{f:e} is not a factor from -{MOST_TIMES} to {MOST_TIMES}")),
    }
}

/// What a validation needs beside the records.
pub struct Ready {
    rig: Rig,
    model: IdentifiedModel,
    free: Option<Record>,
    settings: Settings,
}

/// Reads what is the same for every record.
fn prepare(arguments: &Arguments, rig: Rig) -> Result<Ready> {
    let model = IdentifiedModel::read(&arguments.model)?;
    let free_rig = Rig { drive: None, ..rig.clone() };
    let options = arguments.records.options();
    let free = arguments.free.as_ref().map(|path| Record::read(path, &free_rig, &options)).transpose()?;
    let settings = Settings {
        tolerance_deg: arguments.tolerance_deg,
        starts: arguments.starts,
        seed: arguments.seed,
        bifurcation: arguments.bifurcation.clone(),
    };
    Ok(Ready { rig, model, free, settings })
}

/// Reads the records and validates the model on them.
fn analyse(arguments: &Arguments, ready: &Ready) -> Result<Analysed<Validation>> {
    let records = arguments.records.read_for(&ready.rig)?;
    let bar = super::progress::bar("validating", 0);
    let beside = Beside { free: ready.free.as_ref(), inspection: None, progress: Some(&bar) };
    let result = validate(&records, &ready.rig, &ready.model, beside, &ready.settings).map_err(|e| {
        // What is wrong in the model has no file yet; records and rig name theirs.
        if e.place.as_deref().is_some_and(|p| p.starts_with("--")) { e } else { e.in_file(&arguments.model) }
    })?;
    bar.finish_and_clear();
    Ok(Analysed { records, result: Ok(result) })
}

/// What makes the answer negative.
fn judge(arguments: &Arguments, result: &Validation, lost: u64) -> Judgement {
    if result.verdict == Verdict::Failed {
        return Judgement::negative(Some("the model fails its validation".to_owned()));
    }
    Judgement::of(&result.warnings).and(arguments.records.judge(lost))
}

/// Reads, validates, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, files) = arguments.records.begin(&arguments.rig, &arguments.out, Some(arguments.replace))?;
    files.reads([&arguments.model]).reads(&arguments.free).check()?;
    let ready = prepare(arguments, rig)?;
    let analysed = analyse(arguments, &ready)?;
    let lost = analysed.lost();
    let Analysed { records, result } = analysed;
    let result = result?;
    print_warnings(&result.warnings);
    arguments.out.write_json(&result)?;
    let card = card(&result, &ready.model, &ready.rig);
    arguments.out.say(&format!("{}\nWhat it rests on\n{}", card.text(), presentation::human(&result)));
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        let mut results = Results::new();
        let provenance = Provenance::of(&command_line())
            .with("rig file", ready.rig.path.display())
            .with("model file", arguments.model.display())
            .with("seed", arguments.seed)
            .records(&records);
        let warnings = Warnings { warnings: result.warnings.clone() };
        results.add(card).add(warnings).add(result.clone()).add(provenance);
        Report::of(format!("Validation: {}", ready.rig.name), names.join(", "), &results).write(path)?;
    }
    Ok(judge(arguments, &result, lost).tell())
}

impl Single for Arguments {
    const NAME: &'static str = "validate";
    type Ready = Ready;
    type Result = Validation;

    fn parts(&self) -> Parts<'_> {
        Parts { records: &self.records, rig: &self.rig, out: &self.out, replace: self.replace }
    }

    fn records_mut(&mut self) -> &mut Records {
        &mut self.records
    }

    fn reads(&self) -> Vec<PathBuf> {
        self.free.iter().chain([&self.model]).cloned().collect()
    }

    fn prepare(&self, rig: Rig) -> Result<Ready> {
        prepare(self, rig)
    }

    fn analyse(&self, ready: &Ready) -> Result<Analysed<Validation>> {
        analyse(self, ready)
    }

    fn judge(&self, result: &Validation, lost: u64) -> Judgement {
        judge(self, result, lost)
    }

    fn cells(row: &mut Row, result: &Validation) -> Vec<Warning> {
        answers::validation(row, result);
        result.warnings.clone()
    }
}

//! `whirl explain`: where simulation and measurement disagree, which effect is missing, the gap before and after.

use std::path::PathBuf;

use clap::Args;

use super::batch::{Parts, Single};
use super::identify::WeakForm;
use super::output::{Output, Replace, command_line, print_warnings, write_file};
use super::{Analysed, Answer, Judgement, Records, progress};
use crate::batch::answers;
use crate::batch::row::Row;
use crate::error::{BadInput, Result};
use crate::explain::card::card;
use crate::explain::{Explanation, Settings, Verdict, explain, ledger, presentation};
use crate::model::identified::IdentifiedModel;
use crate::report::sections::provenance::Provenance;
use crate::report::sections::warnings::Warnings;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::warning::Warning;

/// Arguments of `explain`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Rig file (`whirl init` writes one from a record).
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Horizon of the gap, s [default: one drive period, 0.2 s when free].
    #[arg(long, value_name = "S")]
    horizon: Option<f64>,
    /// Horizons at which the last 30 % of the record is predicted after fitting the first 70 %, s [default: 1 and 4 of the gap's; 0.2 and 2.667 when free].
    #[arg(long, value_name = "S", value_delimiter = ',')]
    forecast: Vec<f64>,
    #[command(flatten)]
    weak: WeakForm,
    /// Most effects that are added [default: 8].
    #[arg(long, value_name = "N")]
    most_effects: Option<usize>,
    /// Start from this model, as `whirl identify -o` or an earlier `explain -o` wrote it, instead of the rig file's nominal one.
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Look for the effects of this file too (docs/effects.md); may be given several times.
    #[arg(long, value_name = "FILE.toml")]
    effects: Vec<PathBuf>,
    /// Write the model with its effects here.
    #[arg(short, value_name = "MODEL.toml")]
    output: Option<PathBuf>,
    /// Write everything that is needed to audit and repeat the answer here, as JSON.
    #[arg(long, value_name = "FILE")]
    ledger: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// What an explanation needs beside the records.
pub struct Ready {
    rig: Rig,
    settings: Settings,
}

/// Reads what is the same for every record.
fn prepare(arguments: &Arguments, mut rig: Rig) -> Result<Ready> {
    for file in &arguments.effects {
        rig.add_effects(file)?;
    }
    for h in &arguments.forecast {
        if !(h.is_finite() && *h > 0.0 && *h <= 1e4) {
            return Err(BadInput::new(h.to_string(), "seconds above 0 (at most 10 000)").at("--forecast"));
        }
    }
    let model = arguments.model.as_ref().map(|p| IdentifiedModel::read(p)).transpose()?;
    let settings = Settings {
        horizon_s: arguments.horizon,
        forecast_s: arguments.forecast.clone(),
        weak: arguments.weak.settings(),
        most_effects: arguments.most_effects,
        model,
    };
    Ok(Ready { rig, settings })
}

/// Reads the records and explains them.
fn analyse(arguments: &Arguments, ready: &Ready) -> Result<Analysed<Explanation>> {
    let records = arguments.records.read_for(&ready.rig)?;
    let result = explain(&records, &ready.rig, &ready.settings);
    Ok(Analysed { records, result })
}

/// What makes the answer negative.
fn judge(arguments: &Arguments, result: &Explanation, lost: u64) -> Judgement {
    if result.verdict == Verdict::NotDecidable {
        // The answer itself says why.
        return Judgement::negative(None);
    }
    Judgement::of(&result.warnings).and(arguments.records.judge(lost))
}

/// Reads, explains, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, files) = arguments.records.begin(&arguments.rig, &arguments.out, Some(arguments.replace))?;
    files
        .reads(&arguments.model)
        .result("-o", arguments.output.as_ref())
        .result("--ledger", arguments.ledger.as_ref())
        .check()?;
    let ready = prepare(arguments, rig)?;
    let analysed = progress::during("looking for the effect that is missing", || analyse(arguments, &ready))?;
    let lost = analysed.lost();
    let Analysed { records, result } = analysed;
    let Ready { rig, settings } = ready;
    let result = match result {
        Ok(result) => result,
        Err(error) => return arguments.records.failed(&records, error, &arguments.out),
    };
    print_warnings(&result.warnings);
    arguments.out.write_json(&result)?;
    let card = card(&result, &rig);
    arguments.out.say(&presentation::human(&result, &card));
    if let (Some(path), Some(model)) = (&arguments.output, &result.model) {
        model.write(path)?;
    }
    if let Some(path) = &arguments.ledger {
        let text = format!("{:#}\n", ledger::ledger(&records, &rig, &settings, &result));
        write_file(path, text.as_bytes())?;
    }
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        let mut results = Results::new();
        let provenance = Provenance::of(&command_line()).with("rig file", rig.path.display());
        let provenance = arguments.model.iter().fold(provenance, |all, m| all.with("model file", m.display()));
        results
            .add(card)
            .add(Warnings { warnings: result.warnings.clone() })
            .add(result.clone())
            .add(provenance.records(&records));
        Report::of(format!("Explanation: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    Ok(judge(arguments, &result, lost).tell())
}

impl Single for Arguments {
    const NAME: &'static str = "explain";
    type Ready = Ready;
    type Result = Explanation;

    fn parts(&self) -> Parts<'_> {
        Parts { records: &self.records, rig: &self.rig, out: &self.out, replace: self.replace }
    }

    fn records_mut(&mut self) -> &mut Records {
        &mut self.records
    }

    fn one_each(&self) -> Option<&'static str> {
        self.output.as_ref().map(|_| "-o").or(self.ledger.as_ref().map(|_| "--ledger"))
    }

    fn reads(&self) -> Vec<PathBuf> {
        self.effects.iter().chain(&self.model).cloned().collect()
    }

    fn prepare(&self, rig: Rig) -> Result<Ready> {
        prepare(self, rig)
    }

    fn analyse(&self, ready: &Ready) -> Result<Analysed<Explanation>> {
        analyse(self, ready)
    }

    fn judge(&self, result: &Explanation, lost: u64) -> Judgement {
        judge(self, result, lost)
    }

    fn cells(row: &mut Row, result: &Explanation) -> Vec<Warning> {
        answers::explanation(row, result);
        result.warnings.clone()
    }
}

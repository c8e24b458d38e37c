//! `whirl identify`: parameters with standard errors.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::batch::{Parts, Single};
use super::output::{Output, Replace, command_line, print_warnings};
use super::{Analysed, Answer, Judgement, Records};
use crate::batch::answers;
use crate::batch::row::Row;
use crate::error::{BadInput, Result};
use crate::identify::{
    ERROR_BOUND, Identification, Settings, best::best, card::card, from_rows, harmonic_balance, identify, model_file,
    presentation, shooting,
};
use crate::inspect::{InspectSettings, inspect};
use crate::record::regression_rows::RowsRecord;
use crate::record::{ReadOptions, Record};
use crate::report::card::Card;
use crate::report::format::significant;
use crate::report::sections::provenance::Provenance;
use crate::report::sections::warnings::Warnings;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::warning::Warning;

/// Methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// Weak form.
    Weak,
    /// Multiple-shooting maximum likelihood, started from the weak form.
    Shooting,
    /// Harmonic balance of long pieces.
    Frequency,
    /// Harmonic balance of extracted unstable periodic orbits.
    Upo,
}

/// Choices of the weak form.
#[derive(Clone, Copy, Debug, Args)]
pub struct WeakForm {
    /// Length of a window, s [default: 20 drive periods, or from the motion when free].
    #[arg(long, value_name = "S")]
    window_s: Option<f64>,
    /// Highest frequency of the test functions, Hz [default: 2 f_e, or from the motion when free].
    #[arg(long, value_name = "HZ")]
    max_frequency_hz: Option<f64>,
    /// End of the low-pass's pass band, Hz [default: where the signal sinks into the noise].
    #[arg(long, value_name = "HZ")]
    pass_hz: Option<f64>,
}

impl WeakForm {
    /// As the pipeline takes them.
    pub fn settings(&self) -> Settings {
        Settings { window_s: self.window_s, max_frequency_hz: self.max_frequency_hz, pass_hz: self.pass_hz }
    }
}

/// Arguments of `identify`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Rig file (`whirl init` writes one from a record).
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Method [default: shooting where it stands, otherwise weak].
    #[arg(long, value_enum)]
    method: Option<Method>,
    #[command(flatten)]
    weak: WeakForm,
    /// Length of the pieces of multiple shooting, s [default: 4 drive periods, a fifth of a window when free].
    #[arg(long, value_name = "S")]
    segment_s: Option<f64>,
    /// Bounds of a parameter in multiple shooting, such as C11=0:1 (either side may be left out).
    #[arg(long, value_name = "NAME=LOW:HIGH", value_parser = bound)]
    bound: Vec<(String, f64, f64)>,
    /// The identified model, for `validate` and `explain`.
    #[arg(short, long, value_name = "MODEL.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    balance: super::identify_balance::BalanceArguments,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// NAME=LOW:HIGH.
fn bound(text: &str) -> std::result::Result<(String, f64, f64), String> {
    let expected = || format!("\"{text}\" is not NAME=LOW:HIGH, such as C11=0:1");
    let (name, range) = text.split_once('=').ok_or_else(expected)?;
    let (low, high) = range.split_once(':').ok_or_else(expected)?;
    let side = |s: &str, open: f64| if s.is_empty() { Ok(open) } else { s.parse::<f64>().map_err(|_| expected()) };
    let (low, high) = (side(low, f64::NEG_INFINITY)?, side(high, f64::INFINITY)?);
    if low <= high { Ok((name.to_owned(), low, high)) } else { Err(format!("{low} is not below {high}")) }
}

/// The answer for people: its card first, then what it rests on.
pub fn human(result: &Identification, card: &Card) -> String {
    let mut text = card.text();
    let r = &result.record;
    let _ = writeln!(
        text,
        "\nWhat it rests on\n{} of {} samples in {} unbroken stretch{}{}",
        crate::identify::presentation::method_name(&result.method),
        r.samples,
        r.segments,
        if r.segments == 1 { "" } else { "es" },
        if r.lost > 0 { format!(", {} lost", r.lost) } else { String::new() }
    );
    let _ = writeln!(text, "{}", presentation::error(result));
    if let Some(s) = &result.shooting {
        let ratios: Vec<String> = s.noise_ratio.iter().map(|r| significant(*r, 3)).collect();
        let _ = writeln!(
            text,
            "{} piece{} of {} s; what the fit leaves is {} times the sensors' noise",
            s.pieces,
            if s.pieces == 1 { "" } else { "s" },
            s.levels_s.last().map_or_else(String::new, |l| significant(*l, 3)),
            ratios.join(" and ")
        );
    }
    if let Some(why) = &result.not_by_shooting {
        let _ = writeln!(text, "Multiple shooting was not used: {why}");
    }
    if let Some(i) = &result.details.instruments {
        let _ = writeln!(text, "{}", presentation::instruments(i));
    }
    if let Some(account) = &result.balance {
        text.push_str(&super::identify_balance::human(account));
    }
    text
}

/// Identifies from regression rows alone.
fn of_rows(arguments: &Arguments, rig: &Rig, records: &[RowsRecord]) -> Result<Identification> {
    let options = [
        ("--window-s", arguments.weak.window_s),
        ("--max-frequency-hz", arguments.weak.max_frequency_hz),
        ("--pass-hz", arguments.weak.pass_hz),
        ("--segment-s", arguments.segment_s),
    ];
    if let Some((option, value)) = options.iter().find_map(|(option, value)| Some((option, (*value)?))) {
        return Err(BadInput::new(value.to_string(), "nothing: rows are summed already")
            .at(*option)
            .remedy("Leave the option out"));
    }
    if !matches!(arguments.method, None | Some(Method::Weak))
        || !arguments.bound.is_empty()
        || arguments.records.resample
    {
        return Err(BadInput::new(
            "a method that needs samples, or an option of it",
            "--method weak: these are rows of the weak form",
        )
        .at("--method")
        .remedy("Capture samples: leave --rows out"));
    }
    from_rows::identify(records, rig)
}

/// Identifies by the method asked for.
fn by_method(arguments: &Arguments, records: &[Record], rig: &Rig, settings: &Settings) -> Result<Identification> {
    let choices = shooting::Settings { segment_s: arguments.segment_s, bounds: arguments.bound.clone() };
    let bar = super::progress::bar("multiple shooting", 1);
    // What only shooting heeds asks for it.
    let asked = arguments.segment_s.is_some() || !arguments.bound.is_empty();
    match arguments.method.or(asked.then_some(Method::Shooting)) {
        None => best(records, rig, settings, &choices, &bar),
        Some(Method::Weak) => identify(records, rig, settings),
        Some(Method::Shooting) => shooting::identify(records, rig, settings, &choices, &bar),
        Some(method @ (Method::Frequency | Method::Upo)) => {
            let longest = records.iter().map(|r| r.longest_segment_s()).fold(0.0, f64::max);
            let periods = longest * rig.drive.map_or(0.0, |d| d.frequency_hz);
            let settings = arguments.balance.settings(rig, method == Method::Upo, periods)?;
            harmonic_balance::identify(records, rig, &settings)
        }
    }
}

/// Reads and identifies.
fn analyse(arguments: &Arguments, rig: &Rig) -> Result<Analysed<Identification>> {
    let options = ReadOptions { recover: arguments.records.recover, ..ReadOptions::default() };
    if let Some(rows) = from_rows::read(&arguments.records.records, &options)? {
        return Ok(Analysed { records: Vec::new(), result: of_rows(arguments, rig, &rows) });
    }
    let records = arguments.records.read_for(rig)?;
    let result = by_method(arguments, &records, rig, &arguments.weak.settings());
    Ok(Analysed { records, result })
}

/// What makes the answer negative.
fn judge(arguments: &Arguments, result: &Identification, lost: u64) -> Judgement {
    if !result.within_bound() {
        let bound = 100.0 * ERROR_BOUND;
        return Judgement::negative(Some(format!("the identification error exceeds its bound of {bound:.0} %")));
    }
    Judgement::of(&result.warnings).and(arguments.records.judge(lost))
}

/// Reads, identifies, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, files) = arguments.records.begin(&arguments.rig, &arguments.out, Some(arguments.replace))?;
    files.result("-o", arguments.output.as_ref()).check()?;
    let analysed = analyse(arguments, &rig)?;
    let lost = analysed.lost();
    let Analysed { records, result } = analysed;
    let result = match result {
        Ok(result) => result,
        Err(error) => return arguments.records.failed(&records, error, &arguments.out),
    };
    print_warnings(&result.warnings);
    arguments.out.write_json(&result)?;
    let card = card(&result, &rig);
    arguments.out.say(&human(&result, &card));
    if let Some(path) = &arguments.output {
        model_file::identified_model(&result, &rig)?.write(path)?;
    }
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = arguments.records.records.iter().map(|p| p.display().to_string()).collect();
        let mut results = Results::new();
        results.add(card).add(presentation::table(&result, "", &|_| None)).add(presentation::residuals(&result));
        results.add(Warnings { warnings: result.warnings.clone() });
        results.add(Provenance::of(&command_line()).with("rig file", rig.path.display()).records(&records));
        // A report of an identification also shows what was identified from.
        for record in &records {
            results.add(inspect(record, &rig, &InspectSettings::default())?);
        }
        Report::of(format!("Identification: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    let lost = if records.is_empty() { result.record.lost } else { lost };
    Ok(judge(arguments, &result, lost).tell())
}

impl Single for Arguments {
    const NAME: &'static str = "identify";
    type Ready = Rig;
    type Result = Identification;

    fn parts(&self) -> Parts<'_> {
        Parts { records: &self.records, rig: &self.rig, out: &self.out, replace: self.replace }
    }

    fn records_mut(&mut self) -> &mut Records {
        &mut self.records
    }

    fn one_each(&self) -> Option<&'static str> {
        self.output.as_ref().map(|_| "-o")
    }

    fn prepare(&self, rig: Rig) -> Result<Rig> {
        Ok(rig)
    }

    fn analyse(&self, rig: &Rig) -> Result<Analysed<Identification>> {
        analyse(self, rig)
    }

    fn judge(&self, result: &Identification, lost: u64) -> Judgement {
        judge(self, result, lost.max(result.record.lost))
    }

    fn cells(row: &mut Row, result: &Identification) -> Vec<Warning> {
        answers::identification(row, result);
        result.warnings.clone()
    }
}

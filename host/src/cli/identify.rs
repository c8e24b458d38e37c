//! `whirl identify`: parameters with standard errors.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::Judgement;
use super::single::{Analysed, Common, Named, Single};
use crate::batch::answers;
use crate::batch::row::Row;
use crate::error::{BadInput, Result};
use crate::identify::shooting::zeros::IDENTIFIED;
use crate::identify::{
    Identification, Settings, best::best, card::card, from_rows, harmonic_balance, identify, model_file, presentation,
    shooting, slips,
};
use crate::inspect::{InspectSettings, inspect};
use crate::record::regression_rows::RowsRecord;
use crate::record::{ReadOptions, Record};
use crate::report::Results;
use crate::report::card::Card;
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::{Z95, count, plus_minus, significant};

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

impl Method {
    /// As it is named on the command line.
    fn id(self) -> &'static str {
        match self {
            Self::Weak => "weak",
            Self::Shooting => "shooting",
            Self::Frequency => "frequency",
            Self::Upo => "upo",
        }
    }
}

/// Choices of the weak form.
#[derive(Clone, Copy, Debug, Args)]
pub struct WeakForm {
    /// Length of a window, s [default: 20 drive periods, or 10 of the motion when free].
    #[arg(long, value_name = "S")]
    window_s: Option<f64>,
    /// Highest frequency of the test functions, Hz [default: twice the drive's, or from
    /// the motion when free].
    #[arg(long, value_name = "HZ")]
    max_frequency_hz: Option<f64>,
    /// End of the low-pass's pass band, Hz [default: 1.15 times where the signal sinks into the noise].
    #[arg(long, value_name = "HZ")]
    pass_hz: Option<f64>,
}

impl WeakForm {
    /// As the pipeline takes them.
    pub fn settings(&self) -> Settings {
        let Self { window_s, max_frequency_hz, pass_hz } = *self;
        Settings { window_s, max_frequency_hz, pass_hz, ..Settings::default() }
    }
}

/// Arguments of `identify`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Method [default: shooting where it stands, otherwise weak].
    #[arg(long, value_enum)]
    method: Option<Method>,
    #[command(flatten)]
    weak: WeakForm,
    /// Length of the pieces of multiple shooting, s [default: 4 drive periods, a fifth of a window
    /// when free].
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
}

impl Arguments {
    /// Refuses an option that the method asked for does not read: it would change nothing, whatever
    /// it says.
    fn check_options(&self) -> Result<()> {
        let weak = [
            ("--window-s", self.weak.window_s.is_some()),
            ("--max-frequency-hz", self.weak.max_frequency_hz.is_some()),
            ("--pass-hz", self.weak.pass_hz.is_some()),
        ];
        let shooting = [("--segment-s", self.segment_s.is_some()), ("--bound", !self.bound.is_empty())];
        let given = |list: &[(&'static str, bool)], of: &[Method]| -> Vec<(&'static str, Vec<Method>)> {
            list.iter().filter(|o| o.1).map(|o| (o.0, of.to_vec())).collect()
        };
        let balance = self.balance.given().into_iter().map(|(option, [pieces, orbits])| {
            let of = [(pieces, Method::Frequency), (orbits, Method::Upo)];
            (option, of.iter().filter(|m| m.0).map(|m| m.1).collect())
        });
        // Shooting starts from the weak form.
        let mut all = given(&weak, &[Method::Weak, Method::Shooting]);
        all.extend(given(&shooting, &[Method::Shooting]).into_iter().chain(balance));
        let reads = |of: &[Method]| match self.method {
            Some(method) => of.contains(&method),
            None => of.contains(&Method::Shooting),
        };
        let Some((option, of)) = all.into_iter().find(|(_, of)| !reads(of)) else { return Ok(()) };
        let names: Vec<&str> = of.iter().map(|m| m.id()).collect();
        let methods = format!("--method {}", names.join(" or "));
        let asked = self.method.map_or_else(
            || "no --method, which takes shooting or the weak form".to_owned(),
            |m| format!("--method {}", m.id()),
        );
        Err(BadInput::new(asked, format!("{methods}, which alone reads this option"))
            .at(option)
            .remedy(format!("Leave the option out, or say {methods}")))
    }
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
        count(r.samples as u64),
        r.segments,
        if r.segments == 1 { "" } else { "es" },
        if r.lost > 0 { format!(", {} lost", count(r.lost)) } else { String::new() }
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
    let zeros = result.zeros.iter().filter(|z| z.from == IDENTIFIED).map(|z| {
        let degrees = plus_minus(z.value.to_degrees(), (Z95 * z.std_error).to_degrees());
        format!(
            "{} {degrees}°{}",
            z.channel,
            if z.record > 1 { format!(" in record {}", z.record) } else { String::new() }
        )
    });
    let zeros: Vec<String> = zeros.collect();
    if !zeros.is_empty() {
        let _ = writeln!(text, "Zeros found with them, and taken off: {} (95 %)", zeros.join(", "));
    }
    if let Some(why) = &result.not_by_shooting {
        // What a warning says stands above.
        let is_said = result.warnings.iter().any(|w| w.text == *why);
        let why = if is_said { "the weak form's answer cannot stand, for the reason above" } else { why };
        let _ = writeln!(text, "Multiple shooting was not used: {why}");
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
        || arguments.common.records.resample
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
    let choices = shooting::Settings {
        segment_s: arguments.segment_s,
        bounds: arguments.bound.clone(),
        ..shooting::Settings::default()
    };
    let bar = super::progress::bar("multiple shooting", 1);
    // What only shooting heeds asks for it.
    let asked = arguments.segment_s.is_some() || !arguments.bound.is_empty();
    match arguments.method.or(asked.then_some(Method::Shooting)) {
        None => best(records, rig, settings, &choices, &bar),
        Some(Method::Weak) => identify(records, rig, settings),
        Some(Method::Shooting) => {
            let shoot = |records: &[Record]| shooting::identify(records, rig, settings, &choices, &bar);
            slips::without(records, shoot).map(|found| found.0)
        }
        Some(method @ (Method::Frequency | Method::Upo)) => {
            let longest = records.iter().map(|r| r.longest_segment_s()).fold(0.0, f64::max);
            let periods = longest * rig.drive.map_or(0.0, |d| d.frequency_hz);
            let settings = arguments.balance.settings(rig, method == Method::Upo, periods)?;
            harmonic_balance::identify(records, rig, &settings)
        }
    }
}

impl AsRef<Self> for Rig {
    fn as_ref(&self) -> &Self {
        self
    }
}

impl Single for Arguments {
    const NAME: &'static str = "identify";
    const HEADING: &'static str = "Identification";
    type Ready = Rig;
    type Result = Identification;

    fn common(&self) -> &Common {
        &self.common
    }

    fn common_mut(&mut self) -> &mut Common {
        &mut self.common
    }

    fn writes(&self) -> Vec<Named<'_>> {
        self.output.iter().map(|path| ("-o", path.as_path())).collect()
    }

    fn prepare(&self, rig: Rig) -> Result<Rig> {
        self.check_options().map(|()| rig)
    }

    fn analyse(&self, rig: &Rig) -> Result<Analysed<Identification>> {
        let asked = &self.common.records;
        let options = ReadOptions { recover: asked.recover, ..ReadOptions::default() };
        if let Some(rows) = from_rows::read(&asked.records, &options)? {
            return Ok(Analysed { records: Vec::new(), result: of_rows(self, rig, &rows) });
        }
        let records = asked.read_for(rig)?;
        let result = by_method(self, &records, rig, &self.weak.settings());
        Ok(Analysed { records, result })
    }

    fn warnings(result: &Identification) -> &[Warning] {
        &result.warnings
    }

    fn judge(&self, result: &Identification, lost: u64) -> Judgement {
        if !result.within_bound() {
            let bound = presentation::bounds(result);
            return Judgement::negative(Some(format!("the identification error exceeds its bound of {bound}")));
        }
        // Rows tell themselves what is missing.
        self.stands(result, lost.max(result.record.lost))
    }

    fn card(rig: &Rig, result: &Identification) -> Card {
        card(result, rig)
    }

    fn human(result: &Identification, card: &Card) -> String {
        human(result, card)
    }

    fn write(&self, rig: &Rig, _records: &[Record], result: &Identification) -> Result<()> {
        let Some(path) = &self.output else { return Ok(()) };
        model_file::identified_model(result, rig)?.write(path)
    }

    /// A report of an identification also shows what was identified from.
    fn show(rig: &Rig, records: &[Record], result: &Identification, into: &mut Results) -> Result<()> {
        into.add(presentation::table(result, "", &|_| None)).add(presentation::residuals(result));
        for record in records {
            into.add(inspect(record, rig, &InspectSettings::default())?);
        }
        Ok(())
    }

    fn cells(row: &mut Row, result: &Identification) {
        answers::identification(row, result);
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn checked(options: &str) -> std::result::Result<(), String> {
        let line = format!("identify r.csv --rig rig.toml {options}");
        let line = Line::try_parse_from(line.split_whitespace()).map_err(|e| e.to_string())?;
        line.arguments.check_options().map_err(|e| e.to_string())
    }

    #[test]
    fn an_option_that_the_method_does_not_read_is_refused() {
        for options in [
            "",
            "--window-s 2 --pass-hz 30 --segment-s 1 --bound C11=0:1",
            "--method weak --window-s 2",
            "--method shooting --window-s 2 --bound C11=0:1",
            "--method frequency --piece-periods 60 --differentiation five-point --energy-balance",
            "--method upo --tolerance 0.05 --longest-period 16 --delay 24 --known-coefficient C2=0.04",
        ] {
            assert_eq!(checked(options), Ok(()), "{options}");
        }
        for (options, parts) in [
            ("--method weak --bound nonsense=0:1", ["--bound: found --method weak", "say --method shooting"]),
            ("--method weak --segment-s 3", ["--segment-s: found --method weak", "--method shooting, which alone"]),
            ("--method weak --known-coefficient c=1", ["--known-coefficient", "say --method frequency or upo"]),
            ("--method frequency --bound C11=5:6", ["--bound: found --method frequency", "say --method shooting"]),
            ("--method frequency --delay 3", ["--delay", "say --method upo"]),
            ("--method upo --piece-periods 0", ["--piece-periods: found --method upo", "say --method frequency"]),
            ("--method upo --window-s 3", ["--window-s", "say --method weak or shooting"]),
            ("--beta 0.05", ["--beta: found no --method", "say --method frequency or upo"]),
        ] {
            let e = checked(options).unwrap_err();
            assert!(parts.iter().all(|part| e.contains(part)), "{options}: {e}");
        }
    }
}

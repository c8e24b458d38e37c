//! `whirl identify`: parameters with standard errors.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::output::{Output, print_warnings};
use super::{Answer, Records};
use crate::error::Result;
use crate::identify::{ERROR_BOUND, Identification, Settings, harmonic_balance, identify, model_file, presentation};
use crate::inspect::{InspectSettings, inspect};
use crate::report::format::plus_minus;
use crate::report::{Report, Results};

/// Methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// Weak form.
    #[default]
    Weak,
    /// Harmonic balance of long pieces (chapter 4).
    Frequency,
    /// Harmonic balance of extracted unstable periodic orbits (chapters 2 and 3).
    Upo,
}

/// Arguments of `identify`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Method.
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Length of a window, s [default: 20 drive periods, or 4 s when free].
    #[arg(long, value_name = "S")]
    window_s: Option<f64>,
    /// Highest frequency of the test functions, Hz [default: 2 f_e, or the acceleration's 99 % when free].
    #[arg(long, value_name = "HZ")]
    max_frequency_hz: Option<f64>,
    /// End of the low-pass's pass band, Hz [default: where the signal sinks into the noise].
    #[arg(long, value_name = "HZ")]
    pass_hz: Option<f64>,
    /// The identified model, for `validate` and `explain`.
    #[arg(short, long, value_name = "MODEL.toml")]
    output: Option<PathBuf>,
    #[command(flatten)]
    balance: super::identify_balance::BalanceArguments,
    #[command(flatten)]
    out: Output,
}

/// The answer for people.
pub fn human(result: &Identification) -> String {
    let mut text = String::new();
    let r = &result.record;
    let _ = writeln!(
        text,
        "{} by {} from {} samples in {} stretch{}{}",
        result.model,
        crate::identify::presentation::method_name(&result.method),
        r.samples,
        r.segments,
        if r.segments == 1 { "" } else { "es" },
        if r.lost > 0 { format!(", {} lost", r.lost) } else { String::new() }
    );
    for p in &result.parameters {
        let unit = if p.unit == "1" { "" } else { &p.unit };
        let _ = writeln!(text, "  {:<7} {} {unit}", p.name, plus_minus(p.value, 1.96 * p.std_error));
    }
    let errors: Vec<String> = result.identification_error.iter().map(|e| format!("{:.2} %", 100.0 * e)).collect();
    let _ = writeln!(
        text,
        "identification error {} (bound {:.0} %); ± is 1.96 standard errors",
        errors.join(", "),
        100.0 * ERROR_BOUND
    );
    if let Some(i) = &result.details.instruments {
        let _ = writeln!(text, "{}", presentation::instruments(i));
    }
    if let Some(account) = &result.balance {
        text.push_str(&super::identify_balance::human(account));
    }
    for group in &result.groups_not_separable {
        let _ = writeln!(text, "not told apart or not determined by this record: {}", group.join(", "));
    }
    text
}

/// Reads, identifies, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, records) = arguments.records.read()?;
    let settings = Settings {
        window_s: arguments.window_s,
        max_frequency_hz: arguments.max_frequency_hz,
        pass_hz: arguments.pass_hz,
    };
    let result = match arguments.method {
        Method::Weak => identify(&records, &rig, &settings)?,
        Method::Frequency | Method::Upo => {
            let longest = records.iter().map(|r| r.longest_segment_s()).fold(0.0, f64::max);
            let periods = longest * rig.drive.map_or(0.0, |d| d.frequency_hz);
            let settings = arguments.balance.settings(&rig, arguments.method == Method::Upo, periods)?;
            harmonic_balance::identify(&records, &rig, &settings)?
        }
    };
    print_warnings(&result.warnings);
    arguments.out.write_json(&result)?;
    arguments.out.say(&human(&result));
    if let Some(path) = &arguments.output {
        model_file::identified_model(&result, &rig)?.write(path)?;
    }
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        let mut results = Results::new();
        results.add(presentation::table(&result, "", &|_| None)).add(presentation::residuals(&result));
        // A report of an identification also shows what was identified from.
        for record in &records {
            results.add(inspect(record, &rig, &InspectSettings::default())?);
        }
        Report::of(format!("Identification: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    if !result.within_bound() {
        eprintln!("whirl: the identification error exceeds its bound of {:.0} %", 100.0 * ERROR_BOUND);
        return Ok(Answer::Negative);
    }
    Ok(arguments.records.answer(&records))
}

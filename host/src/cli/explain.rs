//! `whirl explain`: where simulation and measurement disagree, which effect is missing, the gap before and after.

use clap::Args;

use super::output::{Output, print_warnings};
use super::{Answer, Records};
use crate::error::Result;
use crate::explain::{Settings, Verdict, explain, presentation};
use crate::report::{Report, Results};

/// Arguments of `explain`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Horizon of the gap, s [default: one drive period, 0.2 s when free].
    #[arg(long, value_name = "S")]
    horizon: Option<f64>,
    #[command(flatten)]
    out: Output,
}

/// Reads, explains, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, records) = arguments.records.read()?;
    let result = explain(&records, &rig, &Settings { horizon_s: arguments.horizon })?;
    print_warnings(&result.warnings);
    arguments.out.write_json(&result)?;
    arguments.out.say(&presentation::human(&result));
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        let mut results = Results::new();
        results.add(result.clone());
        Report::of(format!("Explanation: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    if result.verdict == Verdict::NotDecidable {
        return Ok(Answer::Negative);
    }
    Ok(arguments.records.answer(&records))
}

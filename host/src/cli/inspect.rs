//! `whirl inspect`: rates, losses, spectra, phase portraits, periodicity of a record.

use std::fmt::Write;
use std::path::Path;

use clap::Args;

use super::output::{Output, print_warnings};
use super::{Answer, Records};
use crate::error::Result;
use crate::inspect::{InspectSettings, Inspection, inspect};
use crate::record::Record;
use crate::record::formats::ReadOptions;
use crate::report::format::{duration, significant};
use crate::report::{Report, Results};
use crate::rig::Rig;

/// Arguments of `inspect`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    #[command(flatten)]
    out: Output,
}

/// The answer for people.
pub fn human(i: &Inspection) -> String {
    let mut text = String::new();
    let r = &i.record;
    let _ = writeln!(
        text,
        "{}: {} samples at {} Hz over {}, {} lost, {} unbroken stretch{}",
        r.file,
        r.samples,
        significant(r.sample_rate_hz, 6),
        duration(r.duration_s),
        r.lost,
        r.segments,
        if r.segments == 1 { "" } else { "es" }
    );
    for c in &i.coordinates {
        let turns = c.turns_per_period.or(c.turns);
        let what = if c.turns_per_period.is_some() { "turns a drive period" } else { "turns in all" };
        let _ = writeln!(
            text,
            "  {:<7} rms speed {} {}/s, noise {} {}{}",
            c.name,
            significant(c.rms_speed, 3),
            c.unit,
            significant(c.noise, 2),
            c.unit,
            turns.map_or_else(String::new, |t| format!(", {} {what}", significant(t, 3)))
        );
        if let Some(s) = &c.spectrum {
            let lines: Vec<String> = s
                .lines
                .iter()
                .take(4)
                .map(|l| {
                    format!(
                        "{} Hz{}",
                        significant(l.frequency_hz, 4),
                        l.name.as_ref().map_or_else(String::new, |n| format!(" ({n})"))
                    )
                })
                .collect();
            if !lines.is_empty() {
                let _ = writeln!(text, "          lines of the {}: {}", s.of, lines.join(", "));
            }
        }
    }
    let _ = writeln!(text, "{}", i.periodicity.sentence());
    text
}

/// Writes the inspection report of one record.
///
/// # Errors
/// A record that cannot be read or inspected, a file that cannot be written.
pub fn report_of(record: &Path, rig: &Rig, report: &Path) -> Result<()> {
    let read = Record::read(record, rig, &ReadOptions::default())?;
    let mut results = Results::new();
    results.add(inspect(&read, rig, &InspectSettings::default())?);
    Report::of(format!("Inspection: {}", rig.name), record.display().to_string(), &results).write(report)
}

/// Reads, inspects, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, records) = arguments.records.read()?;
    let inspections: Vec<Inspection> =
        records.iter().map(|r| inspect(r, &rig, &InspectSettings::default())).collect::<Result<_>>()?;
    let mut results = Results::new();
    let mut text = String::new();
    for i in &inspections {
        print_warnings(&i.warnings);
        text.push_str(&human(i));
        results.add(i.clone());
    }
    // One record, one object; several, a list of them.
    match &inspections[..] {
        [one] => arguments.out.write_json(one)?,
        several => arguments.out.write_json(&several)?,
    }
    arguments.out.say(&text);
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        Report::of(format!("Inspection: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    Ok(arguments.records.answer(&records))
}

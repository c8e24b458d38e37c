//! `whirl init`: a commented rig file from what a record shows.

use std::path::PathBuf;

use clap::Args;

use super::output::{Output, Replace, print_warnings};
use super::outputs::Outputs;
use super::{Answer, Columns};
use crate::error::Result;
use crate::files::write_file;
use crate::init::{Settings, draft, garbled_names, write};
use crate::record::formats;
use crate::record::names::find;
use crate::record::{ReadOptions, Record, has_footer};
use crate::rig::computed::sources;
use crate::warning::Warning;
use crate::wording::format::shell_word;

/// Arguments of `init`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Records of one rig; the first is looked at, the others must have its columns.
    #[arg(required = true, value_name = "REC")]
    records: Vec<PathBuf>,
    /// The system: `whirl list models`, or a model file [default: by the number of angles, one or
    /// two].
    #[arg(long, value_name = "NAME|FILE")]
    system: Option<String>,
    /// The drive's frequency, where you know it; 0: nothing drives the rig [default: from the
    /// motion].
    #[arg(long, value_name = "HZ")]
    drive_hz: Option<f64>,
    #[command(flatten)]
    columns: Columns,
    /// The rig file that is written.
    #[arg(short, long, value_name = "RIG.toml")]
    output: PathBuf,
    /// Read what is whole of a truncated or damaged file.
    #[arg(long)]
    recover: bool,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// Looks at the record, writes the rig file.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    arguments.out.tell_no_report("a rig file", "`whirl inspect` writes one of the record");
    Outputs::of(&arguments.out, Some(arguments.replace))
        .reads(&arguments.records)
        .record("-o", &arguments.output)
        .check()?;
    let settings = Settings {
        system: arguments.system.clone(),
        choices: arguments.columns.choices(),
        drive_hz: arguments.drive_hz,
        options: ReadOptions { recover: arguments.recover, resample: false },
        output: arguments.output.clone(),
        needs_system: true,
    };
    let first = &arguments.records[0];
    let mut warnings: Vec<Warning> = garbled_names(first).into_iter().collect();
    print_warnings(&warnings);
    let draft = draft(first, &settings)?;
    if draft.stored.is_some() && !has_footer(first) {
        // Its head tells the rig; without --recover it is refused as by every command.
        let read = Record::read(first, &draft.rig()?, &settings.options)?;
        print_warnings(&read.warnings);
        warnings.extend(read.warnings);
    }
    for other in &arguments.records[1..] {
        let names: Vec<String> = formats::columns(other, &draft.time)?.into_iter().map(|l| l.name).collect();
        for c in &sources(&draft.rig()?.channel, &arguments.output)?.columns {
            find(&names, &c.name, other)?;
        }
    }
    // What is written must be a rig file.
    draft.rig()?;
    write_file(&arguments.output, write::text(&draft).as_bytes())?;
    let checks = draft.statements().iter().filter(|s| s.check).count();
    let result = serde_json::json!({ "rig": arguments.output, "draft": draft, "to_check": checks });
    arguments.out.write_json_with(&result, &warnings)?;
    arguments.out.say(&write::human(&draft));
    let word = |path: &std::path::Path| shell_word(&path.display().to_string());
    let (record, rig) = (word(first), word(&arguments.output));
    arguments.out.say(&format!(
        "{rig} is written. Next: whirl inspect {record} --rig {rig}, then whirl identify {record} --rig {rig}\n"
    ));
    Ok(Answer::Positive)
}

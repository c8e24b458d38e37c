//! `whirl reproduce`: the seed's tables and figures, printed, reproduced and true values side by
//! side.

use clap::Args;
use serde::Serialize;

use super::Answer;
use super::output::{Output, Replace};
use super::outputs::Outputs;
use crate::error::Result;
use crate::report::{Report, Section};
use crate::reproduce::{Reproduction, by_id, items};

/// Arguments of `reproduce`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Tables and figures, such as table-5.1 or figure-5.13 [default: all].
    #[arg(value_name = "ID")]
    ids: Vec<String>,
    /// Lists what can be reproduced.
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    out: Output,
}

/// What can be reproduced.
#[derive(Serialize)]
struct Listed {
    id: &'static str,
    about: &'static str,
}

/// Reproduces, prints, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    Outputs::of(&arguments.out, Some(arguments.replace)).check()?;
    if arguments.list {
        arguments.out.tell_no_report("a list", "`whirl reproduce ID` writes one");
        let listed: Vec<Listed> = items().map(|item| Listed { id: item.id, about: item.about }).collect();
        arguments.out.write_json_list(&listed)?;
        listed.iter().for_each(|item| arguments.out.say(&format!("{} {}\n", item.id, item.about)));
        return Ok(Answer::Positive);
    }
    let chosen = if arguments.ids.is_empty() {
        items().collect()
    } else {
        arguments.ids.iter().map(|id| by_id(id)).collect::<Result<Vec<_>>>()?
    };
    let mut done: Vec<Reproduction> = Vec::with_capacity(chosen.len());
    let all = chosen.len();
    for (i, item) in chosen.into_iter().enumerate() {
        let what = format!("reproducing {} ({} of {all})", item.id, i + 1);
        let r = super::progress::during(what, item.run)?;
        arguments.out.say(&r.text());
        done.push(r);
    }
    if let Some(path) = &arguments.out.report {
        let mut report =
            Report::new("Reproduction", "the dissertation's tables and figures: printed, reproduced, true");
        for r in &done {
            report.push(Section { id: r.id.replace('.', "-"), title: r.id.replace('-', " "), body: r.html() });
        }
        report.write(path)?;
    }
    arguments.out.write_json_list(&done)?;
    Ok(Answer::Positive)
}

//! `whirl batch merge`.

use std::path::PathBuf;

use clap::Args;

use super::page::Summary;
use crate::batch::merge::merge;
use crate::batch::table::{Layout, Table};
use crate::cli::Answer;
use crate::cli::output::{Output, Replace};
use crate::cli::outputs::Outputs;
use crate::error::{Result, tell};
use crate::files::write_file;

/// Arguments of `batch merge`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Tables of shards, in any order.
    #[arg(required = true, value_name = "TABLE")]
    tables: Vec<PathBuf>,
    /// Table of all their rows.
    #[arg(long, value_name = "TABLE.parquet|.csv")]
    out: PathBuf,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    output: Output,
}

/// Reads, merges, writes. The exit status is that of the one run whose table it is: 0 where every
/// row's is 0 and none is missing.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let layout = Layout::of(&arguments.out)?;
    Outputs::of(&arguments.output, Some(arguments.replace))
        .reads(&arguments.tables)
        .table_of_rows("--out", &arguments.out)
        .check()?;
    let tables = arguments.tables.iter().map(|path| Ok((path.clone(), Table::read(path)?)));
    let merged = merge(tables.collect::<Result<_>>()?)?;
    let files = merged.table.rows.iter().map(|row| row.text_of("file").to_owned()).collect();
    super::keeps_rows(&arguments.out, &files, arguments.replace.force)?;
    write_file(&arguments.out, &merged.table.bytes(layout)?)?;
    let answer = Summary::of(&merged.table, &arguments.out, merged.of).give(&arguments.output)?;
    if merged.missing.is_empty() {
        return Ok(answer);
    }
    tell(merged.missing_in_words());
    Ok(Answer::Negative)
}

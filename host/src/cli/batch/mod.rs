//! `whirl batch`: a command's answers for many records, one row each, in one table.
//!
//! Each record is answered by what answers the command for it alone; a record that cannot be
//! answered is a row with the message and the exit status that the command would end with.

mod merge;
mod page;
mod run;
mod told;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::{ArgMatches, Args, Subcommand};

use super::{Answer, explain, identify, validate};
use crate::batch::table::Table;
use crate::error::{BadInput, Result};

/// What is done with many records.
#[derive(Debug, Subcommand)]
pub enum What {
    /// Parameters of each record, with standard errors.
    Identify(Of<identify::Arguments>),
    /// The effect that each record shows to be missing.
    Explain(Of<explain::Arguments>),
    /// Whether an identified model moves as each record does.
    Validate(Of<validate::Arguments>),
    /// Tables of shards into one, with the bytes that one run would have given.
    Merge(merge::Arguments),
}

/// A command's own arguments with those of a batch.
#[derive(Debug, Args)]
pub struct Of<A: Args> {
    #[command(flatten)]
    single: A,
    /// Table of all records, one row each; its progress is kept beside it, in TABLE.journal.
    #[arg(long, value_name = "TABLE.parquet|.csv")]
    out: PathBuf,
    /// Go on with a batch that was ended: records that are done and have not changed since are
    /// taken from TABLE.journal.
    #[arg(long)]
    resume: bool,
    /// Take records I, I+N, I+2N, … of the list alone, such as 1/4 to 4/4; `whirl batch merge` puts
    /// their tables together.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<Shard>,
    /// Add a column wall_s, the seconds of work on each record: tables then differ from run to run.
    #[arg(long)]
    timing: bool,
}

/// One part of the records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shard {
    number: usize,
    of: usize,
}

/// I/N.
fn shard(text: &str) -> std::result::Result<Shard, String> {
    let parse = || {
        let (number, of) = text.split_once('/')?;
        Some(Shard { number: number.parse().ok()?, of: of.parse().ok()? })
    };
    let shard = parse().ok_or_else(|| format!("\"{text}\" is not I/N, such as 1/4"))?;
    if (1..=shard.of).contains(&shard.number) {
        return Ok(shard);
    }
    Err(format!(
        "{} is not from 1 to {}: shards are 1/{} to {}/{}",
        shard.number, shard.of, shard.of, shard.of, shard.of
    ))
}

/// Does it.
pub fn run(what: &What, matches: &ArgMatches) -> Result<Answer> {
    let matches = matches.subcommand_matches("batch");
    match what {
        What::Identify(a) => run::run(a, matches),
        What::Explain(a) => run::run(a, matches),
        What::Validate(a) => run::run(a, matches),
        What::Merge(a) => merge::run(a),
    }
}

/// Refuses to lose rows of a table that is there: those of records that are not among `files`. The
/// same records with other options are a result made anew, as of any other command.
fn keeps_rows(table: &Path, files: &BTreeSet<String>, force: bool) -> Result<()> {
    let Some(there) = Some(table).filter(|t| !force && t.exists()).and_then(|t| Table::read(t).ok()) else {
        return Ok(());
    };
    let Some(lost) = there.rows.iter().map(|row| row.text_of("file")).find(|file| !files.contains(*file)) else {
        return Ok(());
    };
    Err(BadInput::new(format!("a table with a row of {lost}, which is not among these records"), "a new table")
        .in_file(table)
        .at("--out")
        .remedy("Name another output, or replace it with --force"))
}

/// The command line without what a single command writes for its one answer: it is refused with a
/// message of its own.
pub fn without_single_outputs(batch: clap::Command) -> clap::Command {
    batch
        .mut_subcommand("identify", |c| c.mut_arg("output", |a| a.hide(true)))
        .mut_subcommand("explain", |c| c.mut_arg("output", |a| a.hide(true)).mut_arg("ledger", |a| a.hide(true)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_counted_from_1() {
        assert_eq!(shard("3/4"), Ok(Shard { number: 3, of: 4 }));
        for wrong in ["0/4", "5/4", "1/0", "1", "a/b", "1/-2"] {
            assert!(shard(wrong).is_err(), "{wrong}");
        }
        assert_eq!(shard("0/4").unwrap_err(), "0 is not from 1 to 4: shards are 1/4 to 4/4");
    }
}

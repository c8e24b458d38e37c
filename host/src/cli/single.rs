//! What `identify`, `explain` and `validate` have in common: records and a rig file go in; an
//! answer for people, JSON, a report and an exit status come out. Each command says what is its own
//! ([`Single`]); `whirl batch` answers for many records by the same parts.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::output::{Output, Replace, command_line, print_warnings};
use super::{Answer, Judgement, Records};
use crate::batch::row::Row;
use crate::error::Result;
use crate::record::Record;
use crate::report::card::Card;
use crate::report::sections::provenance::Provenance;
use crate::report::sections::warnings::Warnings;
use crate::report::{Report, Results};
use crate::rig::Rig;
use crate::warning::Warning;

/// Arguments that all of them have.
#[derive(Clone, Debug, Args)]
pub struct Common {
    #[command(flatten)]
    pub records: Records,
    /// Rig file (`whirl init` writes one from a record).
    #[arg(long, value_name = "RIG.toml")]
    pub rig: PathBuf,
    #[command(flatten)]
    pub replace: Replace,
    #[command(flatten)]
    pub out: Output,
}

/// What became of an analysis of records that could be read: its result, or why there is none.
pub struct Analysed<T> {
    /// The records; none where they hold rows instead of samples.
    pub records: Vec<Record>,
    pub result: Result<T>,
}

impl<T> Analysed<T> {
    /// Missing samples.
    pub fn lost(&self) -> u64 {
        self.records.iter().map(|r| r.losses.lost()).sum()
    }
}

/// A file of a command, with the option or the name that it goes by.
pub type Named<'a> = (&'static str, &'a Path);

/// A command that answers for records of one system.
pub trait Single: Args + Clone + Sync {
    /// Its name.
    const NAME: &'static str;
    /// Heading of its report.
    const HEADING: &'static str;
    /// What is read once for all records.
    type Ready: AsRef<Rig> + Sync;
    /// Its result.
    type Result: Serialize;

    /// What all of them have.
    fn common(&self) -> &Common;
    /// The same, to be changed.
    fn common_mut(&mut self) -> &mut Common;
    /// Files that it writes for its one answer, by their options.
    fn writes(&self) -> Vec<Named<'_>> {
        Vec::new()
    }
    /// Files that it reads beside records and rig, by what they are.
    fn reads(&self) -> Vec<Named<'_>> {
        Vec::new()
    }
    /// The seed of what is drawn at random.
    fn seed(&self) -> Option<u64> {
        None
    }
    /// Reads what is the same for every record.
    fn prepare(&self, rig: Rig) -> Result<Self::Ready>;
    /// Reads the records and analyses them.
    fn analyse(&self, ready: &Self::Ready) -> Result<Analysed<Self::Result>>;
    /// Its warnings.
    fn warnings(result: &Self::Result) -> &[Warning];
    /// What makes the answer negative; so many samples are missing.
    fn judge(&self, result: &Self::Result, lost: u64) -> Judgement {
        self.stands(result, lost)
    }
    /// The answer in one card.
    fn card(ready: &Self::Ready, result: &Self::Result) -> Card;
    /// The answer for people.
    fn human(result: &Self::Result, card: &Card) -> String;
    /// Writes what [`Self::writes`] names.
    fn write(&self, _ready: &Self::Ready, _records: &[Record], _result: &Self::Result) -> Result<()> {
        Ok(())
    }
    /// What its report shows beside card, warnings and provenance.
    fn show(ready: &Self::Ready, records: &[Record], result: &Self::Result, into: &mut Results) -> Result<()>;
    /// Fills its row of a batch.
    fn cells(row: &mut Row, result: &Self::Result);

    /// Negative where a warning says that the answer cannot stand, and under `--strict` where
    /// samples are missing.
    fn stands(&self, result: &Self::Result, lost: u64) -> Judgement {
        Judgement::of(Self::warnings(result)).and(self.common().records.judge(lost))
    }
}

/// The report, written.
fn report<C: Single>(
    arguments: &C,
    ready: &C::Ready,
    records: &[Record],
    result: &C::Result,
    card: Card,
) -> Result<()> {
    let common = arguments.common();
    let Some(path) = &common.out.report else { return Ok(()) };
    let rig = ready.as_ref();
    let provenance = Provenance::of(&command_line()).with("rig file", rig.path.display());
    let provenance = arguments.reads().iter().fold(provenance, |all, (name, file)| all.with(name, file.display()));
    let provenance = arguments.seed().iter().fold(provenance, |all, seed| all.with("seed", seed));
    let mut results = Results::new();
    results.add(card).add(Warnings { warnings: C::warnings(result).to_vec() }).add(provenance.records(records));
    C::show(ready, records, result, &mut results)?;
    let names: Vec<String> = common.records.records.iter().map(|p| p.display().to_string()).collect();
    Report::of(format!("{}: {}", C::HEADING, rig.name), names.join(", "), &results).write(path)
}

/// An answer with everything that it is written out from.
pub struct Answered<C: Single> {
    ready: C::Ready,
    records: Vec<Record>,
    result: C::Result,
}

impl<C: Single> Answered<C> {
    /// Says the answer and writes the files that the arguments name.
    pub fn write(&self, arguments: &C) -> Result<()> {
        let Self { ready, records, result } = self;
        let out = &arguments.common().out;
        let card = C::card(ready, result);
        let human = C::human(result, &card);
        // Files that may fail to be written come first: no JSON tells of an answer that ends with 2.
        arguments.write(ready, records, result)?;
        report(arguments, ready, records, result, card)?;
        out.write_json(result)?;
        out.say(&human);
        Ok(())
    }
}

/// The rig, once what is read and written has been checked.
pub fn check<C: Single>(arguments: &C) -> Result<Rig> {
    let Common { records, rig, replace, out } = arguments.common();
    let (rig, files) = records.begin(rig, out, Some(*replace))?;
    let files = files.reads(arguments.reads().into_iter().map(|(_, path)| path));
    arguments.writes().into_iter().fold(files, |all, (option, path)| all.result(option, Some(path))).check()?;
    Ok(rig)
}

/// Reads, analyses, says, writes; the answer, where there is one, is kept.
pub fn answer<C: Single>(arguments: &C) -> Result<(Answer, Option<Answered<C>>)> {
    let ready = arguments.prepare(check(arguments)?)?;
    let analysed = arguments.analyse(&ready)?;
    let lost = analysed.lost();
    let Analysed { records, result } = analysed;
    let common = arguments.common();
    let result = match result {
        Ok(result) => result,
        Err(error) => return common.records.failed(&records, error, &common.out).map(|answer| (answer, None)),
    };
    print_warnings(C::warnings(&result));
    let answered = Answered { ready, records, result };
    answered.write(arguments)?;
    Ok((arguments.judge(&answered.result, lost).tell(), Some(answered)))
}

/// The same for the program.
pub fn run<C: Single>(arguments: &C) -> Result<Answer> {
    answer(arguments).map(|(answer, _)| answer)
}

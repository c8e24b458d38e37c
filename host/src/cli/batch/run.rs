//! `whirl batch identify|explain|validate`.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use clap::ArgMatches;
use indicatif::ProgressBar;

use super::Of;
use super::page::Summary;
use super::told::{Told, is_of_option};
use crate::batch::journal::{Found, Header, Journal, path_of};
use crate::batch::row::{Row, WALL};
use crate::batch::table::{Layout, Table};
use crate::batch::{FORMAT, hash};
use crate::cli::outputs::Outputs;
use crate::cli::single::{Analysed, Common, Single};
use crate::cli::{Answer, progress};
use crate::error::{BadInput, Result};
use crate::files::write_file;
use crate::rig::Rig;

/// Arguments that do not change a row.
const BESIDE: [&str; 11] =
    ["records", "rig", "out", "resume", "shard", "json", "report", "force", "threads", "quiet", "help"];
/// Stack of a thread that answers for a record, bytes: as much as the program's first one has.
const STACK: usize = 8 << 20;
/// What a program ends with that gave up.
const GAVE_UP: i64 = 101;

/// A record of the batch.
struct Task<'a> {
    /// Its number in the list, from 1.
    index: usize,
    path: &'a PathBuf,
}

/// Everything that the threads share.
struct Work<'a, C: Single> {
    batch: &'a Of<C>,
    ready: &'a C::Ready,
    found: Option<&'a Found>,
    journal: &'a Journal,
    line: &'a ProgressBar,
    told: Told,
    negative: AtomicUsize,
}

/// Every option with its values as they were given; files by their hash.
fn options(name: &str, matches: Option<&ArgMatches>) -> Result<BTreeMap<String, Vec<String>>> {
    let command = crate::cli::command();
    let command = command.find_subcommand("batch").and_then(|batch| batch.find_subcommand(name));
    let matches = matches.and_then(|m| m.subcommand_matches(name));
    let (Some(command), Some(matches)) = (command, matches) else { return Ok(BTreeMap::new()) };
    let mut out = BTreeMap::new();
    for argument in command.get_arguments().filter(|a| !BESIDE.contains(&a.get_id().as_str())) {
        let Ok(Some(values)) = matches.try_get_raw(argument.get_id().as_str()) else { continue };
        let option = argument.get_long().map_or_else(|| argument.get_id().to_string(), |long| format!("--{long}"));
        let told = values.map(|value| {
            let path = Path::new(value);
            if path.is_file() {
                return hash::of_file(path).map(|h| format!("sha256:{h}"));
            }
            Ok(value.to_string_lossy().into_owned())
        });
        out.insert(option, told.collect::<Result<Vec<_>>>()?);
    }
    Ok(out)
}

/// The rig file with everything that it names.
fn hash_of(rig: &Rig) -> String {
    let model = rig.bound.as_ref().map_or("", |b| b.model.source.text.as_str());
    hash::of(format!("{}\0{model}\0{:?}", rig.text, rig.effects).as_bytes())
}

/// The journal of a table: one that is there is gone on with where that is asked for, and begun
/// anew otherwise.
fn open(table: &Path, header: &Header, resume: bool, force: bool) -> Result<(Journal, Option<Found>)> {
    let path = path_of(table);
    if force && !resume {
        return Ok((Journal::create(&path, header)?, None));
    }
    match Found::read(&path)? {
        Some(found) if resume => {
            found.belongs_to(header, &path)?;
            Ok((Journal::go_on(&path, &found)?, Some(found)))
        }
        Some(found) if !found.finished && !found.is_empty() => {
            let (n, are) = (found.len(), if found.len() == 1 { "record is" } else { "records are" });
            Err(BadInput::new(format!("a batch that was not finished: {n} {are} done"), "none")
                .in_file(&path)
                .at("--out")
                .remedy("Go on with --resume, or begin anew with --force"))
        }
        _ => Ok((Journal::create(&path, header)?, None)),
    }
}

/// A row that says why there is no answer.
fn failed(row: &mut Row, status: i64, error: &str) {
    row.integer("exit_status", status);
    row.text("verdict", "error");
    row.text("error", error);
}

/// Names of warnings, each once.
fn names(warnings: &[crate::warning::Warning]) -> String {
    let mut out: Vec<&str> = Vec::new();
    for warning in warnings {
        if !out.contains(&warning.id) {
            out.push(warning.id);
        }
    }
    out.join("+")
}

/// The row of one record, as the command alone answers for it.
fn answer<C: Single>(single: &C, ready: &C::Ready, record: &Path) -> Row {
    let mut one = single.clone();
    one.common_mut().records.records = vec![record.to_path_buf()];
    let mut row = Row::default();
    let analysed = match one.analyse(ready) {
        Ok(analysed) => analysed,
        Err(error) => {
            failed(&mut row, 2, &error.to_string());
            return row;
        }
    };
    let lost = analysed.lost();
    let Analysed { records, result } = analysed;
    if !records.is_empty() {
        row.number("seconds", records.iter().map(crate::record::Record::duration_s).sum());
        row.integer("samples", records.iter().map(crate::record::Record::samples).sum::<usize>());
        row.integer("lost", lost);
        row.integer("segments", records.iter().map(|r| r.segments.len()).sum::<usize>());
    }
    match result {
        Ok(result) => {
            C::cells(&mut row, &result);
            let judgement = one.judge(&result, lost);
            row.integer("exit_status", i64::from(judgement.negative));
            row.text("error", judgement.reasons.join("; "));
            row.text("warnings", names(C::warnings(&result)));
        }
        Err(error) => {
            let warnings: Vec<_> = records.iter().flat_map(|r| r.warnings.clone()).collect();
            // Where the record itself is at fault, the answer is negative.
            let status = if warnings.iter().any(|w| w.invalidates) { 1 } else { 2 };
            failed(&mut row, status, &error.to_string());
            row.text("warnings", names(&warnings));
        }
    }
    row
}

impl<C: Single> Work<'_, C> {
    /// A record's row, from the journal or computed.
    fn row(&self, task: &Task<'_>) -> Result<Row> {
        let file = task.path.display().to_string();
        let hashed = hash::of_file(task.path).unwrap_or_default();
        let known = self.found.filter(|_| !hashed.is_empty()).and_then(|found| found.row(&file, &hashed));
        let row = if let Some(row) = known {
            row.clone()
        } else {
            let begun = Instant::now();
            let single = &self.batch.single;
            let mut row =
                catch_unwind(AssertUnwindSafe(|| answer(single, self.ready, task.path))).unwrap_or_else(|_| {
                    let mut row = Row::default();
                    failed(&mut row, GAVE_UP, "whirl gave up on this record, which is a mistake of its own");
                    row
                });
            row.text("file", &file);
            row.text("hash", &hashed);
            if self.batch.timing {
                row.number(WALL, begun.elapsed().as_secs_f64());
            }
            self.journal.done(&file, &hashed, &row)?;
            row
        };
        if row.integer_of("exit_status") != 0 {
            let n = self.negative.fetch_add(1, Ordering::Relaxed) + 1;
            self.line.set_message(format!(", {n} negative or failed"));
        }
        self.line.inc(1);
        self.told.done(&file, &row);
        Ok(row)
    }

    /// All rows, in any order, by one thread for each core; each record's own work is spread over
    /// the same cores.
    fn rows(&self, tasks: &[Task<'_>]) -> Result<Vec<(usize, Row)>> {
        let threads = rayon::current_num_threads().clamp(1, tasks.len().max(1));
        let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
        let rows = Mutex::new(Vec::with_capacity(tasks.len()));
        let work = || -> Result<()> {
            while let Some(task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
                if stopped.load(Ordering::Relaxed) {
                    break;
                }
                let row = self.row(task).inspect_err(|_| stopped.store(true, Ordering::Relaxed))?;
                rows.lock().unwrap_or_else(PoisonError::into_inner).push((task.index, row));
            }
            Ok(())
        };
        std::thread::scope(|scope| {
            let spawn = |_| std::thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work);
            let running: std::io::Result<Vec<_>> = (0..threads).map(spawn).collect();
            let running = running.map_err(|e| BadInput::new(e.to_string(), "threads to work with").at("--threads"))?;
            let ended = running.into_iter().map(|thread| {
                thread.join().unwrap_or_else(|_| Err(BadInput::new("a thread that gave up", "rows of all records")))
            });
            ended.collect::<Result<()>>()
        })?;
        Ok(rows.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The mistake in an option that every record fails for: then nothing is answered, and no table is
/// written.
fn misused(rows: &[(usize, Row)]) -> Option<BadInput> {
    let (_, first) = rows.first()?;
    let error = first.text_of("error");
    let same = |row: &Row| is_of_option(row) && row.text_of("error") == error;
    rows.iter().all(|(_, row)| same(row)).then(|| BadInput::new(error, ""))
}

/// What is told of a batch that a signal ended.
fn interrupted(done: u64, of: usize) -> String {
    format!("interrupted: {done} of {of} done; go on with --resume")
}

/// Ctrl-C, SIGTERM and SIGHUP end the batch at once, with a line that says how to go on: a record
/// may take minutes, and those that are done are in the journal. Where signals cannot be caught,
/// the batch ends without the line.
fn tell_of_signals(line: &ProgressBar, of: usize) {
    let line = line.clone();
    let _ = ctrlc::set_handler(move || {
        // A line that is finished counts as full.
        let done = line.position();
        line.finish_and_clear();
        crate::error::tell(interrupted(done, of));
        std::process::exit(130);
    });
}

/// The records of a shard, or all of them.
fn tasks(all: &[PathBuf], shard: Option<super::Shard>) -> Vec<Task<'_>> {
    let shard = shard.unwrap_or(super::Shard { number: 1, of: 1 });
    let tasks = all.iter().enumerate().map(|(i, path)| Task { index: i + 1, path });
    tasks.skip(shard.number - 1).step_by(shard.of).collect()
}

/// Refuses a pattern that the shell handed on because no file matches it: as a record that cannot
/// be read it would make a table of one row.
fn matched(records: &[PathBuf]) -> Result<()> {
    let is_pattern = |p: &Path| p.to_string_lossy().contains(['*', '?', '[']) && !p.exists();
    let Some(pattern) = records.iter().find(|p| is_pattern(p)) else { return Ok(()) };
    Err(BadInput::new("a pattern that no file matches", "records")
        .in_file(pattern)
        .remedy("Check the folder and the ending; patterns are resolved by the shell"))
}

/// Runs a batch.
pub fn run<C: Single>(batch: &Of<C>, matches: Option<&ArgMatches>) -> Result<Answer> {
    let Common { records, rig, replace, out } = batch.single.common();
    if let Some((option, _)) = batch.single.writes().first() {
        return Err(BadInput::new("one file for many records", "the table alone")
            .at(*option)
            .remedy(format!("Leave it out, or run `whirl {}` on the one record", C::NAME)));
    }
    let layout = Layout::of(&batch.out)?;
    let rig = records.rig(rig)?;
    Outputs::of(out, Some(*replace))
        .reads(&records.records)
        .reads(batch.single.reads().into_iter().map(|(_, path)| path))
        .reads_rig(&rig)
        .batch("--out", &batch.out)
        .check()?;
    matched(&records.records)?;
    let tasks = tasks(&records.records, batch.shard);
    if !batch.resume {
        let files = tasks.iter().map(|t| t.path.display().to_string()).collect();
        super::keeps_rows(&batch.out, &files, replace.force)?;
    }
    let header = Header {
        format: FORMAT,
        command: C::NAME.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        rig: hash_of(&rig),
        options: options(C::NAME, matches)?,
        shard: batch.shard.map(|s| format!("{}/{}", s.number, s.of)),
    };
    let ready = batch.single.prepare(rig)?;
    records.part().validate()?;
    let (journal, found) = open(&batch.out, &header, batch.resume, replace.force)?;
    let all = &records.records;
    let line = progress::of_records(tasks.len() as u64);
    let told = Told::of(tasks.len());
    // This line, or one for each record, is all that is shown of the progress.
    progress::set_quiet(true);
    let work = Work {
        batch,
        ready: &ready,
        found: found.as_ref(),
        journal: &journal,
        line: &line,
        told,
        negative: AtomicUsize::new(0),
    };
    tell_of_signals(&line, tasks.len());
    let rows = work.rows(&tasks)?;
    line.finish_and_clear();
    if let Some(error) = misused(&rows) {
        let _ = std::fs::remove_file(path_of(&batch.out));
        return Err(error);
    }
    work.told.end();
    let run = header.run(all);
    let rows = rows.into_iter().map(|(index, mut row)| {
        row.integer("format", FORMAT);
        row.text("command", C::NAME);
        row.text("run", &run);
        row.integer("index", index);
        row.integer("of", all.len());
        row
    });
    let table = Table::new(C::NAME, rows.collect());
    write_file(&batch.out, &table.bytes(layout)?)?;
    journal.finish()?;
    Summary::of(&table, &batch.out, all.len()).give(out)
}

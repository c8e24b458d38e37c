//! Where results go: a short answer for people on standard output, `--json FILE`,
//! `--report FILE.html`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use clap::Args;
use serde::Serialize;

use crate::error::{BadInput, Result, obeyed, plain_lines, short_numbers, tell};
use crate::files::{FORMAT, write_file};
use crate::said;
use crate::warning::Warning;

/// Options that every command with results has.
#[derive(Clone, Debug, Default, Args)]
pub struct Output {
    /// Machine-readable result; `-` for standard output, and nothing else is printed there.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Self-contained report.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
}

/// The option of every command but `reduce`, whose `--force` is that on the structure: there
/// nothing recorded is replaced.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct Replace {
    /// Replace a record or rig file, where an output names one that exists (never one that this
    /// command reads).
    #[arg(long)]
    pub force: bool,
}

/// A result with the warnings that it does not hold itself.
#[derive(Serialize)]
struct Warned<'a, T> {
    #[serde(flatten)]
    result: &'a T,
    warnings: &'a [Warning],
}

/// A result with the version of its keys.
#[derive(Serialize)]
struct Versioned<'a, T> {
    format: u32,
    #[serde(flatten)]
    result: &'a T,
}

impl Output {
    /// Writes the JSON of a result with named fields if asked for; its first key is `format`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_json<T: Serialize>(&self, result: &T) -> Result<()> {
        self.write(&Versioned { format: FORMAT, result })
    }

    /// The same for a result that does not hold its warnings itself.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_json_with<T: Serialize>(&self, result: &T, warnings: &[Warning]) -> Result<()> {
        self.write_json(&Warned { result, warnings })
    }

    /// Writes the JSON of several results, as a list of objects, if asked for.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_json_list<T: Serialize>(&self, results: &[T]) -> Result<()> {
        let list: Vec<_> = results.iter().map(|result| Versioned { format: FORMAT, result }).collect();
        self.write(&list)
    }

    fn write<T: Serialize>(&self, result: &T) -> Result<()> {
        let called = said::kept(|_| ()).is_some();
        if self.json.is_none() && !called {
            return Ok(());
        }
        let mut text = serde_json::to_string_pretty(result)
            .map_err(|e| BadInput::new(e.to_string(), "a result that can be written as JSON").at("--json"))?;
        text.push('\n');
        let text = as_escapes(&text);
        said::kept(|said| said.json = Some(text.clone()));
        let Some(path) = &self.json else { return Ok(()) };
        if is_standard_output(path) {
            let mut out = std::io::stdout().lock();
            return match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
                // A reader that has enough (`whirl … --json - | head`) is no error of ours.
                Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(BadInput::io("standard output", &e)),
                _ => Ok(()),
            };
        }
        write_file(path, text.as_bytes())
    }

    /// Says that there is no report of what a command does, where one was asked for.
    pub fn tell_no_report(&self, of: &str, remedy: &str) {
        if self.report.is_some() {
            tell(format!("--report: there is no report of {of}, and none was written; {remedy}"));
        }
    }

    /// Prints the answer for people, unless standard output is taken by the JSON.
    pub fn say(&self, text: &str) {
        if !self.json.as_deref().is_some_and(is_standard_output) {
            print(&plain_lines(text));
        }
    }
}

/// Prints a text of whirl's own, as it stands.
pub fn print(text: &str) {
    if said::kept(|said| said.text.push_str(text)).is_some() {
        return;
    }
    let mut out = std::io::stdout().lock();
    note_failure(out.write_all(text.as_bytes()).and_then(|()| out.flush()));
}

/// Whether something could not be said on standard output.
static UNSAID: Mutex<Option<BadInput>> = Mutex::new(None);

/// Keeps what went wrong on standard output; a closed pipe (`whirl … | head`) is no error of ours.
fn note_failure(result: std::io::Result<()>) {
    if let Err(e) = result
        && e.kind() != std::io::ErrorKind::BrokenPipe
        && let Ok(mut unsaid) = UNSAID.lock()
    {
        unsaid.get_or_insert(BadInput::io("standard output", &e));
    }
}

/// Whether all was said that was to be said on standard output.
///
/// # Errors
/// What went wrong there first (a full disk).
pub fn all_said() -> Result<()> {
    UNSAID.lock().ok().and_then(|mut unsaid| unsaid.take()).map_or(Ok(()), Err)
}

/// JSON in which what a terminal would obey (DEL, C1, marks of direction) is written as `\\uXXXX`,
/// as C0 is already.
fn as_escapes(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for c in json.chars() {
        if c == '\n' || !obeyed(c) {
            out.push(c);
        } else {
            let mut units = [0; 2];
            c.encode_utf16(&mut units).iter().for_each(|u| out.push_str(&format!("\\u{u:04x}")));
        }
    }
    out
}

fn is_standard_output(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// The command line without the program and without the number of threads, which changes nothing.
pub fn command_line() -> String {
    let mut out: Vec<String> = Vec::new();
    let called = said::kept(|said| said.command_line.clone());
    let mut words = called
        .unwrap_or_else(|| std::env::args_os().skip(1).map(|a| a.to_string_lossy().into_owned()).collect())
        .into_iter();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--threads" => drop(words.next()),
            "--quiet" => {}
            w if w.starts_with("--threads=") => {}
            _ => out.push(word),
        }
    }
    plain_lines(&out.join(" "))
}

/// Warnings, on standard error.
pub fn print_warnings(warnings: &[Warning]) {
    if said::kept(|said| said.warnings.extend_from_slice(warnings)).is_some() {
        return;
    }
    for w in warnings {
        tell(format_args!("warning: {}. {}", short_numbers(&w.text), w.advice));
    }
}

//! Where results go: a short answer for people on standard output, `--json FILE`, `--report FILE.html`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::error::{BadInput, Result};
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

impl Output {
    /// Writes the JSON if asked for.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_json<T: Serialize>(&self, result: &T) -> Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        let mut text = serde_json::to_string_pretty(result)
            .map_err(|e| BadInput::new(e.to_string(), "a result that can be written as JSON").in_file(path))?;
        text.push('\n');
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

    /// Prints the answer for people, unless standard output is taken by the JSON.
    pub fn say(&self, text: &str) {
        if !self.json.as_deref().is_some_and(is_standard_output) {
            // A closed pipe (`whirl … | head`) is no error of ours.
            let _ = std::io::stdout().lock().write_all(text.as_bytes());
        }
    }
}

fn is_standard_output(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Writes a file whole: beside its name first, then renamed, so that no half-written result is left behind.
///
/// # Errors
/// A folder that does not exist, a full disk, missing rights.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let fail =
        |e: std::io::Error| BadInput::io(path, &e).remedy("Name a file in a folder that exists and can be written to");
    // A device or pipe is written to as it is.
    if path.exists() && !path.is_file() {
        return std::fs::write(path, bytes).map_err(fail);
    }
    let mut name =
        path.file_name().ok_or_else(|| BadInput::new("no file name", "a file to write").in_file(path))?.to_os_string();
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path)).map_err(|e| {
        let _ = std::fs::remove_file(&part);
        fail(e)
    })
}

/// Warnings, on standard error.
pub fn print_warnings(warnings: &[Warning]) {
    for w in warnings {
        eprintln!("whirl: warning: {}. {}", w.text, w.advice);
    }
}

//! Progress bars on standard error, where a terminal is there and nobody asked for quiet.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether progress bars are wanted at all.
pub fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

/// What a capture tells of its progress: shown on a terminal, unless quiet is wanted.
pub fn of_capture() -> Box<dyn FnMut(&crate::capture::Progress)> {
    if QUIET.load(Ordering::Relaxed) {
        Box::new(crate::capture::progress::tell)
    } else {
        crate::capture::progress::on_terminal()
    }
}

/// A bar over `length` steps that says what is being done; hidden where no terminal is there.
pub fn bar(what: &'static str, length: u64) -> ProgressBar {
    let bar = if QUIET.load(Ordering::Relaxed) || !std::io::stderr().is_terminal() {
        ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden())
    } else {
        ProgressBar::new(length)
    };
    if let Ok(style) = ProgressStyle::with_template("{msg:<24} [{bar:32}] {percent:>3} % {eta_precise}") {
        bar.set_style(style.progress_chars("━╸ "));
    }
    bar.set_message(what);
    bar
}

/// A line over `length` records: how many are done, what is told of them, time left; hidden where no terminal is there.
pub fn of_records(length: u64) -> ProgressBar {
    let line = bar("", length);
    if let Ok(style) = ProgressStyle::with_template("{pos} of {len} records{msg} [{bar:32}] {eta_precise} left") {
        line.set_style(style.progress_chars("━╸ "));
    }
    line
}

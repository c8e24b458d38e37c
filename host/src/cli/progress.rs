//! Progress on standard error, one line that fits the terminal, where one is there and nobody asked
//! for quiet.

use std::borrow::Cow;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether progress bars are wanted at all.
pub fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

/// Whether somebody sees them.
fn seen() -> bool {
    !QUIET.load(Ordering::Relaxed) && std::io::stderr().is_terminal()
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
    let bar = if seen() {
        ProgressBar::new(length)
    } else {
        ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden())
    };
    if let Ok(style) = ProgressStyle::with_template("{msg} [{wide_bar}] {percent:>3} % {eta_precise}") {
        bar.set_style(style.progress_chars("━╸ "));
    }
    bar.set_message(what);
    bar
}

/// A line over `length` records: how many are done, what is told of them, time left; hidden where
/// no terminal is there.
pub fn of_records(length: u64) -> ProgressBar {
    let line = bar("", length);
    if let Ok(style) = ProgressStyle::with_template("{pos} of {len} records{msg} [{bar:32}] {eta_precise} left") {
        line.set_style(style.progress_chars("━╸ "));
    }
    line
}

/// One of several steps of a long command: as [`during`]; a line of its own where no terminal is
/// there.
pub fn step<T>(what: &'static str, work: impl FnOnce() -> T) -> T {
    if !QUIET.load(Ordering::Relaxed) && !std::io::stderr().is_terminal() {
        eprintln!("{what}");
    }
    during(what, work)
}

/// Says what is being done, and for how long already, while it is done: for work whose length is
/// not known beforehand.
pub fn during<T>(what: impl Into<Cow<'static, str>>, work: impl FnOnce() -> T) -> T {
    if !seen() {
        return work();
    }
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed_precise} {wide_msg}") {
        bar.set_style(style);
    }
    bar.set_message(what);
    bar.enable_steady_tick(Duration::from_millis(120));
    let done = work();
    bar.finish_and_clear();
    done
}

//! Progress on standard error, where nobody asked for quiet: one line that fits the terminal, or,
//! where none is there, a line for each step that takes long.

use std::borrow::Cow;
use std::io::IsTerminal;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::steps;

/// Off a terminal: how long work goes on before a line is written, and from one line to the next
/// step's; how often a step that goes on is told again.
const FIRST: Duration = Duration::from_secs(5);
const AGAIN: Duration = Duration::from_secs(60);
/// How often is looked whether there is something to write.
const TICK: Duration = Duration::from_millis(250);

static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether progress bars are wanted at all.
pub fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

/// Whether somebody sees them.
fn seen() -> bool {
    !QUIET.load(Ordering::Relaxed) && std::io::stderr().is_terminal()
}

/// Whether progress is told in lines of their own: where nobody sees a bar, unless quiet is wanted.
pub fn wants_lines() -> bool {
    !QUIET.load(Ordering::Relaxed) && !std::io::stderr().is_terminal()
}

/// A line of progress on standard error.
pub fn line(text: &str) {
    // Whoever closed standard error does not want it.
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// What a capture tells of its progress: shown on a terminal, unless quiet is wanted.
pub fn of_capture() -> Box<dyn FnMut(&crate::capture::Progress)> {
    if QUIET.load(Ordering::Relaxed) {
        Box::new(crate::capture::progress::tell)
    } else {
        crate::capture::progress::on_terminal()
    }
}

/// A bar over `length` steps that says what is being done; a line now and then where no terminal is
/// there.
pub fn bar(what: &'static str, length: u64) -> ProgressBar {
    let bar = drawn(what, length);
    if wants_lines() {
        follow(&bar, what);
    }
    bar
}

/// The bar alone, hidden where no terminal is there.
fn drawn(what: &'static str, length: u64) -> ProgressBar {
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
    let line = drawn("", length);
    if let Ok(style) = ProgressStyle::with_template("{pos} of {len} records{msg} [{bar:32}] {eta_precise} left") {
        line.set_style(style.progress_chars("━╸ "));
    }
    line
}

/// Writes how far a bar that nobody sees has come, now and then, until it ends.
fn follow(bar: &ProgressBar, what: &'static str) {
    let (bar, started) = (bar.downgrade(), Instant::now());
    let mut lines = Lines::new();
    // Ends with the bar, or with the program.
    let _ = std::thread::Builder::new().name("progress".to_owned()).spawn(move || {
        while let Some(bar) = bar.upgrade() {
            let (at, of, is_over) = (bar.position(), bar.length().unwrap_or(0), bar.is_finished());
            drop(bar);
            let tenths = (10 * at.min(of)).checked_div(of);
            let share = tenths.map_or_else(String::new, |tenths| format!("{} %", 10 * tenths));
            // What was over may begin again.
            if !is_over {
                lines.write(what, &share, started.elapsed());
            }
            std::thread::sleep(TICK);
        }
    });
}

/// Lines off a terminal: which was the last one, and when.
struct Lines {
    last: Option<(String, Duration)>,
}

impl Lines {
    fn new() -> Self {
        Self { last: None }
    }

    /// The line that is due after so long, if any: what is being done and its step.
    fn due(&mut self, what: &str, step: &str, after: Duration) -> Option<String> {
        let is_due = match &self.last {
            None => after >= FIRST,
            Some((said, at)) => after >= *at + if said == step { AGAIN } else { FIRST },
        };
        if !is_due {
            return None;
        }
        self.last = Some((step.to_owned(), after));
        let colon = if step.is_empty() { "" } else { ": " };
        Some(format!("{what}{colon}{step} ({} s)", after.as_secs()))
    }

    fn write(&mut self, what: &str, step: &str, after: Duration) {
        if let Some(due) = self.due(what, step, after) {
            line(&due);
        }
    }
}

/// One of several steps of a long command: as [`during`]; a line of its own where no terminal is
/// there.
pub fn step<T>(what: &'static str, work: impl FnOnce() -> T) -> T {
    if wants_lines() {
        line(what);
        return in_lines(what.into(), Lines { last: Some((String::new(), Duration::ZERO)) }, work);
    }
    during(what, work)
}

/// Says what is being done, its step ([`steps::tell`]), and for how long already, while it is done:
/// for work whose length is not known beforehand.
pub fn during<T>(what: impl Into<Cow<'static, str>>, work: impl FnOnce() -> T) -> T {
    let what = what.into();
    if QUIET.load(Ordering::Relaxed) {
        return work();
    }
    if !seen() {
        return in_lines(what, Lines::new(), work);
    }
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed_precise} {wide_msg}") {
        bar.set_style(style);
    }
    bar.set_message(what.clone());
    bar.enable_steady_tick(Duration::from_millis(120));
    let shown = bar.clone();
    let done = steps::heard(Arc::new(move |step: &str| shown.set_message(format!("{what}: {step}"))), work);
    bar.finish_and_clear();
    done
}

/// The same where no terminal is there, in lines.
fn in_lines<T>(what: Cow<'static, str>, mut lines: Lines, work: impl FnOnce() -> T) -> T {
    let (now, started) = (Arc::new(Mutex::new(String::new())), Instant::now());
    let (done, ended) = mpsc::channel::<()>();
    let said = Arc::clone(&now);
    let writer = std::thread::Builder::new().name("progress".to_owned()).spawn(move || {
        while ended.recv_timeout(TICK) == Err(mpsc::RecvTimeoutError::Timeout) {
            let step = said.lock().unwrap_or_else(PoisonError::into_inner).clone();
            lines.write(&what, &step, started.elapsed());
        }
    });
    let listener = Arc::new(move |step: &str| step.clone_into(&mut now.lock().unwrap_or_else(PoisonError::into_inner)));
    let result = steps::heard(listener, work);
    drop(done);
    // No line behind what comes next.
    let _ = writer.map(std::thread::JoinHandle::join);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_a_terminal_long_steps_are_told_once_and_short_work_not_at_all() {
        let mut lines = Lines::new();
        let mut due = |step: &str, s: u64| lines.due("explaining", step, Duration::from_secs(s));
        assert_eq!(due("", 1), None);
        assert_eq!(due("candidates", 4), None);
        assert_eq!(due("candidates", 5).as_deref(), Some("explaining: candidates (5 s)"));
        assert_eq!(due("candidates", 20), None);
        assert_eq!(due("pairs", 21).as_deref(), Some("explaining: pairs (21 s)"));
        // No more than a line every few seconds.
        assert_eq!(due("limits", 23), None);
        assert_eq!(due("forecast", 26).as_deref(), Some("explaining: forecast (26 s)"));
        assert_eq!(due("forecast", 86).as_deref(), Some("explaining: forecast (86 s)"));
        assert_eq!(Lines::new().due("inspecting", "", FIRST).as_deref(), Some("inspecting (5 s)"));
    }

    #[test]
    fn work_that_is_followed_in_lines_gives_its_result() {
        let done = in_lines("working".into(), Lines::new(), || {
            steps::tell("first");
            7
        });
        assert_eq!(done, 7);
    }
}

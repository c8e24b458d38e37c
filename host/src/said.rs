//! What a command says, kept for a program that calls it as a function ([`crate::api`]) instead of
//! printed.

use std::cell::RefCell;

use crate::warning::Warning;

/// What a command said.
#[derive(Clone, Debug, Default)]
pub struct Said {
    /// Its result as JSON, as `--json FILE` has it.
    pub json: Option<String>,
    /// Its answer for people.
    pub text: String,
    /// Its warnings.
    pub warnings: Vec<Warning>,
    /// Its other lines on standard error: what makes the answer negative.
    pub remarks: Vec<String>,
    /// The command line that it is said to have been called by.
    pub(crate) command_line: Vec<String>,
}

thread_local! {
    static SAID: RefCell<Option<Said>> = const { RefCell::new(None) };
}

/// Keeps what `work` says on this thread.
pub(crate) fn during<T>(command_line: Vec<String>, work: impl FnOnce() -> T) -> (T, Said) {
    SAID.set(Some(Said { command_line, ..Said::default() }));
    let done = work();
    (done, SAID.take().unwrap_or_default())
}

/// Hands what is kept on this thread to `f`; none where nothing is, and what is said is to be
/// printed.
pub(crate) fn kept<T>(f: impl FnOnce(&mut Said) -> T) -> Option<T> {
    SAID.with_borrow_mut(|said| said.as_mut().map(f))
}

//! Commands as functions, for programs that hold whirl as a library: words of a command line go in,
//! what the command says comes out. The way is the program's own, so that every option has the same
//! meaning and the same checks.

use std::ffi::OsString;
use std::fmt;

use crate::error::BadInput;
pub use crate::said::Said;

/// Why a command ended with exit status 2.
#[derive(Clone, Debug)]
pub enum Error {
    /// A command line that is none: an option that does not exist, a value of another kind, one
    /// that is missing.
    Usage(String),
    /// Bad input.
    Input(Box<BadInput>),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(text) => f.write_str(text),
            Self::Input(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Error {}

impl From<BadInput> for Error {
    fn from(error: BadInput) -> Self {
        Self::Input(Box::new(error))
    }
}

/// Result of a call.
pub type Result<T> = std::result::Result<T, Error>;

/// An answer that can be written out when it is known: what the options of further words name, as
/// though they had been given.
pub(crate) type Writer = Box<dyn Fn(&[OsString]) -> Result<()> + Send + Sync>;

/// What became of a call.
pub struct Called {
    /// What the command said.
    pub said: Said,
    /// Whether the answer is positive (exit status 0) or negative (1).
    pub positive: bool,
    pub(crate) writer: Option<Writer>,
}

impl Called {
    /// Writes what further options of `identify`, `explain` or `validate` name
    /// (`--report FILE.html`, `-o MODEL.toml`, `--ledger FILE`, `--json FILE`), as though they had
    /// been given at the call; nothing is computed again.
    ///
    /// # Errors
    /// As the command's own with those options; a command or an answer of which nothing is kept.
    pub fn write(&self, further: &[OsString]) -> Result<()> {
        match &self.writer {
            Some(writer) => writer(further),
            None => Err(Error::Usage("of this answer nothing is kept: name its files at the call".to_owned())),
        }
    }
}

/// Calls a command with the words that would stand behind `whirl`. Nothing is printed and no
/// progress is shown; what it says on this thread is kept. `--threads` is refused: the caller's
/// pool of rayon's is used, whose number of threads changes no result.
///
/// # Errors
/// Where the program would end with exit status 2.
pub fn call(words: &[OsString]) -> Result<Called> {
    crate::cli::called::call(words)
}

/// An option of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandOption {
    /// Its name without dashes, or the argument's where it has no option (`records`).
    pub name: String,
    /// What it does, with its unit and default.
    pub help: String,
    /// Whether it takes a value; a switch does not.
    pub takes_value: bool,
}

/// The options of a command, without those that are of printing; none for a name that is no
/// command.
pub fn options(command: &str) -> Vec<CommandOption> {
    crate::cli::called::options(command)
}

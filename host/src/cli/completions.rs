//! `whirl completions SHELL`: completions for a shell, on standard output.

use clap::{Args, CommandFactory};

use super::{Answer, Cli};
use crate::error::Result;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Shell.
    shell: clap_complete::Shell,
}

/// Prints the completions.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    clap_complete::generate(arguments.shell, &mut Cli::command(), "whirl", &mut std::io::stdout());
    Ok(Answer::Positive)
}

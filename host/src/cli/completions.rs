//! `whirl completions SHELL`: completions for a shell, on standard output.

use clap::Args;

use super::Answer;
use crate::error::Result;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Shell.
    shell: clap_complete::Shell,
}

/// Prints the completions.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut super::command(), "whirl", &mut script);
    super::output::print(&String::from_utf8_lossy(&script));
    Ok(Answer::Positive)
}

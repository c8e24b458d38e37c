//! `whirl completions SHELL`: completions for a shell, on standard output.

use clap::Args;

use super::Answer;
use crate::error::Result;

/// Where each shell looks for them.
const PLACES: &str = "\
Where to put them (a new shell finds them there):
  bash  whirl completions bash > ~/.local/share/bash-completion/completions/whirl
  zsh   whirl completions zsh > ~/.zfunc/_whirl, with `fpath+=~/.zfunc` above compinit in ~/.zshrc
  fish  whirl completions fish > ~/.config/fish/completions/whirl.fish";

/// Arguments of `completions`.
#[derive(Debug, Args)]
#[command(after_help = PLACES)]
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

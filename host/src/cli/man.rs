//! `whirl man`: manual pages, of the program or, into a folder, of every command.

use std::path::{Path, PathBuf};

use clap::{Args, Command, CommandFactory};
use clap_mangen::Man;

use super::output::{print, write_file};
use super::outputs::Outputs;
use super::{Answer, Cli};
use crate::error::{BadInput, Result};

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder for the pages of all commands, `whirl.1`, `whirl-capture.1` …, such as ~/.local/share/man/man1 [default: the program's page on standard output].
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// A page and its file's name.
type Page = (String, Vec<u8>);

/// Prints the program's page, or writes all of them.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let mut pages = Vec::new();
    collect(&Cli::command(), "whirl", &mut pages)?;
    let Some(folder) = &arguments.output else {
        if let Some((_, text)) = pages.first() {
            print(&String::from_utf8_lossy(text));
        }
        return Ok(Answer::Positive);
    };
    std::fs::create_dir_all(folder)
        .map_err(|e| BadInput::io(folder, &e).at("-o").remedy("Name a folder that can be written to"))?;
    write(folder, &pages)?;
    print(&format!("{} manual pages in {}\n", pages.len(), crate::error::plain(&folder.to_string_lossy())));
    Ok(Answer::Positive)
}

/// The page of a command and those of the commands below it.
fn collect(command: &Command, name: &str, pages: &mut Vec<Page>) -> Result<()> {
    // Clap wants names that live as long as the program.
    let page = command.clone().name(name.to_owned()).bin_name(name.replace('-', " ")).display_name(name.to_owned());
    let mut text = Vec::new();
    Man::new(page).render(&mut text).map_err(|e| BadInput::new(e.to_string(), "a manual page"))?;
    pages.push((format!("{name}.1"), text));
    for below in command.get_subcommands().filter(|c| c.get_name() != "help") {
        collect(below, &format!("{name}-{}", below.get_name()), pages)?;
    }
    Ok(())
}

fn write(folder: &Path, pages: &[Page]) -> Result<()> {
    let paths: Vec<PathBuf> = pages.iter().map(|(name, _)| folder.join(name)).collect();
    paths.iter().fold(Outputs::default(), |files, path| files.result("-o", Some(path))).check()?;
    paths.iter().zip(pages).try_for_each(|(path, (_, text))| write_file(path, text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_that_names_its_options() {
        let mut pages = Vec::new();
        collect(&Cli::command(), "whirl", &mut pages).unwrap();
        let of = |name: &str| {
            let (_, text) = pages.iter().find(|(n, _)| n == name).unwrap();
            String::from_utf8(text.clone()).unwrap().replace("\\-", "-")
        };
        assert!(of("whirl.1").contains("capture"));
        assert!(of("whirl-capture.1").contains("--live") && of("whirl-capture.1").contains("--until"));
        assert!(of("whirl-device-set.1").contains("whirl device set"), "{}", of("whirl-device-set.1"));
        assert_eq!(pages.len(), 1 + Cli::command().get_subcommands().count() + 4);
    }
}

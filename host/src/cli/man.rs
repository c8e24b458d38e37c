//! `whirl man`: manual pages, of the program, of one command or, into a folder, of every command.

use std::path::{Path, PathBuf};

use clap::{Args, Command};
use clap_mangen::Man;

use super::Answer;
use super::output::print;
use super::outputs::Outputs;
use crate::error::{BadInput, Result};
use crate::files::write_file;

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Command whose page is printed, such as identify or device set [default: the program's page].
    #[arg(value_name = "COMMAND", conflicts_with = "output")]
    command: Vec<String>,
    /// Folder for the pages of all commands, `whirl.1`, `whirl-capture.1` …, such as
    /// ~/.local/share/man/man1, where `man whirl-capture` finds them. Without it one page goes to
    /// standard output, in man's own format: `whirl man capture | man -l -`.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// What every command ends with, in man's own format.
const EXIT_STATUS: &str = "\
.SH \"EXIT STATUS\"
0 done; 1 done, and the answer is negative; 2 wrong input or usage, with one message that says what to do.
";

/// A page and its file's name.
type Page = (String, Vec<u8>);

/// Prints a page, or writes all of them.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let pages = all()?;
    let Some(folder) = &arguments.output else {
        print(&String::from_utf8_lossy(page(&pages, &arguments.command)?));
        return Ok(Answer::Positive);
    };
    std::fs::create_dir_all(folder)
        .map_err(|e| BadInput::io(folder, &e).at("-o").remedy("Name a folder that can be written to"))?;
    write(folder, &pages)?;
    print(&format!("{} manual pages in {}\n", pages.len(), crate::error::plain(&folder.to_string_lossy())));
    Ok(Answer::Positive)
}

/// The page of a command, or the program's where none is named.
fn page<'a>(pages: &'a [Page], command: &[String]) -> Result<&'a [u8]> {
    let name = std::iter::once("whirl").chain(command.iter().map(String::as_str)).collect::<Vec<_>>().join("-");
    let file = format!("{name}.1");
    pages.iter().find(|(n, _)| *n == file).map(|(_, text)| text.as_slice()).ok_or_else(|| {
        BadInput::new(format!("\"{}\"", command.join(" ")), "a command of `whirl --help`")
            .at("man")
            .remedy("Name a command as it is called, such as `whirl man identify` or `whirl man device set`")
    })
}

/// The page of a command and those of the commands below it.
fn collect(command: &Command, name: &str, pages: &mut Vec<Page>) -> Result<()> {
    let mut text = Vec::new();
    // The synopsis as --help has it, with what an option takes.
    let usage = command.clone().render_usage().to_string();
    let usage = usage.trim().trim_start_matches("Usage:").trim().to_owned();
    Man::new(command.clone().display_name(name).override_usage(usage))
        .source(concat!("whirl ", env!("CARGO_PKG_VERSION")))
        .render(&mut text)
        .map_err(|e| BadInput::new(e.to_string(), "a page"))?;
    text.extend_from_slice(EXIT_STATUS.as_bytes());
    pages.push((format!("{name}.1"), text));
    command.get_subcommands().try_for_each(|below| collect(below, &format!("{name}-{}", below.get_name()), pages))
}

/// The pages of all commands, that of the program first.
fn all() -> Result<Vec<Page>> {
    let mut program = super::command().disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    collect(&program, "whirl", &mut pages)?;
    Ok(pages)
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
        let pages = all().unwrap();
        let of = |name: &str| {
            let (_, text) = pages.iter().find(|(n, _)| n == name).unwrap();
            String::from_utf8(text.clone()).unwrap().replace("\\-", "-")
        };
        assert!(of("whirl.1").contains("capture"));
        assert!(of("whirl-capture.1").contains("--live") && of("whirl-capture.1").contains("--until"));
        assert!(of("whirl-device-set.1").contains("whirl device set"), "{}", of("whirl-device-set.1"));
        assert!(of("whirl-identify.1").contains("--rig <RIG.toml>"), "{}", of("whirl-identify.1"));
        for page in ["whirl.1", "whirl-device-set.1"] {
            let text = of(page);
            let source = format!("\"whirl {}\"", env!("CARGO_PKG_VERSION"));
            assert!(text.lines().any(|l| l.starts_with(".TH") && l.contains(&source)), "{text}");
            assert!(text.contains("EXIT STATUS"), "{text}");
        }
        let words = ["device".to_owned(), "set".to_owned()];
        assert_eq!(
            String::from_utf8(page(&pages, &words).unwrap().to_vec()).unwrap().replace("\\-", "-"),
            of("whirl-device-set.1")
        );
        assert_eq!(page(&pages, &[]).unwrap(), pages[0].1);
        assert!(page(&pages, &["dance".to_owned()]).unwrap_err().to_string().contains("a command of `whirl --help`"));
        let commands = crate::cli::command();
        let below: usize = commands.get_subcommands().map(|c| 1 + c.get_subcommands().count()).sum();
        assert_eq!(pages.len(), 1 + below);
    }
}

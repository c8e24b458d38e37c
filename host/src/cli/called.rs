//! Commands called as functions ([`crate::api`]).

use std::ffi::OsString;

use clap::FromArgMatches;

use super::single::{self, Answered, Single};
use super::{Answer, Cli, Command, progress};
use crate::api::{Called, CommandOption, Error, Result};
use crate::said;

/// Options that say how something is printed, and with how many threads it is done.
const OF_PRINTING: [&str; 5] = ["help", "version", "quiet", "threads", "json"];

/// As a program that calls sees it.
fn usage(error: &clap::Error, words: &[OsString]) -> Error {
    Error::Usage(super::usage::told(error, &as_text(words)).to_string())
}

fn parse(words: &[OsString]) -> Result<Command> {
    let line = std::iter::once(OsString::from("whirl")).chain(words.iter().cloned());
    let matches = super::command().try_get_matches_from(line).map_err(|e| usage(&e, words))?;
    let cli = Cli::from_arg_matches(&matches).map_err(|e| usage(&e, words))?;
    if cli.threads > 0 {
        return Err(Error::Usage("--threads is for the program: RAYON_NUM_THREADS says it here".to_owned()));
    }
    Ok(cli.command)
}

fn as_text(words: &[OsString]) -> Vec<String> {
    words.iter().map(|w| w.to_string_lossy().into_owned()).collect()
}

/// Calls a command.
pub fn call(words: &[OsString]) -> Result<Called> {
    progress::set_quiet(true);
    match parse(words)? {
        Command::Identify(a) => kept(words, &a, |c| if let Command::Identify(a) = c { Some(a) } else { None }),
        Command::Validate(a) => kept(words, &a, |c| if let Command::Validate(a) = c { Some(a) } else { None }),
        Command::Explain(a) => kept(words, &a, |c| if let Command::Explain(a) = c { Some(a) } else { None }),
        Command::Inspect(a) => plain(words, || super::inspect::run(&a)),
        Command::Init(a) => plain(words, || super::init::run(&a)),
        Command::Simulate(a) => plain(words, || super::simulate::run(&a)),
        Command::Reduce(a) => plain(words, || super::reduce::run(&a)),
        Command::Export(a) => plain(words, || super::export::run(&a)),
        Command::List(a) => plain(words, || super::list::run(&a)),
        _ => Err(Error::Usage("this command is for the program alone".to_owned())),
    }
}

/// A command of whose answer nothing is kept.
fn plain(words: &[OsString], run: impl FnOnce() -> crate::error::Result<Answer>) -> Result<Called> {
    let (answer, said) = said::during(as_text(words), run);
    Ok(Called { positive: answer? == Answer::Positive, said, writer: None })
}

/// A command whose answer is kept; `own` finds its arguments.
fn kept<C>(words: &[OsString], arguments: &C, own: fn(Command) -> Option<C>) -> Result<Called>
where
    C: Single + 'static,
    C::Ready: Send,
    C::Result: Send + Sync,
{
    let (answered, said) = said::during(as_text(words), || single::answer(arguments));
    let (answer, answered) = answered?;
    // Options may stand before the records alone, where a `--` says that no more of them come.
    let (name, rest) = words.split_at(words.len().min(1));
    let (name, rest) = (name.to_vec(), rest.to_vec());
    let writer = answered.map(|answered| -> crate::api::Writer {
        Box::new(move |further| write(&answered, &[&name, further, &without(&rest, further)].concat(), own))
    });
    Ok(Called { positive: answer == Answer::Positive, said, writer })
}

/// The option that a word names, `-o` for either of its names.
fn option_of(word: &OsString) -> Option<String> {
    let word = word.to_string_lossy();
    match word.split('=').next().filter(|w| w.starts_with('-')) {
        Some("--output") => Some("-o".to_owned()),
        Some(long) if long.starts_with("--") => Some(long.to_owned()),
        Some(short) => Some(short.chars().take(2).collect()),
        None => None,
    }
}

/// The words of a call without the options that further words give anew: each may stand once.
fn without(words: &[OsString], further: &[OsString]) -> Vec<OsString> {
    let anew: Vec<String> = further.iter().filter_map(option_of).collect();
    let mut out = Vec::new();
    let mut left = words.iter();
    while let Some(word) = left.next() {
        if word == "--" {
            out.push(word.clone());
            break;
        }
        let Some(option) = option_of(word).filter(|o| anew.contains(o)) else {
            out.push(word.clone());
            continue;
        };
        let text = word.to_string_lossy();
        let has_value = text.contains('=') || (!text.starts_with("--") && text.chars().count() > 2);
        if option != "--force" && !has_value {
            left.next();
        }
    }
    out.extend(left.cloned());
    out
}

/// Writes an answer out by a command line that differs from its own by files that are written.
fn write<C: Single>(answered: &Answered<C>, words: &[OsString], own: fn(Command) -> Option<C>) -> Result<()> {
    let Some(arguments) = own(parse(words)?) else { return Ok(()) };
    single::check(&arguments)?;
    said::during(as_text(words), || answered.write(&arguments)).0.map_err(Error::from)
}

/// Options of a command.
pub fn options(command: &str) -> Vec<CommandOption> {
    let mut all = super::command();
    all.build();
    let Some(command) = all.find_subcommand(command) else { return Vec::new() };
    let wanted =
        command.get_arguments().filter(|a| !a.is_hide_set()).filter(|a| !OF_PRINTING.contains(&a.get_id().as_str()));
    let option = |a: &clap::Arg| CommandOption {
        name: a.get_long().map_or_else(|| a.get_id().to_string(), str::to_owned),
        help: a.get_help().map(ToString::to_string).unwrap_or_default(),
        takes_value: a.get_action().takes_values(),
    };
    wanted.map(option).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_named_anew_takes_the_place_of_the_first() {
        let of = |text: &str| text.split(' ').map(OsString::from).collect::<Vec<_>>();
        let call = of("--rig rig.toml --report=a.html --json a.json -oa.toml --force -- --report=r.csv");
        assert_eq!(
            without(&call, &of("--report=b.html")),
            of("--rig rig.toml --json a.json -oa.toml --force -- --report=r.csv")
        );
        assert_eq!(
            without(&call, &of("-o b.toml --json=b.json --force")),
            of("--rig rig.toml --report=a.html -- --report=r.csv")
        );
    }
}

//! A command line that is none, in the words of all other bad input: the option, what was found,
//! what is expected, what to do.

use std::error::Error as _;

use clap::error::{ContextKind, ContextValue, ErrorKind};

use crate::error::BadInput;
use crate::wording::close::did_you_mean;

/// What a parser of numbers says, and what it expects.
const NUMBERS: [(&str, &str); 6] = [
    ("invalid float literal", "a number"),
    ("cannot parse float from empty string", "a number"),
    ("invalid digit found in string", "a whole number, 0 or more"),
    ("cannot parse integer from empty string", "a whole number"),
    ("number too large to fit in target type", "a smaller whole number"),
    ("number too small to fit in target type", "a greater whole number"),
];

/// What to do about an option or file that is missing.
const MISSING: [(&str, &str); 4] = [
    ("--rig", "A rig file says what each column measures: `whirl init REC -o RIG.toml` writes one from a record"),
    ("<REC>", "Name a record, such as rec.parquet or rec.csv"),
    ("--model", "`whirl identify REC --rig RIG.toml -o MODEL.toml` writes one"),
    ("--from", "Say where the device is, such as serial:/dev/ttyACM0; `whirl device list` lists ports"),
];

/// What stands for a word of a command, where it is one of a few.
const WORDS: [(&str, &str); 2] =
    [("<WHAT>", "one of models, effects, boards, methods"), ("<SHELL>", "one of bash, elvish, fish, powershell, zsh")];

/// Shells without completions: none of the others is meant by them.
const SHELLS: [&str; 8] = ["tcsh", "csh", "ksh", "mksh", "sh", "dash", "nu", "xonsh"];

/// Whether the parser was asked for a text (help, version), which is no error.
pub fn is_asked(error: &clap::Error) -> bool {
    !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
}

/// What is wrong with a command line, of words without the program's name.
pub fn told(error: &clap::Error, words: &[String]) -> BadInput {
    let one = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(list)) => list.first().cloned(),
        _ => None,
    };
    // `--seconds <S>` without what stands for its value.
    let option = one(ContextKind::InvalidArg).unwrap_or_default();
    let option = option.split(" <").next().unwrap_or_default().to_owned();
    let value = one(ContextKind::InvalidValue);
    let help = help(error, words);
    match error.kind() {
        ErrorKind::MissingRequiredArgument => missing(&list(error, ContextKind::InvalidArg), &help),
        ErrorKind::ValueValidation => {
            let said = error.source().map(ToString::to_string).unwrap_or_default();
            of_value(&said, value.as_deref().unwrap_or("")).at(option).remedy(help)
        }
        ErrorKind::InvalidValue => {
            let known = list(error, ContextKind::ValidValue);
            let expected = if known.is_empty() { "a value".to_owned() } else { format!("one of {}", known.join(", ")) };
            match value.filter(|v| !v.is_empty()) {
                Some(v) => {
                    let known = known.iter().map(String::as_str);
                    let is_meant = !SHELLS.contains(&v.as_str());
                    let meant = if is_meant { did_you_mean(&v, known) } else { String::new() };
                    BadInput::new(format!("\"{v}\""), expected).at(option).remedy(format!("{meant}{help}"))
                }
                None => BadInput::new("no value", expected).at(option).remedy(help),
            }
        }
        ErrorKind::UnknownArgument => {
            let meant = one(ContextKind::SuggestedArg).map_or_else(String::new, |a| format!("Did you mean {a}? "));
            let what = if option.starts_with('-') { "the option" } else { "the word" };
            BadInput::new(format!("{what} \"{option}\""), "one that this command has").remedy(format!("{meant}{help}"))
        }
        ErrorKind::InvalidSubcommand => {
            let word = one(ContextKind::InvalidSubcommand).unwrap_or_default();
            let near = list(error, ContextKind::SuggestedSubcommand);
            let meant = did_you_mean(&word, near.iter().map(String::as_str));
            BadInput::new(format!("\"{word}\""), "a command").remedy(format!("{meant}{help}"))
        }
        ErrorKind::ArgumentConflict => {
            let plain = |n: &String| n.split(" <").next().unwrap_or_default().to_owned();
            let other = list(error, ContextKind::PriorArg).iter().map(plain).collect::<Vec<_>>().join(", ");
            let beside = if other.is_empty() || other == option {
                "a second time".to_owned()
            } else {
                format!("beside {other}")
            };
            BadInput::new(format!("{option} {beside}"), "one of them").remedy(help)
        }
        _ => BadInput::new(first_words(error), "").remedy(help),
    }
}

fn list(error: &clap::Error, kind: ContextKind) -> Vec<String> {
    match error.get(kind) {
        Some(ContextValue::Strings(list)) => list.clone(),
        Some(ContextValue::String(text)) => vec![text.clone()],
        _ => Vec::new(),
    }
}

/// Options and files that are missing.
fn missing(names: &[String], help: &str) -> BadInput {
    let remedy = MISSING.iter().find(|(name, _)| names.iter().any(|n| n.starts_with(name)));
    let remedy = remedy.map_or_else(|| help.to_owned(), |(_, what)| format!("{what}. {help}"));
    // `--rig <RIG.toml>` as people write it.
    let plain: Vec<String> = names.iter().map(|n| n.replace(['<', '>'], "").replace("...", " …")).collect();
    let first = |n: &String| n.split(' ').next().unwrap_or_default().to_owned();
    let found: Vec<String> = plain.iter().map(first).collect();
    let word = WORDS.iter().find(|(name, _)| names.iter().any(|n| n.starts_with(name)));
    let expected = word.map_or_else(|| plain.join(" "), |(_, expected)| (*expected).to_owned());
    BadInput::new(format!("no {}", found.join(", no ")), expected).remedy(remedy)
}

/// A value that an option does not take, and what its parser said.
fn of_value(said: &str, value: &str) -> BadInput {
    let found = format!("\"{value}\"");
    if let Some((_, expected)) = NUMBERS.iter().find(|(s, _)| *s == said) {
        return BadInput::new(found, *expected);
    }
    // As clap's ranges and whirl's own parsers say it: VALUE is not in LOW..=HIGH, "VALUE" is not FORM.
    if let Some((low, high)) = said.strip_prefix(value).and_then(|s| s.strip_prefix(" is not in ")?.split_once("..=")) {
        return BadInput::new(found, format!("a whole number from {low} to {high}"));
    }
    match said.strip_prefix(&found).and_then(|s| s.strip_prefix(" is not ")) {
        Some(expected) => BadInput::new(found, expected),
        None => BadInput::new(said, ""),
    }
}

/// The first paragraph of the parser's own text, on one line.
fn first_words(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let words = text.split("\n\n").next().unwrap_or(text);
    words.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Where the options are told.
fn help(error: &clap::Error, called: &[String]) -> String {
    let usage = match error.get(ContextKind::Usage) {
        Some(ContextValue::StyledStr(text)) => text.to_string(),
        _ => String::new(),
    };
    let words = usage.trim().trim_start_matches("Usage:").split_whitespace();
    // Whatever the file is called that is run.
    let behind = words.skip(1).take_while(|w| !w.starts_with(['[', '<', '-'])).map(str::to_owned);
    let mut behind: Vec<String> = behind.collect();
    if behind.is_empty() {
        // Of a wrong value the parser keeps no usage.
        behind = command_of(called);
    }
    let command: Vec<String> = std::iter::once("whirl".to_owned()).chain(behind).collect();
    format!("`{} --help` lists what it takes", command.join(" "))
}

/// The command that words of a command line begin with, and the one within it.
fn command_of(words: &[String]) -> Vec<String> {
    let mut here = crate::cli::command();
    let mut out = Vec::new();
    for word in words.iter().filter(|w| !w.starts_with('-')) {
        let Some(inner) = here.find_subcommand(word).cloned() else { break };
        here = inner;
        out.push(word.clone());
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_command_line_that_is_none_is_told_like_other_bad_input() {
        for (line, parts) in [
            (
                "identify r.csv",
                &["found no --rig, expected --rig RIG.toml", "whirl init REC -o", "whirl identify --help"][..],
            ),
            ("identify --rig r.toml", &["found no REC", "Name a record"]),
            (
                "simulate --rig r.toml --seconds abc --seed 1 -o r.csv",
                &["--seconds", "found \"abc\", expected a number."],
            ),
            (
                "simulate --rig r.toml --seconds 1 --seed -1 -o r.csv",
                &["found \"-1\", expected a whole number, 0 or more"],
            ),
            ("identify r.csv --rig r.toml --method wek", &["found \"wek\", expected one of ", "Did you mean weak?"]),
            ("identify r.csv --rig r.toml --metod weak", &["the option \"--metod\"", "Did you mean --method?"]),
            ("identfy r.csv", &["found \"identfy\", expected a command. Did you mean identify?"]),
            ("identify r.csv --rig r.toml --map x", &["--map", "found \"x\", expected MEASURE=COLUMN, such as"]),
            ("identify r.csv --rig a --rig b", &["--rig", "a second time"]),
            ("list", &["found no WHAT, expected one of models, effects, boards, methods"]),
            ("completions", &["found no SHELL, expected one of bash, elvish"]),
            ("completions tcsh", &["found \"tcsh\", expected one of bash, elvish, fish, powershell, zsh. `whirl"]),
            ("explain r.csv --rig r.toml --output m.toml --metod", &["the option \"--metod\""]),
            ("plan --rig r --budget 900 --output p", &["found \"900\", expected a whole number from 1 to 500"]),
        ] {
            let words = std::iter::once("whirl").chain(line.split_whitespace());
            let error = crate::cli::command().try_get_matches_from(words).unwrap_err();
            let words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
            let told = super::told(&error, &words).to_string();
            assert!(parts.iter().all(|p| told.contains(p)) && !told.contains("invalid"), "{line}: {told}");
        }
    }
    #[test]
    fn the_command_of_a_line_is_the_one_whose_help_is_named() {
        for (line, command) in [
            ("batch --shard 3/2 x", "batch"),
            ("--quiet list foo", "list"),
            ("device set a", "device set"),
            ("foo", ""),
        ] {
            let words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
            assert_eq!(super::command_of(&words).join(" "), command, "{line}");
        }
    }
}

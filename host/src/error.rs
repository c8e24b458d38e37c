//! The one error that a person sees for bad input: file, place, value found, value expected, remedy
//! (exit status 2).
//!
//! What a message quotes comes from files, devices and wires that may be hostile: [`plain`] shows
//! control characters instead of obeying them, [`brief`] also cuts what is long, and [`tell`] is
//! how a line gets to standard error.

use std::fmt;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Characters of a part of a message that are shown: three lines of a terminal.
const SHOWN: usize = 300;
/// Characters of a whole message.
const LINE: usize = 2000;
/// Digits of a number that are shown as they stand: one in 64 bits has at most 20, a shortest
/// binary64 near 1 at most 24.
const DIGITS: usize = 24;

/// Whether a terminal would obey this character instead of showing it: C0, DEL, C1, and Unicode's
/// marks of line, paragraph and direction, with which a text can be made to look like another.
pub(crate) fn obeyed(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// A text as it may stand on a terminal, on one line: what a terminal would obey is written as an
/// escape (`\n`, `\u{1b}`).
pub fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if obeyed(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out
}

/// As [`plain`], for a text whose lines are its own.
pub fn plain_lines(text: &str) -> String {
    text.split('\n').map(plain).collect::<Vec<_>>().join("\n")
}

/// As [`plain`], with numbers of more than 24 digits rounded and no more than 300 characters.
pub fn brief(text: &str) -> String {
    cut(&short_numbers(&plain(text)), SHOWN)
}

/// The first so many characters.
fn cut(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// The last 300 characters: a path's end says more than its beginning.
fn cut_path(text: &str) -> String {
    match text.chars().count().checked_sub(SHOWN) {
        Some(left_out @ 1..) => format!("…{}", text.chars().skip(left_out).collect::<String>()),
        _ => text.to_owned(),
    }
}

/// Runs of more digits than a number needs, such as those of 1e300 or 1e-310, as powers of ten.
pub(crate) fn short_numbers(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let digit = |c: char| c.is_ascii_digit() || c == '.';
    while let Some(start) = rest.find(digit) {
        let (before, from) = rest.split_at(start);
        let (run, after) = from.split_at(from.find(|c| !digit(c)).unwrap_or(from.len()));
        out.push_str(before);
        match run.parse::<f64>() {
            Ok(x) if run.len() > DIGITS => out.push_str(&format!("{x:e}")),
            _ => out.push_str(run),
        }
        rest = after;
    }
    out + rest
}

/// One line on standard error, `whirl: TEXT`. One that is full or closed is no reason to end
/// otherwise than without the line. Kept where a program called ([`crate::said`]).
pub fn tell(text: impl fmt::Display) {
    let line = cut(&plain(&text.to_string()), LINE);
    if crate::said::kept(|said| said.remarks.push(line.clone())).is_none() {
        let _ = writeln!(std::io::stderr().lock(), "whirl: {line}");
    }
}

/// An operating system's error in words, without its number.
pub fn io_words(error: &std::io::Error) -> String {
    use std::io::ErrorKind;
    // One without a number is a text of whirl's own.
    if error.raw_os_error().is_none() {
        return error.to_string();
    }
    let words = match error.kind() {
        ErrorKind::NotFound => "No such file or folder",
        ErrorKind::PermissionDenied => "no right to open or write it",
        ErrorKind::StorageFull => "no space left on the disk",
        ErrorKind::ReadOnlyFilesystem => "a disk that is not written to (read-only)",
        ErrorKind::NotADirectory => "a file where a folder was named",
        _ => {
            let text = error.to_string();
            return text.split(" (os error").next().unwrap_or(&text).to_owned();
        }
    };
    words.to_owned()
}

/// Result of anything that reads what a user or a wire supplied.
pub type Result<T> = std::result::Result<T, BadInput>;

/// Bad input or usage. Printed on one line: `FILE: PLACE: found FOUND, expected EXPECTED. REMEDY`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadInput {
    /// File (or port, or option) that holds the bad value.
    pub file: Option<PathBuf>,
    /// Where in it: row, column, key, byte.
    pub place: Option<String>,
    /// What was found there.
    pub found: String,
    /// What was expected instead (may be empty where `found` says it all).
    pub expected: String,
    /// What to do about it.
    pub remedy: String,
}

impl BadInput {
    /// What was found and what was expected, without a place yet.
    pub fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { file: None, place: None, found: found.into(), expected: expected.into(), remedy: String::new() }
    }

    /// Names the file (kept if one is named already: the innermost knows best).
    pub fn in_file(mut self, file: impl AsRef<Path>) -> Self {
        self.file.get_or_insert_with(|| file.as_ref().to_path_buf());
        self
    }

    /// Names the place in the file (kept if one is named already).
    pub fn at(mut self, place: impl Into<String>) -> Self {
        self.place.get_or_insert_with(|| place.into());
        self
    }

    /// Says what to do about it.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = remedy.into();
        self
    }

    /// An operating system's error on a file.
    pub fn io(file: impl AsRef<Path>, error: &std::io::Error) -> Self {
        Self::new(io_words(error), "").in_file(file)
    }
}

impl fmt::Display for BadInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", cut_path(&plain(&file.to_string_lossy())))?;
        }
        if let Some(place) = &self.place {
            write!(f, "{}: ", brief(place))?;
        }
        if self.expected.is_empty() {
            write!(f, "{}", brief(&self.found))?;
        } else {
            // What whirl itself expects may be a long list, and is whole.
            write!(f, "found {}, expected {}", brief(&self.found), short_numbers(&plain(&self.expected)))?;
        }
        if !self.remedy.is_empty() {
            write!(f, ". {}", plain(&self.remedy))?;
        }
        Ok(())
    }
}

impl std::error::Error for BadInput {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_shown() {
        assert_eq!(plain("a\u{1b}[2J\r\n\tb\u{7f}\u{9b}\u{202e}c"), "a\\u{1b}[2J\\r\\n\\tb\\u{7f}\\u{9b}\\u{202e}c");
        assert_eq!(plain("θ1 ± 0.5 µm — “ü” …"), "θ1 ± 0.5 µm — “ü” …");
        assert_eq!(plain_lines("a\u{7}\nb\n"), "a\\u{7}\nb\n");
    }

    #[test]
    fn an_operating_systems_error_has_no_number() {
        let e = std::fs::read("/no/such/file").unwrap_err();
        assert_eq!(BadInput::io("x.csv", &e).to_string(), "x.csv: No such file or folder");
        for number in [13, 28, 110, 111] {
            assert!(!io_words(&std::io::Error::from_raw_os_error(number)).contains("os error"), "{number}");
        }
        assert_eq!(io_words(&std::io::Error::other("no answer")), "no answer");
    }

    #[test]
    fn long_texts_and_numbers_are_cut() {
        assert_eq!(brief(&"é".repeat(400)), format!("{}…", "é".repeat(300)));
        assert_eq!(brief(&format!("x = {} m, {}", 1e300, 1e-310)), "x = 1e300 m, 1e-310");
        assert_eq!(
            brief(&format!("{} {} 1.2.3", u64::MAX, -0.000_123_456_789_012_345_67)),
            format!("{} -0.00012345678901234567 1.2.3", u64::MAX)
        );
        assert_eq!(brief(&"1.".repeat(20)), "1.".repeat(20));
        let path = format!("/{}/end.csv", "d".repeat(400));
        assert!(BadInput::new("x", "").in_file(&path).to_string().ends_with("ddd/end.csv: x"));
    }

    #[test]
    fn a_message_is_one_line_whatever_it_quotes() {
        let e = BadInput::new("\u{1b}]0;x\u{7}\n", "a\nb").in_file("new\nline.csv").at("line 1\r").remedy("do\nthis");
        let text = e.to_string();
        assert!(!text.chars().any(char::is_control), "{text:?}");
        assert!(text.starts_with("new\\nline.csv: line 1\\r: found \\u{1b}]0;x\\u{7}\\n"), "{text}");
    }
}

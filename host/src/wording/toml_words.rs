//! What the reader of TOML met, in the words of this program: where, what was found, what is
//! expected, what to do.

use crate::error::BadInput;

use super::close::did_you_mean;

/// What the reader says of a text that is no TOML, what that is for a person, and what is expected.
const SYNTAX: [(&str, &str, &str); 19] = [
    ("unclosed table", "a name of a table without its closing bracket", "[name] on one line"),
    ("unclosed array table", "a name of a table without its closing brackets", "[[name]] on one line"),
    ("unclosed inline table", "a { without its }", "{ key = value, … }"),
    ("unclosed array", "a [ without its ]", "[value, value, …]"),
    ("missing comma", "two values without a comma between them", "a comma between them"),
    ("extra comma", "a comma too many", "one comma between two values"),
    ("extra assignment", "two signs =", "key = value"),
    ("extra `=`", "two signs =", "key = value"),
    ("unexpected `=`", "a sign = in a list", "[value, value, …], or { key = value, … }"),
    ("missing assignment", "a key without a value", "key = value"),
    ("missing value", "a key without a value", "key = value"),
    ("key with no value", "a key without a value", "key = value"),
    ("unexpected content", "more behind the value", "the end of the line"),
    ("unexpected leading zero", "a number with a 0 before it", "the number without it"),
    ("carriage return must", "a carriage return without a line feed", "line ends of Linux or Windows"),
    ("recursion limit", "lists or tables within each other too deep", "fewer of them"),
    ("cannot recurse", "lists or tables within each other too deep", "fewer of them"),
    ("invalid basic string", "a text whose quote is not closed", "a text between two quotes on one line"),
    ("invalid literal string", "a text whose quote is not closed", "a text between two quotes on one line"),
];

/// "line L, column C" of a byte, both from 1; columns in characters.
pub fn place(text: &str, byte: usize) -> String {
    let mut end = byte.min(text.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let before = &text[..end];
    let line = before.matches('\n').count() + 1;
    let column = before[before.rfind('\n').map_or(0, |i| i + 1)..].chars().count() + 1;
    format!("line {line}, column {column}")
}

/// An error of the TOML reader on `text`, which is `what` ("a rig file") and whose keys `page`
/// tells; the file is for the caller to name.
pub fn told(error: &toml::de::Error, text: &str, what: &str, page: &str) -> BadInput {
    let at = error.span().map_or_else(|| what.trim_start_matches("a ").to_owned(), |s| place(text, s.start));
    let message = error.message().replace('\n', " ");
    let message = message.trim();
    let met = error.span().and_then(|s| text.get(s)).unwrap_or("");
    let line = error.span().map_or("", |s| line_at(text, s.start));
    let keys = format!("the keys of {what} are listed in {page}");
    in_plain_words(message, met.trim(), line.trim()).at(at).remedy(remedy(message, line, &keys))
}

/// A message about the characters `met` of a line.
fn in_plain_words(message: &str, met: &str, line: &str) -> BadInput {
    if let Some((key, known)) = unknown_key(message) {
        return BadInput::new(format!("the key \"{key}\""), format!("one of {}", known.join(", ")));
    }
    if let Some(number) = decimal_comma(line) {
        return BadInput::new(number, format!("a decimal point, {}", number.replace(',', ".")));
    }
    if message == "duplicate key" {
        return BadInput::new(format!("the key \"{met}\" a second time"), "each key once");
    }
    if let Some((key, _)) = message.strip_prefix("missing field `").and_then(|m| m.split_once('`')) {
        return BadInput::new(format!("no {key}"), "it in this part of the file");
    }
    if let Some((key, _)) = message.strip_prefix("duplicate field `").and_then(|m| m.split_once('`')) {
        return BadInput::new(format!("the key \"{key}\" a second time"), "each key once");
    }
    if let Some((found, expected)) =
        message.strip_prefix("unknown variant `").and_then(|m| m.split_once("`, expected "))
    {
        return BadInput::new(format!("\"{found}\""), expected.replace('`', "\""));
    }
    if let Some((found, expected)) = message.strip_prefix("invalid length ").and_then(|m| m.split_once(", expected ")) {
        let values = |n: &str| if n == "1" { "1 value".to_owned() } else { format!("{n} values") };
        let most = expected.rsplit(' ').next().filter(|n| n.bytes().all(|b| b.is_ascii_digit())).unwrap_or("other");
        return BadInput::new(values(found), values(most));
    }
    if message.starts_with("string values must be quoted") {
        let value = line.split_once('=').map_or(met, |(_, value)| value.trim());
        if value.is_empty() {
            return BadInput::new("a key without a value", "key = value");
        }
        return BadInput::new(format!("{value} without quotes"), "a number, true, false, or a text in quotes");
    }
    if let Some((_, found, expected)) = SYNTAX.iter().find(|(start, _, _)| message.starts_with(start)) {
        return BadInput::new(format!("{found}: {line}"), *expected);
    }
    let typed = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "));
    match typed.and_then(|m| m.rsplit_once(", expected ")) {
        Some((found, expected)) => BadInput::new(value(found), kind(expected)),
        None if message.starts_with("invalid ") || message.starts_with("unquoted ") || message.contains("expected") => {
            BadInput::new(format!("the line {line}"), "key = value, [table], [[table]] or a # comment")
        }
        None => BadInput::new(message.to_owned(), ""),
    }
}

/// The value of a line that is one number with a decimal comma.
fn decimal_comma(line: &str) -> Option<&str> {
    let value = line.split_once('=')?.1.split('#').next()?.trim();
    let (whole, part) = value.split_once(',')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (digits(whole.trim_start_matches(['-', '+'])) && digits(part)).then_some(value)
}

/// A value as the reader calls it.
fn value(found: &str) -> String {
    let (kind, value) = found.split_once(' ').unwrap_or((found, ""));
    match kind {
        "string" => format!("the text {value}"),
        "integer" => format!("the number {}", value.trim_matches('`')),
        "floating" => format!("the number {}", value.trim_start_matches("point ").trim_matches('`')),
        "boolean" => value.trim_matches('`').to_owned(),
        "sequence" => "a list".to_owned(),
        "map" => "a table".to_owned(),
        _ => found.to_owned(),
    }
}

/// A kind of value as the reader calls it.
fn kind(expected: &str) -> String {
    let kind = match expected {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more, without quotes",
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number without quotes",
        "f32" | "f64" => "a number without quotes",
        "a string" => "a text in quotes",
        "a boolean" => "true or false",
        "a sequence" => "a list in brackets",
        "a map" => "a table",
        other => match other.strip_prefix("an array of length ") {
            Some(n) => return format!("a list of {n} values"),
            // `struct Name` is a table to a person.
            None if other.starts_with("struct ") => "a table",
            None => other,
        },
    };
    kind.to_owned()
}

/// The key that a message of the TOML reader says is not known, and those that are.
fn unknown_key(message: &str) -> Option<(&str, Vec<&str>)> {
    let (key, known) = message.strip_prefix("unknown field `")?.split_once('`')?;
    let known: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
    (!known.is_empty()).then_some((key, known))
}

/// The line of a byte.
fn line_at(text: &str, at: usize) -> &str {
    let from = text.get(..at).and_then(|before| before.rfind('\n')).map_or(0, |i| i + 1);
    text.get(from..).and_then(|rest| rest.lines().next()).unwrap_or("")
}

/// What to do about a message: it says what the reader met, not how it came about.
fn remedy(message: &str, line: &str, keys: &str) -> String {
    if line.trim_start().starts_with("[channel]") {
        return "Write [[channel]] with two brackets: each is one of a list".to_owned();
    }
    if message.contains("invalid basic string") || message.contains("invalid literal string") {
        return "Close the quote: a text stands between two of them on one line".to_owned();
    }
    if message.starts_with("string values must be quoted") {
        let is_empty = line.split_once('=').is_some_and(|(_, value)| value.trim().is_empty());
        return if is_empty { "Write its value behind the sign =" } else { "Put it in quotes" }.to_owned();
    }
    if message == "duplicate key" || message.starts_with("duplicate field") {
        return "Take one of the two out".to_owned();
    }
    if message.starts_with("carriage return must") {
        return "Save the file with line ends of Linux or Windows".to_owned();
    }
    if let Some((key, _)) = message.strip_prefix("missing field `").and_then(|m| m.split_once('`')) {
        let example = match key {
            "unit" => ", such as unit = \"count\" or unit = \"rad\"",
            "name" => ", such as name = \"count1\"",
            "measures" => ", such as measures = \"theta1\"",
            "channel" => ": a part [[channel]] for each column of the record",
            "frequency_hz" => ", such as frequency_hz = 5.0",
            _ => "",
        };
        return format!("Add {key}{example}; {keys}");
    }
    if SYNTAX.iter().any(|(start, _, _)| message.starts_with(start)) {
        return "Correct this line".to_owned();
    }
    let meant = unknown_key(message).map_or_else(String::new, |(key, known)| did_you_mean(key, known));
    format!("{meant}Correct this key; {keys}")
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only what is refused is looked at")]
    struct File {
        name: String,
        part: Option<Part>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only what is refused is looked at")]
    struct Part {
        m1: f64,
        #[serde(default)]
        initial: [f64; 4],
    }

    #[test]
    fn a_decimal_comma_is_told() {
        assert_eq!(decimal_comma("sample_rate_hz = 200,0 # Hz"), Some("200,0"));
        assert_eq!(decimal_comma("offset = -1,25"), Some("-1,25"));
        for line in ["a = [1,2]", "a = \"1,2\"", "a = 1,2,3", "a = 1.0", "[table]"] {
            assert_eq!(decimal_comma(line), None, "{line}");
        }
        let text = "a = 200,0\n";
        let error = toml::from_str::<toml::Table>(text).unwrap_err();
        let told = told(&error, text, "a rig file", "docs/rig-file.md").to_string();
        assert!(told.contains("found 200,0, expected a decimal point, 200.0"), "{told}");
    }

    #[test]
    fn the_readers_words_are_not_shown() {
        for (text, parts) in [
            ("name = \"x\"\n[part]\n", ["line 2", "found no m1, expected it in this part", "Add m1"]),
            (
                "name = \"x\"\n[part]\nm1 = 1.0\ninitial = [1.0, 2.0, 3.0]\n",
                ["line 4, column 11", "found 3 values, expected 4 values", "the keys of a rig file"],
            ),
            (
                "name = \"x\"\n[part]\nm1 = \"90 deg\"\n",
                ["line 3, column 6", "found the text \"90 deg\", expected a number without quotes", "Correct"],
            ),
            ("name = \"x\"\nname = \"y\"\n", ["line 2, column 1", "the key \"name\" a second time", "Take one"]),
            ("name = abc\n", ["line 1", "found abc without quotes, expected a number", "Put it in quotes"]),
            ("name = \"x\"\n[part\nm1 = 1.0\n", ["line 2", "without its closing bracket", "Correct this line"]),
            ("name =\n", ["line 1", "a key without a value", "expected key = value"]),
            ("name = \"x\n", ["line 1", "quote is not closed", "Close the quote"]),
            ("nmae = \"x\"\n", ["line 1", "found the key \"nmae\", expected one of name, part", "Did you mean name?"]),
        ] {
            let error = toml::from_str::<File>(text).unwrap_err();
            let message = told(&error, text, "a rig file", "docs/rig-file.md").to_string();
            assert!(parts.iter().all(|p| message.contains(p)), "{text}: {message}");
            let of_the_reader = ["field `", "f64", "invalid", "duplicate", "TOML", "array of length"];
            assert!(!of_the_reader.iter().any(|w| message.contains(w)), "{message}");
        }
    }
}

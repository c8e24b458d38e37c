//! Values of a TOML file with their places, for messages that point at the character.

use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{BadInput, Result};
use crate::wording::toml_words;

/// The text of a file and where it came from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The text.
    pub text: String,
    /// The file.
    pub path: PathBuf,
}

/// The user's page of model files, and of effect files.
pub const MODEL_PAGE: &str = "docs/model-file.md";
const EFFECT_PAGE: &str = "docs/effects.md";

/// The page that tells the keys of what is called so.
fn page(what: &str) -> &'static str {
    if what.contains("effect") || what.contains("shape parameter") { EFFECT_PAGE } else { MODEL_PAGE }
}

/// A value with its place.
pub type Value<'i> = Spanned<DeValue<'i>>;

impl Source {
    /// "line L, column C" of a byte, both from 1; columns in characters.
    pub fn place(&self, byte: usize) -> String {
        toml_words::place(&self.text, byte)
    }

    /// An error at a byte.
    pub fn bad(&self, byte: usize, found: impl Into<String>, expected: impl Into<String>) -> BadInput {
        BadInput::new(found, expected).in_file(&self.path).at(self.place(byte))
    }

    /// Parses the text as TOML.
    pub fn table(&self) -> Result<Spanned<DeTable<'_>>> {
        DeTable::parse(&self.text)
            .map_err(|e| toml_words::told(&e, &self.text, "such a file", MODEL_PAGE).in_file(&self.path))
    }

    /// Refuses keys that are not known.
    pub fn known_keys(&self, table: &DeTable<'_>, known: &[&str], what: &str) -> Result<()> {
        // In the order of the file, so that the first is told.
        let mut unknown: Vec<_> = table.keys().filter(|k| !known.contains(&k.get_ref().as_ref())).collect();
        unknown.sort_by_key(|k| k.span().start);
        match unknown.first() {
            None => Ok(()),
            Some(key) => Err(self
                .bad(key.span().start, format!("the key \"{}\"", key.get_ref()), format!("one of {}", known.join(", ")))
                .remedy(format!("These are the keys of {what}; see {}", page(what)))),
        }
    }

    /// A key's value, required.
    pub fn required<'a, 'i>(
        &self,
        table: &'a DeTable<'i>,
        span: Range<usize>,
        key: &str,
        expected: &str,
    ) -> Result<&'a Value<'i>> {
        table.get(key).ok_or_else(|| self.no_key(span.start, key, expected, MODEL_PAGE))
    }

    /// The same in an effect file.
    pub fn effect_key<'a, 'i>(
        &self,
        table: &'a DeTable<'i>,
        span: Range<usize>,
        key: &str,
        expected: &str,
    ) -> Result<&'a Value<'i>> {
        table.get(key).ok_or_else(|| self.no_key(span.start, key, expected, EFFECT_PAGE))
    }

    fn no_key(&self, byte: usize, key: &str, expected: &str, page: &str) -> BadInput {
        self.bad(byte, format!("no key \"{key}\""), expected).remedy(format!("Add {key}; see {page}"))
    }

    /// A text.
    pub fn text<'a>(&self, value: &'a Value<'_>, expected: &str) -> Result<&'a str> {
        value.get_ref().as_str().ok_or_else(|| {
            self.bad(value.span().start, described(value.get_ref()), expected.to_owned()).remedy("Write it in quotes")
        })
    }

    /// A number.
    pub fn number(&self, value: &Value<'_>, expected: &str) -> Result<f64> {
        let parsed = match value.get_ref() {
            DeValue::Integer(i) if i.radix() == 10 => i.as_str().replace('_', "").parse::<f64>().ok(),
            DeValue::Float(f) => f.as_str().replace('_', "").parse::<f64>().ok(),
            _ => None,
        };
        parsed.filter(|x| x.is_finite()).ok_or_else(|| {
            self.bad(value.span().start, described(value.get_ref()), expected.to_owned())
                .remedy("Write a finite number")
        })
    }

    /// Byte at which a place inside a quoted text stands, exact where the text holds no escapes.
    pub fn inside(&self, value: &Value<'_>, offset: usize) -> usize {
        let start = value.span().start;
        let quoted = &self.text[start.min(self.text.len())..];
        let quotes = if quoted.starts_with("\"\"\"") || quoted.starts_with("'''") { 3 } else { 1 };
        // A line feed right after three quotes is dropped.
        let dropped = usize::from(quotes == 3 && quoted[3..].starts_with('\n'));
        start + quotes + dropped + offset
    }
}

/// What a value is, for messages.
pub fn described(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(s) => format!("\"{s}\""),
        DeValue::Integer(i) => i.as_str().to_owned(),
        DeValue::Float(f) => f.as_str().to_owned(),
        DeValue::Boolean(b) => b.to_string(),
        DeValue::Datetime(d) => d.to_string(),
        DeValue::Array(a) if a.is_empty() => "an empty list".to_owned(),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

/// Reads a text file.
pub fn read(path: &Path, what: &str) -> Result<Source> {
    let text = crate::files::read_text(path, what, &format!("Name {what} that exists"))?;
    Ok(Source { text, path: path.to_path_buf() })
}

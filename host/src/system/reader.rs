//! Values of a system file: tables, names, expressions, with their places.

use toml::de::{DeTable, DeValue};

use super::dimensions::Measures;
use super::polynomial::Polynomial;
use super::words::{Scope, Scoped, Value as Word, Words};
use crate::error::Result;
use crate::model::model_file::parser::parse;
use crate::model::model_file::toml_place::{Source, Value, described};
use crate::model::model_file::{check_name, mistake};

/// Most names of one kind.
const MOST_NAMES: usize = 64;

/// A file and its names, for what reads its parts.
pub struct Reader<'a> {
    /// The file.
    pub source: &'a Source,
    /// Names declared so far.
    pub words: Words,
    /// What they are counted in; none of a name whose unit is not known.
    pub measures: Measures,
}

/// A key with its value, in the file's order.
pub type Entry<'a, 'i> = (&'a str, usize, &'a Value<'i>);

impl<'a> Reader<'a> {
    /// Of a file, without names.
    pub fn new(source: &'a Source) -> Self {
        Self { source, words: Words::default(), measures: Measures::new() }
    }
}

impl Reader<'_> {
    /// Entries of a table in the order of the file.
    pub fn entries<'a, 'i>(&self, table: &'a DeTable<'i>) -> Vec<Entry<'a, 'i>> {
        let mut all: Vec<Entry<'a, 'i>> =
            table.iter().map(|(k, v)| (k.get_ref().as_ref(), k.span().start, v)).collect();
        all.sort_by_key(|e| e.1);
        all
    }

    /// A table at a key, if there.
    pub fn table<'a, 'i>(&self, top: &'a DeTable<'i>, key: &str, example: &str) -> Result<Vec<Entry<'a, 'i>>> {
        match top.get(key) {
            None => Ok(Vec::new()),
            Some(v) => match v.get_ref() {
                DeValue::Table(t) if t.len() <= MOST_NAMES => Ok(self.entries(t)),
                DeValue::Table(t) => Err(self.source.bad(
                    v.span().start,
                    format!("{} entries of {key}", t.len()),
                    format!("at most {MOST_NAMES}"),
                )),
                other => Err(self
                    .source
                    .bad(v.span().start, described(other), example.to_owned())
                    .remedy(format!("Write {key} as a table"))),
            },
        }
    }

    /// Tables at a key in double brackets.
    pub fn tables<'a, 'i>(&self, top: &'a DeTable<'i>, key: &str) -> Result<Vec<(&'a DeTable<'i>, usize)>> {
        let Some(v) = top.get(key) else { return Ok(Vec::new()) };
        let wrong = |at: usize, what: &DeValue<'_>| {
            self.source
                .bad(at, described(what), format!("[[{key}]], at most {MOST_NAMES} times"))
                .remedy(format!("Write [[{key}]] in double brackets"))
        };
        match v.get_ref() {
            DeValue::Array(a) if a.len() <= MOST_NAMES => a
                .iter()
                .map(|item| match item.get_ref() {
                    DeValue::Table(t) => Ok((t, item.span().start)),
                    other => Err(wrong(item.span().start, other)),
                })
                .collect(),
            other => Err(wrong(v.span().start, other)),
        }
    }

    /// An expression, in quotes or a bare number.
    pub fn value(&self, value: &Value<'_>, scope: Scope) -> Result<Word> {
        if matches!(value.get_ref(), DeValue::Integer(_) | DeValue::Float(_)) {
            let x = self.source.number(value, "a number")?;
            return Ok(Word::Scalar(Polynomial::number(x)));
        }
        let text = self.source.text(value, "an expression in quotes")?;
        let word = parse(text, &Scoped(&self.words, scope)).map_err(|m| mistake(self.source, value, text, m))?;
        self.measured(value, scope)?;
        Ok(word)
    }

    /// An expression that is a number.
    pub fn scalar(&self, value: &Value<'_>, scope: Scope) -> Result<Polynomial> {
        match self.value(value, scope)? {
            Word::Scalar(p) => Ok(p),
            Word::Vector(_) => Err(self
                .source
                .bad(value.span().start, format!("the vector {}", described(value.get_ref())), "a number")
                .remedy("Write one of its components, or an angle")),
        }
    }

    /// An expression that is a vector with as many components as those before.
    pub fn vector(&self, value: &Value<'_>) -> Result<Vec<Polynomial>> {
        let bad = |found: String, expected: String| {
            Err(self.source.bad(value.span().start, found, expected).remedy("Points have right and up, or three axes"))
        };
        match self.value(value, Scope::Motion)? {
            Word::Vector(v) => match self.words.points.first() {
                Some((name, first)) if first.len() != v.len() => bad(
                    format!("a vector of {} components", v.len()),
                    format!("{} as in the point {name}", first.len()),
                ),
                _ => Ok(v),
            },
            Word::Scalar(_) => {
                bad(described(value.get_ref()), "a vector such as \"[x, 0]\" or a sum of points".to_owned())
            }
        }
    }

    /// Refuses a name that is taken or cannot be one.
    pub fn new_name(&self, at: usize, name: &str) -> Result<()> {
        let w = &self.words;
        let taken: Vec<String> = [&w.coordinates[..], &w.inputs, &w.parameters].concat();
        let more = w.constants.iter().map(|c| c.0.clone()).chain(w.points.iter().map(|p| p.0.clone()));
        check_name(self.source, at, name, &taken.into_iter().chain(more).collect::<Vec<_>>())?;
        if ["along", "across", "atan2", "step"].contains(&name) {
            return Err(self
                .source
                .bad(at, format!("the name \"{name}\""), "a name that expressions do not use otherwise")
                .remedy("Rename it"));
        }
        Ok(())
    }

    /// The name of a body or joint: free of blanks and of those before.
    pub fn own_name(&self, table: &DeTable<'_>, at: usize, taken: &[&str]) -> Result<String> {
        let value = self.source.required(table, at..at, "name", "a name")?;
        let name = self.source.text(value, "a name")?;
        let bad = |found: String, expected: &str| {
            Err(self.source.bad(value.span().start, found, expected.to_owned()).remedy("Rename it"))
        };
        if name.is_empty() || !name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-')) || name.len() > 64 {
            return bad(format!("the name \"{name}\""), "letters, digits, _ and -, at most 64");
        }
        if taken.contains(&name) {
            return bad(format!("the name \"{name}\" a second time"), "each name once");
        }
        Ok(name.to_owned())
    }
}

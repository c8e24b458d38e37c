//! An effect's entry: keys, laws, shapes, read and checked, every mistake with its line and column.

use toml::de::{DeTable, DeValue};

use super::columns::LOAD;
use crate::error::Result;
use crate::model::model_file::expression::{Node, Symbol, number, symbol};
use crate::model::model_file::parser::parse;
use crate::model::model_file::toml_place::{Source, Value, described};
use crate::model::model_file::{check_name, mistake};
use crate::system::derivative::by_time;
use crate::system::language::Reader;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::{Scope, Scoped, Value as Word, Words};

/// Most values of a shape parameter, and most forms of an entry and of all that a user adds: bounds what a file can ask for.
pub const MOST_FORMS: usize = 400;

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum At {
    /// A joint.
    Joint,
    /// An arm.
    Arm,
    /// The driven point.
    Drive,
    /// The frame that carries everything.
    Frame,
    /// A sensor.
    Encoder,
    /// A measured input.
    Input,
}

/// Kinds of places by name, and the words of each.
const PLACES: [(&str, At, &[&str]); 6] = [
    ("joint", At::Joint, &["x", "v", "t", LOAD]),
    ("arm", At::Arm, &["omega"]),
    ("drive", At::Drive, &["y", "size", "t"]),
    ("frame", At::Frame, &[]),
    ("encoder", At::Encoder, &["x", "v"]),
    ("input", At::Input, &["x", "v"]),
];

/// Words of what acts all along an arm.
const ALONG_AN_ARM: &[&str] = &["v", "s"];
/// The shape parameter that says on how much of it.
pub const LENGTH: &str = "length";

/// How it acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verb {
    /// Does work.
    Force,
    /// Does work all along an arm, a force per length.
    Drags,
    /// Displaces the driven point.
    Moves,
    /// Advances the drive's phase.
    Advances,
    /// Turns a centroid or gravity.
    Turns,
    /// Is what a sensor shows, or what is recorded of an input.
    Reads,
}

/// Verbs by key, and the places that have them.
const VERBS: [(&str, Verb, &[At]); 6] = [
    ("force", Verb::Force, &[At::Joint, At::Arm]),
    ("drags", Verb::Drags, &[At::Arm]),
    ("moves", Verb::Moves, &[At::Drive]),
    ("advances", Verb::Advances, &[At::Drive]),
    ("turns", Verb::Turns, &[At::Arm, At::Frame]),
    ("reads", Verb::Reads, &[At::Encoder, At::Input]),
];

/// A parameter that fixes an effect's form.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Name.
    pub name: String,
    /// Values that are tried.
    pub grid: Vec<f64>,
    /// Bounds of its refinement; none for a whole number, which is not refined.
    pub within: Option<[f64; 2]>,
    /// Whether the values are the frequencies, Hz, of lines in what is left of a record; `grid` then only stands for them.
    pub of_lines: bool,
}

/// An effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Name before the `@`.
    pub id: String,
    /// Where it acts.
    pub at: At,
    /// How.
    pub verb: Verb,
    /// The law.
    pub law: String,
    /// Strengths, which enter linearly.
    pub strengths: Vec<String>,
    /// Whether each is positive by its nature.
    pub positive: Vec<bool>,
    /// Shape parameters.
    pub shapes: Vec<Shape>,
    /// Internal states, each with the law of its rate; they begin at 0.
    pub states: Vec<(String, String)>,
    /// What is reported of strengths and shapes; the first strength where nothing else is said.
    pub value: Option<String>,
    /// Further names that are reported.
    pub also: Vec<(String, String)>,
    /// The simpler effect that this one refines, for people.
    pub refines: Option<String>,
    /// Whether it needs something that turns.
    pub turning: bool,
    /// Whether it is another's law under the contract's name for a horizontal drive.
    pub alias: bool,
    /// Unit of its value, where it does not follow from the place.
    pub unit: Option<String>,
    /// What it adds, for people.
    pub equation: String,
    /// How it shows in residuals.
    pub signature: String,
    /// The laboratory test that would confirm it.
    pub confirm: String,
}

const KEYS: [&str; 19] = [
    "id",
    "at",
    "strengths",
    "sign",
    "shape",
    "states",
    "value",
    "also",
    "refines",
    "turning",
    "same_as",
    "unit",
    "equation",
    "signature",
    "confirm",
    "force",
    "moves",
    "turns",
    "reads",
];

/// One value of each shape parameter, in the entry's order.
pub type Form = Vec<(String, f64)>;

impl Entry {
    /// Every combination of shape parameters; one empty form where there are none.
    pub fn forms(&self) -> Vec<Form> {
        let mut out: Vec<Form> = vec![Vec::new()];
        for s in &self.shapes {
            out = out.iter().flat_map(|f| s.grid.iter().map(|x| [&f[..], &[(s.name.clone(), *x)]].concat())).collect();
        }
        out
    }

    /// The shape parameters that have bounds, which are refined where the law has one strength.
    pub fn bounded_shapes(&self) -> impl Iterator<Item = usize> {
        self.shapes.iter().enumerate().filter(|(_, s)| s.within.is_some()).map(|(k, _)| k)
    }

    /// Whether the law names a word.
    pub fn names(&self, word: &str) -> bool {
        has_word(&self.law, word)
    }

    /// The law in the words of a place: shape parameters are numbers, strengths the parameters from `words.parameters.len()`
    /// on.
    ///
    /// # Errors
    /// The first mistake in the law.
    pub fn law(
        &self,
        words: &Words,
        form: &Form,
    ) -> core::result::Result<Word, crate::model::model_file::parser::Mistake> {
        let rates = self.rates(words, form).map_err(|(_, m)| m)?;
        let mut words = self.words(words, form);
        words.scalars.extend(self.states.iter().zip(rates).map(|((name, _), rate)| (format!("{name}'"), rate)));
        parse(&self.law, &Scoped(&words, Scope::Motion))
    }

    /// The words of a place with shape parameters, strengths and states.
    pub(super) fn words(&self, words: &Words, form: &Form) -> Words {
        let mut words = words.clone();
        words.parameters.extend(self.strengths.iter().cloned());
        words.constants.extend(form.iter().cloned());
        let state = |(k, (name, _)): (usize, &(String, String))| (name.clone(), Polynomial::motion(Symbol::State(k)));
        words.scalars.extend(self.states.iter().enumerate().map(state));
        words
    }
}

/// Whether a law names a word.
pub(super) fn has_word(law: &str, word: &str) -> bool {
    law.split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|w| w == word)
}

/// Reads every `[[effect]]` of a file.
///
/// # Errors
/// Names file, line and column, what was found and what was expected.
pub fn read(source: &Source) -> Result<Vec<Entry>> {
    let table = source.table()?;
    let top = table.get_ref();
    source.known_keys(top, &["effect", "format"], "an effect file")?;
    let r = Reader { source, words: Words::default() };
    let mut out: Vec<Entry> = Vec::new();
    for (t, at) in r.tables(top, "effect")? {
        let entry = one(&r, t, at, &out)?;
        if out.iter().any(|e| e.id == entry.id) {
            return Err(source
                .bad(at, format!("the effect {} a second time", entry.id), "each id once")
                .remedy("Rename it"));
        }
        out.push(entry);
    }
    if out.is_empty() {
        return Err(source
            .bad(0, "no [[effect]]", "one [[effect]] or more")
            .remedy("Write an effect; see docs/effects.md"));
    }
    Ok(out)
}

fn one(r: &Reader<'_>, t: &DeTable<'_>, at: usize, before: &[Entry]) -> Result<Entry> {
    let known: Vec<&str> = KEYS.into_iter().chain(["advances", "drags"]).collect();
    r.source.known_keys(t, &known, "an effect")?;
    let id = r.source.text(r.source.required(t, at..at, "id", "a name such as \"magnet\"")?, "a name")?.to_owned();
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if id.is_empty() || id.len() > 40 || !id.chars().all(plain) {
        let here = t.get("id").map_or(at, |v| v.span().start);
        return Err(r
            .source
            .bad(here, format!("the id \"{id}\""), "small letters, digits and -, at most 40")
            .remedy("Rename the effect"));
    }
    let text = |key: &str| -> Result<Option<String>> {
        t.get(key).map(|v| r.source.text(v, "a text in quotes").map(str::to_owned)).transpose()
    };
    if let Some(v) = t.get("same_as") {
        let other = r.source.text(v, "the id of an effect above")?;
        let Some(same) = before.iter().find(|e| e.id == other) else {
            let ids: Vec<&str> = before.iter().map(|e| e.id.as_str()).collect();
            return Err(r
                .source
                .bad(v.span().start, format!("the effect \"{other}\""), format!("one of {}", ids.join(", ")))
                .remedy("Name an effect that stands above"));
        };
        return Ok(Entry { id, alias: true, ..same.clone() });
    }
    let place = r.source.required(t, at..at, "at", "joint, arm, drive, frame, encoder or input")?;
    let name = r.source.text(place, "joint, arm, drive, frame, encoder or input")?;
    let Some((_, place_at, vocabulary)) = PLACES.iter().find(|p| p.0 == name) else {
        return Err(r
            .source
            .bad(place.span().start, format!("the place \"{name}\""), "joint, arm, drive, frame, encoder or input")
            .remedy("Say where the effect acts"));
    };
    let (verb, law, law_value) = law(r, t, at, *place_at)?;
    let vocabulary = if verb == Verb::Drags { ALONG_AN_ARM } else { *vocabulary };
    let strengths = strengths(r, t, at)?;
    let positive = signs(r, t, &strengths)?;
    let shapes = shapes(r, t)?;
    let forms = shapes.iter().fold(1_usize, |n, s| n.saturating_mul(s.grid.len()));
    if forms > MOST_FORMS {
        let here = t.get("shape").map_or(at, |v| v.span().start);
        return Err(r
            .source
            .bad(here, format!("{forms} combinations of shapes"), format!("at most {MOST_FORMS}"))
            .remedy("Shorten the grids; what has bounds is refined anyway"));
    }
    let names: Vec<String> = strengths.iter().cloned().chain(shapes.iter().map(|s| s.name.clone())).collect();
    let states = super::states::read(r, t, (verb, vocabulary), &names)?;
    let turning = t.get("turning").is_some_and(|v| matches!(v.get_ref(), DeValue::Boolean(true)));
    let entry = Entry {
        equation: text("equation")?.unwrap_or_else(|| law.clone()),
        signature: text("signature")?.unwrap_or_default(),
        confirm: text("confirm")?.unwrap_or_default(),
        value: text("value")?,
        also: also(r, t)?,
        refines: text("refines")?,
        unit: text("unit")?,
        id,
        at: *place_at,
        verb,
        law,
        strengths,
        positive,
        shapes,
        states,
        turning,
        alias: false,
    };
    super::states::check(r, t, &entry, vocabulary)?;
    check(r, &entry, vocabulary, law_value)?;
    super::value::check(&entry).map_err(|(key, m)| match t.get(key.as_str()) {
        Some(v) => mistake(r.source, v, "", m),
        None => r.source.bad(at, m.found, m.expected).remedy(m.remedy),
    })?;
    Ok(entry)
}

/// The one verb of an entry.
fn law<'a, 'i>(r: &Reader<'_>, t: &'a DeTable<'i>, at: usize, place: At) -> Result<(Verb, String, &'a Value<'i>)> {
    let has: Vec<(&str, Verb, &Value<'i>)> =
        VERBS.iter().filter_map(|(key, verb, _)| t.get(*key).map(|v| (*key, *verb, v))).collect();
    let fits = |v: Verb| VERBS.iter().any(|(_, verb, places)| *verb == v && places.contains(&place));
    let wanted: Vec<&str> = VERBS.iter().filter(|v| v.2.contains(&place)).map(|v| v.0).collect();
    match has[..] {
        [(_, verb, v)] if fits(verb) => Ok((verb, r.source.text(v, "a law in quotes")?.to_owned(), v)),
        [] => Err(r
            .source
            .bad(at, "an effect without a law", format!("{} = \"…\"", wanted.join(" or ")))
            .remedy("Write what it adds")),
        [(key, _, v), ..] => Err(r
            .source
            .bad(v.span().start, format!("{key} at this place"), format!("one law, {}", wanted.join(" or ")))
            .remedy("Keep one law, that of the place")),
    }
}

fn strengths(r: &Reader<'_>, t: &DeTable<'_>, at: usize) -> Result<Vec<String>> {
    let v = r.source.required(t, at..at, "strengths", "a list of names such as [\"k\"]")?;
    let DeValue::Array(list) = v.get_ref() else {
        return Err(r
            .source
            .bad(v.span().start, described(v.get_ref()), "a list such as [\"k\"]")
            .remedy("Write a list"));
    };
    let mut out: Vec<String> = Vec::new();
    for item in list {
        let name = r.source.text(item, "a name")?;
        check_name(r.source, item.span().start, name, &out)?;
        out.push(name.to_owned());
    }
    if out.is_empty() || out.len() > 4 {
        return Err(r
            .source
            .bad(v.span().start, format!("{} strengths", out.len()), "one to four")
            .remedy("Name what enters linearly"));
    }
    Ok(out)
}

fn signs(r: &Reader<'_>, t: &DeTable<'_>, strengths: &[String]) -> Result<Vec<bool>> {
    let mut out = vec![false; strengths.len()];
    for (name, at, v) in r.table(t, "sign", "sign = { k = \"+\" }")? {
        match strengths.iter().position(|s| s == name) {
            Some(k) if r.source.text(v, "\"+\"")? == "+" => out[k] = true,
            Some(_) => {
                return Err(r
                    .source
                    .bad(v.span().start, described(v.get_ref()), "\"+\"")
                    .remedy("Turn the law's sign, so that the strength is positive"));
            }
            None => {
                return Err(r
                    .source
                    .bad(at, format!("the name {name}"), format!("one of {}", strengths.join(", ")))
                    .remedy("Name a strength"));
            }
        }
    }
    Ok(out)
}

fn also(r: &Reader<'_>, t: &DeTable<'_>) -> Result<Vec<(String, String)>> {
    r.table(t, "also", "also = { psi = \"atan2(S, C)\" }")?
        .into_iter()
        .map(|(name, _, v)| Ok((name.to_owned(), r.source.text(v, "an expression in quotes")?.to_owned())))
        .collect()
}

/// A list of finite numbers.
fn numbers(r: &Reader<'_>, v: &Value<'_>, least: usize) -> Result<Vec<f64>> {
    let wrong = || {
        r.source
            .bad(v.span().start, described(v.get_ref()), format!("a list of {least} to {MOST_FORMS} numbers"))
            .remedy("Write numbers in brackets")
    };
    let DeValue::Array(list) = v.get_ref() else { return Err(wrong()) };
    if list.len() < least || list.len() > MOST_FORMS {
        return Err(wrong());
    }
    list.iter().map(|x| r.source.number(x, "a number")).collect()
}

fn shapes(r: &Reader<'_>, t: &DeTable<'_>) -> Result<Vec<Shape>> {
    let mut out = Vec::new();
    let example = "shape = { v_s = { grid = [0.1, 1.0], within = [0.01, 10.0] } }, { n = { whole = [1, 60] } }, or { f = { lines = [0.1, 100.0] } }";
    for (name, at, v) in r.table(t, "shape", example)? {
        let DeValue::Table(keys) = v.get_ref() else {
            return Err(r.source.bad(at, described(v.get_ref()), example).remedy("Give a grid, or whole numbers"));
        };
        r.source.known_keys(keys, &["grid", "within", "whole", "lines"], "a shape parameter")?;
        let shape = match (keys.get("grid"), keys.get("whole"), keys.get("lines")) {
            (Some(g), None, None) => {
                let grid = numbers(r, g, 1)?;
                let within = keys.get("within").map(|w| numbers(r, w, 2)).transpose()?;
                let all = (f64::NEG_INFINITY, f64::INFINITY);
                let (low, high) = within.as_ref().map_or(all, |w| (w[0], w[1]));
                if low >= high || grid.iter().any(|x| *x < low || *x > high) {
                    return Err(r
                        .source
                        .bad(at, format!("a grid of {name} outside of {low} to {high}"), "a grid within its bounds")
                        .remedy("Correct within"));
                }
                Shape { name: name.to_owned(), grid, within: within.map(|w| [w[0], w[1]]), of_lines: false }
            }
            (None, None, Some(l)) => {
                let ends = numbers(r, l, 2)?;
                if !(ends[0] > 0.0 && ends[1] > ends[0]) {
                    return Err(r
                        .source
                        .bad(l.span().start, described(l.get_ref()), "two frequencies in Hz, [from, to], above 0")
                        .remedy("Correct them"));
                }
                let middle = (ends[0] * ends[1]).sqrt();
                Shape { name: name.to_owned(), grid: vec![middle], within: Some([ends[0], ends[1]]), of_lines: true }
            }
            (None, Some(w), None) => {
                let ends = numbers(r, w, 2)?;
                let whole = ends.iter().all(|x| x.fract() == 0.0 && x.abs() <= 1000.0);
                if !whole || ends[1] < ends[0] || ends[1] - ends[0] >= MOST_FORMS as f64 {
                    return Err(r
                        .source
                        .bad(w.span().start, described(w.get_ref()), "two whole numbers, [from, to]")
                        .remedy("Correct them"));
                }
                let (from, to) = (ends[0] as i32, ends[1] as i32); // whole, at most 1000
                Shape {
                    name: name.to_owned(),
                    grid: (from..=to).map(f64::from).collect(),
                    within: None,
                    of_lines: false,
                }
            }
            _ => return Err(r.source.bad(at, format!("the shape {name}"), example).remedy("Give one of them")),
        };
        out.push(shape);
    }
    Ok(out)
}

/// What an effect's first strength multiplies, in the words of a displacement: for its unit. The load, N, is the first input.
pub fn multiplied(e: &Entry, form: &Form, on: &Polynomial, coordinates: usize, omega: f64) -> Option<Node> {
    let rate = by_time(on, coordinates, omega).ok()?;
    let mut words = Words::default();
    let time = Polynomial::motion(Symbol::Time);
    words.scalars = vec![
        ("x".to_owned(), on.clone()),
        ("v".to_owned(), rate.clone()),
        ("omega".to_owned(), rate),
        ("t".to_owned(), time),
        (LOAD.to_owned(), Polynomial::motion(Symbol::Input(0))),
    ];
    words.constants.push(("T".to_owned(), 1.0));
    let Ok(Word::Scalar(law)) = e.law(&words, form) else { return None };
    let of = law.by_parameters().get(&vec![(Atom::Parameter(0), 1)]).map(Polynomial::node)?;
    // A state has the unit of the displacement, but that of a strength which is a force by itself none.
    let is_force = e.unit.as_deref() == Some("N m");
    let state = |s: Symbol| match s {
        Symbol::State(_) if is_force => number(1.0),
        Symbol::State(_) => on.node(),
        other => symbol(other),
    };
    Some(of.replace(&state))
}

/// Words of a place with stand-ins for what it offers.
pub fn stand_ins(vocabulary: &[&str]) -> Words {
    let mut words = Words::default();
    for (k, name) in vocabulary.iter().enumerate() {
        let of = match *name {
            "x" => Polynomial::motion(Symbol::Coordinate(0)),
            "v" | "omega" => Polynomial::motion(Symbol::Rate(0)),
            "t" => Polynomial::motion(Symbol::Time),
            _ => Polynomial::motion(Symbol::Coordinate(k + 1)),
        };
        words.scalars.push(((*name).to_owned(), of));
    }
    let unit = |up: f64| vec![Polynomial::number(1.0 - up), Polynomial::number(up)];
    if vocabulary.contains(&"y") {
        words.points = vec![("along".to_owned(), unit(1.0)), ("across".to_owned(), unit(0.0))];
    }
    if vocabulary.contains(&"t") {
        words.constants.push(("T".to_owned(), 1.0));
    }
    words
}

/// Strengths enter linearly, and nothing stands without one but what a sensor ought to show.
fn check(r: &Reader<'_>, e: &Entry, vocabulary: &[&str], at: &Value<'_>) -> Result<()> {
    if e.verb == Verb::Drags && !e.shapes.iter().any(|s| s.name == LENGTH && s.grid.iter().all(|x| *x > 0.0)) {
        let expected = format!("shape = {{ {LENGTH} = {{ grid = [1.0, 1.5], within = [0.001, 10.0] }} }}, above 0");
        return Err(r
            .source
            .bad(at.span().start, "drags without a length of the arm", expected)
            .remedy("Say on how much of the arm it acts; the grid is in lengths of the arm"));
    }
    let words = stand_ins(vocabulary);
    let Some(form) = e.forms().into_iter().next() else { return Ok(()) };
    let read = e.law(&words, &form).map_err(|m| mistake(r.source, at, &e.law, m))?;
    let bad =
        |found: &str, expected: &str, remedy: &str| Err(r.source.bad(at.span().start, found, expected).remedy(remedy));
    let parts = match (read, e.verb) {
        (Word::Vector(v), Verb::Moves) => v,
        (Word::Scalar(_), Verb::Moves) => {
            return bad("a number", "a displacement, along or across times a number", "Multiply by along or across");
        }
        (Word::Vector(_), _) => return bad("a vector", "a number", "Only moves is a vector"),
        (Word::Scalar(p), Verb::Reads) => vec![p.minus(&Polynomial::motion(Symbol::Coordinate(0)))],
        (Word::Scalar(p), _) => vec![p],
    };
    let mut seen = vec![false; e.strengths.len()];
    for (product, _) in parts.iter().flat_map(Polynomial::terms) {
        let own: Vec<(usize, i32)> = product
            .iter()
            .filter_map(|(a, n)| if let Atom::Parameter(k) = a { Some((*k, *n)) } else { None })
            .collect();
        match own[..] {
            [(k, 1)] => seen[k] = true,
            _ => {
                return bad(
                    &format!("\"{}\"", e.law),
                    "a law in which each term has one strength as a factor",
                    "Strengths enter linearly; anything else is a shape",
                );
            }
        }
    }
    if let Some(k) = seen.iter().position(|s| !s) {
        return bad(&format!("no {} in the law", e.strengths[k]), "every strength in it", "Remove the name, or use it");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn of(text: &str) -> Result<Vec<Entry>> {
        read(&Source { text: text.to_owned(), path: Path::new("e.toml").to_path_buf() })
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        let head = "[[effect]]\nid = \"magnet\"\nat = \"joint\"\nstrengths = [\"k\"]\n";
        for (rest, line, told) in [
            ("", 1, "without a law"),
            ("force = \"-k*z\"", 5, "z"),
            ("force = \"-k*x\"\nreads = \"x + k\"", 5, "one law"),
            ("moves = \"k*along\"", 5, "moves at this place"),
            ("force = \"-k^2*x\"", 5, "one strength as a factor"),
            ("force = \"x\"", 5, "one strength as a factor"),
            ("force = \"-k*x\"\nsign = { q = \"+\" }", 6, "the name q"),
            ("force = \"-k*x\"\nshape = { n = { whole = [1, 1e9] } }", 6, "whole numbers"),
            ("force = \"-k*x\"\nshape = { n = { grid = [1.0], within = [2.0, 3.0] } }", 6, "outside"),
            ("force = \"-k*x\"\nshape = { n = { whole = [1, 30] }, m = { whole = [1, 30] } }", 6, "900 combinations"),
            ("force = \"-k*x\"\ncolour = \"red\"", 6, "colour"),
            ("force = \"-k*x\"\nvalue = \"k*q\"", 6, "q"),
            ("drags = \"-k*v\"", 5, "drags at this place"),
        ] {
            let error = of(&format!("{head}{rest}\n")).unwrap_err().to_string();
            assert!(error.contains(told) && error.contains(&format!("line {line}")), "{rest}: {error}");
        }
        let arm = "[[effect]]\nid = \"air\"\nat = \"arm\"\nstrengths = [\"k\"]\n";
        for (rest, told) in [("drags = \"-k*v\"", "without a length"), ("drags = \"-k*omega\"", "drags without")] {
            assert!(of(&format!("{arm}{rest}\n")).unwrap_err().to_string().contains(told), "{rest}");
        }
        assert!(of("[[effect]]\nid = \"a b\"\n").unwrap_err().to_string().contains("small letters"));
        assert!(of("").unwrap_err().to_string().contains("[[effect]]"));
    }

    #[test]
    fn forms_are_all_combinations() {
        let text = "[[effect]]\nid = \"m\"\nat = \"joint\"\nstrengths = [\"k\"]\nforce = \"-k*exp(-x/d)*sin(n*x)\"\nshape = { d = { grid = [0.1, 0.2] }, n = { whole = [1, 3] } }\n";
        let e = of(text).unwrap().remove(0);
        assert_eq!(e.forms().len(), 6);
        assert_eq!(e.forms()[5], [("d".to_owned(), 0.2), ("n".to_owned(), 3.0)]);
    }
}

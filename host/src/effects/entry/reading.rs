//! An `[[effect]]` read from its file and checked: one law that fits the place, strengths that
//! enter linearly, shapes within bounds.
//!
//! Every mistake is told with file, line, column, what was expected and how to mend it.

use toml::de::{DeTable, DeValue};

use super::{At, Entry, LENGTH, MOST_FORMS, Shape, Verb, has_word, stand_ins, words_of};
use crate::effects::columns::LOAD;
use crate::effects::{on_a_frame, states, value};
use crate::error::Result;
use crate::model::model_file::expression::Symbol;
use crate::model::model_file::toml_place::{Source, Value, described};
use crate::model::model_file::{check_name, mistake};
use crate::system::language::Reader;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::Value as Word;

/// Kinds of places by name, and the words of each.
const PLACES: [(&str, At, &[&str]); 8] = [
    ("joint", At::Joint, &["x", "v", "t", LOAD]),
    ("between", At::Between, &["x", "v", "t"]),
    ("arm", At::Arm, &["omega"]),
    ("body", At::Body, &["v"]),
    ("drive", At::Drive, &["y", "size", "t"]),
    ("frame", At::Frame, &[]),
    ("encoder", At::Encoder, &["x", "v", "t"]),
    ("input", At::Input, &["x", "v"]),
];
/// Their names, for people.
const KINDS: &str = "joint, between, arm, body, drive, frame, encoder or input";
/// Verbs by key, and the places that have them.
const VERBS: [(&str, Verb, &[At]); 6] = [
    ("force", Verb::Force, &[At::Joint, At::Between, At::Arm]),
    ("drags", Verb::Drags, &[At::Arm, At::Body]),
    ("moves", Verb::Moves, &[At::Drive, At::Frame]),
    ("advances", Verb::Advances, &[At::Drive]),
    ("turns", Verb::Turns, &[At::Arm, At::Frame]),
    ("reads", Verb::Reads, &[At::Encoder, At::Input]),
];
/// Most shapes of an effect, as of strengths and states: their scales are tried in all combinations.
const MOST_SHAPES: usize = 4;
const KEYS: [&str; 20] = [
    "id",
    "at",
    "strengths",
    "sign",
    "takes_from",
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

/// Reads every `[[effect]]` of a file.
///
/// # Errors
/// Names file, line and column, what was found and what was expected.
pub fn read(source: &Source) -> Result<Vec<Entry>> {
    let table = source.table()?;
    let top = table.get_ref();
    source.known_keys(top, &["effect", "format"], "an effect file")?;
    let r = Reader::new(source);
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
    let id = r.source.text(r.source.effect_key(t, at..at, "id", "a name such as \"magnet\"")?, "a name")?.to_owned();
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
    let place = r.source.effect_key(t, at..at, "at", KINDS)?;
    let name = r.source.text(place, KINDS)?;
    let Some((_, place_at, vocabulary)) = PLACES.iter().find(|p| p.0 == name) else {
        return Err(r
            .source
            .bad(place.span().start, format!("the place \"{name}\""), KINDS)
            .remedy("Say where the effect acts"));
    };
    let (verb, law, law_value) = law(r, t, at, *place_at)?;
    let vocabulary = match (verb, place_at) {
        (Verb::Drags, At::Arm) => &["v", "s"],
        (Verb::Moves, At::Frame) => on_a_frame::WORDS,
        _ => vocabulary,
    };
    let strengths = strengths(r, t, at)?;
    let positive = signs(r, t, &strengths)?;
    let mut taken = words_of(vocabulary);
    taken.extend(strengths.iter().cloned());
    let shapes = shapes(r, t, &mut taken)?;
    let forms = shapes.iter().fold(1_usize, |n, s| n.saturating_mul(s.grid.len()));
    if forms > MOST_FORMS {
        let here = t.get("shape").map_or(at, |v| v.span().start);
        return Err(r
            .source
            .bad(here, format!("{forms} combinations of shapes"), format!("at most {MOST_FORMS}"))
            .remedy("Shorten the grids; what has bounds is refined anyway"));
    }
    let states = states::read(r, t, verb, vocabulary, taken)?;
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
        takes_from: text("takes_from")?,
        shapes,
        states,
        turning,
        alias: false,
        about: Vec::new(),
    };
    states::check(r, t, &entry, vocabulary)?;
    check(r, &entry, vocabulary, law_value)?;
    used_shapes(r, t, &entry)?;
    value::check(&entry).map_err(|(key, m)| match t.get(key.as_str()) {
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
    let v = r.source.effect_key(t, at..at, "strengths", "a list of names such as [\"k\"]")?;
    let DeValue::Array(list) = v.get_ref() else {
        let e = r.source.bad(v.span().start, described(v.get_ref()), "a list such as [\"k\"]");
        return Err(e.remedy("Write a list"));
    };
    let mut out: Vec<String> = Vec::new();
    for item in list {
        let name = r.source.text(item, "a name")?;
        check_name(r.source, item.span().start, name, &out)?;
        out.push(name.to_owned());
    }
    if out.is_empty() || out.len() > 4 {
        let e = r.source.bad(v.span().start, format!("{} strengths", out.len()), "one to four");
        return Err(e.remedy("Name what enters linearly"));
    }
    Ok(out)
}

fn signs(r: &Reader<'_>, t: &DeTable<'_>, strengths: &[String]) -> Result<Vec<bool>> {
    let mut out = vec![false; strengths.len()];
    for (name, at, v) in r.table(t, "sign", "sign = { k = \"+\" }")? {
        match strengths.iter().position(|s| s == name) {
            Some(k) if r.source.text(v, "\"+\"")? == "+" => out[k] = true,
            Some(_) => {
                let remedy = match v.get_ref().as_str() {
                    Some("-" | "−" | "minus") => "Turn the law's sign, so that the strength is positive",
                    _ => "Write \"+\" where it is positive by its nature; where it may be of either sign, leave it out",
                };
                return Err(r.source.bad(v.span().start, described(v.get_ref()), "\"+\"").remedy(remedy));
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

/// Reads the key `shape`; its names join those that are taken.
fn shapes(r: &Reader<'_>, t: &DeTable<'_>, taken: &mut Vec<String>) -> Result<Vec<Shape>> {
    let mut out = Vec::new();
    let example = "shape = { v_s = { grid = [0.1, 1.0], within = [0.01, 10.0] } }, { n = { whole = [1, 60] } }, or { f = { lines = [0.1, 100.0] } }";
    for (name, at, v) in r.table(t, "shape", example)? {
        // A word of the place would be read in its stead, and the grid tried in vain.
        check_name(r.source, at, name, taken)?;
        if out.len() == MOST_SHAPES {
            let e = r.source.bad(at, format!("more than {MOST_SHAPES} shapes"), format!("1 to {MOST_SHAPES}"));
            return Err(e.remedy("Use fewer"));
        }
        taken.push(name.to_owned());
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
                if low >= high {
                    let e = r.source.bad(at, format!("within = [{low}, {high}]"), "the lower bound first");
                    return Err(e.remedy(format!("Write within = [{high}, {low}]")));
                }
                if grid.iter().any(|x| *x < low || *x > high) {
                    let found = format!("a grid of {name} outside of {low} to {high}");
                    let e = r.source.bad(at, found, "a grid within its bounds");
                    return Err(e.remedy("Widen within, or leave out what lies beyond it"));
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

/// Refuses a shape that neither the law nor a state's names.
fn used_shapes(r: &Reader<'_>, t: &DeTable<'_>, e: &Entry) -> Result<()> {
    let of_drag = |name: &str| (e.verb, e.at) == (Verb::Drags, At::Arm) && name == LENGTH;
    let used = |name: &str| e.names(name) || e.states.iter().any(|(_, law)| has_word(law, name)) || of_drag(name);
    for (name, at, _) in r.table(t, "shape", "shape = { n = { whole = [1, 60] } }")? {
        if !used(name) {
            return Err(r
                .source
                .bad(at, format!("the shape {name}, which no law uses"), "every shape in the law or a state's")
                .remedy("Remove it, or use it"));
        }
    }
    Ok(())
}

/// Strengths enter linearly, and nothing stands without one but what a sensor ought to show.
fn check(r: &Reader<'_>, e: &Entry, vocabulary: &[&str], at: &Value<'_>) -> Result<()> {
    let is_length = |s: &Shape| s.name == LENGTH && s.grid.iter().all(|x| *x > 0.0);
    if (e.verb, e.at) == (Verb::Drags, At::Arm) && !e.shapes.iter().any(is_length) {
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
            let (one, other) = if e.at == At::Frame { ("right", "up") } else { ("along", "across") };
            let expected = format!("a displacement, {one} or {other} times a number");
            return bad("a number", &expected, &format!("Multiply by {one} or {other}"));
        }
        (Word::Vector(_), _) => return bad("a vector", "a number", "Only moves is a vector"),
        (Word::Scalar(p), Verb::Reads) => vec![p.minus(&Polynomial::motion(Symbol::Coordinate(0)))],
        (Word::Scalar(p), _) => vec![p],
    };
    if (e.verb, e.at) == (Verb::Moves, At::Frame) {
        // Mistakes in them were told by then.
        let rates = e.rates(&words, &form).unwrap_or_default();
        if let Some([found, expected, remedy]) = on_a_frame::mistake(e, &rates, &parts) {
            return bad(&found, &expected, &remedy);
        }
    }
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

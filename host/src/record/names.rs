//! Names of columns as people and instruments write them: `theta1_deg`, `Winkel 1 (deg)`,
//! `time_ms`, `Time [s]`.
//!
//! A unit may stand in brackets, wherever they are (`Force (N) Run 8`), or at the end of a name
//! behind `_`, a blank, `/` or `-`. What the time is called is known in some spellings; what
//! anything else is called, and what it measures, only the rig file says.

use std::path::Path;

use super::rows::missing_column;
use crate::error::{BadInput, Result};
use crate::rig::Channel;
use crate::wording::close::closest;

/// What the time is called, without its unit, in small letters.
const TIMES: [&str; 16] = [
    "t",
    "time",
    "times",
    "timestamp",
    "time stamp",
    "datetime",
    "date time",
    "elapsed",
    "elapsed time",
    "relative time",
    "zeit",
    "zeitstempel",
    "temps",
    "tiempo",
    "x value",
    "index level 0",
];

/// Units of time: what they are called, and how many there are in a second.
const TIME_UNITS: [(&str, &[&str], f64); 6] = [
    ("s", &["s", "sec", "secs", "second", "seconds", "sek", "sekunden"], 1.0),
    ("ms", &["ms", "msec", "millis", "milliseconds", "millisecond"], 1e3),
    ("us", &["us", "µs", "μs", "usec", "micros", "microseconds", "microsecond"], 1e6),
    ("ns", &["ns", "nsec", "nanos", "nanoseconds", "nanosecond"], 1e9),
    ("min", &["min", "mins", "minute", "minutes"], 1.0 / 60.0),
    ("h", &["h", "hour", "hours"], 1.0 / 3600.0),
];

/// A unit in a column's name: the rig file's unit, and by how much a value is multiplied to be in
/// it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NamedUnit {
    /// A unit of [`crate::rig::UNITS`]; none for what no channel can have (a rate, a temperature).
    pub unit: Option<&'static str>,
    /// Value in that unit over the column's value.
    pub factor: f64,
}

/// Spellings of units: exact ones first, those in small letters behind.
const UNITS: [(&[&str], Option<&str>, f64); 25] = [
    (&["deg", "degs", "degree", "degrees", "°", "grad"], Some("deg"), 1.0),
    (&["rad", "rads", "radian", "radians"], Some("rad"), 1.0),
    (&["mrad"], Some("rad"), 1e-3),
    (&["rev", "revs", "turn", "turns", "revolutions"], Some("deg"), 360.0),
    (&["count", "counts", "cnt", "cnts", "inc", "increments", "pulses", "ticks"], Some("count"), 1.0),
    (&["m", "meter", "metre", "meters", "metres"], Some("m"), 1.0),
    (&["cm"], Some("m"), 1e-2),
    (&["mm"], Some("mm"), 1.0),
    (&["um", "µm", "μm"], Some("um"), 1.0),
    (&["V", "volt", "volts"], Some("V"), 1.0),
    (&["mV"], Some("mV"), 1.0),
    (&["N", "newton"], Some("N"), 1.0),
    (&["mN"], Some("mN"), 1.0),
    (&["kN"], Some("kN"), 1.0),
    (&["A", "amp", "amps"], Some("A"), 1.0),
    (&["mA"], Some("A"), 1e-3),
    (&["m/s", "mps"], Some("m/s"), 1.0),
    (&["m/s2", "m/s²", "m/s^2"], Some("m/s2"), 1.0),
    (&["g"], Some("m/s2"), 9.80665),
    (&["rad/s", "rads/s"], None, 1.0),
    (&["deg/s", "°/s", "dps"], None, 1.0),
    (&["rpm", "Hz", "kHz"], None, 1.0),
    (&["°C", "degC", "K", "C"], None, 1.0),
    (&["1", "-"], Some("1"), 1.0),
    // Lengths of a scale that nobody says.
    (&["px", "pixel", "pixels"], Some("1"), 1.0),
];

/// How many of a unit of time there are in a second; none for what is no unit of time.
pub fn per_second(unit: &str) -> Option<f64> {
    let small = unit.trim().to_lowercase();
    TIME_UNITS.iter().find(|(_, names, _)| names.contains(&small.as_str())).map(|(_, _, n)| *n)
}

/// Units of time that may be named, for messages.
pub fn time_units() -> String {
    TIME_UNITS.map(|(name, _, _)| name).join(", ")
}

/// What a text for a unit means; none where it is none that is known.
pub fn unit(text: &str) -> Option<NamedUnit> {
    let text = text.trim();
    let small = text.to_lowercase();
    let of = |t: &str, single: bool| {
        // A single letter is taken as it stands: N is newton, n is nothing.
        UNITS
            .iter()
            .find(|(names, _, _)| names.iter().any(|n| *n == t || (single && n.chars().count() > 2 && *n == small)))
    };
    of(text, true).map(|(_, unit, factor)| NamedUnit { unit: *unit, factor: *factor })
}

/// What stands in brackets within a name, innermost first where they nest: where the bracket
/// begins, where it ends, and the text.
fn brackets(name: &str) -> Vec<(usize, usize, &str)> {
    let mut out = Vec::new();
    for (open, close) in [('(', ')'), ('[', ']'), ('<', '>'), ('{', '}')] {
        let mut opened = None;
        for (i, c) in name.char_indices() {
            if c == open {
                opened = Some(i);
            } else if c == close
                && let Some(at) = opened.take()
            {
                out.push((at, i + close.len_utf8(), name[at + open.len_utf8()..i].trim()));
            }
        }
    }
    out.sort_unstable();
    out
}

/// A name without its unit, and the unit's text where one stands in it.
pub fn split(name: &str) -> (String, Option<String>) {
    let name = name.trim();
    let bracketed = brackets(name);
    // A unit that is known, the last of several: what stands behind it is a run or a sensor.
    let is_known = |inner: &str| unit(inner).is_some() || per_second(inner).is_some();
    // "1" and "-" are numbers and dashes but at the end.
    let is_word = |inner: &str| inner.chars().any(|c| c.is_alphabetic() || c == '°');
    let known = bracketed.iter().rev().find(|(_, to, inner)| is_known(inner) && (*to == name.len() || is_word(inner)));
    // At the end it is one that is not known.
    if let Some((at, to, inner)) = known.or_else(|| bracketed.last().filter(|(_, to, _)| *to == name.len())) {
        let before = name[..*at].trim();
        let base = if before.is_empty() { name[*to..].trim() } else { before };
        return (base.to_owned(), Some((*inner).to_owned()));
    }
    // Behind a comma or a slash with blanks around: "Time, s", "x / mm".
    for separator in [", ", " / ", " in "] {
        if let Some((base, last)) = name.rsplit_once(separator)
            && (unit(last).is_some() || per_second(last).is_some())
        {
            return (base.trim().to_owned(), Some(last.trim().to_owned()));
        }
    }
    if let Some((base, last)) = name.rsplit_once(['_', ' ', '/', '-'])
        && !base.is_empty()
        && last.parse::<f64>().is_err()
        && !is_index(base, last)
        && (unit(last).is_some() || per_second(last).is_some())
    {
        return (base.trim().to_owned(), Some(last.to_owned()));
    }
    (name.to_owned(), None)
}

/// Whether a letter behind a name is a place and no unit: `V_C` is a voltage at C, `T_C` a
/// temperature.
fn is_index(base: &str, last: &str) -> bool {
    let small = base.to_lowercase();
    matches!(last, "C" | "K") && small != "t" && !small.starts_with("temp")
}

/// A name in small letters, its separators as single blanks.
fn plain(name: &str) -> String {
    let words: Vec<&str> =
        name.split(|c: char| c.is_whitespace() || "_-.:".contains(c)).filter(|w| !w.is_empty()).collect();
    words.join(" ").to_lowercase()
}

/// Whether a column's name says that it is the time.
pub fn is_time(name: &str) -> bool {
    is_called_time(name) || is_only_a_unit(name).is_some()
}

fn is_called_time(name: &str) -> bool {
    let (base, unit) = split(name);
    unit.is_none_or(|u| per_second(&u).is_some()) && TIMES.contains(&plain(&base).as_str())
}

/// How many there are in a second of the unit of time that a name is, and nothing else: `millis`,
/// as a microcontroller's log calls its clock. Not letters and short words that are other things.
pub fn is_only_a_unit(name: &str) -> Option<f64> {
    let name = plain(name);
    let other = name.chars().count() < 2 || name == "min" || name == "mins";
    if other { None } else { per_second(&name) }
}

/// Which column is the time and what it is counted in, as a rig file or an option says.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct TimeChoice {
    /// The column; none where it is to be found by its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Its unit, as it was written; none where its name or its type says it, or it is in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// The column of the time.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeColumn {
    /// Its place among the columns.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// How many of its units there are in a second, where somebody says so.
    pub per_second: Option<f64>,
}

/// Finds the column of the time: the one chosen, or `t`, or the only one that is called so.
///
/// # Errors
/// A chosen column that is not there, none that is called so, several, a unit of time that is none.
pub fn time_column(names: &[String], choice: &TimeChoice, path: &Path) -> Result<TimeColumn> {
    let (wanted, behind) = match &choice.column {
        // COLUMN:UNIT, unless a column is called so itself.
        Some(c) if !names.contains(c) => match c.rsplit_once(':') {
            Some((column, unit)) if per_second(unit).is_some() => (Some(column), Some(unit)),
            _ => (Some(c.as_str()), None),
        },
        Some(c) => (Some(c.as_str()), None),
        None => (None, None),
    };
    let index = match wanted {
        Some(c) => find(names, c, path).map_err(|e| not_the_time(e, names, c, behind))?,
        None => called_time(names, path)?,
    };
    let name = names[index].clone();
    let stated = behind.or(choice.unit.as_deref());
    let in_name = split(&name).1;
    let per_second = match (stated, &in_name) {
        (Some(text), _) => Some(per_second(text).ok_or_else(|| {
            BadInput::new(format!("\"{text}\""), format!("a unit of time: {}", time_units()))
                .at("time_unit")
                .remedy("Correct the rig file")
        })?),
        (None, Some(text)) => per_second(text),
        (None, None) => is_only_a_unit(&name),
    };
    Ok(TimeColumn { index, name, per_second })
}

/// Refuses a column of the time that a person names for a record that has the device's own time.
///
/// # Errors
/// Another one than `t`, in seconds.
pub fn own_time(asked: Option<&str>, path: &Path) -> Result<()> {
    match asked {
        None | Some("t" | "t:s") => Ok(()),
        Some(other) => Err(BadInput::new(
            format!("\"{other}\""),
            "t, the device's own time, by which a record that whirl made is read",
        )
        .in_file(path)
        .at("--time")
        .remedy("Leave --time out")),
    }
}

/// The column of the time as a record is written that is to be read with this choice: its name,
/// and how many of its units there are in a second.
pub fn written_time(choice: &TimeChoice) -> (String, f64) {
    let name = match choice.column.as_deref() {
        Some(c) => c.rsplit_once(':').filter(|(_, unit)| per_second(unit).is_some()).map_or(c, |(column, _)| column),
        None => "t",
    };
    let found = time_column(&[name.to_owned()], choice, Path::new(""));
    (name.to_owned(), found.ok().and_then(|t| t.per_second).unwrap_or(1.0))
}

/// The only column that is called like a time.
fn called_time(names: &[String], path: &Path) -> Result<usize> {
    if let Some(i) = names.iter().position(|n| n == "t") {
        return match names.iter().skip(i + 1).any(|n| n == "t") {
            true => Err(twice(path, "t")),
            false => Ok(i),
        };
    }
    let mut called: Vec<usize> = (0..names.len()).filter(|i| is_called_time(&names[*i])).collect();
    if called.is_empty() {
        called = (0..names.len()).filter(|i| is_only_a_unit(&names[*i]).is_some()).collect();
    }
    if called.is_empty() {
        called = (0..names.len()).filter(|i| last_part(&names[*i]).is_some_and(is_called_time)).collect();
    }
    match called[..] {
        [one] => Ok(one),
        [] => Err(missing_column(path, "t", names, &[])),
        [first, ..] => {
            let list: Vec<String> = called.iter().map(|i| format!("\"{}\"", names[*i])).collect();
            Err(BadInput::new(format!("{}, which all may be the time", list.join(" and ")), "one column for the time")
                .in_file(path)
                .at("header")
                .remedy(format!("Say which: --time \"{0}\", or time = \"{0}\" in the rig file", names[first])))
        }
    }
}

/// The error for a chosen time that is not there, with what is done about a time.
fn not_the_time(e: BadInput, names: &[String], wanted: &str, unit: Option<&str>) -> BadInput {
    if names.iter().any(|n| n == wanted) {
        return e;
    }
    let unit = unit.map_or_else(String::new, |u| format!(":{u}"));
    e.remedy(match closest(wanted, names.iter().map(String::as_str)) {
        Some(h) => format!("Did you mean {h}? Say --time \"{h}{unit}\", or time = \"{h}{unit}\" in the rig file"),
        None => "Say which column is the time: --time COLUMN, or time = \"COLUMN\" in the rig file".to_owned(),
    })
}

fn twice(path: &Path, name: &str) -> BadInput {
    BadInput::new(format!("the column {name} twice"), "each column once")
        .in_file(path)
        .at("header")
        .remedy("Rename one of them")
}

/// The name of a field or dataset behind the structures or groups that it stands in: `t` of
/// `run.data.t` and of `run/t`.
fn last_part(name: &str) -> Option<&str> {
    name.rsplit_once(['.', '/']).map(|(_, last)| last)
}

/// The columns of several names.
///
/// # Errors
/// As [`find`].
pub(super) fn find_all(names: &[String], wanted: &[Channel], path: &Path) -> Result<Vec<usize>> {
    let used: Vec<&str> = wanted.iter().map(|c| c.name.as_str()).collect();
    used.iter().map(|name| find_beside(names, name, &used, path)).collect()
}

/// The column of a name: as it stands, or the only one that differs in letters' case and separators
/// alone, or the only field of a structure that is called so.
///
/// # Errors
/// None, or one twice.
pub fn find(names: &[String], wanted: &str, path: &Path) -> Result<usize> {
    find_beside(names, wanted, &[], path)
}

/// As [`find`], where other columns are read too: none of them is proposed instead.
///
/// # Errors
/// As [`find`].
pub(super) fn find_beside(names: &[String], wanted: &str, used: &[&str], path: &Path) -> Result<usize> {
    let mut exact = (0..names.len()).filter(|i| names[*i] == wanted);
    if let Some(first) = exact.next() {
        return if exact.next().is_some() { Err(twice(path, wanted)) } else { Ok(first) };
    }
    let like = |f: &dyn Fn(&str) -> String| {
        let found: Vec<usize> = (0..names.len()).filter(|i| f(&names[*i]) == f(wanted)).collect();
        if let [one] = found[..] { Some(one) } else { None }
    };
    let field = || {
        let fields: Vec<usize> = (0..names.len()).filter(|i| last_part(&names[*i]) == Some(wanted)).collect();
        if let [one] = fields[..] { Some(one) } else { None }
    };
    like(&plain).or_else(field).ok_or_else(|| missing_column(path, wanted, names, used))
}

#[cfg(test)]
#[path = "names_tests.rs"]
mod tests;

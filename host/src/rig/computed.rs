//! Channels that are computed from several columns: a `name` that begins with `=`, such as
//! `=2*a - b` or `={Winkel 1 (deg)} - {Winkel 2 (deg)}`.
//!
//! The expression is written as those of model files ([`crate::model::model_file::parser`]) over
//! the names of columns: `+ − * / ^`, parentheses, functions of one argument, `pi`, and besides
//! `atan2(y, x)`, `atan`, `asin`, `acos` (`formula`). A name that is no word stands in braces.
//! Values are taken as they stand in the file, before gain and offset, which are the channel's own.
//! What comes out is unwrapped as the channel's unit says, like a column.

mod formula;

use std::cell::RefCell;
use std::path::Path;

pub(crate) use self::formula::Formula;
use self::formula::OF_TWO;
use super::Channel;
use crate::error::{BadInput, Result};
use crate::model::model_file::parser::{Fault, Grammar, parse};

/// Most columns of an expression.
const MOST_COLUMNS: usize = 64;

/// Where a channel's values come from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum From {
    /// The column with this index.
    Column(usize),
    /// An expression over columns.
    Expression(Formula),
}

/// The columns that are read for channels, and how the channels come from them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sources {
    /// The columns: those of channels that are no expression, as their channels say, then those of
    /// expressions, as they stand.
    pub(crate) columns: Vec<Channel>,
    /// One for each channel.
    pub(crate) channels: Vec<From>,
}

/// The expression of a computed channel; none for a channel that is a column.
pub fn expression(channel: &Channel) -> Option<&str> {
    channel.name.strip_prefix('=')
}

/// Whether some channel is computed.
pub(crate) fn any(channels: &[Channel]) -> bool {
    channels.iter().any(|c| expression(c).is_some())
}

/// Whether two channels have a column in common: neither then comes later than the other.
pub(crate) fn share_a_column(a: &Channel, b: &Channel) -> bool {
    let Ok(all) = sources(&[a.clone(), b.clone()], Path::new("")) else { return false };
    let holds = |from: &From, column: usize| match from {
        From::Column(own) => *own == column,
        From::Expression(formula) => formula.any(&|c| c == column),
    };
    (0..all.columns.len()).any(|column| all.channels.iter().all(|from| holds(from, column)))
}

/// The error for a channel that is computed where columns are written.
///
/// # Errors
/// Where there is one.
pub(crate) fn refuse(channels: &[Channel], path: &Path) -> Result<()> {
    match channels.iter().find(|c| expression(c).is_some()) {
        None => Ok(()),
        Some(c) => Err(BadInput::new(
            format!("a channel that is computed when a record is read, \"{}\"", c.name),
            "columns that can be written",
        )
        .in_file(path)
        .at(format!("channel \"{}\"", c.name))
        .remedy("Name the columns themselves in a rig file for this")),
    }
}

/// What is read for channels.
///
/// # Errors
/// An expression that is none: its character, what was found and what to do.
pub(crate) fn sources(channels: &[Channel], path: &Path) -> Result<Sources> {
    let plain = channels.iter().filter(|c| expression(c).is_none()).cloned();
    let mut columns: Vec<Channel> = plain.collect();
    let mut from = Vec::with_capacity(channels.len());
    for (i, channel) in channels.iter().enumerate() {
        let Some(text) = expression(channel) else {
            let before = channels[..i].iter().filter(|c| expression(c).is_none()).count();
            from.push(From::Column(before));
            continue;
        };
        let names = Columns { columns: RefCell::new(columns), braced: RefCell::default() };
        let words = names.words(text);
        let formula =
            words.and_then(|words| parse(&words, &names).map_err(|m| (m.at.start, m.found, m.expected, m.remedy)));
        let formula = formula.map_err(|(at, found, expected, remedy)| {
            let at = text.get(..at).map_or(0, |t| t.chars().count()) + 2;
            BadInput::new(found, expected)
                .in_file(path)
                .at(format!("channel {} (\"{}\"), character {at} of its name", i + 1, channel.name))
                .remedy(remedy)
        })?;
        if !formula.any(&|_| true) {
            return Err(BadInput::new("an expression without a column", "names of columns in it, such as =2*a - b")
                .in_file(path)
                .at(format!("channel {} (\"{}\")", i + 1, channel.name))
                .remedy("A column whose own name begins with = stands in braces: ={=name}"));
        }
        columns = names.columns.into_inner();
        from.push(From::Expression(formula));
    }
    Ok(Sources { columns, channels: from })
}

/// Columns by the names that an expression has for them.
struct Columns {
    columns: RefCell<Vec<Channel>>,
    /// Words that stand for names in braces.
    braced: RefCell<Vec<(String, String)>>,
}

/// Where in a text something is wrong: byte, found, expected, what to do.
type Wrong = (usize, String, String, String);

impl Columns {
    /// The text with a word of the same length for each name in braces, so that places stay where
    /// they are.
    fn words(&self, text: &str) -> core::result::Result<String, Wrong> {
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(open) = rest.find('{') {
            let at = text.len() - rest.len() + open;
            let Some(length) = rest[open..].find('}') else {
                return Err((
                    at,
                    "a \"{\" without its \"}\"".into(),
                    String::new(),
                    "Close it behind the column's name".into(),
                ));
            };
            let name = rest[open + 1..open + length].trim();
            let mut braced = self.braced.borrow_mut();
            if name.is_empty() || braced.len() >= MOST_COLUMNS {
                let expected = format!("a column's name in braces, at most {MOST_COLUMNS} of them");
                return Err((at, format!("\"{}\"", &rest[open..=open + length]), expected, "Name a column".into()));
            }
            let word = format!("_{:_<width$}", braced.len(), width = length);
            out.push_str(&rest[..open]);
            out.push_str(&word);
            braced.push((word, name.to_owned()));
            rest = &rest[open + length + 1..];
        }
        Ok(out + rest)
    }

    /// What stands for a column.
    fn column(&self, name: &str) -> core::result::Result<Formula, Fault> {
        let mut columns = self.columns.borrow_mut();
        let found = columns.iter().position(|c| c.name == name);
        if found.is_none() && columns.len() >= MOST_COLUMNS {
            return Err(Fault::new(format!("more than {MOST_COLUMNS} columns"), "fewer", "Shorten the expression"));
        }
        let index = found.unwrap_or_else(|| {
            columns.push(Channel::new(name, "1"));
            columns.len() - 1
        });
        Ok(Formula::Column(index))
    }
}

impl Grammar for Columns {
    type Value = Formula;
    const LISTS: bool = false;
    const ARGUMENTS: bool = true;

    fn number(&self, x: f64) -> Formula {
        Formula::Number(x)
    }

    fn operation(&self, operator: char, left: Formula, right: Formula) -> core::result::Result<Formula, Fault> {
        Ok(Formula::Operation(operator, Box::new(left), Box::new(right)))
    }

    fn name(&self, name: &str, primes: usize, called: bool) -> core::result::Result<Option<Formula>, Fault> {
        if primes > 0 {
            let found = format!("a derivative of {name}");
            return Err(Fault::new(
                found,
                "values of columns",
                "Remove the prime; identification differentiates by itself",
            ));
        }
        let braced = self.braced.borrow().iter().find(|(word, _)| word == name).map(|(_, column)| column.clone());
        match (braced, name) {
            (Some(column), _) => self.column(&column).map(Some),
            (None, "pi" | "π") => Ok(Some(Formula::Number(core::f64::consts::PI))),
            (None, _) if called => {
                if name == OF_TWO || formula::function(name).is_some() {
                    return Ok(None);
                }
                let expected = format!("one of the functions {}", formula::names().join(", "));
                Err(Fault::new(format!("the function \"{name}\""), expected, "Correct the function's name"))
            }
            (None, _) => self.column(name).map(Some),
        }
    }

    fn call(&self, name: &str, arguments: Vec<Formula>) -> core::result::Result<Formula, Fault> {
        let count = arguments.len();
        let mut arguments = arguments.into_iter().map(Box::new);
        match (formula::function(name), arguments.next(), arguments.next(), count) {
            (Some(f), Some(a), None, _) => Ok(Formula::Call(f, a)),
            (None, Some(y), Some(x), 2) if name == OF_TWO => Ok(Formula::Atan2(y, x)),
            _ => Err(Fault::new(
                format!("{count} argument{} of {name}", if count == 1 { "" } else { "s" }),
                if name == OF_TWO { "two, atan2(y, x)" } else { "one" },
                "Write decimals with a point, and arguments with a comma between them",
            )),
        }
    }

    fn list(&self, _: Vec<Formula>) -> core::result::Result<Formula, Fault> {
        Err(Fault::new("a list", "an expression", "Write one expression"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Column, ReadOptions, Record};
    use crate::rig::Rig;

    fn rig(channels: &[(&str, &str)]) -> Result<Rig> {
        let mut text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n".to_owned();
        for (i, (name, unit)) in channels.iter().enumerate() {
            let counts = if *unit == "count" { "counts_per_turn = 4096\n" } else { "" };
            text += &format!("[[channel]]\nname = \"{name}\"\nmeasures = \"q{i}\"\nunit = \"{unit}\"\n{counts}");
        }
        Rig::parse(&text, Path::new("rig.toml"))
    }

    fn read(csv: &str, rig: &Rig) -> Result<Record> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.csv");
        std::fs::write(&path, csv).unwrap();
        Record::read(&path, rig, &ReadOptions::default())
    }

    fn csv() -> String {
        let row = |i: i32| {
            let gap = if i == 30 { String::new() } else { format!("{:.3}", (f64::from(i) * 0.1).sin()) };
            format!("{:.2},{},{},{gap}\n", f64::from(i) * 0.01, i * i % 97, 5 * i % 61)
        };
        "t,a,b,Winkel 1 (deg)\n".to_owned() + &(0..60).map(row).collect::<String>()
    }

    #[test]
    fn channels_share_columns() {
        let channels = ["=sqrt(a^2 + b^2)", "=atan2(a, b)", "=2*c", "b", "c"].map(|name| Channel::new(name, "mm"));
        let share = |i: usize, k: usize| share_a_column(&channels[i], &channels[k]);
        assert_eq!([share(0, 1), share(0, 3), share(3, 1), share(4, 2)], [true; 4]);
        assert_eq!([share(0, 2), share(3, 2), share(3, 4), share(4, 1)], [false; 4]);
    }

    #[test]
    fn columns_are_put_together() {
        let rig =
            rig(&[("a", "count"), ("=2*a - b", "count"), ("=sin({Winkel 1 (deg)}*pi/180)^2 + b/4", "mm")]).unwrap();
        let record = read(&csv(), &rig).unwrap();
        // A gap of one column is a gap of what is computed with it.
        assert_eq!((record.samples(), record.segments.len(), record.losses.nan_rows), (59, 2, 1));
        assert_eq!(record.channels.len(), 3);
        let first = &record.segments[0].columns;
        assert_eq!(first[0], Column::Counts((0..30).map(|i| i * i % 97).collect()));
        assert_eq!(first[1], Column::Counts((0..30).map(|i| 2 * (i * i % 97) - 5 * i % 61).collect()));
        let Column::Values(v) = &first[2] else { panic!("values") };
        // sin(1.2), as printed.
        let x: f64 = 0.932;
        assert!((v[12] - ((x.to_radians()).sin().powi(2) + 60.0 / 4.0)).abs() < 1e-12, "{}", v[12]);
        // The warning of the gap names the channel.
        assert!(
            record.warnings.iter().any(|w| w.id == "nan-is-gap" && w.text.contains("=sin(")),
            "{:?}",
            record.warnings
        );
    }

    /// A bob that goes round and round and comes back, as a camera sees it (y downward): the angle
    /// is that of the motion, in rad, and in degrees too.
    #[test]
    fn a_whirling_angle_comes_from_pixels() {
        let angle = |i: i32| 12.0 * (f64::from(i) * 0.02).sin() + 0.03 * f64::from(i);
        let row = |i: i32| {
            let (x, y) = (640.0 + 300.0 * angle(i).sin(), 360.0 + 300.0 * angle(i).cos());
            format!("{:.2},{x:.9},{y:.9}\n", f64::from(i) * 0.01)
        };
        let csv = "t,x,y\n".to_owned() + &(0..600).map(row).collect::<String>();
        let rig = rig(&[
            ("=atan2({x} - 640, y - 360)", "rad"),
            ("=atan2(x - 640, y - 360)*180/pi", "deg"),
            ("=asin((x - 640)/300.001)^2 + acos((y - 360)/300.001) + atan(x)", "1"),
        ])
        .unwrap();
        let record = read(&csv, &rig).unwrap();
        let columns = &record.segments[0].columns;
        for (column, unit) in columns.iter().zip([1.0, core::f64::consts::PI / 180.0]) {
            let Column::Values(v) = column else { panic!("values") };
            let worst = (0..600).map(|i| (v[i as usize] * unit - v[0] * unit - angle(i) + angle(0)).abs());
            assert!(worst.fold(0.0, f64::max) < 1e-9);
        }
        let Column::Values(v) = &columns[2] else { panic!("values") };
        let a = angle(10);
        let expected = (300.0 * a.sin() / 300.001).asin().powi(2)
            + (300.0 * a.cos() / 300.001).acos()
            + (640.0 + 300.0 * a.sin()).atan();
        assert!((v[10] - expected).abs() < 1e-6, "{} {expected}", v[10]);
        assert_eq!(record.warnings.iter().filter(|w| w.text.contains("=atan2(")).count(), 2, "{:?}", record.warnings);
    }

    #[test]
    fn mistakes_point_at_their_character() {
        for (name, parts) in [
            ("=2*a -", &["channel 1", "character 7 of its name", "the end"][..]),
            ("=2*{a", &["character 4 of its name", "without its \\\"}\\\""]),
            ("=sen(a)", &["the function", "sin, cos", "acos, atan2"]),
            ("=atan2(a)", &["character 2 of its name", "1 argument of atan2", "atan2(y, x)"]),
            ("=sin(a, b)", &["2 arguments of sin", "expected one"]),
            ("=2,5*a", &["character 3 of its name", "decimals with a point"]),
            ("=a'", &["a derivative of a"]),
            ("={}", &["a column's name in braces"]),
            ("=", &["nothing"]),
            ("=1+1", &["channel 1", "without a column"]),
        ] {
            let message = rig(&[(name, "mm")]).unwrap_err().to_string().replace('"', "\\\"");
            assert!(parts.iter().all(|p| message.contains(p)), "{name}: {message}");
        }
    }

    #[test]
    fn what_cannot_be_computed_names_its_row() {
        let message = read(&csv(), &rig(&[("=1/b", "mm")]).unwrap()).unwrap_err().to_string();
        assert!(message.contains("line 2, column =1/b: found inf"), "{message}");
        let message = read(&csv(), &rig(&[("=a/2", "count")]).unwrap()).unwrap_err().to_string();
        assert!(message.contains("line 3, column =a/2: found 0.5, expected a whole number of counts"), "{message}");
        let message = read(&csv(), &rig(&[("=a - speed", "mm")]).unwrap()).unwrap_err().to_string();
        assert!(message.contains("a column speed"), "{message}");
    }
}

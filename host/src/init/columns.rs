//! What each column is, from its name and its values.

use serde::Serialize;

use super::Statement;
use super::counts::{self, Wrap};
use super::raw::Raw;
use crate::inspect::motion::quantisation_step;
use crate::record::{Column, names};
use crate::rig::Channel;
use crate::wording::format::significant;

/// Words in a name that say an angle.
const ANGLES: [&str; 19] = [
    "theta", "phi", "angle", "winkel", "enc", "count", "rot", "alpha", "beta", "gamma", "psi", "pend", "arm", "joint",
    "gelenk", "zähl", "θ", "φ", "ϕ",
];
/// Beginnings of words in a name that say a counter, and what says one wherever it stands: whole
/// numbers alone may as well be pixels of a camera or levels of a converter.
const COUNTERS: [&str; 8] = ["enc", "count", "cnt", "tick", "pulse", "incr", "zähl", "quad"];
const COUNTING: [&str; 4] = ["encoder", "counts", "pos_raw", "raw_pos"];
/// Levels of a converter of 16 bits: no camera and few converters have more, an encoder that is
/// counted on over turns soon has.
const MOST_LEVELS: f64 = 65_536.0;
/// Functions that give an angle.
const INVERSE: [&str; 4] = ["atan2", "atan", "asin", "acos"];
/// Units that an angle may be in, where neither its name nor its values say which.
pub(super) const UNITS: [&str; 2] = ["rad", "deg"];
/// Rms step from row to row above which a column is no angle in rad: with noise on it, equations
/// then fit what they cannot follow.
const MOST_RADIANS: f64 = 0.5;
/// Range of whole numbers up to which they may be states or marks rather than counts.
const MARKS: f64 = 20.0;

/// What a column is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// An angle.
    Angle,
    /// A displacement.
    Length,
    /// Something that is not a displacement: a voltage, a force, a current.
    Input,
    /// A velocity, a temperature: nothing that a channel may measure.
    Other,
    /// Numbers that say nothing of themselves.
    Unknown,
    /// Rises by one from row to row.
    Counter,
    /// Does not change.
    Constant,
}

impl Kind {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Angle => "an angle",
            Self::Length => "a displacement",
            Self::Input => "a measured quantity",
            Self::Other => "a rate or another quantity that no channel measures",
            Self::Unknown => "numbers whose name and values do not say what they are",
            Self::Counter => "counts the rows",
            Self::Constant => "does not change",
        }
    }
}

/// A column that was looked at.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Its name.
    pub name: String,
    /// Its place among the columns that were read.
    pub index: usize,
    /// What it is.
    pub kind: Kind,
    /// Unit for the rig file.
    pub unit: &'static str,
    /// Value in that unit over the column's.
    pub factor: f64,
    /// Whether the unit is one of two that an angle may be in, and nothing shows which.
    pub is_unit_open: bool,
    /// Counts a turn, where the values show them.
    pub counts: Option<u32>,
    /// Whether it may be an encoder's counts, though neither its name nor its values say so: whole
    /// numbers.
    pub may_count: bool,
    /// How far its values go, in the SI unit of [`Self::unit`].
    pub range: f64,
    /// Why.
    pub why: Vec<Statement>,
}

impl Seen {
    /// Whether a computed channel of that name is made of this column.
    pub(super) fn is_in(&self, computed: &str) -> bool {
        let Some(text) = computed.strip_prefix('=') else { return false };
        let is_part = |c: char| c.is_alphanumeric() || c == '_';
        text.contains(&format!("{{{}}}", self.name)) || text.split(|c| !is_part(c)).any(|word| word == self.name)
    }
}

/// Least, greatest, largest step between neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub low: f64,
    pub high: f64,
    pub leap: f64,
}

pub(super) fn extent(parts: &[&[f64]]) -> Extent {
    let all = parts.iter().flat_map(|p| p.iter());
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    let leap = parts.iter().flat_map(|p| p.windows(2)).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    Extent { low, high, leap }
}

/// Looks at every column.
pub(super) fn look(raw: &Raw) -> Vec<Seen> {
    let columns = raw.record.channels.iter().enumerate();
    let mut all: Vec<Seen> = columns.map(|(i, c)| one(&c.name, i, &raw.values(i))).collect();
    as_beside(&mut all);
    as_alike(&mut all);
    all
}

/// Whether two columns are called alike but for their numbers: theta1 and theta2.
pub(super) fn alike(a: &str, b: &str) -> bool {
    let letters = |name: &str| {
        let base = names::split(name).0.to_lowercase();
        base.chars().filter(|c| c.is_alphabetic()).collect::<String>()
    };
    !letters(a).is_empty() && letters(a) == letters(b)
}

/// Gives angles of no known unit that are called alike one unit.
fn as_alike(all: &mut [Seen]) {
    let in_degrees: Vec<String> =
        all.iter().filter(|s| s.is_unit_open && s.unit == "deg").map(|s| s.name.clone()).collect();
    for s in all.iter_mut().filter(|s| s.is_unit_open && s.unit == "rad") {
        let Some(other) = in_degrees.iter().find(|name| alike(name, &s.name)) else { continue };
        s.unit = "deg";
        let why = format!("its name says an angle, and the values of {other}, which is called alike, go far");
        s.why = vec![Statement::new(&s.name, "an angle in deg", why).unsure()];
    }
}

/// Takes angles of no known unit for what the others of the record are in: how far a value goes
/// says little of an arm that whirls.
fn as_beside(all: &mut [Seen]) {
    let known = |s: &&Seen| s.kind == Kind::Angle && !s.is_unit_open && UNITS.contains(&s.unit) && s.factor == 1.0;
    let Some((name, unit)) = all.iter().find(known).map(|s| (s.name.clone(), s.unit)) else { return };
    for s in all.iter_mut().filter(|s| s.is_unit_open) {
        s.unit = unit;
        let why = format!("its name says an angle, and {name} is in {unit}");
        s.why = vec![Statement::new(&s.name, format!("an angle in {unit}"), why).unsure()];
    }
}

fn one(name: &str, index: usize, parts: &[&[f64]]) -> Seen {
    let e = extent(parts);
    let mut seen = Seen {
        name: name.to_owned(),
        index,
        kind: Kind::Unknown,
        unit: "1",
        factor: 1.0,
        is_unit_open: false,
        counts: None,
        may_count: false,
        range: 0.0,
        why: vec![],
    };
    if e.high <= e.low {
        seen.kind = Kind::Constant;
    } else if parts.iter().all(|p| p.windows(2).all(|w| w[1] - w[0] == 1.0)) {
        seen.kind = Kind::Counter;
    } else if let Some(text) = name.strip_prefix('=') {
        computed(&mut seen, text, parts, e);
    } else if let Some((unit, text)) = names::split(name).1.and_then(|text| names::unit(&text).map(|unit| (unit, text)))
    {
        by_unit(&mut seen, unit, &text, parts);
    } else {
        by_values(&mut seen, parts, e);
    }
    // Counts of an unknown turn are compared among themselves.
    seen.range = (e.high - e.low) * (seen.factor * Channel::new("", seen.unit).scale()).abs();
    seen
}

/// A channel that is computed: of an inverse function it is an angle.
fn computed(seen: &mut Seen, text: &str, parts: &[&[f64]], e: Extent) {
    let Some(function) = INVERSE.iter().find(|f| text.contains(&format!("{f}("))) else {
        return by_values(seen, parts, e);
    };
    // As docs/record-format.md writes degrees: *180/pi.
    let is_plain = text.trim().starts_with(function) && text.trim().ends_with(')');
    seen.kind = Kind::Angle;
    seen.unit = if text.contains("180") { "deg" } else { "rad" };
    let statement =
        Statement::new(&seen.name, format!("an angle in {}", seen.unit), format!("{function} gives an angle in rad"));
    seen.why.push(if is_plain { statement } else { statement.unsure() });
}

/// A column whose name has a unit.
fn by_unit(seen: &mut Seen, unit: names::NamedUnit, text: &str, parts: &[&[f64]]) {
    let Some(name) = unit.unit else {
        seen.kind = Kind::Other;
        return;
    };
    (seen.unit, seen.factor) = (name, unit.factor);
    seen.kind = match name {
        "count" | "rad" | "deg" => Kind::Angle,
        "m" | "mm" | "um" => Kind::Length,
        "1" => Kind::Unknown,
        _ => Kind::Input,
    };
    if name == "count" {
        return counted(seen, parts, extent(parts));
    }
    let mut why = format!("its name says {text}");
    let turn = match name {
        "deg" => Some(360.0),
        "rad" => Some(core::f64::consts::TAU),
        _ => None,
    };
    if let Some(n) = turn.and_then(|turn| counts::of_step(step(parts), turn / unit.factor)) {
        why.push_str(&format!("; its values are steps of 1/{n} of a turn"));
    }
    let what = if name == "1" { "numbers".to_owned() } else { format!("{} in {name}", seen.kind.words()) };
    seen.why.push(Statement::new(&seen.name, what, why));
}

fn step(parts: &[&[f64]]) -> f64 {
    let columns: Vec<Column> = parts.iter().map(|p| Column::Values(p.to_vec())).collect();
    quantisation_step(&columns.iter().collect::<Vec<_>>(), 1.0)
}

/// A column whose name has no unit.
fn by_values(seen: &mut Seen, parts: &[&[f64]], e: Extent) {
    let small = seen.name.to_lowercase();
    let called = ANGLES.iter().any(|a| small.contains(a));
    let whole = parts.iter().all(|p| p.iter().all(|x| x.fract() == 0.0));
    if whole && e.high - e.low > MARKS {
        let is_beyond_converters = e.high - e.low > MOST_LEVELS;
        if called || is_counter(&small) || is_beyond_converters || counts::wrapped(parts, e).is_some() {
            return counted(seen, parts, e);
        }
        seen.may_count = true;
    }
    let turns = [("rad", core::f64::consts::TAU), ("deg", 360.0)];
    if let Some((unit, turn)) = turns.into_iter().find(|(_, turn)| counts::wraps(parts, *turn)) {
        (seen.kind, seen.unit) = (Kind::Angle, unit);
        let why = format!("its values leap by a whole turn of {} {unit}", significant(turn, 4));
        seen.why.push(Statement::new(&seen.name, format!("an angle in {unit}"), why));
        return;
    }
    let q = step(parts);
    let stepped = turns.into_iter().find_map(|(unit, turn)| counts::of_step(q, turn).map(|n| (unit, n)));
    if let Some((unit, n)) = stepped.filter(|_| called) {
        (seen.kind, seen.unit) = (Kind::Angle, unit);
        let why = format!(
            "its name says an angle, and its values are steps of {}, 1/{n} of a turn in {unit}",
            significant(q, 4)
        );
        seen.why.push(Statement::new(&seen.name, format!("an angle in {unit}"), why));
    } else if called {
        let size = e.low.abs().max(e.high.abs());
        let (unit, moved) = (if size > 13.0 { "deg" } else { "rad" }, rms_step(parts));
        let is_fast = moved > MOST_RADIANS && unit == "deg";
        (seen.kind, seen.unit, seen.is_unit_open) = (Kind::Angle, unit, !is_fast);
        let beside = if is_fast { format!(", by {} a row", significant(moved, 2)) } else { String::new() };
        let why = format!("its name says an angle, and its values go to {}{beside}", significant(size, 3));
        seen.why.push(Statement::new(&seen.name, format!("an angle in {unit}"), why).unsure());
    }
}

/// Whether a name in small letters says a counter.
fn is_counter(small: &str) -> bool {
    let mut words = small.split(|c: char| !c.is_alphanumeric());
    words.any(|word| COUNTERS.iter().any(|c| word.starts_with(c))) || COUNTING.iter().any(|c| small.contains(c))
}

/// Root of the mean square of what a column moves by from one row to the next.
fn rms_step(parts: &[&[f64]]) -> f64 {
    let squares = parts.iter().flat_map(|p| p.windows(2)).map(|w| (w[1] - w[0]).powi(2));
    let (sum, count) = squares.fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
    if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
}

/// Whole numbers: counts of an encoder.
fn counted(seen: &mut Seen, parts: &[&[f64]], e: Extent) {
    (seen.kind, seen.unit) = (Kind::Angle, "count");
    let range = format!("whole numbers from {} to {}", e.low, e.high);
    let why = match counts::wrapped(parts, e) {
        Some(Wrap::Turn(n)) => {
            seen.counts = Some(n);
            format!("{range} that leap by {n}: the encoder's turn")
        }
        Some(Wrap::Counter) => format!("{range} that leap by 65536: a counter of 16 bits"),
        None => range,
    };
    seen.why.push(Statement::new(&seen.name, "an angle in counts", why));
}

//! A column as what it is to show: counts of a rail, the volts of a potentiometer.

use super::columns::{Kind, Seen};
use super::{DraftChannel, Statement};
use crate::rig::declared::Declared;
use crate::rig::{Channel, UNITS};

/// Counts a turn where nothing shows them: the commonest encoder, 1024 lines counted four times.
const COMMON: u32 = 4096;

/// Degrees for a volt of a potentiometer of 10 V a turn.
const POTENTIOMETER: f64 = 36.0;

/// What to do about a column of a unit that cannot be what is asked of it.
pub(super) const OTHERWISE: &str = "Name the column that shows it, or another system with --system; where this column does show it \
     through something else, write its [[channel]] by hand: unit is what it shows, gain what one of the column's numbers is in that";

/// A quantity that needs a channel.
pub(super) struct Need {
    pub name: String,
    pub kind: Kind,
    /// What the system counts it in; none where that is left open.
    pub declared: Option<Declared>,
}

impl Need {
    /// Whether a column cannot be this quantity, its unit being of another kind.
    pub fn refuses(&self, s: &Seen) -> bool {
        self.declared.as_ref().is_some_and(|d| d.contradicts(s.unit))
    }

    /// What it is, for messages.
    pub fn words(&self) -> String {
        match &self.declared {
            Some(d) if self.kind == Kind::Input => format!("{} in {}", self.kind.words(), d.words),
            _ => self.kind.words().to_owned(),
        }
    }
}

/// What a column is, for messages.
pub(super) fn words(s: &Seen) -> String {
    match s.kind {
        Kind::Input if s.unit != "1" => format!("{} in {}", s.kind.words(), s.unit),
        _ => s.kind.words().to_owned(),
    }
}

/// Whether a column is an angle by its name alone, and a displacement is to be read from it: counts
/// of an encoder on a rail.
fn is_by_name(s: &Seen, need: &Need) -> bool {
    let is_open = s.is_unit_open || s.unit == "count" && s.counts.is_none();
    need.kind == Kind::Length && s.kind == Kind::Angle && is_open
}

/// Whether a column is a sensor's voltage or current, and something else is to be read from it.
fn is_sensors(s: &Seen, need: &Need) -> bool {
    need.refuses(s) && ["V", "A"].contains(&Channel::new("", s.unit).si_unit())
}

/// Whether a column that a person names may show a quantity though its unit is another.
pub(super) fn may_be(s: &Seen, need: &Need) -> bool {
    is_by_name(s, need) || is_sensors(s, need)
}

/// A sensor's voltage or current in the unit of what it is to show, with a gain to be checked.
fn sensed(s: &Seen, need: &Need) -> Seen {
    let declared = |unit: &&str| need.declared.as_ref().is_some_and(|d| *unit != "1" && !d.contradicts(unit));
    let unit = match need.kind {
        Kind::Angle => "deg",
        Kind::Length => "m",
        _ => UNITS.into_iter().find(declared).unwrap_or("1"),
    };
    let one = Channel::new("", s.unit);
    let in_si = s.factor * one.scale();
    let is_turned = need.kind == Kind::Angle && one.si_unit() == "V";
    let text = format!("{} in {unit}, from {}", need.kind.words(), s.unit);
    let scale = if is_turned {
        "36 deg for a volt, a potentiometer of 10 V a turn"
    } else {
        "one for one, as nothing says the sensor's scale"
    };
    let zero = if need.kind == Kind::Input { "" } else { ", and offset, what is added where its 0 is another" };
    let why = format!("a guess: {scale}; write what one of the column's numbers is in {unit}, gain{zero}");
    Seen {
        kind: need.kind,
        unit,
        factor: in_si * if is_turned { POTENTIOMETER } else { 1.0 },
        why: vec![Statement::new(&s.name, text, why).unsure()],
        ..s.clone()
    }
}

/// A column as what it is to show: whole numbers that are to be an angle are an encoder's, and what
/// is to be a displacement is in a unit that only its owner knows.
pub(super) fn meant(s: &Seen, need: &Need) -> Seen {
    if is_sensors(s, need) {
        return sensed(s, need);
    }
    let mut s = s.clone();
    if is_by_name(&s, need) {
        let is_counted = s.unit == "count";
        (s.kind, s.unit, s.is_unit_open) = (Kind::Length, "m", false);
        let (text, why) = if is_counted {
            (
                "whole numbers, taken for metres",
                "write what one of them is in metres, gain = 2.5e-5, and half of it, offset = 1.25e-5",
            )
        } else {
            ("a displacement in m", "nothing says its unit: write another one, unit = \"mm\"")
        };
        s.why = vec![Statement::new(&s.name, text, why).unsure()];
    }
    if s.may_count && need.kind == Kind::Angle {
        s.unit = "count";
        let why = format!("whole numbers, and {} is an angle", need.name);
        s.why = vec![Statement::new(&s.name, "an angle in counts", why)];
    }
    s
}

pub(super) fn channel(seen: &Seen, measures: &str) -> DraftChannel {
    let mut why = seen.why.clone();
    let mut counts_per_turn = seen.counts;
    if seen.unit == "count" && counts_per_turn.is_none() {
        counts_per_turn = Some(COMMON);
        why.push(commonest(&seen.name));
    }
    if seen.unit == "1" {
        let text = if why.is_empty() {
            "neither its name nor its values say its unit: write it in the rig file, unit = \"m\", \"mm\", \"rad\", \"deg\", \"N\", \"V\" …"
        } else {
            "with a scale write its unit in the rig file, unit = \"mm\", and what one of them is, gain = 0.1"
        };
        why.push(Statement::new(&seen.name, "numbers without a unit", text).unsure());
    }
    DraftChannel {
        name: seen.name.clone(),
        measures: measures.to_owned(),
        unit: seen.unit.to_owned(),
        counts_per_turn,
        gain: (seen.factor != 1.0).then_some(seen.factor),
        why,
    }
}

fn commonest(column: &str) -> Statement {
    let text = format!("{COMMON} counts a turn");
    Statement::new(column, text, "nothing in the record shows them; this is the commonest").unsure()
}

/// Takes the commonest counts a turn for a channel.
pub(super) fn common_counts(c: &mut DraftChannel) {
    c.why.retain(|w| !w.check);
    c.why.push(commonest(&c.name));
    c.counts_per_turn = Some(COMMON);
}

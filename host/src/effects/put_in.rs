//! Effects put into the simulation of a system derived from bodies: `ID@PLACE=VALUE[,name=value]`.
//!
//! The value and the parameters are those that an explanation tells, in SI: the amplitude of
//! cogging with `n` and `psi`, the half width of backlash with `k`.

use std::collections::BTreeMap;

use super::between;
use super::catalogue;
use super::columns::{self, Action, LOAD, Span};
use super::entry::{At, Entry, Form, MASS, Verb};
use super::places::{self, Place};
use super::{value, written};
use crate::error::{BadInput, Result};
use crate::model::model_file::expression::Node;
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;
use crate::wording::close::did_you_mean;

/// What is put in.
#[derive(Clone, Debug, Default)]
pub struct PutIn {
    /// Terms of the left-hand sides: equation, name, expression in seconds.
    pub terms: Vec<(usize, String, Node)>,
    /// Coefficients of the names in [`PutIn::terms`], in the order in which they first stand there.
    pub strengths: Vec<f64>,
    /// What sensors add to what they show: sensor, law of x and v, strength.
    pub reads: Vec<(usize, Node, f64)>,
    /// What the record of an input adds to it: input, law as for a sensor, strength.
    pub records: Vec<(usize, Node, f64)>,
    /// What runs ahead in the drive's phase: law of time, strength.
    pub advances: Vec<(Node, f64)>,
}

/// One text taken apart.
struct Text<'a> {
    id: &'a str,
    at: &'a str,
    value: f64,
    parameters: BTreeMap<String, f64>,
}

fn bad(text: &str, found: String, expected: String) -> BadInput {
    BadInput::new(found, expected).at(format!("--effect {text}")).remedy("See `whirl list effects` and docs/effects.md")
}

fn apart(text: &str) -> Result<Text<'_>> {
    let form = || bad(text, format!("\"{text}\""), "ID@PLACE=VALUE[,name=value]".to_owned());
    let number = |t: &str| {
        let x = t.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        x.ok_or_else(|| bad(text, format!("\"{t}\""), "a finite number".to_owned()))
    };
    let (name, rest) = text.split_once('=').ok_or_else(form)?;
    let (id, at) = name.split_once('@').ok_or_else(form)?;
    let mut parts = rest.split(',');
    let value = number(parts.next().unwrap_or_default())?;
    let mut parameters = BTreeMap::new();
    for part in parts {
        let (key, x) = part.split_once('=').ok_or_else(form)?;
        parameters.insert(key.trim().to_owned(), number(x)?);
    }
    Ok(Text { id, at, value, parameters })
}

/// Shape parameters and strengths of an entry from what was given.
fn shaped(text: &str, entry: &Entry, given: &Text<'_>) -> Result<(Form, Vec<f64>)> {
    let also = entry.also.iter().map(|a| a.0.as_str());
    let known: Vec<&str> = entry.shapes.iter().map(|s| s.name.as_str()).chain(also).collect();
    if let Some(k) = given.parameters.keys().find(|k| !known.contains(&k.as_str())) {
        let known = if known.is_empty() { "no parameter".to_owned() } else { known.join(", ") };
        return Err(bad(text, format!("a parameter \"{k}\""), known));
    }
    let is_value = |name: &str| entry.value.as_deref() == Some(name);
    let form = entry
        .shapes
        .iter()
        .map(|s| {
            let x = if is_value(&s.name) { Some(given.value) } else { given.parameters.get(&s.name).copied() };
            let x = x.ok_or_else(|| {
                bad(text, format!("no {}", s.name), format!("{}@{}=VALUE,{}=…", given.id, given.at, s.name))
            })?;
            Ok((s.name.clone(), x))
        })
        .collect::<Result<Form>>()?;
    let one = |name: &String| {
        // The value itself, or a parameter that is this strength.
        let named = entry.also.iter().find(|a| a.1 == *name).and_then(|a| given.parameters.get(&a.0).copied());
        if is_value(name) { Some(given.value) } else { named }
    };
    let names = &entry.strengths;
    let strengths: Vec<f64> = match &entry.value {
        Some(v) if !names.contains(v) && !entry.shapes.iter().any(|s| s.name == *v) => {
            made_of(text, entry, given, &form)?
        }
        // Without a law of its own the value is the first strength.
        None => {
            let of = |(k, n): (usize, &String)| if k == 0 { given.value } else { one(n).unwrap_or(0.0) };
            names.iter().enumerate().map(of).collect()
        }
        Some(_) => names.iter().map(|n| one(n).unwrap_or(0.0)).collect(),
    };
    told_otherwise(text, entry, given, (&form, &strengths))?;
    of_their_sign(text, entry, &strengths)?;
    if strengths.iter().all(|s| *s == 0.0) && given.value != 0.0 {
        return Err(bad(text, "no strength".to_owned(), format!("one of {} beside the value", known.join(", "))));
    }
    Ok((form, strengths))
}

/// Strengths at which two expressions of them are compared.
const PAIRS: [[f64; 2]; 4] = [[0.8, 0.6], [-0.3, 1.7], [2.1, -0.4], [-1.1, -0.9]];
/// Share by which a value that is put in may differ from what was given: rounding.
const ROUNDING: f64 = 1e-9;

/// Whether an expression is a function of the entry's two strengths.
fn is_of_two(entry: &Entry, of: &str, form: &Form, function: fn(f64, f64) -> f64) -> bool {
    let same = |[a, b]: &[f64; 2]| (value::at(entry, of, &[*a, *b], form) - function(*a, *b)).abs() < ROUNDING;
    entry.strengths.len() == 2 && PAIRS.iter().all(same)
}

/// The further name of an entry that tells the angle between its two strengths.
fn angle<'a>(entry: &'a Entry, form: &Form) -> Option<&'a str> {
    entry.also.iter().find(|(_, of)| is_of_two(entry, of, form, |a, b| b.atan2(a))).map(|a| a.0.as_str())
}

/// Strengths whose value is an expression of theirs: amplitude and angle, or all by name.
fn made_of(text: &str, entry: &Entry, given: &Text<'_>, form: &Form) -> Result<Vec<f64>> {
    let of = entry.value.as_deref().unwrap_or_default();
    let by_name = |n: &String| entry.also.iter().find(|a| a.1 == *n).and_then(|a| given.parameters.get(&a.0).copied());
    if let Some(all) = entry.strengths.iter().map(by_name).collect::<Option<Vec<f64>>>() {
        let own = value::at(entry, of, &all, form);
        let same = (own - given.value).abs() <= ROUNDING * given.value.abs();
        let expected = format!("{of} = {own}, as these strengths have it");
        return if same { Ok(all) } else { Err(bad(text, format!("the value {}", given.value), expected)) };
    }
    if !is_of_two(entry, of, form, f64::hypot) {
        let names = &entry.strengths;
        let expected = match &names[..] {
            [a, b] => format!("a value that is {a}, {b}, a shape or sqrt({a}^2 + {b}^2)"),
            names => format!("a value that is {} or a shape", names.join(", ")),
        };
        let found = format!("the value \"{of}\", from which nothing tells {}", names.join(" and "));
        let remedy = format!(
            "Give {} another `value` in its file, such as \"{}\", and the others under `also`, to put it in",
            entry.id, names[0]
        );
        return Err(bad(text, found, expected).remedy(remedy));
    }
    let angle = angle(entry, form).and_then(|name| given.parameters.get(name).copied()).unwrap_or(0.0);
    Ok(vec![given.value * angle.cos(), given.value * angle.sin()])
}

/// Refuses parameters that the effect, as it would be put in, does not have.
fn told_otherwise(text: &str, entry: &Entry, given: &Text<'_>, (form, strengths): (&Form, &[f64])) -> Result<()> {
    let angle = angle(entry, form);
    for (name, of) in entry.also.iter().filter(|a| Some(a.0.as_str()) != angle) {
        let Some(x) = given.parameters.get(name) else { continue };
        let own = value::at(entry, of, strengths, form);
        if (own - x).abs() <= ROUNDING * x.abs() {
            continue;
        }
        let found = format!("{name}={x}, where {of} is {own}");
        let expected = format!("parameters that fix {}", entry.strengths.join(", "));
        let remedy = format!("Leave {name} out: it follows from what else is given");
        return Err(bad(text, found, expected).remedy(remedy));
    }
    Ok(())
}

/// Refuses a strength below 0 of one that is positive by its nature: friction that drives.
fn of_their_sign(text: &str, entry: &Entry, strengths: &[f64]) -> Result<()> {
    // What takes from another law may take from its other half.
    if entry.takes_from.is_some() {
        return Ok(());
    }
    let mut all = entry.strengths.iter().zip(strengths).zip(&entry.positive);
    let Some(((name, x), _)) = all.find(|((_, x), positive)| **positive && **x < 0.0) else { return Ok(()) };
    let expected = format!("0 or more: {} says sign = {{ {name} = \"+\" }}", entry.id);
    let remedy = format!("Give {name} without the minus; `whirl list effects --show {}` prints its law", entry.id);
    Err(bad(text, format!("{name} = {x}"), expected).remedy(remedy))
}

/// What is found of a law that changes nothing: a shape of 0 may divide in it.
fn changes_nothing(form: &Form) -> String {
    let zero: Vec<String> = form.iter().filter(|s| s.1 == 0.0).map(|s| format!("{} = 0", s.0)).collect();
    let with = if zero.is_empty() { String::new() } else { format!(" with {}", zero.join(", ")) };
    format!("nothing that it would change{with}")
}

/// Where an effect could be put, of places with these names; of none, what it takes.
fn place_wanted(names: &[String], entry: &Entry) -> String {
    match (names, entry.at) {
        ([], At::Between) => "two coordinates of one kind by whose difference no joint moves (at a joint that does, \
                                      a torsion-spring is this)"
            .to_owned(),
        ([], At::Arm) => "a system with an arm: a body that has an angle (docs/effects.md)".to_owned(),
        ([], At::Body) => "a system from bodies, one of them a mass at a point that moves (docs/effects.md)".to_owned(),
        ([], At::Drive) => "a system with a drive".to_owned(),
        ([], At::Input) => "a system with a measured input".to_owned(),
        ([], At::Encoder) if entry.turning => "a system with a channel that shows an angle".to_owned(),
        // Against the first channel nothing is late.
        ([], At::Encoder) => {
            "a system with a second channel of a motion, whose delay against the first shows".to_owned()
        }
        ([], At::Joint) => "a system with a joint, or a coordinate with an equation of its own".to_owned(),
        ([], At::Frame) => "a system whose frame may move: bodies under gravity".to_owned(),
        (names, _) => format!("one of {}", names.join(", ")),
    }
}

/// Reads effects for a rig whose system was derived from bodies, `physical` the values of the
/// system's parameters, or written down, `own` those of its coefficients.
///
/// # Errors
/// Names the effect, what is wrong in it and what could stand there.
pub fn of(
    rig: &Rig,
    bound: &ObservedModel,
    physical: &[f64],
    own: &[f64],
    texts: &[String],
    span: Span,
) -> Result<PutIn> {
    let mut out = PutIn::default();
    let (model, direction, omega) = (&*bound.model, rig.direction(), rig.omega());
    let places = if written::applies(model) { written::mechanism(model, direction, omega, own) } else { None };
    let Some(text) = texts.first() else { return Ok(out) };
    let mechanism = places.as_ref().or(model.mechanism.as_deref());
    let Some((mechanism, file)) = mechanism.and_then(|m| Some((m, m.file.as_deref()?))) else {
        let expected = "one equation for each coordinate, and an inertia in each";
        return Err(bad(text, "equations in which no effect has a place".to_owned(), expected.to_owned()));
    };
    let found = places.as_ref().and_then(|_| written::parameters(model, direction, omega, own));
    let physical = found.as_deref().unwrap_or(physical);
    let entries: Vec<&Entry> = catalogue().iter().chain(rig.effects.iter().map(AsRef::as_ref)).collect();
    for (index, text) in texts.iter().enumerate() {
        let given = apart(text)?;
        let Some(entry) = entries.iter().find(|e| e.id == given.id) else {
            let ids: Vec<&str> = entries.iter().map(|e| e.id.as_str()).collect();
            let meant = did_you_mean(given.id, ids.iter().copied());
            let e = bad(text, format!("\"{}\"", given.id), format!("one of {}", ids.join(", ")));
            return Err(e.remedy(format!("{meant}See `whirl list effects` and docs/effects.md")));
        };
        let here = places::of(entry, file, bound);
        let Some(place) = here.iter().find(|p| p.name(file) == given.at) else {
            let names: Vec<String> = here.iter().map(|p| p.name(file)).collect();
            return Err(bad(text, format!("the place \"{}\"", given.at), place_wanted(&names, entry)));
        };
        let open = match place {
            Place::Joint(_) if places.is_some() && entry.names(LOAD) => {
                Some(entry.with_shape(MASS, Vec::new(), Some([0.0, f64::INFINITY])))
            }
            _ => between::in_written(entry, *place, mechanism),
        };
        let entry = open.as_ref().unwrap_or(entry);
        let (form, mut strengths) = shaped(text, entry, &given)?;
        if places.is_some() {
            let factor = match (entry.verb, places::equation(*place, mechanism)) {
                // A load is a force: its strength is a length.
                (Verb::Force, Some((equation, _))) if !entry.names(LOAD) => {
                    written::told_by(model, omega, equation, physical)
                }
                (Verb::Moves, _) if entry.unit.is_none() => rig.drive.and_then(|d| d.amplitude_m).unwrap_or(1.0),
                _ => 1.0,
            };
            strengths.iter_mut().for_each(|s| *s /= factor);
        }
        let known = entry.about(&strengths);
        let action = columns::action(&known, &form, *place, mechanism, physical, rig.omega(), span);
        let all = match &action {
            Ok(Some(Action::Force(parts))) => Some(columns::columns(parts, strengths.len(), mechanism, physical)),
            Ok(Some(Action::Changes(all))) => Some(written::columns(all, model, direction, omega, own)),
            _ => None,
        };
        match (action, all) {
            (_, Some(all)) => {
                for (k, (column, strength)) in all.into_iter().zip(strengths).enumerate() {
                    if !column.is_empty() {
                        out.strengths.push(strength);
                    }
                    let name = format!("effect {index} {k}");
                    out.terms.extend(column.into_iter().map(|(e, of)| (e, name.clone(), of)));
                }
            }
            (Ok(Some(Action::Reads { sensor, laws })), None) => {
                out.reads.extend(laws.into_iter().zip(strengths).map(|(law, s)| (sensor, law, s)));
            }
            (Ok(Some(Action::Records { input, laws })), None) => {
                out.records.extend(laws.into_iter().zip(strengths).map(|(law, s)| (input, law, s)));
            }
            (Ok(Some(Action::Advances(laws))), None) => out.advances.extend(laws.into_iter().zip(strengths)),
            _ => {
                return Err(bad(text, changes_nothing(&form), "an effect that acts there".to_owned()));
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
#[path = "put_in_tests.rs"]
mod tests;

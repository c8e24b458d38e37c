//! Which sign coefficients keep: those of laws that take energy away, as the catalogue's positive
//! strengths say.

use super::super::candidates::Candidate;
use super::super::setting::{Physical, Setting};
use crate::effects::entry::Verb;
use crate::effects::places;
use crate::identify::Identification;
use crate::model::model_file::expression::multiple;

/// Standard errors by which a coefficient must have its sign in the first fit to keep it.
const CLEAR: f64 = 2.0;

/// Signs of the equations' own columns: of those that are the law of a positive strength (a damping
/// that a user wrote down), where the first fit shows that they have it.
pub fn own(setting: &Setting<'_>, physical: &Physical, first: &Identification) -> Vec<f64> {
    let model = setting.model();
    let Some(file) = setting.file() else { return vec![0.0; setting.own.names.len()] };
    let laws: Vec<_> = setting
        .entries
        .iter()
        .filter(|e| e.verb == Verb::Force && e.positive.first() == Some(&true) && e.shapes.is_empty())
        .flat_map(|e| places::of(e, file, &setting.bound).into_iter().map(move |p| (e, p)))
        .flat_map(|(e, place)| Candidate::plain_columns(setting, e, place, physical))
        .collect();
    let mut signs = vec![None; setting.own.names.len()];
    for (e, (equation, places)) in model.equations.iter().zip(model.term_places()).enumerate() {
        for (term, k) in equation.terms.iter().zip(places) {
            let of = model.in_seconds(&term.of, setting.rig.omega());
            let sign = laws
                .iter()
                .flatten()
                .filter(|(at, _)| *at == e)
                .find_map(|(_, law)| multiple(law, &of).map(f64::signum))
                .unwrap_or(0.0);
            for columns in &setting.own.of_record {
                let Some(&column) = columns.get(k) else { continue };
                signs[column] = Some(match signs[column] {
                    Some(before) if before != sign => 0.0,
                    _ => sign,
                });
            }
        }
    }
    let clear = |name: &String, sign: f64| {
        let found = first.parameter(name);
        found.is_some_and(|p| sign * p.value > CLEAR * p.std_error)
    };
    let with_names = signs.into_iter().map(Option::unwrap_or_default).zip(&setting.own.names);
    with_names.map(|(sign, name)| if clear(name, sign) { sign } else { 0.0 }).collect()
}

/// Signs of a candidate's columns.
pub fn of(candidate: &Candidate) -> Vec<f64> {
    let positive = candidate.entry.positive.iter().map(|p| f64::from(u8::from(*p)));
    let mut out: Vec<f64> = positive.collect();
    // What is found as an increment may take some of it back.
    if candidate.is_applied() {
        out.fill(0.0);
    }
    out.resize(candidate.strengths(), 0.0);
    out
}

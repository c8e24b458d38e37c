//! Internal states of an effect: `states = { z = "(v - abs(v)*z)/d" }`, each with the law of its
//! rate; they begin at 0.

use std::sync::Arc;

use toml::de::DeTable;

use super::columns::LOAD;
use super::entry::{Entry, Form, Verb, has_word, stand_ins};
use super::on_a_frame;
use crate::error::Result;
use crate::model::model_file::expression::{Expression, Node, Symbol};
use crate::model::model_file::memory::Memory;
use crate::model::model_file::parser::parse;
use crate::model::model_file::{check_name, mistake};
use crate::system::language::Reader;
use crate::system::polynomial::Polynomial;
use crate::system::words::{Scope, Scoped, Value as Word, Words};

/// Most states of an effect.
const MOST: usize = 4;

impl Entry {
    /// The rates of the states in the words of a place: state k is [`Symbol::State`].
    ///
    /// # Errors
    /// The first mistake, with the number of the state in whose law it is.
    pub fn rates(
        &self,
        words: &Words,
        form: &Form,
    ) -> core::result::Result<Vec<Polynomial>, (usize, crate::model::model_file::parser::Mistake)> {
        let words = self.words(words, form);
        let one = |(k, (_, law)): (usize, &(String, String))| match parse(law, &Scoped(&words, Scope::Motion)) {
            Ok(Word::Scalar(p)) => Ok(p),
            // No place has vectors for its states.
            Ok(Word::Vector(_)) => Ok(Polynomial::default()),
            Err(m) => Err((k, m)),
        };
        self.states.iter().enumerate().map(one).collect()
    }

    /// What stands for each state in the words of a place: itself, followed by the laws of the
    /// rates. None where these hold parameters of the system, whose values are found while the
    /// states are followed already.
    ///
    /// # Errors
    /// As [`Entry::rates`].
    pub fn followed(
        &self,
        words: &Words,
        form: &Form,
    ) -> core::result::Result<Option<Vec<Node>>, crate::model::model_file::parser::Mistake> {
        let rates = self.rates(words, form).map_err(|(_, m)| m)?;
        if rates.iter().any(Polynomial::has_parameter) {
            return Ok(None);
        }
        let memory = Arc::new(Memory::new(rates.iter().map(Polynomial::node).collect()));
        Ok(Some((0..rates.len()).map(|k| Arc::new(Expression::Memory(memory.clone(), k))).collect()))
    }
}

/// Reads the key `states`; `taken` are the words of the place and the names of strengths and
/// shapes.
///
/// # Errors
/// Names file, line and column, what was found and what was expected.
pub fn read(
    r: &Reader<'_>,
    t: &DeTable<'_>,
    verb: Verb,
    vocabulary: &[&str],
    mut taken: Vec<String>,
) -> Result<Vec<(String, String)>> {
    let mut out = Vec::new();
    for (name, at, v) in r.table(t, "states", "states = { z = \"v - z/T_r\" }")? {
        if verb != Verb::Force && vocabulary != on_a_frame::WORDS {
            return Err(r
                .source
                .bad(
                    at,
                    format!("the state {name}"),
                    "a force at a joint or an arm, or moves at a frame: they have states",
                )
                .remedy("Remove states"));
        }
        check_name(r.source, at, name, &taken)?;
        if out.len() == MOST {
            return Err(r
                .source
                .bad(at, format!("more than {MOST} states"), format!("1 to {MOST}"))
                .remedy("Use fewer"));
        }
        taken.push(name.to_owned());
        out.push((name.to_owned(), r.source.text(v, "the law of its rate in quotes")?.to_owned()));
    }
    Ok(out)
}

/// Refuses laws of states that hold what they may not, and states without use.
///
/// # Errors
/// As [`read`].
pub fn check(r: &Reader<'_>, t: &DeTable<'_>, e: &Entry, vocabulary: &[&str]) -> Result<()> {
    let all = r.table(t, "states", "states = { z = \"v - z/T_r\" }")?;
    let Some(form) = e.forms().into_iter().next() else { return Ok(()) };
    let words = stand_ins(vocabulary);
    let rates = e.rates(&words, &form).map_err(|(k, m)| match all.get(k) {
        Some((_, _, v)) => mistake(r.source, v, &e.states[k].1, m),
        None => r.source.bad(0, m.found, m.expected).remedy(m.remedy),
    })?;
    for ((rate, (name, law)), (_, _, v)) in rates.iter().zip(&e.states).zip(&all) {
        let bad = |found: String, expected: &str, remedy: &str| {
            Err(r.source.bad(v.span().start, found, expected).remedy(remedy))
        };
        if rate.has_parameter() {
            let expected = "a law of the motion, the states and shapes";
            return bad(
                format!("a strength in the law of {name}"),
                expected,
                "Strengths stand in force; make it a shape, or scale the state",
            );
        }
        let time = rate.moves(|s| matches!(s, Symbol::Time | Symbol::Tau)).then_some("a time");
        let load = (vocabulary.contains(&LOAD) && has_word(law, LOAD)).then_some("the load");
        if let Some(found) = time.or(load) {
            let expected = "a law of the motion, the states and shapes";
            return bad(format!("{found} in the law of {name}"), expected, "States follow the motion alone");
        }
    }
    let force = match e.law(&words, &form) {
        Ok(Word::Scalar(p)) => vec![p],
        Ok(Word::Vector(v)) => v,
        // What is wrong with the law is told where it is checked.
        Err(_) => return Ok(()),
    };
    for (k, ((name, _), (_, at, _))) in e.states.iter().zip(&all).enumerate() {
        let used = |p: &Polynomial| p.moves(|s| s == Symbol::State(k));
        let others = rates.iter().enumerate().any(|(j, p)| j != k && used(p));
        if !others && !force.iter().any(used) {
            return Err(r
                .source
                .bad(*at, format!("the state {name}, which the force does not use"), "every state in the force")
                .remedy("Remove it, or use it"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::effects::entry::read;
    use crate::model::model_file::toml_place::Source;

    fn of(rest: &str) -> crate::error::Result<Vec<super::Entry>> {
        let head = "[[effect]]\nid = \"m\"\nat = \"joint\"\nstrengths = [\"F\"]\n";
        let shape = "shape = { d = { grid = [0.1, 0.2], within = [0.01, 1.0] } }\n";
        read(&Source { text: format!("{head}{shape}{rest}\n"), path: Path::new("m.toml").to_path_buf() })
    }

    #[test]
    fn states_are_read_and_may_stand_with_their_rates() {
        let e = of("force = \"-F*z - F*z'*d\"\nstates = { z = \"(v - abs(v)*z)/d\" }").unwrap().remove(0);
        assert_eq!(e.states, [("z".to_owned(), "(v - abs(v)*z)/d".to_owned())]);
    }

    #[test]
    fn mistakes_in_states_are_told_with_their_line() {
        for (rest, line, told) in [
            ("force = \"-F*z\"\nstates = { z = \"(v - abs(v)*zz)/d\" }", 7, "zz"),
            ("force = \"-F*z\"\nstates = { z = \"v - F*z\" }", 7, "strength in the law of z"),
            ("force = \"-F*z\"\nstates = { z = \"v - t*z\" }", 7, "a time in the law of z"),
            ("force = \"-F*z\"\nstates = { z = \"v - load*z\" }", 7, "the load in the law of z"),
            ("force = \"-F*v/d\"\nstates = { z = \"v - z/d\" }", 7, "does not use"),
            ("force = \"-F*d\"\nstates = { d = \"v\" }", 7, "second time"),
            ("force = \"-F*v\"\nstates = { v = \"v\" }", 7, "second time"),
            ("force = \"-F*z\"\nstates = { z = 3 }", 7, "law of its rate"),
            ("force = \"-F*y\"\nstates = { z = \"v - z/d\" }", 6, "y"),
            ("force = \"-F*z''\"\nstates = { z = \"v - z/d\" }", 6, "no accelerations"),
            ("states = \"z\"\nforce = \"-F*v\"", 6, "states"),
        ] {
            let error = of(rest).unwrap_err().to_string();
            assert!(error.contains(told) && error.contains(&format!("line {line}")), "{rest}: {error}");
        }
        let encoder = "[[effect]]\nid = \"m\"\nat = \"encoder\"\nstrengths = [\"F\"]\nreads = \"x + F*v\"\nstates = { z = \"v\" }\n";
        let source = Source { text: encoder.to_owned(), path: Path::new("m.toml").to_path_buf() };
        let error = read(&source).unwrap_err().to_string();
        assert!(error.contains("line 6") && error.contains("joint or an arm"), "{error}");
    }
}

//! An effect's entry: where it acts and how, its law, strengths, shapes and states; [`read`] reads
//! and checks them.

mod beside;
mod reading;

pub use self::beside::read_beside;
pub use self::reading::read;
use super::columns::LOAD;
use super::on_a_frame;
use crate::model::model_file::expression::{Node, Symbol, number, symbol};
use crate::model::model_file::parser::parse;
use crate::system::derivative::by_time;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::words::{Scope, Scoped, Value as Word, Words};

/// Most values of a shape parameter, and most forms of an entry and of all that a user adds: bounds
/// what a file can ask for.
pub const MOST_FORMS: usize = 400;

/// Where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum At {
    /// A joint.
    Joint,
    /// A pair of coordinates.
    Between,
    /// An arm.
    Arm,
    /// A body that is a mass at a point.
    Body,
    /// The driven point.
    Drive,
    /// The frame that carries everything.
    Frame,
    /// A sensor.
    Encoder,
    /// A measured input.
    Input,
}

/// The shape parameter that says on how much of it.
pub const LENGTH: &str = "length";
/// The one that stands for the mass of the arm nearest to a joint, kg, where a load rests on it and
/// nothing fixes it: equations of motion hold its first moment alone.
pub const MASS: &str = "mass";

/// How it acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verb {
    /// Does work.
    Force,
    /// Does work all along an arm, a force per length, or at a body, a force per velocity.
    Drags,
    /// Displaces the driven point, or all that a frame carries.
    Moves,
    /// Advances the drive's phase.
    Advances,
    /// Turns a centroid or gravity.
    Turns,
    /// Is what a sensor shows, or what is recorded of an input.
    Reads,
}

/// A parameter that fixes an effect's form.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Name.
    pub name: String,
    /// Values that are tried.
    pub grid: Vec<f64>,
    /// Bounds of its refinement; none for a whole number, which is not refined.
    pub within: Option<[f64; 2]>,
    /// Whether the values are the frequencies, Hz, of lines in what is left of a record; `grid`
    /// then only stands for them.
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
    /// The effect that negative strengths take away from: where it stands at the same place, these
    /// may have either sign.
    pub takes_from: Option<String>,
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
    /// Values of the strengths near which columns are made, where they do not enter linearly; empty
    /// for nothing.
    pub about: Vec<f64>,
    /// What it adds, for people.
    pub equation: String,
    /// How it shows in residuals.
    pub signature: String,
    /// The laboratory test that would confirm it.
    pub confirm: String,
}

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

    /// The same with one more shape, which the law does not name: what it rests on and nothing
    /// fixes.
    #[must_use]
    pub fn with_shape(&self, name: &str, grid: Vec<f64>, within: Option<[f64; 2]>) -> Self {
        let mut out = self.clone();
        out.shapes.push(Shape { name: name.to_owned(), grid, within, of_lines: false });
        out
    }

    /// Whether the law names a word.
    pub fn names(&self, word: &str) -> bool {
        has_word(&self.law, word)
    }

    /// The law in the words of a place: shape parameters are numbers, strengths the parameters from
    /// `words.parameters.len()` on.
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

/// What an effect's first strength multiplies, in the words of a displacement: for its unit. The
/// load, N, is the first input.
pub fn multiplied(e: &Entry, form: &Form, on: &Polynomial, coordinates: usize, omega: f64) -> Option<Node> {
    let rate = by_time(on, coordinates, omega).ok()?;
    let mut words = Words::default();
    let time = Polynomial::motion(Symbol::Time);
    words.scalars = vec![
        ("x".to_owned(), on.clone()),
        ("v".to_owned(), rate.clone()),
        ("omega".to_owned(), rate),
        ("t".to_owned(), time.clone()),
        // The record's length is a time as well: t/T is a number.
        ("T".to_owned(), time),
        (LOAD.to_owned(), Polynomial::motion(Symbol::Input(0))),
    ];
    let Ok(Word::Scalar(law)) = e.law(&words, form) else { return None };
    let of = law.by_parameters().get(&vec![(Atom::Parameter(0), 1)]).map(Polynomial::node)?;
    // A state has the unit of the displacement, but that of a strength which is a force by itself
    // none.
    let is_force = e.unit.as_deref() == Some("N m");
    let state = |s: Symbol| match s {
        Symbol::State(_) if is_force => number(1.0),
        Symbol::State(_) => on.node(),
        other => symbol(other),
    };
    Some(of.replace(&state))
}

/// Names of all words of a place, which nothing else may have.
fn words_of(vocabulary: &[&str]) -> Vec<String> {
    let Words { scalars, points, .. } = stand_ins(vocabulary);
    let names = scalars.into_iter().map(|s| s.0).chain(points.into_iter().map(|p| p.0));
    names.chain(["T".to_owned()]).collect()
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
    if vocabulary == on_a_frame::WORDS {
        words.points = on_a_frame::axes();
    }
    if vocabulary.contains(&"t") {
        words.constants.push(("T".to_owned(), 1.0));
    }
    words
}

#[cfg(test)]
#[path = "entry_tests.rs"]
mod tests;

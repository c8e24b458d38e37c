//! What a language over the parser's rules gives it: the meaning of names, operations, functions
//! and lists, and their mistakes.

use std::ops::Range;

/// A mistake in an expression.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// Bytes of the text at fault.
    pub at: Range<usize>,
    /// What is wrong there.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// What to do about it.
    pub remedy: String,
}

/// What is wrong with an operation, a name or a call; its place is where the parser stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fault {
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// What to do about it.
    pub remedy: String,
}

impl Fault {
    /// Found, expected, what to do.
    pub fn new(found: impl Into<String>, expected: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { found: found.into(), expected: expected.into(), remedy: remedy.into() }
    }

    /// The same with its place.
    pub fn at(self, at: &Range<usize>) -> Mistake {
        Mistake { at: at.clone(), found: self.found, expected: self.expected, remedy: self.remedy }
    }
}

/// What the text's names and operations mean: the parser's rules are the same for every language
/// over it.
pub trait Grammar {
    /// What an expression becomes.
    type Value;
    /// Whether there are lists `[a, b]`.
    const LISTS: bool;
    /// Whether functions may have several arguments.
    const ARGUMENTS: bool = Self::LISTS;

    /// A number.
    fn number(&self, x: f64) -> Self::Value;

    /// left `operator` right, one of + - * / ^.
    ///
    /// # Errors
    /// Operands that do not go together.
    fn operation(&self, operator: char, left: Self::Value, right: Self::Value) -> Result<Self::Value, Fault>;

    /// A name with its primes; none where it is a function, whose arguments follow if `called`.
    ///
    /// # Errors
    /// A name that there is not.
    fn name(&self, name: &str, primes: usize, called: bool) -> Result<Option<Self::Value>, Fault>;

    /// A function of its arguments (one at least).
    ///
    /// # Errors
    /// Arguments that it does not take.
    fn call(&self, name: &str, arguments: Vec<Self::Value>) -> Result<Self::Value, Fault>;

    /// A list.
    ///
    /// # Errors
    /// A list that there cannot be.
    fn list(&self, items: Vec<Self::Value>) -> Result<Self::Value, Fault>;
}

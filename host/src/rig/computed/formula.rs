//! What a computed channel's expression is made of: columns, numbers, operations, functions.
//!
//! Unlike the expressions of model files it is never differentiated, integrated by parts or
//! exported, so that it may hold what makes angles of coordinates: atan2(y, x), atan, asin, acos.

use crate::model::model_file::expression::{FUNCTIONS, Function};

/// An expression over columns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Formula {
    /// A number.
    Number(f64),
    /// The value of the column with this index.
    Column(usize),
    /// left operator right, one of + - * / ^.
    Operation(char, Box<Self>, Box<Self>),
    /// A function of one argument.
    Call(Of, Box<Self>),
    /// atan2(y, x): the angle of the point (x, y) from the axis of x, (−π, π].
    Atan2(Box<Self>, Box<Self>),
}

/// A function of one argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Of {
    /// One that model files have too.
    Model(Function),
    /// Inverse tangent, −π/2 to π/2.
    Atan,
    /// Inverse sine, −π/2 to π/2.
    Asin,
    /// Inverse cosine, 0 to π.
    Acos,
}

/// What model files have no functions for.
const INVERSE: [(&str, Of); 3] = [("atan", Of::Atan), ("asin", Of::Asin), ("acos", Of::Acos)];
/// The only function of two arguments.
pub(super) const OF_TWO: &str = "atan2";

/// The function of one argument with this name.
pub(super) fn function(name: &str) -> Option<Of> {
    let model = FUNCTIONS.iter().find(|f| f.0 == name).map(|f| Of::Model(f.1));
    model.or_else(|| INVERSE.iter().find(|f| f.0 == name).map(|f| f.1))
}

/// Names of all functions: for messages.
pub(super) fn names() -> Vec<&'static str> {
    let inverse = INVERSE.iter().map(|f| f.0);
    FUNCTIONS.iter().map(|f| f.0).chain(inverse).chain([OF_TWO]).collect()
}

impl Of {
    fn value(self, x: f64) -> f64 {
        match self {
            Self::Model(f) => f.value(x),
            Self::Atan => x.atan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
        }
    }
}

impl Formula {
    /// Its value where `of` gives the columns'.
    pub(crate) fn value(&self, of: &dyn Fn(usize) -> f64) -> f64 {
        match self {
            Self::Number(x) => *x,
            Self::Column(i) => of(*i),
            Self::Operation(operator, a, b) => {
                let (a, b) = (a.value(of), b.value(of));
                match operator {
                    '+' => a + b,
                    '-' => a - b,
                    '*' => a * b,
                    '/' => a / b,
                    _ => a.powf(b),
                }
            }
            Self::Call(f, a) => f.value(a.value(of)),
            Self::Atan2(y, x) => y.value(of).atan2(x.value(of)),
        }
    }

    /// Whether a column satisfies a condition.
    pub(crate) fn any(&self, wanted: &dyn Fn(usize) -> bool) -> bool {
        match self {
            Self::Number(_) => false,
            Self::Column(i) => wanted(*i),
            Self::Operation(_, a, b) | Self::Atan2(a, b) => a.any(wanted) || b.any(wanted),
            Self::Call(_, a) => a.any(wanted),
        }
    }
}

//! What a figure is made of: panels with axes, series and reference lines; layout in CSS pixels.

use super::axis::Axis;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A line; points that are not finite break it.
    Line,
    /// A thin line, for dense histories.
    Thin,
    /// Small dots.
    Dots,
    /// Larger dots (smaller again where there are more than 300).
    BigDots,
    /// Larger dots with an interval `low` … `high` each.
    Intervals,
    /// Bars from the axis.
    Bars,
}

/// One series of a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend; none where empty.
    pub name: String,
    /// How it is drawn.
    pub shape: Shape,
    /// Index into the palette; its place in the panel where none.
    pub colour: Option<usize>,
    /// Horizontal values.
    pub x: Vec<f64>,
    /// Vertical values, as many.
    pub y: Vec<f64>,
    /// Lower ends of intervals (`Shape::Intervals`).
    pub low: Vec<f64>,
    /// Upper ends.
    pub high: Vec<f64>,
}

impl Series {
    /// A series without intervals.
    pub fn new(name: impl Into<String>, shape: Shape, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), shape, colour: None, x, y, low: Vec::new(), high: Vec::new() }
    }

    /// The same in a colour of the palette.
    pub fn colour(mut self, index: usize) -> Self {
        self.colour = Some(index);
        self
    }
}

/// A reference line across a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Rule {
    /// Vertical at x, otherwise horizontal at y.
    pub vertical: bool,
    /// Where.
    pub at: f64,
    /// Short text at its upper (or right) end.
    pub label: String,
}

/// One pair of axes with what is in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Short title above it; may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series.
    pub series: Vec<Series>,
    /// Reference lines.
    pub rules: Vec<Rule>,
    /// Leaves tick texts and label of the horizontal axis to the panel below.
    pub shares_x: bool,
}

impl Panel {
    /// A panel without series.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), x, y, series: Vec::new(), rules: Vec::new(), shares_x: false }
    }
}

/// How panels are arranged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Panels side by side.
    pub columns: usize,
    /// Full width, CSS pixels.
    pub width: f64,
    /// Height of a panel's frame, CSS pixels.
    pub height: f64,
}

impl Default for Layout {
    fn default() -> Self {
        Self { columns: 1, width: 900.0, height: 220.0 }
    }
}

//! Values with intervals, one for each name: identified over true, shares of energy, gaps.

use super::Figure;
use super::axis::Axis;
use super::canvas::{Layout, Panel, Rule, Series, Shape};

/// A named value with an interval (equal ends: none).
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// Name under it, `B_{11}`.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Lower end of its interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Names along the horizontal axis.
fn names(bars: &[Bar]) -> Axis {
    let ticks = bars.iter().enumerate().map(|(i, b)| (i as f64, b.name.clone())).collect();
    Axis { ticks: Some(ticks), ..Axis::linear("").range(-0.6, bars.len().max(1) as f64 - 0.4) }
}

/// What was found over what is true, with intervals, about 1.
pub fn found_over_true(caption: &str, bars: &[Bar]) -> Figure {
    let mut panel = Panel::new("", names(bars), Axis::linear("found / true"));
    let mut series = Series::new(
        "",
        Shape::Intervals,
        (0..bars.len()).map(|i| i as f64).collect(),
        bars.iter().map(|b| b.value).collect(),
    );
    series.low = bars.iter().map(|b| b.low).collect();
    series.high = bars.iter().map(|b| b.high).collect();
    panel.series.push(series);
    panel.rules.push(Rule { vertical: false, at: 1.0, label: String::new() });
    Figure::draw(caption, &Layout { height: 240.0, ..Layout::default() }, &[panel])
}

/// Bars from zero.
pub fn bars(caption: &str, axis: Axis, bars: &[Bar]) -> Figure {
    named(caption, axis, Shape::Bars, bars)
}

/// Dots, for a log axis, which has no zero to draw bars from.
pub fn dots(caption: &str, axis: Axis, bars: &[Bar]) -> Figure {
    named(caption, axis, Shape::Intervals, bars)
}

fn named(caption: &str, axis: Axis, shape: Shape, bars: &[Bar]) -> Figure {
    let mut panel = Panel::new("", names(bars), axis);
    let x = (0..bars.len()).map(|i| i as f64).collect();
    panel.series.push(Series::new("", shape, x, bars.iter().map(|b| b.value).collect()));
    Figure::draw(caption, &Layout { height: 220.0, ..Layout::default() }, &[panel])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_under_their_values() {
        let some = [
            Bar { name: "B_{11}".into(), value: 1.01, low: 0.99, high: 1.03 },
            Bar { name: "C_{2}".into(), value: 0.9, low: 0.7, high: 1.1 },
        ];
        let figure = found_over_true("found over true", &some);
        assert!(figure.svg.contains("B<tspan") && figure.csv.lines().nth(2) == Some("1,0.9,0.7,1.1"), "{}", figure.csv);
        assert!(bars("b", Axis::linear("energy / %"), &some).svg.contains("<rect"));
        assert!(dots("d", Axis::log("relative error / %"), &some).svg.contains("M"));
    }
}

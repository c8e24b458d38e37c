//! Time histories: the whole record unwrapped, and its beginning on the circle.

use crate::inspect::Inspection;
use crate::inspect::motion::Space;
use crate::inspect::plots::{History, Plots};
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};
use crate::report::figures::lines::lines;
use crate::report::html::Html;
use crate::report::{Results, SectionKind};
use crate::wording::symbols::symbol_svg;

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "histories", title: "Time histories", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    let several = results.all::<Inspection>().count() > 1;
    for inspection in results.all::<Inspection>() {
        if several {
            body.heading(&inspection.record.file);
        }
        let whole = panels(inspection, |p| &p.whole, false);
        let start = panels(inspection, |p| &p.start, true);
        let turns = inspection.coordinates.iter().any(|c| c.space == Space::S1);
        let wrapped = if turns { ", angles wrapped to ±π (0 hangs down)" } else { "" };
        body.figure(&lines(&format!("The beginning of the record{wrapped}."), 120.0, &start));
        let unwrapped = if turns { ", unwrapped" } else { "" };
        body.figure(&lines(
            &format!(
                "The whole record{unwrapped}; least and greatest of each stretch of time are drawn, so peaks are kept, and \
                 gaps stay open."
            ),
            120.0,
            &whole,
        ));
    }
    (body != Html::new()).then_some(body)
}

/// One panel for each coordinate, sharing the time axis.
fn panels(inspection: &Inspection, pick: fn(&Plots) -> &History, wrapped: bool) -> Vec<Panel> {
    let wide = |v: &[f32]| v.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    let last = inspection.plots.len().saturating_sub(1);
    let ends = inspection.plots.iter().flat_map(|p| &pick(p).time_s).filter(|t| t.is_finite());
    let (low, high) =
        ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(f64::from(*t)), h.max(f64::from(*t))));
    // To the next hundredth, so that 119.998 s ends at a tick.
    let grain = 10f64.powf((high - low).max(1e-9).log10().floor() - 2.0);
    let high = if high > low { (high / grain).ceil() * grain } else { high };
    let dense = inspection.plots.iter().any(|p| pick(p).time_s.len() > 1500);
    inspection
        .plots
        .iter()
        .zip(&inspection.coordinates)
        .enumerate()
        .map(|(i, (plots, c))| {
            let symbol = symbol_svg(&c.name);
            let mut y = wide(&pick(plots).value);
            let small = c.greatest <= std::f64::consts::PI && c.least >= -std::f64::consts::PI;
            let axis = match (c.space, wrapped && !small) {
                (Space::S1, true) => Axis::angle(format!("{symbol} / rad")),
                (Space::S1, false) if c.greatest - c.least > 20.0 => {
                    y.iter_mut().for_each(|y| *y /= std::f64::consts::TAU);
                    Axis::linear(format!("{symbol} / turns"))
                }
                _ => Axis::linear(format!("{symbol} / {}", c.unit)),
            };
            let mut panel = Panel::new("", Axis::linear("time / s").range(low, high), axis);
            panel.shares_x = i < last;
            let shape = if dense { Shape::Thin } else { Shape::Line };
            panel.series.push(Series::new("", shape, wide(&pick(plots).time_s), y).colour(i));
            panel
        })
        .collect()
}

//! Lays panels out and draws them: frame, grid, ticks, labels, marks, one legend above.
//!
//! Units are half CSS pixels at full width (a drawing 900 px wide has 1800 units), so that
//! whole-number coordinates, which are all that the back end writes, are still smooth.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axis::Fixed;
pub use super::panel::{Layout, Panel, Rule, Series, Shape};
use super::{compact, palette};
use crate::wording::format;

/// Units a CSS pixel at full width.
const U: f64 = 2.0;
/// Font size of ticks and labels, CSS pixels.
const FONT: f64 = 12.5;

/// Width of a text, CSS pixels, by the letters of a wide face (narrower ones leave a little room).
fn text_width(text: &str, size: f64) -> f64 {
    let em = |c: char| match c {
        '.' | ',' | ':' | ';' | 'i' | 'l' | '|' | '\'' | '·' | ' ' => 0.34,
        '−' | '×' | 'm' | 'w' => 0.86,
        '⁻' | '⁰'..='⁹' | '¹' | '²' | '³' => 0.45,
        _ => 0.64,
    };
    super::plain(text).chars().map(em).sum::<f64>() * size
}

struct Pen<'a, 'b>(&'b DrawingArea<SVGBackend<'a>, plotters::coord::Shift>);

impl Pen<'_, '_> {
    fn px(x: f64, y: f64) -> (i32, i32) {
        ((x * U).round() as i32, (y * U).round() as i32)
    }

    fn line(&self, from: (f64, f64), to: (f64, f64), colour: &RGBColor, width: u32) {
        let style = colour.stroke_width(width);
        // Writing into memory cannot fail; the same holds below.
        let _ = self.0.draw(&PathElement::new(vec![Self::px(from.0, from.1), Self::px(to.0, to.1)], style));
    }

    fn dot(&self, at: (f64, f64), radius: u32, colour: &RGBColor) {
        let _ = self.0.draw(&Circle::new(Self::px(at.0, at.1), radius, colour.filled()));
    }

    fn text(&self, label: Label<'_>) {
        let Label { text, at, anchor, size, colour, bold, up } = label;
        // The back end divides sizes by 1.24.
        let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
        let mut font = FontDesc::new(FontFamily::SansSerif, size * U * 1.24, style);
        if up {
            font = font.transform(FontTransform::Rotate270);
        }
        let style = TextStyle::from(font).color(colour).pos(Pos::new(anchor.0, anchor.1));
        let _ = self.0.draw(&Text::new(text.to_owned(), Self::px(at.0, at.1), style));
    }
}

/// A text where it stands.
#[derive(Clone, Copy)]
struct Label<'a> {
    text: &'a str,
    at: (f64, f64),
    /// Which point of the text lies there.
    anchor: (HPos, VPos),
    /// CSS pixels.
    size: f64,
    colour: &'a RGBColor,
    bold: bool,
    /// Whether it reads upward.
    up: bool,
}

impl<'a> Label<'a> {
    /// In ink, of the size of ticks.
    fn new(text: &'a str, at: (f64, f64), anchor: (HPos, VPos)) -> Self {
        Self { text, at, anchor, size: FONT, colour: &palette::INK, bold: false, up: false }
    }
}

/// Draws the panels, row by row. `alternative`: text for readers that cannot show the drawing.
pub fn draw(layout: &Layout, panels: &[Panel], alternative: &str) -> String {
    let columns = layout.columns.clamp(1, 8);
    let cell = layout.width / columns as f64;
    let axes: Vec<(Fixed, Fixed)> = panels
        .iter()
        .map(|p| {
            let values =
                |pick: fn(&Series) -> [&[f64]; 3]| p.series.iter().flat_map(move |s| pick(s).into_iter().flatten());
            let x = p.x.fix(values(|s| [&s.x, &[], &[]]), cell - 90.0, 62.0);
            let bars = p.series.iter().any(|s| s.shape == Shape::Bars);
            let zero = if bars { &[0.0][..] } else { &[] };
            let y = p.y.fix(values(|s| [&s.y, &s.low, &s.high]).chain(zero), layout.height, 27.0);
            (x, y)
        })
        .collect();
    // Panels of a column share the margin that the widest tick text among them needs.
    let lefts: Vec<f64> = (0..columns)
        .map(|c| {
            let texts = axes.iter().skip(c).step_by(columns).flat_map(|a| &a.1.ticks);
            texts.map(|t| text_width(&t.1, FONT)).fold(14.0, f64::max) + 34.0
        })
        .collect();
    let legend = legend_rows(panels, layout.width);
    let mut y = 6.0 + 22.0 * legend.len() as f64;
    let mut tops = Vec::new();
    let rows: Vec<&[Panel]> = panels.chunks(columns).collect();
    for row in &rows {
        let titled = row.iter().any(|p| !p.title.is_empty());
        let powered = axes.iter().skip(tops.len() * columns).take(columns).any(|a| a.1.power != 0);
        let top = y + if titled || powered { 22.0 } else { 8.0 };
        tops.push(top);
        y = top
            + layout.height
            + match row {
                row if row.iter().all(|p| p.shares_x) => 8.0,
                row if row.iter().all(|p| p.x.label.is_empty()) => 28.0,
                _ => 46.0,
            };
    }
    let mut svg = String::new();
    let mut places = Vec::with_capacity(panels.len());
    {
        let size = ((layout.width * U) as u32, ((y + 2.0) * U) as u32);
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        let pen = Pen(&root);
        for (r, row) in legend.iter().enumerate() {
            draw_legend(&pen, row, 6.0 + 22.0 * r as f64 + 8.0);
        }
        for (i, (panel, (x, y))) in panels.iter().zip(&axes).enumerate() {
            let left = (i % columns) as f64 * cell + lefts[i % columns];
            let width = (cell - lefts[i % columns] - 14.0).max(20.0);
            let frame = Frame { left, top: tops[i / columns], width, height: layout.height };
            places.push(place(frame, x, y));
            draw_axes(&pen, panel, x, y, frame);
            draw_marks(&root, panel, x, y, frame);
        }
        let _ = root.present();
    }
    compact::compact(&svg, alternative).replacen("<svg ", &format!("<svg data-panels=\"{}\" ", places.join(";")), 1)
}

/// Where a panel lies in a figure, CSS pixels.
#[derive(Clone, Copy)]
struct Frame {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

/// Where a panel lies in the drawing's units and what it ranges over, for the page's script: left,
/// top, width, height, low and high of both axes in the coordinates that are drawn, 1 for an axis
/// of logarithms.
fn place(frame: Frame, x: &Fixed, y: &Fixed) -> String {
    let log = |a: &Fixed| u8::from(a.scale == super::axis::Scale::Log);
    let units = [frame.left, frame.top, frame.width, frame.height].map(|v| (v * U).round().to_string()).join(" ");
    let ends = [x.low, x.high, y.low, y.high].map(|v| format::shortest(v).replace('−', "-")).join(" ");
    format!("{units} {ends} {} {}", log(x), log(y))
}

/// Legend entries, each name once, broken into rows that fit.
fn legend_rows(panels: &[Panel], width: f64) -> Vec<Vec<(f64, String, RGBColor, Shape)>> {
    let mut rows: Vec<Vec<(f64, String, RGBColor, Shape)>> = Vec::new();
    let mut seen: Vec<&str> = Vec::new();
    let mut x = 0.0;
    for panel in panels {
        for (i, s) in panel.series.iter().enumerate() {
            if s.name.is_empty() || seen.contains(&s.name.as_str()) {
                continue;
            }
            seen.push(&s.name);
            let needed = 34.0 + text_width(&s.name, FONT) + 22.0;
            if rows.is_empty() || x + needed > width {
                rows.push(Vec::new());
                x = 48.0;
            }
            if let Some(row) = rows.last_mut() {
                row.push((x, s.name.clone(), palette::series(s.colour.unwrap_or(i)), s.shape));
            }
            x += needed;
        }
    }
    rows
}

fn draw_legend(pen: &Pen, row: &[(f64, String, RGBColor, Shape)], y: f64) {
    for (x, name, colour, shape) in row {
        match shape {
            Shape::Line | Shape::Thin => pen.line((*x, y), (x + 24.0, y), colour, 5),
            Shape::Bars => pen.line((x + 8.0, y), (x + 20.0, y), colour, 20),
            Shape::Intervals => {
                pen.line((*x + 16.0, y - 8.0), (x + 16.0, y + 8.0), colour, 3);
                pen.dot((x + 16.0, y), 7, colour);
            }
            Shape::Dots | Shape::BigDots => pen.dot((x + 16.0, y), 7, colour),
        }
        pen.text(Label::new(name, (x + 31.0, y), (HPos::Left, VPos::Center)));
    }
}

/// The first of two tops of a label that none of these lines strikes through.
fn free_of(lines: &[f64], tops: [f64; 2]) -> f64 {
    let is_free = |top: &f64| lines.iter().all(|y| !(top - 2.0..top + FONT + 2.0).contains(y));
    tops.into_iter().find(is_free).unwrap_or(tops[0])
}

/// Frame, grid, ticks, labels and rules.
fn draw_axes(pen: &Pen, panel: &Panel, x: &Fixed, y: &Fixed, frame: Frame) {
    let Frame { left, top, width, height } = frame;
    let at_x = |v: f64| left + width * (v - x.low) / (x.high - x.low);
    let at_y = |v: f64| top + height * (1.0 - (v - y.low) / (y.high - y.low));
    let bottom = top + height;
    let ink = &palette::INK;
    for (v, text) in &x.ticks {
        pen.line((at_x(*v), top), (at_x(*v), bottom), &palette::GRID, 2);
        pen.line((at_x(*v), bottom), (at_x(*v), bottom + 4.0), ink, 2);
        if !panel.shares_x {
            pen.text(Label::new(text, (at_x(*v), bottom + 8.0), (HPos::Center, VPos::Top)));
        }
    }
    for (v, text) in &y.ticks {
        pen.line((left, at_y(*v)), (left + width, at_y(*v)), &palette::GRID, 2);
        pen.line((left - 4.0, at_y(*v)), (left, at_y(*v)), ink, 2);
        pen.text(Label::new(text, (left - 8.0, at_y(*v)), (HPos::Right, VPos::Center)));
    }
    let mut label_end = f64::NEG_INFINITY;
    let crossing: Vec<f64> = panel.rules.iter().filter(|r| !r.vertical).map(|r| at_y(y.place(r.at))).collect();
    for rule in &panel.rules {
        if rule.vertical {
            let v = x.place(rule.at);
            if v.is_finite() {
                pen.line((at_x(v), top), (at_x(v), bottom), &palette::SOFT, 2);
                let place = (at_x(v) + 3.0, free_of(&crossing, [top + 3.0, bottom - 3.0 - FONT]));
                // A label that would run into the one before it is left out.
                let end = place.0 + text_width(&rule.label, FONT - 1.5);
                if place.0 < label_end || end > left + width {
                    continue;
                }
                label_end = end;
                pen.text(Label {
                    size: FONT - 1.5,
                    colour: &palette::SOFT,
                    ..Label::new(&rule.label, place, (HPos::Left, VPos::Top))
                });
            }
        } else {
            let v = y.place(rule.at);
            if v.is_finite() {
                pen.line((left, at_y(v)), (left + width, at_y(v)), &palette::SOFT, 2);
                let place = (left + width - 4.0, at_y(v) - 2.0);
                pen.text(Label {
                    size: FONT - 1.5,
                    colour: &palette::SOFT,
                    ..Label::new(&rule.label, place, (HPos::Right, VPos::Bottom))
                });
            }
        }
    }
    for (from, to) in [
        ((left, top), (left + width, top)),
        ((left, bottom), (left + width, bottom)),
        ((left, top), (left, bottom)),
        ((left + width, top), (left + width, bottom)),
    ] {
        pen.line(from, to, ink, 2);
    }
    let power = |p: i32| if p == 0 { String::new() } else { format!("×{}", format::power_of_ten(p)) };
    if !panel.shares_x {
        let centre = (left + width / 2.0, bottom + 26.0);
        let factor = if x.power == 0 { String::new() } else { format!("  ({})", power(x.power)) };
        let label = format!("{}{factor}", panel.x.label);
        pen.text(Label::new(&label, centre, (HPos::Center, VPos::Top)));
    }
    let widest = y.ticks.iter().map(|t| text_width(&t.1, FONT)).fold(14.0, f64::max);
    let place = (left - widest - 16.0, top + height / 2.0);
    pen.text(Label { up: true, ..Label::new(&panel.y.label, place, (HPos::Center, VPos::Bottom)) });
    if y.power != 0 {
        pen.text(Label {
            size: FONT - 0.5,
            ..Label::new(&power(y.power), (left, top - 6.0), (HPos::Left, VPos::Bottom))
        });
    }
    if !panel.title.is_empty() {
        let shift = if y.power == 0 { 0.0 } else { 52.0 };
        pen.text(Label {
            size: FONT + 0.5,
            bold: true,
            ..Label::new(&panel.title, (left + shift, top - 6.0), (HPos::Left, VPos::Bottom))
        });
    }
}

/// The series, in the frame's own coordinates.
fn draw_marks(
    root: &DrawingArea<SVGBackend, plotters::coord::Shift>,
    panel: &Panel,
    x: &Fixed,
    y: &Fixed,
    frame: Frame,
) {
    let size = |v: f64| (v * U).round() as u32;
    let area = root.clone().shrink((size(frame.left), size(frame.top)), (size(frame.width), size(frame.height)));
    let Ok(mut chart) = ChartBuilder::on(&area).build_cartesian_2d(x.low..x.high, y.low..y.high) else { return };
    for (i, s) in panel.series.iter().enumerate() {
        let colour = palette::series(s.colour.unwrap_or(i));
        let points: Vec<(f64, f64)> = s.x.iter().zip(&s.y).map(|(a, b)| (x.place(*a), y.place(*b))).collect();
        let finite = || points.iter().copied().filter(|(a, b)| a.is_finite() && b.is_finite());
        match s.shape {
            Shape::Line | Shape::Thin => {
                let width = if s.shape == Shape::Line { 3 } else { 2 };
                for part in points.split(|(a, b)| !(a.is_finite() && b.is_finite())) {
                    if let [alone] = part {
                        let _ = chart.draw_series([Circle::new(*alone, 2, colour.filled())]);
                    }
                    if part.len() < 2 {
                        continue;
                    }
                    let _ = chart.draw_series(LineSeries::new(part.iter().copied(), colour.stroke_width(width)));
                }
            }
            Shape::Dots | Shape::BigDots | Shape::Intervals => {
                let ends = s.x.iter().zip(s.low.iter().zip(&s.high));
                for (at, (low, high)) in ends.filter(|_| s.shape == Shape::Intervals) {
                    let inside = |v: f64| v.clamp(y.low.min(y.high), y.high);
                    let line = [*low, *high].map(|v| (x.place(*at), inside(v)));
                    if line.iter().all(|(a, b)| a.is_finite() && b.is_finite()) {
                        let _ = chart.draw_series(LineSeries::new(line, colour.stroke_width(4)));
                    }
                }
                let radius = match s.shape {
                    Shape::Dots => 2,
                    Shape::BigDots if points.len() > 300 => 3,
                    Shape::BigDots => 5,
                    _ => 7,
                };
                let _ = chart.draw_series(finite().map(|p| Circle::new(p, radius, colour.filled())));
            }
            Shape::Bars => {
                let base = if y.low <= 0.0 && y.scale != super::axis::Scale::Log { 0.0 } else { y.low };
                let half = 0.35 * s.x.windows(2).map(|w| (w[1] - w[0]).abs()).fold(1.0, f64::min);
                let _ = chart.draw_series(
                    finite().map(|(a, b)| Rectangle::new([(a - half, base), (a + half, b)], colour.filled())),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::axis::Axis;
    use super::*;

    #[test]
    fn no_line_strikes_through_a_label() {
        assert_eq!(free_of(&[40.0], [3.0, 80.0]), 3.0);
        assert_eq!(free_of(&[8.0], [3.0, 80.0]), 80.0);
        assert_eq!(free_of(&[8.0, 85.0], [3.0, 80.0]), 3.0);
    }

    #[test]
    fn every_shape_draws_inside_its_frame() {
        let x: Vec<f64> = (0..200).map(f64::from).collect();
        let y: Vec<f64> = x.iter().map(|x| (0.1 * x).sin() * 1e9).collect();
        for shape in [Shape::Line, Shape::Thin, Shape::Dots, Shape::BigDots, Shape::Intervals, Shape::Bars] {
            let mut series = Series::new("s", shape, x.clone(), y.clone());
            series.low = y.iter().map(|y| y - 1e8).collect();
            series.high = y.iter().map(|y| y + 1e8).collect();
            let mut panel = Panel::new("title", Axis::linear("x / s"), Axis::linear("y / N").range(-5e8, 5e8));
            panel.series.push(series);
            panel.rules.push(Rule { vertical: true, at: 20.0, label: "f_{e}".into() });
            let svg = draw(&Layout::default(), &[panel.clone(), panel], "alt");
            assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"));
            assert!(svg.contains("#0072B2") && svg.contains("×10⁸"), "{shape:?}");
            assert!(!svg.contains("NaN") && !svg.contains("inf"));
        }
    }

    #[test]
    fn bytes_are_the_same_every_time_and_empty_panels_do_not_fail() {
        let panels = [Panel::new("", Axis::log("x"), Axis::angle("y"))];
        let svg = draw(&Layout { columns: 0, width: 300.0, height: 50.0 }, &panels, "");
        assert_eq!(svg, draw(&Layout { columns: 0, width: 300.0, height: 50.0 }, &panels, ""));
        assert!(draw(&Layout::default(), &[], "").contains("</svg>"));
    }
}

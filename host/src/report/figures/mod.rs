//! Figures as inline SVG, drawn with plotters, each with the numbers that it shows.
//!
//! A kind of figure ([`lines`], [`scatter`], [`residuals`], [`bars`], [`response`]) turns its data
//! into [`canvas::Panel`]s; [`canvas`] lays these out and draws axes, legend and marks; [`compact`]
//! makes the SVG small and sets subscripts. Labels are plain text in which `_{…}` is a subscript.
//! Points that are not finite break a line and are never drawn.

pub mod axis;
pub mod bars;
pub mod canvas;
pub mod compact;
pub mod decimate;
pub mod lines;
pub mod palette;
pub mod panel;
pub mod residuals;
pub mod response;
pub mod scatter;

use super::html::escape;
use canvas::{Layout, Panel};

/// Width of a drawing for a phone, CSS pixels.
const NARROW: f64 = 380.0;
/// Longest drawing that is there twice, bytes.
const MOST_TWICE: usize = 200_000;
/// Most names along an axis of a narrow drawing.
const MOST_NAMES: usize = 5;

/// A drawn figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// What it shows, plain text.
    pub caption: String,
    /// The drawing.
    pub svg: String,
    /// The same for a narrow screen, panels one below the other; none where it would make the page
    /// much larger.
    pub narrow: Option<String>,
    /// The plotted numbers, CSV with quantity and unit in the header.
    pub csv: String,
    /// Rows of the CSV, without its header.
    pub rows: usize,
}

impl Figure {
    /// Draws panels.
    pub fn draw(caption: impl Into<String>, layout: &Layout, panels: &[Panel]) -> Self {
        let caption = caption.into();
        let (csv, rows) = numbers(panels);
        let svg = canvas::draw(layout, panels, &plain(&caption));
        // Names along an axis of one's own would run into each other.
        let named = panels.iter().filter_map(|p| p.x.ticks.as_ref()).any(|t| t.len() > MOST_NAMES);
        let narrow = (svg.len() <= MOST_TWICE && !named).then(|| {
            let one = Layout { columns: 1, width: NARROW, ..*layout };
            canvas::draw(&one, panels, &plain(&caption))
        });
        Self { caption, svg, narrow, csv, rows }
    }

    /// The figure as HTML: drawing, caption, numbers to download.
    pub fn html(&self) -> String {
        format!(
            "<figure><div class=plot>{}</div><figcaption>{}</figcaption>\n<details><summary>Numbers</summary>\
             <a download=\"{}.csv\" href=\"data:text/csv;charset=utf-8,{}\">CSV, {} rows</a></details></figure>\n",
            self.drawings(),
            subscripts(&escape(&self.caption)),
            file_name(&self.caption),
            percent_encoded(&self.csv),
            crate::wording::format::count(self.rows as u64),
        )
    }
}

impl Figure {
    /// The drawing for wide and, where there is one, that for narrow screens.
    fn drawings(&self) -> String {
        let classed = |svg: &str, class: &str| svg.replacen("<svg ", &format!("<svg class={class} "), 1);
        match &self.narrow {
            Some(narrow) => classed(&self.svg, "wide") + &classed(narrow, "narrow"),
            None => classed(&self.svg, "scrolls"),
        }
    }
}

/// Most letters of a file's name.
const MOST_LETTERS: usize = 48;

/// A name for a figure's files: the caption's first words, in small letters with hyphens between
/// them.
fn file_name(caption: &str) -> String {
    let mut out = String::new();
    for word in plain(caption).split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()) {
        if !out.is_empty() && out.chars().count() + word.chars().count() > MOST_LETTERS {
            break;
        }
        out.extend((!out.is_empty()).then_some('-'));
        out.extend(word.chars().take(MOST_LETTERS).flat_map(char::to_lowercase));
    }
    if out.is_empty() { "figure".to_owned() } else { out }
}

/// `_{…}` as HTML subscripts; the text is escaped already.
fn subscripts(escaped: &str) -> String {
    let mut out = String::with_capacity(escaped.len());
    let mut rest = escaped;
    while let Some((before, after)) = rest.split_once("_{") {
        let (sub, tail) = after.split_once('}').unwrap_or((after, ""));
        out.push_str(before);
        out.push_str(&format!("<sub>{sub}</sub>"));
        rest = tail;
    }
    out + rest
}

/// `_{…}` dropped to its content: for alternative text and CSV headers.
pub fn plain(text: &str) -> String {
    text.replace("_{", "").replace('}', "")
}

/// Percent-encodes what a data address may not hold bare.
fn percent_encoded(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + text.len() / 8);
    for b in text.bytes() {
        match b {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'.' | b',' | b'-' | b'_' | b'/' | b':' => out.push(b as char),
            _ => out.push_str(&format!("%{b:02X}")),
        }
    }
    out
}

/// A number for a CSV cell: six significant digits, without trailing zeros; nothing for one that is
/// not finite.
fn cell(x: f64) -> String {
    if !x.is_finite() {
        return String::new();
    }
    if x == 0.0 {
        return "0".to_owned();
    }
    let scientific = format!("{x:.5e}");
    let rounded: f64 = scientific.parse().unwrap_or(x);
    let short = rounded.to_string();
    if short.len() <= 12 { short } else { format!("{rounded:e}") }
}

/// All series side by side: a pair of columns each (or three columns more where it has intervals).
fn numbers(panels: &[Panel]) -> (String, usize) {
    let quote = |s: String| if s.contains([',', '"', '\n']) { format!("\"{}\"", s.replace('"', "\"\"")) } else { s };
    let mut header = Vec::new();
    let mut columns: Vec<&[f64]> = Vec::new();
    for panel in panels {
        for series in &panel.series {
            let name: Vec<String> =
                [&panel.title, &series.name].into_iter().filter(|s| !s.is_empty()).map(|s| plain(s)).collect();
            let of = if name.is_empty() { String::new() } else { format!(" ({})", name.join(": ")) };
            let shared = columns.last().is_some_and(|_| {
                // A series that has the same x as the one before it needs no second column of it.
                panel.series.first().is_some_and(|f| !std::ptr::eq(f, series) && f.x == series.x)
            });
            if !shared {
                header.push(quote(format!("{}{of}", plain(&panel.x.label))));
                columns.push(&series.x);
            }
            header.push(quote(format!("{}{of}", plain(&panel.y.label))));
            columns.push(&series.y);
            for (values, what) in [(&series.low, "lower end"), (&series.high, "upper end")] {
                if !values.is_empty() {
                    header.push(quote(format!("{what}{of}")));
                    columns.push(values);
                }
            }
        }
    }
    let rows = columns.iter().map(|c| c.len()).max().unwrap_or(0);
    let mut csv = header.join(",");
    csv.push('\n');
    for r in 0..rows {
        for (i, c) in columns.iter().enumerate() {
            if i > 0 {
                csv.push(',');
            }
            if let Some(x) = c.get(r) {
                csv.push_str(&cell(*x));
            }
        }
        csv.push('\n');
    }
    (csv, rows)
}

#[cfg(test)]
mod tests {
    use super::axis::Axis;
    use super::canvas::{Series, Shape};
    use super::*;

    #[test]
    fn a_figure_carries_its_numbers_and_no_markup_of_others() {
        let mut panel = Panel::new("<b>", Axis::linear("t / s"), Axis::linear("φ_{1} / rad"));
        panel.series.push(Series::new("a,b", Shape::Line, vec![0.0, 1.0, 2.0], vec![0.5, f64::NAN, -1.25]));
        panel.series.push(Series::new("c", Shape::Dots, vec![0.0, 1.0, 2.0], vec![1.0, 2.0, 3.0]));
        let figure = Figure::draw("φ_{1} <x>", &Layout::default(), &[panel]);
        assert_eq!(figure.rows, 3);
        let lines: Vec<&str> = figure.csv.lines().collect();
        assert_eq!(lines[0], "\"t / s (<b>: a,b)\",\"φ1 / rad (<b>: a,b)\",φ1 / rad (<b>: c)");
        assert_eq!(lines[2], "1,,2");
        assert_eq!(lines[3], "2,-1.25,3");
        let html = figure.html();
        assert!(html.contains("download=\"φ1-x.csv\""), "{html}");
        let long = "Angle on the circle against velocity (slopes of cubics over 5 samples).";
        assert_eq!(file_name(long), "angle-on-the-circle-against-velocity-slopes-of");
        assert_eq!(file_name(" … "), "figure");
        // One panel: where it lies, and 0 to 2 s across with a margin.
        let panels = figure.svg.split("data-panels=\"").nth(1).unwrap().split('"').next().unwrap();
        let numbers: Vec<f64> = panels.split(' ').map(|n| n.parse().unwrap()).collect();
        assert_eq!((numbers.len(), numbers[4], numbers[5], numbers[8]), (10, -0.08, 2.08, 0.0), "{panels}");
        assert!(html.contains("φ<sub>1</sub> &lt;x&gt;") && !html.contains("<b>") && !html.contains("<x>"));
    }

    #[test]
    fn cells_are_short() {
        for (x, want) in [(0.1 + 0.2, "0.3"), (1234567.0, "1234570"), (1.0 / 3.0, "0.333333"), (-2.5e-9, "-2.5e-9")] {
            assert_eq!(cell(x), want);
        }
        assert_eq!(cell(f64::NAN), "");
    }
}

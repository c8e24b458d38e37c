//! The card that an answer opens with: what was found, the equations with the numbers in them,
//! parameters before and after, the gap as one picture, the test that would confirm it, and what
//! could not be decided. One type for terminal and page.

use std::fmt::Write;

use serde::Serialize;

use super::figures::Figure;
use super::figures::axis::Axis;
use super::figures::palette::MEASURED;
use super::figures::panel::{Layout, Panel, Rule, Series, Shape};
use super::html::{Align, Html, escape, marked};
use crate::explain::engine::compared::Compared;
use crate::export::written_out::{WrittenEquation, WrittenOut, WrittenTerm};
use crate::identify::Parameter;
use crate::rig::Rig;
use crate::wording::format::{Z95, plus_minus, significant};
use crate::wording::names;
use crate::wording::symbols::{symbol_plain, symbol_svg};

/// Widest line of an equation in a terminal, characters.
const WIDE: usize = 100;
/// Length of the longest bar in a terminal, characters.
const BAR: usize = 40;

/// A parameter before and after.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CardRow {
    /// Symbol; empty for an effect, whose plain name says all.
    pub symbol: String,
    /// What it is in plain words.
    pub plain: String,
    /// Value and standard error before; none where it was not there.
    pub before: Option<(f64, f64)>,
    /// Value and standard error.
    pub after: (f64, f64),
    /// Unit; empty for a number.
    pub unit: String,
}

/// The gap at one stage: what the model was, the gap over the noise, and the same in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GapBar {
    /// The model.
    pub name: String,
    /// Gap over what noise alone leaves.
    pub value: f64,
    /// In words.
    pub label: String,
}

/// An answer's card.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Card {
    /// What was found, one sentence.
    pub verdict: String,
    /// The equations; none where there is no model.
    pub equations: Option<WrittenOut>,
    /// Parameters.
    pub parameters: Vec<CardRow>,
    /// What is to be known of them beside their intervals.
    pub remarks: Vec<String>,
    /// What the gap is measured by, and the gap at each stage.
    pub gap: (String, Vec<GapBar>),
    /// The picture.
    pub picture: Option<Compared>,
    /// Checks that were not passed.
    pub failed: Vec<String>,
    /// Tests in the laboratory.
    pub confirm: Vec<String>,
    /// What could not be decided, and what to do for it.
    pub undecided: Vec<String>,
}

impl CardRow {
    /// Of a coefficient of a rig's model; what it multiplies stands where it has no plain name.
    pub fn of(p: &Parameter, equations: Option<&WrittenOut>, rig: &Rig) -> Self {
        let multiplies = || equations.and_then(|w| Some(factor(w.multiplies.get(&p.name)?, w.equations.len())));
        let plain = names::parameter(&p.name).filter(|_| rig.names_a_pendulum_s(&p.name));
        Self {
            symbol: p.name.clone(),
            plain: plain.map(str::to_owned).or_else(multiplies).unwrap_or_default(),
            before: None,
            after: (p.value, p.std_error),
            unit: if p.unit == "1" { String::new() } else { p.unit.clone() },
        }
    }

    /// Value and 95 % interval.
    fn interval((value, std_error): (f64, f64)) -> String {
        if std_error.is_infinite() {
            return "not determined by this record".to_owned();
        }
        plus_minus(value, Z95 * std_error)
    }

    /// How much the value changed; empty where that means nothing.
    fn change(&self) -> String {
        let Some((before, error)) = self.before else { return "new".to_owned() };
        let (after, other) = self.after;
        let change = 100.0 * (after / before - 1.0);
        // A change within the errors is none.
        if !change.is_finite() || after.abs() < Z95 * other || (after - before).abs() < Z95 * error.hypot(other) {
            return String::new();
        }
        format!("{}{} %", if change > 0.0 { "+" } else { "" }, significant(change, 2))
    }

    /// Name in a terminal.
    fn name(&self) -> String {
        if self.plain.is_empty() {
            symbol_plain(&self.symbol)
        } else if self.symbol.is_empty() {
            self.plain.clone()
        } else {
            format!("{}, {}", symbol_plain(&self.symbol), self.plain)
        }
    }
}

/// What a coefficient of no plain name is: `in equation 1: x` of several, as a person says it.
fn factor(place: &str, equations: usize) -> String {
    match place.split_once(": ") {
        Some((_, of)) if equations == 1 => format!("factor of {of}"),
        Some((at, of)) => format!("factor {at} of {of}"),
        None => place.to_owned(),
    }
}

/// Terms of one side behind their signs, as text.
fn signed(terms: &[WrittenTerm]) -> Vec<String> {
    if terms.is_empty() {
        return vec!["0".to_owned()];
    }
    let all = terms.iter().enumerate();
    all.map(|(k, t)| match (k, t.negative) {
        (0, false) => t.text.clone(),
        (0, true) => format!("−{}", t.text),
        (_, false) => format!("+ {}", t.text),
        (_, true) => format!("− {}", t.text),
    })
    .collect()
}

/// An equation on lines of at most [`WIDE`] characters, broken between terms.
fn lines(e: &WrittenEquation) -> String {
    let mut right = signed(&e.right);
    right[0] = format!("= {}", right[0]);
    let mut out = String::from("  ");
    let mut column = 2;
    for piece in signed(&e.left).into_iter().chain(right) {
        let length = piece.chars().count() + 1;
        if column > 2 && column + length > WIDE {
            out.push_str("\n      ");
            column = 6;
        }
        column += length;
        let _ = write!(out, "{piece} ");
    }
    format!("{}\n", out.trim_end())
}

/// Columns of a terminal that a text takes: dots above a letter take none.
fn shown(text: &str) -> usize {
    text.chars().filter(|c| !('\u{300}'..='\u{36f}').contains(c)).count()
}

/// A column's width: that of its longest cell.
fn width(cells: impl Iterator<Item = String>) -> usize {
    cells.map(|c| shown(&c)).max().unwrap_or(0)
}

/// A cell filled up to a width.
fn cell(text: &str, width: usize) -> String {
    format!("{text}{}", " ".repeat(width.saturating_sub(shown(text))))
}

impl Card {
    /// The card in a terminal.
    pub fn text(&self) -> String {
        let mut out = format!("{}\n", self.verdict);
        if let Some(e) = &self.equations {
            out.push_str("\nEquations of motion\n");
            e.equations.iter().for_each(|e| out.push_str(&lines(e)));
            e.notes.iter().for_each(|n| out.push_str(&format!("  {n}\n")));
        }
        if !self.parameters.is_empty() {
            self.table(&mut out);
            self.remarks.iter().for_each(|r| out.push_str(&format!("  {r}\n")));
        }
        self.bars(&mut out);
        for (heading, list) in
            [("Not passed", &self.failed), ("To confirm it", &self.confirm), ("Not decided", &self.undecided)]
        {
            if !list.is_empty() {
                let _ = writeln!(out, "\n{heading}");
                list.iter().for_each(|l| out.push_str(&format!("  {l}\n")));
            }
        }
        out
    }

    fn has_before(&self) -> bool {
        self.parameters.iter().any(|p| p.before.is_some_and(|before| before != p.after))
    }

    fn table(&self, out: &mut String) {
        let both = self.has_before();
        let _ = writeln!(out, "\nParameters{} (± is a 95 % interval)", if both { " before → after" } else { "" });
        let before = |p: &CardRow| p.before.map_or_else(|| "–".to_owned(), CardRow::interval);
        let after = |p: &CardRow| CardRow::interval(p.after);
        let widths = [
            width(self.parameters.iter().map(CardRow::name)),
            width(self.parameters.iter().map(before)),
            width(self.parameters.iter().map(after)),
            width(self.parameters.iter().map(|p| p.unit.clone())),
        ];
        for p in &self.parameters {
            let mut line = format!("  {}  ", cell(&p.name(), widths[0]));
            if both {
                let _ = write!(line, "{}  →  ", cell(&before(p), widths[1]));
            }
            let _ = write!(line, "{}  {}", cell(&after(p), widths[2]), cell(&p.unit, widths[3]));
            if both {
                let _ = write!(line, "  {}", p.change());
            }
            let _ = writeln!(out, "{}", line.trim_end());
        }
    }

    fn bars(&self, out: &mut String) {
        let (heading, bars) = &self.gap;
        let most = bars.iter().map(|b| b.value).filter(|v| v.is_finite()).fold(0.0, f64::max);
        if bars.is_empty() || most <= 0.0 {
            return;
        }
        let _ = writeln!(out, "\n{heading}");
        let wide = width(bars.iter().map(|b| b.name.clone()));
        for b in bars {
            let length = if b.value.is_finite() { ((b.value / most * BAR as f64).round() as usize).max(1) } else { 0 };
            let bar = format!("{}{}", "█".repeat(length), " ".repeat(BAR - length.min(BAR)));
            let _ = writeln!(out, "  {}  {bar}  {}", cell(&b.name, wide), b.label);
        }
    }

    /// The card in a page.
    pub fn html(&self) -> Html {
        let mut body = Html::new();
        body.0.push_str(&format!("<p class=verdict>{}</p>\n", marked(&self.verdict)));
        if let Some(e) = &self.equations {
            body.heading("Equations of motion");
            e.equations.iter().for_each(|e| equation(&mut body, e));
            let notes: Vec<String> = e.notes.iter().map(|n| escape(n)).collect();
            body.0.push_str(&format!("<p class=quiet>{}</p>\n", notes.join(" ")));
        }
        if !self.parameters.is_empty() {
            self.html_table(&mut body);
            self.remarks.iter().for_each(|r| {
                body.paragraph(r);
            });
        }
        let bars: Vec<(String, f64, String)> =
            self.gap.1.iter().map(|b| (b.name.clone(), b.value, b.label.clone())).collect();
        if bars.len() > 1 {
            body.heading(&self.gap.0);
            body.bars(["model", "how far predictions miss"], &bars);
        }
        if let Some(p) = &self.picture {
            body.figure(&picture(p));
        }
        for (heading, list) in [
            ("What was not passed", &self.failed),
            ("The test in the laboratory that would confirm it", &self.confirm),
            ("What could not be decided, and what to do for it", &self.undecided),
        ] {
            if !list.is_empty() {
                body.heading(heading);
                list.iter().for_each(|l| {
                    body.paragraph(l);
                });
            }
        }
        body
    }

    fn html_table(&self, body: &mut Html) {
        let both = self.has_before();
        body.heading(if both { "Parameters before and after" } else { "Parameters" });
        let head = |t: &str, a| (Html::text(t), a);
        let mut heads = vec![head("", Align::Left), head("what it is", Align::Left)];
        if both {
            heads.push(head("before ±\u{a0}95\u{a0}%", Align::Right));
        }
        let now = if both { "after ±\u{a0}95\u{a0}%" } else { "value ±\u{a0}95\u{a0}%" };
        heads.push(head(now, Align::Right));
        heads.push(head("unit", Align::Left));
        if both {
            heads.push(head("change", Align::Right));
        }
        // On a phone a line may end before a sign, never behind it.
        let interval = |of: (f64, f64)| CardRow::interval(of).replace("± ", "±\u{a0}");
        let row = |p: &CardRow| -> Vec<Html> {
            let symbol = if p.symbol.is_empty() { Html::new() } else { Html::symbol(&p.symbol) };
            let mut cells = vec![symbol, Html::text(&p.plain)];
            if both {
                cells.push(Html::text(&p.before.map_or_else(|| "–".to_owned(), interval)));
            }
            cells.push(Html::text(&interval(p.after)));
            cells.push(Html::text(&p.unit.replace(' ', "\u{a0}")));
            if both {
                cells.push(Html::text(&p.change().replace(' ', "\u{a0}")));
            }
            cells
        };
        body.table(&heads, &self.parameters.iter().map(row).collect::<Vec<_>>());
    }
}

/// An equation as MathML, each term an element of its own, so that lines break between them.
fn equation(body: &mut Html, e: &WrittenEquation) {
    let side = |terms: &[WrittenTerm], leads: &str| -> String {
        let one = |(k, t): (usize, &WrittenTerm)| {
            let sign = match (k, t.negative) {
                (0, false) => String::new(),
                (0, true) => "<mo>−</mo>".to_owned(),
                (_, negative) => format!("<mo form=infix>{}</mo>", if negative { '−' } else { '+' }),
            };
            let leads = if k == 0 { leads } else { "" };
            format!("<math><mrow>{leads}{sign}{}</mrow></math> ", t.mathml)
        };
        terms.iter().enumerate().map(one).collect()
    };
    let equals = "<mo form=infix>=</mo>";
    let right = if e.right.is_empty() {
        format!("<math><mrow>{equals}<mn>0</mn></mrow></math>")
    } else {
        side(&e.right, equals)
    };
    body.0.push_str(&format!("<p class=equation>{}{}</p>\n", side(&e.left, ""), right.trim_end()));
}

/// How much longer than what its initial state is fitted to a prediction is that runs on freely.
const RUNS_ON: f64 = 1.05;

/// Measured and predicted over the same seconds, and how far the predictions are off.
fn picture(p: &Compared) -> Figure {
    let symbol = symbol_svg(&p.measures);
    let time = || Axis::linear("time / s");
    let mut above = Panel::new("", time(), Axis::linear(format!("{symbol} / {}", p.unit)));
    above.shares_x = true;
    above.series.push(Series::new("measured", Shape::Line, p.t.clone(), p.measured.clone()).colour(MEASURED));
    let mut below = Panel::new("predicted − measured", time(), Axis::linear(format!("error / {}", p.unit)));
    below.rules.push(Rule { vertical: false, at: 0.0, label: String::new() });
    let alone = p.after.is_empty();
    let names =
        [if alone { "predicted by the model" } else { "predicted by the old model" }, "predicted by the new model"];
    for (k, (name, errors)) in names.iter().zip([&p.before, &p.after]).enumerate().filter(|(_, (_, e))| !e.is_empty()) {
        let colour = [2, 0][k];
        let shown: Vec<f64> = p.measured.iter().zip(errors).map(|(y, e)| y + e).collect();
        let t = p.t[..shown.len()].to_vec();
        above.series.push(Series::new(*name, Shape::Line, t.clone(), shown).colour(colour));
        below.series.push(Series::new(*name, Shape::Line, t, errors.clone()).colour(colour));
    }
    for panel in [&mut above, &mut below] {
        let label = if panel.shares_x { String::new() } else { "initial state fitted up to here".to_owned() };
        panel.rules.push(Rule { vertical: true, at: p.fitted_s, label });
    }
    let runs_on = if p.t.last().is_some_and(|last| *last > RUNS_ON * p.fitted_s) {
        "and then runs on freely"
    } else {
        "and ends with it: this record holds no longer part that was not fitted"
    };
    let caption = format!(
        "Measured, and predicted of the same seconds (from {} s of the record on, where a part begins that was not fitted). Each prediction has an initial \
         state fitted to the first {} s {runs_on}.",
        // What rounding leaves of 0 is 0.
        significant((1e9 * p.from_s).round() / 1e9, 4),
        significant(p.fitted_s, 2)
    );
    Figure::draw(caption, &Layout { height: 150.0, ..Layout::default() }, &[above, below])
}

#[cfg(test)]
#[path = "card_tests.rs"]
mod tests;

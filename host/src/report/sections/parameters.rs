//! Identified parameters with their intervals, beside the true ones where a simulation knows them.

use serde::Serialize;

use crate::report::figures::axis::Axis;
use crate::report::figures::bars::{self, Bar};
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{Z95, fixed, plus_minus, significant, to_digits_of};
use crate::wording::names;
use crate::wording::symbols::symbol_svg;

/// One parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Name as in JSON (`B11`, `J_o1`).
    pub name: String,
    /// Value, SI.
    pub value: f64,
    /// Standard error; 0 or NaN where there is none.
    pub std_error: f64,
    /// SI unit; empty or `1` for a number.
    pub unit: String,
    /// True value, where it is known.
    pub truth: Option<f64>,
}

/// A table of parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ParameterTable {
    /// Heading, such as `Double pendulum, weak form`; may be empty.
    pub heading: String,
    /// The parameters.
    pub parameters: Vec<Parameter>,
    /// Sentences below the table (ties, groups that cannot be separated).
    pub notes: Vec<String>,
}

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "parameters", title: "Parameters", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for table in results.all::<ParameterTable>().filter(|t| !t.parameters.is_empty()) {
        if !table.heading.is_empty() {
            body.heading(&table.heading);
        }
        one(&mut body, table);
    }
    (body != Html::new()).then_some(body)
}

/// A parameter's symbol; an effect's name in words.
fn told(name: &str) -> Html {
    if name.contains('@') { Html::text(&names::capitalised(&names::effect(name))) } else { Html::symbol(name) }
}

pub(super) fn one(body: &mut Html, table: &ParameterTable) {
    let truth = table.parameters.iter().any(|p| p.truth.is_some());
    let head = |t: &str, a| (Html::text(t), a);
    let mut heads = vec![head("", Align::Left), head("value ± 95 %", Align::Right), head("unit", Align::Left)];
    heads.push(head("relative", Align::Right));
    if truth {
        heads.push(head("true", Align::Right));
        heads.push(head("found − true", Align::Right));
        heads.push(head("in σ", Align::Right));
    }
    let rows: Vec<Vec<Html>> = table
        .parameters
        .iter()
        .map(|p| {
            let half = Z95 * p.std_error;
            let relative = (half / p.value).abs();
            let text = |s: String| Html::text(&s);
            let unit = if p.unit == "1" { "" } else { &p.unit };
            let mut row = vec![
                told(&p.name),
                text(plus_minus(p.value, half)),
                Html::text(&unit.replace(' ', "\u{a0}")),
                text(if relative.is_finite() && half > 0.0 {
                    format!("± {} %", significant(100.0 * relative, 2))
                } else {
                    "–".to_owned()
                }),
            ];
            if let Some(t) = p.truth {
                row.push(text(to_digits_of(t, half)));
                row.push(text(if t == 0.0 {
                    "–".to_owned()
                } else {
                    format!("{} %", significant(100.0 * (p.value / t - 1.0), 2))
                }));
                row.push(text(if p.std_error > 0.0 {
                    fixed((p.value - t) / p.std_error, 1)
                } else {
                    "–".to_owned()
                }));
            }
            row
        })
        .collect();
    body.table(&heads, &rows);
    for note in &table.notes {
        body.paragraph(note);
    }
    if truth {
        let bars: Vec<Bar> = table
            .parameters
            .iter()
            .filter_map(|p| p.truth.filter(|t| *t != 0.0).map(|t| (p, t)))
            .map(|(p, t)| {
                let ends = [(p.value - Z95 * p.std_error) / t, (p.value + Z95 * p.std_error) / t];
                Bar {
                    name: if p.name.contains('@') { names::effect(&p.name) } else { symbol_svg(&p.name) },
                    value: p.value / t,
                    low: ends[0].min(ends[1]),
                    high: ends[0].max(ends[1]),
                }
            })
            .collect();
        body.figure(&bars::found_over_true("Found over true, with 95 % intervals.", &bars));
    } else {
        let bars: Vec<Bar> = table
            .parameters
            .iter()
            .filter(|p| p.value != 0.0 && p.std_error > 0.0)
            .map(|p| {
                let value = 100.0 * (Z95 * p.std_error / p.value).abs();
                Bar {
                    name: if p.name.contains('@') { names::effect(&p.name) } else { symbol_svg(&p.name) },
                    value,
                    low: value,
                    high: value,
                }
            })
            .collect();
        if !bars.is_empty() {
            let ends = bars.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), b| (l.min(b.value), h.max(b.value)));
            let decade = |x: f64, up: f64| 10f64.powf((x.log10() + up).floor());
            let axis = Axis::log("half width of 95 % interval / %").range(decade(ends.0, 0.0), decade(ends.1, 1.0));
            body.figure(&bars::dots("How well each parameter is known: the lower, the better.", axis, &bars));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_holds_value_interval_truth_and_distance() {
        let p = |name: &str, value, std_error, truth| Parameter {
            name: name.into(),
            value,
            std_error,
            unit: "1".into(),
            truth,
        };
        let mut results = Results::new();
        results.add(ParameterTable {
            heading: "weak form <x>".into(),
            parameters: vec![p("B11", 0.113_12, 0.000_02, Some(0.1131)), p("C11", 1e-3, f64::NAN, Some(0.0))],
            notes: vec!["B11/B21 = C12/C2 & so on".into()],
        });
        let html = render(&results).unwrap().0;
        assert!(html.contains("0.11312 ±\u{a0}0.00004") && html.contains("<td class=n>1.0</td>"), "{html}");
        assert!(html.contains("weak form &lt;x&gt;") && html.contains("&amp; so on") && !html.contains("NaN"));
        assert!(render(&Results::new()).is_none());
    }
}

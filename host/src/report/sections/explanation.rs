//! An explanation: verdict, effects, the gap before and after, what each candidate explains, where
//! the disagreement sits.

use std::collections::BTreeSet;

use crate::explain::engine::residual_map::Map;
use crate::explain::engine::unknown::Unknown;
use crate::explain::gap::AtHorizon;
use crate::explain::presentation::letters;
use crate::explain::{Explanation, Found, Ranked};
use crate::report::figures::Figure;
use crate::report::figures::axis::Axis;
use crate::report::figures::panel::{Layout, Panel, Rule, Series, Shape};
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{Z95, percent, plus_minus, significant};
use crate::wording::names;

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "explanation", title: "What the answer rests on", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for e in results.all::<Explanation>() {
        one(&mut body, e);
    }
    (body != Html::new()).then_some(body)
}

fn one(body: &mut Html, e: &Explanation) {
    body.paragraph(&format!("{}.", e.reason.to_string().trim_end_matches('.')));
    if !e.effects.is_empty() {
        effects(body, &e.effects);
    }
    horizons(body, e);
    forecasts(body, e);
    attractor(body, e);
    ranking(body, e);
    if let Some(u) = &e.unknown {
        unknown(body, u);
    }
    let equations: BTreeSet<usize> = e.maps.iter().map(|m| m.equation).collect();
    for equation in equations {
        let of = e.maps.iter().filter(|m| m.equation == equation);
        let panels: Vec<Panel> = of.map(|m| map(m, e.maps_before.iter().find(|b| b.of(m)))).collect();
        let layout = Layout { columns: 2, height: 150.0, ..Layout::default() };
        let is_changed = e.maps.iter().any(|m| m.equation == equation && e.maps_before.iter().any(|b| b.of(m)));
        // Where nothing was added there is one mean residual.
        let when = if is_changed { " before the first effect was added and after the last one" } else { "" };
        let caption = format!(
            "What is left of equation of motion {equation}: mean residual{when}, with the 95 % band that the sensors' noise alone gives."
        );
        body.figure(&Figure::draw(caption, &layout, &panels));
    }
}

/// The gap at each horizon, before and after where something was added or fitted again.
fn horizons(body: &mut Html, e: &Explanation) {
    let all = &e.gap.horizons;
    if all.is_empty() {
        return;
    }
    let head = |t: &str| (Html::text(t), Align::Right);
    let is_changed = all.iter().any(|h| h.numbers()[1] != h.numbers()[2]);
    let heads = if is_changed { &["horizon / s", "gap before", "gap after"][..] } else { &["horizon / s", "gap"] };
    let row = |h: &AtHorizon| h.numbers().iter().take(heads.len()).map(|x| Html::text(&significant(*x, 3))).collect();
    body.table(&heads.iter().map(|t| head(t)).collect::<Vec<_>>(), &all.iter().map(row).collect::<Vec<Vec<Html>>>());
}

/// What each candidate of the first step takes away.
fn ranking(body: &mut Html, e: &Explanation) {
    let first: Vec<&Ranked> = e.ranking.iter().filter(|r| r.step == 0 && r.gain > 0.0).take(8).collect();
    if first.is_empty() {
        return;
    }
    body.heading("What each candidate alone explains");
    body.paragraph("Share of what the model leaves on parts of the record that were not fitted, the model refitted with the candidate:");
    let bar = |r: &&Ranked| {
        let chance = if r.p_value < 1e-12 { "below 10⁻¹²".to_owned() } else { significant(r.p_value, 2) };
        (names::effect(&r.name), r.gain, format!("{} (by chance: {chance})", percent(r.gain, 2)))
    };
    body.bars(["candidate", "explains"], &first.iter().map(bar).collect::<Vec<_>>());
}

/// Errors of forecasts, a column for each horizon.
fn forecasts(body: &mut Html, e: &Explanation) {
    let Some(first) = e.gap.forecasts.first() else { return };
    body.paragraph(
        "The gap is over parts spread over the whole record. As another trial, models were fitted to the first 70 % alone and predict the last 30 %: \
         the rms error there, initial states fitted to each window. It is of other seconds, and so another number:",
    );
    let mut heads = vec![
        (Html::text("step"), Align::Right),
        (Html::text("model"), Align::Left),
        (Html::text("gap / noise floors"), Align::Right),
    ];
    heads.extend(e.gap.forecasts.iter().map(|f| {
        (
            Html::text(&format!(
                "over {} s / {}",
                significant(f.horizon_s, 4),
                if f.unit == "deg" { "°" } else { &f.unit }
            )),
            Align::Right,
        )
    }));
    let rows: Vec<Vec<Html>> = (0..first.steps.len())
        .map(|i| {
            let name = first.steps[i].told("+");
            let values = e.gap.forecasts.iter().filter_map(|f| f.steps.get(i)).map(|s| significant(s.value, 3));
            let gap = e.gap.steps.get(i).map_or_else(String::new, |s| significant(s.value, 3));
            [i.to_string(), name, gap].into_iter().chain(values).map(|t| Html::text(&t)).collect()
        })
        .collect();
    body.table(&heads, &rows);
}

/// Prediction horizon and section, before and after.
fn attractor(body: &mut Html, e: &Explanation) {
    if e.gap.attractor.is_empty() {
        return;
    }
    let head = |t: &str| (Html::text(t), Align::Right);
    let heads = [
        (Html::text("model"), Align::Left),
        head("predictions hold to 30° / s"),
        head("section distance"),
        head("probability by chance"),
    ];
    let number = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| significant(v, 3));
    let rows: Vec<Vec<Html>> = ["before", "after"]
        .iter()
        .zip(&e.gap.attractor)
        .map(|(name, a)| {
            let cells = [
                (*name).to_owned(),
                significant(a.prediction_horizon_s, 3),
                number(a.section_distance),
                number(a.section_p_value),
            ];
            cells.iter().map(|t| Html::text(t)).collect()
        })
        .collect();
    body.paragraph(
        "How long free predictions from held-out windows hold (median), and how far the record's Poincaré section is from those of records that the model itself makes (mean energy distance), with the probability that one of these is as far from the others:",
    );
    body.table(&heads, &rows);
}

/// Shape of what has no name.
fn unknown(body: &mut Html, u: &Unknown) {
    let label = format!("{} / {}", u.against, u.against_unit);
    let axis = if u.against_unit == "rad" { Axis::angle(label) } else { Axis::linear(label) };
    let kind = u.kind();
    let mut panel = Panel::new(format!("{kind} at {}", u.at), axis, Axis::linear(format!("{kind} / {}", u.unit)));
    let x: Vec<f64> = u.points.iter().map(|p| p[0]).collect();
    for (name, sign) in [("95 % band", -1.0), ("", 1.0)] {
        let edge = u.points.iter().map(|p| p[1] + sign * p[2]).collect();
        panel.series.push(Series::new(name, Shape::Line, x.clone(), edge).colour(1));
    }
    panel.series.push(Series::new(kind, Shape::BigDots, x, u.points.iter().map(|p| p[1]).collect()).colour(0));
    panel.rules.push(Rule { vertical: false, at: 0.0, label: String::new() });
    body.figure(&Figure::draw(
        format!(
            "What is left and has no name, drawn as the function that takes away most of it: a {kind} at {} against the {}. It takes away {} of the held-out residual.",
            u.at,
            u.against,
            percent(u.held_out_gain, 2)
        ),
        &Layout { columns: 1, height: 220.0, ..Layout::default() },
        &[panel],
    ));
}

fn effects(body: &mut Html, found: &[Found]) {
    let head = |t: &str, a| (Html::text(t), a);
    let heads = [
        head("effect", Align::Left),
        head("value ± 95 %", Align::Right),
        head("unit", Align::Left),
        head("parameters", Align::Left),
        head("adds", Align::Left),
        head("explains", Align::Right),
        head("not told apart from", Align::Left),
    ];
    let rows: Vec<Vec<Html>> = found
        .iter()
        .map(|f| {
            let parameters: Vec<String> =
                f.parameters.iter().map(|(k, v)| format!("{k} = {}", significant(*v, 3))).collect();
            [
                f.name(),
                plus_minus(f.value, Z95 * f.std_error),
                f.unit.clone(),
                parameters.join(", "),
                f.equation.clone(),
                percent(f.held_out_gain, 2),
                f.indistinguishable_from.join(", "),
            ]
            .iter()
            .map(|t| Html::text(t))
            .collect()
        })
        .collect();
    body.table(&heads, &rows);
    if let Some(words) = letters(found) {
        body.paragraph(&format!("{}.", names::capitalised(&words)));
    }
}

fn map(m: &Map, before: Option<&Map>) -> Panel {
    let x: Vec<f64> = m.bins.iter().map(|b| b[0]).collect();
    let label = format!("{} / {}", m.against, m.against_unit);
    let axis = if m.against.starts_with("angle") || m.against == "drive phase" {
        Axis::angle(label)
    } else {
        Axis::linear(label)
    };
    let mut panel =
        Panel::new(format!("equation {}", m.equation), axis, Axis::linear(format!("residual / {}", m.unit)));
    // A residual at a frequency is an rms: it has no lower side.
    let sides: &[(&str, f64)] =
        if m.against == "frequency" { &[("noise alone", 1.0)] } else { &[("noise alone", -1.0), ("", 1.0)] };
    for &(name, sign) in sides {
        let edge = m.bins.iter().map(|b| sign * b[2]).collect();
        panel.series.push(Series::new(name, Shape::Line, x.clone(), edge).colour(1));
    }
    if let Some(before) = before {
        let column = |i: usize| before.bins.iter().map(|b| b[i]).collect();
        panel.series.push(Series::new("before", Shape::BigDots, column(0), column(1)).colour(2));
    }
    let name = if before.is_some() { "after" } else { "mean residual" };
    panel.series.push(Series::new(name, Shape::BigDots, x, m.bins.iter().map(|b| b[1]).collect()).colour(0));
    panel.rules.push(Rule { vertical: false, at: 0.0, label: String::new() });
    panel
}

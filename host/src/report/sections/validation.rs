//! Whether the identified model moves as the measured system does: checks, horizons, sections,
//! invariants, orbits, frequencies.

use crate::identify::presentation::method_name;
use crate::phase_space::poincare_section::Section;
use crate::report::figures::axis::Axis;
use crate::report::figures::panel::{Panel, Series, Shape};
use crate::report::figures::scatter::scatter;
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::validate::horizon::Horizon;
use crate::validate::result::Labelled;
use crate::validate::{Bifurcation, Orbits, Pair, Validation, Verdict};
use crate::wording::format::{Z95, fixed, percent, plus_minus, significant};
use crate::wording::symbols::symbol_svg;

/// Registration.
pub const SECTION: SectionKind =
    SectionKind { id: "validation", title: "Does the model move as the system does", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    let several = results.all::<Validation>().count() > 1;
    for v in results.all::<Validation>() {
        if several {
            body.heading(&format!("The model by {}", method_name(&v.method)));
        }
        one(&mut body, v);
    }
    (body != Html::new()).then_some(body)
}

fn head(text: &str, align: Align) -> (Html, Align) {
    (Html::text(text), align)
}

fn one(body: &mut Html, v: &Validation) {
    let passed = if v.verdict == Verdict::Passed { "passed" } else { "failed" };
    body.paragraph(&format!(
        "Validation {passed}. Histories of a chaotic motion part, so the model made a record of its own ({} s, same sensors and drive), and both were put through the \
         same analyses.",
        significant(v.simulated_s, 4)
    ));
    let rows: Vec<Vec<Html>> = v
        .checks
        .iter()
        .map(|c| {
            [c.name, if c.passed { "passed" } else { "failed" }, &c.message].iter().map(|t| Html::marked(t)).collect()
        })
        .collect();
    body.table(&[head("check", Align::Left), head("", Align::Left), head("numbers", Align::Left)], &rows);
    horizons(body, v);
    sections(body, v);
    invariants(body, v);
    if let Some(o) = &v.orbits {
        orbits(body, o);
    }
    if let Some(b) = &v.bifurcation {
        bifurcation(body, b);
    }
}

/// Share of starts whose prediction still holds after a time.
fn survival(h: &Horizon, name: &str, colour: usize) -> Series {
    let mut sorted = h.seconds.clone();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len().max(1) as f64;
    let (mut x, mut y) = (vec![0.0], vec![100.0]);
    for (i, s) in sorted.iter().enumerate() {
        x.extend([*s, *s]);
        y.extend([100.0 * (n - i as f64) / n, 100.0 * (n - i as f64 - 1.0) / n]);
    }
    Series::new(name, Shape::Line, x, y).colour(colour)
}

fn horizons(body: &mut Html, v: &Validation) {
    let h = &v.horizon;
    let mut panel = Panel::new("", Axis::linear("time / s"), Axis::linear("still within / %").range(0.0, 100.0));
    panel.series.push(survival(&h.measured, "record", 0));
    panel.series.push(survival(&h.simulated, "model's own", 1));
    body.figure(&scatter(
        &format!(
            "Predictions within {} after a time: {} starts on the record, {} on the model's own; initial states fitted over {} s each.",
            h.within,
            h.measured.seconds.len(),
            h.simulated.seconds.len(),
            significant(h.fit_s, 3)
        ),
        1,
        200.0,
        &[panel],
    ));
    let row = |name: &str, of: &Horizon, times: Option<f64>| -> Vec<Html> {
        let mut cells = vec![Html::text(name)];
        cells.extend(of.quantiles_s.iter().map(|q| Html::text(&significant(*q, 3))));
        cells.push(Html::text(&times.map_or_else(|| "–".to_owned(), |t| fixed(t, 2))));
        cells.push(Html::text(&of.unended.to_string()));
        cells
    };
    let heads: Vec<(Html, Align)> = [
        "",
        "10 % by / s",
        "25 % by / s",
        "median / s",
        "75 % by / s",
        "90 % by / s",
        "median in Lyapunov times",
        "to the record's end",
    ]
    .iter()
    .enumerate()
    .map(|(i, t)| head(t, if i == 0 { Align::Left } else { Align::Right }))
    .collect();
    let times = h.median_lyapunov_times;
    body.table(
        &heads,
        &[row("record", &h.measured, times.map(|t| t[0])), row("model's own", &h.simulated, times.map(|t| t[1]))],
    );
}

fn sections(body: &mut Html, v: &Validation) {
    let Some(s) = v.sections.first() else { return };
    let mut panels = Vec::new();
    for (c, name) in s.names.iter().enumerate() {
        let symbol = symbol_svg(name);
        for (title, of, colour) in [("record", &s.measured, 0), ("model's own", &s.simulated, 1)] {
            let (x, unit) = (axis(&s.of[c]), &s.of[c].unit);
            let y = Axis::linear(format!("d{symbol}/dt / ({unit}/s)")).range(-reach(s, c), reach(s, c));
            let mut panel = Panel::new(title, x, y);
            let list = |x: &[Vec<f32>]| x.get(c).map_or(Vec::new(), |x| x.iter().map(|v| f64::from(*v)).collect());
            panel.series.push(Series::new("", Shape::Dots, list(&of.value), list(&of.velocity)).colour(colour));
            panels.push(panel);
        }
    }
    body.figure(&scatter("Poincaré sections at τ = 0, measured and simulated.", 2, 220.0, &panels));
    let rows: Vec<Vec<Html>> = v
        .sections
        .iter()
        .filter_map(|s| {
            let t = s.test?;
            let cells = [
                fixed(s.tau, 3),
                significant(t.distance, 2),
                significant(t.p_value, 2),
                t.block.to_string(),
                t.permutations.to_string(),
            ];
            Some(cells.iter().map(|c| Html::text(c)).collect())
        })
        .collect();
    if !rows.is_empty() {
        let heads: Vec<(Html, Align)> =
            ["τ / rad", "mean energy distance", "probability by chance", "points", "records of the model"]
                .iter()
                .map(|t| head(t, Align::Right))
                .collect();
        body.table(&heads, &rows);
    }
}

/// The axis of a coordinate in its own unit; of angles that turn, wrapped.
fn axis(c: &Labelled) -> Axis {
    let label = format!("{} / {}", symbol_svg(&c.name), c.unit);
    if c.turns { Axis::angle(label) } else { Axis::linear(label) }
}

/// The largest velocity of a coordinate in both sections: both panels get one scale.
fn reach(s: &crate::validate::sections::SectionComparison, c: usize) -> f64 {
    let of = |x: &Section| x.velocity.get(c).map_or(0.0, |v| v.iter().fold(0.0_f64, |m, x| m.max(f64::from(x.abs()))));
    let greatest = of(&s.measured).max(of(&s.simulated));
    if greatest > 0.0 { 1.05 * greatest } else { 1.0 }
}

fn invariants(body: &mut Html, v: &Validation) {
    let mut rows: Vec<Vec<Html>> = Vec::new();
    let cells = |p: &Pair| {
        [plus_minus(p.measured, Z95 * p.measured_std_error), plus_minus(p.simulated, Z95 * p.simulated_std_error)]
    };
    let mut row = |name: &str, [measured, simulated]: [String; 2], model: String| {
        rows.push([name.to_owned(), measured, simulated, model].iter().map(|t| Html::text(t)).collect());
    };
    let none = || "–".to_owned();
    if let Some(l) = &v.lyapunov {
        let found = l.records.as_ref().map_or_else(|| [none(), none()], cells);
        row("largest exponent / (1/s)", found, plus_minus(l.model, Z95 * l.model_std_error));
    }
    if let Some(p) = &v.correlation_dimension {
        row("correlation dimension", cells(p), none());
    }
    if let Some(f) = &v.natural_frequencies {
        for i in 0..2 {
            let measured = f.measured_hz.map_or_else(none, |m| significant(m[i], 4));
            row(&format!("natural frequency {} / Hz", i + 1), [measured, none()], significant(f.model_hz[i], 4));
        }
    }
    if !rows.is_empty() {
        let heads = [
            head("", Align::Left),
            head("record", Align::Right),
            head("model's own record", Align::Right),
            head("model's equations", Align::Right),
        ];
        body.table(&heads, &rows);
    }
}

fn orbits(body: &mut Html, o: &Orbits) {
    let periods = o.measured.len().max(o.simulated.len());
    let mut panel =
        Panel::new("", Axis::linear("period / drive periods").range(0.0, periods as f64 + 1.0), Axis::linear("orbits"));
    let at = |shift: f64| (1..=periods).map(|k| k as f64 + shift).collect::<Vec<f64>>();
    let counts = |x: &[usize]| x.iter().map(|n| *n as f64).collect::<Vec<f64>>();
    panel.series.push(Series::new("record", Shape::BigDots, at(-0.1), counts(&o.measured)).colour(0));
    panel.series.push(Series::new("model's own", Shape::BigDots, at(0.1), counts(&o.simulated)).colour(1));
    body.figure(&scatter(
        &format!("Distinct unstable periodic orbits by period, at a tolerance of {}.", percent(o.tolerance, 1)),
        1,
        170.0,
        &[panel],
    ));
    let rows: Vec<Vec<Html>> = o
        .refined
        .iter()
        .map(|r| {
            let (turns, moved, multiplier) = r.refined.as_ref().map_or_else(
                || ("none near".to_owned(), "–".to_owned(), "–".to_owned()),
                |f| {
                    let turns: Vec<String> =
                        f.turns.iter().map(|t| t.map_or_else(|| "–".to_owned(), |t| fixed(t as f64, 0))).collect();
                    let largest = f.multipliers.first().map_or(0.0, |m| m[0].hypot(m[1]));
                    (turns.join(", "), significant(f.moved, 2), significant(largest, 3))
                },
            );
            [r.period.to_string(), significant(r.start_s, 4), percent(r.closing, 2), turns, moved, multiplier]
                .iter()
                .map(|t| Html::text(t))
                .collect()
        })
        .collect();
    if !rows.is_empty() {
        body.paragraph("The record's best closing orbits, made exactly periodic on the model:");
        let heads = [
            head("period", Align::Right),
            head("in the record at / s", Align::Right),
            head("closing error", Align::Right),
            head("turns", Align::Right),
            head(&if o.unit == "1" { "moved".to_owned() } else { format!("moved / {}", o.unit) }, Align::Right),
            head("largest multiplier", Align::Right),
        ];
        body.table(&heads, &rows);
    }
}

fn bifurcation(body: &mut Html, b: &Bifurcation) {
    let panels: Vec<Panel> = (0..b.of.len())
        .map(|k| {
            let factor = format!("factor on {}", if b.parameter == "drive" { "the drive" } else { &b.parameter });
            let mut panel = Panel::new("", Axis::linear(factor), axis(&b.of[k]));
            let points = b.factor.iter().zip(&b.columns).flat_map(|(f, c)| c.iter().map(move |p| (*f, p[k])));
            let (x, y) = points.unzip();
            panel.series.push(Series::new("", Shape::Dots, x, y).colour(k));
            panel
        })
        .collect();
    body.figure(&scatter(
        "Bifurcation diagram of the model: its section at one phase of the drive.",
        1,
        240.0,
        &panels,
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagram_has_a_panel_for_each_coordinate_in_its_own_unit() {
        let of = |name: &str, unit: &str| Labelled {
            name: name.to_owned(),
            unit: unit.to_owned(),
            is_angle: unit == "rad",
            turns: unit == "rad",
        };
        let drawn = |of: Vec<Labelled>, point: Vec<f64>| {
            let mut body = Html::new();
            let (parameter, factor, columns) = ("k".to_owned(), vec![0.9, 1.1], vec![vec![point]; 2]);
            bifurcation(&mut body, &Bifurcation { parameter, factor, columns, of });
            body.0
        };
        let length = drawn(vec![of("x", "m")], vec![0.01, 0.2]);
        assert!(length.contains("/ m<") && !length.contains("rad"), "{length}");
        let both = drawn(vec![of("x", "m"), of("phi", "rad")], vec![0.01, 0.5, 0.2, 0.1]);
        assert!(both.contains("/ m<") && both.contains("/ rad<"), "{both}");
    }
}

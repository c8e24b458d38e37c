//! Reduced-order model: energies, modes, releases, frequency against energy, shapes and time
//! histories.

use crate::reduce::forced::ResponsePoint;
use crate::reduce::{AmplitudePoint, Forced, Reduction};
use crate::report::figures::axis::Axis;
use crate::report::figures::bars::{Bar, bars, dots};
use crate::report::figures::canvas::{Panel, Series, Shape};
use crate::report::figures::lines::lines;
use crate::report::figures::scatter::scatter;
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{fixed, percent, significant};

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "reduction", title: "Reduced-order model", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for r in results.all::<Reduction>() {
        energies(&mut body, r);
        for w in r.warnings.iter().filter(|w| w.id.ends_with("channel")) {
            body.paragraph(&format!("{}. {}.", w.text, w.advice));
        }
        modes(&mut body, r);
        releases(&mut body, r);
        curve(&mut body, r);
        amplitudes(&mut body, r);
        forced(&mut body, r);
        motion(&mut body, r);
    }
    (body != Html::new()).then_some(body)
}

fn energies(body: &mut Html, r: &Reduction) {
    let some: Vec<Bar> = r
        .energy
        .iter()
        .take(16)
        .enumerate()
        .filter(|(_, e)| **e > 1e-12)
        .map(|(k, e)| Bar { name: (k + 1).to_string(), value: 100.0 * e, low: 100.0 * e, high: 100.0 * e })
        .collect();
    let circle = if r.modes_imaginary.is_some() { " of z = exp(iφ), which whirling does not bias" } else { "" };
    let caption = format!(
        "Energy of the proper orthogonal modes{circle}: {} of {} hold {}.",
        r.kept,
        r.coordinates.len(),
        percent(r.energy.iter().take(r.kept).sum(), 5)
    );
    let spread = r.energy.iter().copied().filter(|e| *e > 1e-12).fold(1.0, f64::min) < 0.02;
    body.figure(&if spread {
        dots(&caption, Axis::log("energy / %"), &some)
    } else {
        bars(&caption, Axis::linear("energy / %"), &some)
    });
}

fn modes(body: &mut Html, r: &Reduction) {
    let shown = r.kept.clamp(2, 4).min(r.modes.len());
    if r.coordinates.len() > 8 {
        let x: Vec<f64> = (1..=r.coordinates.len()).map(|i| i as f64).collect();
        let mut panel = Panel::new("", Axis::linear("coordinate"), Axis::linear("entry of the mode"));
        for k in 0..shown {
            let name = format!("mode {}, {}", k + 1, percent(r.energy[k], 3));
            panel.series.push(Series::new(name, Shape::Line, x.clone(), r.modes[k].clone()));
        }
        body.figure(&lines("Modes.", 200.0, &[panel]));
        return;
    }
    let mut columns = vec![(Html::text("mode"), Align::Left), (Html::text("energy"), Align::Right)];
    columns.extend(r.coordinates.iter().map(|c| (Html::symbol(c), Align::Right)));
    let rows: Vec<Vec<Html>> = (0..shown)
        .map(|k| {
            let mut row = vec![Html::text(&(k + 1).to_string()), Html::text(&percent(r.energy[k], 4))];
            row.extend(r.modes[k].iter().enumerate().map(|(c, re)| match &r.modes_imaginary {
                Some(im) => {
                    let sign = if im[k][c] < 0.0 { "−" } else { "+" };
                    Html::text(&format!("{} {sign} {} i", fixed(*re, 4), fixed(im[k][c].abs(), 4)))
                }
                None => Html::text(&fixed(*re, 4)),
            }));
            row
        })
        .collect();
    body.table(&columns, &rows);
}

fn releases(body: &mut Html, r: &Reduction) {
    if r.releases.is_empty() || r.model.is_none() {
        return;
    }
    let head = |t: &str, a| (Html::text(t), a);
    let columns = [
        head("release", Align::Left),
        head("amplitude", Align::Right),
        head("frequency", Align::Right),
        head("residual", Align::Right),
        head("even harmonics", Align::Right),
        head("Floquet", Align::Right),
        head("ten periods", Align::Right),
        head("", Align::Left),
    ];
    let rows: Vec<Vec<Html>> = r
        .releases
        .iter()
        .enumerate()
        .take(40)
        .map(|(i, x)| {
            let history = r.error.time_history.get(i).copied().flatten();
            let mut note = x.remarks.join(", ");
            if !x.used {
                note.push_str(if note.is_empty() { "not used" } else { "; not used" });
            }
            vec![
                Html::text(&(i + 1).to_string()),
                Html::text(&significant(x.amplitude, 5)),
                Html::text(&format!("{} Hz", significant(x.frequency_hz, 7))),
                Html::text(&percent(x.residual, 2)),
                Html::text(&percent(x.even_harmonics, 2)),
                Html::text(&x.floquet.map_or_else(String::new, |f| fixed(f, 3))),
                Html::text(&history.map_or_else(String::new, |e| percent(e, 2))),
                Html::text(&note),
            ]
        })
        .collect();
    body.table(&columns, &rows);
    body.paragraph(
        "Residual: what harmonics of one frequency leave. Ten periods: relative error of all coordinates of the model, \
         started at the release's amplitude and phase.",
    );
    let mut facts = vec![("constraint", format!("{:?}", r.constraint).to_lowercase())];
    if let Some(e) = r.error.frequency {
        facts.push(("greatest error of frequency", percent(e, 2)));
    }
    if let Some(e) = r.error.left_out {
        facts.push(("at a release left out", percent(e, 2)));
    }
    if let Some([low, high]) = r.error.range {
        facts.push(("to be used at amplitudes", format!("{} to {}", significant(low, 4), significant(high, 4))));
    }
    body.facts(&facts);
}

fn curve(body: &mut Html, r: &Reduction) {
    let f = &r.frequency_energy;
    if f.full.is_empty() {
        return;
    }
    let split = |v: &[[f64; 2]]| -> (Vec<f64>, Vec<f64>) { v.iter().map(|p| (p[0], p[1])).unzip() };
    let label = format!("energy / {}", f.energy_unit);
    let mut panel = Panel::new(
        "",
        Axis::log(if f.source == "shooting" { "energy".to_owned() } else { label }),
        Axis::linear("frequency / Hz"),
    );
    let (x, y) = split(&f.full);
    if f.source == "shooting" {
        panel.series.push(Series::new("full system, by shooting", Shape::Line, x, y).colour(5));
    } else {
        panel.series.push(Series::new("releases", Shape::BigDots, x, y).colour(1));
    }
    let (x, y) = split(&f.reduced);
    panel.series.push(
        Series::new("reduced model", if f.source == "shooting" { Shape::BigDots } else { Shape::Line }, x, y).colour(0),
    );
    let marked: (Vec<f64>, Vec<f64>) =
        r.releases.iter().filter(|x| x.used).filter_map(|x| x.energy.map(|e| (e, x.frequency_hz))).unzip();
    if f.source == "shooting" {
        panel.series.push(Series::new("releases", Shape::BigDots, marked.0, marked.1).colour(1));
    }
    let caption = if f.source == "shooting" {
        "Frequency against energy: the full system's nonlinear normal mode, computed apart by shooting with continuation, and the reduced model."
    } else {
        "Frequency against energy: the releases and the reduced model, whose energy is the integral of ω dI."
    };
    body.figure(&lines(caption, 240.0, &[panel]));
}

fn amplitudes(body: &mut Html, r: &Reduction) {
    let curve = &r.frequency_amplitude;
    if curve.is_empty() {
        return;
    }
    let mut panel = Panel::new("", Axis::linear("amplitude"), Axis::linear("frequency / Hz"));
    let x: Vec<f64> = curve.iter().map(|p| p.amplitude).collect();
    panel.series.push(
        Series::new("reduced model", Shape::Line, x.clone(), curve.iter().map(|p| p.frequency_hz).collect()).colour(0),
    );
    let (at, y) = r.releases.iter().filter(|x| x.used).map(|x| (x.amplitude, x.frequency_hz)).unzip();
    panel.series.push(Series::new("releases", Shape::BigDots, at, y).colour(1));
    panel.shares_x = true;
    // Beside the curve the interval would be thinner than its line.
    let mut width = Panel::new("", Axis::linear("amplitude"), Axis::log("interval / %"));
    let of = |error: fn(&AmplitudePoint) -> f64| -> Vec<f64> {
        curve.iter().map(|p| 196.0 * error(p) / p.frequency_hz).collect()
    };
    width.series.push(Series::new("at an amplitude", Shape::Line, x.clone(), of(|p| p.std_error_hz)).colour(2));
    width.series.push(Series::new("at an energy", Shape::Line, x, of(|p| p.std_error_at_energy_hz)).colour(3));
    body.figure(&lines(
        "Frequency against amplitude (first harmonic of the major coordinate), and half the width of its 95 % interval: what noise leaves uncertain. What \
         the model's form costs is told by the releases left out.",
        200.0,
        &[panel, width],
    ));
}

/// The response with what is unstable apart, on its backbone.
fn response_panel(f: &Forced) -> Panel {
    let mut panel = Panel::new("", Axis::linear("frequency of the force / Hz"), Axis::linear("amplitude"));
    let (x, y) = f.backbone.iter().map(|p| (p[0], p[1])).unzip();
    panel.series.push(Series::new("backbone", Shape::Thin, x, y).colour(5));
    for (stable, name, shape, colour) in [(true, "stable", Shape::Line, 0), (false, "unstable", Shape::Dots, 1)] {
        // A point that is not finite breaks a line.
        let of = |value: fn(&ResponsePoint) -> f64| -> Vec<f64> {
            f.curve.iter().map(|p| if p.stable == stable { value(p) } else { f64::NAN }).collect()
        };
        panel.series.push(Series::new(name, shape, of(|p| p.frequency_hz), of(|p| p.amplitude)).colour(colour));
    }
    let (x, y) = f.folds.iter().map(|p| (p.frequency_hz, p.amplitude)).unzip();
    panel.series.push(Series::new("folds", Shape::BigDots, x, y).colour(3));
    panel
}

fn forced(body: &mut Html, r: &Reduction) {
    let Some(f) = &r.forced else { return };
    let number = |x: f64| significant(x, 5);
    let mut facts = vec![
        ("force", number(f.amplitude)),
        (
            "damping",
            match f.damping_found {
                Some(d) => format!("{} ± {} 1/s, from the decays", number(d.value), significant(d.std_error, 2)),
                None => format!("{} 1/s, as given", number(f.damping)),
            },
        ),
    ];
    let place = |p: &ResponsePoint| format!("{} Hz, amplitude {}", significant(p.frequency_hz, 7), number(p.amplitude));
    facts.extend(f.peak.iter().map(|p| ("peak", place(p))));
    facts.extend(f.folds.iter().map(|p| ("fold", place(p))));
    body.facts(&facts);
    body.figure(&lines(
        "Forced and damped response of the reduced model, in closed form: between its folds the motion in the middle is unstable.",
        260.0,
        &[response_panel(f)],
    ));
}

fn motion(body: &mut Html, r: &Reduction) {
    if r.plots.histories.is_empty() {
        return;
    }
    // The first, the middle and the last release.
    let n = r.plots.histories.len();
    let mut pick = vec![0, n / 2, n - 1];
    pick.dedup();
    let mut panels = Vec::new();
    for (p, &i) in pick.iter().enumerate() {
        let [t, measured, model] = &r.plots.histories[i];
        let mut panel =
            Panel::new(format!("release {}", i + 1), Axis::linear("t / s"), Axis::linear("major coordinate"));
        panel.series.push(Series::new("measured", Shape::Line, t.clone(), measured.clone()).colour(5));
        panel.series.push(Series::new("reduced model", Shape::Thin, t.clone(), model.clone()).colour(1));
        panel.shares_x = false;
        let _ = p;
        panels.push(panel);
    }
    body.figure(&lines("Time histories over three periods.", 120.0, &panels));
    if r.plots.shapes.iter().any(|s| !s[1].is_empty()) {
        let panels: Vec<Panel> = pick
            .iter()
            .map(|&i| {
                let [a, b, c, d] = &r.plots.shapes[i];
                let mut panel = Panel::new(
                    format!("release {}", i + 1),
                    Axis::linear("major coordinate"),
                    Axis::linear("minor coordinate"),
                );
                panel.series.push(Series::new("measured", Shape::Line, a.clone(), b.clone()).colour(5));
                panel.series.push(Series::new("reduced model", Shape::Dots, c.clone(), d.clone()).colour(1));
                panel
            })
            .collect();
        body.figure(&scatter("Shapes of the mode: second coordinate against the first.", 3, 220.0, &panels));
    }
}

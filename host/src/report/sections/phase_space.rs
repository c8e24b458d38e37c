//! Phase space: delays, dimensions, sections, exponent, correlation dimension, catalogue of orbits.

use crate::inspect::Inspection;
use crate::inspect::motion::Space;
use crate::phase_space::survey::{Lyapunov, PhaseSpace};
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Rule, Series, Shape};
use crate::report::figures::lines::lines;
use crate::report::figures::scatter::scatter;
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{Z95, fixed, instant, plus_minus, significant};
use crate::wording::symbols::{symbol_plain, symbol_svg};

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "phase-space", title: "Phase space", render };

/// Most rows of the catalogue that are printed.
const ROWS: usize = 40;

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    let several = results.all::<Inspection>().count() > 1;
    for inspection in results.all::<Inspection>() {
        let space = &inspection.phase_space;
        if space.coordinates.is_empty() {
            continue;
        }
        if several {
            body.heading(&inspection.record.file);
        }
        facts(&mut body, space);
        delays(&mut body, space);
        sections(&mut body, inspection);
        if let Some(l) = &space.lyapunov {
            exponent(&mut body, space, l);
        }
        correlation(&mut body, space);
        catalogue(&mut body, space);
        free_catalogue(&mut body, space);
    }
    (body != Html::new()).then_some(body)
}

fn facts(body: &mut Html, space: &PhaseSpace) {
    let mut facts = vec![("Delay T_d", format!("{} samples", space.delay))];
    if let Some(d) = space.dimension {
        facts.push(("Embedding dimension", d.to_string()));
    }
    if space.dies_away {
        facts.push(("Largest Lyapunov exponent", "none: the motion dies away".to_owned()));
    }
    if let Some(l) = &space.lyapunov {
        facts.push(("Largest Lyapunov exponent", format!("{} /s", plus_minus(l.per_second, Z95 * l.std_error))));
        if let (Some(v), Some(e)) = (l.per_period, l.per_period_std_error) {
            facts.push(("The same a drive period", plus_minus(v, Z95 * e)));
        }
    }
    if let Some((d, e)) = space.correlation_dimension.as_ref().and_then(|d| Some((d.dimension?, d.std_error))) {
        facts.push(("Correlation dimension", plus_minus(d, Z95 * e)));
    }
    if let Some(o) = &space.orbits {
        facts.push(("Distinct periodic orbits", o.orbits.len().to_string()));
        facts.push(("Motion that they cover", format!("{} %", fixed(100.0 * o.coverage, 1))));
    }
    body.facts(&facts);
}

fn delays(body: &mut Html, space: &PhaseSpace) {
    let mut information = Panel::new("", Axis::linear("lag / samples"), Axis::linear("I / bit"));
    let mut neighbours = Panel::new("", Axis::linear("dimension"), Axis::linear("false neighbours / %"));
    let mut cao = Panel::new("", Axis::linear("dimension"), Axis::linear("E1 (Cao)").range(0.0, 1.1));
    for (i, c) in space.coordinates.iter().enumerate() {
        let count = |n: usize| (1..=n).map(|k| k as f64).collect::<Vec<f64>>();
        let name = symbol_svg(&c.name);
        let bits = &c.mutual_information.bits;
        information.series.push(Series::new(name.clone(), Shape::Line, count(bits.len()), bits.clone()).colour(i));
        information.rules.push(Rule { vertical: true, at: c.delay as f64, label: format!("{name}: {}", c.delay) });
        let f = &c.false_neighbours;
        let percent = f.share.iter().map(|s| 100.0 * s).collect();
        neighbours.series.push(Series::new(name.clone(), Shape::Line, count(f.share.len()), percent).colour(i));
        cao.series.push(Series::new(name, Shape::Line, count(f.e1.len()), f.e1.clone()).colour(i));
    }
    body.figure(&lines(
        &format!(
            "Average mutual information, {} bins, {} samples; the lines mark each coordinate's delay: the first minimum \
             that is not weak.",
            space.settings.bins, space.samples
        ),
        170.0,
        &[information],
    ));
    let vectors = space.coordinates.iter().map(|c| c.false_neighbours.vectors).max().unwrap_or(0);
    body.figure(&scatter(
        &format!(
            "False nearest neighbours and Cao's E1 on the circle: {vectors} delay vectors, Theiler window {} samples, counts \
             dithered by less than one.",
            space.theiler
        ),
        2,
        190.0,
        &[neighbours, cao],
    ));
    let rows: Vec<Vec<Html>> = space
        .coordinates
        .iter()
        .map(|c| {
            let dimension = |d: Option<usize>| Html::text(&d.map_or_else(|| "–".to_owned(), |d| d.to_string()));
            let minima: Vec<String> =
                c.minima.iter().take(8).map(|m| format!("{} ({} %)", m.lag, fixed(100.0 * m.depth, 1))).collect();
            let open = if c.weak { " (no minimum is clear)" } else { "" };
            vec![
                Html::symbol(&c.name),
                Html::text(&format!("{}{open}", c.delay)),
                dimension(c.dimension),
                dimension(c.cao_dimension),
                Html::text(&minima.join(", ")),
            ]
        })
        .collect();
    let columns = [
        (Html::text("coordinate"), Align::Left),
        (Html::text("delay / samples"), Align::Right),
        (Html::text("dimension, false neighbours"), Align::Right),
        (Html::text("dimension, Cao"), Align::Right),
        (Html::text("minima of I: lag (depth)"), Align::Left),
    ];
    body.table(&columns, &rows);
}

fn sections(body: &mut Html, inspection: &Inspection) {
    let space = &inspection.phase_space;
    let wide = |v: &[f32]| v.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    for (i, c) in space.coordinates.iter().enumerate() {
        let Some(of) = inspection.coordinates.iter().find(|k| k.name == c.name) else { continue };
        let symbol = symbol_svg(&c.name);
        let turns = of.greatest > std::f64::consts::PI || of.least < -std::f64::consts::PI;
        let panels: Vec<Panel> = space
            .sections
            .iter()
            .zip(["τ = 0", "τ = π/2", "τ = π", "τ = 3π/2"])
            .filter(|(s, _)| s.value.get(i).is_some_and(|v| !v.is_empty()))
            .map(|(s, name)| {
                let x = match of.space {
                    Space::S1 if turns => Axis::angle(format!("{symbol} / rad")),
                    _ => Axis::linear(format!("{symbol} / {}", of.unit)),
                };
                let mut panel = Panel::new(name, x, Axis::linear(format!("d{symbol}/dt / ({}/s)", of.unit)));
                panel.series.push(Series::new("", Shape::Dots, wide(&s.value[i]), wide(&s.velocity[i])).colour(i));
                panel
            })
            .collect();
        if !panels.is_empty() {
            body.figure(&scatter(
                &format!(
                    "Poincaré sections of {symbol} at four phases τ mod 2π of the drive, one point a drive period each."
                ),
                2,
                190.0,
                &panels,
            ));
        }
    }
}

fn exponent(body: &mut Html, space: &PhaseSpace, l: &Lyapunov) {
    let rate = space.sample_rate_hz;
    let curve = &l.divergence.curve;
    let time: Vec<f64> = (0..curve.len()).map(|k| k as f64 / rate).collect();
    let mut panel = Panel::new("", Axis::linear("time / s"), Axis::linear("⟨ln distance⟩"));
    panel.series.push(Series::new("divergence of neighbours", Shape::Line, time, curve.clone()));
    let line = |slope: f64, from: usize, to: usize, at: f64| {
        let x = [from, to].map(|k| k as f64 / rate).to_vec();
        (x, [from, to].map(|k| at + slope * (k as f64 - from as f64)).to_vec())
    };
    let mut caption = format!(
        "Divergence of nearest neighbours ({} pairs). The exponent is from the tangent maps of {} steps of {} s along the record: {} /s.",
        l.divergence.pairs,
        l.tangent.steps,
        significant(l.step_s, 3),
        plus_minus(l.per_second, Z95 * l.std_error)
    );
    if let (Some(f), Some(v), Some(e)) = (l.fit, l.divergence_per_second, l.divergence_std_error) {
        let at = f.at_zero + f.slope * f.from as f64;
        let (x, y) = line(f.slope, f.from, f.to, at);
        panel.series.push(Series::new("its straight part", Shape::Line, x, y));
        let (x, y) = line(l.tangent.exponent, f.from, f.to, at);
        panel.series.push(Series::new("slope of the tangent maps", Shape::Line, x, y).colour(2));
        caption.push_str(&format!(
            " The curve's straight part has {} /s; it bends early where neighbours are far apart from the start, and then lies too low.",
            plus_minus(v, Z95 * e)
        ));
    }
    panel.rules.push(Rule { vertical: false, at: l.divergence.saturation, label: "unrelated".to_owned() });
    body.figure(&lines(&caption, 200.0, &[panel]));
}

fn correlation(body: &mut Html, space: &PhaseSpace) {
    let Some(d) = space.correlation_dimension.as_ref().filter(|d| d.radius.len() > 2) else { return };
    let Some(value) = d.dimension else { return };
    let mut panel = Panel::new("", Axis::log("radius r / turns"), Axis::log("C(r)"));
    panel.series.push(Series::new("C(r)", Shape::Line, d.radius.clone(), d.sum.clone()));
    let at = |r: f64| d.radius.iter().zip(&d.sum).find(|(x, _)| **x >= r).map_or(f64::NAN, |(_, c)| *c);
    let middle = (d.fitted.0 * d.fitted.1).sqrt();
    let ends = [d.fitted.0, d.fitted.1];
    let y = ends.map(|r| at(middle) * (r / middle).powf(value));
    panel.series.push(Series::new("fit", Shape::Line, ends.to_vec(), y.to_vec()));
    body.figure(&lines(
        &format!(
            "Correlation sum of {} vectors of two delays of each coordinate and the drive's phase; slope {}. So many vectors \
             could show a dimension up to {}.",
            d.vectors,
            plus_minus(value, Z95 * d.std_error),
            fixed(d.most, 1)
        ),
        180.0,
        &[panel],
    ));
}

fn catalogue(body: &mut Html, space: &PhaseSpace) {
    let Some(o) = &space.orbits else { return };
    body.paragraph(&format!(
        "Unstable periodic orbits: stretches of up to {} drive periods that close to within {} % of the angles' range. {} such stretches are {} distinct orbits.{}",
        o.settings.longest,
        significant(100.0 * o.settings.tolerance, 2),
        o.recurrences,
        o.orbits.len(),
        if o.orbits.len() > ROWS { format!(" The first {ROWS} are listed.") } else { String::new() }
    ));
    if o.orbits.is_empty() {
        return;
    }
    let names: Vec<String> = space.coordinates.iter().map(|c| format!("turns of {}", symbol_plain(&c.name))).collect();
    let mut columns = vec![
        (Html::text("period"), Align::Right),
        (Html::text("from / s"), Align::Right),
        (Html::text("closing error / %"), Align::Right),
        (Html::text("seen"), Align::Right),
    ];
    columns.extend(names.iter().map(|n| (Html::text(n), Align::Right)));
    let rows: Vec<Vec<Html>> = o
        .orbits
        .iter()
        .take(ROWS)
        .map(|r| {
            let mut row = vec![
                Html::text(&r.period.to_string()),
                Html::text(&instant(r.start_s, 1.0 / space.sample_rate_hz)),
                Html::text(&fixed(100.0 * r.error, 2)),
                Html::text(&r.seen.to_string()),
            ];
            row.extend(
                r.turns
                    .iter()
                    .map(|t| Html::text(&t.map_or_else(|| "–".to_owned(), |t| t.to_string().replace('-', "−")))),
            );
            row
        })
        .collect();
    body.table(&columns, &rows);
}

fn free_catalogue(body: &mut Html, space: &PhaseSpace) {
    let Some(o) = &space.free_orbits else { return };
    body.paragraph(&format!(
        "Unstable periodic orbits of any period up to {} s by their returns, tolerance {} % of the span: {} closing stretches are {} distinct orbits.{}{}",
        significant(o.settings.longest as f64 / space.sample_rate_hz, 3),
        significant(100.0 * o.settings.tolerance, 2),
        o.recurrences,
        o.orbits.len(),
        if o.orbits.len() > ROWS { format!(" The first {ROWS} are listed.") } else { String::new() },
        if space.spreads() { "" } else { " The exponent is not shown to be positive: they may be returns of a motion without unstable orbits." }
    ));
    if o.orbits.is_empty() {
        return;
    }
    let columns = ["period / s", "from / s", "closing error / %", "seen"].map(|t| (Html::text(t), Align::Right));
    let rows: Vec<Vec<Html>> = o
        .orbits
        .iter()
        .take(ROWS)
        .map(|r| {
            vec![
                Html::text(&significant(r.period_s, 5)),
                Html::text(&instant(r.start_s, 1.0 / space.sample_rate_hz)),
                Html::text(&fixed(100.0 * r.error, 2)),
                Html::text(&r.seen.to_string()),
            ]
        })
        .collect();
    body.table(&columns, &rows);
}

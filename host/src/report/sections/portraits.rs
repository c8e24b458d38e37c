//! Phase portraits, angle on the circle against velocity, with the Poincaré section of a driven
//! record.

use crate::inspect::Inspection;
use crate::inspect::coordinate::Coordinate;
use crate::inspect::motion::Space;
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};
use crate::report::figures::scatter::scatter;
use crate::report::html::Html;
use crate::report::{Results, SectionKind};
use crate::wording::symbols::symbol_svg;

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "portraits", title: "Phase portraits", render };

/// What is drawn to the right.
fn drawn(coordinates: &[Coordinate]) -> &'static str {
    let is_angle = |c: &Coordinate| c.space == Space::S1;
    match (coordinates.iter().any(is_angle), coordinates.iter().all(is_angle)) {
        (_, true) => "Angle on the circle",
        (true, false) => "Each coordinate (angles on the circle)",
        (false, false) => "Each coordinate",
    }
}

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    let several = results.all::<Inspection>().count() > 1;
    for inspection in results.all::<Inspection>() {
        let wide = |v: &[f32]| v.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
        let mut driven = false;
        let panels: Vec<Panel> = inspection
            .plots
            .iter()
            .zip(&inspection.coordinates)
            .filter(|(p, _)| !p.portrait_x.is_empty())
            .enumerate()
            .map(|(i, (p, c))| {
                let symbol = symbol_svg(&c.name);
                let turns = c.greatest > std::f64::consts::PI || c.least < -std::f64::consts::PI;
                let x = match c.space {
                    Space::S1 if turns => Axis::angle(format!("{symbol} / rad")),
                    _ => Axis::linear(format!("{symbol} / {}", c.unit)),
                };
                let y = Axis::linear(format!("d{symbol}/dt / ({}/s)", c.unit));
                let mut panel = Panel::new("", x, y);
                // Chaos drawn as a line is a blot; a free motion drawn as dots is no orbit.
                let shape = if inspection.drive.is_some() { Shape::Dots } else { Shape::Thin };
                let orbit = wide(&p.portrait_x);
                panel.series.push(
                    Series::new(
                        if inspection.drive.is_some() { "orbit" } else { "" },
                        shape,
                        orbit,
                        wide(&p.portrait_v),
                    )
                    .colour(if inspection.drive.is_some() { 5 } else { i }),
                );
                if !p.section_x.is_empty() {
                    driven = true;
                    let section =
                        Series::new("at drive phase τ = 0", Shape::BigDots, wide(&p.section_x), wide(&p.section_v));
                    panel.series.push(section.colour(1));
                }
                panel
            })
            .collect();
        if panels.is_empty() {
            continue;
        }
        if several {
            body.heading(&inspection.record.file);
        }
        let section = if driven {
            " The larger dots are taken once a drive period, at τ mod 2π = 0 (Poincaré section)."
        } else {
            ""
        };
        let columns = panels.len().clamp(1, 3);
        body.figure(&scatter(
            &format!(
                "{} against velocity (slopes of cubics over {} samples).{section}",
                drawn(&inspection.coordinates),
                inspection.coordinates.iter().map(|c| 2 * c.slope_half_width + 1).max().unwrap_or(5)
            ),
            columns,
            if columns == 3 { 250.0 } else { 320.0 },
            &panels,
        ));
    }
    (body != Html::new()).then_some(body)
}

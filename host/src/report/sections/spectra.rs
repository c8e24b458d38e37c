//! Spectra of the velocities with their lines named, and the table of lines.

use crate::inspect::Inspection;
use crate::inspect::coordinate::{Coordinate, Spectrum};
use crate::inspect::motion::Space;
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Rule, Series, Shape};
use crate::report::figures::lines::lines;
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{fixed, significant, to_digits_of};
use crate::wording::symbols::symbol_svg;

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "spectra", title: "Spectra", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    let several = results.all::<Inspection>().count() > 1;
    for inspection in results.all::<Inspection>() {
        let moving: Vec<(usize, &Coordinate, &Spectrum)> = inspection
            .coordinates
            .iter()
            .enumerate()
            .filter_map(|(i, c)| c.spectrum.as_ref().map(|s| (i, c, s)))
            .collect();
        let Some((_, _, first)) = moving.first() else { continue };
        if several {
            body.heading(&inspection.record.file);
        }
        let drive = inspection.record.drive_hz;
        // What holds the motion; under a drive its first four harmonics at least, twelve at most
        // (the lines that quantisation makes of a locked orbit go on to half the sampling rate).
        // The same for all, so that they compare.
        let band = 2.0 * moving.iter().map(|m| m.2.band_hz).fold(0.0, f64::max);
        let top = drive.map_or(band, |f| band.clamp(4.2 * f, 12.0 * f)).min(0.5 * inspection.record.sample_rate_hz);
        let panels: Vec<Panel> =
            moving.iter().enumerate().map(|(n, (i, c, s))| panel(*i, c, s, top, drive, n + 1 < moving.len())).collect();
        body.figure(&lines(
            &format!(
                "One-sided power spectral density (Welch: {} pieces of {} samples, Hann, {} Hz a bin){}.",
                first.averages,
                first.piece,
                significant(first.bin_hz, 3),
                if moving.iter().any(|m| m.1.space == Space::S1) {
                    ", of velocities for angles, so that whirling leaves no ramp"
                } else {
                    ""
                }
            ),
            150.0,
            &panels,
        ));
        line_table(&mut body, &moving, drive.is_some());
    }
    (body != Html::new()).then_some(body)
}

fn panel(i: usize, c: &Coordinate, s: &Spectrum, top: f64, drive: Option<f64>, shares_x: bool) -> Panel {
    let (x, y): (Vec<f64>, Vec<f64>) = s
        .frequency_hz
        .iter()
        .zip(&s.density)
        // The removed mean empties the lowest bin.
        .filter(|(f, p)| f64::from(**f) >= 0.9 * s.bin_hz && f64::from(**f) <= top && **p > 0.0)
        .map(|(f, p)| (f64::from(*f), f64::from(*p)))
        .unzip();
    let symbol = symbol_svg(&c.name);
    let of = if s.of == "velocity" { format!("d{symbol}/dt") } else { symbol };
    // Units of a density: unit²/Hz; a long one is set in brackets.
    let mut panel =
        Panel::new("", Axis::linear("frequency / Hz").range(0.0, top), Axis::log(format!("{of} / ({})", s.unit)));
    panel.shares_x = shares_x;
    panel.series.push(Series::new("", Shape::Line, x, y).colour(i));
    if let Some(f) = drive {
        for (k, name) in [(0.5, "f_{e}/2"), (1.0, "f_{e}"), (2.0, "2f_{e}"), (3.0, "3f_{e}"), (4.0, "4f_{e}")] {
            if k * f < 0.97 * top {
                panel.rules.push(Rule { vertical: true, at: k * f, label: name.to_owned() });
            }
        }
    }
    panel
}

fn line_table(body: &mut Html, moving: &[(usize, &Coordinate, &Spectrum)], driven: bool) {
    let named = driven && moving.iter().any(|(_, _, s)| s.lines.iter().take(6).any(|l| l.name.is_some()));
    let mut rows = Vec::new();
    for (_, c, s) in moving {
        for l in s.lines.iter().take(6) {
            let unit = if s.of == "velocity" { format!("{}/s", c.unit) } else { c.unit.clone() };
            let name = crate::report::html::escape(l.name.as_deref().unwrap_or(""));
            let mut row = vec![
                Html::symbol(&c.name),
                Html::text(&format!("{} Hz", to_digits_of(l.frequency_hz, 0.1 * s.bin_hz))),
                Html::text(&format!("{} {unit}", significant(l.amplitude, 3))),
                Html::text(&format!("{} dB", fixed(10.0 * l.prominence.log10(), 1))),
            ];
            if named {
                row.push(Html(name.replace("f_e", "<i>f</i><sub>e</sub>")));
            }
            rows.push(row);
        }
    }
    if rows.is_empty() {
        body.paragraph("No line stands out of its surroundings.");
        return;
    }
    let head = |t: &str, a| (Html::text(t), a);
    let mut heads = vec![
        head("", Align::Left),
        head("line", Align::Right),
        head("amplitude", Align::Right),
        head("above surroundings", Align::Right),
    ];
    if named {
        heads.push(head("of the drive", Align::Left));
    }
    body.table(&heads, &rows);
}

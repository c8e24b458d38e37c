//! The record: rate, length, what each coordinate does, the drive, whether it repeats.

use crate::inspect::Inspection;
use crate::inspect::coordinate::Coordinate;
use crate::inspect::text::{drive, motion, range, speed};
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{count, duration, fixed, quantity, shortest, significant};

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "record", title: "Record", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for inspection in results.all::<Inspection>() {
        one(&mut body, inspection);
    }
    (body != Html::new()).then_some(body)
}

fn one(body: &mut Html, inspection: &Inspection) {
    let r = &inspection.record;
    body.heading(&r.file);
    let mut facts = vec![
        ("rig", r.rig.clone()),
        ("samples", count(r.samples)),
        ("lost", count(r.lost)),
        ("length", duration(r.duration_s)),
        ("sampling rate", format!("{} Hz", shortest(r.sample_rate_hz))),
        ("unbroken stretches", count(r.segments as u64)),
    ];
    if r.segments > 1 {
        facts.push(("longest stretch", duration(r.longest_segment as f64 / r.sample_rate_hz)));
        facts.push(("off the grid of ticks", duration(r.start_jitter_s)));
    }
    if let Some(jitter) = r.phase_jitter {
        facts.push(("jitter of the drive's phase", format!("{} samples", significant(jitter, 2))));
    }
    facts.push(("motion", motion(inspection)));
    if let Some(seen) = drive(inspection) {
        facts.push(("drive", seen));
    }
    if let Some(o) = &r.origin {
        facts.push(("recorded with", o.firmware.clone()));
        facts.push(("board", o.board.clone()));
        facts.push(("source", o.source.clone()));
        if let Some(at) = &o.started_at {
            facts.push(("started", at.clone()));
        }
    }
    body.facts(&facts.into_iter().filter(|f| !f.1.is_empty()).collect::<Vec<_>>());
    table(body, &inspection.coordinates);
}

/// One column for each coordinate.
fn table(body: &mut Html, coordinates: &[Coordinate]) {
    let column = |c: &Coordinate| c.channel.clone().unwrap_or_else(|| "derived".to_owned());
    type Cell<'a> = (&'a str, &'a dyn Fn(&Coordinate) -> Option<String>);
    let cells: [Cell; 11] = [
        ("column", &|c| Some(column(c))),
        ("range", &|c| Some(range(c))),
        ("rms speed", &|c| Some(speed(c.rms_speed, &c.unit, 4))),
        ("greatest speed", &|c| Some(speed(c.greatest_speed, &c.unit, 4))),
        ("net turns", &|c| c.turns.map(|t| fixed(t, 2))),
        ("net turns a drive period", &|c| c.turns_per_period.map(|t| fixed(t, 4))),
        ("time beyond ±90°", &|c| c.beyond_90.map(|b| format!("{} %", fixed(100.0 * b, 1)))),
        ("quantisation step q", &|c| (c.step > 0.0).then(|| quantity(c.step, &c.unit, 3))),
        ("noise of steps alone (q/√12; of a sum, of all its parts)", &|c| {
            (c.step > 0.0).then(|| quantity(c.quantisation_noise, &c.unit, 3))
        }),
        ("noise, estimated (white)", &|c| Some(quantity(c.noise, &c.unit, 3))),
        ("99 % of the power below", &|c| c.spectrum.as_ref().map(|s| quantity(s.band_hz, "Hz", 3))),
    ];
    let mut heads = vec![(Html::new(), Align::Left)];
    heads.extend(coordinates.iter().map(|c| (Html::symbol(&c.name), Align::Right)));
    let rows: Vec<Vec<Html>> = cells
        .iter()
        .filter(|(_, value)| coordinates.iter().any(|c| value(c).is_some()))
        .map(|(name, value)| {
            let values = coordinates.iter().map(|c| Html::text(&value(c).unwrap_or_else(|| "–".to_owned())));
            std::iter::once(Html::text(name)).chain(values).collect()
        })
        .collect();
    body.table(&heads, &rows);
}

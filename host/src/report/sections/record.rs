//! The record: rate, length, what each coordinate does, the drive, whether it repeats.

use crate::inspect::Inspection;
use crate::inspect::coordinate::Coordinate;
use crate::inspect::motion::Space;
use crate::inspect::periodicity::Kind;
use crate::report::format::{count, duration, fixed, quantity, shortest, significant, to_digits_of};
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};

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
    if let Some(d) = &inspection.drive {
        let found = d.phase_hz.or(d.line_hz).or(d.other_hz);
        let stated = shortest(d.stated_hz);
        let digits = |f| to_digits_of(f, if d.phase_hz.is_some() { 1e-5 } else { d.resolution_hz });
        let seen = match (d.agrees, found) {
            (Some(true), Some(f)) => format!("{stated} Hz stated, {} Hz in the record", digits(f)),
            (Some(false), Some(f)) => format!("{stated} Hz stated, but {} Hz in the record", digits(f)),
            _ => format!("{stated} Hz stated, no clear line in the record"),
        };
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

/// One line on the kind of motion.
pub fn motion(inspection: &Inspection) -> String {
    let p = &inspection.periodicity;
    match (p.kind, p.period) {
        (Kind::AtRest, _) => "at rest".to_owned(),
        (Kind::Free, _) => "free, no drive".to_owned(),
        (Kind::Periodic, Some(1)) => "repeats every drive period".to_owned(),
        (Kind::Periodic, k) => format!("repeats every {} drive periods", k.unwrap_or(0)),
        (Kind::LocksLater, _) => format!("locks after {}", duration(p.locked_after_s.unwrap_or(0.0))),
        (Kind::ChaoticOrTransient, _) => "chaotic or transient".to_owned(),
    }
}

/// One column for each coordinate.
fn table(body: &mut Html, coordinates: &[Coordinate]) {
    let turn = std::f64::consts::TAU;
    let range = |c: &Coordinate| {
        if c.space == Space::S1 && c.greatest - c.least > 20.0 {
            format!("{} … {} turns", significant(c.least / turn, 3), significant(c.greatest / turn, 3))
        } else {
            format!("{} … {} {}", significant(c.least, 4), significant(c.greatest, 4), c.unit)
        }
    };
    let column = |c: &Coordinate| c.channel.clone().unwrap_or_else(|| "derived".to_owned());
    type Cell<'a> = (&'a str, &'a dyn Fn(&Coordinate) -> Option<String>);
    let cells: [Cell; 11] = [
        ("column", &|c| Some(column(c))),
        ("range", &|c| Some(range(c))),
        ("rms speed", &|c| Some(format!("{} {}/s", significant(c.rms_speed, 4), c.unit))),
        ("greatest speed", &|c| Some(format!("{} {}/s", significant(c.greatest_speed, 4), c.unit))),
        ("net turns", &|c| c.turns.map(|t| fixed(t, 2))),
        ("net turns a drive period", &|c| c.turns_per_period.map(|t| fixed(t, 4))),
        ("time beyond ±90°", &|c| c.beyond_90.map(|b| format!("{} %", fixed(100.0 * b, 1)))),
        ("quantisation step q", &|c| (c.step > 0.0).then(|| quantity(c.step, &c.unit, 3))),
        ("q/√12", &|c| (c.step > 0.0).then(|| quantity(c.quantisation_noise, &c.unit, 3))),
        ("noise, estimated (white)", &|c| Some(quantity(c.noise, &c.unit, 3))),
        ("99.9 % of the power below", &|c| c.spectrum.as_ref().map(|s| quantity(s.band_hz, "Hz", 3))),
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

//! The record: rate, length, what each coordinate does, the drive, whether it repeats.

use crate::inspect::Inspection;
use crate::inspect::coordinate::Coordinate;
use crate::inspect::motion::Space;
use crate::inspect::periodicity::Kind;
use crate::report::format::{count, duration, percent, quantity, significant};
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
        ("sampling rate", format!("{} Hz", significant(r.sample_rate_hz, 7).trim_end_matches(".0000"))),
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
        let found = d.phase_hz.or(d.line_hz);
        let seen = match (d.agrees, found, d.other_hz) {
            (Some(true), Some(f), _) => {
                format!("{} Hz stated, {} Hz in the record", significant(d.stated_hz, 5), significant(f, 5))
            }
            (Some(false), Some(f), _) | (Some(false), None, Some(f)) => {
                format!("{} Hz stated, but {} Hz in the record", significant(d.stated_hz, 5), significant(f, 5))
            }
            _ => format!("{} Hz stated, no clear line in the record", significant(d.stated_hz, 5)),
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

fn table(body: &mut Html, coordinates: &[Coordinate]) {
    let heads = [
        ("", Align::Left),
        ("column", Align::Left),
        ("range", Align::Right),
        ("rms speed", Align::Right),
        ("net turns", Align::Right),
        ("turns a drive period", Align::Right),
        ("beyond ±90°", Align::Right),
        ("step q", Align::Right),
        ("q/√12", Align::Right),
        ("noise, estimated", Align::Right),
    ];
    let rows: Vec<Vec<Html>> = coordinates
        .iter()
        .map(|c| {
            let text = |s: String| Html::text(&s);
            let or_dash = |v: Option<String>| Html::text(&v.unwrap_or_else(|| "–".to_owned()));
            let range = if c.space == Space::S1 && c.greatest - c.least > 20.0 {
                let turn = std::f64::consts::TAU;
                format!("{} … {} turns", significant(c.least / turn, 3), significant(c.greatest / turn, 3))
            } else {
                format!("{} … {} {}", significant(c.least, 4), significant(c.greatest, 4), c.unit)
            };
            vec![
                Html::symbol(&c.name),
                match &c.channel {
                    Some(name) => Html::text(name),
                    None => Html::text("sum of the above"),
                },
                text(range),
                text(format!("{} {}/s", significant(c.rms_speed, 4), c.unit)),
                or_dash(c.turns.map(|t| significant(t, 4))),
                or_dash(c.turns_per_period.map(|t| significant(t, 3))),
                or_dash(c.beyond_90.map(|b| percent(b, 3))),
                or_dash((c.step > 0.0).then(|| quantity(c.step, &c.unit, 3))),
                or_dash((c.step > 0.0).then(|| quantity(c.quantisation_noise, &c.unit, 2))),
                text(quantity(c.noise, &c.unit, 2)),
            ]
        })
        .collect();
    let heads: Vec<(Html, Align)> = heads.iter().map(|(t, a)| (Html::text(t), *a)).collect();
    body.table(&heads, &rows);
}

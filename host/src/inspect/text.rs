//! An inspection in a few lines of plain text, for a terminal.

use std::fmt::Write as _;

use super::Inspection;
use super::coordinate::Coordinate;
use super::motion::Space;
use super::periodicity::Kind;
use crate::wording::format::{behind, count, duration, fixed, quantity, shortest, significant, to_digits_of};
use crate::wording::symbols::symbol_plain;

/// Restarts of the device that are shown, a line each.
const MOST_RESTARTS: usize = 10;

/// One line on the kind of motion.
pub fn motion(inspection: &Inspection) -> String {
    let p = &inspection.periodicity;
    match (p.kind, p.period) {
        (Kind::AtRest, _) => "at rest".to_owned(),
        (Kind::Free, _) => measured_drive(inspection).unwrap_or_else(|| "free, no drive".to_owned()),
        (Kind::Periodic, Some(1)) => "repeats every drive period".to_owned(),
        (Kind::Periodic, k) => format!("repeats every {} drive periods", k.unwrap_or(0)),
        (Kind::LocksLater, _) => format!("locks after {}", duration(p.locked_after_s.unwrap_or(0.0))),
        (Kind::ChaoticOrTransient, _) => "chaotic or transient".to_owned(),
    }
}

/// What drives a system without a stated drive: its measured inputs that move; none where none
/// does.
fn measured_drive(inspection: &Inspection) -> Option<String> {
    let moving = inspection.coordinates.iter().filter(|c| c.input && c.greatest - c.least > 6.0 * c.step);
    let names: Vec<String> = moving.map(|c| symbol_plain(&c.name)).collect();
    (!names.is_empty()).then(|| format!("driven by the measured {}", names.join(" and ")))
}

/// Where most of a coordinate's motion is: a line, or a hump that stands above every line.
fn strongest(c: &Coordinate) -> Option<String> {
    let s = c.spectrum.as_ref()?.strongest.as_ref()?;
    if s.broad {
        return Some(format!("strongest near {} Hz (broad)", significant(s.frequency_hz, 2)));
    }
    let name = s.name.as_ref().map_or(String::new(), |n| format!(" ({})", beside_the_drives(n)));
    Some(format!("strongest at {} Hz{name}", significant(s.frequency_hz, 3)))
}

/// A line's name in words, as a terminal has no legend for f_e: `f_e/2`, half of the drive's.
fn beside_the_drives(name: &str) -> String {
    let Some((times, part)) = name.split_once("f_e") else { return name.to_owned() };
    let (times, part) = (times.trim(), part.trim_start_matches('/'));
    match (times, part) {
        ("", "") => "the drive's".to_owned(),
        (n, "") => format!("{n} times the drive's"),
        ("", n) => format!("1/{n} of the drive's"),
        (n, m) => format!("{n}/{m} of the drive's"),
    }
}

/// One line on the drive: stated and found; none for a free system.
pub fn drive(inspection: &Inspection) -> Option<String> {
    let d = inspection.drive.as_ref()?;
    let stated = shortest(d.stated_hz);
    let digits = |f| to_digits_of(f, if d.phase_hz.is_some() { 1e-5 } else { d.resolution_hz });
    Some(match (d.agrees, d.phase_hz.or(d.line_hz).or(d.other_hz)) {
        (Some(true), Some(f)) => format!("{stated} Hz stated, {} Hz in the record", digits(f)),
        (Some(false), Some(f)) => format!("{stated} Hz stated, but {} Hz in the record", digits(f)),
        _ => format!("{stated} Hz stated, no clear line in the record"),
    })
}

/// Range of a coordinate; in turns where it whirls.
pub fn range(c: &Coordinate) -> String {
    let turn = std::f64::consts::TAU;
    if c.space == Space::S1 && c.greatest - c.least > 20.0 {
        format!("{} … {} turns", significant(c.least / turn, 3), significant(c.greatest / turn, 3))
    } else {
        format!("{} … {}{}", significant(c.least, 4), significant(c.greatest, 4), behind(&c.unit))
    }
}

/// A speed with the unit of its coordinate a second; a pure number has none to be shown.
pub fn speed(value: f64, unit: &str, digits: usize) -> String {
    format!("{} {}/s", significant(value, digits), if unit == "1" { "" } else { unit })
}

/// What was found, one sentence.
pub fn sentence(inspection: &Inspection) -> String {
    let r = &inspection.record;
    let whole = match (r.segments, r.lost) {
        (1, 0) => "whole".to_owned(),
        (n, lost) => {
            let plural = |k: u64, one: &str, many: &str| format!("{} {}", count(k), if k == 1 { one } else { many });
            format!(
                "in {}, {} missing",
                plural(n as u64, "unbroken stretch", "unbroken stretches"),
                plural(lost, "sample", "samples")
            )
        }
    };
    let drive = match inspection.drive.as_ref().and_then(|d| d.agrees) {
        Some(true) => ", the drive is as the rig file says",
        Some(false) => ", the drive is not at the rig file's frequency",
        None => "",
    };
    let noticed = match inspection.warnings.len() {
        0 => String::new(),
        1 => "; one warning".to_owned(),
        n => format!("; {n} warnings"),
    };
    format!("The record of {} is {whole}; its motion: {}{drive}{noticed}.", duration(r.duration_s), motion(inspection))
}

/// The inspection in a few lines: its sentence, record, losses, drive, motion, one line for each
/// coordinate. Ends with a line break; warnings are left to standard error.
pub fn text(inspection: &Inspection) -> String {
    let r = &inspection.record;
    let mut out = format!("{}\n", sentence(inspection));
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<10} {value}");
    };
    let stretches = match r.segments {
        1 => "unbroken".to_owned(),
        n => format!("{n} stretches, longest {}", duration(r.longest_segment as f64 / r.sample_rate_hz)),
    };
    line(
        "record",
        format!(
            "{}: {} samples at {} Hz, {}, {stretches}",
            r.file,
            count(r.samples),
            shortest(r.sample_rate_hz),
            duration(r.duration_s)
        ),
    );
    let l = &r.losses;
    let causes: Vec<String> = [
        (if r.origin.is_some() { "on the link" } else { "missing rows" }, l.lost_on_link),
        ("damaged", l.damaged),
        ("overruns", l.overruns),
        ("dropped by the device", l.dropped_by_device),
        ("NaN", l.nan_rows),
    ]
    .iter()
    .filter(|(_, n)| *n > 0)
    .map(|(what, n)| format!("{} {what}", count(*n)))
    .collect();
    line("lost", if causes.is_empty() { count(r.lost) } else { format!("{}: {}", count(r.lost), causes.join(", ")) });
    for pair in r.origin.iter().flat_map(|origin| origin.boots.windows(2)).take(MOST_RESTARTS) {
        let at_s = pair[1].tick as f64 / r.sample_rate_hz;
        line("restart", format!("at t = {} s: {}", fixed(at_s, 3), pair[1].after(&pair[0])));
    }
    if let Some(seen) = drive(inspection) {
        line("drive", seen);
    }
    line("motion", motion(inspection));
    for c in &inspection.coordinates {
        let mut parts = vec![range(c), format!("rms {}", speed(c.rms_speed, &c.unit, 3))];
        if let Some(b) = c.beyond_90 {
            parts.push(format!("{} % beyond ±90°", fixed(100.0 * b, 1)));
        }
        if let Some(t) = c.turns_per_period {
            parts.push(format!("{} turns a drive period", fixed(t, 3)));
        }
        parts.push(format!("noise {}", quantity(c.noise, &c.unit, 2)));
        if c.step > 0.0 {
            let from = if c.counts { "counting" } else { "its steps" };
            parts.push(format!("{from} alone {}", quantity(c.quantisation_noise, &c.unit, 2)));
        }
        parts.extend(strongest(c));
        line(&symbol_plain(&c.name), parts.join(", "));
    }
    out.push_str(&crate::phase_space::survey_text::text(&inspection.phase_space));
    out
}

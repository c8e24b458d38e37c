//! A survey in a few lines of plain text, for a terminal.

use std::fmt::Write as _;

use super::survey::PhaseSpace;
use crate::wording::format::{Z95, fixed, plus_minus, significant};
use crate::wording::symbols::symbol_plain;

/// Delay and dimension of each coordinate, exponent, dimension, orbits; a line each. Ends with a
/// line break.
pub fn text(space: &PhaseSpace) -> String {
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<10} {value}");
    };
    let dimension = |d: Option<usize>| d.map_or_else(|| "none found".to_owned(), |d| d.to_string());
    for c in &space.coordinates {
        let first = match c.first_minimum {
            Some(m) if m == c.delay => "the first minimum of its mutual information".to_owned(),
            Some(m) => format!("the first minimum of its mutual information is at {m}"),
            None => "its mutual information has no minimum".to_owned(),
        };
        let weak = if c.weak { ", none of them clear" } else { "" };
        line(
            "delay",
            format!(
                "{}: {} sample{} ({first}{weak}); embedding dimension {} by false neighbours, {} by Cao",
                symbol_plain(&c.name),
                c.delay,
                if c.delay == 1 { "" } else { "s" },
                dimension(c.dimension),
                dimension(c.cao_dimension)
            ),
        );
    }
    if space.dies_away {
        line("exponent", "none: the motion dies away, and neighbouring states with it".to_owned());
    }
    if let Some(l) = &space.lyapunov {
        let period = match (l.per_period, l.per_period_std_error) {
            (Some(v), Some(e)) => format!(", {} a drive period", plus_minus(v, Z95 * e)),
            _ => String::new(),
        };
        let period = format!("{period} (± is 95 %)");
        // The slope of the divergence curve lies low where it saturates early; its scatter does not
        // show that.
        let divergence = match (l.divergence_per_second, l.fit_window_s) {
            (Some(v), Some([a, b])) => {
                format!(
                    "; from how neighbours part: {} /s over {} … {} s (a cruder estimate, usually too small)",
                    significant(v, 2),
                    significant(a, 3),
                    significant(b, 3)
                )
            }
            _ => String::new(),
        };
        let open = if space.spreads() { "" } else { "; it does not show that neighbouring states part" };
        line("exponent", format!("{} /s{period}{divergence}{open}", plus_minus(l.per_second, Z95 * l.std_error)));
    }
    if let Some(d) = space.correlation_dimension.as_ref().filter(|d| d.dimension.is_some()) {
        line(
            "attractor",
            format!("dimension {} (± is 95 %)", plus_minus(d.dimension.unwrap_or(0.0), Z95 * d.std_error)),
        );
    }
    if let Some(o) = &space.orbits {
        let periods: Vec<String> = o.orbits.iter().take(12).map(|o| o.period.to_string()).collect();
        let more = if o.orbits.len() > 12 { ", …" } else { "" };
        let of = if periods.is_empty() {
            String::new()
        } else {
            let shared = fixed(100.0 * o.coverage, 1);
            format!(", after {}{more} drive periods; they cover {shared} % of the motion", periods.join(", "))
        };
        line("orbits", format!("{}{of}", closing(o.orbits.len(), o.settings.tolerance)));
    }
    if let Some(o) = &space.free_orbits {
        let periods: Vec<String> = o.orbits.iter().take(8).map(|o| significant(o.period_s, 4)).collect();
        let more = if o.orbits.len() > 8 { ", …" } else { "" };
        let of = if periods.is_empty() {
            String::new()
        } else {
            format!(
                ", after {}{more} s; they cover {} % of the motion",
                periods.join(", "),
                fixed(100.0 * o.coverage, 1)
            )
        };
        // Without a positive exponent the motion need not have unstable orbits: a sum of swings
        // also comes back.
        let word = if space.spreads() { "orbits" } else { "returns" };
        line(word, format!("{}{of}", closing(o.orbits.len(), o.settings.tolerance)));
    }
    out
}

/// How many orbits close, and how closely.
fn closing(count: usize, tolerance: f64) -> String {
    let within = format!("within {} % of the range", significant(100.0 * tolerance, 2));
    match count {
        0 => format!("none that closes {within}"),
        1 => format!("1 that closes {within}"),
        n => format!("{n} that close {within}"),
    }
}

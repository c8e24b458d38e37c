//! An explanation in words.

use std::fmt::Write;

use super::engine::attractor::{Attractor, TOLERANCE_DEG};
use super::engine::residual_map::Where;
use super::{Explanation, Verdict};
use crate::report::format::{plus_minus, significant};

/// The answer for people.
pub fn human(e: &Explanation) -> String {
    let mut out = String::new();
    let verdict = match e.verdict {
        Verdict::NothingMissing => "nothing is missing",
        Verdict::Explained => "explained",
        Verdict::Unexplained => "unexplained: something is missing that has no name in the list",
        Verdict::NotDecidable => "not decidable from this record",
    };
    let _ = writeln!(out, "{verdict}: {}", e.reason);
    for f in &e.effects {
        let parameters: Vec<String> =
            f.parameters.iter().map(|(k, v)| format!(", {k} = {}", significant(*v, 3))).collect();
        let _ = writeln!(
            out,
            "  {}@{} = {} {}{}   ({})",
            f.id,
            f.at,
            plus_minus(f.value, 1.96 * f.std_error),
            f.unit,
            parameters.concat(),
            f.equation
        );
        if !f.indistinguishable_from.is_empty() {
            let _ = writeln!(out, "    not told apart from {}", f.indistinguishable_from.join(", "));
        }
        let _ = writeln!(out, "    to confirm: {}", f.confirm);
    }
    if !e.gap.steps.is_empty() {
        let _ = writeln!(out, "gap over {} s:", significant(e.gap.horizon_s, 3));
    }
    for s in &e.gap.steps {
        let _ = writeln!(out, "  {:<34} {}", s.added.as_deref().unwrap_or("nominal model"), e.gap.told(s.value));
    }
    if let Some(before) = e.gap.attractor.first() {
        let both = |f: &dyn Fn(&Attractor) -> Option<f64>| -> String {
            let values: Vec<String> = e.gap.attractor.iter().filter_map(f).map(|v| significant(v, 3)).collect();
            values.join(" → ")
        };
        let _ = writeln!(
            out,
            "predictions hold to {TOLERANCE_DEG} degrees for {} s",
            both(&|a| Some(a.prediction_horizon_s))
        );
        if before.section_distance.is_some() {
            let _ = writeln!(
                out,
                "energy distance between the Poincaré sections of model and record: {} (probability by chance {})",
                both(&|a| a.section_distance),
                both(&|a| a.section_p_value)
            );
        }
    }
    for f in e.gap.forecasts.iter().filter(|f| !f.steps.is_empty()) {
        let _ = writeln!(
            out,
            "error over {} s on the last 30 %, first 70 % fitted, in {}:",
            significant(f.horizon_s, 4),
            if f.unit == "deg" { "degrees" } else { &f.unit }
        );
        for s in &f.steps {
            let _ =
                writeln!(out, "  {:<34} {}", s.added.as_deref().unwrap_or("nominal model"), significant(s.value, 3));
        }
    }
    for f in &e.simulation {
        let _ = writeln!(
            out,
            "error of a simulation over the rest, first {} % fitted, in {}:",
            significant(100.0 * f.fitted, 2),
            f.unit
        );
        for s in &f.steps {
            let _ =
                writeln!(out, "  {:<34} {}", s.added.as_deref().unwrap_or("nominal model"), significant(s.value, 3));
        }
    }
    if let Some(u) = &e.unknown {
        let clear = u.points.iter().filter(|p| p[1].abs() > p[2]).count();
        let _ = writeln!(
            out,
            "what is left looks most like a torque at {} that depends on the {}: it takes away {} % of the held-out residual ({clear} of {} points clear of their bands)",
            u.at,
            u.against,
            significant(100.0 * u.held_out_gain, 2),
            u.points.len()
        );
    }
    if !e.where_before.is_empty() {
        let _ = writeln!(out, "before the first effect was added the model disagreed most here:");
        // One place for each coordinate; a drift in time says least about the cause.
        let mut clearest: Vec<Where> = Vec::new();
        for w in e.where_before.iter().filter(|w| w.against != "time") {
            if clearest.iter().all(|c| c.against != w.against) {
                clearest.push(w.clone());
            }
        }
        departures(&mut out, if clearest.is_empty() { &e.where_before } else { &clearest }, 3);
    }
    if e.verdict == Verdict::Unexplained && !e.r#where.is_empty() {
        let _ = writeln!(out, "what is left sits here:");
        departures(&mut out, &e.r#where, 5);
    }
    out
}

/// The clearest places, a line each.
fn departures(out: &mut String, places: &[Where], most: usize) {
    for w in places.iter().take(most) {
        let _ = writeln!(
            out,
            "  equation {} departs by {} at {} {} … {} (noise: ± {})",
            w.equation,
            significant(w.value, 2),
            w.against,
            significant(w.from, 3),
            significant(w.to, 3),
            significant(w.band, 2)
        );
    }
}

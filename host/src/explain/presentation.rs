//! An explanation in words.

use std::fmt::Write;

use super::card::clean;
use super::engine::attractor::{Attractor, LONGEST, TOLERANCE_DEG};
use super::engine::residual_map::Where;
use super::{Explanation, Found, Step, Verdict};
use crate::effects::catalogue;
use crate::effects::entry::At;
use crate::report::card::Card;
use crate::wording::format::{Z95, percent, plus_minus, rounded, shortest, significant};
use crate::wording::symbols::symbol_plain;

/// The answer for people: its card first, then what it rests on.
pub fn human(e: &Explanation, card: &Card) -> String {
    let rests_on = rests_on(e);
    if rests_on.is_empty() { card.text() } else { format!("{}\nWhat it rests on\n{rests_on}", card.text()) }
}

fn rests_on(e: &Explanation) -> String {
    let mut out = String::new();
    added(&mut out, &e.effects);
    if let Some(before) = e.gap.attractor.first() {
        // Predictions are no longer than that.
        let longest = LONGEST * e.gap.horizon_s;
        let stays = |s: f64| format!("{}{}", if s > 0.99 * longest { "at least " } else { "" }, significant(s, 3));
        let both = |f: &dyn Fn(&Attractor) -> Option<f64>| -> String {
            let values: Vec<String> = e.gap.attractor.iter().filter_map(f).map(|v| significant(v, 3)).collect();
            values.join(" → ")
        };
        let _ = writeln!(
            out,
            "free predictions stay within {TOLERANCE_DEG}° for {} s (median)",
            e.gap.attractor.iter().map(|a| stays(a.prediction_horizon_s)).collect::<Vec<_>>().join(" → ")
        );
        if before.section_distance.is_some() {
            let _ = writeln!(
                out,
                "distance of the record's Poincaré section from those of the model's own records: {} (energy distance; one of them is as far from the others with probability {}: where that is below 0.01, the motion differs in the long run)",
                both(&|a| a.section_distance),
                both(&|a| a.section_p_value)
            );
        }
    }
    for f in e.gap.forecasts.iter().filter(|f| !f.steps.is_empty()) {
        let _ = writeln!(
            out,
            "another trial: error of predictions over {} s on the last 30 % of the record, by models fitted to the first 70 % alone{}:",
            shortest(rounded(f.horizon_s, 3)),
            in_unit(&f.unit)
        );
        lines(&mut out, &f.steps);
    }
    if let Some(piece_s) = e.details.simulated_s {
        let [piece, window] = [piece_s, e.details.window_s].map(|s| shortest(rounded(s, 3)));
        let than = if piece == window {
            "the search's windows, which are as long".to_owned()
        } else {
            format!("windows of {window} s")
        };
        let _ = writeln!(
            out,
            "parameters are those by which simulations follow pieces of {piece} s: they tell more than {than}, and foretell as well"
        );
    }
    for f in &e.simulation {
        let fitted = significant(100.0 * f.fitted, 2);
        let _ = write!(out, "error of one simulation to the record's end, its first {fitted} % fitted");
        let _ = if f.steps.is_empty() {
            writeln!(out, ": none, as no simulation follows the record that far")
        } else {
            writeln!(out, "{}:", in_unit(&f.unit))
        };
        lines(&mut out, &f.steps);
    }
    if let Some(u) = &e.unknown {
        let clear = u.points.iter().filter(|p| p[1].abs() > p[2]).count();
        let _ = writeln!(
            out,
            "what is left looks most like a {} at {} that depends on the {}: it explains {} % of what was not fitted ({clear} of {} points are clear of noise)",
            u.kind(),
            u.at,
            u.against,
            significant(100.0 * u.held_out_gain, 2),
            u.points.len()
        );
    }
    if !e.where_before.is_empty() {
        let _ = writeln!(out, "before anything was added the model disagreed most here:");
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

/// What each effect adds to the equations, a line each, and what the letters in it are.
fn added(out: &mut String, effects: &[Found]) {
    for f in effects {
        let number = |(k, v): (&String, &f64)| match f.parameter_std_errors.get(k) {
            Some(error) if *error > 0.0 => plus_minus(*v, Z95 * error),
            _ => significant(*v, 3),
        };
        let parameters: Vec<String> =
            f.parameters.iter().map(|p| format!(", {} = {}", symbol_plain(p.0), number(p))).collect();
        let _ = writeln!(
            out,
            "  {} adds {}{}; it explains {} of what was left before it was added, where it was not fitted",
            f.name(),
            f.equation,
            parameters.concat(),
            percent(f.held_out_gain, 2)
        );
    }
    if let Some(words) = letters(effects) {
        let _ = writeln!(out, "  {words}");
    }
}

/// What the letters in the terms of listed effects at joints and arms stand for, but for those that
/// a term's own text tells; none where there is none.
pub fn letters(effects: &[Found]) -> Option<String> {
    let is_mechanical = |f: &&Found| {
        let entry = catalogue().iter().find(|e| e.id == f.id);
        entry.is_some_and(|e| matches!(e.at, At::Joint | At::Arm))
    };
    let has = |text: &str, letter: &str| {
        let is_told = ["", "(s)"].iter().any(|of| text.contains(&format!("{letter}{of} the ")));
        // Raised digits are no letters of a name.
        !is_told
            && text.split(|c: char| !c.is_alphabetic() && !c.is_ascii_digit() && c != '_').any(|word| word == letter)
    };
    let stands = |letter: &str| effects.iter().filter(is_mechanical).any(|f| has(&f.equation, letter));
    let all = [
        ("v", "the rate of the joint"),
        ("x", "the joint's angle or position"),
        ("ω", "the angular velocity of the arm"),
    ];
    let told: Vec<String> =
        all.iter().filter(|(letter, _)| stands(letter)).map(|(letter, what)| format!("{letter} is {what}")).collect();
    (!told.is_empty()).then(|| format!("in these terms {}; the letter in front is the value", told.join(", ")))
}

/// `, in m`; nothing where the rig file says no unit.
fn in_unit(unit: &str) -> String {
    match unit {
        "" | "1" => String::new(),
        "deg" => ", in degrees".to_owned(),
        unit => format!(", in {unit}"),
    }
}

/// Steps, a line each.
fn lines(out: &mut String, steps: &[Step]) {
    for s in steps {
        let _ = writeln!(out, "  {:<34} {}", s.told("with"), significant(s.value, 3));
    }
}

/// The clearest places, a line each.
fn departures(out: &mut String, places: &[Where], most: usize) {
    for w in places.iter().take(most) {
        let _ = writeln!(
            out,
            "  equation {} is off by {} at {} (noise alone: within ± {})",
            w.equation,
            w.residual(w.value),
            clean(w).stretch(),
            w.residual(w.band)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::engine::simulation::Simulation;

    #[test]
    fn letters_of_terms_are_told_but_for_those_that_the_term_tells() {
        let found = |id: &str, equation: &str| {
            let mut f = Found::empty(id, "joint1", String::new());
            f.equation = equation.to_owned();
            f
        };
        let drag = found("quadratic-drag", "−k ω |ω|");
        let friction = found("coulomb-friction", "−τ sign v");
        let told = letters(&[drag, friction]).unwrap();
        assert!(told.contains("v is the rate of the joint, ω is the angular velocity of the arm;"), "{told}");
        assert_eq!(letters(&[found("body-drag", "−k |v| v, v the velocity of the body's centroid")]), None);
        assert_eq!(letters(&[found("zero-offset", "θ + b")]), None);
        // A raised digit stands behind the letter.
        let told = letters(&[found("cubic-stiffness", "−k x³")]).unwrap();
        assert!(told.contains("x is the joint's angle or position;"), "{told}");
        assert_eq!(letters(&[found("distributed-drag", "−k |v(s)| v(s), v(s) the speed at s")]), None);
    }

    #[test]
    fn pieces_are_not_compared_with_windows_of_their_own_length() {
        let mut e = Explanation::new(0.2, Vec::new());
        e.details.simulated_s = Some(38.6);
        e.details.window_s = 38.6;
        assert!(
            rests_on(&e).contains("pieces of 38.6 s: they tell more than the search's windows, which are as long"),
            "{}",
            rests_on(&e)
        );
        e.details.window_s = 4.0;
        assert!(rests_on(&e).contains("pieces of 38.6 s: they tell more than windows of 4 s"), "{}", rests_on(&e));
    }

    /// Steps that no simulation follows are left out of what is told.
    #[test]
    fn where_no_simulation_follows_the_record_that_is_said() {
        let mut e = Explanation::new(0.2, Vec::new());
        let of =
            |fitted: f64, steps: Vec<Step>| Simulation { fitted, unit: "m".to_owned(), steps, parameters: Vec::new() };
        e.simulation = vec![of(2.0 / 3.0, Vec::new()), of(0.75, vec![Step { added: None, value: 1.43 }])];
        let told = rests_on(&e);
        let lines: Vec<&str> = told.lines().collect();
        let head = "error of one simulation to the record's end, its first";
        assert_eq!(lines[0], format!("{head} 67 % fitted: none, as no simulation follows the record that far"));
        assert_eq!(lines[1], format!("{head} 75 % fitted, in m:"));
        assert!(lines.len() == 3 && lines[2].ends_with("1.43"), "{told}");
    }
}

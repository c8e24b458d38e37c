//! A plan for people, and as the file that a capture runs.

use std::fmt::Write as _;

use super::task::LOOKED_AT_S;
use super::{APART, Plan, Proposal, Separated, Setting};
use crate::identify::Parameter;
use crate::statistics::Z95;
use crate::wording::format::{significant, to_digits_of};

/// Length below which times are not told, s.
const SIMULATED_S: f64 = 20.0;

/// "tell A from B, C and whatever else looks like it".
pub fn told_apart(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => format!("show {one} at {APART} standard errors"),
        [first, others @ ..] => {
            format!(
                "tell {first} from {} and whatever else looks like it at {APART} standard errors",
                others.join(", ")
            )
        }
    }
}

/// A setting in one phrase.
pub fn setting(s: &Setting) -> String {
    if let Some(pose) = &s.pose {
        let degrees: Vec<String> = pose.iter().map(|x| format!("{:.0}", x.to_degrees())).collect();
        return format!("let go at rest from {} degrees", degrees.join(" and "));
    }
    let Some(f) = s.frequency_hz else { return "as it is".to_owned() };
    match (s.amplitude_m, s.amplitude_factor) {
        (Some(a), _) => format!("{f:.2} Hz at {:.2} mm", 1e3 * a),
        (None, Some(k)) => format!("{f:.2} Hz at {k:.2} of the present amplitude"),
        (None, None) => format!("{f:.2} Hz"),
    }
}

/// A length, rounded up.
pub fn length(seconds: f64) -> String {
    let tenths = |unit_s: f64| (seconds / unit_s * 10.0 - 1e-6).ceil() / 10.0;
    match seconds {
        s if s >= 259_200.0 => format!("{:.1} days", tenths(86_400.0)),
        s if s >= 10_800.0 => format!("{:.1} hours", tenths(3600.0)),
        s if s >= 120.0 => format!("{:.1} minutes", tenths(60.0)),
        s => format!("{s:.0} s"),
    }
}

/// How long a setting is recorded: what is let go is at rest after a while, and let go again.
pub fn lasting(s: &Setting, seconds: f64) -> String {
    // Few: the cast cuts nothing.
    let times = (seconds / LOOKED_AT_S - 1e-6).ceil() as u64;
    match s.pose {
        Some(_) if times > 1 => format!("{times} times, for {LOOKED_AT_S} s each"),
        _ => format!("for {}", length(seconds)),
    }
}

/// What is said behind a number that rests on one draw: it bounds no other record.
fn alone(draws: usize) -> &'static str {
    if draws == 1 { " (one draw)" } else { "" }
}

/// What the numbers of a proposal rest on.
fn rests_on(draws: usize) -> String {
    match draws {
        1 => "by one simulated: nothing bounds what another would tell".to_owned(),
        n => format!("by {n} simulated; separations are at least so large, at 97.5 %"),
    }
}

/// Why what is proposed is not said to reach every goal.
pub fn undecided(p: &Proposal) -> &'static str {
    if p.is_one_draw() {
        "Whether this reaches every goal is not certain: it rests on one draw"
    } else {
        "This does not reach every goal within the longest record that is allowed"
    }
}

/// Standard errors of all parameters over those of as long a record as the rig is set, geometric
/// mean; none where a length was asked for, or nothing is known of it.
fn narrower(plan: &Plan, best: &Proposal) -> Option<f64> {
    let there = plan.unchanged.as_ref().filter(|_| plan.goals.precise.is_empty())?;
    let of = |q: &Parameter| {
        let same = there.parameters.iter().find(|p| p.name == q.name)?;
        Some((q.std_error / same.std_error).ln()).filter(|x| x.is_finite())
    };
    let all: Vec<f64> = best.parameters.iter().filter_map(of).collect();
    (!all.is_empty()).then(|| (all.iter().sum::<f64>() / all.len() as f64).exp())
}

/// The plan in one line; none where nothing is proposed.
pub fn line(plan: &Plan) -> Option<String> {
    let best = plan.best.as_ref()?;
    let mut out = format!("{}, {}", setting(&best.setting), lasting(&best.setting, best.seconds));
    if plan.goals.tell.is_empty() {
        if plan.unchanged.as_ref().is_some_and(|there| there.setting == best.setting) {
            out.push_str(", as it is set now");
        } else if let Some(ratio) = narrower(plan, best) {
            let share = significant(ratio, 2);
            let _ = write!(out, ", would have standard errors of {share} of those as it is set now, in the same time");
        }
        return Some(out);
    }
    let asked = |s: &&Separated| plan.goals.tell.contains(&s.effect);
    let nearest =
        |p: &Proposal| p.separations.iter().filter(asked).min_by(|a, b| a.deviations.total_cmp(&b.deviations)).cloned();
    let Some(s) = nearest(best) else { return Some(out) };
    let from = s.from.as_ref().map_or("nothing missing".to_owned(), Clone::clone);
    let _ = write!(
        out,
        ", would tell {} from {from}, which is nearest to it, at {:.1} standard errors{}",
        s.effect,
        s.deviations,
        alone(s.draws)
    );
    match plan.unchanged.as_ref() {
        Some(there) if there.setting == best.setting => out.push_str("; it is set so now"),
        there => {
            if let Some(there) = there.and_then(nearest) {
                let from = there.from.as_ref().map_or("nothing missing", |f| f.as_str());
                let told = format!("at {:.1} standard errors{}", there.deviations, alone(there.draws));
                let _ = write!(out, "; as it is set now, a record as long would tell it from {from} {told}");
            }
        }
    }
    Some(out)
}

/// The plan's first line, or that nothing is proposed.
pub fn headline(plan: &Plan) -> String {
    match line(plan) {
        Some(line) => format!("The next experiment: {line}"),
        None => format!(
            "{}: no setting was found at which the model moves chaotically and a record of it can be followed",
            plan.rig
        ),
    }
}

fn proposal(out: &mut String, p: &Proposal, tell: &[String]) {
    for g in &p.goals {
        // Below what was simulated nothing is known.
        let time = match g.seconds {
            None => "cannot be reached here".to_owned(),
            Some(s) if s < p.seconds.min(SIMULATED_S) => format!("less than {}", length(SIMULATED_S)),
            Some(s) => length(s),
        };
        let _ = writeln!(out, "  to {}: {time}{}", g.goal, alone(g.draws));
    }
    for s in p.separations.iter().filter(|s| s.from.is_none() || tell.contains(&s.effect)) {
        let from = s.from.as_ref().map_or("nothing missing".to_owned(), Clone::clone);
        let _ = writeln!(out, "  {} from {from}: {:.1} standard errors{}", s.effect, s.deviations, alone(s.draws));
    }
    // What a fit to a simulated record gives, not what the model has.
    let _ = writeln!(out, "  {:<28} {:>13} {:>12} (95 %)", "parameter", "in one draw", "±");
    for (q, [low, high]) in p.parameters.iter().zip(&p.std_errors) {
        let half = Z95 * q.std_error;
        let (value, error) = (to_digits_of(q.value, half), significant(half, 3));
        let _ = write!(out, "  {:<28} {value:>13} {error:>12}", q.name);
        // One record alone says nothing of others.
        if p.draws > 1 && high.is_finite() {
            let _ = write!(out, " ({} to {})", significant(Z95 * low, 3), significant(Z95 * high, 3));
        }
        let _ = writeln!(out, "{}", if q.unit == "1" { String::new() } else { format!(" {}", q.unit) });
    }
}

/// The whole plan.
pub fn human(plan: &Plan) -> String {
    let Some(best) = &plan.best else {
        return format!("{}\nWiden the limits (--limits), or look at more settings (--budget)\n", headline(plan));
    };
    let mut out = format!("{}\n", headline(plan));
    if !best.decides {
        let _ = writeln!(out, "{}", undecided(best));
    }
    if let Some(c) = best.chaos {
        let [low, high] = c.interval;
        let _ = writeln!(
            out,
            "chaotic in {} of {} draws of parameters and initial states (95 %: {:.2} to {:.2}), an arm goes round in {}",
            c.chaotic, c.draws, low, high, c.whirling
        );
    }
    let _ = writeln!(out, "\nWhat a record of {} there would tell ({})", length(best.seconds), rests_on(best.draws));
    proposal(&mut out, best, &plan.goals.tell);
    // What is proposed may be what is set: further draws have told more of it than the one here.
    if let Some(now) = plan.unchanged.as_ref().filter(|now| now.setting != best.setting) {
        let _ =
            writeln!(out, "\nAs it is set now ({}), in the same time ({})", setting(&now.setting), rests_on(now.draws));
        proposal(&mut out, now, &plan.goals.tell);
    }
    if plan.wider > 1.05 {
        let _ = writeln!(
            out,
            "\nWhat the model does not explain of the record makes all intervals {:.1} times as wide as the sensors' noise alone would",
            plan.wider
        );
    }
    if !plan.others.is_empty() {
        let _ = writeln!(out, "\nOther settings");
        for p in plan.others.iter().take(5) {
            let _ = writeln!(
                out,
                "  {}: {}{}",
                setting(&p.setting),
                length(p.seconds),
                match p {
                    p if p.decides => "",
                    p if p.is_one_draw() => ", by one draw",
                    _ => ", which does not reach every goal",
                }
            );
        }
    }
    if !plan.map.is_empty() {
        out.push_str("\nMotion over frequency and amplitude (c chaotic, C chaotic and going round, + for some draws, . locked)\n");
        out.push_str(&map(plan));
    }
    out
}

/// The map in letters, amplitudes downwards.
fn map(plan: &Plan) -> String {
    let mut frequencies: Vec<f64> = plan.map.iter().filter_map(|p| p.setting.frequency_hz).collect();
    let mut amplitudes: Vec<f64> = plan.map.iter().filter_map(|p| p.setting.amplitude_factor).collect();
    for list in [&mut frequencies, &mut amplitudes] {
        list.sort_by(f64::total_cmp);
        list.dedup();
    }
    let mut out = String::from("  Hz       ");
    for f in &frequencies {
        let _ = write!(out, "{f:>6.2}");
    }
    out.push('\n');
    for a in amplitudes.iter().rev() {
        let at = |f: &f64| {
            plan.map.iter().find(|p| p.setting.frequency_hz == Some(*f) && p.setting.amplitude_factor == Some(*a))
        };
        let in_m = frequencies.iter().find_map(|f| at(f)?.setting.amplitude_m);
        let _ = write!(out, "  {:<9}", in_m.map_or(format!("x {a:.2}"), |m| format!("{:.2} mm", 1e3 * m)));
        for f in &frequencies {
            let letter = at(f).map_or(' ', |p| match p.chaos {
                c if c.chaotic == 0 => '.',
                c if c.chaotic < c.draws => '+',
                c if c.whirling > 0 => 'C',
                _ => 'c',
            });
            let _ = write!(out, "{letter:>6}");
        }
        out.push('\n');
    }
    out
}

/// The plan as a file: what is set and for how long, best first.
pub fn to_toml(plan: &Plan) -> String {
    let mut out =
        format!("# The next experiment on {}: run it with `whirl capture --plan`.\n", plan.rig.replace('\n', " "));
    if let Some(line) = line(plan) {
        let _ = writeln!(out, "# {line}");
    }
    let quoted =
        |list: &[String]| list.iter().map(|s| toml::Value::from(s.as_str()).to_string()).collect::<Vec<_>>().join(", ");
    let _ = writeln!(
        out,
        "format = 1\nrig = {}\ntell = [{}]",
        toml::Value::from(plan.rig.as_str()),
        quoted(&plan.goals.tell)
    );
    let precise: Vec<String> = plan.goals.precise.iter().map(|p| format!("{}={}%", p.name, 100.0 * p.share)).collect();
    let _ = writeln!(out, "precise = [{}]\nseed = {}", quoted(&precise), plan.seed);
    for p in plan.best.iter().chain(plan.others.iter().take(2)) {
        out.push_str("\n[[run]]\n");
        let mut number = |key: &str, x: Option<f64>| {
            if let Some(x) = x {
                let _ = writeln!(out, "{key} = {x:?}");
            }
        };
        number("frequency_hz", p.setting.frequency_hz);
        number("amplitude_m", p.setting.amplitude_m);
        number("amplitude_factor", p.setting.amplitude_factor);
        number("seconds", Some(p.seconds.ceil()));
        if let Some(pose) = &p.setting.pose {
            let _ = writeln!(out, "pose = {pose:?}");
        }
        let _ = writeln!(out, "decides = {}", p.decides);
        if let Some(c) = p.chaos {
            let _ = writeln!(out, "chaotic = {:?}", c.chaotic as f64 / c.draws.max(1) as f64);
        }
        out.push_str("[run.std_errors]\n");
        for q in &p.parameters {
            let _ = writeln!(out, "{} = {:?}", toml::Value::from(q.name.as_str()), q.std_error);
        }
    }
    out
}

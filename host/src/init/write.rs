//! A draft as the text of a rig file, each line with its reason, and as a few lines for people.

use std::fmt::Write;

use super::{Draft, DraftChannel, Statement};
use crate::error::plain;
use crate::rig::Direction;
use crate::system::library::Pendulum;

/// A text as a TOML string.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn reasons<'a>(out: &mut String, list: impl IntoIterator<Item = &'a Statement>) {
    for s in list {
        let mark = if s.check { "CHECK: " } else { "" };
        // Names of columns come from the file: one line, whatever they hold.
        let of = if is_of_drive(s) { "drive, " } else { "" };
        let _ = writeln!(out, "# {mark}{of}{}: {}", plain(&s.taken_for), plain(&s.why));
    }
}

/// The rig file.
pub fn text(draft: &Draft) -> String {
    if let Some(stored) = &draft.stored {
        return stored.clone();
    }
    let mut out = String::new();
    // Without its folder: a rig file is handed on.
    let record = draft.record.file_name().unwrap_or(draft.record.as_os_str());
    let record = plain(&record.to_string_lossy());
    let _ = writeln!(
        out,
        "# Written by `whirl init {record}` from what the record shows; every statement has its reason above it."
    );
    if draft.statements().iter().any(|s| s.check) {
        out.push_str("# What the record cannot show is marked CHECK: look at these lines first.\n");
    }
    let _ = writeln!(out, "name = {}\n", quoted(&draft.name));
    reasons(&mut out, draft.why_model.iter().filter(|s| !is_of_drive(s)));
    let _ = writeln!(out, "model = {}", quoted(draft.model.as_deref().unwrap_or("columns")));
    out.push('\n');
    reasons(&mut out, &draft.why_time);
    let _ = writeln!(out, "sample_rate_hz = {:?}", draft.sample_rate_hz);
    if let Some(column) = &draft.time.column {
        let _ = writeln!(out, "time = {}", quoted(column));
    }
    if let Some(unit) = &draft.time.unit {
        let _ = writeln!(out, "time_unit = {}", quoted(unit));
    }
    drive(&mut out, draft);
    draft.channels.iter().for_each(|c| channel(&mut out, c));
    if !draft.unused.is_empty() {
        out.push_str("\n# Columns that are not used:\n");
        for s in &draft.unused {
            let _ = writeln!(out, "#   {}: {}", plain(&s.of), plain(&s.why));
        }
    }
    known(&mut out, draft);
    out
}

/// Whether a statement is about the drive, which its value alone does not say.
fn is_of_drive(s: &Statement) -> bool {
    s.of == "drive"
}

fn drive(out: &mut String, draft: &Draft) {
    let Some(d) = &draft.drive else {
        let told = || draft.why_model.iter().filter(|s| is_of_drive(s));
        if draft.pendulum().is_some() {
            out.push('\n');
            reasons(out, told());
            out.push_str(if told().next().is_some() {
                "# Taken as a base at rest. With a shaker, --drive-hz HZ or:\n"
            } else {
                "# No drive shows, or the motion dies away: taken as a base at rest. With a shaker, --drive-hz HZ or:\n"
            });
            out.push_str("# [drive]\n# direction = \"vertical\"     # or \"horizontal\"\n# frequency_hz = 5.0\n");
        }
        return;
    };
    out.push('\n');
    reasons(out, &d.why);
    let direction = if d.direction == Direction::Vertical { "vertical" } else { "horizontal" };
    let _ = writeln!(out, "[drive]\ndirection = \"{direction}\"\nfrequency_hz = {:?}", d.frequency_hz);
    out.push_str("# amplitude_m = 0.01           # fill in to let `whirl capture` start the shaker with it; identified otherwise\n");
}

fn channel(out: &mut String, c: &DraftChannel) {
    out.push_str("\n[[channel]]\n");
    reasons(out, &c.why);
    let _ = writeln!(out, "name = {}", quoted(&c.name));
    let _ = writeln!(out, "measures = {}", quoted(&c.measures));
    let _ = writeln!(out, "unit = {}", quoted(&c.unit));
    if let Some(n) = c.counts_per_turn {
        let _ = writeln!(out, "counts_per_turn = {n}");
    }
    if let Some(gain) = c.gain {
        let _ = writeln!(out, "gain = {gain:?}");
    }
    out.push_str("# gain = -1.0                  # where it counts the other way\n");
}

/// What nobody can see: masses and lengths.
fn known(out: &mut String, draft: &Draft) {
    let list: &[&str] = match draft.pendulum() {
        Some(Pendulum::Double) => &[
            "m2 = 0.040     # kg, arm 2",
            "e2 = 0.0267    # m, joint 2 to the centroid of arm 2",
            "l1 = 0.0635    # m, joint 1 to joint 2",
        ],
        Some(Pendulum::Single) => &["m1 = 0.1       # kg", "e1 = 0.02      # m, joint to centroid"],
        None => return,
    };
    out.push_str("\n# FILL IN what was weighed and measured (SI), to get physical parameters too; left out, coefficients alone are identified.\n# [known]\n");
    for line in list {
        let _ = writeln!(out, "# {line}");
    }
}

/// The answer for people: what was taken for what, what is to be checked first.
pub fn human(draft: &Draft) -> String {
    let mut out = String::new();
    if let Some(s) = draft.stored.as_ref().and(draft.why_model.first()) {
        let _ = writeln!(out, "{}: {}", s.taken_for, s.why);
        return out;
    }
    let statements = draft.statements();
    let (check, seen): (Vec<&&Statement>, Vec<&&Statement>) = statements.iter().partition(|s| s.check);
    for s in seen {
        let _ = writeln!(out, "{}: {} ({})", s.of, s.taken_for, s.why);
    }
    if !check.is_empty() {
        out.push_str("To be checked, as the record cannot show it:\n");
        for s in check {
            let _ = writeln!(out, "  {}: {} ({})", s.of, s.taken_for, s.why);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::{channel_of, draft_of};
    use super::*;

    #[test]
    fn what_is_said_of_a_missing_drive_stands_where_the_drive_would() {
        let mut draft = draft_of(vec![channel_of("right")]);
        draft.model = Some("single-pendulum".to_owned());
        assert!(text(&draft).contains("\n# No drive shows, or the motion dies away: taken as a base at rest."));
        let why = "the motion does not die away, yet nothing asks for a frequency";
        draft.why_model.push(Statement::new("drive", "none", why).unsure());
        let told = text(&draft);
        let at = |part: &str| told.find(part).unwrap_or_else(|| panic!("no {part} in {told}"));
        let model = at("model = \"single-pendulum\"");
        let drive = at("# CHECK: drive, none: the motion does not die away, yet");
        assert!(model < drive && drive < at("# Taken as a base at rest.") && drive < at("# [drive]"), "{told}");
        assert!(!told.contains("or the motion dies away"), "{told}");
    }
}

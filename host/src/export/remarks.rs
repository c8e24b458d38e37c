//! What a model's code says in comments: what it is, its state, its effects. Texts come from files
//! and are made harmless first.

use super::program::Program;
use crate::error::plain;
use crate::motion::{Acts, Effect};

/// Longest line of a comment, characters.
const WIDE: usize = 110;

/// A number as it is told in a comment.
pub(super) fn rounded(x: f64) -> String {
    let digits = format!("{x:.5e}");
    match digits.parse::<f64>() {
        Ok(short) if (1e-3..1e5).contains(&short.abs()) || short == 0.0 => short.to_string(),
        _ => format!("{:e}", digits.parse::<f64>().unwrap_or(x)),
    }
}

/// A standard error in words.
pub fn error_text(x: f64) -> String {
    match x {
        x if x.is_nan() => "standard error not known".to_owned(),
        x if x.is_infinite() => "not determined by its record".to_owned(),
        0.0 => "taken as known".to_owned(),
        x => format!("standard error {x:.1e}"),
    }
}

/// Unit of a coordinate or input in words.
pub fn unit_text(unit: &str) -> String {
    if unit == "1" || unit.is_empty() { "SI unit".to_owned() } else { plain(unit) }
}

impl Program<'_> {
    /// The state with its units, for people.
    fn state_text(&self) -> String {
        let q: Vec<String> = self.coordinates.iter().map(|c| format!("{} ({})", c.name, c.unit)).collect();
        let v: Vec<String> = self.coordinates.iter().map(|c| format!("{} ({}/s)", c.rate, c.unit)).collect();
        format!("{}, {}", q.join(", "), v.join(", "))
    }

    /// Lines of comment that open the file: name, method, state, effects.
    pub fn about(&self) -> String {
        let m = self.motion;
        let mut lines = vec![
            format!("{}: equations of motion, identified (method: {}).", m.name, m.method),
            format!("Written by `whirl export`, version {}.", env!("CARGO_PKG_VERSION")),
            String::new(),
            format!("State x: {}.", self.state_text()),
        ];
        if !self.inputs.is_empty() {
            let list: Vec<String> = self.inputs.iter().map(|(n, unit)| format!("{n} ({unit})")).collect();
            lines.push(format!("Inputs u: {}.", list.join(", ")));
        }
        if let Some((name, omega)) = &self.omega {
            let hz = omega / core::f64::consts::TAU;
            lines.push(format!("Drive: {} Hz, phase tau = {name} t.", rounded(hz)));
        }
        if !m.effects.is_empty() {
            lines.push("Effects beside the nominal model:".to_owned());
            lines.extend(m.effects.iter().map(effect_text));
        }
        lines.iter().map(|l| self.remark(l)).collect::<Vec<_>>().join("\n")
    }

    /// A text as lines of comment.
    pub fn remark(&self, text: &str) -> String {
        let mark = self.language.remark();
        let text = harmless(text);
        let indent = " ".repeat(text.len() - text.trim_start_matches(' ').len());
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(last) if last.chars().count() + word.chars().count() < WIDE => last.push_str(&format!(" {word}")),
                Some(_) => lines.push(format!("{indent}  {word}")),
                None => lines.push(format!("{indent}{word}")),
            }
        }
        if lines.is_empty() {
            lines.push(String::new());
        }
        lines.iter().map(|l| harmless(&format!("{mark} {l}")).trim_end().to_owned()).collect::<Vec<_>>().join("\n")
    }
}

/// A text from a file as it may stand in a comment: on one line, and without a backslash at its
/// end, which would join the next line to it.
pub fn harmless(text: &str) -> String {
    let text = plain(text);
    // `??/` is a backslash where C still has trigraphs.
    let joins = text.trim_end().ends_with('\\') || text.trim_end().ends_with("??/");
    if joins { format!("{}.", text.trim_end()) } else { text }
}

/// An effect in a line.
fn effect_text(e: &Effect) -> String {
    let mut out = format!(
        "  {}: {}; value {} {}, {}",
        e.name(),
        e.equation,
        rounded(e.identified.value),
        e.identified.unit,
        error_text(e.identified.std_error)
    );
    for (name, value) in &e.identified.parameters {
        out.push_str(&format!(", {name} = {}", rounded(*value)));
    }
    out.push_str(match e.acts {
        Acts::Motion(_) => "",
        Acts::Drive(_) => " (in the drive's phase)",
        Acts::Input(..) => " (changes what is recorded of the input, not the motion: it is not in the equations)",
        Acts::Sensor(..) => " (changes what the sensor shows, not the motion: it is not in the equations)",
    });
    out
}

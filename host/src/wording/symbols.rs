//! Symbols for people: Greek letters, subscripts and marks of derivatives, as plain text, in HTML,
//! in a figure and as MathML.

use std::fmt::Write as _;

/// Escapes the five characters that HTML gives a meaning to, and drops control characters that no
/// document may hold.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// A symbol with its subscript: `theta1` → (θ, 1), `B11` → (B, 11), `J_o1` → (J, o1), `m1e1` → (m,
/// 1), (e, 1).
fn parts(name: &str) -> Vec<(String, String)> {
    const GREEK: &[(&str, &str)] = &[
        ("theta", "θ"),
        ("phi", "φ"),
        ("tau", "τ"),
        ("omega", "ω"),
        ("psi", "ψ"),
        ("epsilon", "ε"),
        ("mu", "μ"),
        ("alpha", "α"),
        ("beta", "β"),
        ("delta", "δ"),
        ("xi", "ξ"),
    ];
    let (head, tail) = name.split_once('_').unwrap_or((name, ""));
    let letters: String = head.chars().take_while(|c| c.is_alphabetic()).collect();
    let digits = &head[letters.len()..];
    let base = |l: &str| GREEK.iter().find(|g| g.0 == l).map_or(l.to_owned(), |g| g.1.to_owned());
    let known = GREEK.iter().any(|g| g.0 == letters) || letters.chars().count() == 1;
    if !known || letters.is_empty() {
        return vec![(name.to_owned(), String::new())];
    }
    if digits.chars().all(|c| c.is_ascii_digit()) {
        let comma = if digits.is_empty() || tail.is_empty() { "" } else { "," };
        return vec![(base(&letters), format!("{digits}{comma}{tail}"))];
    }
    // Products such as m1e1: each letter takes the digits that follow it.
    let mut out: Vec<(String, String)> = Vec::new();
    for c in head.chars() {
        match out.last_mut() {
            Some(last) if c.is_ascii_digit() => last.1.push(c),
            _ if c.is_alphabetic() => out.push((c.to_string(), String::new())),
            _ => return vec![(name.to_owned(), String::new())],
        }
    }
    if out.iter().any(|p| p.1.is_empty()) { vec![(name.to_owned(), String::new())] } else { out }
}

/// A symbol in HTML, escaped: `<i>J</i><sub>o1</sub>`.
pub fn symbol_html(name: &str) -> String {
    parts(name).iter().fold(String::new(), |mut out, (base, sub)| {
        let single = base.chars().count() == 1;
        let (open, close) = if single { ("<i>", "</i>") } else { ("", "") };
        let _ = write!(out, "{open}{}{close}", escape(base));
        if !sub.is_empty() {
            let _ = write!(out, "<sub>{}</sub>", escape(sub));
        }
        out
    })
}

/// A symbol for a figure's text, where `_{…}` is set as a subscript: `θ_{1}`.
pub fn symbol_svg(name: &str) -> String {
    parts(name).iter().fold(String::new(), |mut out, (base, sub)| {
        out.push_str(base);
        if !sub.is_empty() {
            let _ = write!(out, "_{{{sub}}}");
        }
        out
    })
}

/// A symbol in plain Unicode for a terminal: `θ₁`, `B₁₁`; where a subscript letter has no
/// character, as it was given.
pub fn symbol_plain(name: &str) -> String {
    let lower = |c: char| {
        let digits = ['₀', '₁', '₂', '₃', '₄', '₅', '₆', '₇', '₈', '₉'];
        match c {
            '0'..='9' => Some(digits[c as usize - '0' as usize]),
            'a' => Some('ₐ'),
            'e' => Some('ₑ'),
            'o' => Some('ₒ'),
            'r' => Some('ᵣ'),
            'x' => Some('ₓ'),
            _ => None,
        }
    };
    let mut out = String::new();
    for (base, sub) in parts(name) {
        let Some(sub) = sub.chars().map(lower).collect::<Option<String>>() else {
            // A Greek letter with an index as it was given: `τ_c1`; a column's `x_m` is its name.
            return match name.split_once('_') {
                Some((_, index)) if sub == index => format!("{base}_{index}"),
                _ => name.to_owned(),
            };
        };
        out.push_str(&base);
        out.push_str(&sub);
    }
    out
}

/// A law as it is typed, `-k x^2 sin(tau - psi)`, as people write it, `−k x² sin(τ − ψ)`; what is
/// no letter's name stays.
pub fn law_plain(text: &str) -> String {
    const LETTERS: [(&str, &str); 3] = [("pi", "π"), ("eps", "ε"), ("w", "ω")];
    const POWERS: [(&str, &str); 4] = [("^2", "²"), ("^3", "³"), ("^4", "⁴"), ("^5", "⁵")];
    let letter = |word: &str| match LETTERS.iter().find(|l| l.0 == word) {
        Some((_, letter)) => (*letter).to_owned(),
        None => {
            let (head, index) = word.split_at(word.find('_').unwrap_or(word.len()));
            let (name, digits) = head.split_at(head.find(|c: char| c.is_ascii_digit()).unwrap_or(head.len()));
            match parts(name).first() {
                Some((base, sub)) if sub.is_empty() => format!("{base}{digits}{index}"),
                _ => word.to_owned(),
            }
        }
    };
    let in_word = |c: char| c.is_alphanumeric() || c == '_';
    let (mut out, mut word) = (String::with_capacity(text.len()), String::new());
    for c in text.chars().chain(core::iter::once(' ')) {
        if in_word(c) {
            word.push(c);
            continue;
        }
        out.push_str(&letter(&std::mem::take(&mut word)));
        out.push(if c == '-' { '−' } else { c });
    }
    out.pop();
    POWERS.iter().fold(out, |out, (from, to)| out.replace(from, to))
}

/// A mark of a derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// None.
    None,
    /// By the drive's phase, `φ′`.
    Prime,
    /// Twice by it.
    DoublePrime,
    /// By time, `φ̇`.
    Dot,
    /// Twice by it.
    DoubleDot,
}

/// A symbol with a mark in plain Unicode: `φ₁″`, `φ̇₁`.
pub fn symbol_plain_marked(name: &str, mark: Mark) -> String {
    let symbol = symbol_plain(name);
    let mut letters = symbol.chars();
    let first = letters.next().map_or(String::new(), |c| c.to_string());
    // A dot stands above one letter; a word has it behind.
    let single = parts(name).len() == 1 && parts(name)[0].0.chars().count() == 1;
    let above = |dots: char, behind: char| {
        if single { format!("{first}{dots}{}", letters.as_str()) } else { format!("{symbol}{behind}") }
    };
    match mark {
        Mark::None => symbol,
        Mark::Prime => format!("{symbol}′"),
        Mark::DoublePrime => format!("{symbol}″"),
        Mark::Dot => above('\u{307}', '˙'),
        Mark::DoubleDot => above('\u{308}', '¨'),
    }
}

/// A symbol with a mark as MathML: `<msub><mi>φ</mi><mn>1</mn></msub>`.
pub fn symbol_mathml(name: &str, mark: Mark) -> String {
    let all = parts(name);
    let last = all.len() - 1;
    let of = |(i, (base, sub)): (usize, &(String, String))| {
        let mark = if i == last { mark } else { Mark::None };
        let base = format!("<mi>{}</mi>", escape(base));
        let base = match mark {
            Mark::Dot => format!("<mover>{base}<mo stretchy=false>˙</mo></mover>"),
            Mark::DoubleDot => format!("<mover>{base}<mo stretchy=false>¨</mo></mover>"),
            _ => base,
        };
        let prime = match mark {
            Mark::Prime => "<mo lspace=0 rspace=0>′</mo>",
            Mark::DoublePrime => "<mo lspace=0 rspace=0>″</mo>",
            _ => "",
        };
        let sub = format!("<mtext>{}</mtext>", escape(sub));
        match (sub.len() > "<mtext></mtext>".len(), prime.is_empty()) {
            (false, true) => base,
            (true, true) => format!("<msub>{base}{sub}</msub>"),
            // Browsers draw a prime in the place of an exponent too small to be read.
            (false, false) => format!("<mrow>{base}{prime}</mrow>"),
            (true, false) => format!("<mrow><msub>{base}{sub}</msub>{prime}</mrow>"),
        }
    };
    all.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbols_in_three_scripts() {
        assert_eq!(symbol_plain("theta1"), "θ₁");
        assert_eq!(symbol_plain("B11"), "B₁₁");
        assert_eq!(symbol_plain("J_o1"), "Jₒ₁");
        assert_eq!((symbol_plain("tau_c1").as_str(), symbol_plain("x_m").as_str()), ("τ_c1", "x_m"));
        assert_eq!(symbol_plain("m1e1"), "m₁e₁");
        assert_eq!(symbol_html("J_o1"), "<i>J</i><sub>o1</sub>");
        assert_eq!(symbol_html("a<b"), "a&lt;b");
        assert_eq!(symbol_svg("phi2"), "φ_{2}");
        assert_eq!(symbol_svg("position"), "position");
        assert_eq!(symbol_html("n_cos"), "<i>n</i><sub>cos</sub>");
        assert_eq!(symbol_plain_marked("phi1", Mark::DoublePrime), "φ₁″");
        assert_eq!(symbol_plain_marked("q", Mark::Dot), "q\u{307}");
        assert_eq!(symbol_plain_marked("position", Mark::DoubleDot), "position¨");
        assert_eq!(
            symbol_mathml("phi1", Mark::Prime),
            "<mrow><msub><mi>φ</mi><mtext>1</mtext></msub><mo lspace=0 rspace=0>′</mo></mrow>"
        );
        assert_eq!(symbol_mathml("a<b", Mark::None), "<mi>a&lt;b</mi>");
    }

    #[test]
    fn a_typed_law_as_people_write_it() {
        assert_eq!(law_plain("-tau_s exp(-(v/v_s)^2) sign v"), "−τ_s exp(−(v/v_s)²) sign v");
        assert_eq!(law_plain("-A cos(2 pi f t - psi), theta2(t)"), "−A cos(2 π f t − ψ), θ2(t)");
        assert_eq!(law_plain("-eps t/T_record, the base's x_b"), "−ε t/T_record, the base's x_b");
    }
}

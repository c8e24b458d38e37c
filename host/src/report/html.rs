//! Pieces of HTML. Whatever comes from a file goes through [`escape`]; [`Html`] marks what has.

use std::fmt;

use crate::wording::names::sentence;
pub use crate::wording::symbols::escape;

/// Escaped text in which what stands between backticks is set as code.
pub fn marked(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, code, after)) = split_code(rest) {
        out.push_str(&format!("{}<code>{}</code>", escape(&joined(before)), escape(code)));
        rest = after;
    }
    out.push_str(&escape(&joined(rest)));
    out
}

/// A text in which no line breaks behind a sign ±, before %, between the factors of a unit, or
/// within the brackets of a number with its interval.
fn joined(text: &str) -> String {
    const FACTORS: [&str; 5] = ["N", "m", "kg", "V", "A"];
    let words: Vec<&str> = text.split(' ').collect();
    let mut out = String::with_capacity(text.len());
    for (i, word) in words.iter().enumerate() {
        if i > 0 {
            let before = words[i - 1];
            let plain = word.trim_end_matches(['.', ',', ';', ':', ')']);
            let is_unit = |w: &str| w.starts_with(['m', 's', 'N', 'k']) && w.chars().count() <= 3 && !w.is_ascii();
            let is_factor = FACTORS.contains(&before) && (is_unit(plain) || FACTORS.contains(&plain) || plain == "s");
            let is_bracket = *word == "±" && before.starts_with('(');
            let is_one = plain == "%" || before == "±" || is_factor || is_bracket;
            out.push(if is_one { '\u{a0}' } else { ' ' });
        }
        out.push_str(word);
    }
    out
}

/// What stands before, between and behind a text's first two backticks.
fn split_code(text: &str) -> Option<(&str, &str, &str)> {
    let (before, rest) = text.split_once('`')?;
    let (code, after) = rest.split_once('`')?;
    Some((before, code, after))
}

/// HTML that may be written as it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Html(pub(crate) String);

impl fmt::Display for Html {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// How a column of a table is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Text.
    Left,
    /// Numbers.
    Right,
}

impl Html {
    /// Nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Escaped text.
    pub fn text(text: &str) -> Self {
        Self(escape(&joined(text)))
    }

    /// A parameter's symbol, see [`crate::wording::symbols::symbol_html`].
    pub fn symbol(name: &str) -> Self {
        Self(crate::wording::symbols::symbol_html(name))
    }

    /// Appends another piece.
    pub fn push(&mut self, other: &Self) -> &mut Self {
        self.0.push_str(&other.0);
        self
    }

    /// Escaped text with its code marked.
    pub fn marked(text: &str) -> Self {
        Self(marked(text))
    }

    /// Appends a paragraph: sentences, as plain text with its code between backticks.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.0.push_str(&format!("<p>{}</p>\n", marked(&sentence(text))));
        self
    }

    /// Appends a heading inside a section.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        self.0.push_str(&format!("<h3>{}</h3>\n", marked(text)));
        self
    }

    /// Appends a figure with caption and numbers.
    pub fn figure(&mut self, figure: &super::figures::Figure) -> &mut Self {
        self.0.push_str(&figure.html());
        self
    }

    /// Appends a table. `columns`: heading and alignment; rows of ready pieces, a short row ends
    /// with empty cells.
    pub fn table(&mut self, columns: &[(Html, Align)], rows: &[Vec<Html>]) -> &mut Self {
        let class = |a: Align| if a == Align::Right { " class=n" } else { "" };
        self.0.push_str("<div class=scroll><table><thead><tr>");
        for (heading, align) in columns {
            self.0.push_str(&format!("<th{}>{heading}</th>", class(*align)));
        }
        self.0.push_str("</tr></thead><tbody>\n");
        for row in rows {
            self.0.push_str("<tr>");
            for (i, (_, align)) in columns.iter().enumerate() {
                let empty = Html::new();
                self.0.push_str(&format!("<td{}>{}</td>", class(*align), row.get(i).unwrap_or(&empty)));
            }
            self.0.push_str("</tr>\n");
        }
        self.0.push_str("</tbody></table></div>\n");
        self
    }

    /// Appends a table of named bars from 0: heading of names and bars; name, value, the value in
    /// words. What is no number has no bar.
    pub fn bars(&mut self, heads: [&str; 2], bars: &[(String, f64, String)]) -> &mut Self {
        let most = bars.iter().map(|b| b.1).filter(|v| v.is_finite()).fold(0.0, f64::max);
        let [name, value] = heads.map(escape);
        self.0.push_str(&format!(
            "<div class=scroll><table class=bars><thead><tr><th>{name}</th><th>{value}</th></tr></thead><tbody>\n"
        ));
        for (name, value, label) in bars {
            let share = if *value > 0.0 && value.is_finite() && most > 0.0 { 100.0 * value / most } else { 0.0 };
            self.0.push_str(&format!(
                "<tr><td>{}</td><td><span class=bar><span style=\"width:{share:.1}%\"></span></span> {}</td></tr>\n",
                escape(name),
                escape(label)
            ));
        }
        self.0.push_str("</tbody></table></div>\n");
        self
    }

    /// Appends a list of name and value pairs, set in columns.
    pub fn facts(&mut self, facts: &[(&str, String)]) -> &mut Self {
        self.0.push_str("<dl class=facts>");
        for (name, value) in facts {
            self.0.push_str(&format!("<div><dt>{}</dt><dd>{}</dd></div>", escape(name), escape(value)));
        }
        self.0.push_str("</dl>\n");
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_from_a_file_becomes_markup() {
        let nasty = "<script>alert('x')</script>&\"\u{1}";
        assert_eq!(escape(nasty), "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;&amp;&quot;\u{fffd}");
        let mut h = Html::new();
        h.paragraph(nasty).heading(nasty).facts(&[(nasty, nasty.to_owned())]);
        h.table(&[(Html::text(nasty), Align::Left)], &[vec![Html::symbol(nasty)], vec![]]);
        assert!(!h.0.contains("<script"));
    }

    #[test]
    fn numbers_stay_with_their_signs_and_units() {
        let of = |text: &str| joined(text).replace('\u{a0}', "_");
        assert_eq!(of("to ± 0.3 %, of 95 % (7.5 ± 0.7)·10⁻⁴"), "to ±_0.3_%, of 95_% (7.5_±_0.7)·10⁻⁴");
        assert_eq!(of("0.05 N m s², 2 kg m², 3 N m s"), "0.05 N_m_s², 2 kg_m², 3 N_m_s");
        assert_eq!(of("A motion  of m and a"), "A motion  of m and a");
    }

    #[test]
    fn what_stands_between_backticks_is_code() {
        let mut h = Html::new();
        h.heading("The model by `whirl explain`").paragraph("run `a < b`, or one ` alone <i>");
        assert_eq!(
            h.0,
            "<h3>The model by <code>whirl explain</code></h3>\n<p>Run <code>a &lt; b</code>, or one ` alone &lt;i&gt;</p>\n"
        );
    }
}

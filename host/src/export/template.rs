//! Templates: `{{place}}` is replaced by a text, a part from a line `{{#part}}` to a line
//! `{{/part}}` stands only where a model needs it.

/// The template with its places filled and the parts that are wanted.
pub fn filled(template: &str, places: &[(&'static str, String)], sections: &[(&'static str, bool)]) -> String {
    let wanted = |name: &str| sections.iter().any(|s| s.0 == name && s.1);
    let mut out = String::new();
    // Names of the parts that are open, and whether each is wanted.
    let mut open: Vec<bool> = Vec::new();
    for line in template.lines() {
        let tag = line.trim().strip_prefix("{{").and_then(|l| l.strip_suffix("}}"));
        match tag.map(|t| (t.chars().next(), t)) {
            Some((Some('#'), t)) => open.push(wanted(&t[1..])),
            Some((Some('/'), _)) => drop(open.pop()),
            _ if open.iter().all(|w| *w) => {
                let text = replaced(line, places);
                // A place that is empty leaves no line behind.
                if !(text.trim().is_empty() && line.contains("{{")) {
                    out.push_str(text.trim_end());
                    out.push('\n');
                }
            }
            _ => {}
        }
    }
    out
}

/// A line with its places filled; what was filled in is not looked at again.
fn replaced(line: &str, places: &[(&'static str, String)]) -> String {
    let mut out = String::new();
    let mut rest = line;
    while let Some((before, from)) = rest.split_once("{{") {
        out.push_str(before);
        match from.split_once("}}") {
            Some((name, after)) => {
                out.push_str(places.iter().find(|p| p.0 == name).map_or("", |p| &p.1));
                rest = after;
            }
            None => {
                out.push_str("{{");
                rest = from;
            }
        }
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_filled_once_and_parts_stand_where_they_are_wanted() {
        let template = "a {{x}} b\n{{#no}}\nhidden {{x}}\n{{#yes}}\nhidden\n{{/yes}}\n{{/no}}\n{{#yes}}\nshown\n{{/yes}}\n{{empty}}\nend\n";
        let places = [("x", "{{y}}".to_owned()), ("y", "wrong".to_owned()), ("empty", String::new())];
        assert_eq!(filled(template, &places, &[("yes", true), ("no", false)]), "a {{y}} b\nshown\nend\n");
    }
}

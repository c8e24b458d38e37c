//! Makes the SVG that plotters writes small, without changing the picture: runs of equal circles
//! become one path of round dots, poly-lines become relative paths, attributes that only repeat a
//! default go. Sets `_{…}` as subscripts.
//!
//! It relies on the back end writing one tag a line with attributes in a fixed order; a line that
//! does not fit is passed on as it is.

/// Compacts a drawing. `alternative` is its text for readers that cannot show it.
pub fn compact(svg: &str, alternative: &str) -> String {
    let mut out = String::with_capacity(svg.len() / 2);
    let mut lines = svg.lines().peekable();
    while let Some(line) = lines.next() {
        if let Some(rest) = line.strip_prefix("<svg ") {
            let view = attribute(rest, "viewBox").unwrap_or("0 0 100 100");
            out.push_str(&format!(
                "<svg viewBox=\"{view}\" role=\"img\" aria-label=\"{}\" xmlns=\"http://www.w3.org/2000/svg\">\n",
                super::escape(alternative)
            ));
        } else if let Some((centre, style)) = circle(line) {
            let mut path = String::new();
            dot(&mut path, centre);
            while let Some(next) = lines.peek().and_then(|l| circle(l)).filter(|(_, s)| *s == style) {
                dot(&mut path, next.0);
                lines.next();
            }
            let (radius, colour, opacity) = style;
            out.push_str(&format!(
                "<path d=\"{path}\" stroke=\"{colour}\" stroke-width=\"{}\" stroke-linecap=\"round\"{} fill=\"none\"/>\n",
                2 * radius,
                opacity_attribute(opacity),
            ));
        } else if line.starts_with("<polyline ") {
            out.push_str(&polyline(line).unwrap_or_else(|| line.to_owned()));
            out.push('\n');
        } else if line.starts_with("<text ") {
            let open = line.replace(" opacity=\"1\"", "").replace(" font-family=\"sans-serif\"", "");
            let text = lines.next().unwrap_or("");
            out.push_str(&open);
            out.push_str(&tspans(text, attribute(line, "font-size").and_then(|s| s.parse().ok()).unwrap_or(12.0)));
        } else {
            out.push_str(&line.replace(" opacity=\"1\"", "").replace(" stroke=\"none\"", ""));
            out.push('\n');
        }
    }
    out
}

/// Value of an attribute in a tag.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let start = tag.find(&format!("{name}=\""))? + name.len() + 2;
    let tail = &tag[start..];
    tail.find('"').map(|end| &tail[..end])
}

fn opacity_attribute(opacity: &str) -> String {
    if opacity == "1" { String::new() } else { format!(" opacity=\"{opacity}\"") }
}

/// A point in the drawing's units.
type Point = (i64, i64);

/// A filled circle: centre and (radius, colour, opacity).
fn circle(line: &str) -> Option<(Point, (i64, &str, &str))> {
    let rest = line.strip_prefix("<circle ")?;
    let number = |name: &str| attribute(rest, name)?.parse::<i64>().ok();
    let colour = attribute(rest, "fill").filter(|f| *f != "none")?;
    // `cx` and `cy` come first, so the first `r="` after them is the radius.
    let radius = attribute(&rest[rest.find(" r=")?..], "r")?.parse().ok()?;
    Some(((number("cx")?, number("cy")?), (radius, colour, attribute(rest, "opacity")?)))
}

fn dot(path: &mut String, (x, y): Point) {
    path.push_str(&format!("M{x} {y}h0"));
}

/// A relative path; points that repeat the one before are left out.
fn polyline(line: &str) -> Option<String> {
    let points = attribute(line, "points")?;
    let mut path = String::new();
    let mut before: Option<Point> = None;
    for point in points.split_whitespace() {
        let (x, y) = point.split_once(',')?;
        let (x, y): (i64, i64) = (x.parse().ok()?, y.parse().ok()?);
        match before {
            None => path.push_str(&format!("M{x} {y}l")),
            Some(b) if b == (x, y) => continue,
            Some((bx, by)) => {
                let (dx, dy) = (x - bx, y - by);
                let space = if path.ends_with('l') || dx < 0 { "" } else { " " };
                let comma = if dy < 0 { "" } else { " " };
                path.push_str(&format!("{space}{dx}{comma}{dy}"));
            }
        }
        before = Some((x, y));
    }
    if path.ends_with('l') {
        path.push_str("0 0");
    }
    let (colour, width, opacity) =
        (attribute(line, "stroke")?, attribute(line, "stroke-width")?, attribute(line, "opacity")?);
    Some(format!(
        "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"{}/>",
        opacity_attribute(opacity)
    ))
}

/// Subscripts as smaller, lowered spans; what follows returns to the line.
fn tspans(text: &str, size: f64) -> String {
    let drop = (0.28 * size).round();
    let mut out = String::new();
    let mut rest = text;
    let mut lowered = false;
    while let Some((before, after)) = rest.split_once("_{") {
        let (sub, tail) = after.split_once('}').unwrap_or((after, ""));
        push_span(&mut out, before, lowered, drop);
        out.push_str(&format!("<tspan dy=\"{drop}\" font-size=\"{}\">{sub}</tspan>", (0.74 * size).round()));
        lowered = true;
        rest = tail;
    }
    push_span(&mut out, rest, lowered, drop);
    out
}

fn push_span(out: &mut String, text: &str, lowered: bool, drop: f64) {
    if text.is_empty() {
        return;
    }
    if lowered {
        out.push_str(&format!("<tspan dy=\"-{drop}\">{text}</tspan>"));
    } else {
        out.push_str(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_join_and_lines_become_relative() {
        let dot = |x, c| {
            format!(
                "<circle cx=\"{x}\" cy=\"7\" r=\"3\" opacity=\"1\" fill=\"{c}\" stroke=\"none\" stroke-width=\"1\"/>\n"
            )
        };
        let svg = format!(
            "<svg width=\"9\" height=\"9\" viewBox=\"0 0 9 9\" xmlns=\"x\">\n{}{}{}<polyline fill=\"none\" opacity=\"1\" \
             stroke=\"#000000\" stroke-width=\"2\" points=\"1,2 3,1 3,1 2,8 \"/>\n</svg>\n",
            dot(1, "#111111"),
            dot(5, "#111111"),
            dot(6, "#222222"),
        );
        let small = compact(&svg, "a \"b\"");
        assert!(small.contains("d=\"M1 7h0M5 7h0\" stroke=\"#111111\" stroke-width=\"6\""), "{small}");
        assert!(small.contains("d=\"M6 7h0\" stroke=\"#222222\""));
        assert!(small.contains("d=\"M1 2l2-1-1 7\""), "{small}");
        assert!(small.contains("aria-label=\"a &quot;b&quot;\""));
    }

    #[test]
    fn subscripts_return_to_the_line() {
        assert_eq!(
            tspans("φ_{1} / rad", 20.0),
            "φ<tspan dy=\"6\" font-size=\"15\">1</tspan><tspan dy=\"-6\"> / rad</tspan>"
        );
        assert_eq!(tspans("plain", 20.0), "plain");
        assert_eq!(tspans("x_{un", 20.0), "x<tspan dy=\"6\" font-size=\"15\">un</tspan>");
    }
}

//! Self-contained offline reports: one HTML file with inline SVG, nothing fetched, the same bytes
//! every time. One small script within it reads out and enlarges figures; the page is whole without
//! it.
//!
//! Results go into [`Results`] as the analyses return them; [`Report::of`] runs every registered
//! section ([`sections::SECTIONS`]) over them, and a section whose result is not there leaves
//! itself out. A new section is one file in `sections/` and one line there.

pub mod card;
pub mod figures;
pub mod html;
pub mod sections;

use std::any::Any;
use std::path::Path;

use askama::Template;
use serde::Serialize;

use crate::error::{BadInput, Result};
use html::Html;

/// The results that a report prints: anything that serialises, found again by its type.
#[derive(Default)]
pub struct Results(Vec<Box<dyn Any + Send + Sync>>);

impl Results {
    /// None yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a result; several of one type (one for each record) stay in order.
    pub fn add<T: Serialize + Any + Send + Sync>(&mut self, result: T) -> &mut Self {
        self.0.push(Box::new(result));
        self
    }

    /// All results of a type, in the order in which they were added.
    pub fn all<T: Any>(&self) -> impl Iterator<Item = &T> {
        self.0.iter().filter_map(|r| r.downcast_ref())
    }

    /// The first result of a type.
    pub fn get<T: Any>(&self) -> Option<&T> {
        self.all().next()
    }
}

/// A rendered section.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// Anchor: lower-case letters, digits and hyphens.
    pub id: String,
    /// Heading.
    pub title: String,
    /// Content.
    pub body: Html,
}

/// A registered kind of section: renders from the results, or leaves itself out.
pub struct SectionKind {
    /// Anchor of the section.
    pub id: &'static str,
    /// Heading of the section.
    pub title: &'static str,
    /// Renders its content from the results; None where there is nothing of it.
    pub render: fn(&Results) -> Option<Html>,
}

/// A report under construction.
#[derive(Clone, Debug, Default)]
pub struct Report {
    title: String,
    subtitle: String,
    facts: Vec<(String, String)>,
    sections: Vec<Section>,
}

#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    title: &'a str,
    subtitle: &'a str,
    facts: &'a [(String, String)],
    sections: &'a [Section],
    /// The section that the contents stand behind; none where they open the page.
    answer: Option<&'a String>,
    contents: String,
    version: &'static str,
    style: &'static str,
    script: &'static str,
}

impl Report {
    /// An empty report.
    pub fn new(title: impl Into<String>, subtitle: impl Into<String>) -> Self {
        Self { title: title.into(), subtitle: subtitle.into(), ..Self::default() }
    }

    /// A report of all registered sections that have something to say about these results.
    pub fn of(title: impl Into<String>, subtitle: impl Into<String>, results: &Results) -> Self {
        let mut report = Self::new(title, subtitle);
        for kind in sections::SECTIONS {
            if let Some(body) = (kind.render)(results) {
                report.push(Section { id: kind.id.to_owned(), title: kind.title.to_owned(), body });
            }
        }
        report
    }

    /// Adds a line to the summary at the top: what a reader wants to know first.
    pub fn fact(&mut self, name: impl Into<String>, value: impl Into<String>) -> &mut Self {
        self.facts.push((name.into(), value.into()));
        self
    }

    /// Appends a section.
    pub fn push(&mut self, section: Section) -> &mut Self {
        self.sections.push(section);
        self
    }

    /// Links to the sections; none where there is one only.
    fn contents(&self) -> String {
        if self.sections.len() < 2 {
            return String::new();
        }
        let link = |s: &Section| format!("<a href=\"#{}\">{}</a>", html::escape(&s.id), html::escape(&s.title));
        format!("\n<nav>{}</nav>", self.sections.iter().map(link).collect::<String>())
    }

    /// The whole document.
    ///
    /// # Errors
    /// None in practice: writing into memory cannot fail; a formatter's error is passed on.
    pub fn render(&self) -> Result<String> {
        Page {
            title: &self.title,
            subtitle: &self.subtitle,
            facts: &self.facts,
            sections: &self.sections,
            answer: self.sections.first().map(|s| &s.id).filter(|id| *id == "answer"),
            contents: self.contents(),
            version: env!("CARGO_PKG_VERSION"),
            style: include_str!("../../templates/report.css"),
            script: include_str!("../../templates/report.js"),
        }
        .render()
        // The template engine takes the last line break away.
        .map(|page| page + "\n")
        .map_err(|e| BadInput::new(format!("the report cannot be rendered: {e}"), ""))
    }

    /// Writes the document, whole or not at all (through a temporary file beside it).
    ///
    /// # Errors
    /// Names the file and what the operating system says.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let text = self.render()?;
        crate::files::write_file(path, text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_found_by_type_and_in_order() {
        let mut r = Results::new();
        r.add(1u32).add("text".to_owned()).add(2u32);
        assert_eq!(r.all::<u32>().copied().collect::<Vec<_>>(), [1, 2]);
        assert_eq!(r.get::<String>().map(String::as_str), Some("text"));
        assert!(r.get::<i64>().is_none());
    }

    #[test]
    fn a_page_is_escaped_self_contained_and_the_same_every_time() {
        let mut report = Report::new("a <b> & c", "record \"x\".csv");
        report.fact("samples", "60 000 <i>");
        report.push(Section { id: "one".into(), title: "One & two".into(), body: Html::text("<body>") });
        let page = report.render().unwrap();
        assert!(
            page.contains("<title>a &#60;b&#62; &#38; c</title>")
                || page.contains("<title>a &lt;b&gt; &amp; c</title>")
        );
        assert!(!page.contains("<i>") && page.contains("&lt;body&gt;"));
        assert_eq!(page.matches("<script>").count(), 1);
        for fetched in ["<script ", "http-equiv", "<link", "src=", "@import", "url("] {
            assert!(!page.contains(fetched), "{fetched}");
        }
        assert_eq!(page, report.render().unwrap());
    }

    #[test]
    fn writes_whole_or_tells_why_not() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("report.html");
        Report::new("t", "s").write(&file).unwrap();
        assert!(std::fs::read_to_string(&file).unwrap().ends_with("</html>\n"));
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let error = Report::new("t", "s").write(dir.path().join("no/such/folder.html")).unwrap_err();
        assert!(error.to_string().contains("no/such/folder.html"));
    }
}

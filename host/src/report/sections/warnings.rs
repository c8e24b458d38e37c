//! What was noticed, and what to do about it.

use serde::Serialize;

use crate::inspect::Inspection;
use crate::report::html::{Html, escape, marked};
use crate::report::{Results, SectionKind};
use crate::warning::Warning;
use crate::wording::names::sentence;

/// Warnings of an analysis other than the inspection.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Warnings {
    /// The warnings.
    pub warnings: Vec<Warning>,
}

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "warnings", title: "Warnings", render };

fn render(results: &Results) -> Option<Html> {
    let of_records =
        results.all::<Inspection>().flat_map(|i| i.warnings.iter().map(move |w| (Some(&i.record.file), w)));
    let others = results.all::<Warnings>().flat_map(|w| w.warnings.iter().map(|w| (None, w)));
    let mut all: Vec<_> = of_records.chain(others).collect();
    all.sort_by_key(|(_, w)| !w.invalidates);
    let mut seen: Vec<&Warning> = Vec::new();
    let mut body = Html::new();
    let several = results.all::<Inspection>().count() > 1;
    for (file, warning) in all {
        if seen.contains(&warning) {
            continue;
        }
        seen.push(warning);
        let place = file.filter(|_| several).map_or(String::new(), |f| format!("{}: ", escape(f)));
        body.0.push_str(&format!(
            "<div class=warning><b>{place}{}</b>{}</div>\n",
            marked(&if place.is_empty() { sentence(&warning.text) } else { warning.text.clone() }),
            marked(&sentence(&warning.advice))
        ));
    }
    (!seen.is_empty()).then_some(body)
}

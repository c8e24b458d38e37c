//! Where an answer comes from: command, rig, model, records with their checksums, version, seed.

use serde::Serialize;

use crate::explain::ledger::checksum;
use crate::record::Record;
use crate::report::html::Html;
use crate::report::{Results, SectionKind};
use crate::wording::format::count;

/// What an answer was made from. No date: the same input gives the same bytes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Provenance {
    /// Name and value of each fact.
    pub facts: Vec<(String, String)>,
}

impl Provenance {
    /// Of this command: `explain`, `identify`, …
    pub fn of(command: &str) -> Self {
        let fact = |name: &str, value: String| (name.to_owned(), value);
        let version = format!("whirl {}", env!("CARGO_PKG_VERSION"));
        Self { facts: vec![fact("command", format!("whirl {command}")), fact("version", version)] }
    }

    /// With a fact.
    pub fn with(mut self, name: &str, value: impl std::fmt::Display) -> Self {
        self.facts.push((name.to_owned(), value.to_string()));
        self
    }

    /// With records: file, samples, CRC-32 of the samples' bytes.
    pub fn records(self, records: &[Record]) -> Self {
        records.iter().fold(self, |all, r| {
            let told =
                format!("{} ({} samples, CRC-32 {:08x})", r.path.display(), count(r.samples() as u64), checksum(r));
            all.with("record", told)
        })
    }
}

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "provenance", title: "Where this comes from", render };

fn render(results: &Results) -> Option<Html> {
    let all = results.get::<Provenance>()?;
    let mut body = Html::new();
    let facts: Vec<(&str, String)> = all.facts.iter().map(|(n, v)| (n.as_str(), v.clone())).collect();
    body.facts(&facts);
    Some(body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_are_told() {
        let mut results = Results::new();
        results.add(Provenance::of("explain a.csv").with("rig file", "rig <1>.toml"));
        let html = render(&results).unwrap().0;
        assert!(html.contains("whirl explain a.csv") && html.contains("rig &lt;1&gt;.toml"), "{html}");
    }
}

//! The next experiment: what to set, for how long, and what it will tell.

use crate::plan::{Plan, presentation};
use crate::report::html::Html;
use crate::report::{Results, SectionKind};

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "next", title: "The next experiment", render };

fn render(results: &Results) -> Option<Html> {
    let plan = results.get::<Plan>()?;
    let mut body = Html::new();
    // The section's title says what it is.
    body.paragraph(&presentation::line(plan).unwrap_or_else(|| presentation::headline(plan)));
    Some(body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_without_a_proposal_says_so() {
        let mut results = Results::new();
        assert!(render(&results).is_none());
        results.add(Plan {
            rig: "a rig".into(),
            goals: Default::default(),
            best: None,
            unchanged: None,
            others: Vec::new(),
            wider: 1.0,
            map: Vec::new(),
            seed: 1,
        });
        let html = render(&results).unwrap().0;
        assert!(html.contains("a rig: no setting was found"), "{html}");
    }
}

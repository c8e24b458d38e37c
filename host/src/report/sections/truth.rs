//! The truth of a simulated rig beside what was found without knowing it: a demonstration's last
//! table.

use serde::Serialize;

use super::parameters::{self, ParameterTable};
use crate::report::html::Html;
use crate::report::{Results, SectionKind};

/// What a simulated rig was made of.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Truth {
    /// Identified parameters with their true values.
    pub table: ParameterTable,
    /// Effects that the rig has and the identified model does not.
    pub hidden: Vec<String>,
}

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "truth", title: "The truth", render };

fn render(results: &Results) -> Option<Html> {
    let truth = results.get::<Truth>()?;
    let mut body = Html::new();
    body.paragraph("The simulated rig's own parameters, read only after every number above was there.");
    if !truth.hidden.is_empty() {
        body.paragraph(&format!(
            "Hidden in the rig: {}. Below are the parameters of the last model; σ is the standard error.",
            truth.hidden.join(", ")
        ));
    }
    let mut table = truth.table.clone();
    table.notes.clear();
    parameters::one(&mut body, &table);
    Some(body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::sections::parameters::Parameter;

    #[test]
    fn the_truth_is_told_with_what_was_hidden() {
        let mut results = Results::new();
        assert!(render(&results).is_none());
        let parameter =
            Parameter { name: "C2".into(), value: 0.0486, std_error: 1e-5, unit: "1".into(), truth: Some(0.0485) };
        let table = ParameterTable { parameters: vec![parameter], ..ParameterTable::default() };
        results.add(Truth { table, hidden: vec!["quadratic-drag@arm2=2e-7".into()] });
        let html = render(&results).unwrap().0;
        assert!(html.contains("quadratic-drag@arm2=2e-7") && html.contains("0.04850"), "{html}");
    }
}

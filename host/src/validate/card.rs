//! The card of a validation: see [`crate::report::card`].

use super::{Validation, Verdict};
use crate::explain::card::equations;
use crate::model::identified::IdentifiedModel;
use crate::report::card::{Card, CardRow};
use crate::report::format::significant;
use crate::report::names;
use crate::rig::Rig;

/// The card of a validation of a model on a rig.
pub fn card(v: &Validation, model: &IdentifiedModel, rig: &Rig) -> Card {
    let equations = equations(model, rig);
    let own = model.parameters.iter().map(|p| CardRow {
        symbol: p.name.clone(),
        plain: names::parameter(&p.name).unwrap_or_default().to_owned(),
        before: None,
        after: (p.value, p.std_error),
        unit: if p.unit == "1" { String::new() } else { p.unit.clone() },
    });
    let effects = model.effects.iter().map(|e| CardRow {
        symbol: String::new(),
        plain: names::effect(&e.name()),
        before: None,
        after: (e.value, e.std_error),
        unit: e.unit.clone(),
    });
    let failed = v.checks.iter().filter(|c| !c.passed);
    Card {
        verdict: sentence(v),
        equations,
        parameters: own.chain(effects).collect(),
        undecided: failed.map(|c| format!("Failed: {}: {}.", c.name, c.message.trim_end_matches('.'))).collect(),
        ..Card::default()
    }
}

/// Whether the model moves as the record does, and how long its predictions hold.
fn sentence(v: &Validation) -> String {
    let passed = v.checks.iter().filter(|c| c.passed).count();
    let verdict = match v.verdict {
        Verdict::Passed => "The model moves as the measured system does",
        Verdict::Failed => "The model does not move as the measured system does",
    };
    format!(
        "{verdict} ({passed} of {} check{} passed); its predictions stay within {} of the record for {} s (median), where those of its own records do for {} s.",
        v.checks.len(),
        if v.checks.len() == 1 { "" } else { "s" },
        v.horizon.within,
        significant(v.horizon.measured.median(), 3),
        significant(v.horizon.simulated.median(), 3)
    )
}

//! The card of a validation: see [`crate::report::card`].

use super::horizon::Horizon;
use super::{Validation, Verdict};
use crate::explain::card::equations;
use crate::model::identified::IdentifiedModel;
use crate::report::card::{Card, CardRow};
use crate::rig::Rig;
use crate::wording::format::significant;
use crate::wording::names;

/// The card of a validation of a model on a rig.
pub fn card(v: &Validation, model: &IdentifiedModel, rig: &Rig) -> Card {
    let equations = equations(model, rig);
    let own = model.parameters.iter().map(|p| CardRow::of(p, equations.as_ref(), rig));
    let effects = model.effects.iter().map(|e| CardRow {
        symbol: String::new(),
        plain: names::effect(&e.name()),
        before: None,
        after: (e.value, e.std_error),
        unit: e.unit.clone(),
    });
    let parameters = own.chain(effects).collect();
    let failed = v.checks.iter().filter(|c| !c.passed);
    let failed = failed.map(|c| format!("{}: {}.", c.name, c.message.trim_end_matches('.')));
    Card { verdict: sentence(v), equations, parameters, failed: failed.collect(), ..Card::default() }
}

/// Whether the model moves as the record does, and how long its predictions hold.
fn sentence(v: &Validation) -> String {
    let passed = v.checks.iter().filter(|c| c.passed).count();
    let verdict = match v.verdict {
        Verdict::Passed => "The model moves as the measured system does",
        Verdict::Failed => "The model does not move as the measured system does",
    };
    let h = &v.horizon;
    let lasts = |of: &Horizon| {
        let to_the_end = 2 * of.unended > of.seconds.len();
        format!("{} s (median{})", significant(of.median(), 3), if to_the_end { ", most to its end" } else { "" })
    };
    format!(
        "{verdict} ({passed} of {} check{} passed); its predictions stay within {} of the record for {}, of a record of its own for {}.",
        v.checks.len(),
        if v.checks.len() == 1 { "" } else { "s" },
        h.within,
        lasts(&h.measured),
        lasts(&h.simulated)
    )
}

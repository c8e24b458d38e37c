//! Parameters and quantities of a system behind the coefficients that were identified:
//! [`crate::system::ties`].

use super::Parameter;
use crate::model::model_file::ModelFile;
use crate::rig::Rig;
use crate::system::ties::{self, Identified};
use crate::warning::Warning;
use crate::wording::names::listed;

/// Id of the warning about what stays open.
pub const OPEN: &str = "undetermined";

/// Adds the parameters and quantities to those reported; the ties' misfit with its degrees of
/// freedom, where there are any.
pub fn add(
    rig: &Rig,
    model: &ModelFile,
    identified: &Identified<'_>,
    parameters: &mut Vec<Parameter>,
    warnings: &mut Vec<Warning>,
) -> Option<(f64, usize)> {
    let mechanism = model.mechanism.as_ref()?;
    let known = mechanism.known(&rig.known, rig.says_gravity());
    let fit = ties::fit(mechanism, identified, &known)?;
    parameters.extend(fit.found);
    if !fit.undetermined.is_empty() {
        let advice = match fit.wanted {
            Some((name, follow)) if !follow.is_empty() => format!(
                "Put what you weighed or measured into the rig file, under [known]: with {name} given, {} {}",
                listed(&follow),
                if follow.len() == 1 { "follows" } else { "follow" }
            ),
            _ => {
                "Put what you weighed or measured of them into the rig file, under [known]; the other values do not depend on it".to_owned()
            }
        };
        warnings.push(Warning::new(
            OPEN,
            format!("the record and what the rig file knows do not determine {}", fit.undetermined.join(", ")),
            advice,
        ));
    }
    (fit.freedom > 0).then_some((fit.misfit, fit.freedom))
}

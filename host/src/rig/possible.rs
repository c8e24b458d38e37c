//! Values of a system file's quantities that no rig has: a mass or an inertia below 0.

use std::path::Path;

use toml::de::{DeTable, DeValue};

use crate::error::{BadInput, Result};
use crate::model::model_file::units::Unit;
use crate::system::mechanism::Mechanism;
use crate::wording::toml_words;

/// Units of what is never below 0. A length may be: an offset to one side or the other.
const NEVER_NEGATIVE: [&str; 2] = ["kg", "kg m^2"];

/// Refuses a mass or an inertia below 0 in a table of a rig file; `values` by name, in its order.
///
/// # Errors
/// Names file, line, value and what is expected.
pub(crate) fn check<'a>(
    (path, text): (&Path, &str),
    table: &str,
    mechanism: &Mechanism,
    mut values: impl Iterator<Item = (&'a str, f64)>,
) -> Result<()> {
    let unit = |name: &str| {
        let own = mechanism.parameters.iter().map(|p| (&p.name, &p.unit));
        own.chain(mechanism.quantities.iter().map(|q| (&q.name, &q.unit))).find(|(n, _)| *n == name).map(|u| u.1)
    };
    let fixed = |name: &str| {
        let unit = unit(name)?;
        NEVER_NEGATIVE.into_iter().find(|text| Unit::parse(text).as_ref() == Some(unit))
    };
    match values.find_map(|(name, value)| Some((name, value, fixed(name).filter(|_| value < 0.0)?))) {
        None => Ok(()),
        Some((name, value, unit)) => {
            let what = if unit == "kg" { "a mass" } else { "an inertia" };
            let line = line(text, table, name).map_or_else(String::new, |l| format!(", {l}"));
            Err(BadInput::new(value.to_string(), format!("{what} of 0 or more in {}", unit.replace("^2", "²")))
                .in_file(path)
                .at(format!("{table}.{name}{line}"))
                .remedy("Correct the value: no body has less than none of it"))
        }
    }
}

/// "line L, column C" of a key of a table.
fn line(text: &str, table: &str, key: &str) -> Option<String> {
    let whole = DeTable::parse(text).ok()?;
    let DeValue::Table(inner) = whole.get_ref().get(table)?.get_ref() else { return None };
    Some(toml_words::place(text, inner.get(key)?.span().start))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;
    use crate::rig::choices::Choices;

    #[test]
    fn a_mass_or_an_inertia_below_nothing_is_refused_with_its_line() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs");
        let path = folder.join("double-pendulum-from-bodies.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let known = |from: &str, to: &str| {
            let text = text.replacen(from, to, 1);
            Rig::of_text(&text, &path, &Choices::default(), &mut |_| Ok(None))
        };
        assert!(known("m2 = 0.040", "m2 = 0.041").is_ok());
        // Joint to centroid on the other side.
        assert!(known("e2 = 0.0267", "e2 = -0.0267").is_ok());
        let e = known("m2 = 0.040", "m2 = -0.040").unwrap_err().to_string();
        assert!(e.contains("known.m2, line 2") && e.contains("found -0.04, expected a mass of 0 or more in kg"), "{e}");
        let e = known("m2 = 0.040", "J_o2 = -1e-5").unwrap_err().to_string();
        assert!(e.contains("known.J_o2, line ") && e.contains("an inertia of 0 or more in kg m²"), "{e}");
        let rig = known("J_1 = 4.3771e-4", "J_1 = -4.3771e-4").unwrap();
        let bound = rig.bound.clone().unwrap();
        let plant = crate::model::model_file::simulation::plant::Plant::of(&rig, &bound.model, 1.0, 1);
        let e = plant.unwrap_err().to_string();
        assert!(e.contains("plant.J_1, line 3") && e.contains("an inertia of 0 or more"), "{e}");
    }
}

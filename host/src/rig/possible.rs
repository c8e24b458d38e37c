//! Values of a system file's quantities that no rig has: a mass or an inertia below 0, and an arm's
//! inertia below that of its mass in its centroid.

use std::path::Path;

use toml::de::{DeTable, DeValue};

use crate::error::{BadInput, Result};
use crate::model::model_file::units::Unit;
use crate::system::bodies::Body;
use crate::system::mechanism::{Mechanism, at};
use crate::wording::format::significant;
use crate::wording::toml_words;

/// Units of what is never below 0. A length may be: an offset to one side or the other.
const NEVER_NEGATIVE: [&str; 2] = ["kg", "kg m^2"];

/// Share by which an arm's inertia may lie below m e²: rounded values of a mass at a point.
const ROUNDED: f64 = 1e-3;

/// Refuses a mass or an inertia below 0 in a table of a rig file, and the inertia of an arm that is
/// below m e², where all of them stand there; `values` by name, in its order.
///
/// # Errors
/// Names file, line, value and what is expected.
pub(crate) fn check<'a>(
    (path, text): (&Path, &str),
    table: &str,
    mechanism: &Mechanism,
    values: impl Iterator<Item = (&'a str, f64)>,
) -> Result<()> {
    let unit = |name: &str| {
        let own = mechanism.parameters.iter().map(|p| (&p.name, &p.unit));
        own.chain(mechanism.quantities.iter().map(|q| (&q.name, &q.unit))).find(|(n, _)| *n == name).map(|u| u.1)
    };
    let fixed = |name: &str| {
        let unit = unit(name)?;
        NEVER_NEGATIVE.into_iter().find(|text| Unit::parse(text).as_ref() == Some(unit))
    };
    let values: Vec<(&str, f64)> = values.collect();
    match values.iter().find_map(|(name, value)| Some((*name, *value, fixed(name).filter(|_| *value < 0.0)?))) {
        None => arms(path, table, mechanism, &values),
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

/// Refuses an arm whose inertia about its end is below that of its mass in its centroid.
fn arms(path: &Path, table: &str, mechanism: &Mechanism, values: &[(&str, f64)]) -> Result<()> {
    let value = |name: &str| values.iter().find(|v| v.0 == name).map_or(f64::NAN, |v| v.1);
    let parameters: Vec<f64> = mechanism.parameters.iter().map(|p| value(&p.name)).collect();
    for body in mechanism.file.iter().flat_map(|f| &f.bodies) {
        let Body::Arm { name, mass, first_moment, inertia, .. } = &body.value else { continue };
        let [mass, moment, inertia] = [mass, first_moment, inertia].map(|p| at(p, &parameters));
        let least = moment * moment / mass;
        // What is not given is no number, and less than nothing.
        if mass > 0.0 && inertia < (1.0 - ROUNDED) * least {
            let told = |x: f64| significant(x, 4);
            let found = format!("an inertia of {name} about its end of {} kg m²", told(inertia));
            let expected =
                format!("{} kg m² or more, what its mass of {} kg has in its centroid, m e²", told(least), told(mass));
            return Err(BadInput::new(found, expected)
                .in_file(path)
                .at(table)
                .remedy("Correct one of them: the inertia is that about the end, J = J_centroid + m e²"));
        }
    }
    Ok(())
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
        let plant = |to: &str| {
            let rig = known("J_1 = 4.3771e-4", to).unwrap();
            let bound = rig.bound.clone().unwrap();
            let plant = crate::model::model_file::simulation::plant::Plant::of(&rig, &bound.model, 1.0, 1);
            plant.map(|_| ()).map_err(|e| e.to_string())
        };
        let e = plant("J_1 = -4.3771e-4").unwrap_err();
        assert!(e.contains("plant.J_1, line 3") && e.contains("an inertia of 0 or more"), "{e}");
        assert_eq!(plant("J_1 = 4.3771e-4"), Ok(()));
        let e = plant("J_1 = 1e-7").unwrap_err();
        assert!(e.contains("1.000·10⁻⁷ kg m², expected") && e.contains("kg m² or more, what its mass of"), "{e}");
    }
}

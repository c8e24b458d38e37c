//! An identification as a model file (`identify -o`), and whether a model file is that of a
//! built-in system.

use std::collections::BTreeMap;

use super::{Identification, Parameter};
use crate::error::{BadInput, Result};
use crate::model::damping::Damping;
use crate::model::double_pendulum::{Base, DAMPINGS, coefficients};
use crate::model::identified::{IdentifiedModel, System};
use crate::model::model_file::ModelFile;
use crate::model::model_file::toml_place::MODEL_PAGE;
use crate::rig::Rig;
use crate::system::library::Pendulum;
use crate::wording::toml_words;

/// The identified coefficients as a model file; derived and physical parameters stay with the
/// identification.
///
/// # Errors
/// A nominal damping that there is not.
pub fn identified_model(result: &Identification, rig: &Rig) -> Result<IdentifiedModel> {
    // In the order in which the identification tells them.
    let found = result.parameters.iter().filter(|p| result.correlation_names.contains(&p.name)).cloned();
    // What a harmonic balance took as known belongs to the model all the same.
    let known = result.balance.iter().flat_map(|b| &b.settings.known).map(|(name, value)| Parameter {
        name: name.clone(),
        value: *value,
        std_error: 0.0,
        unit: "1".to_owned(),
    });
    let coefficients = found.chain(known);
    let (system, nominal) = match &rig.bound {
        None => (System::BuiltIn(result.model.clone()), super::system::System::of(rig)?.nominal()),
        Some(bound) => (System::Own(own_keys(&bound.model)?), Vec::new()),
    };
    Ok(IdentifiedModel {
        name: rig.name.clone(),
        system,
        method: result.method.clone(),
        drive_frequency_hz: rig.drive.map(|d| d.frequency_hz),
        nominal,
        parameters: coefficients.collect(),
        effects: Vec::new(),
        found_with: BTreeMap::new(),
    })
}

/// The keys that define a system of one's own.
pub fn own_keys(model: &ModelFile) -> Result<toml::Table> {
    let table: toml::Table = toml::from_str(&model.source.text).map_err(|e| {
        toml_words::told(&e, &model.source.text, "a model file", MODEL_PAGE).in_file(&model.source.path)
    })?;
    Ok(table.into_iter().filter(|(k, _)| ["coordinates", "inputs", "time", "equation"].contains(&k.as_str())).collect())
}

/// Checks that a model file is one of the built-in double pendulum: its dampings and coefficients.
///
/// # Errors
/// Another model, a damping that there is not, a parameter that is missing or does not belong to
/// the equations. Without the file's name.
pub fn check_double_pendulum(model: &IdentifiedModel) -> Result<()> {
    let double = Pendulum::Double;
    match &model.system {
        _ if model.system.pendulum() == Some(double) => {}
        System::BuiltIn(id) => {
            return Err(BadInput::new(format!("\"{id}\""), format!("\"{}\"", double.id())).at("model"));
        }
        System::Own(_) => {
            return Err(BadInput::new("a system of one's own", format!("model = \"{}\"", double.id())).at("model"));
        }
    }
    let used = Damping::chosen(model.nominal.iter().map(String::as_str), DAMPINGS).map_err(|e| e.at("nominal"))?;
    let base = match (model.parameter("B16"), model.drive_frequency_hz) {
        (Some(_), _) => Base::Measured,
        (None, Some(_)) => Base::Driven,
        (None, None) => Base::Resting,
    };
    let names = coefficients(base, &used).concat();
    if let Some(p) = model.parameters.iter().find(|p| !names.contains(&p.name)) {
        return Err(BadInput::new("a parameter that the equations do not have", names.join(", "))
            .at(format!("parameters.{}", p.name)));
    }
    match names.iter().find(|n| model.parameter(n).is_none()) {
        Some(name) => Err(BadInput::new(format!("no {name}"), names.join(", ")).at(format!("parameters.{name}"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_written_in_the_order_in_which_they_are_told() {
        let rig = Rig::read(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml")).unwrap();
        let mut result = crate::identify::judgement::tests::identified(&[]);
        result.parameters.sort_by(|a, b| a.name.cmp(&b.name));
        result.correlation_names.sort_by(|a, b| b.cmp(a));
        // What follows from the coefficients stays with the identification.
        let derived = Parameter { name: "B15".into(), ..result.parameters[0].clone() };
        result.parameters.insert(2, derived);
        let names = |list: &[Parameter]| list.iter().map(|p| p.name.clone()).collect::<Vec<_>>();
        let told: Vec<String> = names(&result.parameters).into_iter().filter(|n| n != "B15").collect();
        assert_eq!(names(&identified_model(&result, &rig).unwrap().parameters), told);
    }

    #[test]
    fn parameters_are_found_by_name_and_the_wrong_ones_are_named() {
        let names = ["C2", "B11", "B12", "B21", "B22", "C12"];
        let parameters = names
            .iter()
            .enumerate()
            .map(|(i, n)| Parameter { name: (*n).into(), value: i as f64, std_error: 0.0, unit: "1".into() })
            .collect();
        let mut m = IdentifiedModel {
            name: String::new(),
            system: System::BuiltIn(Pendulum::Double.id().into()),
            method: "weak".into(),
            drive_frequency_hz: None,
            nominal: vec!["viscous-friction@joint2".into()],
            parameters,
            effects: vec![],
            found_with: BTreeMap::new(),
        };
        check_double_pendulum(&m).unwrap();
        m.parameters[1].name = "B13".into();
        assert!(check_double_pendulum(&m).unwrap_err().to_string().starts_with("parameters.B13"));
        m.parameters.remove(1);
        assert!(check_double_pendulum(&m).unwrap_err().to_string().starts_with("parameters.B11"));
        m.nominal.push("rust@joint1".into());
        assert!(check_double_pendulum(&m).unwrap_err().to_string().contains("rust@joint1"));
    }
}

//! What is refused where an identified model is expected: other files, and models of another system
//! than the rig's.

use std::path::Path;

use toml::Table;

use super::identified::{IdentifiedModel, System};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

/// Refuses files of other kinds, which are told by their keys.
///
/// # Errors
/// A rig file; a model file without numbers.
pub fn other_file(table: &Table) -> Result<()> {
    if table.contains_key("method") {
        return Ok(());
    }
    let found = if table.contains_key("channel") {
        "this is a rig file, not a model file"
    } else if table.contains_key("coordinates") {
        "this is a model file with equations alone, not a model with identified numbers"
    } else {
        return Ok(());
    };
    Err(BadInput::new(found, "")
        .remedy("`whirl identify -o MODEL.toml` writes a model, and so does `whirl explain -o`: name one of these"))
}

/// An error of a model's file, with what to do where it does not say so itself.
pub fn told(e: BadInput, path: &Path) -> BadInput {
    let e = e.in_file(path);
    if !e.remedy.is_empty() {
        return e;
    }
    e.remedy("Correct the file, or write it anew with `whirl identify -o`; its keys are in docs/validate.md")
}

/// Refuses a model of another system than the rig's built-in one: told before a record is looked
/// at, in which channels of that other system would be missed. What is compared of systems of one's
/// own is told later, by their equations.
///
/// # Errors
/// Names both systems.
pub fn other_system(model: &IdentifiedModel, path: &Path, rig: &Rig) -> Result<()> {
    let Some(of_rig) = rig.pendulum().filter(|_| rig.bound.is_none()) else { return Ok(()) };
    let found = match &model.system {
        System::BuiltIn(id) if id == of_rig.id() => return Ok(()),
        System::BuiltIn(id) => format!("a model of \"{id}\""),
        System::Own(_) => format!("a model of a system of one's own, \"{}\"", model.name),
    };
    let expected = format!("a model of \"{}\", which is the system of {}", of_rig.id(), rig.path.display());
    Err(BadInput::new(found, expected)
        .in_file(path)
        .at("model")
        .remedy("Name a model that was identified on this rig, or the rig file of this model"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_are_told_by_their_keys() {
        let told = |text: &str| IdentifiedModel::parse(text).unwrap_err().to_string();
        let rig = told("name = \"r\"\nmodel = \"double-pendulum\"\n[[channel]]\nname = \"c\"\n");
        assert!(rig.contains("this is a rig file, not a model file") && rig.contains("identify -o"), "{rig}");
        let bare = told("name = \"m\"\ncoordinates = [{ name = \"q\", space = \"R\" }]\n");
        assert!(bare.contains("not a model with identified numbers"), "{bare}");
        assert!(told("name = \"m\"\n").contains("no method"));
    }

    #[test]
    fn a_model_of_another_system_is_told_with_both() {
        let rig = Rig::parse(
            "name = \"p\"\nmodel = \"single-pendulum\"\nsample_rate_hz = 200.0\n[[channel]]\nname = \"enc\"\n\
             measures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n",
            Path::new("rig.toml"),
        )
        .unwrap();
        let model = |system: &str| {
            let text = format!("name = \"m\"\nmethod = \"weak\"\n{system}\n[parameters]\n");
            IdentifiedModel::parse(&text).unwrap()
        };
        let path = Path::new("double.toml");
        let e = other_system(&model("model = \"double-pendulum\""), path, &rig).unwrap_err().to_string();
        assert!(e.starts_with("double.toml: model: found a model of \"double-pendulum\""), "{e}");
        assert!(e.contains("\"single-pendulum\", which is the system of rig.toml"), "{e}");
        let own = model("coordinates = [{ name = \"q\", space = \"R\" }]\nequation = []");
        assert!(other_system(&own, path, &rig).is_err());
        assert!(other_system(&model("model = \"single-pendulum\""), path, &rig).is_ok());
    }
}

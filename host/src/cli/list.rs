//! `whirl list`: what can be chosen, one line each with unit and equation.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::{Value, json};
use whirl_hil_sim::plant::effects::{EffectInfo, LIST, ParameterInfo};

use super::Answer;
use super::output::Output;
use super::outputs::Outputs;
use crate::effects::catalogue;
use crate::effects::entry::{At, Entry, Verb};
use crate::error::{BadInput, Result};
use crate::model::model_file::toml_place;
use crate::system::library;
use crate::wording::format::shortest;
use crate::wording::symbols::law_plain;

/// What to list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Models of rigs.
    Models,
    /// Physical effects.
    Effects,
    /// Boards with firmware.
    Boards,
    /// Methods of identification.
    Methods,
}

/// Arguments of `list`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What to list.
    what: What,
    /// Print the file of one model (a system file to copy and change), or with effects what is known
    /// of one, its laboratory test too; without NAME the file of all effects.
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "")]
    show: Option<String>,
    /// List the effects of this file too (docs/effects.md); may be given several times.
    #[arg(long, value_name = "FILE.toml")]
    effects: Vec<PathBuf>,
    #[command(flatten)]
    out: Output,
}

/// An item of a list, as JSON has it.
#[derive(Serialize)]
struct Item {
    id: String,
    about: String,
}

/// An effect, as JSON has it.
#[derive(Serialize)]
struct Effect {
    id: String,
    unit: String,
    at: Vec<String>,
    equation: String,
    parameters: Vec<Parameter>,
}

/// What is given of an effect beside its value.
#[derive(Serialize)]
struct Parameter {
    name: String,
    /// None where it follows from the equation on which the effect acts.
    unit: Option<String>,
    /// Its value where none is given; none where it must be.
    default: Option<f64>,
}

/// Prints the list.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let out = &arguments.out;
    Outputs::of(out, None).reads(&arguments.effects).check()?;
    out.tell_no_report("a list", "`whirl explain` writes one of the effects that it finds");
    if let Some(name) = &arguments.show {
        return show(arguments, name);
    }
    let result = match arguments.what {
        What::Models => said(out, models(), 28),
        What::Methods => said(out, items(crate::identify::METHODS.iter().copied()), 18),
        What::Boards => said(out, items(crate::boards::BOARDS.iter().map(|b| (b.id, b.about))), 18),
        What::Effects => effects(out, &arguments.effects)?,
    };
    out.write_json(&json!({ "list": word(arguments.what), "items": result, "warnings": [] }))?;
    Ok(Answer::Positive)
}

/// The word for a list on the command line.
fn word(what: What) -> String {
    format!("{what:?}").to_lowercase()
}

fn items<'a>(of: impl Iterator<Item = (&'a str, &'a str)>) -> Vec<Item> {
    of.map(|(id, about)| Item { id: id.to_owned(), about: about.to_owned() }).collect()
}

/// Prints items, one a line.
fn said(out: &Output, items: Vec<Item>, width: usize) -> Value {
    items.iter().for_each(|i| out.say(&format!("{:<width$} {}\n", i.id, i.about)));
    json!(items)
}

fn models() -> Vec<Item> {
    let mut all: Vec<Item> = Vec::new();
    for (id, about) in crate::model::MODELS {
        let about = format!("{about} (--show {id} prints the system file of that name)");
        all.push(Item { id: (*id).to_owned(), about });
    }
    for s in crate::reduce::systems::SYSTEMS {
        let about = format!("{} (--show {} prints a system file of it)", s.about, s.id);
        all.push(Item { id: s.id.to_owned(), about });
    }
    let built_in = |name: &str| crate::model::MODELS.iter().any(|(id, _)| *id == name);
    for (name, text) in library::all().iter().filter(|(name, _)| !built_in(name)) {
        let about = format!("a file, see --show {name}: {}", library::about(text));
        all.push(Item { id: (*name).to_owned(), about });
    }
    all
}

/// Prints one system's file, or an effect's entry.
fn show(arguments: &Arguments, name: &str) -> Result<Answer> {
    let text = match arguments.what {
        What::Models => system_file(name)?,
        What::Effects => match own_text(name, &arguments.effects)? {
            Some(text) => text,
            None => effect_text(name)?,
        },
        What::Boards | What::Methods => {
            return Err(BadInput::new("--show", "whirl list models --show NAME, or whirl list effects --show ID")
                .at("--show")
                .remedy("Only models and effects have files to show"));
        }
    };
    arguments.out.say(&text);
    let list = word(arguments.what);
    arguments.out.write_json(&json!({ "list": list, "id": name, "text": text, "warnings": [] }))?;
    Ok(Answer::Positive)
}

fn system_file(name: &str) -> Result<String> {
    if let Some(system) = crate::reduce::systems::SYSTEMS.iter().find(|s| s.id == name) {
        return Ok((system.file)());
    }
    let own = crate::reduce::systems::SYSTEMS.iter().map(|s| s.id);
    let names: Vec<&str> = library::all().iter().map(|(n, _)| *n).chain(own).collect();
    library::text(name).map(str::to_owned).ok_or_else(|| {
        BadInput::new(format!("\"{name}\""), format!("one of {}", names.join(", ")))
            .at("--show")
            .remedy("Name one of the systems of `whirl list models`")
    })
}

/// The entry of an effect file that has it.
fn own_text(id: &str, files: &[PathBuf]) -> Result<Option<String>> {
    let mut own: Vec<Entry> = Vec::new();
    let mut found = None;
    for file in files {
        let source = toml_place::read(file, "an effect file")?;
        let entries = crate::effects::read_more(&source, own.iter())?;
        if let Some(k) = entries.iter().position(|e| e.id == id) {
            // Its table as it stands, the k-th of the file, without what is said above the next.
            let is_head = |line: &&str| line.replace(' ', "").starts_with("[[effect]]");
            let lines: Vec<&str> = source.text.lines().collect();
            let mut heads = (0..lines.len()).filter(|&i| is_head(&lines[i])).skip(k);
            let begin = heads.next().unwrap_or(0);
            let own = lines[begin..heads.next().unwrap_or(lines.len())].join("\n");
            let told = own.trim_end_matches(|c: char| c.is_whitespace());
            found = Some(format!("{told}\n"));
        }
        own.extend(entries);
    }
    Ok(found)
}

/// One effect's entry, or all of them where none is named.
fn effect_text(id: &str) -> Result<String> {
    if id.is_empty() {
        return Ok(crate::effects::TEXT.to_owned());
    }
    let text = crate::effects::text_of(id).ok_or_else(|| {
        BadInput::new(format!("\"{id}\""), "an effect of `whirl list effects`").at("--show").remedy(
            "Name one without its place, such as quadratic-drag; one of an effect file needs --effects FILE.toml",
        )
    })?;
    // What is the same as another's entry stands there.
    let other = text.lines().find_map(|line| line.strip_prefix("same_as = "));
    let other = other.and_then(|id| crate::effects::text_of(id.trim_matches('"')));
    let other = other.map_or_else(String::new, |text| format!("\n[[effect]]\n{text}\n"));
    Ok(format!("[[effect]]\n{text}\n{other}"))
}

/// Prints every effect: those that a simulated rig can have, with their parameters, then the
/// others, then a user's.
fn effects(out: &Output, files: &[PathBuf]) -> Result<Value> {
    let mut all = simulated();
    let mut own = Vec::new();
    for file in files {
        let source = toml_place::read(file, "an effect file")?;
        own.extend(crate::effects::read_more(&source, own.iter())?);
    }
    for e in catalogue().iter().chain(&own) {
        if !all.iter().any(|s| s.id == e.id) {
            all.push(of_entry(e));
        }
    }
    for e in &all {
        let named = |p: &Parameter| match &p.unit {
            Some(unit) => format!("{} [{unit}]", p.name),
            None => p.name.clone(),
        };
        let named = |p: &Parameter| match p.default {
            Some(value) => format!("{} = {} where not given", named(p), shortest(value)),
            None => named(p),
        };
        let parameters: Vec<String> = e.parameters.iter().map(named).collect();
        let with = if parameters.is_empty() { String::new() } else { format!("; with {}", parameters.join(", ")) };
        let (unit, places) = (format!("[{}]", e.unit), e.at.join("|"));
        out.say(&format!("{:<28} {unit:<18} @{places:<30} {}{with}\n", e.id, e.equation));
    }
    Ok(json!(all))
}

/// Units as people read them: a pure number has the unit 1.
fn shown(unit: &str) -> String {
    if unit.is_empty() { "1" } else { unit }.to_owned()
}

fn simulated() -> Vec<Effect> {
    let parameter = |p: &ParameterInfo| Parameter {
        name: p.name.to_owned(),
        unit: Some(law_plain(&shown(p.unit))),
        default: Some(p.default),
    };
    let effect = |e: &EffectInfo| Effect {
        id: e.id.to_owned(),
        unit: law_plain(&shown(e.unit)),
        at: e.places.iter().map(|p| p.name().to_owned()).collect(),
        equation: law_plain(e.equation),
        parameters: e.parameters.iter().map(parameter).collect(),
    };
    LIST.iter().map(effect).collect()
}

fn of_entry(e: &Entry) -> Effect {
    let by_place = match (e.at, e.verb) {
        (At::Encoder, _) => "the sensor's unit",
        (At::Input, _) => "the input's unit",
        (_, Verb::Turns) => "rad",
        _ => "by the law",
    };
    Effect {
        id: e.id.clone(),
        unit: e.unit.clone().unwrap_or_else(|| by_place.to_owned()),
        at: vec![format!("{:?}", e.at).to_lowercase()],
        equation: e.equation.clone(),
        parameters: e.shapes.iter().map(|s| Parameter { name: s.name.clone(), unit: None, default: None }).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_entry_of_an_effect_file_is_shown() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("own.toml");
        let entry = |id: &str| {
            format!("[[effect]]\nid = \"{id}\"\nat = \"joint\"\nstrengths = [\"k\"]\nforce = \"-k*x\" # {id}\n")
        };
        std::fs::write(&file, format!("# two of them\n{}\n{}", entry("one"), entry("two"))).unwrap();
        let shown = |id: &str| own_text(id, std::slice::from_ref(&file)).unwrap();
        assert_eq!((shown("one"), shown("two")), (Some(entry("one")), Some(entry("two"))));
        assert_eq!(shown("quadratic-drag"), None);
    }
}

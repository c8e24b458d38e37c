//! `whirl list`: what can be chosen, one line each with unit and equation.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::Answer;
use crate::effects::catalogue;
use crate::error::{BadInput, Result};
use crate::model::model_file::toml_place;
use crate::system::library;

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
}

/// Prints the list.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let out = super::output::Output::default();
    if let Some(name) = &arguments.show {
        return show(&out, arguments.what, name);
    }
    match arguments.what {
        What::Models => {
            for (id, about) in crate::model::MODELS {
                out.say(&format!("{id:<18} {about} (--show {id} prints the system file of that name)\n"));
            }
            for s in crate::reduce::systems::SYSTEMS {
                out.say(&format!("{:<18} {}\n", s.id, s.about));
            }
            let built_in = |name: &str| crate::model::MODELS.iter().any(|(id, _)| *id == name);
            for (name, text) in library::all().iter().filter(|(name, _)| !built_in(name)) {
                out.say(&format!("{name:<28} a file, see --show {name}: {}\n", library::about(text)));
            }
        }
        What::Methods => {
            for (id, about) in crate::identify::METHODS {
                out.say(&format!("{id:<18} {about}\n"));
            }
        }
        What::Boards => {
            for board in crate::boards::BOARDS {
                out.say(&format!("{:<18} {}\n", board.id, board.about));
            }
        }
        What::Effects => effects(&out, &arguments.effects)?,
    }
    Ok(Answer::Positive)
}

/// Prints one system's file.
fn show(out: &super::output::Output, what: What, name: &str) -> Result<Answer> {
    match what {
        What::Models => {}
        What::Effects => return show_effect(out, name),
        What::Boards | What::Methods => {
            return Err(BadInput::new("--show", "whirl list models --show NAME, or whirl list effects --show ID")
                .at("--show")
                .remedy("Only models and effects have files to show"));
        }
    }
    let names: Vec<&str> = library::all().iter().map(|(n, _)| *n).collect();
    let text = library::text(name).ok_or_else(|| {
        BadInput::new(format!("\"{name}\""), format!("one of {}", names.join(", ")))
            .at("--show")
            .remedy("Name one of the systems that ship as files")
    })?;
    out.say(text);
    Ok(Answer::Positive)
}

/// Prints one effect's entry, or all of them where none is named.
fn show_effect(out: &super::output::Output, id: &str) -> Result<Answer> {
    if id.is_empty() {
        out.say(crate::effects::TEXT);
        return Ok(Answer::Positive);
    }
    let text = crate::effects::text_of(id).ok_or_else(|| {
        BadInput::new(format!("\"{id}\""), "an effect of `whirl list effects`")
            .at("--show")
            .remedy("Name one without its place, such as quadratic-drag")
    })?;
    out.say(&format!("[[effect]]\n{text}\n"));
    // What is the same as another's entry stands there.
    let other = text.lines().find_map(|line| line.strip_prefix("same_as = "));
    if let Some(text) = other.and_then(|id| crate::effects::text_of(id.trim_matches('"'))) {
        out.say(&format!("\n[[effect]]\n{text}\n"));
    }
    Ok(Answer::Positive)
}

/// Prints every effect: those that a simulated rig can have, with their parameters, then the
/// others, then a user's.
fn effects(out: &super::output::Output, files: &[PathBuf]) -> Result<()> {
    // Read first: a file that cannot be is told alone.
    let mut own = Vec::new();
    for file in files {
        let source = toml_place::read(file, "an effect file")?;
        own.extend(crate::effects::read_more(&source, own.iter())?);
    }
    let simulated = simulated(out);
    for e in catalogue().iter().chain(&own).filter(|e| !simulated.contains(&e.id.as_str())) {
        let place = format!("{:?}", e.at).to_lowercase();
        out.say(&format!("{:<28} {:<18} @{place:<30} {}\n", e.id, "", e.equation));
    }
    Ok(())
}

fn simulated(out: &super::output::Output) -> Vec<&'static str> {
    for e in whirl_hil_sim::plant::effects::LIST {
        let places: Vec<&str> = e.places.iter().map(|p| p.name()).collect();
        let parameters: Vec<String> = e
            .parameters
            .iter()
            .map(|p| format!("{} [{}]", p.name, if p.unit.is_empty() { "1" } else { p.unit }))
            .collect();
        let with = if parameters.is_empty() { String::new() } else { format!("; with {}", parameters.join(", ")) };
        out.say(&format!(
            "{:<28} {:<18} @{:<30} {}{with}\n",
            e.id,
            format!("[{}]", e.unit),
            places.join("|"),
            e.equation
        ));
    }
    whirl_hil_sim::plant::effects::LIST.iter().map(|e| e.id).collect()
}

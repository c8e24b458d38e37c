//! An effect file beside others: ids of its own, and references that lead somewhere.

use super::{Entry, read};
use crate::error::Result;
use crate::model::model_file::toml_place::Source;
use crate::system::language::Reader;

/// Reads every `[[effect]]` of a file that stands beside others: its ids are its own, and what it
/// refines or takes from is one of them or among the others.
///
/// # Errors
/// Names file, line and column, what was found and what was expected.
pub fn read_beside<'a>(source: &Source, others: impl Iterator<Item = &'a Entry>) -> Result<Vec<Entry>> {
    let own = read(source)?;
    let others: Vec<&str> = others.map(|e| e.id.as_str()).collect();
    let remedy = "`whirl list effects` prints those that there are";
    let table = source.table()?;
    let r = Reader::new(source);
    for ((t, at), entry) in r.tables(table.get_ref(), "effect")?.into_iter().zip(&own) {
        if others.contains(&entry.id.as_str()) {
            let here = t.get("id").map_or(at, |v| v.span().start);
            return Err(source
                .bad(here, format!("the effect {}, which there is already", entry.id), "an id of its own")
                .remedy(format!("Rename it; {remedy}")));
        }
        for key in ["refines", "takes_from"] {
            let Some(v) = t.get(key) else { continue };
            let id = source.text(v, "the id of another effect")?;
            let is_there = others.contains(&id) || own.iter().any(|e| e.id == id);
            if id == entry.id || !is_there {
                return Err(source
                    .bad(v.span().start, format!("{key} = \"{id}\""), "the id of another effect")
                    .remedy(format!("Name an effect of this file or of the list; {remedy}")));
            }
        }
    }
    Ok(own)
}

//! `[sensors]`: names for what a channel may measure, sums of coordinates.

use toml::de::DeTable;

use super::language::Reader;
use super::words::Scope;
use crate::error::Result;
use crate::model::model_file::expression::Symbol;

/// A sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Name.
    pub name: String,
    /// What it shows, as written.
    pub shows: String,
}

/// Reads the sensors.
///
/// # Errors
/// A name that is taken, something that does not move.
pub fn read(r: &Reader<'_>, top: &DeTable<'_>) -> Result<Vec<Sensor>> {
    let mut out: Vec<Sensor> = Vec::new();
    for (name, at, value) in r.table(top, "sensors", "[sensors] with theta2 = \"phi2 - phi1\"")? {
        // A sensor may have a coordinate's name if it shows that coordinate.
        let shows = r.source.text(value, "a sum of coordinates in quotes")?.to_owned();
        if shows != name {
            r.new_name(at, name)?;
        }
        let p = r.scalar(value, Scope::Motion)?;
        let coordinates = p.moves(|s| matches!(s, Symbol::Coordinate(_)));
        if p.has_parameter() || !coordinates || p.moves(|s| !matches!(s, Symbol::Coordinate(_))) {
            return Err(r
                .source
                .bad(value.span().start, format!("\"{shows}\""), "a sum of coordinates such as \"phi2 - phi1\"")
                .remedy("Sensors show coordinates"));
        }
        out.push(Sensor { name: name.to_owned(), shows });
    }
    Ok(out)
}

//! `[points]`: vectors, right and up (or three components). A point that uses another moves with
//! it.

use toml::de::DeTable;

use super::language::Reader;
use crate::error::Result;

/// Reads the points in the order of the file; each may use those above it.
///
/// # Errors
/// A name that is taken, an expression that is no vector.
pub fn read(r: &mut Reader<'_>, top: &DeTable<'_>) -> Result<()> {
    for (name, at, value) in r.table(top, "points", "[points] with base = \"[0, 0]\"")? {
        r.new_name(at, name)?;
        let point = r.vector(value)?;
        r.counted_in(value, "the point", "m")?;
        r.words.points.push((name.to_owned(), point));
    }
    Ok(())
}

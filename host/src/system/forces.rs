//! `[[force]]`: generalised forces by their virtual work, δW = value · δ(does_work_on).

use toml::de::DeTable;

use super::language::{Placed, Reader};
use super::polynomial::Polynomial;
use super::words::Scope;
use crate::error::Result;

/// A force.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// The displacement that it works along.
    pub does_work_on: Placed<Polynomial>,
    /// Its value.
    pub value: Placed<Polynomial>,
}

/// Reads the forces.
///
/// # Errors
/// Keys that are missing or unknown, expressions that are no numbers.
pub fn read(r: &Reader<'_>, top: &DeTable<'_>) -> Result<Vec<Force>> {
    let mut out = Vec::new();
    for (table, at) in r.tables(top, "force")? {
        r.source.known_keys(table, &["does_work_on", "value", "name"], "a force")?;
        let placed = |key: &str, expected: &str| -> Result<Placed<Polynomial>> {
            let v = r.source.required(table, at..at, key, expected)?;
            Ok(Placed { value: r.scalar(v, Scope::Motion)?, at: r.source.inside(v, 0) })
        };
        let does_work_on = placed("does_work_on", "the displacement that it works along, such as \"x\"")?;
        let value = placed("value", "the force or torque, such as \"force - k*x\"")?;
        out.push(Force { does_work_on, value });
    }
    Ok(out)
}

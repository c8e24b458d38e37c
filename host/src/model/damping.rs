//! Dampings of the built-in systems' nominal models.

use crate::error::{BadInput, Result};

/// A damping of a nominal model: where it acts and which coefficients it adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damping {
    /// `ID@PLACE` in rig files.
    pub id: &'static str,
    /// Names of its coefficients in the first and second equation.
    pub names: [Option<&'static str>; 2],
    /// Whether its coefficients are divided by Ω (viscous) or by Ω² (Coulomb).
    pub viscous: bool,
}

impl Damping {
    /// Those of `all` that are called so, in the order of the names.
    ///
    /// # Errors
    /// A damping that there is not, or named twice. Without its place.
    pub fn chosen<'a>(names: impl IntoIterator<Item = &'a str>, all: &'static [Self]) -> Result<Vec<&'static Self>> {
        let mut out: Vec<&'static Self> = Vec::new();
        for name in names {
            let damping = all.iter().find(|d| d.id == name).ok_or_else(|| {
                let ids: Vec<&str> = all.iter().map(|d| d.id).collect();
                BadInput::new(format!("\"{name}\""), format!("one of {}", ids.join(", ")))
            })?;
            if out.contains(&damping) {
                return Err(BadInput::new(format!("\"{name}\" a second time"), "each damping once"));
            }
            out.push(damping);
        }
        Ok(out)
    }
}

//! A base that moves in another direction than the rig file says.
//!
//! The single pendulum's equation (2.6) has the terms of both: a horizontal drive puts its force
//! into n_cos and p_cos, a vertical one into n_sin and p_sin. A built-in double pendulum has a
//! vertical drive only.

use super::arrow::{CLEAR, NamedCoefficient};
use crate::rig::{Direction, Rig};
use crate::warning::Warning;

/// Share of the other direction's force below which the stated one's is not the drive.
const NONE: f64 = 0.2;

/// The other direction, where all of the drive's force is in it.
pub(super) fn other(own: &Rig, known: &[NamedCoefficient<'_>]) -> Option<Warning> {
    let stated = own.drive?.direction;
    let force = |names: [&str; 2]| {
        let list = names.map(|n| known.iter().find(|k| k.name == n));
        let [Some(a), Some(b)] = list else { return None };
        Some((a.value.hypot(b.value), a.std_error.hypot(b.std_error)))
    };
    let (horizontal, vertical) = (force(["n_cos", "p_cos"])?, force(["n_sin", "p_sin"])?);
    let (here, there, name) = match stated {
        Direction::Horizontal => (horizontal, vertical, "vertical"),
        Direction::Vertical => (vertical, horizontal, "horizontal"),
    };
    (there.0 > CLEAR * there.1 && here.0 < NONE * there.0).then(|| {
        Warning::new(
            "drive-direction",
            format!(
                "the base moves {name}ly: the drive's force is {:.0} times as large in that direction",
                there.0 / here.0.max(here.1)
            ),
            format!("Set drive.direction = \"{name}\" in the rig file"),
        )
        .with("value", name)
        .invalidating()
    })
}

/// A direction that the system's equations do not have.
pub(super) fn impossible(rig: &Rig) -> Option<Warning> {
    let (pendulum, drive) = (rig.pendulum()?, rig.drive?);
    (!pendulum.takes(drive.direction)).then(|| {
        Warning::new(
            "drive-direction",
            "the rig file says drive.direction = \"horizontal\", but the double pendulum's equations have a vertically driven base",
            "Set drive.direction = \"vertical\" in the rig file, or write the equations of a horizontal drive into a model file",
        )
        .with("value", "vertical")
        .invalidating()
    })
}

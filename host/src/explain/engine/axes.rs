//! Coordinates that something is looked at against: what moves at a place, its velocity, the
//! drive's phase, time.

use super::setting::Setting;
use crate::effects::places::{self, Place};
use crate::model::model_file::expression::{Function, Node, Symbol, call, symbol};
use crate::system::derivative::by_time;
use crate::system::polynomial::Polynomial;

/// A coordinate.
pub struct Axis {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Whether it runs from −π to π.
    pub turn: bool,
    /// Its value.
    pub of: Node,
}

impl Axis {
    /// The angle or position of what moves by `moves`.
    pub fn position(name: &str, moves: &Polynomial, is_angle: bool) -> Self {
        let what = if is_angle { "angle" } else { "position" };
        let of = if is_angle { call(Function::Wrap, moves.node()) } else { moves.node() };
        Self { name: format!("{what} of {name}"), unit: if is_angle { "rad" } else { "m" }, turn: is_angle, of }
    }

    /// Its velocity, where there is one.
    pub fn velocity(setting: &Setting<'_>, name: &str, moves: &Polynomial, is_angle: bool) -> Option<Self> {
        let rate = by_time(moves, setting.file()?.coordinates.len(), setting.rig.omega()).ok()?;
        let unit = if is_angle { "rad/s" } else { "m/s" };
        Some(Self { name: format!("velocity of {name}"), unit, turn: false, of: rate.node() })
    }

    /// The drive's phase, where there is a drive.
    pub fn phase(setting: &Setting<'_>) -> Option<Self> {
        let of = call(Function::Wrap, symbol(Symbol::Tau));
        setting.rig.drive.map(|_| Self { name: "drive phase".to_owned(), unit: "rad", turn: true, of })
    }

    /// Time.
    pub fn time() -> Self {
        Self { name: "time".to_owned(), unit: "s", turn: false, of: symbol(Symbol::Time) }
    }
}

/// Each joint, and each arm whose angle is no joint's, with what moves there.
pub fn places_of_forces(setting: &Setting<'_>) -> Vec<(Place, Polynomial)> {
    let Some(file) = setting.file() else { return Vec::new() };
    let joints: Vec<(Place, Polynomial)> =
        file.joints.iter().enumerate().map(|(k, j)| (Place::Joint(k), j.moves.value.clone())).collect();
    let arms = file.bodies.iter().enumerate().filter_map(|(k, b)| {
        let angle = b.value.angle().filter(|angle| joints.iter().all(|j| j.1 != **angle))?;
        Some((Place::Arm(k), angle.clone()))
    });
    joints.iter().cloned().chain(arms).collect()
}

/// All coordinates that residuals are looked at against.
pub fn all(setting: &Setting<'_>) -> Vec<Axis> {
    let Some(file) = setting.file() else { return Vec::new() };
    let mut out = Vec::new();
    for (place, moves) in places_of_forces(setting) {
        let name = place.name(file);
        let is_angle = matches!(place, Place::Arm(_)) || places::is_angle(file, &moves);
        // How an arm stands is told by its joints.
        if matches!(place, Place::Joint(_)) {
            out.push(Axis::position(&name, &moves, is_angle));
        }
        out.extend(Axis::velocity(setting, &name, &moves, is_angle));
    }
    out.extend(Axis::phase(setting));
    out.push(Axis::time());
    out
}

/// Those that a force at a place may depend on.
pub fn of_force(setting: &Setting<'_>, place: Place, moves: &Polynomial) -> Vec<Axis> {
    let Some(file) = setting.file() else { return Vec::new() };
    let (name, is_angle) = (place.name(file), places::is_angle(file, moves));
    let mut out = vec![Axis::position(&name, moves, is_angle)];
    out.extend(Axis::velocity(setting, &name, moves, is_angle));
    out.extend(Axis::phase(setting));
    out
}

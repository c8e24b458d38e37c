//! Coordinates that something is looked at against: what moves at a place, its velocity, the
//! drive's phase, time.

use super::setting::Setting;
use super::units;
use crate::effects::places::{self, Place};
use crate::model::model_file::expression::{Function, Node, Symbol, call, symbol};
use crate::system::derivative::by_time;
use crate::system::polynomial::Polynomial;

/// A coordinate.
pub struct Axis {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Whether it runs from −π to π.
    pub turn: bool,
    /// Its value.
    pub of: Node,
}

impl Axis {
    /// The angle or position of what moves by `moves`; the value of what is neither.
    pub fn position(setting: &Setting<'_>, name: &str, moves: &Polynomial, is_angle: bool) -> Self {
        let unit = unit_of(setting, moves, is_angle);
        let what = match unit.as_str() {
            "rad" => "angle",
            "m" => "position",
            _ => "value",
        };
        let of = if is_angle { call(Function::Wrap, moves.node()) } else { moves.node() };
        Self { name: format!("{what} of {name}"), unit, turn: is_angle, of }
    }

    /// Its velocity, or its rate, where there is one.
    pub fn velocity(setting: &Setting<'_>, name: &str, moves: &Polynomial, is_angle: bool) -> Option<Self> {
        let rate = by_time(moves, setting.file()?.coordinates.len(), setting.rig.omega()).ok()?;
        let unit = unit_of(setting, moves, is_angle);
        let what = if matches!(unit.as_str(), "rad" | "m") { "velocity" } else { "rate" };
        Some(Self { name: format!("{what} of {name}"), unit: format!("{unit}/s"), turn: false, of: rate.node() })
    }

    /// The drive's phase, where there is a drive.
    pub fn phase(setting: &Setting<'_>) -> Option<Self> {
        let of = call(Function::Wrap, symbol(Symbol::Tau));
        setting.rig.drive.map(|_| Self { name: "drive phase".to_owned(), unit: "rad".to_owned(), turn: true, of })
    }

    /// Time.
    pub fn time() -> Self {
        Self { name: "time".to_owned(), unit: "s".to_owned(), turn: false, of: symbol(Symbol::Time) }
    }
}

/// Unit of what moves by `moves`: a coordinate's own, or that of the difference of two; a length
/// otherwise.
fn unit_of(setting: &Setting<'_>, moves: &Polynomial, is_angle: bool) -> String {
    if is_angle {
        return "rad".to_owned();
    }
    let coordinate = |k: usize| Polynomial::motion(Symbol::Coordinate(k));
    let count = setting.circle.len();
    let is_that_of = |k: &usize| {
        let differs = |j: usize| *moves == coordinate(*k).minus(&coordinate(j));
        *moves == coordinate(*k) || (0..count).any(differs)
    };
    let own = (0..count).find(is_that_of).map(|k| units::si_unit(setting.rig, setting.whole, k));
    own.filter(|unit| unit != "rad").unwrap_or_else(|| "m".to_owned())
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
            out.push(Axis::position(setting, &name, &moves, is_angle));
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
    let mut out = vec![Axis::position(setting, &name, moves, is_angle)];
    out.extend(Axis::velocity(setting, &name, moves, is_angle));
    out.extend(Axis::phase(setting));
    out
}

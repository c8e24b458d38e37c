//! A table about a tick, for motion between ticks.

use core::f64::consts::TAU;

use whirl_shared::excitation::{Form, Shape, Table, WHOLE};

/// A device's shape, in its own memory: see [`Shape`].
#[derive(Clone, Copy, Debug, PartialEq)]
// It is copied once a tick, and boxing it would make commands no numbers.
#[allow(clippy::large_enum_variant)]
pub enum CommandShape {
    /// Several sines.
    Sines(Form),
    /// A table.
    Table(Table),
}

impl Default for CommandShape {
    fn default() -> Self {
        Self::Sines(Form::SINE)
    }
}

impl CommandShape {
    /// That of a device.
    #[must_use]
    pub fn of(shape: Shape<'_>) -> Self {
        match shape {
            Shape::Sines(form) => Self::Sines(*form),
            Shape::Table(table) => Self::Table(*table),
        }
    }

    /// Displacement at an amplitude (nm) and a phase (turns · 2⁻³²), nm: see [`Shape::displacement`].
    #[must_use]
    pub fn displacement(&self, amplitude_nanometre: u32, phase: u32) -> i32 {
        match self {
            Self::Sines(form) => form.displacement(amplitude_nanometre, phase),
            Self::Table(table) => table.displacement(amplitude_nanometre, phase),
        }
    }
}

/// Control points that a motion may reach from a tick on: one point a tick, two behind it and one
/// before, and two more for a base that is faster than commanded.
const REACH: usize = 6;

/// A table about a tick: c(t) Σ c_j B(x − j), x = `at` + `per_radian` (θ − `from`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spline {
    points: [f64; REACH],
    from: f64,
    at: f64,
    per_radian: f64,
}

impl Spline {
    /// About a phase (rad), behind which the base lags (rad).
    pub(super) fn of(table: &Table, phase: f64, lag: f64) -> Option<Self> {
        let count = table.points().len();
        let turns = (phase - lag) / TAU;
        // Within the table, whatever the rounding.
        let x = ((turns - turns.floor()) * count as f64).min(count as f64);
        let first = x.floor();
        let point = |k: usize| table.points().get((first as usize + count + k).checked_sub(1)? % count).copied();
        let mut points = [0.0; REACH];
        for (k, place) in points.iter_mut().enumerate() {
            *place = f64::from(point(k)?) / f64::from(WHOLE);
        }
        Some(Self { points, from: phase, at: x - first, per_radian: count as f64 / TAU })
    }

    /// Value, and first and second derivative by θ.
    pub(super) fn at(&self, theta: f64) -> [f64; 3] {
        let x = self.at + self.per_radian * (theta - self.from);
        let j = x.floor().clamp(0.0, (REACH - 4) as f64);
        let u = x - j;
        // Four from there on, see `REACH`.
        let [p, q, r, s] = [0, 1, 2, 3].map(|k| self.points.get(j as usize + k).copied().unwrap_or(0.0));
        let [d0, d1, d2, d3] =
            [p + 4.0 * q + r, 3.0 * (r - p), 3.0 * (p - 2.0 * q + r), s - 3.0 * r + 3.0 * q - p].map(|d| d / 6.0);
        let k = self.per_radian;
        [d0 + u * (d1 + u * (d2 + u * d3)), k * (d1 + u * (2.0 * d2 + u * 3.0 * d3)), k * k * (2.0 * d2 + 6.0 * d3 * u)]
    }
}

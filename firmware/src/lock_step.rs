//! The wire between an emulated board and the simulated plant at its other end.
//!
//! Once a tick, first thing in the sampling interrupt, the board sends a [`Request`] and waits for
//! the [`Reply`]: the plant moves up to this tick under the drive of the last one, and shows its
//! encoders and its base. Where the shape of the drive is another one than before, it follows the
//! request. A board that waits has no time that passes (QEMU stops its clock), so
//! that board and plant are in lock-step and a run is the same at every repeat.
//!
//! All numbers are little-endian. A reply may carry bytes as if they had come from the host, which
//! the board takes between this tick and the next, and an [`Order`] by which a test makes the board
//! fail.

use whirl_shared::excitation::{Component, Form, POINTS, Shape, Table};

/// Length of a request on the wire, bytes.
pub const REQUEST_LEN: usize = 24;
/// Length of a reply without the host's bytes.
pub const REPLY_LEN: usize = 10;
/// Length of a shape on the wire.
pub const SHAPE_LEN: usize = 2 + 2 * POINTS[1];
/// Most bytes of the host in one reply.
pub const HOST_BYTES: usize = 255;

/// Name of the pipe from board to plant.
pub const TO_PLANT: &str = "to_plant";
/// Name of the pipe from plant to board.
pub const FROM_PLANT: &str = "from_plant";

/// Board → plant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// The tick that is being sampled.
    pub tick: u32,
    /// Phase of the drive at the tick before, turns · 2⁻³².
    pub phase: u32,
    /// Its advance in a tick.
    pub phase_increment: u32,
    /// Amplitude at the tick before, nm.
    pub amplitude_nanometre: u32,
    /// What stands at the shaker's output, nm.
    pub displacement_nanometre: i32,
    /// Whether the shaker's amplifier is on.
    pub amplifier_on: bool,
    /// Whether the board has panicked: its last words.
    pub panicked: bool,
    /// Whether a shape follows ([`shape_to_bytes`]), that of this tick and those to come; at boot
    /// it is the sine.
    pub shape_follows: bool,
}

impl Request {
    /// On the wire.
    #[must_use]
    pub fn to_bytes(self) -> [u8; REQUEST_LEN] {
        let words = [
            self.tick,
            self.phase,
            self.phase_increment,
            self.amplitude_nanometre,
            self.displacement_nanometre.cast_unsigned(),
            u32::from(self.amplifier_on) | u32::from(self.panicked) << 1 | u32::from(self.shape_follows) << 2,
        ];
        let mut bytes = [0; REQUEST_LEN];
        for (place, word) in bytes.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }

    /// From the wire.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; REQUEST_LEN]) -> Self {
        let word = |i: usize| {
            let i = 4 * i;
            u32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]])
        };
        Self {
            tick: word(0),
            phase: word(1),
            phase_increment: word(2),
            amplitude_nanometre: word(3),
            displacement_nanometre: word(4).cast_signed(),
            amplifier_on: word(5) & 1 != 0,
            panicked: word(5) & 2 != 0,
            shape_follows: word(5) & 4 != 0,
        }
    }
}

/// A shape on the wire: how many points a table has, and those; or 0, and the components.
#[must_use]
pub fn shape_to_bytes(shape: Shape<'_>) -> [u8; SHAPE_LEN] {
    let mut bytes = [0; SHAPE_LEN];
    let (count, rest) = bytes.split_at_mut(2);
    match shape {
        Shape::Sines(form) => {
            for (place, component) in rest.chunks_exact_mut(COMPONENT_LEN).zip(form.0) {
                let ([a, b], [c, d]) = (component.share.to_le_bytes(), component.phase.to_le_bytes());
                place.copy_from_slice(&[component.harmonic, a, b, c, d]);
            }
        }
        Shape::Table(table) => {
            let points = table.points();
            count.copy_from_slice(&(points.len() as u16).to_le_bytes());
            for (place, point) in rest.chunks_exact_mut(2).zip(points) {
                place.copy_from_slice(&point.to_le_bytes());
            }
        }
    }
    bytes
}

/// Bytes of a component on the wire.
const COMPONENT_LEN: usize = 5;

/// What is made of a shape from the wire; `None` where no table has so many points.
pub fn shape_from_bytes<T>(bytes: &[u8; SHAPE_LEN], take: impl FnOnce(Shape<'_>) -> T) -> Option<T> {
    let (count, rest) = bytes.split_at(2);
    let pair = |bytes: &[u8], i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
    let count = usize::from(pair(count, 0));
    if count == 0 {
        let mut form = Form::SINE;
        for (component, place) in form.0.iter_mut().zip(rest.chunks_exact(COMPONENT_LEN)) {
            *component = Component { harmonic: place[0], share: pair(place, 1), phase: pair(place, 3) };
        }
        return Some(take(Shape::Sines(&form)));
    }
    let mut points = [0; POINTS[1]];
    for (point, place) in points.iter_mut().zip(rest.chunks_exact(2)) {
        *point = pair(place, 0).cast_signed();
    }
    Some(take(Shape::Table(&Table::of(points.get(..count)?)?)))
}

/// What a test makes the board do after this tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Nothing.
    #[default]
    None,
    /// Send what waits, and end.
    Exit,
    /// Panic.
    Panic,
    /// Keep interrupts off for so many ticks.
    Stall(u16),
    /// The shaker's output fails from now on.
    BreakOutput,
    /// The link takes nothing for so many ticks.
    BlockLink(u16),
    /// Be reset, as by a watchdog; after a panic where it says so.
    Reset(bool),
    /// Panic with a message that panics while it is written; be reset then, or end.
    PanicTwice(bool),
}

/// Plant → board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reply {
    /// Both 16-bit counters at this tick.
    pub counts: [u16; 2],
    /// The input of the base's motion at this tick.
    pub base: u16,
    /// What to do after it.
    pub order: Order,
    /// Bytes of the host that follow.
    pub host_bytes: u8,
}

impl Reply {
    /// On the wire.
    #[must_use]
    pub fn to_bytes(self) -> [u8; REPLY_LEN] {
        let (order, argument) = match self.order {
            Order::None => (0, 0),
            Order::Exit => (1, 0),
            Order::Panic => (2, 0),
            Order::Stall(ticks) => (3, ticks),
            Order::BreakOutput => (4, 0),
            Order::BlockLink(ticks) => (5, ticks),
            Order::Reset(panic) => (6, u16::from(panic)),
            Order::PanicTwice(reset) => (7, u16::from(reset)),
        };
        let [a, b] = self.counts.map(u16::to_le_bytes);
        let (c, d) = (argument.to_le_bytes(), self.base.to_le_bytes());
        [a[0], a[1], b[0], b[1], order, self.host_bytes, c[0], c[1], d[0], d[1]]
    }

    /// From the wire; `None` where the order is none of the known ones.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; REPLY_LEN]) -> Option<Self> {
        let pair = |i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
        let order = match bytes[4] {
            0 => Order::None,
            1 => Order::Exit,
            2 => Order::Panic,
            3 => Order::Stall(pair(6)),
            4 => Order::BreakOutput,
            5 => Order::BlockLink(pair(6)),
            6 => Order::Reset(pair(6) != 0),
            7 => Order::PanicTwice(pair(6) != 0),
            _ => return None,
        };
        Some(Self { counts: [pair(0), pair(2)], base: pair(8), order, host_bytes: bytes[5] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_survive_the_wire() {
        for flags in 0..8 {
            let request = Request {
                tick: 0xfedc_ba98,
                phase: 1,
                phase_increment: u32::MAX,
                amplitude_nanometre: 15_525_000,
                displacement_nanometre: -7,
                amplifier_on: flags & 1 != 0,
                panicked: flags & 2 != 0,
                shape_follows: flags & 4 != 0,
            };
            assert_eq!(Request::from_bytes(&request.to_bytes()), request);
        }
    }

    #[test]
    fn shapes_survive_the_wire_and_a_table_of_too_many_points_is_none() {
        let mut form = Form::SINE;
        for (component, k) in form.0.iter_mut().zip(1..) {
            *component = Component { harmonic: k, share: 5_000 + u16::from(k), phase: 60_000 + u16::from(k) };
        }
        let points: [i16; POINTS[1]] = core::array::from_fn(|j| 200 * (j as i16 - 130));
        for shape in [
            Shape::default(),
            Shape::Sines(&form),
            Shape::Table(&Table::of(&points).unwrap()),
            Shape::Table(&Table::of(&points[100..111]).unwrap()),
        ] {
            assert_eq!(shape_from_bytes(&shape_to_bytes(shape), |found| found == shape), Some(true), "{shape:?}");
        }
        for count in [7_u16, 257] {
            let mut bytes = [0; SHAPE_LEN];
            bytes[..2].copy_from_slice(&count.to_le_bytes());
            assert_eq!(shape_from_bytes(&bytes, |_| ()), None, "{count}");
        }
    }

    #[test]
    fn replies_survive_the_wire_and_unknown_orders_are_none() {
        for order in [
            Order::None,
            Order::Exit,
            Order::Panic,
            Order::Stall(513),
            Order::BreakOutput,
            Order::BlockLink(u16::MAX),
            Order::Reset(true),
            Order::Reset(false),
            Order::PanicTwice(true),
        ] {
            let reply = Reply { counts: [0xfffe, 3], base: 0x8001, order, host_bytes: 255 };
            assert_eq!(Reply::from_bytes(&reply.to_bytes()), Some(reply));
        }
        assert_eq!(Reply::from_bytes(&[0, 0, 0, 0, 8, 0, 0, 0, 0, 0]), None);
    }
}

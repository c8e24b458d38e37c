//! A host that says what it says at given ticks: what makes a run of the emulated board repeatable.

use std::collections::BTreeMap;

use whirl_firmware::Settings;
use whirl_firmware::lock_step::{HOST_BYTES, Order};
use whirl_firmware::settings::HOST_TIMEOUT_MAX_MS;
use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::excitation::{Excitation, Table};
use whirl_shared::frame::{Command, Envelope, HostMessage};

use crate::error::SimulationError;
use crate::virtual_rig::{RigSettings, VirtualRig};

/// Bytes of the host and orders of the test, by the tick after whose sample they come.
#[derive(Clone, Debug, Default)]
pub struct Script {
    bytes: BTreeMap<u32, Vec<u8>>,
    orders: BTreeMap<u32, Order>,
    sequence: u16,
}

impl Script {
    /// A host that says nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// A command, after a tick's sample. Frame numbers are those of the order of calls.
    #[must_use]
    pub fn command(self, tick: u32, command: Command) -> Self {
        let mut buffer = [0; MAX_FRAME];
        let envelope = Envelope { sequence: self.sequence, message: HostMessage::Command(command) };
        // A command is far shorter than the longest frame.
        let length = encode(&envelope, &mut buffer).unwrap_or(0);
        let mut script = self.bytes(tick, &buffer[..length]);
        script.sequence = script.sequence.wrapping_add(1);
        script
    }

    /// Any bytes, after a tick's sample; at most [`HOST_BYTES`] at one tick, what is beyond comes a
    /// tick later.
    #[must_use]
    pub fn bytes(mut self, mut tick: u32, bytes: &[u8]) -> Self {
        for &byte in bytes {
            while self.bytes.get(&tick).is_some_and(|b| b.len() >= HOST_BYTES) {
                tick += 1;
            }
            self.bytes.entry(tick).or_default().push(byte);
        }
        self
    }

    /// Arms and starts the shaker after a tick, and keeps it alive, every `every` ticks, until
    /// another tick.
    #[must_use]
    pub fn drive(
        self,
        from: u32,
        until: u32,
        every: u32,
        amplitude_micrometre: u32,
        frequency_millihertz: u32,
    ) -> Self {
        let start = Command::Start { amplitude_micrometre, frequency_millihertz };
        let script = self.command(from, Command::Arm).command(from, start);
        let ticks = (from..until).step_by(every.max(1) as usize).skip(1);
        ticks.fold(script, |script, tick| script.command(tick, Command::KeepAlive))
    }

    /// What the host says of an excitation, the points of its table first: a command every other
    /// tick, from a tick on.
    #[must_use]
    pub fn excite(self, from: u32, excitation: &Excitation, table: Option<&Table>) -> Self {
        let points = table.into_iter().flat_map(Table::parts).map(Command::Prepare);
        let commands = points.chain(excitation.commands());
        commands.zip((from..).step_by(2)).fold(self, |script, (command, tick)| script.command(tick, command))
    }

    /// Something for the board itself, after a tick's sample.
    #[must_use]
    pub fn order(mut self, tick: u32, order: Order) -> Self {
        self.orders.insert(tick, order);
        self
    }

    /// The host's bytes at a tick.
    pub(super) fn bytes_at(&self, tick: u32) -> &[u8] {
        self.bytes.get(&tick).map_or(&[], Vec::as_slice)
    }

    /// The order at a tick.
    pub(super) fn order_at(&self, tick: u32) -> Order {
        self.orders.get(&tick).copied().unwrap_or_default()
    }
}

/// What the firmware sends on this machine ([`VirtualRig`]) in so many ticks under a script, whose
/// orders are not carried out.
///
/// # Errors
/// As [`VirtualRig`].
pub fn on_this_machine(rig: &RigSettings, script: &Script, ticks: u32) -> Result<Vec<u8>, SimulationError> {
    watched_on_this_machine(rig, script, ticks, |_| ())
}

/// The same, with a look at the rig before each tick.
///
/// # Errors
/// As [`VirtualRig`].
pub fn watched_on_this_machine(
    rig: &RigSettings,
    script: &Script,
    ticks: u32,
    mut look: impl FnMut(&mut VirtualRig),
) -> Result<Vec<u8>, SimulationError> {
    let mut rig = VirtualRig::new(rig)?;
    let mut frames = Vec::new();
    for tick in 0..ticks {
        look(&mut rig);
        rig.step()?;
        frames.extend(rig.take_output());
        rig.give_input(script.bytes_at(tick));
    }
    Ok(frames)
}

/// The settings of the emulated board's image, for [`on_this_machine`]; its build is taken from
/// what it says in its hello (`whirl-firmware 0.1.0 (1a2b3c4d)`).
pub fn board_settings(firmware: &str) -> Settings {
    let build = firmware.split_once(" (").and_then(|(_, rest)| rest.strip_suffix(')')).unwrap_or_default();
    Settings {
        board: "mps2-an386",
        // On a board this text is part of the image; here it lives as long as the program.
        build: String::leak(build.to_owned()),
        boot_id: 1,
        host_timeout_ms: HOST_TIMEOUT_MAX_MS,
        base_input: true,
        ..Settings::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_at_their_ticks_and_no_more_than_fit() {
        let script = Script::new().bytes(3, &[1; 300]).bytes(4, &[2]);
        assert_eq!(script.bytes_at(3).len(), HOST_BYTES);
        assert_eq!(script.bytes_at(4), [[1; 45].as_slice(), &[2]].concat());
        assert_eq!(script.bytes_at(5), []);
    }

    #[test]
    fn a_driven_script_runs_the_shaker() {
        let script = Script::new().drive(10, 2_000, 400, 15_525, 5_000);
        let rig = RigSettings::default();
        let frames = on_this_machine(&rig, &script, 2_000).unwrap();
        assert_eq!(frames, on_this_machine(&rig, &script, 2_000).unwrap());
        let quiet = on_this_machine(&rig, &Script::new(), 2_000).unwrap();
        assert_ne!(frames, quiet);
    }
}

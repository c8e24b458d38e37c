//! What a host may ask for, and the answer.

use serde::{Deserialize, Serialize};

use super::Setting;
use crate::excitation::Part;

/// A command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// Send a [`Hello`](super::Hello).
    Hello,
    /// The host is alive (every valid command says so too).
    KeepAlive,
    /// Allow the shaker to be started.
    Arm,
    /// Stop and forbid starting; clears a fault.
    Disarm,
    /// Ramp to an amplitude at a frequency. While running: ramp to the new amplitude; the frequency
    /// must be the same.
    Start {
        /// Amplitude of the base, µm.
        amplitude_micrometre: u32,
        /// Frequency, mHz.
        frequency_millihertz: u32,
    },
    /// Ramp down to rest.
    Stop,
    /// Rate of amplitude changes, µm/s; refused while the shaker moves.
    SetRamp {
        /// µm/s.
        micrometre_per_s: u32,
    },
    /// Time without a command after which the shaker stops, ms; refused while it moves.
    SetHostTimeout {
        /// ms.
        ms: u32,
    },
    /// Take the present position of every encoder as zero; refused while the shaker moves.
    ZeroCounts,
    /// Send a [`Status`](super::Status) now.
    Status,
    /// What is to be streamed from now on, whatever the shaker does.
    Stream(Streamed),
    /// Keep a setting, in force from the next boot on; refused unless the shaker is disarmed. A
    /// [`Hello`](super::Hello) tells whether it was kept.
    Set(Setting),
    /// Reset; refused unless the shaker is disarmed.
    Restart,
    /// Send samples again, as [`DeviceMessage::Restored`](super::DeviceMessage::Restored), behind
    /// everything else that is to be sent. It takes the place of what was asked for before; refused
    /// where the boot is another one.
    BackFill {
        /// [`Hello::boot_id`](super::Hello::boot_id) of the boot whose ticks these are.
        boot_id: u32,
        /// First tick.
        first_tick: u32,
        /// Number of ticks.
        ticks: u32,
    },
    /// A part of what [`Command::Excite`] is to do; refused while the shaker moves.
    Prepare(Part),
    /// As [`Command::Start`], of what has been prepared; refused while the shaker moves. Answered
    /// by an [`Excited`](super::Excited), too.
    Excite {
        /// Frequency at the start, mHz.
        frequency_millihertz: u32,
    },
}

/// What a device streams.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Streamed {
    /// Every sample ([`SampleBlock`](super::SampleBlock)); so it is at boot.
    #[default]
    Samples,
    /// The regression rows of every window ([`Rows`](super::Rows)) instead: a third of the bytes at
    /// a drive of 5 Hz.
    Rows,
}

/// Answer to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ack {
    /// Sequence number of the envelope that carried the command.
    pub command_sequence: u16,
    /// What became of it.
    pub result: CommandResult,
}

/// What became of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CommandResult {
    /// Carried out.
    Done,
    /// A value is beyond its limit; nothing changed.
    OutOfRange {
        /// The limit, in the command's unit.
        limit: u32,
    },
    /// Not in this state of the shaker; nothing changed.
    WrongState,
    /// Not known to this firmware.
    Unsupported,
}

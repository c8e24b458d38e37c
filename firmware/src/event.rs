//! What the two halves tell each other.

use heapless::Vec;
use whirl_shared::frame::{Ack, Command, Excited, MOST_ENCODERS, ResetCause, Status, Zero};

use crate::adjust::Words;
use crate::preview::Turning;

/// A command on its way to the interrupt half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Sequence number of the frame that brought it.
    pub sequence: u16,
    /// The command.
    pub command: Command,
}

/// Something that the interrupt half reports besides samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A hello is to be sent.
    Hello(Present),
    /// Settings are to be kept; a hello then tells what became of it.
    Keep(Words, Present),
    /// The board is to restart when all before this has been sent.
    Restart,
    /// A status is to be sent.
    Status(Snapshot),
    /// A command was carried out or refused.
    Ack(Ack),
    /// What the shaker does.
    Excited(Excited),
    /// A line for people.
    Log {
        /// Present tick.
        tick: u32,
        /// What happened.
        notice: Notice,
    },
}

/// The interrupt half's share of a hello.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Present {
    /// Present tick.
    pub tick: u32,
    /// Host time-out in force, ms.
    pub host_timeout_ms: u32,
    /// The encoders' zeros.
    pub zeros: Vec<Zero, MOST_ENCODERS>,
}

/// The interrupt half's share of a status.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Snapshot {
    /// Its counters and the shaker; the fields of the thread half are zero.
    pub status: Status,
    /// The last whole second of the encoders.
    pub turning: Vec<Turning, MOST_ENCODERS>,
}

/// What is worth a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Notice {
    /// The host fell silent; the shaker stops.
    HostSilent,
    /// The shaker's output failed; the shaker is cut off.
    OutputFailed,
    /// A limit was about to be exceeded; the shaker is cut off.
    LimitExceeded,
    /// The emergency stop has cut the enable line.
    EmergencyStop,
    /// An index mark was not where it had been.
    IndexSlipped(u8),
    /// The boot before this one did not end in order.
    Reset(ResetCause),
}

impl Notice {
    /// 0 error, 1 warning, 2 information.
    #[must_use]
    pub const fn level(self) -> u8 {
        match self {
            Self::HostSilent | Self::IndexSlipped(_) => 1,
            Self::OutputFailed | Self::LimitExceeded | Self::EmergencyStop | Self::Reset(_) => 0,
        }
    }

    /// In words, at most [`whirl_shared::frame::TEXT_LEN`] bytes.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::HostSilent => "host silent: shaker stops and disarms",
            Self::OutputFailed => "shaker output failed: cut off",
            Self::LimitExceeded => "shaker limit about to be exceeded: cut off",
            Self::EmergencyStop => "emergency stop: amplifier cut off",
            Self::IndexSlipped(0) => "encoder 1 has lost counts: its index moved",
            Self::IndexSlipped(_) => "encoder 2 has lost counts: its index moved",
            Self::Reset(ResetCause::Panic) => "restarted after a panic: see the hello's text",
            Self::Reset(ResetCause::Watchdog) => "restarted by the watchdog: firmware stood still",
            Self::Reset(_) => "restarted",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_notice_fits_into_a_log_line() {
        for notice in [
            Notice::HostSilent,
            Notice::OutputFailed,
            Notice::LimitExceeded,
            Notice::EmergencyStop,
            Notice::IndexSlipped(0),
            Notice::IndexSlipped(1),
            Notice::Reset(ResetCause::Panic),
            Notice::Reset(ResetCause::Watchdog),
            Notice::Reset(ResetCause::Software),
        ] {
            assert!(
                !notice.text().is_empty() && notice.text().len() <= whirl_shared::frame::TEXT_LEN,
                "{}",
                notice.text()
            );
        }
    }
}

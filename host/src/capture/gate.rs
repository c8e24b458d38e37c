//! Only a device that answers is listened to.
//!
//! What a link holds when it is opened (a probe's ring buffer, a port's or a network bridge's
//! queue) may be of an earlier boot, or of another session: its ticks and counts are not those of
//! the rig as it is. So nothing is recorded until a hello has come behind the acknowledgement of a
//! hello command of this session; commands are numbered from a number of the session's own.

use whirl_shared::frame::{DeviceMessage, Hello};

/// Sent hello commands that are remembered: those of half a minute.
const REMEMBERED: usize = 64;

/// Closed until the device has answered.
#[derive(Debug, Default)]
pub(super) struct Gate {
    asked: Vec<u16>,
    acknowledged: bool,
    open: bool,
    /// A hello that answered nothing, for the message where none does.
    pub(super) stranger: Option<Hello>,
}

impl Gate {
    /// A hello command was sent under this number.
    pub(super) fn asked(&mut self, sequence: u16) {
        if self.asked.len() >= REMEMBERED {
            self.asked.remove(0);
        }
        self.asked.push(sequence);
    }

    /// Whether the device has answered.
    pub(super) fn is_open(&self) -> bool {
        self.open
    }

    /// Takes a message; true where it opens the gate.
    pub(super) fn opens(&mut self, message: &DeviceMessage) -> bool {
        match message {
            DeviceMessage::Ack(ack) => self.acknowledged |= self.asked.contains(&ack.command_sequence),
            DeviceMessage::Hello(hello) if !self.open => {
                self.open = self.acknowledged;
                self.stranger = Some(hello.clone());
                return self.open;
            }
            _ => {}
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whirl_shared::frame::{Ack, CommandResult, PROTOCOL_VERSION, SCHEMA_HASH};

    #[test]
    fn only_the_answer_to_its_own_command_opens_it() {
        let hello = DeviceMessage::Hello(Hello {
            protocol: PROTOCOL_VERSION,
            schema: SCHEMA_HASH,
            boot_id: 1,
            sample_rate_millihertz: 500_000,
            counts_per_turn: [4096; 2].into(),
            block_len: 10,
            host_timeout_ms: 2000,
            ..Hello::default()
        });
        let ack = |command_sequence| DeviceMessage::Ack(Ack { command_sequence, result: CommandResult::Done });
        let mut gate = Gate::default();
        // Left over from before: a hello, and the answers to another session's commands.
        assert!(!gate.opens(&hello) && !gate.opens(&ack(0)) && !gate.opens(&hello));
        gate.asked(40_000);
        assert!(!gate.opens(&ack(1)) && !gate.opens(&hello) && gate.stranger.is_some());
        assert!(!gate.opens(&ack(40_000)) && !gate.is_open());
        assert!(gate.opens(&hello) && gate.is_open() && !gate.opens(&hello));
    }
}

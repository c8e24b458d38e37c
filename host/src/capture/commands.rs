//! Commands to the device, one at a time, each repeated until it is acknowledged.

use std::time::{Duration, Instant};

use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::frame::{Ack, Command, CommandResult, Envelope, HostMessage};

/// How long an answer may take before the command is sent again.
const TIMEOUT: Duration = Duration::from_millis(400);
/// How often a command is sent.
const TRIES: u32 = 8;

/// What became of the command under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// No answer yet.
    Waiting,
    /// The device answered.
    Answered(Command, CommandResult),
    /// It never answered.
    Silent(Command),
}

/// The host's sending end.
#[derive(Debug)]
pub(super) struct Commands {
    sequence: u16,
    under_way: Option<UnderWay>,
    /// Frames to be sent.
    out: Vec<u8>,
}

#[derive(Debug)]
struct UnderWay {
    command: Command,
    /// Numbers under which it was sent.
    sequences: Vec<u16>,
    sent: Instant,
}

impl Commands {
    /// Numbered from `first` on.
    pub(super) fn new(first: u16) -> Self {
        Self { sequence: first, under_way: None, out: Vec::new() }
    }

    /// Sends a command whose answer does not matter.
    pub(super) fn send(&mut self, command: Command) -> u16 {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        let envelope = Envelope { sequence, message: HostMessage::Command(command) };
        let mut frame = [0; MAX_FRAME];
        // MAX_FRAME holds every message.
        if let Ok(n) = encode(&envelope, &mut frame) {
            self.out.extend_from_slice(&frame[..n]);
        }
        sequence
    }

    /// Sends a command and waits for its answer; one under way before is given up.
    pub(super) fn ask(&mut self, command: Command, now: Instant) {
        let sequence = self.send(command);
        self.under_way = Some(UnderWay { command, sequences: vec![sequence], sent: now });
    }

    /// Takes an answer.
    pub(super) fn ack(&mut self, ack: &Ack) -> Outcome {
        match &self.under_way {
            Some(u) if u.sequences.contains(&ack.command_sequence) => {
                let command = u.command;
                self.under_way = None;
                Outcome::Answered(command, ack.result)
            }
            _ => Outcome::Waiting,
        }
    }

    /// Sends the command under way again where its time is up.
    pub(super) fn poll(&mut self, now: Instant) -> Outcome {
        let Some(mut u) = self.under_way.take() else {
            return Outcome::Waiting;
        };
        if now.duration_since(u.sent) >= TIMEOUT {
            if u.sequences.len() as u32 >= TRIES {
                return Outcome::Silent(u.command);
            }
            u.sequences.push(self.send(u.command));
            u.sent = now;
        }
        self.under_way = Some(u);
        Outcome::Waiting
    }

    /// Whether a command waits for its answer.
    pub(super) fn busy(&self) -> bool {
        self.under_way.is_some()
    }

    /// The link was lost: what was to be sent is void, and the command under way is sent anew.
    pub(super) fn reconnected(&mut self, now: Instant) {
        self.out.clear();
        // A zero ends whatever the device has of a cut frame.
        self.out.push(0);
        if let Some(u) = self.under_way.take() {
            self.ask(u.command, now);
        }
    }

    /// Bytes to be sent now.
    pub(super) fn take_bytes(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_repeated_until_answered_or_given_up() {
        let mut commands = Commands::new(0);
        let start = Instant::now();
        commands.ask(Command::Arm, start);
        assert!(!commands.take_bytes().is_empty() && commands.busy());
        assert_eq!(commands.poll(start), Outcome::Waiting);
        assert!(commands.take_bytes().is_empty());
        assert_eq!(commands.poll(start + TIMEOUT), Outcome::Waiting);
        assert!(!commands.take_bytes().is_empty());
        // The answer to the first sending counts too; a foreign one does not.
        assert_eq!(commands.ack(&Ack { command_sequence: 77, result: CommandResult::Done }), Outcome::Waiting);
        let answered = commands.ack(&Ack { command_sequence: 0, result: CommandResult::WrongState });
        assert_eq!(answered, Outcome::Answered(Command::Arm, CommandResult::WrongState));
        assert!(!commands.busy());
        commands.ask(Command::Stop, start);
        let mut now = start;
        for _ in 1..TRIES {
            now += TIMEOUT;
            assert_eq!(commands.poll(now), Outcome::Waiting);
        }
        assert_eq!(commands.poll(now + TIMEOUT), Outcome::Silent(Command::Stop));
    }
}

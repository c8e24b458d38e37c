//! What a request does, and its answer.

use whirl_shared::frame::{Ack, Command, CommandResult, Excited, SampleBlock, Setting, ShakerState};

use super::Sampler;
use crate::event::{Event, Request};
use crate::inputs::Inputs;
use crate::output::ShakerOutput;
use crate::queue::Sink;

impl<I: Inputs, O: ShakerOutput> Sampler<I, O> {
    pub(super) fn carry_out(
        &mut self,
        request: Request,
        blocks: &mut impl Sink<SampleBlock>,
        events: &mut impl Sink<Event>,
    ) {
        let ramp_before = self.shaker.drive().state;
        let mut result = self.shaker.command(request.command);
        if let (CommandResult::Done, Command::Set(setting)) = (result, request.command) {
            result = self.keep(setting, events);
        }
        if let Command::BackFill { boot_id, .. } = request.command
            && boot_id != self.boot_id
        {
            // The ticks of another boot.
            result = CommandResult::WrongState;
        }
        if result != CommandResult::Done {
            self.rejected = self.rejected.wrapping_add(1);
        }
        self.put_event(Event::Ack(Ack { command_sequence: request.sequence, result }), events);
        if matches!(request.command, Command::Start { .. } | Command::Excite { .. }) {
            let _ = self.shaker.take_begun();
            if result == CommandResult::Done {
                self.excited = Excited { tick: self.tick, excitation: *self.shaker.excitation() };
                self.constant = self.excited.excitation.is_constant();
            }
            self.put_event(Event::Excited(self.excited), events);
        }
        if result != CommandResult::Done {
            return;
        }
        match request.command {
            Command::Start { .. } | Command::Excite { .. } if ramp_before == ShakerState::Ramping => self.flush(blocks),
            Command::ZeroCounts => {
                self.flush(blocks);
                self.base.zero();
                self.last_counts = None;
                // Each of a boot's zeros has an id of its own, and none that of another boot but by
                // chance.
                let id = (self.boot_id ^ self.tick.wrapping_add(1)).wrapping_mul(0x0100_0193);
                for channel in &mut self.channels {
                    channel.encoder.zero();
                    channel.reference.set_zero(id);
                }
                self.put_event(Event::Hello(self.present()), events);
            }
            Command::Hello | Command::SetRamp { .. } | Command::SetHostTimeout { .. } => {
                self.put_event(Event::Hello(self.present()), events);
            }
            Command::Restart => self.put_event(Event::Restart, events),
            Command::Status => self.put_status(events),
            _ => {}
        }
    }

    /// Takes a setting: for the next boot.
    fn keep(&mut self, setting: Setting, events: &mut impl Sink<Event>) -> CommandResult {
        let new = match self.settings[0].with(setting, &self.settings[1]) {
            Ok(new) => new,
            Err(refused) => return refused,
        };
        if events.put(Event::Keep(new.to_words(), self.present())).is_err() {
            return CommandResult::WrongState;
        }
        self.settings[0] = new;
        CommandResult::Done
    }
}

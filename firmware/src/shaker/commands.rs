//! What the host may tell the shaker.

use whirl_shared::excitation::{Excitation, Part};
use whirl_shared::frame::{Command, CommandResult, ShakerState, StopCause};

use super::Shaker;
use crate::excite::Run;
use crate::output::ShakerOutput;
use crate::settings::{HOST_TIMEOUT_MAX_MS, HOST_TIMEOUT_MIN_MS};

impl<O: ShakerOutput> Shaker<O> {
    /// Carries a command out, or refuses it and changes nothing.
    ///
    /// `Hello`, `KeepAlive`, `Status`, `Stream`, `BackFill`, `ZeroCounts`, `Set` and `Restart` only
    /// ask whether they may be carried out.
    pub fn command(&mut self, command: Command) -> CommandResult {
        let result = match command {
            Command::Hello | Command::KeepAlive | Command::Status | Command::Stream(_) | Command::BackFill { .. } => {
                CommandResult::Done
            }
            Command::Arm => self.arm(),
            Command::Disarm => self.command_disarm(),
            Command::Start { amplitude_micrometre, frequency_millihertz } => {
                self.excite(Excitation::sine(amplitude_micrometre, frequency_millihertz))
            }
            Command::Prepare(_) if self.moving() => CommandResult::WrongState,
            // What waits for its trigger keeps its table.
            Command::Prepare(Part::Points { .. }) if self.waiting => CommandResult::WrongState,
            Command::Prepare(part) => match self.prepared.put(part, &mut self.table) {
                Ok(()) => CommandResult::Done,
                Err(limit) => CommandResult::OutOfRange { limit },
            },
            Command::Excite { frequency_millihertz } => {
                self.excite(Excitation { frequency_millihertz, ..self.prepared })
            }
            Command::Stop => {
                self.waiting = false;
                if matches!(self.state, ShakerState::Ramping | ShakerState::Running) {
                    self.stop(StopCause::Command, true);
                }
                CommandResult::Done
            }
            Command::SetRamp { .. } | Command::SetHostTimeout { .. } | Command::ZeroCounts if self.moving() => {
                CommandResult::WrongState
            }
            Command::Set(_) | Command::Restart if self.state != ShakerState::Disarmed => CommandResult::WrongState,
            Command::ZeroCounts | Command::Set(_) | Command::Restart => CommandResult::Done,
            Command::SetRamp { micrometre_per_s } => {
                let result = within(micrometre_per_s, 1, self.limits.ramp_micrometre_per_s);
                if result == CommandResult::Done {
                    self.ramp.set_rate(micrometre_per_s);
                }
                result
            }
            Command::SetHostTimeout { ms } => {
                let result = within(ms, HOST_TIMEOUT_MIN_MS, HOST_TIMEOUT_MAX_MS);
                if result == CommandResult::Done {
                    self.host_timeout_ms = ms;
                }
                result
            }
        };
        if result == CommandResult::Done {
            self.silent_ticks = 0;
            self.heard = true;
        }
        result
    }

    fn arm(&mut self) -> CommandResult {
        match self.state {
            ShakerState::Armed => CommandResult::Done,
            ShakerState::Disarmed => {
                if self.output.write(0).is_ok() && self.output.enable(true).is_ok() {
                    self.state = ShakerState::Armed;
                    CommandResult::Done
                } else {
                    self.fault(StopCause::Fault);
                    CommandResult::WrongState
                }
            }
            _ => CommandResult::WrongState,
        }
    }

    fn command_disarm(&mut self) -> CommandResult {
        match self.state {
            ShakerState::Ramping | ShakerState::Running => self.stop(StopCause::Command, false),
            ShakerState::Stopping => self.armed_after_stop = false,
            ShakerState::Disarmed | ShakerState::Armed | ShakerState::Faulted => self.disarm(),
        }
        // An output that still fails keeps its fault.
        if self.state == ShakerState::Faulted { CommandResult::WrongState } else { CommandResult::Done }
    }

    fn excite(&mut self, new: Excitation) -> CommandResult {
        if !matches!(self.state, ShakerState::Armed | ShakerState::Ramping | ShakerState::Running) {
            return CommandResult::WrongState;
        }
        // Of no table, or of one of a count that cannot be, nothing is known.
        let extent = self.table.extent(new.table.points).unwrap_or_default();
        let of_table = || extent.refusal(&new, &self.limits, self.sample_rate_millihertz);
        if let Some(refusal) = new.refusal(&self.limits).or_else(of_table) {
            return CommandResult::OutOfRange { limit: refusal.limit() };
        }
        let Some(run) = Run::new(new, self.sample_rate_millihertz) else {
            return CommandResult::OutOfRange { limit: self.limits.frequency_millihertz };
        };
        let old = &self.run.excitation;
        if !self.moving() {
            self.run = run;
            self.table.take(extent);
            self.waiting = new.on_trigger;
            if !self.waiting {
                self.begin();
            }
        } else if old.is_constant() && new.is_constant() && old.frequency_millihertz == new.frequency_millihertz {
            // Another amplitude, and nothing else.
            self.run = run;
            self.go_to(run.target());
        } else {
            return CommandResult::WrongState;
        }
        CommandResult::Done
    }
}

fn within(found: u32, min: u32, max: u32) -> CommandResult {
    if found < min {
        CommandResult::OutOfRange { limit: min }
    } else if found > max {
        CommandResult::OutOfRange { limit: max }
    } else {
        CommandResult::Done
    }
}

//! The shaker during a capture: arm, start, wait until it runs, keep it alive, stop and disarm at
//! the end.
//!
//! The device stops by itself when the host is silent, so that a host that died leaves a shaker at
//! rest. Where the link was lost for longer than that, or the device has restarted, the shaker
//! stays off, and a warning says so: people may be at the rig by then. It is started again only
//! where that was asked for.

use std::time::{Duration, Instant};

use whirl_shared::excitation::{Excitation, Table};
use whirl_shared::frame::{Command, CommandResult, Hello, ShakerState, Status, StopCause};

use super::commands::{Commands, Outcome};
use super::excite;
use crate::error::{BadInput, Result};
use crate::warning::Warning;

/// How long the shaker may take to come to rest before a new start, and over its ramp.
const PATIENCE: Duration = Duration::from_secs(20);

/// Stops of the shaker that are told; of more, the last one is.
const MOST_WARNINGS: usize = 16;

/// What is asked of the shaker, and the table that it names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Target(pub(super) Excitation, pub(super) Option<Table>);

impl Target {
    /// Amplitude of the base at the start, µm.
    pub(super) fn amplitude_micrometre(&self) -> u32 {
        self.0.amplitudes_micrometre[0]
    }

    /// Frequency at the start, mHz.
    pub(super) fn frequency_millihertz(&self) -> u32 {
        self.0.frequency_millihertz
    }

    /// The commands that start it, one after the other.
    fn commands(&self) -> Vec<Command> {
        if self.0.is_constant() && !self.0.on_trigger {
            let (amplitude_micrometre, frequency_millihertz) =
                (self.amplitude_micrometre(), self.frequency_millihertz());
            vec![Command::Start { amplitude_micrometre, frequency_millihertz }]
        } else {
            let points = self.1.iter().flat_map(Table::parts).map(Command::Prepare);
            points.chain(self.0.commands()).collect()
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Nothing commanded yet.
    Idle,
    /// Coming to rest before it is armed.
    Clearing,
    Arming,
    Starting,
    /// Started; not known to run yet.
    Ramping,
    Running,
    Stopping,
    Disarming,
    /// Told to rest; not known to be at rest yet.
    Resting,
    /// At rest, or given up.
    Off,
}

/// The shaker's operator.
#[derive(Debug)]
pub(super) struct Drive {
    target: Option<Target>,
    /// Whether a shaker that has stopped by itself is started again.
    restart: bool,
    step: Step,
    /// What is still to be commanded for the start, the last one first.
    to_start: Vec<Command>,
    since: Instant,
    asked_status: Instant,
    limits: String,
    pub(super) warnings: Vec<Warning>,
}

impl Drive {
    pub(super) fn new(target: Option<Target>, restart: bool, now: Instant) -> Self {
        Self {
            target,
            restart,
            step: Step::Idle,
            to_start: Vec::new(),
            since: now,
            asked_status: now,
            limits: String::new(),
            warnings: Vec::new(),
        }
    }

    fn go(&mut self, step: Step, now: Instant) {
        self.step = step;
        self.since = now;
    }

    /// What is asked of the shaker.
    pub(super) fn target(&self) -> Option<Target> {
        self.target
    }

    /// Another amplitude, µm, for a drive that runs.
    pub(super) fn adjust(&mut self, amplitude_micrometre: u32, commands: &mut Commands, now: Instant) {
        if let Some(target) = &mut self.target {
            target.0.amplitudes_micrometre[0] = amplitude_micrometre;
            if self.step == Step::Running {
                let frequency_millihertz = target.frequency_millihertz();
                commands.ask(Command::Start { amplitude_micrometre, frequency_millihertz }, now);
            }
        }
    }

    /// Starts the drive (once the device has said hello).
    pub(super) fn start(&mut self, hello: &Hello, commands: &mut Commands, now: Instant) {
        let l = hello.limits;
        self.limits = format!(
            "the device allows {} mm, {} Hz and the acceleration that both together give",
            f64::from(l.amplitude_micrometre) / 1000.0,
            f64::from(l.frequency_millihertz) / 1000.0
        );
        if self.target.is_some() && self.step == Step::Idle {
            commands.ask(Command::Arm, now);
            self.go(Step::Arming, now);
        }
    }

    /// The link is there again: patience begins anew.
    ///
    /// # Errors
    /// It was lost while the shaker was being started, and is not to be started again: it would
    /// move when nobody expects it.
    pub(super) fn reconnected(&mut self, now: Instant) -> Result<()> {
        self.since = now;
        if self.starting() && !self.restart {
            return Err(BadInput::new("a link that was lost while the shaker was being started", "a link that holds")
                .at("drive")
                .remedy("See to the cable and capture again; --restart-drive starts the shaker after such a gap"));
        }
        Ok(())
    }

    /// Whether the shaker may be moving on this program's command.
    pub(super) fn active(&self) -> bool {
        !matches!(self.step, Step::Idle | Step::Off)
    }

    /// Whether [`Drive::stop`] has come to its end.
    pub(super) fn off(&self) -> bool {
        matches!(self.step, Step::Idle | Step::Off)
    }

    /// Whether the drive is on its way to the target, for the progress line.
    pub(super) fn starting(&self) -> bool {
        matches!(self.step, Step::Clearing | Step::Arming | Step::Starting | Step::Ramping)
    }

    /// Whether it is brought to rest, for the progress line.
    pub(super) fn stopping(&self) -> bool {
        matches!(self.step, Step::Stopping | Step::Disarming | Step::Resting)
    }

    /// The next command of the start; behind the last one it ramps.
    fn go_on(&mut self, commands: &mut Commands, now: Instant) {
        if let Some(command) = self.to_start.pop() {
            commands.ask(command, now);
            self.go(Step::Starting, now);
        } else {
            commands.send(Command::Status);
            self.asked_status = now;
            self.go(Step::Ramping, now);
        }
    }

    /// Ramps down and disarms.
    pub(super) fn stop(&mut self, commands: &mut Commands, now: Instant) {
        if self.active() {
            commands.ask(Command::Stop, now);
            self.go(Step::Stopping, now);
        }
    }

    /// Takes what became of a command.
    ///
    /// # Errors
    /// The device refuses the drive, or does not answer.
    pub(super) fn outcome(&mut self, outcome: Outcome, commands: &mut Commands, now: Instant) -> Result<()> {
        match (outcome, self.step) {
            (Outcome::Waiting, _) => {}
            (Outcome::Answered(Command::Arm, CommandResult::Done), Step::Arming) => {
                if let Some(t) = self.target {
                    self.to_start = t.commands();
                    self.to_start.reverse();
                    self.go_on(commands, now);
                }
            }
            // It moves, or has a fault: bring it to rest, then arm anew.
            (Outcome::Answered(Command::Arm, CommandResult::WrongState), Step::Arming) => {
                commands.ask(Command::Disarm, now);
                self.go(Step::Clearing, now);
            }
            (
                Outcome::Answered(
                    Command::Start { .. } | Command::Prepare(_) | Command::Excite { .. },
                    CommandResult::Done,
                ),
                Step::Starting,
            ) => self.go_on(commands, now),
            (
                Outcome::Answered(
                    Command::Start { .. } | Command::Prepare(_) | Command::Excite { .. },
                    CommandResult::OutOfRange { limit },
                ),
                Step::Starting,
            ) => {
                let t = self.target.map_or_else(String::new, |t| excite::words(&t.0));
                return Err(BadInput::new(t, format!("within the shaker's limits (here {limit}); {}", self.limits))
                    .at("drive")
                    .remedy(
                        "Set drive.amplitude_m and drive.frequency_hz of the rig file, or --amplitude-m, within them",
                    ));
            }
            (Outcome::Answered(Command::Stop, _) | Outcome::Silent(Command::Stop), Step::Stopping) => {
                commands.ask(Command::Disarm, now);
                self.go(Step::Disarming, now);
            }
            (Outcome::Answered(Command::Disarm, _), Step::Disarming) => {
                commands.send(Command::Status);
                self.asked_status = now;
                self.go(Step::Resting, now);
            }
            (Outcome::Silent(Command::Disarm), Step::Disarming) => self.go(Step::Off, now),
            (Outcome::Answered(Command::Disarm, CommandResult::Done), Step::Clearing) => {}
            (Outcome::Answered(command, result), Step::Arming | Step::Starting | Step::Clearing) => {
                return Err(BadInput::new(
                    format!("{result:?} in answer to {command:?}"),
                    "a shaker that can be started",
                )
                .at("drive")
                .remedy("Look at the shaker's amplifier and the device's log; `--no-drive` records without it"));
            }
            (Outcome::Silent(command), Step::Arming | Step::Starting | Step::Clearing) => {
                return Err(BadInput::new(format!("no answer to {command:?}"), "an acknowledgement")
                    .at("drive")
                    .remedy(
                        "The device sends but does not hear: look at the line from host to device, and its baud rate",
                    ));
            }
            (Outcome::Answered(..) | Outcome::Silent(_), _) => {}
        }
        Ok(())
    }

    /// Takes a status of the device.
    ///
    /// # Errors
    /// The shaker has a fault.
    pub(super) fn status(&mut self, status: &Status, commands: &mut Commands, now: Instant) -> Result<()> {
        let Some(target) = self.target else { return Ok(()) };
        match (self.step, status.shaker) {
            (Step::Resting, ShakerState::Disarmed | ShakerState::Faulted) => self.go(Step::Off, now),
            (Step::Clearing, ShakerState::Disarmed | ShakerState::Armed) if !commands.busy() => {
                commands.ask(Command::Arm, now);
                self.go(Step::Arming, now);
            }
            (Step::Ramping, ShakerState::Running)
                if status.amplitude_nanometre == target.amplitude_micrometre().saturating_mul(1000) =>
            {
                self.go(Step::Running, now);
            }
            // It waits for its trigger, however long that takes.
            (Step::Ramping, ShakerState::Armed) if target.0.on_trigger => self.since = now,
            (Step::Ramping | Step::Running, ShakerState::Faulted) if status.stop_cause == StopCause::EmergencyStop => {
                return Err(BadInput::new("a shaker whose emergency stop is pressed", "one that may run")
                    .at("drive")
                    .remedy("See why it was pressed; release it, then capture again"));
            }
            (Step::Ramping | Step::Running, ShakerState::Faulted) => {
                return Err(BadInput::new(format!("a shaker with a fault ({:?})", status.stop_cause), "one that runs")
                    .at("drive")
                    .remedy("Look at the shaker's amplifier and the device's log"));
            }
            // A status may be older than the start: the device has restarted only if it stays so.
            (Step::Ramping, ShakerState::Disarmed)
                if !self.restart && now.duration_since(self.since) > Duration::from_secs(1) =>
            {
                return Err(BadInput::new(
                    "a device that has restarted while the shaker was being started",
                    "one that runs",
                )
                .at("drive")
                .remedy(
                    "Look after its power supply and capture again; --restart-drive starts the shaker after a restart",
                ));
            }
            (Step::Ramping, ShakerState::Disarmed) if now.duration_since(self.since) > Duration::from_secs(1) => {
                commands.ask(Command::Arm, now);
                self.go(Step::Arming, now);
            }
            (Step::Running, ShakerState::Disarmed | ShakerState::Armed | ShakerState::Stopping) => {
                let cause = match status.stop_cause {
                    StopCause::HostSilent => "it had not heard from the host",
                    StopCause::None => "the device has restarted",
                    _ => "it was commanded to",
                };
                let (then, next) = if self.restart {
                    ("it is started again", (Command::Arm, Step::Arming))
                } else {
                    ("it stays off (--restart-drive starts it again)", (Command::Disarm, Step::Disarming))
                };
                self.warnings.truncate(MOST_WARNINGS - 1);
                self.warnings.push(Warning::new(
                    "drive-stopped",
                    format!("the shaker stopped at the device's tick {}: {cause}; {then}", status.tick),
                    "The record holds the amplitude at each sample; identify uses stretches with a steady drive",
                ));
                commands.ask(next.0, now);
                self.go(next.1, now);
            }
            _ => {}
        }
        Ok(())
    }

    /// What time demands.
    ///
    /// # Errors
    /// The shaker does not come to run.
    pub(super) fn poll(&mut self, commands: &mut Commands, now: Instant) -> Result<()> {
        if !matches!(self.step, Step::Clearing | Step::Ramping | Step::Resting) {
            return Ok(());
        }
        if self.step != Step::Resting && now.duration_since(self.since) > PATIENCE {
            return Err(BadInput::new(
                format!("a shaker that does not run {} s after its start", PATIENCE.as_secs()),
                "the commanded amplitude",
            )
            .at("drive")
            .remedy("Look at the device's ramp rate and log; `--no-drive` records without it"));
        }
        if now.duration_since(self.asked_status) > Duration::from_millis(100) {
            commands.send(Command::Status);
            self.asked_status = now;
        }
        Ok(())
    }
}

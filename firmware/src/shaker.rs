//! The shaker: it never moves unless told to, and stops when the host is silent.
//!
//! ```text
//!              arm                start             amplitude reached
//!  Disarmed ─────────▶ Armed ─────────────▶ Ramping ─────────────────▶ Running
//!     ▲ ▲   ◀─────────   ▲                     │  ◀───────────────────   │
//!     │ │     disarm     │ at rest, after stop │   start (new amplitude) │
//!     │ │                └──────────────┐      │ stop, disarm, silence   │
//!     │ └── at rest, after disarm/silence ── Stopping ◀──────────────────┘
//!     │ disarm
//!  Faulted ◀── the output fails or a limit would be exceeded, from anywhere
//! ```
//!
//! Displacement y = a cos φ: φ is the phase accumulator ([`whirl_shared::waveform`]), a the ramp
//! ([`crate::ramp`]). φ starts at 0 with every start and advances while the shaker moves and only
//! then. The frequency cannot change while it moves. Amplitude, frequency and acceleration a(2πf)²
//! are limited; a refused command changes nothing.
//!
//! The watchdog counts sampling ticks, missed ones too, since the last command that was carried
//! out.

use whirl_shared::frame::{Command, CommandResult, ShakerLimits, ShakerState, StopCause};
use whirl_shared::waveform::{self, PhaseAccumulator};

use crate::event::Notice;
use crate::output::ShakerOutput;
use crate::ramp::Ramp;
use crate::settings::{HOST_TIMEOUT_MAX_MS, HOST_TIMEOUT_MIN_MS, Settings};
use crate::sweep::Sweep;

/// The drive at a tick: what that tick's sample carries and its displacement was computed from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drive {
    /// Phase at the tick, turns · 2⁻³².
    pub phase: u32,
    /// Advance of the phase until the next tick, turns · 2⁻³² (0 at rest).
    pub phase_increment: u32,
    /// Amplitude at the tick, nm.
    pub amplitude_nanometre: u32,
    /// State of the shaker.
    pub state: ShakerState,
}

/// The shaker and its output.
#[derive(Debug)]
pub struct Shaker<O> {
    output: O,
    sample_rate_millihertz: u32,
    limits: ShakerLimits,
    state: ShakerState,
    /// Whether a stop ends in [`ShakerState::Armed`].
    armed_after_stop: bool,
    cause: StopCause,
    phase: PhaseAccumulator,
    ramp: Ramp,
    frequency_millihertz: u32,
    host_timeout_ms: u32,
    silent_ticks: u32,
    heard: bool,
    notice: Option<Notice>,
    /// A fault whose output has not taken its zero yet.
    silence_due: bool,
}

impl<O: ShakerOutput> Shaker<O> {
    /// Disarmed, with the output at zero and its amplifier off; faulted where that fails. The
    /// settings are taken as validated.
    pub fn new(settings: &Settings, output: O) -> Self {
        let mut shaker = Self {
            output,
            sample_rate_millihertz: settings.sample_rate_millihertz,
            limits: settings.limits,
            state: ShakerState::Disarmed,
            armed_after_stop: false,
            cause: StopCause::None,
            phase: PhaseAccumulator::default(),
            ramp: Ramp::new(settings.limits.ramp_micrometre_per_s, settings.sample_rate_millihertz),
            frequency_millihertz: 0,
            host_timeout_ms: settings.host_timeout_ms,
            silent_ticks: 0,
            heard: false,
            notice: None,
            silence_due: false,
        };
        if !shaker.silence() {
            shaker.fault(StopCause::Fault);
        }
        shaker
    }

    /// The drive at this tick.
    pub fn drive(&self) -> Drive {
        Drive {
            phase: self.phase.phase,
            phase_increment: self.phase.increment,
            amplitude_nanometre: self.ramp.amplitude(),
            state: self.state,
        }
    }

    /// State.
    pub fn state(&self) -> ShakerState {
        self.state
    }

    /// Why it last stopped.
    pub fn stop_cause(&self) -> StopCause {
        self.cause
    }

    /// Commanded frequency of the present or last run, mHz.
    pub fn frequency_millihertz(&self) -> u32 {
        self.frequency_millihertz
    }

    /// Time without a command after which it stops, ms.
    pub fn host_timeout_ms(&self) -> u32 {
        self.host_timeout_ms
    }

    /// Rate of amplitude changes, µm/s.
    pub fn ramp_micrometre_per_s(&self) -> u32 {
        self.ramp.rate()
    }

    /// The output.
    pub fn output_mut(&mut self) -> &mut O {
        &mut self.output
    }

    /// Something worth a line has happened (told once).
    pub fn take_notice(&mut self) -> Option<Notice> {
        self.notice.take()
    }

    /// Whether a command has been carried out within the host's time-out.
    pub fn hears_host(&self) -> bool {
        self.heard && !self.silent()
    }

    fn silent(&self) -> bool {
        let timeout = u64::from(self.host_timeout_ms) * u64::from(self.sample_rate_millihertz);
        u64::from(self.silent_ticks) * 1_000_000 >= timeout
    }

    /// Whether the phase advances.
    pub fn moving(&self) -> bool {
        matches!(self.state, ShakerState::Ramping | ShakerState::Running | ShakerState::Stopping)
    }

    /// Time went on by ticks in which nothing was computed: the phase keeps up, the ramp waits.
    pub fn skip(&mut self, ticks: u32) {
        self.phase.advance(ticks);
        self.silent_ticks = self.silent_ticks.saturating_add(ticks);
    }

    /// Writes the displacement of this tick, then advances phase, ramp and watchdog.
    pub fn tick(&mut self) {
        if self.silence_due {
            self.silence_due = !self.silence();
        }
        if self.moving() {
            self.write();
        }
        if self.moving() {
            self.advance();
        }
        self.silent_ticks = self.silent_ticks.saturating_add(1);
        self.watch();
    }

    fn write(&mut self) {
        let amplitude = self.ramp.amplitude();
        // Commands are checked when they come; this guards against everything else.
        if u64::from(amplitude) > u64::from(self.limits.amplitude_micrometre) * 1_000 {
            return self.fault(StopCause::Limit);
        }
        let mut next = self.ramp;
        next.step();
        let sweep = Sweep {
            phase: self.phase.phase,
            phase_increment: self.phase.increment,
            amplitude_nanometre: [amplitude, next.amplitude()],
        };
        if self.output.sweep(&sweep).is_err() {
            self.fault(StopCause::Fault);
        }
    }

    fn advance(&mut self) {
        if self.state == ShakerState::Stopping && self.ramp.amplitude() == 0 {
            // Zero has been written at this tick.
            self.phase.increment = 0;
            if self.armed_after_stop {
                self.state = ShakerState::Armed;
            } else {
                self.disarm();
            }
            return;
        }
        self.phase.advance(1);
        self.ramp.step();
        if self.state == ShakerState::Ramping && self.ramp.arrived() {
            self.state = ShakerState::Running;
        }
    }

    fn watch(&mut self) {
        if !self.silent() {
            return;
        }
        match self.state {
            ShakerState::Disarmed | ShakerState::Faulted => {}
            ShakerState::Armed => {
                self.cause = StopCause::HostSilent;
                self.disarm();
                self.notice = self.notice.or(Some(Notice::HostSilent));
            }
            ShakerState::Stopping => self.armed_after_stop = false,
            ShakerState::Ramping | ShakerState::Running => {
                self.stop(StopCause::HostSilent, false);
                self.notice = Some(Notice::HostSilent);
            }
        }
    }

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
                self.start(amplitude_micrometre, frequency_millihertz)
            }
            Command::Stop => {
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

    fn start(&mut self, amplitude_micrometre: u32, frequency_millihertz: u32) -> CommandResult {
        if !matches!(self.state, ShakerState::Armed | ShakerState::Ramping | ShakerState::Running) {
            return CommandResult::WrongState;
        }
        for result in [
            within(amplitude_micrometre, 0, self.limits.amplitude_micrometre),
            within(frequency_millihertz, 1, self.limits.frequency_millihertz),
            within(
                amplitude_micrometre,
                0,
                amplitude_limit(self.limits.acceleration_millimetre_per_s2, frequency_millihertz),
            ),
        ] {
            if result != CommandResult::Done {
                return result;
            }
        }
        if self.moving() {
            if frequency_millihertz != self.frequency_millihertz {
                return CommandResult::WrongState;
            }
        } else {
            let Some(increment) = waveform::phase_increment(frequency_millihertz, self.sample_rate_millihertz) else {
                return CommandResult::OutOfRange { limit: self.limits.frequency_millihertz };
            };
            self.phase = PhaseAccumulator { phase: 0, increment };
            self.frequency_millihertz = frequency_millihertz;
        }
        self.ramp.go_to(amplitude_micrometre.saturating_mul(1_000));
        self.state = if self.ramp.arrived() { ShakerState::Running } else { ShakerState::Ramping };
        CommandResult::Done
    }

    fn stop(&mut self, cause: StopCause, armed_after_stop: bool) {
        self.cause = cause;
        self.armed_after_stop = armed_after_stop;
        self.ramp.go_to(0);
        self.state = ShakerState::Stopping;
    }

    /// Output at zero, amplifier off; whether both worked.
    fn silence(&mut self) -> bool {
        let zero = self.output.write(0).is_ok();
        let off = self.output.enable(false).is_ok();
        zero && off
    }

    fn disarm(&mut self) {
        if self.silence() {
            self.silence_due = false;
            self.state = ShakerState::Disarmed;
        } else {
            self.fault(StopCause::Fault);
        }
    }

    fn fault(&mut self, cause: StopCause) {
        self.ramp.cut();
        self.phase.increment = 0;
        self.cause = cause;
        self.state = ShakerState::Faulted;
        self.notice = Some(if cause == StopCause::Limit { Notice::LimitExceeded } else { Notice::OutputFailed });
        // It may well fail again: tried anew at every tick until it works.
        self.silence_due = !self.silence();
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

/// Greatest amplitude in µm whose acceleration a(2πf)² keeps within a limit in mm/s², rounded down.
fn amplitude_limit(acceleration_millimetre_per_s2: u32, frequency_millihertz: u32) -> u32 {
    // a = A/(2πf)²: 10³ µm a mm and 10⁶ mHz² a Hz² over 4π² make 10⁹/4π² = 25 330 295.91.
    let numerator = u64::from(acceleration_millimetre_per_s2) * 25_330_295;
    let square = u64::from(frequency_millihertz).pow(2).max(1);
    u32::try_from(numerator / square).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;

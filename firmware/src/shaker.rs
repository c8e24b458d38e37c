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
//!  Faulted ◀── the output fails, a limit would be exceeded, or the emergency stop is pressed,
//!              from anywhere
//! ```
//!
//! Displacement y = a cos φ, a sum of such, or a table's ([`whirl_shared::excitation`]): φ is the phase
//! accumulator ([`whirl_shared::waveform`]), a the ramp ([`crate::ramp`]). φ starts at 0 with every
//! start and advances while the shaker moves and only then. A command cannot change the frequency
//! while it moves; sweeps and lists of amplitudes go on while it is running. Amplitude, frequency
//! and acceleration are limited for the sum; a refused command changes nothing.
//!
//! The emergency stop cuts the amplifier's enable line without the firmware; the shaker sees the
//! line cut, and is faulted until the stop is released and the host disarms.
//!
//! The watchdog counts sampling ticks, missed ones too, since the last command that was carried
//! out.

use whirl_shared::excitation::{Excitation, Shape, Table};
use whirl_shared::frame::{ShakerLimits, ShakerState, StopCause};
use whirl_shared::waveform::PhaseAccumulator;

use crate::event::Notice;
use crate::excite::Run;
use crate::output::ShakerOutput;
use crate::ramp::Ramp;
use crate::settings::Settings;
use crate::sweep::Sweep;

mod commands;

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
    run: Run,
    /// What the next start is to be of.
    prepared: Excitation,
    /// The points that were brought, and those that count of what it does.
    table: Table,
    /// It begins at the trigger.
    waiting: bool,
    /// It has begun since this was asked for.
    begun: bool,
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
            run: Run::default(),
            prepared: Excitation::default(),
            table: Table::EMPTY,
            waiting: false,
            begun: false,
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

    /// What it does, or did last.
    pub fn excitation(&self) -> &Excitation {
        &self.run.excitation
    }

    /// The shape of that motion.
    pub fn shape(&self) -> Shape<'_> {
        shape_of(&self.run.excitation, &self.table)
    }

    /// Whether it has begun since this was asked last: its first displacement is that of the next
    /// tick.
    pub fn take_begun(&mut self) -> bool {
        core::mem::take(&mut self.begun)
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

    /// Time went on by ticks in which nothing was computed: the phase keeps up at its present
    /// increment; ramp, sweep and list of amplitudes wait.
    pub fn skip(&mut self, ticks: u32) {
        self.phase.advance(ticks);
        self.silent_ticks = self.silent_ticks.saturating_add(ticks);
    }

    /// Writes the displacement of this tick, then advances phase, ramp and watchdog.
    pub fn tick(&mut self) {
        if self.output.is_cut() && (self.state != ShakerState::Faulted || self.cause != StopCause::EmergencyStop) {
            self.fault(StopCause::EmergencyStop);
        }
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
        if self.waiting && self.state == ShakerState::Armed && self.output.is_triggered() {
            self.begin();
        }
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
            shape: shape_of(&self.run.excitation, &self.table),
        };
        if self.output.sweep(&sweep).is_err() {
            self.fault(StopCause::Fault);
        }
    }

    fn advance(&mut self) {
        if self.state == ShakerState::Stopping && self.ramp.amplitude() == 0 {
            // Zero has been written at this tick.
            self.phase.increment = 0;
            self.output.trigger(false);
            if self.armed_after_stop {
                self.state = ShakerState::Armed;
            } else {
                self.disarm();
            }
            return;
        }
        self.phase.advance(1);
        self.ramp.step();
        match self.state {
            ShakerState::Ramping if self.ramp.arrived() => self.state = ShakerState::Running,
            ShakerState::Running => {
                let [increment, amplitude] = self.run.advance();
                self.phase.increment = increment.unwrap_or(self.phase.increment);
                if let Some(amplitude) = amplitude {
                    self.go_to(amplitude);
                }
            }
            _ => {}
        }
    }

    fn go_to(&mut self, nanometre: u32) {
        self.ramp.go_to(nanometre);
        self.state = if self.ramp.arrived() { ShakerState::Running } else { ShakerState::Ramping };
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

    fn begin(&mut self) {
        self.waiting = false;
        self.begun = true;
        self.phase = PhaseAccumulator { phase: 0, increment: self.run.increment() };
        self.go_to(self.run.target());
        self.output.trigger(true);
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
        self.waiting = false;
        if self.output.is_cut() {
            // Latched as long as it is pressed.
            self.fault(StopCause::EmergencyStop);
        } else if self.silence() {
            self.silence_due = false;
            self.state = ShakerState::Disarmed;
        } else {
            self.fault(StopCause::Fault);
        }
    }

    fn fault(&mut self, cause: StopCause) {
        self.ramp.cut();
        self.waiting = false;
        self.phase.increment = 0;
        self.output.trigger(false);
        self.cause = cause;
        self.state = ShakerState::Faulted;
        self.notice = Some(match cause {
            StopCause::Limit => Notice::LimitExceeded,
            StopCause::EmergencyStop => Notice::EmergencyStop,
            _ => Notice::OutputFailed,
        });
        // It may well fail again: tried anew at every tick until it works.
        self.silence_due = !self.silence();
    }
}

/// What an excitation makes of a phase; its table is the one that was checked when it was taken.
fn shape_of<'a>(excitation: &'a Excitation, table: &'a Table) -> Shape<'a> {
    if excitation.table.is_some() { Shape::Table(table) } else { Shape::Sines(&excitation.form) }
}

#[cfg(test)]
mod excite_tests;
#[cfg(test)]
mod table_tests;
#[cfg(test)]
mod tests;

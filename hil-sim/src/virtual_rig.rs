//! The firmware and the plant in lock-step, one tick at a time.
//!
//! In every tick the firmware reads the counters as they stand, and commands the drive; then the
//! plant moves on to the next tick under that drive, and the encoders turn with it, edge by edge.
//! Nothing depends on wall time: a run is the same at every repeat.
//!
//! The base follows `a(t) cos(phase)`, or the sum of the form's components, between ticks with the
//! firmware's phase and increment; the amplitude goes along a straight line from the previous tick's
//! value to this tick's (one tick behind the device while it ramps, equal to it when it runs). Times
//! of drifting effects count from power-on.
//!
//! Output is held up to [`RigSettings::output_limit`] bytes. Beyond that the firmware's link is not
//! emptied, blocks wait in its memory, and the firmware counts those that the stream passes over:
//! what a slow link does to a real device.

use std::collections::VecDeque;

use whirl_firmware::adjust::Words;
use whirl_firmware::settings::Boot;
use whirl_firmware::{App, Settings};
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::{ResetCause, SettingsSource, Status};

use crate::base_sensor::BaseSensor;
use crate::encoder::Encoder;
use crate::error::SimulationError;
use crate::plant::{ParameterError, Plant};
use crate::shaker::{Command, CommandShape};

mod parts;
mod settings;

use parts::{Device, Moving, PowerStage, Wired};
use settings::setting_error;

pub use parts::Arms;
pub use settings::RigSettings;
pub(crate) use settings::{bench_of, tick_s, two_encoders};

/// Firmware and plant.
#[derive(Debug)]
pub struct VirtualRig {
    app: Device,
    device: Settings,
    /// As the device was made, and what its flash holds.
    image: Settings,
    kept_settings: Option<Words>,
    moving: Moving,
    command: Command,
    tick_s: f64,
    ticks: u64,
    /// Ticks that the sampler will still miss, and those that it has missed since it last ran.
    to_miss: u32,
    missed: u32,
    latency_us: u32,
    output: VecDeque<u8>,
    output_limit: usize,
    kept_bytes: usize,
}

impl VirtualRig {
    /// A rig that has just been switched on: shaker disarmed, a hello waiting to be sent.
    ///
    /// # Errors
    /// A parameter, setting or effect that cannot be. A negative channel delay is refused: a device
    /// cannot show its first encoder before it is sampled ([`crate::Simulation`] can).
    pub fn new(settings: &RigSettings) -> Result<Self, SimulationError> {
        let bench = bench_of(settings)?;
        let shown = bench.shown();
        let (first, second) = two_encoders(&settings.device, shown)?;
        Self::of(settings, Moving::Bench(Box::new(bench)), vec![first, second])
    }

    /// A rig whose encoders are turned by other arms; of the settings the device and its memory
    /// count.
    ///
    /// # Errors
    /// Settings that cannot be, or that are not of as many encoders as there are arms.
    pub fn with_arms(settings: &RigSettings, arms: Box<dyn Arms>) -> Result<Self, SimulationError> {
        settings.device.validate().map_err(setting_error)?;
        let (angles, counts) = (arms.angles(), &settings.device.counts_per_turn);
        if angles.len() != counts.len() {
            let expected = angles.len().to_string();
            return Err(ParameterError::new("encoders", counts.len() as f64, &expected).into());
        }
        let encoders = counts.iter().zip(angles).map(|(n, angle)| Encoder::new(*n, *angle)).collect();
        Self::of(settings, Moving::Arms(arms), encoders)
    }

    fn of(settings: &RigSettings, moving: Moving, encoders: Vec<Encoder>) -> Result<Self, SimulationError> {
        let inputs = Wired { encoders, base: settings.base.map(BaseSensor::new) };
        let app = Self::boot(&settings.device, &settings.device, inputs, settings.kept_bytes)?;
        Ok(Self {
            app,
            image: settings.device.clone(),
            kept_settings: None,
            device: settings.device.clone(),
            moving,
            command: Command::default(),
            tick_s: tick_s(&settings.device),
            ticks: 0,
            to_miss: 0,
            missed: 0,
            latency_us: 0,
            output: VecDeque::new(),
            output_limit: settings.output_limit,
            kept_bytes: settings.kept_bytes,
        })
    }

    fn boot(device: &Settings, image: &Settings, inputs: Wired, kept_bytes: usize) -> Result<Device, ParameterError> {
        let memory = vec![0; kept_bytes];
        let mut app = App::with_memory(device, inputs, PowerStage::default(), memory).map_err(setting_error)?;
        app.set_built_in(image);
        Ok(app)
    }

    /// One tick: the firmware samples, then the plant moves on to the next tick.
    ///
    /// # Errors
    /// A plant that cannot be integrated further.
    pub fn step(&mut self) -> Result<(), SimulationError> {
        let previous = self.command.amplitude_nanometre[1];
        if self.to_miss > 0 {
            self.to_miss -= 1;
            self.missed = self.missed.saturating_add(1);
            // The output goes on by itself, as a waveform timer does.
            self.command.phase = self.command.phase.wrapping_add(self.command.phase_increment);
            self.command.increment_before = self.command.phase_increment;
            self.command.amplitude_nanometre = [previous; 2];
        } else {
            self.app.tick(std::mem::take(&mut self.missed), self.latency_us);
            let drive = self.app.drive();
            self.command = Command {
                phase: drive.phase,
                phase_increment: drive.phase_increment,
                increment_before: self.command.phase_increment,
                amplitude_nanometre: [previous, drive.amplitude_nanometre],
                shape: CommandShape::of(self.app.shape()),
            };
        }
        self.collect();
        if self.app.restart_due() {
            self.restart()?;
        }
        self.moving.advance(self.command, self.ticks as f64 * self.tick_s)?;
        self.ticks += 1;
        self.moving.show(self.app.inputs_mut());
        Ok(())
    }

    /// Empties the firmware's link as far as there is room.
    fn collect(&mut self) {
        let mut frame = [0; MAX_FRAME];
        while self.output.len() + MAX_FRAME <= self.output_limit {
            match self.app.poll_transmit(&mut frame) {
                Some(length) => self.output.extend(&frame[..length]),
                None => match self.app.settings_to_keep() {
                    Some(words) => {
                        self.kept_settings = Some(words);
                        self.app.settings_kept(true);
                    }
                    None => return,
                },
            }
        }
        while self.app.keep_up() {}
    }

    /// What the device has sent since the last call: whole frames.
    pub fn take_output(&mut self) -> Vec<u8> {
        let taken = self.output.drain(..).collect();
        self.collect();
        taken
    }

    /// Bytes that wait for [`Self::take_output`].
    pub fn output_len(&self) -> usize {
        self.output.len()
    }

    /// Bytes from the host; commands in them act from the next tick on.
    pub fn give_input(&mut self, bytes: &[u8]) {
        self.app.receive(bytes);
    }

    /// The sampler misses the next `ticks` ticks: the rig moves, the firmware does not run, and
    /// finds out afterwards.
    pub fn miss_ticks(&mut self, ticks: u32) {
        self.to_miss = self.to_miss.saturating_add(ticks);
    }

    /// Delay from tick to sample that the firmware is told, µs. (The counters are read at the tick
    /// all the same.)
    pub fn set_latency(&mut self, microseconds: u32) {
        self.latency_us = microseconds;
    }

    /// The shaker's power stage fails, or is repaired.
    pub fn break_shaker(&mut self, broken: bool) {
        self.app.output_mut().broken = broken;
    }

    /// The emergency stop is pressed, or released: it cuts the amplifier's enable line, which
    /// the firmware sees at its next tick.
    pub fn press_emergency_stop(&mut self, pressed: bool) {
        self.app.output_mut().cut = pressed;
    }

    /// The trigger input is active, or is not.
    pub fn trigger(&mut self, active: bool) {
        self.app.output_mut().triggered = active;
    }

    /// The trigger output.
    pub fn trigger_output(&mut self) -> bool {
        self.app.output_mut().trigger
    }

    /// What the firmware wrote last to the shaker's output, nm.
    pub fn set_point(&mut self) -> i32 {
        self.app.output_mut().written
    }

    /// The device is reset by its watchdog: tick 0, another boot id, shaker off, settings that were
    /// kept in force. The base stops where it is, the arms go on; the counts are carried over, with
    /// their zeros where the arms rest. What was queued in the firmware is gone; what it had sent
    /// is not.
    ///
    /// # Errors
    /// None that [`Self::new`] has not excluded.
    pub fn restart(&mut self) -> Result<(), SimulationError> {
        let mut kept = self.app.kept();
        // The simulated chip's counters last, so that nothing of their counts is to be added.
        kept.iter_mut().for_each(|encoder| encoder.count = 0);
        self.boot_again(Boot { reset: ResetCause::Watchdog, kept: Some(kept), ..Boot::default() })?;
        Ok(())
    }

    /// The device's power goes and comes: as [`Self::restart`], but zero is where the arms are now.
    ///
    /// # Errors
    /// None that [`Self::new`] has not excluded.
    pub fn power_cycle(&mut self) -> Result<(), SimulationError> {
        self.boot_again(Boot { reset: ResetCause::Power, ..Boot::default() })?;
        self.app.inputs_mut().encoders.iter_mut().for_each(Encoder::reset);
        Ok(())
    }

    fn boot_again(&mut self, boot: Boot) -> Result<(), SimulationError> {
        let (boot_id, image) = (self.device.boot_id.wrapping_add(1), self.image.clone());
        let kept = self.kept_settings.and_then(|words| image.with_words(&words));
        let source = if kept.is_some() { SettingsSource::Kept } else { SettingsSource::BuiltIn };
        self.device = kept.unwrap_or(image);
        self.device.boot_id = boot_id;
        self.device.boot = Boot { settings: source, ..boot };
        let inputs = self.app.inputs_mut().clone();
        self.app = Self::boot(&self.device, &self.image, inputs, self.kept_bytes)?;
        self.command = Command::default();
        self.missed = 0;
        self.to_miss = 0;
        Ok(())
    }

    /// Ticks since power-on.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Length of a tick, s.
    pub fn tick_s(&self) -> f64 {
        self.tick_s
    }

    /// The firmware's counters and the shaker's state.
    pub fn status(&self) -> Status {
        self.app.status()
    }

    /// The drive over the last tick.
    pub fn command(&self) -> Command {
        self.command
    }

    /// The double pendulum, for truths such as its state; none where other arms turn the encoders.
    pub fn plant(&self) -> Option<&Plant> {
        match &self.moving {
            Moving::Bench(bench) => Some(bench.plant()),
            Moving::Arms(_) => None,
        }
    }

    /// The device's settings (the boot id as it is now).
    pub fn device(&self) -> &Settings {
        &self.device
    }
}

#[cfg(test)]
mod excite_tests;
#[cfg(test)]
mod tests;

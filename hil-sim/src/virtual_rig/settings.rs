//! Settings of a virtual rig, and the bench that they make.

use whirl_firmware::Settings;
use whirl_firmware::history::KEPT;
use whirl_firmware::settings::SettingsError;

use crate::base_sensor::BaseSettings;
use crate::bench::{Bench, BenchSettings, SecondEncoder};
use crate::encoder::Encoder;
use crate::error::SimulationError;
use crate::plant::effects::{Effect, EffectError};
use crate::plant::{ParameterError, Parameters, State, TOLERANCE};
use crate::shaker::{Direction, Hum};
use crate::simulate::{DriveSettings, additions, perturbed};

/// Settings of a virtual rig.
#[derive(Clone, Debug)]
pub struct RigSettings {
    /// The nominal rig.
    pub parameters: Parameters,
    /// Direction of the shaker.
    pub direction: Direction,
    /// Lag ψ of the base behind the device's phase, rad.
    pub psi: f64,
    /// What the base does of the amplitude that the device commands, less 1.
    pub gain_error: f64,
    /// A tone of the base beside the drive, as of the mains.
    pub hum: Hum,
    /// What encoder 2 is fixed to.
    pub second: SecondEncoder,
    /// The sensor of the base's motion, where one is connected; what it is to the device is in
    /// `device.base`.
    pub base: Option<BaseSettings>,
    /// φ1, φ2 (rad), φ̇1, φ̇2 (rad/s) at power-on.
    pub initial: State,
    /// Perturbs `initial` ([`perturbed`]); `None` leaves it as it is.
    pub seed: Option<u64>,
    /// Effects beside the nominal model.
    pub effects: Vec<Effect>,
    /// What an amplitude drift refers to, s.
    pub record_s: f64,
    /// Tolerance of the integration, rad and rad/s.
    pub tolerance: f64,
    /// The device's own settings: sampling rate, counts a turn, limits of the shaker, host
    /// time-out.
    pub device: Settings,
    /// Memory for samples that the device keeps for the host to ask for again, bytes.
    pub kept_bytes: usize,
    /// Most bytes held for [`VirtualRig::take_output`](super::VirtualRig::take_output).
    pub output_limit: usize,
}

impl Default for RigSettings {
    /// The printed rig, vertical, 500 Hz, 4096 counts, unperturbed; as many samples kept as a
    /// NUCLEO board keeps (21 s), 64 kB of output (15 s).
    fn default() -> Self {
        Self {
            parameters: Parameters::PRINTED,
            direction: Direction::Vertical,
            psi: 0.0,
            gain_error: 0.0,
            hum: Hum::default(),
            second: SecondEncoder::Relative,
            base: None,
            initial: [0.3, 2.0, 0.0, 0.0],
            seed: None,
            effects: Vec::new(),
            record_s: 120.0,
            tolerance: TOLERANCE,
            device: Settings { board: "virtual rig", boot_id: 1, base_input: true, ..Settings::default() },
            kept_bytes: KEPT,
            output_limit: 65_536,
        }
    }
}

/// The encoders at power-on.
///
/// # Errors
/// A device of other than two.
pub(crate) fn two_encoders(device: &Settings, shown: [f64; 2]) -> Result<(Encoder, Encoder), ParameterError> {
    match device.counts_per_turn[..] {
        [first, second] => Ok((Encoder::new(first, shown[0]), Encoder::new(second, shown[1]))),
        ref other => Err(ParameterError::new("encoders", other.len() as f64, "2")),
    }
}

pub(super) fn setting_error(error: SettingsError) -> ParameterError {
    ParameterError::new(error.field, f64::from(error.found), &format!("{} to {}", error.min, error.max))
}

/// Length of a tick, s.
pub(crate) fn tick_s(device: &Settings) -> f64 {
    1.0 / (f64::from(device.sample_rate_millihertz) / 1e3)
}

/// Plant, shaker and encoders of a rig at power-on.
pub(crate) fn bench_of(settings: &RigSettings) -> Result<Bench, SimulationError> {
    settings.device.validate().map_err(setting_error)?;
    settings.base.as_ref().map_or(Ok(()), BaseSettings::validate)?;
    // The firmware's drive is not known yet; its direction decides what may act across it.
    let drive = DriveSettings { direction: settings.direction, frequency_hz: 0.0, amplitude_m: 0.0, psi: settings.psi };
    let mut additions = additions(&settings.effects, Some(&drive))?;
    additions.drive.gain_error = settings.gain_error;
    additions.drive.hum = settings.hum;
    if additions.delay_s < 0.0 {
        let found = additions.delay_s.to_string();
        return Err(EffectError::new("channel-delay", &found, "0 or more on a rig that runs firmware").into());
    }
    let initial = settings.seed.map_or(settings.initial, |seed| perturbed(settings.initial, seed));
    Bench::new(&BenchSettings {
        parameters: settings.parameters,
        additions,
        direction: settings.direction,
        psi: settings.psi,
        record_s: settings.record_s,
        initial,
        tick_s: tick_s(&settings.device),
        tolerance: settings.tolerance,
        second: settings.second,
    })
}

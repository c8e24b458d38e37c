//! `sim`: the rig of `[plant]`, simulated, with the firmware's own logic in lock-step, over an
//! in-process pipe.
//!
//! Time is the device's: each read moves the rig on until it has sent something, and the session's
//! clock with it. A capture from `sim` is therefore the same, byte for byte, at every repeat and on
//! any machine.

use std::collections::VecDeque;
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use whirl_hil_sim::{BaseQuantity, Direction, Effect, RigSettings, SecondEncoder, VirtualRig};
use whirl_shared::frame::{BaseKind, BaseSensor, MOST_ENCODERS};

use super::source::{Link, Source, SourceKind, bad};
use crate::error::{BadInput, Result};
use crate::model::model_file::simulation::live::Live;
use crate::rig::measures::{BASE, ObservedModel};
use crate::rig::plant::Plant;
use crate::rig::{Channel, Direction as RigDirection, Rig};

pub(super) const KIND: SourceKind = SourceKind {
    id: "sim",
    form: "sim[:SEED]",
    about: "the simulated rig of [plant]",
    parse: |argument, rig| {
        let seed = match argument.map(str::parse::<u64>) {
            None => None,
            Some(Ok(seed)) => Some(seed),
            Some(Err(_)) => {
                return Err(bad(argument.unwrap_or_default(), "a seed, a whole number").remedy("Such as sim:7, or sim"));
            }
        };
        Ok(Box::new(Simulated::new(rig, &[], seed, None)?))
    },
};

/// Ticks of one read at most without a byte, as other links have a time-out: the host has to
/// say now and then that it is there.
const PATIENCE_TICKS: u32 = 50;

/// The simulated rig as a source.
pub struct Simulated {
    rig: Arc<Mutex<Plugged>>,
    start: Instant,
    settle_s: f64,
}

/// The rig, and why it moves no more where its plant could not be integrated; time goes by
/// without it then.
struct Plugged {
    rig: VirtualRig,
    failed: Option<BadInput>,
    without: Duration,
    path: PathBuf,
}

impl Plugged {
    /// A tick; nothing once it has failed.
    fn step(&mut self) -> io::Result<()> {
        if self.failed.is_none()
            && let Err(e) = self.rig.step()
        {
            self.failed = Some(
                BadInput::new(e.to_string(), "")
                    .in_file(&self.path)
                    .at("[plant]")
                    .remedy("Correct the plant or the effects put into it"),
            );
        }
        self.failed.as_ref().map_or(Ok(()), |e| Err(io::Error::other(e.to_string())))
    }

    fn time(&self) -> Duration {
        // At most 2^32 ticks of at most 1000 s (rates are 1e-3 Hz and more).
        Duration::from_secs_f64(self.rig.ticks() as f64 * self.rig.tick_s()).saturating_add(self.without)
    }
}

impl Simulated {
    /// The rig of `[plant]` with effects, perturbed by a seed. `record_s` is what an amplitude
    /// drift refers to (120 s where none is given).
    ///
    /// # Errors
    /// A rig file without `[plant]`; parameters, channels or effects that cannot be simulated.
    pub fn new(rig: &Rig, effects: &[Effect], seed: Option<u64>, record_s: Option<f64>) -> Result<Self> {
        if let Some(bound) = &rig.bound {
            return Self::of_own(rig, bound, effects, seed);
        }
        let settle_s = Plant::of(rig)?.settle_s;
        let virtual_rig = VirtualRig::new(&Self::settings(rig, effects, seed, record_s)?).map_err(|e| {
            BadInput::new(e.to_string(), "a rig that can be simulated")
                .in_file(&rig.path)
                .at("[plant]")
                .remedy("Correct [plant], or the effect")
        })?;
        Ok(Self::plugged(virtual_rig, rig, settle_s))
    }

    fn plugged(virtual_rig: VirtualRig, rig: &Rig, settle_s: f64) -> Self {
        let plugged = Plugged { rig: virtual_rig, failed: None, without: Duration::ZERO, path: rig.path.clone() };
        Self { rig: Arc::new(Mutex::new(plugged)), start: Instant::now(), settle_s }
    }

    /// A device with an encoder on every channel of a free system of one's own.
    fn of_own(rig: &Rig, bound: &Arc<ObservedModel>, effects: &[Effect], seed: Option<u64>) -> Result<Self> {
        let refused = |found: String, expected: &str| BadInput::new(found, expected).in_file(&rig.path).at("channel");
        if let Some(effect) = effects.first() {
            return Err(refused(format!("--effect {effect}"), "none, on a system of one's own")
                .remedy("`whirl simulate` puts effects into it"));
        }
        let counts: Option<Vec<u32>> = bound.sensors.iter().map(|&i| rig.channel[i].counts_per_turn).collect();
        let Some(counts) = counts.filter(|counts| counts.len() == rig.channel.len()) else {
            return Err(refused("a channel without counts_per_turn".to_owned(), "unit = \"count\" for every channel")
                .remedy("A simulated device has encoders that count"));
        };
        let mut settings = RigSettings::default();
        settings.device.sample_rate_millihertz = (rig.sample_rate_hz * 1e3).round() as u32;
        let too_many = || refused(format!("{} channels", counts.len()), "at most six encoders");
        if counts.len() > MOST_ENCODERS {
            return Err(too_many());
        }
        settings.device.counts_per_turn = counts.iter().copied().collect();
        settings.device.reversed = counts.iter().map(|_| false).collect();
        settings.device.limits.frequency_millihertz = settings.device.sample_rate_millihertz / 5;
        let arms = Live::of(rig, bound, seed)?;
        let virtual_rig = VirtualRig::with_arms(&settings, Box::new(arms)).map_err(|e| {
            BadInput::new(e.to_string(), "a rig that can be simulated").in_file(&rig.path).at("[plant]")
        })?;
        Ok(Self::plugged(virtual_rig, rig, 0.0))
    }

    /// The virtual rig's settings for a rig file, for [`Simulated::new`] and for servers of a
    /// simulated rig.
    ///
    /// # Errors
    /// As [`Simulated::new`].
    pub fn settings(rig: &Rig, effects: &[Effect], seed: Option<u64>, record_s: Option<f64>) -> Result<RigSettings> {
        let plant = Plant::of(rig)?;
        let refused = |found: String, expected: &str| BadInput::new(found, expected).in_file(&rig.path).at("[plant]");
        let encoders: Vec<&Channel> = rig.channel.iter().filter(|c| c.measures != BASE).collect();
        let second = match encoders.get(1).map(|c| c.measures.as_str()) {
            None | Some("theta2") => SecondEncoder::Relative,
            Some("phi2") => SecondEncoder::Absolute,
            Some(other) => return Err(refused(format!("encoder 2 on {other}"), "theta2 or phi2")),
        };
        if let Some(first) = encoders.first().filter(|c| !matches!(c.measures.as_str(), "theta1" | "phi1")) {
            return Err(refused(format!("encoder 1 on {}", first.measures), "theta1 or phi1"));
        }
        let mut settings = RigSettings {
            parameters: crate::simulate::parameters(&plant),
            direction: match rig.drive.map(|d| d.direction) {
                Some(RigDirection::Horizontal) => Direction::Horizontal,
                Some(RigDirection::Vertical) | None => Direction::Vertical,
            },
            psi: plant.phase_rad,
            gain_error: plant.shaker_gain - 1.0,
            second,
            initial: plant.initial,
            seed,
            effects: effects.to_vec(),
            record_s: record_s.unwrap_or(120.0),
            ..RigSettings::default()
        };
        // Rates are at most 1e7 Hz; the device says no to what it cannot do.
        settings.device.sample_rate_millihertz = (rig.sample_rate_hz * 1e3).round() as u32;
        for (n, channel) in settings.device.counts_per_turn.iter_mut().zip(&encoders) {
            *n = channel.counts_per_turn.unwrap_or(*n);
        }
        if let Some(base) = crate::simulate::base(rig, &plant.base, seed.unwrap_or(0))? {
            let (kind, unit) = match base.quantity {
                BaseQuantity::Counted => (BaseKind::Encoder, 1e12),
                BaseQuantity::Position => (BaseKind::Position, 1e12),
                BaseQuantity::Acceleration => (BaseKind::Acceleration, 1e9),
            };
            // Where that is not what a device can tell, the rig file is refused as for a real one.
            settings.device.base = BaseSensor { kind, scale: (base.scale * unit).round() as u32 };
            settings.base = Some(base);
        }
        // A simulated shaker may do what no real one can.
        settings.device.limits.amplitude_micrometre = 200_000;
        settings.device.full_scale_micrometre = 200_000;
        settings.device.limits.frequency_millihertz = settings.device.sample_rate_millihertz / 5;
        settings.device.limits.acceleration_millimetre_per_s2 = 2_000_000;
        Ok(settings)
    }
}

fn lock(rig: &Mutex<Plugged>) -> MutexGuard<'_, Plugged> {
    // A panic while it was held leaves a rig that goes on from where it was.
    rig.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Source for Simulated {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        Ok(Box::new(Pipe { rig: self.rig.clone(), rest: VecDeque::new() }))
    }

    fn now(&self) -> Instant {
        self.start + lock(&self.rig).time()
    }

    fn pause(&mut self, time: Duration) {
        let mut plugged = lock(&self.rig);
        let ticks = (time.as_secs_f64() / plugged.rig.tick_s()).ceil().max(1.0) as u64;
        for _ in 0..ticks {
            if plugged.step().is_err() {
                plugged.without = plugged.without.saturating_add(time);
                return;
            }
        }
    }

    fn is_simulated(&self) -> bool {
        true
    }

    fn failed(&self) -> Option<BadInput> {
        lock(&self.rig).failed.clone()
    }

    fn settle_s(&self) -> f64 {
        self.settle_s
    }

    fn resumed(&mut self) {
        // It cannot fail with settings that made the rig; if it did, the same boot would go on,
        // whose repeats are not recorded.
        let _ = lock(&self.rig).rig.restart();
    }

    fn remedy(&self) -> String {
        "Correct [plant] of the rig file".to_owned()
    }
}

/// One end of the in-process pipe; `rest` is what a read had no room for.
struct Pipe {
    rig: Arc<Mutex<Plugged>>,
    rest: VecDeque<u8>,
}

impl Link for Pipe {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.is_empty() {
            let mut plugged = lock(&self.rig);
            for _ in 0..PATIENCE_TICKS {
                if plugged.rig.output_len() > 0 {
                    break;
                }
                plugged.step()?;
            }
            self.rest = plugged.rig.take_output().into();
        }
        match self.rest.read(buffer)? {
            0 => Err(io::ErrorKind::TimedOut.into()),
            n => Ok(n),
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        lock(&self.rig).rig.give_input(bytes);
        Ok(())
    }
}

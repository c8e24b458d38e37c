//! Messages of every kind, both ways, from a seed.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use whirl_shared::excitation::{Component, Excitation, Form, Glide, Law, Part, TableName};
use whirl_shared::frame::regression::{Binary24, Binary32, EquationEstimate, ROWS_LEN, Unknown};
use whirl_shared::frame::{
    Ack, BLOCK_LEN, BackFilled, BaseKind, BaseSensor, Command, CommandResult, DeviceMessage, Envelope, Estimate,
    Excited, Hello, HostMessage, Log, MOST_CHANNELS, MOST_ENCODERS, ResetCause, Rows, SampleBlock, Setting,
    SettingsSource, ShakerLimits, ShakerState, Status, StopCause, Streamed, Zero, ZeroSource,
};

/// A seeded source of numbers and messages.
pub struct Source(ChaCha8Rng);

impl Source {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn u32(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// Below `end`, which is not zero.
    pub fn below(&mut self, end: usize) -> usize {
        ((u64::from(self.u32()) * end as u64) >> 32) as usize
    }

    /// A number of any length: short varints are as likely as long ones.
    pub fn any(&mut self) -> u32 {
        let bits = self.below(33) as u32;
        (u64::from(self.u32()) & ((1_u64 << bits) - 1)) as u32
    }

    fn some<T, const N: usize>(&mut self, make: impl Fn(u32) -> T) -> heapless::Vec<T, N> {
        (0..self.below(N + 1)).map(|_| make(self.any())).collect()
    }

    fn text<const N: usize>(&mut self) -> heapless::String<N> {
        let mut text = heapless::String::new();
        for _ in 0..self.below(N + 1) {
            let character = char::from_u32(self.any() % 0x11_0000).unwrap_or('°');
            if text.push(character).is_err() {
                break;
            }
        }
        text
    }

    fn block(&mut self) -> SampleBlock {
        let channels = 1 + self.below(MOST_CHANNELS);
        let more = channels * self.below(BLOCK_LEN);
        SampleBlock {
            first_tick: self.any(),
            phase: self.any(),
            phase_increment: self.any(),
            amplitude_nanometre: self.any(),
            first: (0..channels).map(|_| self.any() as i32).collect(),
            deltas: (0..more).map(|_| self.any() as i16).collect(),
        }
    }

    fn hello(&mut self) -> Hello {
        Hello {
            protocol: self.any() as u16,
            schema: self.any(),
            boot_id: self.any(),
            tick: self.any(),
            firmware: self.text(),
            board: self.text(),
            sample_rate_millihertz: self.any(),
            counts_per_turn: self.some(|n| n),
            block_len: self.any() as u8,
            limits: ShakerLimits {
                amplitude_micrometre: self.any(),
                frequency_millihertz: self.any(),
                ramp_micrometre_per_s: self.any(),
                acceleration_millimetre_per_s2: self.any(),
            },
            host_timeout_ms: self.any(),
            zeros: (0..self.below(MOST_ENCODERS + 1)).map(|_| self.zero()).collect(),
            reset: [ResetCause::Unknown, ResetCause::Watchdog, ResetCause::Panic][self.below(3)],
            panic: self.text(),
            reversed: self.some(|n| n % 2 == 1),
            full_scale_micrometre: self.any(),
            baud: self.any(),
            settings: [SettingsSource::BuiltIn, SettingsSource::Changed, SettingsSource::NotKept][self.below(3)],
            base: BaseSensor { kind: self.base(), scale: self.any() },
        }
    }

    fn base(&mut self) -> BaseKind {
        [BaseKind::None, BaseKind::Encoder, BaseKind::Position, BaseKind::Acceleration][self.below(4)]
    }

    fn zero(&mut self) -> Zero {
        Zero {
            id: self.any(),
            source: [ZeroSource::PowerUp, ZeroSource::Commanded, ZeroSource::Carried][self.below(3)],
            index: (self.below(2) == 0).then(|| self.any()),
        }
    }

    fn setting(&mut self) -> Setting {
        match self.below(7) {
            0 => Setting::CountsPerTurn { channel: self.any() as u8, counts: self.any() },
            1 => Setting::Reversed { channel: self.any() as u8, reversed: self.below(2) == 0 },
            2 => Setting::SampleRate { millihertz: self.any() },
            3 => Setting::Baud { rate: self.any() },
            4 => Setting::Base { kind: self.base() },
            5 => Setting::BaseScale { scale: self.any() },
            _ => Setting::BuiltIn,
        }
    }

    fn status(&mut self) -> Status {
        use ShakerState::{Armed, Disarmed, Faulted, Ramping, Running, Stopping};
        Status {
            tick: self.any(),
            overruns: self.any(),
            dropped_samples: self.any(),
            dropped_frames: self.any(),
            bad_frames: self.any(),
            rejected_commands: self.any(),
            samples_sent: self.any(),
            shaker: [Disarmed, Armed, Ramping, Running, Stopping, Faulted][self.below(6)],
            stop_cause: [StopCause::None, StopCause::Command, StopCause::HostSilent, StopCause::Limit][self.below(4)],
            amplitude_nanometre: self.any(),
            frequency_millihertz: self.any(),
            latency_max_us: self.any(),
            rms_angle_mrad: self.some(|n| n),
            turns_per_minute_milli: self.some(|n| n as i32),
            kept_from: self.any(),
        }
    }

    fn equation<const P: usize>(&mut self) -> EquationEstimate<[Unknown; P]> {
        match self.below(4) {
            0 => EquationEstimate::TooFewWindows,
            1 => EquationEstimate::Undetermined(self.any() as u8),
            2 => EquationEstimate::Repeating,
            _ => EquationEstimate::Known {
                unknowns: core::array::from_fn(|_| Unknown { value: self.float(), std_error: self.float() }),
                condition: self.float(),
                residual_rms: self.float(),
            },
        }
    }

    fn float(&mut self) -> Binary32 {
        Binary32(self.any().to_le_bytes())
    }

    fn estimate(&mut self) -> Estimate {
        Estimate {
            tick: self.any(),
            window_ticks: self.any(),
            windows: self.any(),
            forget_per_mille: self.any() as u16,
            phase_increment: self.any(),
            amplitude_nanometre: self.any(),
            first: self.equation(),
            second: self.equation(),
        }
    }

    fn rows(&mut self) -> Rows {
        let mut rows = heapless::Vec::new();
        for _ in 0..self.below(ROWS_LEN + 1) {
            let row = core::array::from_fn(|_| Binary24([self.any() as u8, self.any() as u8, self.any() as u8]));
            // There is room for so many.
            let _ = rows.push(row);
        }
        Rows {
            tick: self.any(),
            window_ticks: self.any(),
            window: self.any(),
            phase_increment: self.any(),
            amplitude_nanometre: self.any(),
            frequency: self.any() as u8,
            last_frequency: self.any() as u8,
            rows,
        }
    }

    pub fn device(&mut self) -> Envelope<DeviceMessage> {
        let message = match self.below(13) {
            0 => DeviceMessage::Hello(self.hello()),
            1 => DeviceMessage::Status(self.status()),
            2 => DeviceMessage::Ack(Ack {
                command_sequence: self.any() as u16,
                result: match self.below(4) {
                    0 => CommandResult::Done,
                    1 => CommandResult::OutOfRange { limit: self.any() },
                    2 => CommandResult::WrongState,
                    _ => CommandResult::Unsupported,
                },
            }),
            3 => DeviceMessage::Log(Log { tick: self.any(), level: self.any() as u8, text: self.text() }),
            4 => DeviceMessage::Estimate(self.estimate()),
            5 => DeviceMessage::Rows(self.rows()),
            6 => DeviceMessage::Restored(self.block()),
            7 => {
                DeviceMessage::BackFilled(BackFilled { first_tick: self.any(), ticks: self.any(), samples: self.any() })
            }
            8 => DeviceMessage::Excited(Excited { tick: self.any(), excitation: self.excitation() }),
            _ => DeviceMessage::Samples(self.block()),
        };
        Envelope { sequence: self.any() as u16, message }
    }

    pub fn host(&mut self) -> Envelope<HostMessage> {
        let command = match self.below(18) {
            0 => Command::Hello,
            1 => Command::KeepAlive,
            2 => Command::Arm,
            3 => Command::Disarm,
            4 => Command::Start { amplitude_micrometre: self.any(), frequency_millihertz: self.any() },
            5 => Command::Stop,
            6 => Command::SetRamp { micrometre_per_s: self.any() },
            7 => Command::SetHostTimeout { ms: self.any() },
            8 => Command::ZeroCounts,
            9 => Command::Stream(Streamed::Samples),
            10 => Command::Stream(Streamed::Rows),
            11 => Command::Set(self.setting()),
            12 => Command::Restart,
            13 => Command::BackFill { boot_id: self.any(), first_tick: self.any(), ticks: self.any() },
            14 => Command::Excite { frequency_millihertz: self.any() },
            15 => {
                let points = core::array::from_fn(|_| self.any() as i16);
                Command::Prepare(Part::Points { place: self.any() as u8, points })
            }
            16 => {
                let all = self.excitation().commands();
                all[self.below(all.len())]
            }
            _ => Command::Status,
        };
        Envelope { sequence: self.any() as u16, message: HostMessage::Command(command) }
    }

    pub fn excitation(&mut self) -> Excitation {
        let law = [Law::Steady, Law::Linear, Law::Logarithmic][self.below(3)];
        let mut form = Form::SINE;
        for component in &mut form.0 {
            let (harmonic, share, phase) = (self.any() as u8, self.any() as u16, self.any() as u16);
            *component = Component { harmonic, share, phase };
        }
        let back = self.below(2) == 1;
        Excitation {
            frequency_millihertz: self.any(),
            glide: Glide { law, back, to_millihertz: self.any(), ms: self.any() },
            amplitudes_micrometre: core::array::from_fn(|_| self.any()),
            steps: self.any() as u8,
            hold_ms: self.any(),
            form,
            on_trigger: self.below(2) == 1,
            table: TableName { points: self.any() as u16, check: self.any() },
        }
    }
}

//! The messages between device and host, one table of them.
//!
//! Every frame on the wire is `COBS(postcard(Envelope) ‖ CRC-32) ‖ 0x00`, see [`crate::codec`].
//! Integers are postcard varints (zigzag where signed). All fields are integers, but for the
//! results of the device's own identification ([`regression`]), which are floats by their bits:
//! nothing on the wire depends on a rounding mode.
//!
//! | id | message | direction | when |
//! |---|---|---|---|
//! | 0 | [`Hello`] | device → host | at boot, on request, and after a settings change |
//! | 1 | [`SampleBlock`] | device → host | every [`BLOCK_LEN`] ticks; earlier where the drive's settings change or a tick is missed |
//! | 2 | [`Status`] | device → host | once a second |
//! | 3 | [`Ack`] | device → host | for every command frame that decodes |
//! | 4 | [`Log`] | device → host | rarely |
//! | 5 | [`Estimate`] | device → host | every second window of the device's identification: every twenty drive periods |
//! | 6 | [`Rows`] | device → host | instead of samples, where the host asks for it: after every window |
//! | 7 | [`DeviceMessage::Restored`] | device → host | a block of samples again, because the host has asked for it ([`Command::BackFill`]) |
//! | 8 | [`BackFilled`] | device → host | behind the last block that was asked for |
//! | 9 | [`Excited`] | device → host | after every [`Command::Excite`], and once a second while that is no plain sine |
//! | 0 | [`Command`] | host → device | |
//!
//! Adding a message or a field: append it at the end of its enum or struct, add it to [`SCHEMA`],
//! raise [`PROTOCOL_VERSION`]. [`SCHEMA_HASH`] is sent in [`Hello`], so that a host never misreads
//! an unknown layout.

mod command;
pub mod hello;
pub mod regression;
mod setting;

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::excitation::Excitation;

pub use command::{Ack, Command, CommandResult, Streamed};
pub use hello::{BaseKind, BaseSensor, Hello, ResetCause, SettingsSource, ShakerLimits, Zero, ZeroSource};
pub use regression::{Estimate, Rows};
pub use setting::Setting;

/// Version of the wire protocol; raised at every change of the layout.
pub const PROTOCOL_VERSION: u16 = 6;
/// Samples in a full block. Ten samples a frame keep the worst case well under the rate of a
/// 115 200 baud link.
pub const BLOCK_LEN: usize = 10;
/// Most encoders of a device, as far as this build has room: two, or six with the feature
/// `six-encoders`, as hosts have it. Messages are lists: what fewer fill is the same on the wire.
pub const MOST_ENCODERS: usize = if cfg!(feature = "six-encoders") { 6 } else { 2 };
/// Most channels of a device: its encoders, and the base's sensor.
pub const MOST_CHANNELS: usize = MOST_ENCODERS + 1;
/// Longest text in a [`Log`] or [`Hello`] field, bytes.
pub const TEXT_LEN: usize = 48;
/// Longest text of a panic, bytes.
pub const PANIC_LEN: usize = 80;

/// The layout in words: what [`SCHEMA_HASH`] is computed from.
pub const SCHEMA: &str = concat!(
    "whirl 6;envelope{sequence:u16,message};",
    "device[hello{protocol:u16,schema:u32,boot_id:u32,tick:u32,firmware:str,board:str,sample_rate_millihertz:u32,",
    "counts_per_turn:[u32],block_len:u8,limits{amplitude_micrometre:u32,frequency_millihertz:u32,ramp_micrometre_per_s:u32,",
    "acceleration_millimetre_per_s2:u32},host_timeout_ms:u32,zeros:[{id:u32,source:enum[power_up,commanded,carried],index:option(u32)}],",
    "reset:enum[unknown,power,pin,software,watchdog,panic],panic:str,reversed:[bool],full_scale_micrometre:u32,baud:u32,",
    "settings:enum[built_in,kept,changed,refused,not_kept],base{kind:enum[none,encoder,position,acceleration],scale:u32}}|samples{first_tick:u32,phase:u32,phase_increment:u32,amplitude_nanometre:u32,first:[i32],deltas:[i16]}|",
    "status{tick:u32,overruns:u32,dropped_samples:u32,dropped_frames:u32,bad_frames:u32,rejected_commands:u32,",
    "samples_sent:u32,shaker:enum[disarmed,armed,ramping,running,stopping,faulted],stop_cause:enum[none,command,host_silent,limit,fault,emergency_stop],",
    "amplitude_nanometre:u32,frequency_millihertz:u32,latency_max_us:u32,rms_angle_mrad:[u32],turns_per_minute_milli:[i32],kept_from:u32}|",
    "ack{command_sequence:u16,result:enum[done,out_of_range{limit:u32},wrong_state,unsupported]}|log{tick:u32,level:u8,text:str}|",
    "estimate{tick:u32,window_ticks:u32,windows:u32,forget_per_mille:u16,phase_increment:u32,amplitude_nanometre:u32,",
    "first:enum[known{unknowns:[{value:[u8;4],std_error:[u8;4]};6],condition:[u8;4],residual_rms:[u8;4]},too_few_windows,",
    "undetermined(u8),repeating],second:enum[known{unknowns:[{value:[u8;4],std_error:[u8;4]};5],condition:[u8;4],",
    "residual_rms:[u8;4]},too_few_windows,undetermined(u8),repeating]}|",
    "rows{tick:u32,window_ticks:u32,window:u32,phase_increment:u32,amplitude_nanometre:u32,frequency:u8,last_frequency:u8,",
    "rows:[[[u8;3];13]]}|restored(samples)|back_filled{first_tick:u32,ticks:u32,samples:u32}|excited{tick:u32,excitation}];",
    "excitation{frequency_millihertz:u32,glide{law:enum[steady,linear,logarithmic],back:bool,to_millihertz:u32,ms:u32},",
    "amplitudes_micrometre:[u32;8],steps:u8,hold_ms:u32,form:[{harmonic:u8,share:u16,phase:u16};6],on_trigger:bool,table{points:u16,check:u32}};",
    "host[command{hello|keep_alive|arm|disarm|start{amplitude_micrometre:u32,frequency_millihertz:u32}|stop|",
    "set_ramp{micrometre_per_s:u32}|set_host_timeout{ms:u32}|zero_counts|status|stream(enum[samples,rows])|",
    "set(enum[counts_per_turn{channel:u8,counts:u32},reversed{channel:u8,reversed:bool},sample_rate{millihertz:u32},",
    "amplitude_limit{micrometre:u32},frequency_limit{millihertz:u32},ramp_limit{micrometre_per_s:u32},",
    "acceleration_limit{millimetre_per_s2:u32},host_timeout{ms:u32},full_scale{micrometre:u32},baud{rate:u32},built_in,base{kind:enum[none,encoder,position,acceleration]},base_scale{scale:u32}])|restart|",
    "back_fill{boot_id:u32,first_tick:u32,ticks:u32}|prepare(enum[anew,component{place:u8,component{harmonic:u8,share:u16,phase:u16}},amplitude{place:u8,micrometre:u32},",
    "hold{ms:u32},glide(glide),on_trigger,points{place:u8,points:[i16;6]},table(table)])|excite{frequency_millihertz:u32}}]"
);

/// FNV-1a hash of [`SCHEMA`]: two sides with the same value lay messages out alike.
pub const SCHEMA_HASH: u32 = fnv1a(SCHEMA.as_bytes());

const fn fnv1a(bytes: &[u8]) -> u32 {
    let mut hash: u32 = 0x811c_9dc5;
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}

/// A message with the sender's frame number (wrapping), by which the receiver counts lost frames.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Envelope<M> {
    /// Frame number of this sender, wrapping at 2¹⁶.
    pub sequence: u16,
    /// The message.
    pub message: M,
}

/// Everything that a device sends.
// A block is much larger than a log line; boxing is not possible without an allocator and the queue
// holds mostly blocks.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceMessage {
    /// Who the device is and how it is set.
    Hello(Hello),
    /// Counts of all channels.
    Samples(SampleBlock),
    /// Counters and the shaker's state.
    Status(Status),
    /// Answer to a command.
    Ack(Ack),
    /// A line for people.
    Log(Log),
    /// The device's own estimate.
    Estimate(Estimate),
    /// Regression rows.
    Rows(Rows),
    /// Counts that were asked for again ([`Command::BackFill`]).
    Restored(SampleBlock),
    /// All that the device has of what was asked for has been sent.
    BackFilled(BackFilled),
    /// What the shaker does.
    Excited(Excited),
}

/// Everything that a host sends.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum HostMessage {
    /// A command, answered by an [`Ack`] that carries its envelope's sequence number.
    Command(Command),
}

/// Consecutive samples of all channels: the encoders in their order, then the base's sensor where
/// there is one ([`Hello::base`]). Sample i was taken at tick `first_tick + i`, when the
/// drive's phase was `phase + i·phase_increment` (turns · 2⁻³², wrapping).
///
/// What is decoded is whole: a block without a channel, or with other than as many differences of
/// each ([`crate::block::is_whole`]), is no message.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "AnyBlock")]
pub struct SampleBlock {
    /// Tick of the first sample, wrapping at 2³².
    pub first_tick: u32,
    /// Phase of the drive at the first sample, in turns · 2⁻³².
    pub phase: u32,
    /// Advance of the phase in one tick, in turns · 2⁻³² (0 where the shaker rests).
    pub phase_increment: u32,
    /// Commanded amplitude of the base at the first sample, nm.
    pub amplitude_nanometre: u32,
    /// Counts of the first sample (multi-turn), one for each channel.
    pub first: Vec<i32, MOST_CHANNELS, u8>,
    /// Differences from sample to sample: those of all channels from the first sample to the
    /// second, then to the third, and so on.
    pub deltas: Vec<i16, { (BLOCK_LEN - 1) * MOST_CHANNELS }, u8>,
}

/// What may be laid out as a block.
#[derive(Deserialize)]
struct AnyBlock {
    first_tick: u32,
    phase: u32,
    phase_increment: u32,
    amplitude_nanometre: u32,
    first: Vec<i32, MOST_CHANNELS, u8>,
    deltas: Vec<i16, { (BLOCK_LEN - 1) * MOST_CHANNELS }, u8>,
}

impl TryFrom<AnyBlock> for SampleBlock {
    type Error = &'static str;

    fn try_from(any: AnyBlock) -> Result<Self, Self::Error> {
        let AnyBlock { first_tick, phase, phase_increment, amplitude_nanometre, first, deltas } = any;
        let block = Self { first_tick, phase, phase_increment, amplitude_nanometre, first, deltas };
        if crate::block::is_whole(&block) { Ok(block) } else { Err("a block that is not whole") }
    }
}

impl SampleBlock {
    /// A block of no channel at tick 0.
    pub const EMPTY: Self = Self {
        first_tick: 0,
        phase: 0,
        phase_increment: 0,
        amplitude_nanometre: 0,
        first: Vec::new(),
        deltas: Vec::new(),
    };
}

/// The end of the answer to a [`Command::BackFill`]: all that the device still has of these ticks
/// has been sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BackFilled {
    /// First tick that was asked for.
    pub first_tick: u32,
    /// Number of ticks that were asked for.
    pub ticks: u32,
    /// Samples of these ticks that the device had, and has sent: of the other ticks it has none
    /// (any more).
    pub samples: u32,
}

/// What the shaker does, or did last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Excited {
    /// Tick of its first displacement; where it has not begun yet, the one at which it was taken.
    pub tick: u32,
    /// What it does.
    pub excitation: Excitation,
}

/// State of the shaker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ShakerState {
    /// Silent; a start is refused.
    #[default]
    Disarmed,
    /// Silent; a start is accepted.
    Armed,
    /// Moving, amplitude on its way to the one commanded.
    Ramping,
    /// Moving at the commanded amplitude.
    Running,
    /// Amplitude on its way to zero.
    Stopping,
    /// Silent after a fault; disarm to clear.
    Faulted,
}

/// Why the shaker last stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StopCause {
    /// It has not run since boot.
    #[default]
    None,
    /// Commanded.
    Command,
    /// No command came within the host's time-out.
    HostSilent,
    /// A limit was about to be exceeded.
    Limit,
    /// The output failed.
    Fault,
    /// The emergency stop has cut the amplifier's enable line.
    EmergencyStop,
}

/// Counters since boot (wrapping) and the shaker's state.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// Sampling tick.
    pub tick: u32,
    /// Ticks missed by the sampler.
    pub overruns: u32,
    /// Samples that were not streamed because the link took nothing; as long as they are kept they
    /// can be asked for.
    pub dropped_samples: u32,
    /// Other frames dropped because their queue was full.
    pub dropped_frames: u32,
    /// Received frames that failed their checksum or did not decode.
    pub bad_frames: u32,
    /// Commands refused.
    pub rejected_commands: u32,
    /// Samples handed to the link.
    pub samples_sent: u32,
    /// State of the shaker.
    pub shaker: ShakerState,
    /// Why it last stopped.
    pub stop_cause: StopCause,
    /// Present amplitude, nm.
    pub amplitude_nanometre: u32,
    /// Commanded frequency, mHz.
    pub frequency_millihertz: u32,
    /// Greatest delay from tick to sample since the last status, µs.
    pub latency_max_us: u32,
    /// Preview: rms of each encoder's wrapped angle over the last second, mrad (reduced precision;
    /// never used for results).
    pub rms_angle_mrad: Vec<u32, MOST_ENCODERS>,
    /// Preview: mean turning rate over the last second, 10⁻³ turns a minute.
    pub turns_per_minute_milli: Vec<i32, MOST_ENCODERS>,
    /// Tick of the oldest sample that can be asked for again; that of this status where there is
    /// none.
    pub kept_from: u32,
}

/// A line for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Log {
    /// Sampling tick.
    pub tick: u32,
    /// 0 error, 1 warning, 2 information.
    pub level: u8,
    /// Text.
    pub text: String<TEXT_LEN>,
}

//! Greatest lengths, the wire's budget, and the decoder case by case.

use heapless::{String, Vec};
use std::vec::Vec as StdVec;

use super::*;
use crate::excitation::{CHUNK, Component, Excitation, Form, Glide, Law, Part, TableName};
use crate::frame::regression::{Binary24, Binary32, EquationEstimate, ROW_LEN, Unknown};
use crate::frame::*;

fn full<T: Clone, const N: usize>(value: T) -> Vec<T, N> {
    core::iter::repeat_n(value, N).collect()
}

fn text<const N: usize>() -> String<N> {
    let mut text = String::new();
    while text.push('x').is_ok() {}
    text
}

/// A block whose every varint has its full length.
fn longest_block(channels: usize) -> SampleBlock {
    let all = u32::MAX;
    SampleBlock {
        first_tick: all,
        phase: all,
        phase_increment: all,
        amplitude_nanometre: all,
        first: core::iter::repeat_n(i32::MIN, channels).collect(),
        deltas: core::iter::repeat_n(i16::MIN, (BLOCK_LEN - 1) * channels).collect(),
    }
}

/// The longest message of each kind: every varint at its full length.
fn longest() -> [DeviceMessage; 10] {
    let mut rows = Vec::new();
    while rows.push([Binary24([9; 3]); ROW_LEN]).is_ok() {}
    let float = Binary32([9; 4]);
    let unknown = Unknown { value: float, std_error: float };
    let all = u32::MAX;
    let block = longest_block(MOST_CHANNELS);
    [
        DeviceMessage::Hello(Hello {
            protocol: u16::MAX,
            schema: all,
            boot_id: all,
            tick: all,
            firmware: text(),
            board: text(),
            sample_rate_millihertz: all,
            counts_per_turn: full(all),
            block_len: u8::MAX,
            limits: ShakerLimits {
                amplitude_micrometre: all,
                frequency_millihertz: all,
                ramp_micrometre_per_s: all,
                acceleration_millimetre_per_s2: all,
            },
            host_timeout_ms: all,
            zeros: full(Zero { id: all, source: ZeroSource::Carried, index: Some(all) }),
            reset: ResetCause::Panic,
            panic: text(),
            reversed: full(true),
            full_scale_micrometre: all,
            baud: all,
            settings: SettingsSource::NotKept,
            base: BaseSensor { kind: BaseKind::Acceleration, scale: all },
        }),
        DeviceMessage::Samples(block.clone()),
        DeviceMessage::Status(Status {
            tick: all,
            overruns: all,
            dropped_samples: all,
            dropped_frames: all,
            bad_frames: all,
            rejected_commands: all,
            samples_sent: all,
            shaker: ShakerState::Faulted,
            stop_cause: StopCause::Fault,
            amplitude_nanometre: all,
            frequency_millihertz: all,
            latency_max_us: all,
            rms_angle_mrad: full(all),
            turns_per_minute_milli: full(i32::MIN),
            kept_from: all,
        }),
        DeviceMessage::Ack(Ack { command_sequence: u16::MAX, result: CommandResult::OutOfRange { limit: all } }),
        DeviceMessage::Log(Log { tick: all, level: u8::MAX, text: text() }),
        DeviceMessage::Estimate(Estimate {
            tick: all,
            window_ticks: all,
            windows: all,
            forget_per_mille: u16::MAX,
            phase_increment: all,
            amplitude_nanometre: all,
            first: EquationEstimate::Known { unknowns: [unknown; 6], condition: float, residual_rms: float },
            second: EquationEstimate::Known { unknowns: [unknown; 5], condition: float, residual_rms: float },
        }),
        DeviceMessage::Rows(Rows {
            tick: all,
            window_ticks: all,
            window: all,
            phase_increment: all,
            amplitude_nanometre: all,
            frequency: u8::MAX,
            last_frequency: u8::MAX,
            rows,
        }),
        DeviceMessage::Restored(block),
        DeviceMessage::BackFilled(BackFilled { first_tick: all, ticks: all, samples: all }),
        DeviceMessage::Excited(Excited { tick: all, excitation: longest_excitation() }),
    ]
}

fn longest_excitation() -> Excitation {
    let all = u32::MAX;
    let component = Component { harmonic: u8::MAX, share: u16::MAX, phase: u16::MAX };
    Excitation {
        frequency_millihertz: all,
        glide: Glide { law: Law::Logarithmic, back: true, to_millihertz: all, ms: all },
        amplitudes_micrometre: [all; MOST_STEPS],
        steps: u8::MAX,
        hold_ms: all,
        form: Form([component; MOST_COMPONENTS]),
        on_trigger: true,
        table: TableName { points: u16::MAX, check: all },
    }
}

fn frame<M: Serialize>(message: M) -> StdVec<u8> {
    let mut out = [0; MAX_FRAME];
    let length = encode(&Envelope { sequence: u16::MAX, message }, &mut out).unwrap();
    out[..length].to_vec()
}

fn worst_lengths() -> [usize; 10] {
    longest().map(|message| frame(message).len())
}

#[test]
fn the_longest_messages_have_the_stated_lengths() {
    let [hello, samples, status, ack, log, estimate, rows, restored, back_filled, excited] = worst_lengths();
    assert_eq!(
        [hello, samples, status, log, estimate, rows, excited],
        [HELLO, samples_len(MOST_CHANNELS), STATUS, LOG, ESTIMATE, ROWS, EXCITED].map(frame_len)
    );
    assert_eq!(MAX_FRAME, worst_lengths().into_iter().max().unwrap_or(0));
    assert!(ack < log && back_filled < log);
    assert_eq!([samples_frame_len(MOST_CHANNELS); 2], [samples, restored]);
    for channels in 1..=MOST_CHANNELS {
        let longest = frame(DeviceMessage::Samples(longest_block(channels))).len();
        assert_eq!(longest, samples_frame_len(channels), "{channels} channels");
    }
    let all = u32::MAX;
    let ask = Command::BackFill { boot_id: all, first_tick: all, ticks: all };
    assert!(frame(HostMessage::Command(ask)).len() <= MAX_FRAME);
    assert!(longest_excitation().commands().iter().all(|c| frame(HostMessage::Command(*c)).len() <= MAX_FRAME));
    let points = Command::Prepare(Part::Points { place: u8::MAX, points: [i16::MIN; CHUNK] });
    assert!(frame(HostMessage::Command(points)).len() <= MAX_FRAME);
    // COBS' second overhead byte begins with the 254th byte.
    assert_eq!([frame_len(249), frame_len(250)], [249 + 4 + 2, 250 + 4 + 3]);
}

/// The share of a 115 200 baud line (8N1: ten bits a byte) that so many bytes a second take.
fn occupancy(bytes_per_second: usize) -> f64 {
    (bytes_per_second * 10) as f64 / 115_200.0
}

/// Beside the stream: a status a second, ten commands a second with their answers, estimates at the
/// greatest frequency of the drive that boards allow (20 Hz: one every twenty periods).
fn beside_the_stream() -> usize {
    let [_, _, status, ack, _, estimate, _, _, _, excited] = worst_lengths();
    // What is no sine is told once a second, and is not identified.
    status + 10 * ack + estimate.max(excited)
}

#[test]
fn the_wire_is_at_most_seventy_percent_full_at_115200_baud() {
    // Two encoders, and the base's sensor with them: more than that needs a faster line.
    let shares = [2, 3].map(|channels| stream_share(samples_frame_len(channels)));
    std::println!("samples: {shares:.3?} of 115 200 baud");
    assert!(shares[0] <= 0.70 && shares[1] <= 0.85, "{shares:?}");
}

fn stream_share(samples: usize) -> f64 {
    // Full blocks at 500 Hz. Each command may end a block early, and so may the ramp that it
    // begins, when it ends.
    let bytes_per_second = 500usize.div_ceil(BLOCK_LEN) * samples + 20 * samples + beside_the_stream();
    occupancy(bytes_per_second)
}

#[test]
fn the_wire_is_at_most_seventy_percent_full_with_rows_too() {
    let [.., rows, _, _, _] = worst_lengths();
    // m from 0 to 32, two in a message; a window every ten periods.
    let window = 33usize.div_ceil(2) * rows;
    for (frequency_hz, most) in [(5, 0.20), (20, 0.70)] {
        let bytes_per_second = window * frequency_hz / 10 + beside_the_stream();
        let share = occupancy(bytes_per_second);
        std::println!("rows at {frequency_hz} Hz: {bytes_per_second} bytes a second, {:.1} %", 100.0 * share);
        assert!(share <= most, "{frequency_hz} Hz: {share}");
    }
}

#[test]
fn the_checksum_is_the_catalogued_one() {
    assert_eq!(CRC.checksum(b"123456789"), 0xcbf4_3926);
}

#[test]
fn a_frame_byte_by_byte() {
    // Envelope 7, message 0 (command), command 1 (keep alive); CRC of 07 00 01; COBS.
    let crc = CRC.checksum(&[7, 0, 1]).to_le_bytes();
    assert!(!crc.contains(&0));
    let mut want = std::vec![2, 7, 6, 1];
    want.extend(crc);
    want.push(0);
    let mut out = [0; 16];
    let envelope = Envelope { sequence: 7, message: HostMessage::Command(Command::KeepAlive) };
    let length = encode(&envelope, &mut out).unwrap();
    assert_eq!(out[..length], want);
    for short in 0..length {
        assert_eq!(encode(&envelope, &mut out[..short]), Err(EncodeError::BufferTooSmall));
    }
}

/// Bytes of every length, with zeros at every distance and with none.
#[test]
fn zeros_are_taken_out_in_place() {
    for length in 0..800 {
        for every in [1, 2, 3, 7, 100, 253, 254, 255, 300, 508, usize::MAX] {
            let bytes: StdVec<u8> =
                (1..=length).map(|i| if i % every == 0 { 0 } else { 1 + (i % 255) as u8 }).collect();
            let mut out = std::vec![9; frame_len(length) - CRC_LEN];
            out[1..=length].copy_from_slice(&bytes);
            let frame = stuff(&mut out, length).unwrap();
            assert!(frame <= length + length / 254 + 2 && out[frame - 1] == 0, "{length} {every}");
            assert!(out[..frame - 1].iter().all(|byte| *byte != 0), "{length} {every}");
            let decoded = cobs::decode_in_place(&mut out[..frame - 1]).unwrap();
            assert_eq!(out[..decoded], bytes, "{length} {every}");
            assert!(stuff(&mut out[..length + 1], length).is_none());
        }
    }
}

fn decode(bytes: &[u8]) -> (StdVec<Result<Envelope<HostMessage>, FrameError>>, DecoderCounters) {
    let mut decoder: Decoder<HostMessage> = Decoder::new();
    let results = bytes.iter().filter_map(|&byte| decoder.push(byte)).collect();
    (results, decoder.counters())
}

fn checked(payload: &[u8]) -> StdVec<u8> {
    let mut bytes = payload.to_vec();
    bytes.extend(CRC.checksum(payload).to_le_bytes());
    let mut frame = std::vec![0; cobs::max_encoding_length(bytes.len()) + 1];
    let length = cobs::encode(&bytes, &mut frame);
    frame.truncate(length + 1);
    frame
}

#[test]
fn each_error_is_told_and_counted() {
    let good = frame(HostMessage::Command(Command::Arm));
    let mut stream = StdVec::new();
    stream.extend([0, 0, 0]);
    stream.extend(&good);
    let mut flipped = good.clone();
    flipped[2] ^= 0x40;
    stream.extend(&flipped); // framing or checksum
    stream.extend([5, 1, 0]); // COBS promises more than there is
    stream.extend([3, 1, 2, 0]); // too short for a checksum
    stream.extend(checked(&[7, 0, 99])); // no such command
    stream.extend(checked(&[7, 0, 1, 0])); // bytes left over
    stream.extend([9; MAX_FRAME]);
    stream.push(0); // no zero in time
    stream.extend(&good);
    let (results, counters) = decode(&stream);
    let errors: StdVec<_> = results.iter().map(|r| r.as_ref().err().copied()).collect();
    use FrameError::{BadChecksum, BadCobs, Malformed, Oversize};
    let want = [
        None,
        Some(BadChecksum),
        Some(BadCobs),
        Some(BadChecksum),
        Some(Malformed),
        Some(Malformed),
        Some(Oversize),
        None,
    ];
    assert_eq!(errors, want);
    assert_eq!((counters.frames, counters.bad_frames()), (2, 6));
    assert_eq!([counters.bad_checksum, counters.bad_cobs, counters.malformed, counters.oversize], [2, 1, 2, 1]);
    let good_bytes = 3 + 2 * good.len() as u64;
    assert_eq!(counters.bytes_discarded, stream.len() as u64 - good_bytes);
}

#[test]
fn a_block_that_is_not_whole_is_no_message() {
    for (channels, differences, whole) in [(1, 9, true), (2, 18, true), (3, 3, true), (0, 0, false), (2, 3, false)] {
        let block = SampleBlock {
            first: core::iter::repeat_n(1, channels).collect(),
            deltas: core::iter::repeat_n(1, differences).collect(),
            ..SampleBlock::EMPTY
        };
        let mut decoder: Decoder<DeviceMessage> = Decoder::new();
        let result = frame(DeviceMessage::Samples(block)).into_iter().find_map(|byte| decoder.push(byte)).unwrap();
        assert_eq!(result.err(), if whole { None } else { Some(FrameError::Malformed) }, "{channels} {differences}");
    }
}

#[test]
fn the_longest_frame_that_is_accepted() {
    let mut decoder: Decoder<HostMessage, 10> = Decoder::new();
    let mut lengths = StdVec::new();
    for length in [9, 10, 11] {
        let result = (0..length - 1).map(|_| 1).chain([0]).find_map(|byte| decoder.push(byte));
        lengths.push(result.unwrap().unwrap_err());
    }
    // Eight or nine bytes and a zero fit; ten and a zero do not.
    assert_eq!(lengths, [FrameError::BadChecksum, FrameError::BadChecksum, FrameError::Oversize]);
}

#[test]
fn a_decoder_without_room_is_harmless() {
    let mut none: Decoder<HostMessage, 0> = Decoder::new();
    let mut one: Decoder<HostMessage, 1> = Decoder::new();
    for byte in [1, 2, 0, 0, 3, 0] {
        none.push(byte);
        one.push(byte);
    }
    assert_eq!((none.counters().oversize, one.counters().oversize), (2, 2));
}

#[test]
fn an_abandoned_frame_is_accounted_for() {
    let good = frame(HostMessage::Command(Command::Arm));
    let mut decoder: Decoder<HostMessage> = Decoder::new();
    for &byte in &good[..4] {
        decoder.push(byte);
    }
    decoder.abandon();
    assert_eq!((decoder.counters().bytes_discarded, decoder.pending_bytes()), (4, 0));
    assert!(good.iter().filter_map(|&byte| decoder.push(byte)).all(|result| result.is_ok()));
}

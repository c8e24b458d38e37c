//! Codec and frame numbers.

use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::{
    Ack, Command, CommandResult, DeviceMessage, Envelope, HostMessage, SampleBlock, ShakerState, Status,
};
use whirl_shared::sequence::SequenceTracker;

fn messages() -> [DeviceMessage; 4] {
    let deltas = (0..9).flat_map(|_| [i16::MIN, i16::MAX, 0]).collect();
    [
        DeviceMessage::Samples(SampleBlock {
            first_tick: u32::MAX,
            phase: 0x8000_0001,
            phase_increment: 42_949_673,
            amplitude_nanometre: 15_525_000,
            first: [i32::MIN, i32::MAX, -1].into(),
            deltas,
        }),
        DeviceMessage::Status(Status {
            tick: 7,
            shaker: ShakerState::Running,
            rms_angle_mrad: [1, 2].into(),
            ..Status::default()
        }),
        DeviceMessage::Ack(Ack { command_sequence: 3, result: CommandResult::OutOfRange { limit: 20_000 } }),
        DeviceMessage::Samples(SampleBlock {
            first_tick: 0,
            phase: 0,
            phase_increment: 0,
            amplitude_nanometre: 0,
            first: [0, -1].into(),
            deltas: heapless::Vec::new(),
        }),
    ]
}

fn framed(sequence: u16, message: DeviceMessage, out: &mut [u8; MAX_FRAME]) -> usize {
    match encode(&Envelope { sequence, message }, out) {
        Ok(length) => length,
        Err(error) => panic!("{error:?}"),
    }
}

pub fn every_message_survives_the_wire() {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let mut out = [0; MAX_FRAME];
    for (sequence, message) in (65_534..=u16::MAX).chain(0..2).zip(messages()) {
        let length = framed(sequence, message.clone(), &mut out);
        let mut got = None;
        for &byte in &out[..length] {
            got = got.or(decoder.push(byte));
        }
        assert_eq!(got, Some(Ok(Envelope { sequence, message })));
    }
}

pub fn every_flipped_bit_is_seen() {
    let mut out = [0; MAX_FRAME];
    let message = HostMessage::Command(Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_000 });
    let length = encode(&Envelope { sequence: 9, message }, &mut out).unwrap_or(0);
    assert!(length > 8);
    for bit in 0..8 * (length - 1) {
        let mut damaged = out;
        damaged[bit / 8] ^= 1 << (bit % 8);
        let mut decoder = Decoder::<HostMessage>::new();
        for &byte in &damaged[..length] {
            assert!(!matches!(decoder.push(byte), Some(Ok(_))), "bit {bit}");
        }
        assert!(decoder.counters().bad_frames() > 0, "bit {bit}");
    }
}

pub fn the_decoder_finds_its_way_back() {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let mut out = [0; MAX_FRAME];
    // Longer than any frame, without an end.
    for n in 0..1_000_u32 {
        assert!(!matches!(decoder.push((n % 255 + 1) as u8), Some(Ok(_))));
    }
    decoder.push(0);
    for (sequence, message) in (0..).zip(messages()) {
        let length = framed(sequence, message, &mut out);
        let good = out[..length].iter().filter(|&&byte| matches!(decoder.push(byte), Some(Ok(_)))).count();
        assert_eq!(good, 1);
    }
}

pub fn frame_numbers_tell_what_is_lost() {
    let mut tracker = SequenceTracker::new();
    for number in (65_530..=u16::MAX).chain(0..10).filter(|n| n % 7 != 0) {
        tracker.observe(number);
    }
    tracker.observe(10);
    tracker.observe(10);
    // 65 534, 0 and 7 were left out.
    let counters = tracker.counters();
    assert_eq!((counters.lost, counters.duplicate), (3, 1));
}

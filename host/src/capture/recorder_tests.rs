//! The recorder under whatever a device may say.

use rand::{Rng, SeedableRng};
use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::frame::{BLOCK_LEN, BackFilled, PROTOCOL_VERSION, SCHEMA_HASH, SampleBlock, ShakerState, Status};

use super::*;

const RIG: &str = "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n\
    [[channel]]\nname = \"a\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n";

fn message(rng: &mut rand_chacha::ChaCha8Rng, hello: &Hello) -> DeviceMessage {
    // Ticks near each other, near the wrap, and anywhere.
    let tick = match rng.next_u32() % 4 {
        0 => rng.next_u32(),
        1 => u32::MAX - rng.next_u32() % 100,
        _ => rng.next_u32() % 5000,
    };
    match rng.next_u32() % 11 {
        10 => DeviceMessage::BackFilled(BackFilled {
            first_tick: tick,
            ticks: rng.next_u32() % 1000,
            samples: rng.next_u32() % 1000,
        }),
        0 => DeviceMessage::Hello(Hello { boot_id: rng.next_u32() % 3, tick, ..hello.clone() }),
        1 => DeviceMessage::Status(Status {
            tick,
            overruns: rng.next_u32(),
            dropped_samples: rng.next_u32(),
            shaker: ShakerState::Running,
            amplitude_nanometre: 1_000_000,
            frequency_millihertz: 5000,
            kept_from: tick.wrapping_sub(rng.next_u32() % 1000),
            ..Status::default()
        }),
        kind => {
            let n = rng.next_u32() as usize % BLOCK_LEN;
            let block = SampleBlock {
                first_tick: tick,
                phase: rng.next_u32(),
                phase_increment: rng.next_u32(),
                amplitude_nanometre: rng.next_u32(),
                first: [rng.next_u32().cast_signed(), i32::MAX].into(),
                deltas: (0..n).flat_map(|_| [rng.next_u32() as i16, i16::MAX]).collect(),
            };
            if kind > 7 { DeviceMessage::Restored(block) } else { DeviceMessage::Samples(block) }
        }
    }
}

/// Bytes without a hello: a file of a device that sent older ticks again.
#[test]
fn samples_of_ticks_long_gone_by_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::parse(RIG, Path::new("rig.toml")).unwrap();
    let warnings = |ticks: &[u32]| {
        let mut recorder = Recorder::new(&rig, &dir.path().join("r.csv"), Terms::default()).unwrap();
        for (sequence, tick) in ticks.iter().enumerate() {
            let block = SampleBlock {
                first_tick: *tick,
                phase: 0,
                phase_increment: 0,
                amplitude_nanometre: 0,
                first: [0, 0].into(),
                deltas: [0; 2 * (BLOCK_LEN - 1)].into_iter().collect(),
            };
            let envelope = Envelope { sequence: sequence as u16, message: DeviceMessage::Samples(block) };
            let mut frame = [0; MAX_FRAME];
            let n = encode(&envelope, &mut frame).unwrap();
            frame[..n].iter().for_each(|byte| drop(recorder.push(*byte).unwrap()));
        }
        recorder.finish().unwrap().warnings
    };
    let once: Vec<u32> = (500..1500).step_by(10).collect();
    assert_eq!(warnings(&once), []);
    let told = warnings(&[&once[..], &once[40..]].concat());
    // From tick 900 to what a link may deliver late.
    assert!(told.len() == 1 && told[0].id == "samples-again" && told[0].details["samples"] == 280, "{told:?}");
    assert!(told[0].text.contains("behind tick 1500 of the record"), "{told:?}");
}

#[test]
fn whatever_a_device_says_adds_up_without_panic() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::parse(RIG, Path::new("rig.toml")).unwrap();
    let hello = Hello {
        protocol: PROTOCOL_VERSION,
        schema: SCHEMA_HASH,
        boot_id: 0,
        tick: 0,
        firmware: "x".try_into().unwrap(),
        board: "y".try_into().unwrap(),
        sample_rate_millihertz: 500_000,
        counts_per_turn: [4096, 1].into(),
        block_len: 10,
        limits: whirl_shared::frame::ShakerLimits {
            amplitude_micrometre: 1,
            frequency_millihertz: 1,
            ramp_micrometre_per_s: 1,
            acceleration_millimetre_per_s2: 40_000,
        },
        host_timeout_ms: 1,
        ..Hello::default()
    };
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    let mut with_samples = 0;
    for round in 0..200 {
        let terms = Terms {
            seconds: (round % 3 == 0).then_some(20.0),
            from_drive: (round % 2 == 0).then_some((1000, 5000)),
            hello_first: round % 5 == 0,
            ..Terms::default()
        };
        let mut recorder = Recorder::new(&rig, &dir.path().join("r.csv"), terms).unwrap();
        for sequence in 0..300 {
            let envelope = Envelope { sequence, message: message(&mut rng, &hello) };
            let mut frame = [0; MAX_FRAME];
            let n = encode(&envelope, &mut frame).unwrap();
            if rng.next_u32() % 10 == 0 {
                frame[rng.next_u32() as usize % n] = rng.next_u32() as u8;
            }
            for &byte in &frame[..n] {
                recorder.push(byte).unwrap();
            }
        }
        let done = recorder.finish().unwrap();
        if let (Some(first), Some(last)) = (done.first_tick, done.last_tick) {
            with_samples += 1;
            assert_eq!(done.losses.received + done.losses.lost(), last.abs_diff(first) + 1);
        }
    }
    assert!(with_samples > 50, "{with_samples}");
}

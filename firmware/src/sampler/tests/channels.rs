//! Inputs of other numbers: one to six encoders, and the base's sensor.

use super::*;
use crate::base::BaseInput;
use crate::inputs::WithBase;
use whirl_shared::frame::{BaseKind, BaseSensor};

/// A converter, and an encoder's counter.
struct Reading(u16);

impl BaseInput for Reading {
    fn latch(&mut self) -> u16 {
        self.0
    }
}

fn with_base(kind: BaseKind) -> Settings {
    Settings { base_input: true, base: BaseSensor { kind, scale: 1_000 }, ..Settings::default() }
}

#[test]
fn the_bases_counts_come_behind_the_encoders_in_every_sample() {
    for (kind, want) in [
        (BaseKind::Encoder, Some([-536, -535])),
        (BaseKind::Position, Some([32_232, 32_233])),
        (BaseKind::Acceleration, Some([32_232, 32_233])),
        (BaseKind::None, None),
    ] {
        let inputs = WithBase { encoders: (Counter(5), Counter(6)), base: Reading(65_000) };
        let mut sampler = Sampler::new(&with_base(kind), inputs, Recorder::default()).unwrap();
        let (mut blocks, mut events) = (Queue::<SampleBlock, 4>::new(), Queue::<Event, 4>::new());
        let mut requests = Queue::<Request, 4>::new();
        for n in 0..10 {
            sampler.parts_mut().0.base.0 = 65_000 + n;
            sampler.tick(0, 0, &mut blocks, &mut events, &mut requests);
        }
        let block = blocks.dequeue().expect("a full block");
        let counts: Vec<_> = samples(&block).map(|s| s.counts).collect();
        match want {
            Some([first, second]) => {
                assert_eq!((counts[0], counts[1]), (Counts::of(&[5, 6, first]), Counts::of(&[5, 6, second])));
            }
            None => assert_eq!(counts[9], [5, 6]),
        }
        // Zeroing is an encoder's, not a converter's.
        let zero = Request { sequence: 1, command: Command::ZeroCounts };
        requests.enqueue(zero).unwrap();
        for _ in 0..12 {
            sampler.tick(0, 0, &mut blocks, &mut events, &mut requests);
        }
        let _ = blocks.dequeue();
        let block = blocks.dequeue().expect("another full block");
        let third = block.first.get(2).copied();
        assert_eq!(third, want.map(|_| if kind == BaseKind::Encoder { 0 } else { 65_009 - 32_768 }));
    }
}

#[test]
fn one_to_six_encoders_are_sampled() {
    fn run<const N: usize>() {
        let settings = Settings {
            counts_per_turn: (0..N).map(|_| 4_096).collect(),
            reversed: (0..N).map(|i| i == 1).collect(),
            ..with_base(BaseKind::Position)
        };
        let encoders: [Counter; N] = core::array::from_fn(|i| Counter(100 * i as u16 + 7));
        let inputs = WithBase { encoders, base: Reading(32_769) };
        let mut sampler = Sampler::new(&settings, inputs, Recorder::default()).unwrap();
        let (mut blocks, mut events) = (Queue::<SampleBlock, 4>::new(), Queue::<Event, 4>::new());
        for _ in 0..10 {
            sampler.tick(0, 0, &mut blocks, &mut events, &mut Queue::<Request, 4>::new());
        }
        let block = blocks.dequeue().expect("a full block");
        let want = |i: usize| if i == N { 1 } else { (100 * i as i32 + 7) * if i == 1 { -1 } else { 1 } };
        assert_eq!(&block.first[..], (0..=N).map(want).collect::<Vec<_>>());
        assert_eq!((sample_count(&block), sampler.snapshot().turning.len()), (10, N));
    }
    run::<1>();
    run::<3>();
    run::<6>();
    // A board's inputs and its settings belong together.
    let three = [0, 0, 0].map(Counter);
    let error = Sampler::new(&Settings::default(), three, Recorder::default()).unwrap_err();
    assert_eq!((error.field, error.found, error.min), ("encoders", 2, 3));
    let two = (Counter(0), Counter(0));
    let error = Sampler::new(&with_base(BaseKind::None), two, Recorder::default()).unwrap_err();
    assert_eq!(error.field, "base_input");
}

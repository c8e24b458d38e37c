//! Instructions of each part of a tick, by the emulator's instruction count (`-icount shift=5`: 32
//! ns each; the clock's steps are 40 ns, so that a single figure is good to 2 instructions).
//!
//! Worst case: both arms whirl at 10 turns a second, the shaker runs, every block is sent, a
//! command comes each tick.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod on_target {
    use core::borrow::BorrowMut;
    use core::cell::Cell;
    use core::convert::Infallible;
    use core::fmt::Write;
    use core::hint::black_box;
    use core::panic::PanicInfo;

    use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
    use heapless::spsc::Queue;
    use static_cell::ConstStaticCell;
    use whirl_board_lasting as lasting;
    use whirl_board_mps2_an386::machine::{self, Vector};
    use whirl_board_mps2_an386::meter::Meter;
    use whirl_board_mps2_an386::semihosting::{Console, exit};
    use whirl_board_mps2_an386::stack;
    use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
    use whirl_firmware::base::BaseInput;
    use whirl_firmware::dac::DacShaker;
    use whirl_firmware::estimate::{Estimator, FREQUENCIES, STEPS};
    use whirl_firmware::event::{Event, Request};
    use whirl_firmware::history::KEPT;
    use whirl_firmware::lines::{Pins, WithLines};
    use whirl_firmware::link::Link;
    use whirl_firmware::pacing::{Pacer, Passed};
    use whirl_firmware::player::{Channel, MOST, Player, Run, schedule};
    use whirl_firmware::sampler::Sampler;
    use whirl_firmware::sweep::BEYOND;
    use whirl_firmware::{Inputs, QuadratureCounter, Settings, ShakerOutput, WithBase};
    use whirl_shared::codec::{MAX_FRAME, encode};
    use whirl_shared::excitation::{Component, Excitation, Glide, Law, Table, WHOLE};
    use whirl_shared::frame::{BaseKind, BaseSensor, Command, DeviceMessage, Envelope, HostMessage, SampleBlock};
    use whirl_shared::harmonics::{HarmonicBank, HarmonicSettings, Window};
    use whirl_shared::least_squares::LeastSquares;
    use whirl_shared::regressor::UNKNOWNS1;
    use whirl_shared::waveform::displacement;

    #[unsafe(link_section = ".vector_table.interrupts")]
    #[unsafe(no_mangle)]
    static __INTERRUPTS: [Vector; 32] = machine::empty_table();

    #[panic_handler]
    fn panic(info: &PanicInfo<'_>) -> ! {
        // The emulation ends in any case.
        let _ = writeln!(Console, "{info}");
        exit(false)
    }

    /// Turns steadily.
    struct Whirling(u16, u16);

    impl QuadratureCounter for Whirling {
        fn count(&mut self) -> u16 {
            self.0 = self.0.wrapping_add(self.1);
            self.0
        }
    }

    /// The points' timer and channel of the NUCLEO-G474RE; the last run has come to one place or
    /// another, so that there are ticks in which all points are caught up with.
    struct Points(Cell<usize>);

    /// The timers' clock, and a tick's counts of it.
    const TIMER_HZ: u32 = 170_000_000;

    impl Channel for Points {
        const MAX: u16 = 4_095;
        const AHEAD: usize = 0;
        const UNCLEAR: u32 = 8;

        fn since_tick(&self) -> u32 {
            black_box(100)
        }

        fn write(&mut self, code: u16) {
            black_box(code);
        }

        fn start(&mut self, codes: &[u16]) {
            black_box(codes);
        }

        fn left(&self) -> usize {
            self.0.set((self.0.get() + 31) % (80 + BEYOND));
            black_box(self.0.get())
        }

        fn stop(&mut self) {
            black_box(());
        }
    }

    /// A converter that shows 200 counts more each time.
    struct Swinging(u16);

    impl BaseInput for Swinging {
        fn latch(&mut self) -> u16 {
            self.0 = black_box(self.0.wrapping_add(200));
            self.0
        }
    }

    struct Pin;

    impl ErrorType for Pin {
        type Error = Infallible;
    }

    impl InputPin for Pin {
        fn is_high(&mut self) -> Result<bool, Infallible> {
            Ok(black_box(true))
        }

        fn is_low(&mut self) -> Result<bool, Infallible> {
            Ok(!black_box(true))
        }
    }

    impl OutputPin for Pin {
        fn set_low(&mut self) -> Result<(), Infallible> {
            black_box(());
            Ok(())
        }

        fn set_high(&mut self) -> Result<(), Infallible> {
            black_box(());
            Ok(())
        }
    }

    /// The interrupt of a board, but for what lasts over a reset: which tick it is, its latency,
    /// the counters, all that the sampler does, the light.
    fn take_tick<I: Inputs, O: ShakerOutput>(
        (sampler, pacer, clock): (&mut Sampler<I, O>, &mut Pacer, &mut u32),
        blocks: &mut Queue<SampleBlock, BLOCKS>,
        events: &mut Queue<Event, EVENTS>,
        requests: &mut Queue<Request, REQUESTS>,
    ) {
        *clock = clock.wrapping_add(pacer.period());
        let now = *clock;
        let Some(Passed { missed, latency }) = pacer.latch(|| black_box(now), || sampler.latch()) else { return };
        let latency_us = u64::from(latency) * 1_000_000 / u64::from(black_box(TIMER_HZ / 8));
        sampler.tick(missed, latency_us as u32, blocks, events, requests);
        black_box(sampler.light());
    }

    /// So many ticks in which the host says what it is to say: the interrupt's from one of them on,
    /// and a command's in the thread.
    fn excited<I: Inputs, O: ShakerOutput, E: BorrowMut<Estimator>, K: BorrowMut<[u8]>>(
        (sampler, pacer, clock, link): (&mut Sampler<I, O>, &mut Pacer, &mut u32, &mut Link<E, K>),
        (blocks, events, requests): (
            &mut Queue<SampleBlock, BLOCKS>,
            &mut Queue<Event, EVENTS>,
            &mut Queue<Request, REQUESTS>,
        ),
        [ticks, from]: [u16; 2],
        say: impl Fn(usize) -> Command,
    ) -> Option<[Meter; 2]> {
        let (mut interrupt, mut thread) = (Meter::default(), Meter::default());
        let (mut frame, mut command) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        for n in 0..ticks {
            let message = HostMessage::Command(say(usize::from(n)));
            let length = encode(&Envelope { sequence: n, message }, &mut command).ok()?;
            thread.take(|| link.receive(&command[..length], requests));
            let mut meter = Meter::default();
            meter.take(|| take_tick((sampler, pacer, clock), blocks, events, requests));
            if n >= from {
                interrupt.add(&meter);
            }
            while link.poll_transmit(&mut frame, blocks, events).is_some() {}
        }
        Some([interrupt, thread])
    }

    /// As many sines as there may be, in a sweep.
    fn swept() -> Excitation {
        let mut sweep = Excitation::sine(1_000, 400);
        sweep.glide = Glide { law: Law::Logarithmic, back: true, to_millihertz: 3_000, ms: 1_000 };
        for (component, harmonic) in sweep.form.0.iter_mut().zip(1..) {
            *component = Component { harmonic, share: WHOLE / 6, phase: 9_000 };
        }
        sweep
    }

    fn tick() -> Option<()> {
        static ESTIMATOR: ConstStaticCell<Estimator> = ConstStaticCell::new(Estimator::IDLE);
        let base = BaseSensor { kind: BaseKind::Position, scale: 763_000 };
        let settings = Settings { board: "measure", base_input: true, base, ..Settings::default() };
        static RUNS: ConstStaticCell<[Run; 2]> = ConstStaticCell::new([[0; MOST + BEYOND]; 2]);
        let schedule = schedule(TIMER_HZ, settings.sample_rate_millihertz)?;
        (schedule.points == 80).then_some(())?;
        let player = Player::new(Points(Cell::new(0)), RUNS.take(), schedule);
        let pins = Pins { enabled: Pin, start: Pin, moving: Pin };
        let shaker = WithLines::new(DacShaker::new(player, Pin, 25_000_000), pins);
        let (mut pacer, mut clock) = (Pacer::new(schedule.period(), 7), 27_u32);
        // Ten turns a second of 4096 counts at 500 Hz; the base's sensor on the converter.
        let inputs = WithBase { encoders: (Whirling(0, 82), Whirling(0, 65_454)), base: Swinging(0) };
        let mut sampler = Sampler::new(&settings, inputs, shaker).ok()?;
        static MEMORY: ConstStaticCell<[u8; KEPT]> = ConstStaticCell::new([0; KEPT]);
        let memory: &mut [u8] = MEMORY.take();
        let mut link = Link::with(&settings, ESTIMATOR.take(), memory).ok()?;
        static QUEUE_BLOCKS: ConstStaticCell<Queue<SampleBlock, BLOCKS>> = ConstStaticCell::new(Queue::new());
        static QUEUE_EVENTS: ConstStaticCell<Queue<Event, EVENTS>> = ConstStaticCell::new(Queue::new());
        static QUEUE_REQUESTS: ConstStaticCell<Queue<Request, REQUESTS>> = ConstStaticCell::new(Queue::new());
        let (blocks, events, requests) = (QUEUE_BLOCKS.take(), QUEUE_EVENTS.take(), QUEUE_REQUESTS.take());
        let (mut sampling, mut keeping, mut hearing) = (Meter::default(), Meter::default(), Meter::default());
        let (mut block, mut other, mut all) = (Meter::default(), Meter::default(), Meter::default());
        let (mut frame, mut command) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        static NONE: ConstStaticCell<Queue<SampleBlock, 2>> = ConstStaticCell::new(Queue::new());
        static TAKEN: ConstStaticCell<Queue<SampleBlock, 2>> = ConstStaticCell::new(Queue::new());
        let (none, taken) = (NONE.take(), TAKEN.take());
        for n in 0..5_000_u16 {
            let say = match n {
                1 => Command::Arm,
                2 => Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_000 },
                _ => Command::KeepAlive,
            };
            let envelope = Envelope { sequence: n, message: HostMessage::Command(say) };
            let length = encode(&envelope, &mut command).ok()?;
            hearing.take(|| link.receive(&command[..length], requests));
            sampling.take(|| take_tick((&mut sampler, &mut pacer, &mut clock), blocks, events, requests));
            keeping.take(|| lasting::keep(u32::from(n), &sampler.kept()));
            // The frames of a tick: answers and reports, a block's by itself, then all that the
            // thread does with a block.
            other.take(|| while link.poll_transmit(&mut frame, none, events).is_some() {});
            if let Some(next) = blocks.dequeue() {
                let envelope = Envelope { sequence: n, message: DeviceMessage::Samples(next.clone()) };
                block.take(|| encode(&envelope, &mut frame)).ok()?;
                taken.enqueue(next).ok()?;
                all.take(|| link.poll_transmit(&mut frame, taken, events));
            }
        }
        // Then the host asks for all of it again. Nothing else is sent, so that the line has room.
        let mut again = Meter::default();
        let ask = Command::BackFill { boot_id: settings.boot_id, first_tick: 0, ticks: 5_000 };
        let length = encode(&Envelope { sequence: 0, message: HostMessage::Command(ask) }, &mut command).ok()?;
        hearing.take(|| link.receive(&command[..length], requests));
        for _ in 0..2_000 {
            sampler.tick(0, 0, blocks, events, requests);
            while events.dequeue().is_some() {}
            link.keep_up(blocks);
            again.take(|| link.poll_transmit(&mut frame, none, events));
        }
        // Then something else than a sine, told once a second.
        let sweep = swept();
        let [six, excite] = excited(
            (&mut sampler, &mut pacer, &mut clock, &mut link),
            (&mut *blocks, &mut *events, &mut *requests),
            [4_000, 980],
            |n| match n {
                // Nobody was heard meanwhile: it is disarmed.
                500 => Command::Arm,
                _ => n.checked_sub(980).and_then(|i| sweep.commands().get(i).copied()).unwrap_or(Command::KeepAlive),
            },
        )?;
        (*sampler.shaker().excitation() == sweep && sampler.shaker().moving()).then_some(())?;
        // Then a table of as many points as there may be.
        let points: [i16; 256] = core::array::from_fn(|j| 100 * (j as i16 - 128).abs());
        let points = Table::of(&points)?;
        let named = Excitation { table: points.known().name, ..Excitation::sine(1_000, 1_900) };
        let say = points.parts().map(Command::Prepare).chain(named.commands());
        let [table, bring] = excited(
            (&mut sampler, &mut pacer, &mut clock, &mut link),
            (blocks, events, requests),
            [3_000, 200],
            |n| match n {
                0 => Command::Stop,
                _ => n.checked_sub(200).and_then(|i| say.clone().nth(i)).unwrap_or(Command::KeepAlive),
            },
        )?;
        (*sampler.shaker().excitation() == named && sampler.shaker().moving()).then_some(())?;
        table.tell("a table: the interrupt");
        bring.tell("a table: a command");
        six.tell("six sines: the interrupt");
        excite.tell("six sines: a command");
        sampling.tell("interrupt: sampling, shaker with its points, blocks, one command");
        keeping.tell("interrupt: what lasts over a reset");
        block.tell("stream: the frame of a block, every ten ticks");
        again.tell("stream: a block that is sent again");
        other.tell("stream: other frames of a tick, estimates too");
        hearing.tell("thread: one command");
        all.tell("thread: all of a block, ten samples' estimate too");
        Some(())
    }

    /// The device's own estimate, by what a sample does beside the sums: nothing, a comparison, a
    /// fit, or the last step.
    fn estimate() -> Option<()> {
        static ESTIMATOR: ConstStaticCell<Estimator> = ConstStaticCell::new(Estimator::IDLE);
        let estimator = ESTIMATOR.take();
        estimator.set_up(&Settings::default()).then_some(())?;
        let (mut sample, mut with_window) = (Meter::default(), Meter::default());
        let increment = 42_949_673_u32;
        for n in 0..8_010_u32 {
            let counts = [displacement(900, n.wrapping_mul(31_415_926)), (n as i32 * 37) + displacement(700, n << 25)];
            let mut meter = Meter::default();
            meter.take(|| estimator.sample(n, counts, n.wrapping_mul(increment), increment, 1));
            if n > 2_010 {
                // The steps of a window come with the samples behind it.
                let behind = (n + 1_000 - 8) % 1_000;
                sample.add(&meter);
                if behind <= STEPS as u32 {
                    with_window.add(&meter);
                }
            }
        }
        sample.tell("estimate: a sample");
        with_window.tell("those that finish a window among them");
        let mut rows = Meter::default();
        for m in 0..=FREQUENCIES {
            rows.take(|| estimator.rows_at(black_box(m)));
        }
        rows.tell("rows of one frequency");
        Some(())
    }

    /// Least squares alone: a row into the greater of both fits, and its solution.
    fn least_squares() -> Option<()> {
        let mut fit = LeastSquares::<f32, UNKNOWNS1>::new();
        let (mut push, mut solve) = (Meter::default(), Meter::default());
        let mut state = 1_u32;
        for _ in 0..200 {
            let mut noise = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f32::from((state >> 16) as i16) / 32_768.0
            };
            let row = [noise(), noise(), noise(), noise(), noise(), noise()];
            let target = noise();
            push.take(|| fit.push(black_box(row), target));
        }
        for _ in 0..10 {
            solve.take(|| fit.solve(1e-3)).ok()?;
        }
        push.tell("least squares of six unknowns: a row");
        solve.tell("least squares of six unknowns: the solution");
        Some(())
    }

    fn accumulate() -> Option<()> {
        let settings = HarmonicSettings::of_frequency(5_000, 500_000, 20, 2_000, Window::SinFourth)?;
        let mut bank = HarmonicBank::<f32, 2, 64>::new(settings);
        let mut meter = Meter::default();
        for n in 0..2_000_u16 {
            let x = f32::from(n);
            meter.take(|| bank.push([x, -x]));
        }
        meter.tell("64 harmonics of two signals");
        Some(())
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        stack::paint();
        machine::start_clock();
        let done = tick().and_then(|()| accumulate()).and_then(|()| estimate()).and_then(|()| least_squares());
        // As above.
        let _ = writeln!(Console, "stack: {} bytes", stack::used());
        exit(done.is_some())
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("whirl-measure-mps2-an386 is firmware: build it with --target thumbv7em-none-eabihf");
    std::process::exit(2);
}

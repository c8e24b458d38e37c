//! Instructions of each part of a tick, by the emulator's instruction count (`-icount shift=5`: 32 ns each; the clock's
//! steps are 40 ns, so that a single figure is good to 2 instructions).
//!
//! Worst case: both arms whirl at 10 turns a second, the shaker runs, every block is sent, a command comes each tick.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod on_target {
    use core::convert::Infallible;
    use core::fmt::Write;
    use core::hint::black_box;
    use core::panic::PanicInfo;

    use heapless::spsc::Queue;
    use whirl_board_mps2_an386::machine::{self, Vector};
    use whirl_board_mps2_an386::semihosting::{Console, exit};
    use whirl_board_mps2_an386::stack;
    use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
    use whirl_firmware::estimate::Estimator;
    use whirl_firmware::event::{Event, Request};
    use whirl_firmware::link::Link;
    use whirl_firmware::sampler::Sampler;
    use whirl_firmware::{QuadratureCounter, Settings, ShakerOutput};
    use whirl_shared::codec::{MAX_FRAME, encode};
    use whirl_shared::frame::{Command, Envelope, HostMessage, SampleBlock};
    use whirl_shared::harmonics::{HarmonicBank, HarmonicSettings, Window};
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

    /// Instructions of the measured part: count, sum, most.
    #[derive(Default)]
    struct Meter {
        times: u32,
        sum: u64,
        most: u32,
    }

    impl Meter {
        fn take<T>(&mut self, part: impl FnOnce() -> T) -> T {
            let empty = {
                let start = machine::clock();
                machine::clock().wrapping_sub(start)
            };
            let start = machine::clock();
            let result = black_box(part());
            let clocks = machine::clock().wrapping_sub(start).saturating_sub(empty);
            self.times += 1;
            self.sum += u64::from(clocks);
            self.most = self.most.max(clocks);
            result
        }

        fn add(&mut self, other: &Self) {
            self.times += other.times;
            self.sum += other.sum;
            self.most = self.most.max(other.most);
        }

        fn tell(&self, name: &str) {
            // 40 ns a clock, 32 ns an instruction.
            let mean = self.sum * 5 / (4 * u64::from(self.times.max(1)));
            // The console is the emulator's own; it does not fail.
            let _ = writeln!(Console, "{name}: mean {mean} most {}", u64::from(self.most) * 5 / 4);
        }
    }

    /// Turns steadily.
    struct Whirling(u16, u16);

    impl QuadratureCounter for Whirling {
        fn count(&mut self) -> u16 {
            self.0 = self.0.wrapping_add(self.1);
            self.0
        }
    }

    struct Nowhere(i32);

    impl ShakerOutput for Nowhere {
        type Error = Infallible;

        fn write(&mut self, displacement_nanometre: i32) -> Result<(), Infallible> {
            self.0 = black_box(displacement_nanometre);
            Ok(())
        }
    }

    fn tick() -> Option<()> {
        let settings = Settings { board: "measure", ..Settings::default() };
        // Ten turns a second of 4096 counts at 500 Hz.
        let mut sampler = Sampler::new(&settings, Whirling(0, 82), Whirling(0, 65_454), Nowhere(0)).ok()?;
        let mut link = Link::new(&settings).ok()?;
        let mut blocks = Queue::<SampleBlock, BLOCKS>::new();
        let mut events = Queue::<Event, EVENTS>::new();
        let mut requests = Queue::<Request, REQUESTS>::new();
        let (mut sampling, mut sending, mut hearing) = (Meter::default(), Meter::default(), Meter::default());
        let (mut frame, mut command) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        for n in 0..5_000_u16 {
            let say = match n {
                1 => Command::Arm,
                2 => Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_000 },
                _ => Command::KeepAlive,
            };
            let envelope = Envelope { sequence: n, message: HostMessage::Command(say) };
            let length = encode(&envelope, &mut command).ok()?;
            hearing.take(|| link.receive(&command[..length], &mut requests));
            sampling.take(|| sampler.tick(0, 0, &mut blocks, &mut events, &mut requests));
            sending.take(|| while link.poll_transmit(&mut frame, &mut blocks, &mut events).is_some() {});
        }
        sampling.tell("interrupt: sampling, shaker, blocks, one command");
        sending.tell("thread: frames of a tick");
        hearing.tell("thread: one command");
        Some(())
    }

    /// The device's own estimate: a sample of two overlapping windows, and the end of a window.
    fn estimate() -> Option<()> {
        let mut estimator = Estimator::new(&Settings::default(), 0.9)?;
        let (mut sample, mut window) = (Meter::default(), Meter::default());
        let increment = 42_949_673_u32;
        for n in 0..4_100_u32 {
            let counts = [displacement(900, n.wrapping_mul(31_415_926)), (n as i32 * 37) + displacement(700, n << 25)];
            let mut meter = Meter::default();
            let outcome = meter.take(|| estimator.sample(n, counts, n.wrapping_mul(increment), increment));
            if n > 2_010 && outcome.is_none() {
                sample.add(&meter);
            } else if outcome.is_some() {
                window.add(&meter);
            }
        }
        sample.tell("estimate: a sample");
        window.tell("end of a window, each 1 000 ticks, in the thread: worst");
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
        let done = tick().and_then(|()| accumulate()).and_then(|()| estimate());
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

//! Interrupt and thread.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m::interrupt::Mutex;
use embassy_executor::Spawner;
use embassy_futures::select::{Either, select};
use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::mode::Async;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{IWDG, TIM6};
use embassy_stm32::timer::low_level::Timer as TickTimer;
use embassy_stm32::usart::{RingBufferedUartRx, Uart, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;
use heapless::spsc::{Consumer, Producer, Queue};
use rtt_target::{ChannelMode, DownChannel, UpChannel};
use static_cell::{ConstStaticCell, StaticCell};
use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
use whirl_firmware::dac::DacShaker;
use whirl_firmware::estimate::Estimator;
use whirl_firmware::event::{Event, Request};
use whirl_firmware::link::Link;
use whirl_firmware::pacing::{Pacer, divide};
use whirl_firmware::sampler::Sampler;
use whirl_firmware::settings::Settings;
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::SampleBlock;

use crate::board;
use crate::boot;
use crate::hardware::{Dac, Encoder1, Encoder2};

/// Displacement of the base at the highest voltage, nm: the limit of the settings and a quarter. To be made true by the gain
/// of the shaker's amplifier.
const FULL_SCALE_NANOMETRE: u32 = 25_000_000;
/// The serial port's bytes that wait for the thread: 22 ms of them.
const RECEIVE_RING: usize = 256;
/// RTT's buffers: a second of the stream, several commands.
const RTT_UP: usize = 4_608;
const RTT_DOWN: usize = 256;
const RTT_MESSAGES: usize = 1_024;

/// What the interrupt owns.
struct Interrupt {
    sampler: Sampler<Encoder1, Encoder2, DacShaker<Dac, Output<'static>>>,
    blocks: Producer<'static, SampleBlock>,
    events: Producer<'static, Event>,
    requests: Consumer<'static, Request>,
    pacer: Pacer,
    /// Processor's clocks for each step of the tick's timer.
    clocks_per_count: u32,
    clocks_per_microsecond: u32,
}

static INTERRUPT: Mutex<RefCell<Option<Interrupt>>> = Mutex::new(RefCell::new(None));
/// Interrupts so far: what the watchdog is petted for.
static TICKS: AtomicU32 = AtomicU32::new(0);

#[embassy_stm32::interrupt]
fn TIM6_DAC() {
    // Since the tick: the timer counts on from its update.
    let counted = u32::from(pac::TIM6.cnt().read().cnt());
    let now = cortex_m::peripheral::DWT::cycle_count();
    pac::TIM6.sr().write(|w| w.set_uif(false));
    cortex_m::interrupt::free(|section| {
        if let Some(i) = INTERRUPT.borrow(section).borrow_mut().as_mut() {
            let latency = counted * i.clocks_per_count;
            let missed = i.pacer.interrupt(now, latency);
            // The counters are the first thing that this reads.
            i.sampler.tick(missed, latency / i.clocks_per_microsecond, &mut i.blocks, &mut i.events, &mut i.requests);
        }
    });
    TICKS.store(TICKS.load(Relaxed).wrapping_add(1), Relaxed);
}

/// What the thread owns.
struct Thread {
    link: Link<&'static mut Estimator>,
    blocks: Consumer<'static, SampleBlock>,
    events: Consumer<'static, Event>,
    requests: Producer<'static, Request>,
    to_host: UartTx<'static, Async>,
    from_host: RingBufferedUartRx<'static>,
    rtt: (UpChannel, DownChannel),
    watchdog: IndependentWatchdog<'static, IWDG>,
    petted_at: u32,
}

impl Thread {
    async fn run(mut self) -> ! {
        self.watchdog.unleash();
        let mut bytes = [0; 64];
        let mut frame = [0; MAX_FRAME];
        loop {
            self.pet();
            match select(self.from_host.read(&mut bytes), Timer::after_millis(1)).await {
                Either::First(Ok(n)) => self.link.receive(&bytes[..n], &mut self.requests),
                // What is lost is a damaged frame, which the link counts.
                Either::First(Err(error)) => defmt::debug!("serial port: {}", error),
                Either::Second(()) => {}
            }
            let n = self.rtt.1.read(&mut bytes);
            self.link.receive(&bytes[..n], &mut self.requests);
            while let Some(n) = self.link.poll_transmit(&mut frame, &mut self.blocks, &mut self.events) {
                // Nobody may be listening here; a channel that is full drops the whole frame, which its numbers show.
                self.rtt.0.write(&frame[..n]);
                if let Err(error) = self.to_host.write(&frame[..n]).await {
                    defmt::warn!("serial port: {}", error);
                }
                self.pet();
            }
        }
    }

    /// Only as long as the tick goes on, too.
    fn pet(&mut self) {
        let ticks = TICKS.load(Relaxed);
        if ticks != self.petted_at {
            self.petted_at = ticks;
            self.watchdog.pet();
        }
    }
}

fn settings() -> Settings {
    Settings { board: board::NAME, build: env!("WHIRL_BUILD_ID"), boot_id: boot::id(), ..Settings::default() }
}

/// Starts the tick; clocks of a period, for each step of the timer, for each microsecond.
fn start(timer: &TickTimer<'static, TIM6>, rate_millihertz: u32) -> Option<[u32; 3]> {
    let timer_hz = timer.get_clock_frequency().0;
    let per_tick = u64::from(timer_hz) * 1_000 / u64::from(rate_millihertz);
    let (prescaler, reload) = divide(u32::try_from(per_tick).ok()?)?;
    let registers = pac::TIM6;
    registers.psc().write_value(prescaler);
    registers.arr().write(|w| w.set_arr(reload));
    timer.generate_update_event();
    timer.clear_update_interrupt();
    timer.enable_update_interrupt(true);
    // The processor's clock, by which missed ticks are counted, is a multiple of the timer's.
    let processor_hz = embassy_stm32::rcc::frequency::<embassy_stm32::peripherals::DMA1>().0;
    let ratio = processor_hz / timer_hz;
    let per_count = (u32::from(prescaler) + 1) * ratio;
    Some([per_count * (u32::from(reload) + 1), per_count, processor_hz / 1_000_000])
}

fn assemble(parts: board::Parts, rtt: (UpChannel, DownChannel)) -> Option<Thread> {
    static ESTIMATOR: ConstStaticCell<Estimator> = ConstStaticCell::new(Estimator::IDLE);
    static QUEUE_BLOCKS: StaticCell<Queue<SampleBlock, BLOCKS>> = StaticCell::new();
    static QUEUE_EVENTS: StaticCell<Queue<Event, EVENTS>> = StaticCell::new();
    static QUEUE_REQUESTS: StaticCell<Queue<Request, REQUESTS>> = StaticCell::new();
    static RING: StaticCell<[u8; RECEIVE_RING]> = StaticCell::new();
    static TIMER: StaticCell<TickTimer<'static, TIM6>> = StaticCell::new();
    let (blocks_in, blocks) = QUEUE_BLOCKS.init(Queue::new()).split();
    let (events_in, events) = QUEUE_EVENTS.init(Queue::new()).split();
    let (requests, requests_out) = QUEUE_REQUESTS.init(Queue::new()).split();
    let settings = settings();
    let output = DacShaker::new(parts.dac, parts.enable, FULL_SCALE_NANOMETRE);
    let sampler = Sampler::new(&settings, parts.encoder1, parts.encoder2, output).ok()?;
    let link = Link::with(&settings, ESTIMATOR.take()).ok()?;
    let timer = TIMER.init(parts.timer);
    let [period, clocks_per_count, clocks_per_microsecond] = start(timer, settings.sample_rate_millihertz)?;
    let interrupt = Interrupt {
        sampler,
        blocks: blocks_in,
        events: events_in,
        requests: requests_out,
        pacer: Pacer::new(period),
        clocks_per_count,
        clocks_per_microsecond,
    };
    cortex_m::interrupt::free(|section| INTERRUPT.borrow(section).replace(Some(interrupt)));
    // SAFETY: the interrupt's handler and all that it uses are there, and no critical section of ours is open.
    unsafe { interrupt::TIM6_DAC.enable() };
    timer.start();
    defmt::info!("{=str}, build {=str}, boot {=u32:08x}", settings.board, settings.build, settings.boot_id);
    let (to_host, from_host) = split(parts.uart, RING.init([0; RECEIVE_RING]));
    let watchdog = parts.watchdog;
    Some(Thread { link, blocks, events, requests, to_host, from_host, rtt, watchdog, petted_at: 0 })
}

fn split(uart: Uart<'static, Async>, ring: &'static mut [u8]) -> (UartTx<'static, Async>, RingBufferedUartRx<'static>) {
    let (to_host, from_host) = uart.split();
    (to_host, from_host.into_ring_buffered(ring))
}

/// RTT: messages on channel 0, the product's stream on channel 1, the host's bytes on channel 0 down.
fn rtt() -> (UpChannel, DownChannel) {
    let channels = rtt_target::rtt_init! {
        up: {
            0: { size: RTT_MESSAGES, mode: ChannelMode::NoBlockSkip, name: "defmt" }
            1: { size: RTT_UP, mode: ChannelMode::NoBlockSkip, name: "whirl" }
        }
        down: {
            0: { size: RTT_DOWN, mode: ChannelMode::NoBlockSkip, name: "whirl" }
        }
    };
    rtt_target::set_defmt_channel(channels.up.0);
    (channels.up.1, channels.down.0)
}

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let rtt = rtt();
    let Some(parts) = board::init() else { panic!("the serial port refuses its settings") };
    // The free clock.
    let mut core = cortex_m::Peripherals::take().unwrap_or_else(|| panic!("the core's peripherals are taken"));
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    let Some(thread) = assemble(parts, rtt) else { panic!("the settings are not possible on this board") };
    thread.run().await
}

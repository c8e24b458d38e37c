//! Interrupt and thread.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m::interrupt::Mutex;
use embassy_executor::Spawner;
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::gpio::{Input, Output};
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::mode::Async;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{IWDG, TIM5, TIM6, TIM7};
use embassy_stm32::timer::low_level::Timer as TickTimer;
use embassy_stm32::usart::{RingBufferedUartRx, Uart, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;
use heapless::spsc::{Consumer, Producer, Queue};
use rtt_target::{ChannelMode, DownChannel, UpChannel};
use static_cell::{ConstStaticCell, StaticCell};
use whirl_board_lasting as lasting;
use whirl_firmware::WithBase;
use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
use whirl_firmware::dac::DacShaker;
use whirl_firmware::estimate::Estimator;
use whirl_firmware::event::{Event, Request};
use whirl_firmware::history::KEPT;
use whirl_firmware::lines::WithLines;
use whirl_firmware::link::Link;
use whirl_firmware::pacing::{Pacer, Passed, Schedule};
use whirl_firmware::player::Player;
use whirl_firmware::sampler::Sampler;
use whirl_firmware::store::Store;
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::SampleBlock;

use crate::base_input::Base;
use crate::board;
use crate::fault::passing_over_torn_words;
use crate::hardware::{Encoder1, Encoder2};
use crate::player::Registers;

/// The serial port's bytes that wait for the thread: 22 ms of them.
const RECEIVE_RING: usize = 256;
/// RTT's buffers: a second of the stream, several commands.
const RTT_UP: usize = 4_608;
const RTT_DOWN: usize = 256;
const RTT_MESSAGES: usize = 1_024;

/// The shaker, its emergency stop and its trigger.
type Shaker = WithLines<DacShaker<Player<Registers>, Output<'static>>, Input<'static>, Input<'static>, Output<'static>>;

/// What the interrupt owns.
struct Interrupt {
    sampler: Sampler<WithBase<(Encoder1, Encoder2), Base>, Shaker>,
    light: Output<'static>,
    blocks: Producer<'static, SampleBlock>,
    events: Producer<'static, Event>,
    requests: Consumer<'static, Request>,
    pacer: Pacer,
    counts_per_second: u32,
    ticks: u32,
}

static INTERRUPT: Mutex<RefCell<Option<Interrupt>>> = Mutex::new(RefCell::new(None));
/// Interrupts so far: what the watchdog is petted for.
static TICKS: AtomicU32 = AtomicU32::new(0);

/// The free clock, which goes on in a debugger's halt as the tick's timer does.
fn clock() -> u32 {
    pac::TIM5.cnt().read()
}

#[embassy_stm32::interrupt]
fn TIM6_DAC() {
    pac::TIM6.sr().write(|w| w.set_uif(false));
    cortex_m::interrupt::free(|section| {
        if let Some(interrupt) = INTERRUPT.borrow(section).borrow_mut().as_mut() {
            interrupt.run();
        }
    });
}

impl Interrupt {
    fn run(&mut self) {
        let told = self.pacer.latch(clock, || self.sampler.latch());
        // An interrupt whose tick has been told with the one before is none.
        let Some(Passed { missed, latency }) = told else { return };
        let latency_us = (u64::from(latency) * 1_000_000 / u64::from(self.counts_per_second)) as u32;
        self.sampler.tick(missed, latency_us, &mut self.blocks, &mut self.events, &mut self.requests);
        self.light.set_level(self.sampler.light().into());
        self.ticks = self.ticks.wrapping_add(1);
        lasting::keep(self.ticks, &self.sampler.kept());
        TICKS.store(self.ticks, Relaxed);
    }
}

/// What the thread owns.
struct Thread {
    link: Link<&'static mut Estimator, &'static mut [u8]>,
    blocks: Consumer<'static, SampleBlock>,
    events: Consumer<'static, Event>,
    requests: Producer<'static, Request>,
    to_host: UartTx<'static, Async>,
    heard: Consumer<'static, u8>,
    rtt: (UpChannel, DownChannel),
    store: Store<Flash<'static, Blocking>>,
    watchdog: IndependentWatchdog<'static, IWDG>,
    petted_at: u32,
}

/// Takes the serial port's bytes. A task of its own, so that no read is given up half-way: bytes
/// that come while one is would be lost.
#[embassy_executor::task]
async fn hear(mut from_host: RingBufferedUartRx<'static>, mut heard: Producer<'static, u8>) -> ! {
    let mut bytes = [0; 64];
    loop {
        match from_host.read(&mut bytes).await {
            Ok(n) => {
                for &byte in &bytes[..n] {
                    // What finds no room is a damaged frame, which the link counts.
                    let _ = heard.enqueue(byte);
                }
            }
            Err(error) => {
                defmt::debug!("serial port: {}", error);
                // A line that errs without end must not starve the thread, which pets the watchdog.
                Timer::after_micros(100).await;
            }
        }
    }
}

impl Thread {
    async fn run(mut self) -> ! {
        let mut bytes = [0; 64];
        let mut frame = [0; MAX_FRAME];
        loop {
            self.pet();
            Timer::after_millis(1).await;
            while let Some(byte) = self.heard.dequeue() {
                self.link.receive(&[byte], &mut self.requests);
            }
            let n = self.rtt.1.read(&mut bytes);
            self.link.receive(&bytes[..n], &mut self.requests);
            while let Some(n) = self.link.poll_transmit(&mut frame, &mut self.blocks, &mut self.events) {
                // Nobody may be listening here; a channel that is full drops the whole frame, which
                // its numbers show.
                self.rtt.0.write(&frame[..n]);
                if let Err(error) = self.to_host.write(&frame[..n]).await {
                    defmt::warn!("serial port: {}", error);
                }
                self.pet();
            }
            self.keep();
            if self.link.restart_due() {
                // The last answer is on its way.
                Timer::after_millis(20).await;
                cortex_m::peripheral::SCB::sys_reset();
            }
        }
    }

    /// Keeps settings that were changed.
    fn keep(&mut self) {
        let Some(words) = self.link.settings_to_keep() else { return };
        board::watch_longer(true);
        let kept = passing_over_torn_words(|| self.store.save(&words));
        board::watch_longer(false);
        if let Err(error) = kept {
            defmt::error!("settings were not kept: {}", error);
        }
        self.link.kept(kept.is_ok());
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

/// Starts the free clock, the tick and the points, in this order; what the free clock showed when
/// the tick began.
fn start(
    parts: &(TickTimer<'static, TIM5>, TickTimer<'static, TIM6>, TickTimer<'static, TIM7>),
    with: Schedule,
) -> u32 {
    let (free, tick, _points) = parts;
    pac::TIM5.psc().write_value(with.prescaler);
    pac::TIM5.arr().write_value(u32::MAX);
    pac::TIM6.psc().write_value(with.prescaler);
    pac::TIM6.arr().write(|w| w.set_arr(with.reload));
    free.generate_update_event();
    tick.generate_update_event();
    tick.clear_update_interrupt();
    tick.enable_update_interrupt(true);
    cortex_m::interrupt::free(|_| {
        free.start();
        let began = clock();
        tick.start();
        Registers::begin();
        began
    })
}

fn assemble(
    parts: board::Parts,
    rtt: (UpChannel, DownChannel),
    watchdog: IndependentWatchdog<'static, IWDG>,
) -> Option<(Thread, RingBufferedUartRx<'static>, Producer<'static, u8>)> {
    static ESTIMATOR: ConstStaticCell<Estimator> = ConstStaticCell::new(Estimator::IDLE);
    static MEMORY: ConstStaticCell<[u8; KEPT]> = ConstStaticCell::new([0; KEPT]);
    static QUEUE_BLOCKS: StaticCell<Queue<SampleBlock, BLOCKS>> = StaticCell::new();
    static QUEUE_EVENTS: StaticCell<Queue<Event, EVENTS>> = StaticCell::new();
    static QUEUE_REQUESTS: StaticCell<Queue<Request, REQUESTS>> = StaticCell::new();
    static QUEUE_HEARD: StaticCell<Queue<u8, RECEIVE_RING>> = StaticCell::new();
    static RING: StaticCell<[u8; RECEIVE_RING]> = StaticCell::new();
    static TIMERS: StaticCell<(TickTimer<'static, TIM5>, TickTimer<'static, TIM6>, TickTimer<'static, TIM7>)> =
        StaticCell::new();
    let (blocks_in, blocks) = QUEUE_BLOCKS.init(Queue::new()).split();
    let (events_in, events) = QUEUE_EVENTS.init(Queue::new()).split();
    let (requests, requests_out) = QUEUE_REQUESTS.init(Queue::new()).split();
    let (heard_in, heard) = QUEUE_HEARD.init(Queue::new()).split();
    let [settings, built_in] = &parts.settings;
    // Validated: at most 2³¹ nm.
    let output = DacShaker::new(parts.player, parts.enable, settings.full_scale_micrometre.saturating_mul(1_000));
    let output = WithLines::new(output, parts.lines);
    let inputs = WithBase { encoders: (parts.encoder1, parts.encoder2), base: parts.base };
    let mut sampler = Sampler::new(settings, inputs, output).ok()?;
    sampler.set_built_in(built_in);
    let memory: &mut [u8] = MEMORY.take();
    let link = Link::with(settings, ESTIMATOR.take(), memory).ok()?;
    let period = parts.schedule.period();
    defmt::info!("{=str}, build {=str}, boot {=u32:08x}", settings.board, settings.build, settings.boot_id);
    defmt::info!("reset by {}", settings.boot.reset);
    let timers = TIMERS.init((parts.clock, parts.timer, parts.points));
    let began = start(timers, parts.schedule);
    let interrupt = Interrupt {
        sampler,
        light: parts.light,
        blocks: blocks_in,
        events: events_in,
        requests: requests_out,
        pacer: Pacer::new(period, began),
        counts_per_second: (u64::from(period) * u64::from(settings.sample_rate_millihertz) / 1_000) as u32,
        ticks: 0,
    };
    cortex_m::interrupt::free(|section| INTERRUPT.borrow(section).replace(Some(interrupt)));
    // SAFETY: the interrupt's handler and all that it uses are there, and no critical section of
    // ours is open.
    unsafe { interrupt::TIM6_DAC.enable() };
    let (to_host, from_host) = split(parts.uart, RING.init([0; RECEIVE_RING]));
    let store = parts.store;
    let thread = Thread { link, blocks, events, requests, to_host, heard, rtt, store, watchdog, petted_at: 0 };
    Some((thread, from_host, heard_in))
}

fn split(uart: Uart<'static, Async>, ring: &'static mut [u8]) -> (UartTx<'static, Async>, RingBufferedUartRx<'static>) {
    let (to_host, from_host) = uart.split();
    (to_host, from_host.into_ring_buffered(ring))
}

/// RTT: messages on channel 0, the product's stream on channel 1, the host's bytes on channel 0
/// down.
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
async fn main(spawner: Spawner) {
    // Before anything that may wait.
    let watchdog = board::watch();
    let rtt = rtt();
    let Some(parts) = board::init() else { panic!("the serial port or a timer refuses the image's own settings") };
    let Some((thread, from_host, heard)) = assemble(parts, rtt, watchdog) else {
        panic!("the settings are not possible on this board")
    };
    match hear(from_host, heard) {
        Ok(task) => spawner.spawn(task),
        Err(_) => panic!("no room for the task that hears the serial port"),
    }
    thread.run().await
}

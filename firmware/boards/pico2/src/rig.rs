//! Interrupt and thread.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m::interrupt::Mutex;
use embassy_executor::Spawner;
use embassy_rp::gpio::{Input, Output};
use embassy_rp::interrupt::{self, InterruptExt};
use embassy_time::Timer;
use heapless::spsc::{Consumer, Producer, Queue};
use rtt_target::{ChannelMode, DownChannel, UpChannel};
use static_cell::{ConstStaticCell, StaticCell};
use whirl_board_lasting as lasting;
use whirl_board_pico2::player::microseconds;
use whirl_firmware::WithBase;
use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
use whirl_firmware::dac::DacShaker;
use whirl_firmware::estimate::Estimator;
use whirl_firmware::event::{Event, Request};
use whirl_firmware::lines::WithLines;
use whirl_firmware::link::Link;
use whirl_firmware::pacing::{Pacer, Passed};
use whirl_firmware::player::Player;
use whirl_firmware::sampler::Sampler;
use whirl_firmware::store::Store;
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::frame::SampleBlock;

use crate::base_input::Base;
use crate::board::{self, Dog, SettingsFlash};
use crate::hardware::{Decoder, Registers};
use crate::usb::{self, Port};

/// RTT's buffers: a second of the stream, several commands.
const RTT_UP: usize = 4_608;
const RTT_DOWN: usize = 256;
const RTT_MESSAGES: usize = 1_024;

/// Bytes of blocks that are kept for the host to ask for again: 75 s of samples at 500 Hz, half of
/// the memory.
const KEPT: usize = 256_000;

/// Both encoders and the base's sensor.
type Sensors = WithBase<(Decoder<0>, Decoder<1>), Base>;
/// The player of waveforms behind its enable line, its emergency stop and its trigger.
type Drive = WithLines<DacShaker<Player<Registers>, Output<'static>>, Input<'static>, Input<'static>, Output<'static>>;

/// What the interrupt owns.
struct Interrupt {
    sampler: Sampler<Sensors, Drive>,
    light: Output<'static>,
    blocks: Producer<'static, SampleBlock>,
    events: Producer<'static, Event>,
    requests: Consumer<'static, Request>,
    pacer: Pacer,
    ticks: u32,
}

static INTERRUPT: Mutex<RefCell<Option<Interrupt>>> = Mutex::new(RefCell::new(None));
/// Interrupts so far: what the watchdog is petted for.
static TICKS: AtomicU32 = AtomicU32::new(0);

#[embassy_rp::interrupt]
fn PWM_IRQ_WRAP_0() {
    board::clear_tick();
    cortex_m::interrupt::free(|section| {
        if let Some(interrupt) = INTERRUPT.borrow(section).borrow_mut().as_mut() {
            interrupt.run();
        }
    });
}

impl Interrupt {
    fn run(&mut self) {
        let told = self.pacer.latch(board::clock, || self.sampler.latch());
        // An interrupt whose tick has been told with the one before is none. The clock counts
        // microseconds.
        let Some(Passed { missed, latency }) = told else { return };
        self.sampler.tick(missed, latency, &mut self.blocks, &mut self.events, &mut self.requests);
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
    port: Port,
    rtt: (UpChannel, DownChannel),
    store: Store<SettingsFlash>,
    dog: Dog,
    petted_at: u32,
}

impl Thread {
    async fn run(mut self) -> ! {
        let mut bytes = [0; 64];
        let mut frame = [0; MAX_FRAME];
        loop {
            self.pet();
            Timer::after_millis(1).await;
            while let Some(byte) = self.port.hear() {
                self.link.receive(&[byte], &mut self.requests);
            }
            let n = self.rtt.1.read(&mut bytes);
            self.link.receive(&bytes[..n], &mut self.requests);
            if !self.port.ready() {
                // An unplugged port takes nothing; what the host will ask for is kept meanwhile.
                self.link.keep_up(&mut self.blocks);
            }
            while self.port.ready()
                && let Some(n) = self.link.poll_transmit(&mut frame, &mut self.blocks, &mut self.events)
            {
                // Nobody may be listening here; a channel that is full drops the whole frame, which
                // its numbers show.
                self.rtt.0.write(&frame[..n]);
                self.port.send(&frame[..n]);
                self.pet();
            }
            self.keep();
            if self.link.restart_due() {
                // The last answer is on its way.
                Timer::after_millis(20).await;
                self.dog.restart();
            }
        }
    }

    /// Keeps settings that were changed. The processor stands meanwhile: its program is in the same
    /// flash.
    fn keep(&mut self) {
        let Some(words) = self.link.settings_to_keep() else { return };
        self.dog.wait_longer();
        let kept = self.store.save(&words);
        self.dog.pet();
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
            self.dog.pet();
        }
    }
}

fn assemble(parts: board::Parts, rtt: (UpChannel, DownChannel), dog: Dog, spawner: Spawner) -> Option<Thread> {
    static ESTIMATOR: ConstStaticCell<Estimator> = ConstStaticCell::new(Estimator::IDLE);
    static MEMORY: ConstStaticCell<[u8; KEPT]> = ConstStaticCell::new([0; KEPT]);
    static QUEUE_BLOCKS: StaticCell<Queue<SampleBlock, BLOCKS>> = StaticCell::new();
    static QUEUE_EVENTS: StaticCell<Queue<Event, EVENTS>> = StaticCell::new();
    static QUEUE_REQUESTS: StaticCell<Queue<Request, REQUESTS>> = StaticCell::new();
    let (blocks_in, blocks) = QUEUE_BLOCKS.init(Queue::new()).split();
    let (events_in, events) = QUEUE_EVENTS.init(Queue::new()).split();
    let (requests, requests_out) = QUEUE_REQUESTS.init(Queue::new()).split();
    let [settings, built_in] = &parts.settings;
    // Validated: at most 2³¹ nm.
    let output = DacShaker::new(parts.player, parts.enable, settings.full_scale_micrometre.saturating_mul(1_000));
    let output = WithLines::new(output, parts.lines);
    let inputs = WithBase { encoders: (parts.encoder1, parts.encoder2), base: parts.base };
    let mut sampler = Sampler::new(settings, inputs, output).ok()?;
    sampler.set_built_in(built_in);
    let memory: &mut [u8] = MEMORY.take();
    let link = Link::with(settings, ESTIMATOR.take(), memory).ok()?;
    defmt::info!("{=str}, build {=str}, boot {=u32:08x}", settings.board, settings.build, settings.boot_id);
    defmt::info!("reset by {}", settings.boot.reset);
    let port = usb::start(parts.usb, parts.serial, spawner)?;
    let interrupt = Interrupt {
        sampler,
        light: parts.light,
        blocks: blocks_in,
        events: events_in,
        requests: requests_out,
        pacer: Pacer::new(microseconds(&parts.schedule), board::start()),
        ticks: 0,
    };
    cortex_m::interrupt::free(|section| INTERRUPT.borrow(section).replace(Some(interrupt)));
    // SAFETY: the interrupt's handler and all that it uses are there, and no critical section of
    // ours is open.
    unsafe { interrupt::PWM_IRQ_WRAP_0.enable() };
    Some(Thread { link, blocks, events, requests, port, rtt, store: parts.store, dog, petted_at: 0 })
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
    let dog = Dog::watch();
    let rtt = rtt();
    let Some(parts) = board::init() else { panic!("the slices refuse the image's own settings") };
    match assemble(parts, rtt, dog, spawner) {
        Some(thread) => thread.run().await,
        None => panic!("the settings are not possible on this board"),
    }
}

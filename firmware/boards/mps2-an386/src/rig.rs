//! Interrupt and thread, as on a real board.

use core::cell::RefCell;
use core::fmt::Write;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use cortex_m::interrupt::Mutex;
use cortex_m::peripheral::{NVIC, SCB};
use heapless::spsc::{Consumer, Producer, Queue};
use static_cell::{ConstStaticCell, StaticCell};
use whirl_board_lasting as lasting;
use whirl_board_mps2_an386::flash::Pages;
use whirl_board_mps2_an386::machine::{self, CLOCK_HZ, Timer0, Vector};
use whirl_board_mps2_an386::{semihosting, stack};
use whirl_firmware::WithBase;
use whirl_firmware::app::{BLOCKS, EVENTS, REQUESTS};
use whirl_firmware::estimate::Estimator;
use whirl_firmware::event::{Event, Request};
use whirl_firmware::history::KEPT;
use whirl_firmware::link::Link;
use whirl_firmware::lock_step::{self, Order};
use whirl_firmware::pacing::{Pacer, Passed};
use whirl_firmware::sampler::Sampler;
use whirl_firmware::settings::{HOST_TIMEOUT_MAX_MS, Settings};
use whirl_shared::codec::MAX_FRAME;
use whirl_shared::excitation::{Form, TableName};
use whirl_shared::frame::{SampleBlock, SettingsSource};

use crate::fault;
use crate::plant::{self, Base, Counter, Output, Plant};

/// Bytes of the host that wait for the thread.
const HOST_QUEUE: usize = 512;

/// What the interrupt owns.
struct Interrupt {
    sampler: Sampler<WithBase<(Counter, Counter), Base>, Output>,
    plant: Plant,
    blocks: Producer<'static, SampleBlock>,
    events: Producer<'static, Event>,
    requests: Consumer<'static, Request>,
    host: Producer<'static, u8>,
    pacer: Pacer,
    /// Form and table that the plant has been told of.
    told: (Form, TableName),
    /// Least and greatest time from the tick by its own timer to the tick by the free clock.
    apart: [u32; 2],
    tick: u32,
}

static INTERRUPT: Mutex<RefCell<Option<Interrupt>>> = Mutex::new(RefCell::new(None));
static EXIT: AtomicBool = AtomicBool::new(false);
/// Interrupts so far.
static TICKS: AtomicU32 = AtomicU32::new(0);
/// Ticks for which the link takes nothing.
static BLOCKED: AtomicU32 = AtomicU32::new(0);

/// A message that panics while it is written.
struct Bomb;

impl core::fmt::Display for Bomb {
    fn fmt(&self, _: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        panic!("while it was written")
    }
}

/// The table behind the processor's own exceptions.
// SAFETY: the section and the name are those that cortex-m-rt wants for it.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Vector; 32] = machine::table(Timer0, tick);

/// TIMER0's interrupt: one sampling tick.
unsafe extern "C" fn tick() {
    // Before anything else: a latency of less than a microsecond is none.
    let now = machine::clock();
    machine::clear_tick();
    cortex_m::interrupt::free(|section| {
        if let Some(interrupt) = INTERRUPT.borrow(section).borrow_mut().as_mut() {
            interrupt.tick(now);
        }
    });
}

impl Interrupt {
    fn tick(&mut self, now: u32) {
        let since = machine::since_tick(self.pacer.period());
        let Some(Passed { missed, latency }) = self.pacer.interrupt(now) else { return };
        let apart = latency.wrapping_sub(since);
        self.apart = [self.apart[0].min(apart), self.apart[1].max(apart)];
        self.tick = self.tick.wrapping_add(missed);

        let drive = self.sampler.drive();
        let request = lock_step::Request {
            tick: self.tick,
            phase: drive.phase,
            phase_increment: drive.phase_increment,
            amplitude_nanometre: drive.amplitude_nanometre,
            ..lock_step::Request::default()
        };
        let shaker = self.sampler.shaker();
        let form = (shaker.excitation().form, shaker.excitation().table);
        let told = core::mem::replace(&mut self.told, form);
        let shape = (told != form).then(|| shaker.shape());
        let Some(reply) = self.plant.exchange(request, shape) else { panic!("the plant has gone") };
        let latency_us = latency / (CLOCK_HZ / 1_000_000);
        self.sampler.tick(missed, latency_us, &mut self.blocks, &mut self.events, &mut self.requests);
        self.tick = self.tick.wrapping_add(1);
        lasting::keep(self.tick, &self.sampler.kept());
        let blocked = BLOCKED.load(Relaxed);
        BLOCKED.store(blocked.saturating_sub(missed + 1), Relaxed);
        for &byte in &self.plant.host {
            // A test that sends more than the thread takes finds its commands unanswered.
            let _ = self.host.enqueue(byte);
        }
        TICKS.store(self.tick, Relaxed);
        self.obey(reply.order);
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::None => {}
            Order::Exit => {
                self.tell();
                EXIT.store(true, Relaxed);
                NVIC::mask(Timer0);
            }
            Order::Panic => panic!("ordered to"),
            Order::Reset(false) => SCB::sys_reset(),
            Order::Reset(true) => {
                fault::RESETS.store(true, Relaxed);
                panic!("ordered to, and to come back");
            }
            Order::PanicTwice(resets) => {
                fault::RESETS.store(resets, Relaxed);
                panic!("{}", Bomb);
            }
            Order::Stall(ticks) => {
                let start = machine::clock();
                let clocks = u32::from(ticks) * self.pacer.period();
                while machine::clock().wrapping_sub(start) < clocks {}
            }
            Order::BreakOutput => plant::break_output(),
            Order::BlockLink(ticks) => BLOCKED.store(u32::from(ticks), Relaxed),
        }
    }

    /// The account of a run, for people and tests.
    fn tell(&self) {
        let (early, late) = (0, self.apart[1].saturating_sub(self.apart[0]));
        // The console is the emulator's own; it does not fail.
        let _ = writeln!(
            semihosting::Console,
            "ticks {}\nperiod {} clocks, early {early} late {late}\nlatency {} clocks\nstack {} bytes\nstatics {} bytes",
            self.tick,
            self.pacer.period(),
            self.pacer.latency(),
            stack::used(),
            stack::statics(),
        );
    }
}

/// What the thread owns.
struct Thread {
    link: Link<&'static mut Estimator, &'static mut [u8]>,
    blocks: Consumer<'static, SampleBlock>,
    events: Consumer<'static, Event>,
    requests: Producer<'static, Request>,
    host: Consumer<'static, u8>,
}

impl Thread {
    /// Sends what waits, takes what has come.
    fn turn(&mut self) {
        let mut frame = [0; MAX_FRAME];
        if BLOCKED.load(Relaxed) > 0 {
            self.link.keep_up(&mut self.blocks);
        }
        while BLOCKED.load(Relaxed) == 0 {
            let Some(length) = self.link.poll_transmit(&mut frame, &mut self.blocks, &mut self.events) else { break };
            for &byte in &frame[..length] {
                while !machine::send(byte) {}
            }
        }
        while let Some(byte) = self.host.dequeue().or_else(machine::receive) {
            self.link.receive(&[byte], &mut self.requests);
        }
        if let Some(words) = self.link.settings_to_keep() {
            let kept = Pages::store().save(&words).is_ok();
            self.link.kept(kept);
        }
        if self.link.restart_due() {
            SCB::sys_reset();
        }
    }
}

/// The board's settings in force, and those of the image. The host may be as silent as it is
/// allowed to be: it lives by another clock.
fn settings() -> [Settings; 2] {
    // The machine has no flag that tells why it was reset.
    let boot = lasting::before(None);
    let boot_id = lasting::boot_number(boot.kept.is_none());
    let built_in = Settings {
        board: "mps2-an386",
        build: env!("WHIRL_BUILD_ID"),
        boot_id,
        host_timeout_ms: HOST_TIMEOUT_MAX_MS,
        boot,
        base_input: true,
        ..Settings::default()
    };
    let mut settings = built_in.clone();
    if let Some(words) = Pages::store().load() {
        settings = settings.with_words(&words).unwrap_or(settings);
        settings.boot.settings =
            if settings.to_words() == words { SettingsSource::Kept } else { SettingsSource::Refused };
    }
    [settings, built_in]
}

fn start() -> Option<Thread> {
    static ESTIMATOR: ConstStaticCell<Estimator> = ConstStaticCell::new(Estimator::IDLE);
    static MEMORY: ConstStaticCell<[u8; KEPT]> = ConstStaticCell::new([0; KEPT]);
    static QUEUE_BLOCKS: StaticCell<Queue<SampleBlock, BLOCKS>> = StaticCell::new();
    static QUEUE_EVENTS: StaticCell<Queue<Event, EVENTS>> = StaticCell::new();
    static QUEUE_REQUESTS: StaticCell<Queue<Request, REQUESTS>> = StaticCell::new();
    static QUEUE_HOST: StaticCell<Queue<u8, HOST_QUEUE>> = StaticCell::new();
    let (blocks_in, blocks) = QUEUE_BLOCKS.init(Queue::new()).split();
    let (events_in, events) = QUEUE_EVENTS.init(Queue::new()).split();
    let (requests, requests_out) = QUEUE_REQUESTS.init(Queue::new()).split();
    let (host_in, host) = QUEUE_HOST.init(Queue::new()).split();
    let [settings, built_in] = settings();
    let inputs = WithBase { encoders: (Counter(0), Counter(1)), base: Base };
    let mut sampler = Sampler::new(&settings, inputs, Output).ok()?;
    sampler.set_built_in(&built_in);
    let memory: &mut [u8] = MEMORY.take();
    let link = Link::with(&settings, ESTIMATOR.take(), memory).ok()?;
    let period = (u64::from(CLOCK_HZ) * 1_000 / u64::from(settings.sample_rate_millihertz)) as u32;
    machine::start_clock();
    let plant = Plant::open()?;
    machine::start_uart();
    // The tick starts some instructions later, so that its interrupt never comes before the clock's
    // tick.
    let start = machine::clock();
    machine::start_tick(period);
    let interrupt = Interrupt {
        sampler,
        plant,
        blocks: blocks_in,
        events: events_in,
        requests: requests_out,
        host: host_in,
        pacer: Pacer::new(period, start),
        told: (Form::SINE, TableName::NONE),
        apart: [u32::MAX, 0],
        tick: 0,
    };
    cortex_m::interrupt::free(|section| INTERRUPT.borrow(section).replace(Some(interrupt)));
    // SAFETY: the interrupt's handler and all that it uses are there, and no critical section of
    // ours is open.
    unsafe { NVIC::unmask(Timer0) };
    Some(Thread { link, blocks, events, requests, host })
}

#[cortex_m_rt::entry]
fn main() -> ! {
    stack::paint();
    let Some(mut thread) = start() else { panic!("no plant: the pipes to_plant and from_plant cannot be opened") };
    // A turn in each tick, as a real board's thread has one in each millisecond.
    let mut turned = None;
    while !EXIT.load(Relaxed) {
        let tick = Some(TICKS.load(Relaxed));
        if turned != tick {
            turned = tick;
            thread.turn();
        }
        cortex_m::asm::nop();
    }
    thread.turn();
    semihosting::exit(true)
}

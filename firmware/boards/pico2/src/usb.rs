//! The stream over USB: a serial port of its own (CDC-ACM).
//!
//! Where nobody has the port open, and so does not set DTR, frames are dropped whole, which their
//! numbers show. Where somebody has it open and does not read, they wait: blocks then wait in their
//! queue, which counts what it cannot take.

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embassy_executor::Spawner;
use embassy_futures::select::{Either, select};
use embassy_rp::peripherals::USB;
use embassy_rp::usb::Driver;
use embassy_time::Timer;
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::{Builder, Config, UsbDevice};
use heapless::String;
use heapless::spsc::{Consumer, Producer, Queue};
use static_cell::{ConstStaticCell, StaticCell};
use whirl_shared::codec::MAX_FRAME;

/// Bytes that wait: a second of the stream.
const TO_HOST: usize = 4_608;
const FROM_HOST: usize = 512;
/// A packet that is not full ends a transfer: the host has its bytes at once, and no empty packet
/// is needed.
const PACKET: usize = 63;
/// Raspberry Pi's own numbers for a serial port of its chips, as its SDK has them.
const VENDOR: u16 = 0x2e8a;
const PRODUCT: u16 = 0x000a;

/// Whether somebody has the port open.
static OPEN: AtomicBool = AtomicBool::new(false);

type Chip = Driver<'static, USB>;

/// The thread's end.
pub struct Port {
    to_host: Producer<'static, u8>,
    from_host: Consumer<'static, u8>,
}

impl Port {
    /// Whether the next frame can be taken, or dropped whole since nobody hears it.
    pub fn ready(&self) -> bool {
        !OPEN.load(Relaxed) || self.to_host.capacity() - self.to_host.len() >= MAX_FRAME
    }

    /// Sends a frame.
    pub fn send(&mut self, frame: &[u8]) {
        if OPEN.load(Relaxed) && self.to_host.capacity() - self.to_host.len() >= frame.len() {
            for &byte in frame {
                // There is room.
                let _ = self.to_host.enqueue(byte);
            }
        }
    }

    /// A byte that has come.
    pub fn hear(&mut self) -> Option<u8> {
        self.from_host.dequeue()
    }
}

#[embassy_executor::task]
async fn run(mut device: UsbDevice<'static, Chip>) -> ! {
    device.run().await
}

/// Until nobody has the port open any more.
async fn closed(control: &ControlChanged<'static>) {
    while control.dtr() {
        control.control_changed().await;
    }
}

#[embassy_executor::task]
async fn speak(
    mut sender: Sender<'static, Chip>,
    control: ControlChanged<'static>,
    mut waiting: Consumer<'static, u8>,
) -> ! {
    let mut packet = [0; PACKET];
    loop {
        Timer::after_millis(1).await;
        let open = control.dtr();
        OPEN.store(open, Relaxed);
        if !open {
            // Who opens the port finds nothing stale.
            while waiting.dequeue().is_some() {}
        }
        loop {
            let mut length = 0;
            for (place, byte) in packet.iter_mut().zip(core::iter::from_fn(|| waiting.dequeue())) {
                *place = byte;
                length += 1;
            }
            if length == 0 {
                break;
            }
            // Cut short where the port is closed or the plug is drawn: what waited is stale then.
            match select(sender.write_packet(&packet[..length]), closed(&control)).await {
                Either::First(Ok(())) => {}
                Either::First(Err(_)) | Either::Second(()) => {
                    OPEN.store(false, Relaxed);
                    while waiting.dequeue().is_some() {}
                }
            }
        }
    }
}

#[embassy_executor::task]
async fn hear(mut receiver: Receiver<'static, Chip>, mut heard: Producer<'static, u8>) -> ! {
    let mut packet = [0; 64];
    loop {
        receiver.wait_connection().await;
        while let Ok(length) = receiver.read_packet(&mut packet).await {
            for &byte in &packet[..length] {
                // What finds no room is a damaged frame, which the link counts.
                let _ = heard.enqueue(byte);
            }
        }
    }
}

/// Starts the port; none where a task finds no room.
pub fn start(driver: Chip, serial: String<16>, spawner: Spawner) -> Option<Port> {
    static SERIAL: StaticCell<String<16>> = StaticCell::new();
    // What does not fit ends in a panic at boot: a CDC port's are 83 and 12 bytes.
    static DESCRIPTORS: ConstStaticCell<([u8; 256], [u8; 64], [u8; 64])> =
        ConstStaticCell::new(([0; 256], [0; 64], [0; 64]));
    static STATE: StaticCell<State<'static>> = StaticCell::new();
    static QUEUE_TO: StaticCell<Queue<u8, TO_HOST>> = StaticCell::new();
    static QUEUE_FROM: StaticCell<Queue<u8, FROM_HOST>> = StaticCell::new();
    let mut config = Config::new(VENDOR, PRODUCT);
    config.manufacturer = Some("whirl");
    config.product = Some("whirl pico2");
    config.serial_number = Some(SERIAL.init(serial));
    // mA, with two encoders.
    config.max_power = 250;
    let (configuration, system, control) = DESCRIPTORS.take();
    let mut builder = Builder::new(driver, config, configuration, system, &mut [], control);
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), 64);
    let device = builder.build();
    let (sender, receiver, control) = class.split_with_control();
    let (to_host, waiting) = QUEUE_TO.init(Queue::new()).split();
    let (heard, from_host) = QUEUE_FROM.init(Queue::new()).split();
    spawner.spawn(run(device).ok()?);
    spawner.spawn(speak(sender, control, waiting).ok()?);
    spawner.spawn(hear(receiver, heard).ok()?);
    Some(Port { to_host, from_host })
}

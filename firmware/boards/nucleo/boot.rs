//! What came before this boot, and what lasts beyond it: an id, the cause of the reset, both counts, a panic's text.
//!
//! All of it is in memory that nothing initialises. After power-on it holds noise of its cells, and after a reset what was
//! there. Noise and the chip's number are hashed into the boot's id, which is left there, so that the next reset has
//! another one.

use core::mem::MaybeUninit;
use core::ptr::{addr_of_mut, read_volatile, write_volatile};

use embassy_stm32::pac;
use whirl_firmware::kept::{KEPT_LEN, Kept, NOTE_LEN, newest, read_note, to_bytes};
use whirl_firmware::settings::Boot;
use whirl_firmware::zero::keeps_memory;
use whirl_shared::frame::ResetCause;

/// Words of noise.
const WORDS: usize = 256;

#[unsafe(link_section = ".uninit.boot")]
static mut NOISE: MaybeUninit<[u32; WORDS]> = MaybeUninit::uninit();
#[unsafe(link_section = ".uninit.counts")]
static mut COUNTS: MaybeUninit<[[u8; KEPT_LEN]; 2]> = MaybeUninit::uninit();
#[unsafe(link_section = ".uninit.note")]
static mut NOTE: MaybeUninit<[u8; NOTE_LEN]> = MaybeUninit::uninit();

fn load<const N: usize>(from: *const u8) -> [u8; N] {
    // SAFETY: called with the statics above alone, of N bytes or more, which are there whatever they hold; nobody writes
    // meanwhile: at boot nothing else runs.
    core::array::from_fn(|i| unsafe { read_volatile(from.add(i)) })
}

fn store(to: *mut u8, bytes: &[u8]) {
    for (i, &byte) in bytes.iter().enumerate() {
        // SAFETY: called with the statics above alone and as many bytes as they have; each of them has one writer: the
        // tick's interrupt or, with interrupts off, a panic.
        unsafe { write_volatile(to.add(i), byte) };
    }
}

/// The id of this boot. To be called once, before anything else runs.
pub fn id() -> u32 {
    let noise = addr_of_mut!(NOISE).cast::<u32>();
    let mut hash = 0x811c_9dc5_u32;
    let mut take = |byte: u8| hash = (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
    for word in 0..WORDS {
        // SAFETY: within the array; it is memory that is there, whatever its content, and read by nobody else.
        let value = unsafe { read_volatile(noise.add(word)) };
        value.to_le_bytes().into_iter().for_each(&mut take);
    }
    embassy_stm32::uid::uid().into_iter().for_each(&mut take);
    // SAFETY: as above.
    unsafe { write_volatile(noise, hash) };
    hash
}

/// Why the chip was reset. The flags are cleared, so that the next reset shows its own. A reset from within pulls the pin
/// too, and power sets more than its own flag: the order decides.
fn cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    pac::RCC.csr().modify(|w| w.set_rmvf(false));
    #[cfg(chip = "g474re")]
    let (power, watchdog, pin) = (flags.borrstf(), flags.iwdgrstf(), flags.pinrstf());
    #[cfg(chip = "f446re")]
    let (power, watchdog, pin) = (flags.porrstf() || flags.borrstf(), flags.wdgrstf(), flags.padrstf());
    if power {
        ResetCause::Power
    } else if watchdog || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if pin {
        ResetCause::Pin
    } else {
        ResetCause::Unknown
    }
}

/// What came before. To be called once, before the tick runs.
pub fn before() -> Boot {
    let mut boot = Boot { reset: cause(), ..Boot::default() };
    let note = addr_of_mut!(NOTE).cast::<u8>();
    // A panic ends in the watchdog's reset.
    if let Some(text) = read_note(&load(note)).filter(|_| boot.reset == ResetCause::Watchdog) {
        boot.reset = ResetCause::Panic;
        boot.panic = text;
    }
    store(note, &[0; NOTE_LEN]);
    if keeps_memory(boot.reset) {
        let counts = addr_of_mut!(COUNTS).cast::<u8>();
        boot.kept = newest(&[load(counts), load(counts.wrapping_add(KEPT_LEN))]).map(|(_, kept)| kept);
    }
    boot
}

/// Leaves both counts for the next boot; `number` counts the calls.
pub fn keep(number: u32, kept: &Kept) {
    let place = addr_of_mut!(COUNTS).cast::<u8>().wrapping_add(KEPT_LEN * (number & 1) as usize);
    store(place, &to_bytes(number, kept));
}

/// Leaves a panic's text for the next boot. With interrupts off.
pub fn leave_note(bytes: &[u8; NOTE_LEN]) {
    store(addr_of_mut!(NOTE).cast::<u8>(), bytes);
}

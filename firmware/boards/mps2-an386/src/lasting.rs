//! What lasts over a reset of the machine: memory that nothing initialises, and the settings' flash.
//!
//! The machine has no flag that tells why it was reset: counts that are whole say that it was one from within.

use core::convert::Infallible;
use core::mem::MaybeUninit;
use core::ptr::{addr_of_mut, read_volatile, write_volatile};

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use whirl_firmware::kept::{KEPT_LEN, Kept, NOTE_LEN, newest, read_note, to_bytes};
use whirl_firmware::settings::Boot;
use whirl_firmware::store::Store;
use whirl_shared::frame::ResetCause;

#[unsafe(link_section = ".uninit.boots")]
static mut BOOTS: MaybeUninit<u32> = MaybeUninit::uninit();
#[unsafe(link_section = ".uninit.counts")]
static mut COUNTS: MaybeUninit<[[u8; KEPT_LEN]; 2]> = MaybeUninit::uninit();
#[unsafe(link_section = ".uninit.note")]
static mut NOTE: MaybeUninit<[u8; NOTE_LEN]> = MaybeUninit::uninit();

fn load<const N: usize>(from: *const u8) -> [u8; N] {
    // SAFETY: called with the statics above alone, of N bytes or more, which are there whatever they hold.
    core::array::from_fn(|i| unsafe { read_volatile(from.add(i)) })
}

fn store(to: *mut u8, bytes: &[u8]) {
    for (i, &byte) in bytes.iter().enumerate() {
        // SAFETY: called with the statics above alone and as many bytes as they have.
        unsafe { write_volatile(to.add(i), byte) };
    }
}

/// What came before, and the number of this boot, from 1. To be called once, before the tick runs.
pub fn before() -> (Boot, u32) {
    let (boots, counts, note) =
        (addr_of_mut!(BOOTS).cast::<u8>(), addr_of_mut!(COUNTS).cast::<u8>(), addr_of_mut!(NOTE).cast::<u8>());
    let mut boot = Boot::default();
    let Some((_, kept)) = newest(&[load(counts), load(counts.wrapping_add(KEPT_LEN))]) else {
        store(boots, &1_u32.to_le_bytes());
        return (boot, 1);
    };
    boot.kept = Some(kept);
    boot.reset = ResetCause::Watchdog;
    if let Some(text) = read_note(&load(note)) {
        boot.reset = ResetCause::Panic;
        boot.panic = text;
    }
    store(note, &[0; NOTE_LEN]);
    let number = u32::from_le_bytes(load(boots)).wrapping_add(1);
    store(boots, &number.to_le_bytes());
    (boot, number)
}

/// Leaves both counts for the next boot; `number` counts the calls.
pub fn keep(number: u32, kept: &Kept) {
    let place = addr_of_mut!(COUNTS).cast::<u8>().wrapping_add(KEPT_LEN * (number & 1) as usize);
    store(place, &to_bytes(number, kept));
}

/// Leaves a panic's text for the next boot.
pub fn leave_note(bytes: &[u8; NOTE_LEN]) {
    store(addr_of_mut!(NOTE).cast::<u8>(), bytes);
}

/// The settings' two pages, behind what the linker was given: memory that behaves as flash does.
pub struct Pages;

/// Where they begin: 508 KB.
const PAGES_AT: u32 = 508 * 1024;

impl Pages {
    /// The store of settings on them.
    pub fn store() -> Store<Self> {
        Store::new(Self, 0)
    }
}

impl ErrorType for Pages {
    type Error = Infallible;
}

impl ReadNorFlash for Pages {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        for (address, byte) in (PAGES_AT + offset..).zip(bytes) {
            // SAFETY: memory of this machine that is given to nobody else.
            *byte = unsafe { read_volatile(address as *const u8) };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * Self::ERASE_SIZE
    }
}

impl NorFlash for Pages {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2_048;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        for address in PAGES_AT + from..PAGES_AT + to {
            // SAFETY: as in `read`.
            unsafe { write_volatile(address as *mut u8, 0xff) };
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        for (address, &byte) in (PAGES_AT + offset..).zip(bytes) {
            // Flash only clears bits.
            // SAFETY: as in `read`.
            unsafe { write_volatile(address as *mut u8, read_volatile(address as *const u8) & byte) };
        }
        Ok(())
    }
}

//! The settings' flash: memory of the machine that behaves as flash does.

use core::convert::Infallible;
use core::ptr::{read_volatile, write_volatile};

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use whirl_firmware::store::Store;

/// The settings' two pages, behind what the linker was given.
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

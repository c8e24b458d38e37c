//! Calls to the debugger's side: pipes, messages, the end.

use core::fmt::{self, Write};

use cortex_m_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};
use cortex_m_semihosting::{nr, syscall};

/// An open file.
#[derive(Clone, Copy)]
pub struct File(usize);

impl File {
    /// Opens a file of the emulator's folder; `name` ends with a zero byte. `None` where that
    /// fails.
    pub fn open(name: &str, write: bool) -> Option<Self> {
        if !name.ends_with('\0') {
            return None;
        }
        // Modes of the ARM semihosting specification: "rb" and "wb".
        let mode = if write { 5_usize } else { 1 };
        // SAFETY: name and length describe a string that lives across the call, as SYS_OPEN wants
        // it.
        let handle = unsafe { syscall!(OPEN, name.as_ptr(), mode, name.len() - 1) };
        (handle != usize::MAX).then_some(Self(handle))
    }

    /// What it is to the debugger; above 0.
    pub fn handle(self) -> usize {
        self.0
    }

    /// A file that is open already; 0 is none.
    pub fn of_handle(handle: usize) -> Option<Self> {
        (handle > 0).then_some(Self(handle))
    }

    /// Writes all of it; false where that fails.
    pub fn write_all(self, mut bytes: &[u8]) -> bool {
        while !bytes.is_empty() {
            // SAFETY: pointer and length describe `bytes`, which is only read.
            let left = unsafe { syscall!(WRITE, self.0, bytes.as_ptr(), bytes.len()) };
            if left >= bytes.len() {
                return false;
            }
            bytes = &bytes[bytes.len() - left..];
        }
        true
    }

    /// Fills the buffer, waiting as long as that takes; false where the other end has gone.
    pub fn read_exact(self, mut buffer: &mut [u8]) -> bool {
        while !buffer.is_empty() {
            // SAFETY: pointer and length describe `buffer`, which is ours alone.
            let left = unsafe { syscall!(READ, self.0, buffer.as_mut_ptr(), buffer.len()) };
            if left >= buffer.len() {
                return false;
            }
            let n = buffer.len() - left;
            buffer = &mut buffer[n..];
        }
        true
    }
}

/// The emulator's console.
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        // WRITE0 wants a zero at the end: in pieces that fit with one.
        for piece in text.as_bytes().chunks(63) {
            let mut line = [0_u8; 64];
            line[..piece.len()].copy_from_slice(piece);
            // SAFETY: `line` ends with a zero and lives across the call.
            unsafe { cortex_m_semihosting::syscall1(nr::WRITE0, line.as_ptr() as usize) };
        }
        Ok(())
    }
}

/// The arguments that the emulator was given, at most `buffer`'s length of them.
pub fn arguments(buffer: &mut [u8]) -> Option<&str> {
    let mut block = [buffer.as_mut_ptr() as usize, buffer.len()];
    // SAFETY: the block names a buffer of ours with its length, as SYS_GET_CMDLINE wants it, and
    // takes the text's length.
    let result = unsafe { cortex_m_semihosting::syscall1(nr::GET_CMDLINE, block.as_mut_ptr() as usize) };
    // What was written through the pointer is read by the pointer.
    // SAFETY: the second word is initialised.
    let length = unsafe { core::ptr::read_volatile(block.as_ptr().add(1)) };
    if result != 0 { None } else { core::str::from_utf8(buffer.get(..length)?).ok() }
}

/// Ends the emulation.
pub fn exit(well: bool) -> ! {
    loop {
        debug::exit(if well { EXIT_SUCCESS } else { EXIT_FAILURE });
    }
}

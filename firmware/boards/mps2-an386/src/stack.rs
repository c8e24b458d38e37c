//! How deep the stack has been: it is painted at boot, and the paint that is left is counted.

use core::ptr::{addr_of, read_volatile, write_volatile};

const PAINT: u32 = 0xdead_5afe;
/// Below the painter's own frame, bytes.
const CLEAR_OF_FRAME: usize = 256;

unsafe extern "C" {
    // Symbols of cortex-m-rt's linker script: their addresses are their meaning.
    static _stack_start: u32;
    static __sheap: u32;
}

fn bounds() -> (usize, usize) {
    // Only addresses are taken.
    (addr_of!(__sheap) as usize, addr_of!(_stack_start) as usize)
}

/// Paints what is free of the stack. To be called once, before interrupts are on.
#[inline(never)]
pub fn paint() {
    let (bottom, _) = bounds();
    let here = 0_u32;
    let top = (addr_of!(here) as usize).saturating_sub(CLEAR_OF_FRAME) & !3;
    for address in (bottom..top).step_by(4) {
        // SAFETY: between the end of all statics and the stack that is in use lies nothing.
        unsafe { write_volatile(address as *mut u32, PAINT) };
    }
}

/// Deepest use so far, bytes.
pub fn used() -> usize {
    let (bottom, top) = bounds();
    // SAFETY: RAM that is there; words that are in use are read and compared, nothing more.
    let painted = (bottom..top).step_by(4).take_while(|&a| unsafe { read_volatile(a as *const u32) } == PAINT).count();
    top - bottom - 4 * painted
}

/// Bytes of statics below the stack.
pub fn statics() -> usize {
    bounds().0 - 0x2000_0000
}

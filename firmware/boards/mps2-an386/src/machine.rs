//! The machine's peripherals: CMSDK timers and UART, the interrupt's place in the vector table.
//! Registers as in the Cortex-M System Design Kit's reference manual (ARM DDI 0479).

use core::ptr::{read_volatile, write_volatile};

use cortex_m::interrupt::InterruptNumber;

/// Clock of the machine, Hz.
pub const CLOCK_HZ: u32 = 25_000_000;

const TIMER0: usize = 0x4000_0000;
const TIMER1: usize = 0x4000_1000;
const UART0: usize = 0x4000_4000;

const CTRL: usize = 0x0;
const VALUE: usize = 0x4;
const RELOAD: usize = 0x8;
const CLEAR: usize = 0xC;

fn write(address: usize, value: u32) {
    // SAFETY: every address in this file is a register of this machine that is written as a word,
    // with no effect on memory.
    unsafe { write_volatile(address as *mut u32, value) }
}

fn read(address: usize) -> u32 {
    // SAFETY: as in `write`.
    unsafe { read_volatile(address as *const u32) }
}

/// TIMER0's interrupt.
#[derive(Clone, Copy)]
pub struct Timer0;

const TIMER0_INTERRUPT: u16 = 8;

// SAFETY: this is TIMER0's interrupt on this machine.
unsafe impl InterruptNumber for Timer0 {
    fn number(self) -> u16 {
        TIMER0_INTERRUPT
    }
}

/// Starts the tick: an interrupt every `period` clocks.
pub fn start_tick(period: u32) {
    write(TIMER0 + RELOAD, period - 1);
    write(TIMER0 + VALUE, period - 1);
    write(TIMER0 + CTRL, 0b1001);
}

/// Takes the tick's interrupt.
pub fn clear_tick() {
    write(TIMER0 + CLEAR, 1);
}

/// Clocks since the last tick.
pub fn since_tick(period: u32) -> u32 {
    (period - 1).saturating_sub(read(TIMER0 + VALUE))
}

/// Starts the free clock.
pub fn start_clock() {
    write(TIMER1 + RELOAD, u32::MAX);
    write(TIMER1 + VALUE, u32::MAX);
    write(TIMER1 + CTRL, 1);
}

/// The free clock, clocks (wrapping, counting up).
pub fn clock() -> u32 {
    !read(TIMER1 + VALUE)
}

/// Switches the UART on.
pub fn start_uart() {
    write(UART0 + 0x10, 16);
    write(UART0 + 0x8, 0b11);
}

/// Sends a byte if the UART takes it now.
pub fn send(byte: u8) -> bool {
    let free = read(UART0 + 0x4) & 1 == 0;
    if free {
        write(UART0, u32::from(byte));
    }
    free
}

/// A byte that has come, if any.
pub fn receive() -> Option<u8> {
    (read(UART0 + 0x4) & 2 != 0).then(|| read(UART0) as u8)
}

/// An entry of the vector table.
pub type Vector = unsafe extern "C" fn();

unsafe extern "C" fn unexpected() {
    panic!("interrupt without a handler");
}

/// The table behind the processor's own exceptions, with one interrupt's handler in it.
#[must_use]
pub const fn table(interrupt: Timer0, handler: Vector) -> [Vector; 32] {
    let Timer0 = interrupt;
    let mut table = [unexpected as Vector; 32];
    table[TIMER0_INTERRUPT as usize] = handler;
    table
}

/// The table of a program without interrupts.
#[must_use]
pub const fn empty_table() -> [Vector; 32] {
    [unexpected as Vector; 32]
}

//! The firmware on the Raspberry Pi Pico 2 (RP2350, Cortex-M33 at 150 MHz).
//!
//! | part | hardware |
//! |---|---|
//! | encoders | two state machines of PIO 0, all edges ([`whirl_board_pico2::decoder`]) |
//! | tick | PWM slice 8, 500 Hz from the crystal, divided exactly; TIMER 0 tells which tick it is |
//! | shaker | pulse width on GP16, 40 000 points a second by PWM slice 0 and DMA ([`whirl_board_pico2::player`]), amplifier enable on GP17 |
//! | settings | in the flash's last two sectors |
//! | light | GP25, the board's green LED |
//! | stream | USB, a serial port of its own; RTT channel 1 beside it |
//! | messages | defmt, RTT channel 0 |
//!
//! Pins: `board.rs`, and docs/boards.md with the wiring. The watchdog resets the board when the
//! tick or the thread stands still for 100 ms; after a reset, as after a panic, the enable pin is
//! low. The second core is not started.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod base_input;
#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod fault;
#[cfg(target_os = "none")]
mod hardware;
#[cfg(target_os = "none")]
mod rig;
#[cfg(target_os = "none")]
mod usb;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("whirl-board-pico2 is firmware: build it with --target thumbv8m.main-none-eabihf");
    std::process::exit(2);
}

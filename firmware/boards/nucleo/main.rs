//! The firmware on ST's NUCLEO-64 boards: one source, one package a board.
//!
//! | part | hardware |
//! |---|---|
//! | encoders | TIM2 and TIM5 in encoder mode, all edges, digital filter |
//! | tick | TIM6, 500 Hz from the crystal, divided exactly; its interrupt is above all others |
//! | shaker | DAC1 channel 1 (PA4), amplifier enable on PB10 |
//! | stream | USART2 by DMA: the ST-LINK's serial port; RTT channel 1 beside it |
//! | messages | defmt, RTT channel 0 |
//!
//! Pins: `board.rs`, and docs/boards.md with the wiring. The watchdog resets the board when the tick or the thread stands
//! still for [`watchdog`]'s time; after a reset, as after a panic, the enable pin is low.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod boot;
#[cfg(target_os = "none")]
mod fault;
#[cfg(target_os = "none")]
mod hardware;
#[cfg(target_os = "none")]
mod rig;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("{} is firmware: build it with --target thumbv7em-none-eabihf", env!("CARGO_PKG_NAME"));
    std::process::exit(2);
}

//! The firmware on ST's NUCLEO-64 boards: one source, one package a board.
//!
//! | part | hardware |
//! |---|---|
//! | encoders | TIM4 and TIM3 in encoder mode, all edges, digital filter; their index by input capture |
//! | tick | TIM6, 500 Hz from the crystal, divided exactly; its interrupt is above all others; TIM5 tells which tick it is |
//! | shaker | DAC1 channel 1 (PA4), 40 000 points a second by TIM7 and DMA, amplifier enable on PB10 |
//! | settings | in the flash's last two pages or sectors |
//! | light | PA5, the board's green LED |
//! | stream | USART2 by DMA: the ST-LINK's serial port; RTT channel 1 beside it |
//! | messages | defmt, RTT channel 0 |
//!
//! Pins: `board.rs`, and docs/boards.md with the wiring. The watchdog resets the board when the
//! tick or the thread stands still for 100 ms; after a reset, as after a panic, the enable pin is
//! low.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod base_input;
#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod boot;
#[cfg(target_os = "none")]
mod fault;
#[cfg(target_os = "none")]
mod hardware;
#[cfg(target_os = "none")]
mod player;
#[cfg(target_os = "none")]
mod rig;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("{} is firmware: build it with --target thumbv7em-none-eabihf", env!("CARGO_PKG_NAME"));
    std::process::exit(2);
}

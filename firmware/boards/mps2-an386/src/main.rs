//! The firmware on QEMU's mps2-an386 (Cortex-M4F at 25 MHz), against a simulated plant.
//!
//! | part | here | on a real board |
//! |---|---|---|
//! | tick | TIMER0, 500 Hz | a timer |
//! | encoders and shaker | one exchange a tick over the semihosting pipes ([`whirl_firmware::lock_step`]) | quadrature timers, DAC |
//! | the product's stream | UART0 | a UART |
//!
//! Everything else is the firmware library, split between interrupt and thread as on a real board.
//! The thread spins where a real one sleeps: QEMU 7.2 runs its timers at half their rate over WFI
//! when instructions are counted.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod fault;
#[cfg(target_os = "none")]
mod plant;
#[cfg(target_os = "none")]
mod rig;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("whirl-board-mps2-an386 is firmware: build it with --target thumbv7em-none-eabihf");
    std::process::exit(2);
}

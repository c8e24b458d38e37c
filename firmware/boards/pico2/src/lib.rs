//! What of the Pico 2's firmware is no register: the program of its quadrature decoders, the order
//! of the shaker's points, the reset's cause. It is the same on a host, where it is tested.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod decoder;
pub mod player;
pub mod reset;

#[cfg(test)]
mod interpreter;

//! What the firmware and the host must agree on, and nothing else.
//!
//! | module | what |
//! |---|---|
//! | [`frame`] | the messages |
//! | [`codec`] | messages ↔ bytes on the wire |
//! | [`block`] | the samples of a block one by one |
//! | [`sequence`] | lost, repeated and late frames |
//! | [`tick`] | sampling ticks beyond 2³², gaps, restarts |
//! | [`encoder`] | counts ↔ angles, wrap, unwrap, multi-turn counts |
//! | [`waveform`] | the drive's phase and displacement |
//! | [`excitation`] | the drive beyond one sine: sweeps, several sines, steps of amplitude |
//! | [`harmonics`] | windowed harmonic sums of the measured signals |
//! | [`regressor`] | regression rows of the double pendulum, in the weak form |
//! | [`least_squares`] | recursive least squares in square-root form, on nalgebra |
//!
//! Everything is `no_std`, allocates nothing and uses a bounded amount of memory. Transcendental
//! functions come from `libm` by name, not from the platform, so that device and host agree to the
//! last bit.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod block;
pub mod codec;
pub mod encoder;
pub mod excitation;
pub mod frame;
pub mod harmonics;
pub mod least_squares;
pub mod real;
pub mod regressor;
pub mod sequence;
pub mod tick;
pub mod waveform;

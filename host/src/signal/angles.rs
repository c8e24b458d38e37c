//! The drive's phase at the samples of a record.

/// Where the phase of the drive comes from.
#[derive(Clone, Debug)]
pub enum Phase {
    /// Recorded by the device, turns · 2⁻³² at each sample.
    Device(Vec<u32>),
    /// τ = Ω t with this Ω, rad/s (0 for a free system).
    Clock(f64),
}

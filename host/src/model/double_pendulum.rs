//! The double pendulum with vertically driven or resting base, in the non-dimensional form (3.4).
//!
//! With τ = Ω t (Ω = 1 rad/s for a free system), φ1, φ2 absolute, Δ = φ2 − φ1:
//!
//! φ1″ + B11 (φ2″ cos Δ − φ2′² sin Δ) + B12 sin φ1 + (B13 cos τ + B14 sin τ) sin φ1 + C11 sign
//! φ1′ − C12 (φ2′ − φ1′) = 0
//!
//! φ2″ + B21 (φ1″ cos Δ + φ1′² sin Δ) + B22 sin φ2 + (B23 cos τ + B24 sin τ) sin φ2 + C2 (φ2′ −
//! φ1′) = 0
//!
//! Where the base's own motion is measured (a channel that measures `base`, as acceleration ÿ or as
//! a position that is differentiated), the terms in cos τ and sin τ are B16 ÿ sin φ1 and B26 ÿ sin
//! φ2 in their place, B_i6 = S_i/(κ J_oi Ω²) in s²/m: amplitude, phase and form of the drive are no
//! parameters. κ is what the channel shows of 1: B_i2 = κ g B_i6.
//!
//! The weak form leaves first derivatives only, since φ2″ cos Δ − φ2′² sin Δ = (φ2′ cos Δ)′ − φ1′
//! φ2′ sin Δ and φ1″ cos Δ + φ1′² sin Δ = (φ1′ cos Δ)′ + φ1′ φ2′ sin Δ.
//!
//! The dampings are those of the rig's nominal effects. Beside the seed's C11 (Coulomb, joint 1)
//! and C12, C2 (viscous, joint 2): C13 = c_r1/(J_o1 Ω) viscous friction of joint 1, and C14, C4 =
//! τ_c2/(J_oi Ω²) Coulomb friction of joint 2.

use super::damping::Damping;

/// The dampings that a nominal model may have.
pub const DAMPINGS: &[Damping] = &[
    Damping { id: "coulomb-friction@joint1", names: [Some("C11"), None], viscous: false },
    Damping { id: "viscous-friction@joint2", names: [Some("C12"), Some("C2")], viscous: true },
    Damping { id: "viscous-friction@joint1", names: [Some("C13"), None], viscous: true },
    Damping { id: "coulomb-friction@joint2", names: [Some("C14"), Some("C4")], viscous: false },
];

/// The double pendulum's default nominal dampings (contract: `[nominal]`).
pub const DEFAULT_DAMPINGS: &[&str] = &["coulomb-friction@joint1", "viscous-friction@joint2"];

/// What is known of the base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// It rests.
    Resting,
    /// It moves harmonically, with unknown amplitude and phase.
    Driven,
    /// Its motion is measured.
    Measured,
}

/// Names of the coefficients of both equations, in their order.
pub fn coefficients(base: Base, dampings: &[&Damping]) -> [Vec<String>; 2] {
    [0, 1].map(|i: usize| {
        let orders: &[u8] = match base {
            Base::Resting => &[1, 2],
            Base::Driven => &[1, 2, 3, 4],
            Base::Measured => &[1, 2, 6],
        };
        let base = orders.iter().map(|k| format!("B{}{k}", i + 1));
        base.chain(dampings.iter().filter_map(|d| d.names[i].map(str::to_owned))).collect()
    })
}

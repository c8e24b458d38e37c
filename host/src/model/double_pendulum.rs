//! The double pendulum with vertically driven or resting base, in the non-dimensional form (3.4).
//!
//! With τ = Ω t (Ω = 1 rad/s for a free system), φ1, φ2 absolute, Δ = φ2 − φ1:
//!
//! φ1″ + B11 (φ2″ cos Δ − φ2′² sin Δ) + B12 sin φ1 + (B13 cos τ + B14 sin τ) sin φ1 + C11 sign φ1′ − C12 (φ2′ − φ1′) = 0
//!
//! φ2″ + B21 (φ1″ cos Δ + φ1′² sin Δ) + B22 sin φ2 + (B23 cos τ + B24 sin τ) sin φ2 + C2 (φ2′ − φ1′) = 0
//!
//! The weak form leaves first derivatives only, since
//! φ2″ cos Δ − φ2′² sin Δ = (φ2′ cos Δ)′ − φ1′ φ2′ sin Δ and φ1″ cos Δ + φ1′² sin Δ = (φ1′ cos Δ)′ + φ1′ φ2′ sin Δ.
//!
//! The dampings are those of the rig's nominal effects. Beside the seed's C11 (Coulomb, joint 1) and C12, C2 (viscous,
//! joint 2): C13 = c_r1/(J_o1 Ω) viscous friction of joint 1, and C14, C4 = τ_c2/(J_oi Ω²) Coulomb friction of joint 2.

use super::weak::{Block, Equation, Order, Term, WeakModel, mean_sign};

/// A damping of the nominal model: where it acts and which coefficients it adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damping {
    /// `ID@PLACE` in rig files.
    pub id: &'static str,
    /// Names of its coefficients in the first and second equation.
    pub names: [Option<&'static str>; 2],
    /// Whether the coefficient is divided by Ω (viscous) or by Ω² (Coulomb).
    pub(crate) viscous: bool,
}

impl Damping {
    /// Whether its coefficients are divided by Ω (viscous) or by Ω² (Coulomb).
    pub fn is_viscous(&self) -> bool {
        self.viscous
    }
}

/// The dampings that a nominal model may have.
pub const DAMPINGS: &[Damping] = &[
    Damping { id: "coulomb-friction@joint1", names: [Some("C11"), None], viscous: false },
    Damping { id: "viscous-friction@joint2", names: [Some("C12"), Some("C2")], viscous: true },
    Damping { id: "viscous-friction@joint1", names: [Some("C13"), None], viscous: true },
    Damping { id: "coulomb-friction@joint2", names: [Some("C14"), Some("C4")], viscous: false },
];

/// The double pendulum's default nominal dampings (contract: `[nominal]`).
pub const DEFAULT_DAMPINGS: &[&str] = &["coulomb-friction@joint1", "viscous-friction@joint2"];

fn phi1(b: &Block<'_>, out: &mut [f64]) {
    out.copy_from_slice(b.raw[0]);
}
fn phi2(b: &Block<'_>, out: &mut [f64]) {
    out.copy_from_slice(b.raw[1]);
}
fn momentum1(b: &Block<'_>, out: &mut [f64]) {
    product(b.rate[0], b.delta[1], out);
}
fn momentum2(b: &Block<'_>, out: &mut [f64]) {
    product(b.rate[1], b.delta[1], out);
}
fn coupling(b: &Block<'_>, out: &mut [f64]) {
    product(b.rate[0], b.rate[1], out);
    out.iter_mut().zip(b.delta[0]).for_each(|(o, s)| *o *= s);
}
fn sin1(b: &Block<'_>, out: &mut [f64]) {
    out.copy_from_slice(b.sin[0]);
}
fn sin2(b: &Block<'_>, out: &mut [f64]) {
    out.copy_from_slice(b.sin[1]);
}
fn sin1_cos_tau(b: &Block<'_>, out: &mut [f64]) {
    product(b.sin[0], b.tau[1], out);
}
fn sin1_sin_tau(b: &Block<'_>, out: &mut [f64]) {
    product(b.sin[0], b.tau[0], out);
}
fn sin2_cos_tau(b: &Block<'_>, out: &mut [f64]) {
    product(b.sin[1], b.tau[1], out);
}
fn sin2_sin_tau(b: &Block<'_>, out: &mut [f64]) {
    product(b.sin[1], b.tau[0], out);
}
fn sign_joint1(b: &Block<'_>, out: &mut [f64]) {
    for ((o, v), step) in out.iter_mut().zip(b.clear_rate[0]).zip(b.clear_step[0]) {
        *o = mean_sign(*v, *step);
    }
}
fn sign_joint2(b: &Block<'_>, out: &mut [f64]) {
    let ([v1, v2], [step1, step2]) = (b.clear_rate, b.clear_step);
    for ((o, v), step) in out.iter_mut().zip(v1.iter().zip(v2)).zip(step1.iter().zip(step2)) {
        *o = mean_sign(v.1 - v.0, step.1 - step.0);
    }
}

fn product(a: &[f64], b: &[f64], out: &mut [f64]) {
    out.iter_mut().zip(a.iter().zip(b)).for_each(|(o, (a, b))| *o = a * b);
}

/// The weak model at angular frequency `omega` (rad/s; 1 for a free system, `driven` false then).
pub fn weak_model(omega: f64, driven: bool, dampings: &[&Damping]) -> WeakModel {
    let mut m = WeakModel::default();
    m.name = "double-pendulum".to_owned();
    let unit = |driven_free: [&'static str; 2]| if driven { driven_free[0] } else { driven_free[1] };
    let (second, first) = (1.0 / (omega * omega), 1.0 / omega);
    for i in 0..2 {
        let target = vec![m.run(["phi1", "phi2"][i], [phi1, phi2][i], Order::Second, -second)];
        // The coupling of an equation carries the other arm's momentum.
        let momentum = m.run(["momentum2", "momentum1"][i], [momentum2, momentum1][i], Order::First, second);
        let product = m.run("coupling", coupling, Order::Value, [-second, second][i]);
        let n = i + 1;
        let gravity = m.run(["sin1", "sin2"][i], [sin1, sin2][i], Order::Value, 1.0);
        let mut terms = vec![
            Term { name: format!("B{n}1"), unit: "1", parts: vec![momentum, product] },
            Term { name: format!("B{n}2"), unit: unit(["1", "s⁻²"]), parts: vec![gravity] },
        ];
        if driven {
            let cos = m.run(["sin1 cos", "sin2 cos"][i], [sin1_cos_tau, sin2_cos_tau][i], Order::Value, 1.0);
            let sin = m.run(["sin1 sin", "sin2 sin"][i], [sin1_sin_tau, sin2_sin_tau][i], Order::Value, 1.0);
            terms.push(Term { name: format!("B{n}3"), unit: "1", parts: vec![cos] });
            terms.push(Term { name: format!("B{n}4"), unit: "1", parts: vec![sin] });
        }
        for damping in dampings {
            let Some(name) = damping.names[i] else { continue };
            let joint2 = damping.id.ends_with("joint2");
            // A torque in joint 2 acts on both arms with opposite signs.
            let direction = if joint2 && i == 0 { -1.0 } else { 1.0 };
            let parts = match (damping.viscous, joint2) {
                (true, true) => vec![
                    m.run("phi2", phi2, Order::First, direction * first),
                    m.run("phi1", phi1, Order::First, -direction * first),
                ],
                (true, false) => vec![m.run("phi1", phi1, Order::First, direction * first)],
                (false, true) => vec![m.run("sign joint2", sign_joint2, Order::Value, direction)],
                (false, false) => vec![m.run("sign joint1", sign_joint1, Order::Value, direction)],
            };
            let unit = unit(["1", if damping.viscous { "s⁻¹" } else { "s⁻²" }]);
            terms.push(Term { name: name.to_owned(), unit, parts });
        }
        m.equations.push(Equation { terms, target });
    }
    m
}

//! The equations as the harmonic balance needs them: each term a sum of products of factors, so
//! that every factor can be low-passed before products are formed (3.26), (3.27).
//!
//! Equation e reads Σ_j λ_j X_j = −φ_e″. Non-dimensional throughout.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::orbit::State;
use super::settings::Basis;
use crate::model::damping::Damping;
use crate::model::single_pendulum;

/// A factor of a product.
pub struct Factor {
    /// Its value at an instant.
    pub of: Arc<dyn Fn(&State) -> f64 + Send + Sync>,
    /// Whether the low-pass acts on it (velocities and accelerations have been through it already;
    /// a jumping law stands alone).
    pub filtered: bool,
}

/// The part of the drive in a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// 1.
    None,
    /// cos τ.
    Cos,
    /// sin τ.
    Sin,
}

/// factor · Π factors · drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Product {
    /// Number in front.
    pub scale: f64,
    /// Indices into [`Equations::factors`].
    pub factors: Vec<usize>,
    /// Part of the drive.
    pub drive: Drive,
}

/// What a term does to the energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Dissipates.
    Damping,
    /// Vanishes over an orbit that closes.
    Conservative,
    /// Feeds energy in, or passes it between the equations.
    Other,
}

/// One unknown coefficient and what it multiplies.
pub struct Term {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// What it multiplies, as a sum.
    pub products: Vec<Product>,
    /// What it does to the energy.
    pub role: Role,
    /// U with X φ_e′ = dU/dτ, where it has one.
    pub potential: Option<fn(&State) -> f64>,
}

/// A system of equations over shared factors.
pub struct Equations {
    /// Factors.
    pub factors: Vec<Factor>,
    /// Left-hand sides, equation by equation.
    pub terms: Vec<Vec<Term>>,
    /// Right-hand sides, equation by equation; −φ_e″ where there are none.
    pub targets: Vec<Vec<Product>>,
    /// Whether each coordinate is an angle.
    pub circle: [bool; 2],
    /// Coefficients of unknown functions by function: name, and (equation, term) of each
    /// coefficient with its basis function.
    pub functions: Vec<(&'static str, Vec<(usize, usize)>)>,
    /// Basis of those functions.
    pub basis: Vec<Arc<dyn Fn(f64) -> f64 + Send + Sync>>,
}

impl Default for Equations {
    fn default() -> Self {
        Self {
            factors: Vec::new(),
            terms: Vec::new(),
            targets: Vec::new(),
            circle: [true; 2],
            functions: Vec::new(),
            basis: Vec::new(),
        }
    }
}

impl Equations {
    fn factor(&mut self, of: impl Fn(&State) -> f64 + Send + Sync + 'static, filtered: bool) -> usize {
        self.factors.push(Factor { of: Arc::new(of), filtered });
        self.factors.len() - 1
    }

    /// Number of unknowns over all equations.
    pub fn unknowns(&self) -> usize {
        self.terms.iter().map(Vec::len).sum()
    }
}

fn product(scale: f64, factors: &[usize], drive: Drive) -> Product {
    Product { scale, factors: factors.to_vec(), drive }
}

/// The double pendulum (3.4).
pub fn double_pendulum(dampings: &[&Damping]) -> Equations {
    let mut m = Equations::default();
    let rate = [m.factor(|s| s.rate[0], false), m.factor(|s| s.rate[1], false)];
    let accel = [m.factor(|s| s.accel[0], false), m.factor(|s| s.accel[1], false)];
    let cos_delta = m.factor(|s| (s.angle[1] - s.angle[0]).cos(), true);
    let sin_delta = m.factor(|s| (s.angle[1] - s.angle[0]).sin(), true);
    let sin = [m.factor(|s| s.angle[0].sin(), true), m.factor(|s| s.angle[1].sin(), true)];
    let joint = |d: &Damping| usize::from(d.id.ends_with("joint2"));
    for i in 0..2 {
        let other = 1 - i;
        let n = i + 1;
        let one = |name: String, products, role, potential| Term { name, unit: "1", products, role, potential };
        let coupling = vec![
            product(1.0, &[accel[other], cos_delta], Drive::None),
            product([-1.0, 1.0][i], &[rate[other], rate[other], sin_delta], Drive::None),
        ];
        let gravity: fn(&State) -> f64 =
            if i == 0 { |s: &State| -s.angle[0].cos() } else { |s: &State| -s.angle[1].cos() };
        let mut terms = vec![
            one(format!("B{n}1"), coupling, Role::Other, None),
            one(format!("B{n}2"), vec![product(1.0, &[sin[i]], Drive::None)], Role::Conservative, Some(gravity)),
        ];
        for (k, drive) in [(3, Drive::Cos), (4, Drive::Sin)] {
            terms.push(one(format!("B{n}{k}"), vec![product(1.0, &[sin[i]], drive)], Role::Other, None));
        }
        for damping in dampings {
            let Some(name) = damping.names[i] else { continue };
            // A torque in joint 2 acts on both arms with opposite signs.
            let direction = if joint(damping) == 1 && i == 0 { -1.0 } else { 1.0 };
            let products = match (damping.viscous, joint(damping)) {
                (true, 0) => vec![product(direction, &[rate[0]], Drive::None)],
                (true, _) => {
                    vec![product(direction, &[rate[1]], Drive::None), product(-direction, &[rate[0]], Drive::None)]
                }
                (false, 0) => {
                    let f = m.factor(|s| sign(s.rate[0]), false);
                    vec![product(direction, &[f], Drive::None)]
                }
                (false, _) => {
                    let f = m.factor(|s| sign(s.rate[1] - s.rate[0]), false);
                    vec![product(direction, &[f], Drive::None)]
                }
            };
            terms.push(one(name.to_owned(), products, Role::Damping, None));
        }
        m.terms.push(terms);
    }
    m
}

/// sign v, sign 0 = 0.
fn sign(v: f64) -> f64 {
    if v == 0.0 { 0.0 } else { v.signum() }
}

/// φ_i of the interpolation basis on N nodes, node i at −π + 2πi/N: a hat one spacing wide on
/// either side, on the circle.
pub fn hat(i: usize, nodes: usize, x: f64) -> f64 {
    let d = TAU / nodes as f64;
    let from = (x + PI - i as f64 * d + PI).rem_euclid(TAU) - PI;
    (1.0 - from.abs() / d).max(0.0)
}

/// The single pendulum (2.6), (2.19), (4.12). `dampings`: coefficient names.
pub fn single_pendulum(dampings: &[&str], basis: Basis) -> Equations {
    let mut m = Equations::default();
    let rate = m.factor(|s| s.rate[0], false);
    let mut terms = Vec::new();
    for damping in dampings {
        let factor = if *damping == "c_r" { rate } else { m.factor(|s| sign(s.rate[0]), false) };
        terms.push(Term {
            name: (*damping).to_owned(),
            unit: "1",
            products: vec![product(1.0, &[factor], Drive::None)],
            role: Role::Damping,
            potential: None,
        });
    }
    match basis {
        Basis::Harmonic(orders) => {
            for k in 1..=orders {
                let k = k as f64;
                m.basis.push(Arc::new(move |x: f64| (k * x).cos()));
                m.basis.push(Arc::new(move |x: f64| (k * x).sin()));
            }
        }
        Basis::Interpolation(nodes) => {
            for i in 0..nodes {
                m.basis.push(Arc::new(move |x: f64| hat(i, nodes, x)));
            }
        }
    }
    let name = |function: &str, i: usize| match basis {
        Basis::Harmonic(_) => single_pendulum::name(function, ["cos", "sin"][i % 2], i / 2 + 1),
        Basis::Interpolation(_) => format!("{function}_{}", i + 1),
    };
    let factors: Vec<usize> = m.basis.clone().into_iter().map(|b| m.factor(move |s| b(s.angle[0]), true)).collect();
    for (function, drive) in [("n", Drive::Cos), ("p", Drive::Sin), ("q", Drive::None)] {
        let mut places = Vec::new();
        for (i, factor) in factors.iter().enumerate() {
            // Only the first order's potentials are needed: −cos θ of sin θ, sin θ of cos θ.
            let potential: Option<fn(&State) -> f64> = match (function, basis, i) {
                ("q", Basis::Harmonic(_), 0) => Some(|s| s.angle[0].sin()),
                ("q", Basis::Harmonic(_), 1) => Some(|s| -s.angle[0].cos()),
                _ => None,
            };
            places.push((0, terms.len()));
            terms.push(Term {
                name: name(function, i),
                unit: "1",
                products: vec![product(1.0, &[*factor], drive)],
                role: if function == "q" { Role::Conservative } else { Role::Other },
                potential,
            });
        }
        m.functions.push((function, places));
    }
    m.terms.push(terms);
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::double_pendulum::DAMPINGS;

    fn value(m: &Equations, e: usize, name: &str, s: &State, tau: f64) -> f64 {
        let term = m.terms[e].iter().find(|t| t.name == name).unwrap();
        let product = |p: &Product| {
            let drive = match p.drive {
                Drive::None => 1.0,
                Drive::Cos => tau.cos(),
                Drive::Sin => tau.sin(),
            };
            p.scale * drive * p.factors.iter().map(|f| (m.factors[*f].of)(s)).product::<f64>()
        };
        term.products.iter().map(product).sum()
    }

    #[test]
    fn terms_of_the_double_pendulum_are_those_of_3_4() {
        let all: Vec<&Damping> = DAMPINGS.iter().collect();
        let m = double_pendulum(&all);
        let s = State { angle: [0.4, 2.0], rate: [-0.7, 1.3], accel: [0.2, -0.9], tau: 0.8 };
        let (delta, tau) = (1.6_f64, 0.8_f64);
        let want = [
            (0, "B11", -0.9 * delta.cos() - 1.69 * delta.sin()),
            (0, "B13", 0.4_f64.sin() * tau.cos()),
            (0, "C11", -1.0),
            (0, "C12", -2.0),
            (1, "B21", 0.2 * delta.cos() + 0.49 * delta.sin()),
            (1, "B24", 2.0_f64.sin() * tau.sin()),
            (1, "C2", 2.0),
            (1, "C4", 1.0),
            (0, "C14", -1.0),
            (0, "C13", -0.7),
        ];
        for (e, name, want) in want {
            assert!((value(&m, e, name, &s, tau) - want).abs() < 1e-12, "{name}");
        }
        assert_eq!(double_pendulum(&[]).terms[0].len(), 4);
    }

    #[test]
    fn hats_interpolate_on_the_circle() {
        let s = |x: f64| (0..8).map(|i| hat(i, 8, x)).sum::<f64>();
        for x in [-PI, -3.0, 0.1, 2.9, 3.1, 7.0] {
            assert!((s(x) - 1.0).abs() < 1e-12, "{x} {}", s(x));
        }
        assert!((hat(0, 8, PI - 0.1) - (1.0 - 0.1 / (TAU / 8.0))).abs() < 1e-12);
        let m = single_pendulum(&["c_r"], Basis::Interpolation(8));
        assert_eq!((m.unknowns(), m.terms[0][1].name.as_str(), m.functions.len()), (25, "n_1", 3));
    }

    /// Each potential is an integral of its term along a motion.
    #[test]
    fn potentials_belong_to_their_terms() {
        let m = single_pendulum(&["c_r"], Basis::Harmonic(2));
        let d = double_pendulum(&[]);
        for (e, t, arm) in [(&m, "q_sin", 0), (&m, "q_cos", 0), (&d, "B12", 0), (&d, "B22", 1)] {
            let equation = usize::from(t == "B22");
            let term = e.terms[equation].iter().find(|x| x.name == t).unwrap();
            let potential = term.potential.unwrap();
            let at = |x: f64| {
                let mut s = State::default();
                s.angle[arm] = x;
                s
            };
            let slope = (potential(&at(0.7 + 1e-5)) - potential(&at(0.7 - 1e-5))) / 2e-5;
            assert!((slope - value(e, equation, t, &at(0.7), 0.3)).abs() < 1e-9, "{t}");
        }
    }
}

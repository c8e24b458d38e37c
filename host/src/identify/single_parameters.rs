//! Physical parameters of a single pendulum from its coefficients: with m e = m1·e1, q_sin = m e
//! g/(J Ω²), amplitude of the drive's term f = m e a/J, c_r = c_r1/(J Ω), C11 = τ_c1/(J Ω²).
//!
//! a = f g/(q_sin Ω²) follows without knowing a mass. Where the base is measured with a gain κ its
//! term is u = m e/(κ J Ω²), and κ = q_sin/(u g) for a vertical drive. With m e (or m1 and e1)
//! known, J = m e g/(q Ω²); with J known, m e = q J Ω²/g, where q is q_sin, or √(q_sin² + q_cos²)
//! where gravity's torque has both parts; then c_r1 and τ_c1. Standard
//! errors by linear propagation of the coefficients' covariance.

use super::physical_parameters::{Physical, PhysicalFit};
use crate::rig::{Direction, Rig};
use crate::system::ties::Identified;

/// The parameters that follow.
pub fn derive(identified: &Identified<'_>, rig: &Rig) -> Option<PhysicalFit> {
    let Identified { names, values, covariance, .. } = *identified;
    let at = |name: &str| names.iter().position(|n| n == name);
    let q = at("q_sin").filter(|i| values[*i] > 0.0)?;
    let omega = rig.omega();
    let known = |name: &str| rig.known.get(name).copied();
    let g = known("g").unwrap_or(crate::rig::GRAVITY);
    let mut out = PhysicalFit::default();
    // A product of powers of coefficients: value · Π, relative gradient (index, power).
    let mut push = |name: &'static str, unit: &'static str, value: f64, gradient: &[(usize, f64)]| {
        let variance: f64 =
            gradient.iter().flat_map(|a| gradient.iter().map(move |b| a.1 * b.1 * covariance[(a.0, b.0)])).sum();
        out.parameters.push(Physical { name, value, std_error: variance.max(0.0).sqrt(), unit });
    };
    let component = |shape: &str| Some((at(&format!("p_{shape}"))?, at(&format!("n_{shape}"))?));
    let shape = if rig.drive.is_some_and(|d| d.direction == Direction::Vertical) { "sin" } else { "cos" };
    if let Some((p, n)) = component(shape) {
        let f = values[p].hypot(values[n]);
        if f > 0.0 {
            let a = f * g / (values[q] * omega * omega);
            push("a", "m", a, &[(p, a * values[p] / (f * f)), (n, a * values[n] / (f * f)), (q, -a / values[q])]);
        }
    }
    if let Some(u) = at("u_sin") {
        let gain = values[q] / (values[u] * g);
        push("base_gain", "1", gain, &[(u, -gain / values[u]), (q, gain / values[q])]);
    }
    // A sensor whose zero is off, a tilted frame and a centroid off the arm's line turn gravity's
    // torque and leave its size: √(q_sin² + q_cos²), with its relative gradient.
    let beside = at("q_cos").map(|i| (i, values[i]));
    let size = values[q].hypot(beside.map_or(0.0, |b| b.1));
    let gravity: Vec<(usize, f64)> =
        std::iter::once((q, values[q])).chain(beside).map(|(i, v)| (i, v / (size * size))).collect();
    let by_gravity = |factor: f64| gravity.iter().map(move |(i, r)| (*i, factor * r));
    let moment = known("m1e1").or_else(|| Some(known("m1")? * known("e1")?));
    let inertia = known("J_o1");
    let scale = match (moment, inertia) {
        (_, Some(j)) => {
            if moment.is_none() {
                let value = size * j * omega * omega / g;
                push("m1e1", "kg m", value, &by_gravity(value).collect::<Vec<_>>());
            }
            Some((j, 0.0))
        }
        (Some(m), None) => {
            let j = m * g / (size * omega * omega);
            push("J_o1", "kg m²", j, &by_gravity(-j).collect::<Vec<_>>());
            Some((j, -1.0))
        }
        (None, None) => None,
    };
    if let Some((j, power)) = scale {
        for (name, unit, from, factor) in
            [("c_r1", "N m s", "c_r", j * omega), ("tau_c1", "N m", "C11", j * omega * omega)]
        {
            if let Some(i) = at(from) {
                let value = values[i] * factor;
                let gradient: Vec<_> = std::iter::once((i, factor)).chain(by_gravity(power * value)).collect();
                push(name, unit, value, &gradient);
            }
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::{DMatrix, DVector};

    use super::*;

    #[test]
    fn true_coefficients_give_the_plants_parameters() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/single-pendulum.toml")).unwrap();
        let plant = crate::rig::single_plant::SinglePlant::of(&rig).unwrap();
        let names: Vec<String> = ["c_r", "n_cos", "p_cos", "q_sin"].iter().map(|s| (*s).to_owned()).collect();
        let truth = |n: &str| plant.truth(n, rig.omega(), rig.drive.map(|d| d.direction)).unwrap();
        let values = DVector::from_iterator(4, names.iter().map(|n| truth(n)));
        let covariance = DMatrix::from_diagonal(&values.map(|v| (0.01 * v).powi(2)));
        let (values, covariance) = (&values, &covariance);
        let fit = derive(&Identified { names: &names, values, covariance, metric: covariance }, &rig).unwrap();
        for (name, relative) in [("a", 2f64.sqrt() * 0.01), ("J_o1", 0.01), ("c_r1", 2f64.sqrt() * 0.01)] {
            let p = fit.parameters.iter().find(|p| p.name == name).unwrap();
            assert!((p.value / truth(name) - 1.0).abs() < 1e-9, "{name} {}", p.value);
            assert!((p.std_error / p.value - relative).abs() < 1e-9, "{name} {}", p.std_error);
        }
        // An encoder whose zero is off by 0.1 rad turns gravity's torque into two parts.
        let turned: Vec<String> = ["q_cos", "q_sin"].iter().map(|s| (*s).to_owned()).collect();
        let values = DVector::from_vec([0.1_f64.sin(), 0.1_f64.cos()].map(|part| part * truth("q_sin")).to_vec());
        let covariance = &DMatrix::from_diagonal(&DVector::from_vec(vec![0.0, (0.01 * truth("q_sin")).powi(2)]));
        let found = Identified { names: &turned, values: &values, covariance, metric: covariance };
        let fit = derive(&found, &rig).unwrap();
        let j = fit.parameters.iter().find(|p| p.name == "J_o1").unwrap();
        assert!((j.value / truth("J_o1") - 1.0).abs() < 1e-9, "{}", j.value);
        assert!((j.std_error / j.value - 0.01 * 0.1_f64.cos()).abs() < 1e-9, "{}", j.std_error);
    }
}

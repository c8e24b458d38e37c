//! The full system's nonlinear normal mode, computed apart from every reduced model: shooting with
//! continuation in the energy.
//!
//! A motion from rest at x0 that is again at rest after half a period T/2 is periodic, because free
//! motion is reversible. Unknowns x0 and T; equations ẋ(T/2) = 0 and V(x0) = E; Newton's method
//! with difference quotients, started from the secant through the last two members in ln E, first
//! from the linear mode. Floquet multipliers are the eigenvalues of the monodromy matrix over a
//! whole period (central differences): a pair is 1, the others lie on the unit circle where the
//! mode is stable.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::integrate::advance;
use super::systems::Mechanical;

/// Relative local error of the integrations.
const TOLERANCE: f64 = 1e-12;

/// One member of the family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Member {
    /// Energy.
    pub energy: f64,
    /// Angular frequency, rad per unit of time.
    pub omega: f64,
    /// Rest state.
    pub rest: Vec<f64>,
}

/// The slowest mode of the linearised system: angular frequency, shape normalised to xᵀM(0)x = 1,
/// largest entry positive.
pub fn linear_mode(system: &dyn Mechanical) -> Option<(f64, Vec<f64>)> {
    let n = system.size();
    let m = DMatrix::from_row_slice(n, n, &system.mass(&vec![0.0; n]));
    let h = 1e-4;
    let k = DMatrix::from_fn(n, n, |i, j| {
        let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
        up[j] = h;
        down[j] = -h;
        (system.gradient(&up)[i] - system.gradient(&down)[i]) / (2.0 * h)
    });
    let k = (&k + k.transpose()) * 0.5;
    let l = m.cholesky()?.l();
    let inverse = l.clone().try_inverse()?;
    let eigen = (&inverse * k * inverse.transpose()).symmetric_eigen();
    let which = (0..n).min_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]))?;
    let mut shape: Vec<f64> = (inverse.transpose() * eigen.eigenvectors.column(which)).iter().copied().collect();
    let largest = shape.iter().copied().fold(0.0_f64, |l, x| if x.abs() > l.abs() * (1.0 + 1e-9) { x } else { l });
    if largest < 0.0 {
        shape.iter_mut().for_each(|x| *x = -*x);
    }
    let value = eigen.eigenvalues[which];
    (value > 0.0).then(|| (value.sqrt(), shape))
}

/// The state after `time` from (x, v).
pub fn flow(system: &dyn Mechanical, x: &[f64], v: &[f64], time: f64) -> Option<Vec<f64>> {
    let n = x.len();
    let mut y: Vec<f64> = x.iter().chain(v).copied().collect();
    let mut step = time / 20.0;
    let mut f = |_: f64, y: &[f64], d: &mut [f64]| {
        let (x, v) = y.split_at(n);
        let (dx, dv) = d.split_at_mut(n);
        dx.copy_from_slice(v);
        system.acceleration(x, v, dv);
    };
    advance(&mut f, &mut y, 0.0, time, TOLERANCE, &mut step).then_some(y)
}

/// Newton's method for the member of energy E from a guess; None where it does not converge.
fn solve(system: &dyn Mechanical, energy: f64, guess: &Member) -> Option<Member> {
    let n = system.size();
    let mut x = guess.rest.clone();
    let mut half = std::f64::consts::PI / guess.omega;
    let size = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let speed = guess.omega * size;
    let zero = vec![0.0; n];
    for _ in 0..12 {
        let end = flow(system, &x, &zero, half)?;
        let mut a = vec![0.0; n];
        system.acceleration(&end[..n], &end[n..], &mut a);
        let mut jacobian = DMatrix::zeros(n + 1, n + 1);
        let h = 1e-6 * size;
        for j in 0..n {
            let mut near = x.clone();
            near[j] += h;
            let moved = flow(system, &near, &zero, half)?;
            for i in 0..n {
                jacobian[(i, j)] = (moved[n + i] - end[n + i]) / h / speed;
            }
        }
        let gradient = system.gradient(&x);
        for i in 0..n {
            jacobian[(i, n)] = a[i] / speed;
            jacobian[(n, i)] = gradient[i] / energy;
        }
        let mut rhs = DVector::zeros(n + 1);
        for i in 0..n {
            rhs[i] = -end[n + i] / speed;
        }
        rhs[n] = 1.0 - system.potential(&x) / energy;
        let residual = rhs.amax();
        let delta = jacobian.lu().solve(&rhs)?;
        let change = (0..n).fold(0.0_f64, |m, i| m.max(delta[i].abs())) / size;
        if !(change.is_finite() && change < 0.5 && delta[n].abs() < 0.5 * half) {
            return None;
        }
        for i in 0..n {
            x[i] += delta[i];
        }
        half += delta[n];
        if residual < 1e-8 && change < 1e-7 {
            return Some(Member { energy, omega: std::f64::consts::PI / half, rest: x });
        }
    }
    None
}

/// Step in ln E below which the shape must not turn by more than [`TURN`] times the step from the
/// secant through the last members.
const LEAST_STRIDE: f64 = 0.02;
/// Greatest distance from the secant, relative to the shape, for a step of 1 in ln E.
const TURN: f64 = 0.1;

/// The family that starts at the slowest linear mode, at the energies given (each above 0; answered
/// in rising order).
///
/// Where the frequency meets a fraction of a higher mode's, the branch turns off into an internal
/// resonance (a motion of both modes, up which the energy rises too). There the family goes on
/// beyond it, at the first energy at which the extrapolated shape leads to a periodic motion near
/// it; energies in between have no member. It ends where none is found.
pub fn family(system: &dyn Mechanical, energies: &[f64]) -> Vec<Member> {
    let mut wanted: Vec<f64> = energies.iter().copied().filter(|e| *e > 0.0 && e.is_finite()).collect();
    wanted.sort_by(f64::total_cmp);
    let Some((omega, shape)) = linear_mode(system) else { return Vec::new() };
    let mut out = Vec::new();
    let Some(&least) = wanted.first() else { return out };
    // A start so small that the motion is linear: V = ½ω² a².
    let at = |e: f64| -> Member {
        let a = (2.0 * e).sqrt() / omega;
        Member { energy: e, omega, rest: shape.iter().map(|s| a * s).collect() }
    };
    let mut last = at(least.min(*wanted.last().unwrap_or(&least) * 1e-5) * 0.1);
    let mut previous: Option<Member> = None;
    let mut path: Vec<Member> = Vec::new();
    let mut stride = 1.2_f64;
    for goal in wanted {
        let mut steps = 0;
        while last.energy < goal {
            steps += 1;
            if steps > 2000 {
                return out;
            }
            let tried = (goal / last.energy).ln().min(stride);
            let next = if tried < stride { goal } else { last.energy * stride.exp() };
            if let Some(member) = near(system, &last, previous.as_ref(), next) {
                path.push(last.clone());
                previous = Some(std::mem::replace(&mut last, member));
                stride = (1.4 * stride).min(1.2);
            } else if tried > LEAST_STRIDE {
                stride = 0.5 * tried;
            } else {
                // The secant well before the resonance, which bends the last members.
                let before = |share: f64| path.iter().rev().find(|m| m.energy <= share * last.energy);
                let (Some(near_by), Some(far)) = (before(0.85), before(0.6)) else { return out };
                let beyond = (1..=20).find_map(|i| {
                    let energy = last.energy * (f64::from(i) * 0.05).exp();
                    near(system, near_by, Some(far), energy)
                });
                let Some(member) = beyond else { return out };
                last = member;
                previous = None;
                stride = LEAST_STRIDE;
            }
        }
        // A jump may have gone beyond this energy.
        if last.energy == goal {
            out.push(last.clone());
        }
    }
    out
}

/// The member of this energy that lies close to the secant through the last two.
fn near(system: &dyn Mechanical, last: &Member, previous: Option<&Member>, energy: f64) -> Option<Member> {
    let guess = predict(last, previous, energy);
    let member = solve(system, energy, &guess)?;
    let size = member.rest.iter().map(|x| x * x).sum::<f64>().sqrt();
    let off = member.rest.iter().zip(&guess.rest).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    let stride = (energy / last.energy).ln();
    ((member.omega / last.omega - 1.0).abs() < 0.1 && off <= TURN * stride * size).then_some(member)
}

/// Secant in ln E of x0/√E and ω.
fn predict(last: &Member, previous: Option<&Member>, energy: f64) -> Member {
    let root = |m: &Member| m.energy.sqrt();
    let scale = energy.sqrt();
    let share = match previous {
        Some(p) if p.energy < last.energy => (energy / last.energy).ln() / (last.energy / p.energy).ln(),
        _ => 0.0,
    };
    let p = previous.unwrap_or(last);
    let rest = last
        .rest
        .iter()
        .zip(&p.rest)
        .map(|(a, b)| {
            let (a, b) = (a / root(last), b / root(p));
            scale * (a + share * (a - b))
        })
        .collect();
    Member { energy, omega: last.omega + share * (last.omega - p.omega), rest }
}

/// Sizes of the Floquet multipliers of a member, largest first; None where the motion cannot be
/// integrated.
pub fn multipliers(system: &dyn Mechanical, member: &Member) -> Option<Vec<f64>> {
    let n = system.size();
    let period = std::f64::consts::TAU / member.omega;
    let size = member.rest.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let mut monodromy = DMatrix::zeros(2 * n, 2 * n);
    for j in 0..2 * n {
        let scale = if j < n { size } else { size * member.omega };
        let h = 1e-5 * scale;
        let moved = |sign: f64| {
            let mut y: Vec<f64> = member.rest.iter().copied().chain(std::iter::repeat_n(0.0, n)).collect();
            y[j] += sign * h;
            flow(system, &y[..n], &y[n..], period)
        };
        let (up, down) = (moved(1.0)?, moved(-1.0)?);
        for i in 0..2 * n {
            let unit = if i < n { size } else { size * member.omega };
            monodromy[(i, j)] = (up[i] - down[i]) / (2.0 * h) * scale / unit;
        }
    }
    let mut sizes: Vec<f64> = monodromy.complex_eigenvalues().iter().map(|z| z.re.hypot(z.im)).collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    Some(sizes)
}

#[cfg(test)]
mod tests {
    use super::super::systems::{beam::Beam, by_id};
    use super::*;

    #[test]
    fn the_mass_pendulum_hardens_as_known() {
        let system = by_id("mass-pendulum").unwrap();
        let energies: Vec<f64> = [[0.125, 0.385], [0.575, 1.892]].iter().map(|x| system.potential(x)).collect();
        let family = family(&*system, &energies);
        assert!((linear_mode(&*system).unwrap().0 - 13.7237).abs() < 1e-4);
        assert!((family[0].omega - 13.7284).abs() < 1e-4 && (family[1].omega - 14.2423).abs() < 1e-4, "{family:?}");
        assert!((multipliers(&*system, &family[0]).unwrap()[0] - 1.0).abs() < 1e-2);
    }

    #[test]
    fn the_clamped_beams_backbone_is_the_known_one_on_both_sides_of_its_internal_resonance() {
        // The branch meets five times its frequency in the third mode at an amplitude of 2.25; the
        // known points lie on either side.
        let system = by_id("clamped-beam").unwrap();
        let known = [
            (0.20557, 1.00, 1.022259),
            (0.84545, 1.96, 1.081099),
            (2.09678, 2.91, 1.168781),
            (4.24112, 3.86, 1.277112),
        ];
        let members = family(&*system, &known.map(|k| k.0));
        assert_eq!(members.len(), 4);
        for (m, (_, amplitude, omega)) in members.iter().zip(known) {
            assert!((m.omega / omega - 1.0).abs() < 1e-5, "{amplitude}: {} {omega}", m.omega);
            assert!((m.rest[0] * Beam::centre(&[1.0]) - amplitude).abs() < 0.005, "{amplitude}: {:?}", m.rest);
        }
    }
}

//! The polar (action–angle) model: a nonlinear mode as a family of periodic motions x(a, φ) = Σ_k X_k(a) cos kφ, φ̇ = ω(a).
//!
//! a is the first harmonic of the major coordinate. X_k/a and ω are polynomials in s = ln(1 + (a/a0)²), which passes from powers of a² (weak
//! motion) to powers of ln a (strong motion), where polynomials in displacement and velocity stall; a0 and the degree are chosen by
//! leaving out one release at a time, the degree for ω and for the shapes apart. The linear mode, where it is known, is the node s = 0.
//!
//! Where mass and potential are known the frequency is variational (Whitham's averaged Lagrangian ½ω²T2(a) − V̄(a) is stationary):
//! ω² = 2 V̄′(a)/T2′(a), V̄ = ⟨V⟩_φ, T2 = ⟨x_φᵀ M x_φ⟩_φ; an error of the shapes enters squared. Otherwise ω is interpolated, the action is
//! I = ω T2 with the masses taken as 1 (or as given), and E = ∫ ω dI.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::f64::consts::TAU;

use super::release_fit::{ReleaseFit, least_squares};
use super::systems::Mechanical;

/// Phases over which averages are taken.
const PHASES: usize = 128;
/// Highest degree in s.
const MOST_DEGREE: usize = 6;

/// A measured member of the family.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Amplitude.
    pub amplitude: f64,
    /// Angular frequency.
    pub omega: f64,
    /// Relative standard error of the node, for its weight.
    pub error: f64,
    /// X_k/a, `[k][channel]`.
    pub shape: Vec<Vec<f64>>,
}

impl Node {
    /// From a fitted release.
    pub fn of(fit: &ReleaseFit, major: &[f64]) -> Self {
        let a: f64 = fit.cosine[1].iter().zip(major).map(|(x, p)| x * p).sum();
        Self {
            amplitude: a,
            omega: fit.omega,
            error: fit.omega_error / fit.omega,
            shape: fit.cosine.iter().map(|x| x.iter().map(|v| v / a).collect()).collect(),
        }
    }
}

/// The model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Polar {
    /// Weights of the channels in the major coordinate.
    pub major: Vec<f64>,
    /// Scale of the amplitude in s.
    pub a0: f64,
    /// Coefficients of ω² in powers of s.
    pub omega_squared: Vec<f64>,
    /// Coefficients of X_k/a in powers of s, `[k][channel][power]`.
    pub shape: Vec<Vec<Vec<f64>>>,
    /// Amplitudes between which the model was made: it may be used there.
    pub range: [f64; 2],
    /// Greatest relative error of ω at a release that was left out.
    pub left_out: Option<f64>,
    /// Whether even harmonics are kept.
    pub symmetric: bool,
}

/// Polynomial and its derivative.
fn horner(c: &[f64], s: f64) -> (f64, f64) {
    c.iter().rev().fold((0.0, 0.0), |(p, d), a| (p * s + a, d * s + p))
}

/// Coefficients of polynomials of one degree through all quantities of the nodes (columns of `values`).
fn polynomials(s: &[f64], weight: &[f64], values: &DMatrix<f64>, degree: usize) -> Option<Vec<DVector<f64>>> {
    let a = DMatrix::from_fn(s.len(), degree + 1, |i, j| weight[i] * s[i].powi(j as i32));
    (0..values.ncols())
        .map(|q| {
            let b = DVector::from_fn(s.len(), |i, _| weight[i] * values[(i, q)]);
            if degree == 0 { least_squares(&a, &b).map(|r| r.0) } else { solve(&a, &b) }
        })
        .collect()
}

/// Least squares by QR: exact interpolation where there are as many nodes as powers.
fn solve(a: &DMatrix<f64>, b: &DVector<f64>) -> Option<DVector<f64>> {
    let qr = a.clone().qr();
    let rhs = qr.q().transpose() * b;
    let x = qr.r().solve_upper_triangular(&rhs)?;
    x.iter().all(|v| v.is_finite()).then_some(x)
}

fn s_of(a: f64, a0: f64) -> f64 {
    (a / a0).powi(2).ln_1p()
}

/// Makes the model of nodes (at least two of different amplitude), with the linear mode (ω, X_1/a) where it is known.
pub fn model(nodes: &[Node], major: &[f64], linear: Option<(f64, Vec<f64>)>) -> Option<Polar> {
    let channels = major.len();
    let mut nodes: Vec<Node> = nodes.iter().filter(|n| n.amplitude > 0.0 && n.amplitude.is_finite()).cloned().collect();
    nodes.sort_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
    let (first, last) = (nodes.first()?.amplitude, nodes.last()?.amplitude);
    // Even harmonics stay out of a symmetric mode: 1 % of the odd ones is what noise and mixing leave.
    let even: f64 = nodes.iter().flat_map(|n| n.shape.iter().step_by(2).flatten().map(|x| x * x)).sum();
    let odd: f64 = nodes.iter().flat_map(|n| n.shape.iter().skip(1).step_by(2).flatten().map(|x| x * x)).sum();
    let symmetric = even < 1e-4 * odd;
    let harmonics = nodes.iter().map(|n| n.shape.len()).max()?;
    if let Some((omega, shape)) = linear {
        let a: f64 = shape.iter().zip(major).map(|(x, p)| x * p).sum();
        let mut of = vec![vec![0.0; channels]; 2];
        of[1] = shape.iter().map(|x| x / a).collect();
        nodes.insert(0, Node { amplitude: 0.0, omega, error: 0.0, shape: of });
    }
    let values = DMatrix::from_fn(nodes.len(), 1 + harmonics * channels, |i, q| {
        if q == 0 {
            return nodes[i].omega * nodes[i].omega;
        }
        let (k, c) = ((q - 1) / channels, (q - 1) % channels);
        if symmetric && k % 2 == 0 { 0.0 } else { nodes[i].shape.get(k).map_or(0.0, |x| x[c]) }
    });
    // Nodes that are known equally well weigh alike; one ten times worse than the median weighs a tenth.
    let mut errors: Vec<f64> = nodes.iter().map(|n| n.error).collect();
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2].max(1e-9);
    let weight: Vec<f64> = nodes.iter().map(|n| (median / n.error.max(median)).max(0.01)).collect();
    // Left out one at a time, the ends excepted (they would have to be extrapolated): rms and greatest relative error of ω (quantity 0) or
    // of the shapes (all others).
    let score = |a0: f64, degree: usize, of_omega: bool| -> Option<(f64, f64)> {
        let s: Vec<f64> = nodes.iter().map(|n| s_of(n.amplitude, a0)).collect();
        let part = if of_omega { values.columns(0, 1) } else { values.columns(1, values.ncols() - 1) }.into_owned();
        let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
        for out in 1..nodes.len().saturating_sub(1) {
            let keep: Vec<usize> = (0..nodes.len()).filter(|i| *i != out).collect();
            let pick = |v: &[f64]| keep.iter().map(|i| v[*i]).collect::<Vec<f64>>();
            let p = polynomials(&pick(&s), &pick(&weight), &part.select_rows(&keep), degree)?;
            let (mut error, mut size) = (0.0, 0.0);
            for (q, p) in p.iter().enumerate() {
                error += (horner(p.as_slice(), s[out]).0 - part[(out, q)]).powi(2);
                size += part[(out, q)].powi(2);
            }
            let relative = (error / size).sqrt() * if of_omega { 0.5 } else { 1.0 };
            sum += relative * relative;
            count += 1.0;
            worst = worst.max(relative);
        }
        Some(((sum / count).sqrt(), worst)).filter(|e| e.0.is_finite())
    };
    let middle = (first * last).sqrt();
    let scales: Vec<f64> = (-20..=20).map(|n| middle * 10.0_f64.powf(f64::from(n) * 0.075)).collect();
    // Few releases are interpolated: one degree, by the worst of ω and shapes. Many (the windows of decays) are smoothed: ω and shapes
    // each with the degree that predicts best in the mean.
    let few = nodes.len() <= MOST_DEGREE + 2;
    let judged = |a0: f64, degree: usize, of_omega: bool| -> Option<(f64, f64)> {
        let (rms, worst) = score(a0, degree, of_omega)?;
        if few { Some((worst.max(score(a0, degree, false)?.1), worst)) } else { Some((rms, worst)) }
    };
    let choose = |scales: &[f64], of_omega: bool| -> Option<(f64, f64, f64, usize)> {
        let mut best: Option<(f64, f64, f64, usize)> = None;
        for degree in 1..=MOST_DEGREE.min(nodes.len().saturating_sub(2)) {
            for &a0 in scales {
                if let Some((value, worst)) = judged(a0, degree, of_omega)
                    && best.is_none_or(|b| value < b.0)
                {
                    best = Some((value, worst, a0, degree));
                }
            }
        }
        best
    };
    let by_omega = if nodes.len() > 2 { choose(&scales, true) } else { None };
    let (left_out, a0) = by_omega.map_or((None, middle), |b| (Some(b.1), b.2));
    // What served best without one node goes up by one degree with it, where every node then is met.
    let full = |d: usize| if d + 2 == nodes.len() { d + 1 } else { d }.min(nodes.len() - 1);
    let degree = full(by_omega.map_or(1, |b| b.3));
    let shape_degree = if few { degree } else { full(choose(&[a0], false).map_or(1, |b| b.3)) };
    let s: Vec<f64> = nodes.iter().map(|n| s_of(n.amplitude, a0)).collect();
    let mut p = polynomials(&s, &weight, &values.columns(0, 1).into_owned(), degree)?;
    p.extend(polynomials(&s, &weight, &values.columns(1, values.ncols() - 1).into_owned(), shape_degree)?);
    let shape = (0..harmonics)
        .map(|k| (0..channels).map(|c| p[1 + k * channels + c].iter().copied().collect()).collect())
        .collect();
    let low = if nodes[0].amplitude == 0.0 { 0.0 } else { first };
    Some(Polar {
        major: major.to_vec(),
        a0,
        omega_squared: p[0].iter().copied().collect(),
        shape,
        range: [low, last],
        left_out,
        symmetric,
    })
}

impl Polar {
    /// Interpolated ω(a).
    pub fn omega(&self, a: f64) -> f64 {
        horner(&self.omega_squared, s_of(a, self.a0)).0.max(0.0).sqrt()
    }

    /// X_k(a), `[k][channel]`.
    pub fn harmonics(&self, a: f64) -> Vec<Vec<f64>> {
        let s = s_of(a, self.a0);
        self.shape.iter().map(|x| x.iter().map(|c| a * horner(c, s).0).collect()).collect()
    }

    /// dX_k/da.
    fn slopes(&self, a: f64) -> Vec<Vec<f64>> {
        let s = s_of(a, self.a0);
        // ds/da = 2a/(a0² + a²).
        let ds = 2.0 * a / (self.a0 * self.a0 + a * a);
        self.shape
            .iter()
            .map(|x| {
                x.iter()
                    .map(|c| {
                        let (p, d) = horner(c, s);
                        p + a * d * ds
                    })
                    .collect()
            })
            .collect()
    }

    /// The displacements of all channels at amplitude a and phase φ.
    pub fn displacement(&self, a: f64, phi: f64) -> Vec<f64> {
        sum(&self.harmonics(a), |k| (k as f64 * phi).cos())
    }

    /// T2(a) = ⟨x_φᵀ x_φ⟩ weighted by masses of the channels (1 where none are given).
    pub fn inertia(&self, a: f64, masses: Option<&[f64]>) -> f64 {
        let x = self.harmonics(a);
        let mass = |c: usize| masses.and_then(|m| m.get(c)).copied().unwrap_or(1.0);
        x.iter()
            .enumerate()
            .map(|(k, x)| 0.5 * (k * k) as f64 * x.iter().enumerate().map(|(c, v)| mass(c) * v * v).sum::<f64>())
            .sum()
    }

    /// The variational frequency, ω² = 2 V̄′/T2′; None where the averages do not give one.
    pub fn variational_omega(&self, system: &dyn Mechanical, a: f64) -> Option<f64> {
        // Averages over half a turn: the motion retraces itself.
        let (x, dx) = (self.harmonics(a), self.slopes(a));
        let n = self.major.len();
        let (mut v, mut t) = (0.0, 0.0);
        for i in 0..PHASES {
            let phi = 0.5 * TAU * (i as f64 + 0.5) / PHASES as f64;
            let at = sum(&x, |k| (k as f64 * phi).cos());
            let da = sum(&dx, |k| (k as f64 * phi).cos());
            let turn = sum(&x, |k| -(k as f64) * (k as f64 * phi).sin());
            let turn_da = sum(&dx, |k| -(k as f64) * (k as f64 * phi).sin());
            v += system.gradient(&at).iter().zip(&da).map(|(g, d)| g * d).sum::<f64>();
            let m = system.mass(&at);
            // The mass matrix changes along x_a: by a difference quotient in that direction.
            let h = 1e-5;
            let moved =
                |sign: f64| system.mass(&at.iter().zip(&da).map(|(x, d)| x + sign * h * a * d).collect::<Vec<f64>>());
            let (up, down) = (moved(1.0), moved(-1.0));
            for p in 0..n {
                for q in 0..n {
                    let dm = (up[p * n + q] - down[p * n + q]) / (2.0 * h * a);
                    t += 2.0 * turn[p] * m[p * n + q] * turn_da[q] + turn[p] * dm * turn[q];
                }
            }
        }
        let square = 2.0 * v / t;
        (square > 0.0 && square.is_finite()).then(|| square.sqrt())
    }

    /// The variational frequency, corrected by what it misses at the nodes (interpolated linearly in s): at a node the measured frequency.
    ///
    /// The variational one errs where the shapes' slopes are poorest, at the ends of the range; the nodes know better.
    pub fn corrected_omega(&self, system: &dyn Mechanical, nodes: &[Node], a: f64) -> Option<f64> {
        let omega = self.variational_omega(system, a)?;
        let mut ratio: Vec<(f64, f64)> = nodes
            .iter()
            .filter_map(|n| Some((s_of(n.amplitude, self.a0), n.omega / self.variational_omega(system, n.amplitude)?)))
            .collect();
        if self.range[0] == 0.0 {
            ratio.push((0.0, 1.0));
        }
        ratio.sort_by(|a, b| a.0.total_cmp(&b.0));
        let s = s_of(a, self.a0);
        let (first, last) = (ratio.first()?, ratio.last()?);
        let factor = if s <= first.0 {
            first.1
        } else if s >= last.0 {
            last.1
        } else {
            let w = ratio.windows(2).find(|w| s <= w[1].0)?;
            w[0].1 + (w[1].1 - w[0].1) * (s - w[0].0) / (w[1].0 - w[0].0).max(1e-300)
        };
        Some(omega * factor)
    }

    /// Energy by E = ∫ ω dI from rest, at rising amplitudes.
    pub fn energies(&self, amplitudes: &[f64], masses: Option<&[f64]>) -> Vec<f64> {
        let steps = 400;
        let (mut energy, mut at, mut action) = (0.0, 0.0, 0.0);
        amplitudes
            .iter()
            .map(|&to| {
                for i in 1..=steps {
                    let a = at + (to - at) * f64::from(i) / f64::from(steps);
                    let before = at + (to - at) * f64::from(i - 1) / f64::from(steps);
                    let next = self.omega(a) * self.inertia(a, masses);
                    energy += self.omega(0.5 * (a + before)) * (next - action);
                    action = next;
                }
                at = to;
                energy
            })
            .collect()
    }

    /// The amplitude whose rest state has this major coordinate; None outside of three times the range.
    pub fn amplitude_of(&self, rest: &[f64]) -> Option<f64> {
        let want: f64 = rest.iter().zip(&self.major).map(|(x, p)| x * p).sum::<f64>().abs();
        let height = |a: f64| self.displacement(a, 0.0).iter().zip(&self.major).map(|(x, p)| x * p).sum::<f64>();
        bisect(height, want, 3.0 * self.range[1])
    }

    /// The amplitude whose rest state has this potential energy.
    pub fn amplitude_at(&self, system: &dyn Mechanical, energy: f64) -> Option<f64> {
        bisect(|a| system.potential(&self.displacement(a, 0.0)), energy, 3.0 * self.range[1])
    }
}

/// Σ_k w_k X_k.
fn sum(x: &[Vec<f64>], w: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut out = vec![0.0; x.first().map_or(0, Vec::len)];
    for (k, x) in x.iter().enumerate() {
        let w = w(k);
        for (o, v) in out.iter_mut().zip(x) {
            *o += w * v;
        }
    }
    out
}

/// The point in (0, most) at which a rising function reaches a value.
pub fn bisect(f: impl Fn(f64) -> f64, value: f64, most: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, most);
    if !(value.is_finite() && value >= 0.0) || f(high) < value {
        return None;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if f(middle) < value { low = middle } else { high = middle }
    }
    Some(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::super::normal_mode::{family, linear_mode};
    use super::super::systems::by_id;
    use super::*;

    /// Nodes from the full system's own periodic motions, resolved into harmonics over one period.
    fn exact_nodes(id: &str, energies: &[f64], major: &[f64]) -> Vec<Node> {
        let system = by_id(id).unwrap();
        family(&*system, 0, energies)
            .iter()
            .map(|m| {
                let n = system.size();
                let period = TAU / m.omega;
                let samples = 64;
                let mut x = vec![vec![0.0; n]; 16];
                for i in 0..samples {
                    let t = period * i as f64 / samples as f64;
                    let at = super::super::normal_mode::flow(&*system, &m.rest, &vec![0.0; n], t).unwrap();
                    for (k, x) in x.iter_mut().enumerate() {
                        for c in 0..n {
                            x[c] += 2.0 / samples as f64 * at[c] * (k as f64 * TAU * i as f64 / samples as f64).cos();
                        }
                    }
                }
                x[0].iter_mut().for_each(|v| *v = 0.0);
                let a: f64 = x[1].iter().zip(major).map(|(x, p)| x * p).sum();
                let shape = x.iter().map(|x| x.iter().map(|v| v / a).collect()).collect();
                Node { amplitude: a, omega: m.omega, error: 1e-9, shape }
            })
            .collect()
    }

    #[test]
    fn the_variational_frequency_is_the_shooting_one_and_energy_is_the_actions() {
        let system = by_id("mass-pendulum").unwrap();
        let energies: Vec<f64> = [25.0, 90.0, 190.0, 330.0, 480.0].to_vec();
        let major = [0.2838, 0.9589];
        let nodes = exact_nodes("mass-pendulum", &energies, &major);
        let (omega, shape) = linear_mode(&*system, 0).unwrap();
        let polar = model(&nodes, &major, Some((omega, shape))).unwrap();
        for member in family(&*system, 0, &[40.0, 140.0, 260.0, 400.0]) {
            let a = polar.amplitude_at(&*system, member.energy).unwrap();
            let omega = polar.variational_omega(&*system, a).unwrap();
            assert!((omega / member.omega - 1.0).abs() < 2e-5, "{} {}", omega, member.omega);
            assert!((polar.omega(a) / member.omega - 1.0).abs() < 3e-4);
        }
    }

    #[test]
    fn a_duffing_oscillators_energy_follows_from_displacements_alone() {
        // x″ + x + x³ = 0: E(rest) = x²/2 + x⁴/4 against ∫ω dI.
        let member = |x0: f64| -> Node {
            let n = 4096;
            let mut y = vec![x0, 0.0];
            let mut f = |_: f64, y: &[f64], d: &mut [f64]| {
                d[0] = y[1];
                d[1] = -y[0] - y[0].powi(3);
            };
            // Quarter period by bisection on x = 0.
            let mut step = 0.1;
            let mut at = |t: f64| {
                y = vec![x0, 0.0];
                super::super::integrate::advance(&mut f, &mut y, 0.0, t, 1e-12, &mut step);
                y[0]
            };
            let (mut low, mut high) = (0.0, 2.0);
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                if at(middle) > 0.0 { low = middle } else { high = middle }
            }
            let period = 4.0 * low;
            let _ = n;
            let mut x = vec![vec![0.0]; 12];
            for i in 0..64 {
                let v = at(period * f64::from(i) / 64.0);
                for (k, x) in x.iter_mut().enumerate() {
                    x[0] += 2.0 / 64.0 * v * (k as f64 * TAU * f64::from(i) / 64.0).cos();
                }
            }
            x[0][0] = 0.0;
            let a = x[1][0];
            Node { amplitude: a, omega: TAU / period, error: 1e-9, shape: x.iter().map(|x| vec![x[0] / a]).collect() }
        };
        let nodes: Vec<Node> = [0.2, 0.5, 0.9, 1.4, 2.0].iter().map(|x| member(*x)).collect();
        let polar = model(&nodes, &[1.0], Some((1.0, vec![1.0]))).unwrap();
        for x0 in [0.3_f64, 0.7, 1.2, 1.8] {
            let a = polar.amplitude_of(&[x0]).unwrap();
            let energy = polar.energies(&[a], None)[0];
            let want = 0.5 * x0 * x0 + 0.25 * x0.powi(4);
            assert!((energy / want - 1.0).abs() < 2e-3, "{x0}: {energy} {want}");
        }
    }
}

//! The full system's forced, damped response, computed apart from every reduced model: harmonic
//! balance with pseudo-arclength continuation.
//!
//! M(x)(ẍ − a(x, ẋ)) + c M(x) ẋ = F b cos Ωt, a the free acceleration, x = Σ_k C_k cos kΩt + S_k
//! sin kΩt over odd k: the system must be symmetric in x. Residuals by alternating between time and
//! frequency (T. M. Cameron, J. H. Griffin, *Journal of Applied Mechanics* 56, 1989), over half a
//! period with twice as many samples as the highest harmonic plus two, so that cubic terms do not
//! alias; Newton's method with the step along the tangent held fixed. Steps adapt to the tangent's
//! turning: coarse ones jump to other branches and show folds that are none. A fold is where Ω
//! turns; it is found by the secant of the tangent's part along Ω.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

use super::forced_response::{ForcedResponse, Forcing, Point};
use super::systems::Mechanical;

/// How to follow the response.
#[derive(Clone, Debug, PartialEq)]
pub struct Continuation {
    /// Highest harmonic, odd.
    pub harmonic: usize,
    /// First and last angular frequency.
    pub from: f64,
    /// The curve ends where Ω passes this.
    pub to: f64,
    /// Scale of the amplitudes (length of a mode's shape times its greatest amplitude), and of Ω:
    /// the expected shift of the resonance.
    pub scale: [f64; 2],
    /// Longest step in those scales.
    pub step: f64,
}

struct Problem<'a> {
    system: &'a dyn Mechanical,
    forcing: &'a Forcing,
    n: usize,
    harmonic: usize,
    scale: [f64; 2],
}

/// Cosine and sine of kφ and their part in velocity and acceleration, for one sample.
struct Basis {
    at: Vec<f64>,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
}

impl Problem<'_> {
    /// Unknowns without Ω.
    fn size(&self) -> usize {
        (self.harmonic + 1) * self.n
    }

    fn samples(&self) -> usize {
        2 * (self.harmonic + 1)
    }

    fn basis(&self, sample: usize, omega: f64) -> Basis {
        let phi = PI * sample as f64 / self.samples() as f64;
        let (mut at, mut velocity, mut acceleration) = (Vec::new(), Vec::new(), Vec::new());
        for k in (1..=self.harmonic).step_by(2) {
            let (s, c) = (k as f64 * phi).sin_cos();
            let w = k as f64 * omega;
            at.extend([c, s]);
            velocity.extend([-w * s, w * c]);
            acceleration.extend([-w * w * c, -w * w * s]);
        }
        Basis { at, velocity, acceleration }
    }

    fn balance(&self, x: &[f64], v: &[f64], a: &[f64], push: f64, out: &mut [f64]) {
        let n = self.n;
        let mut free = vec![0.0; n];
        self.system.acceleration(x, v, &mut free);
        let m = self.system.mass(x);
        let rest: Vec<f64> = (0..n).map(|i| a[i] - free[i] + self.forcing.damping * v[i]).collect();
        for i in 0..n {
            let inertia: f64 = m[i * n..(i + 1) * n].iter().zip(&rest).map(|(m, r)| m * r).sum();
            out[i] = inertia - push * self.forcing.shape[i];
        }
    }

    /// ∂r/∂x and ∂r/∂ẋ by central differences (∂r/∂ẍ is M).
    fn slopes(
        &self,
        x: &[f64],
        v: &[f64],
        a: &[f64],
        push: f64,
        mass: &[f64],
        omega: f64,
    ) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = self.n;
        let h = 1e-6 * self.scale[0];
        let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
        let (mut by_x, mut by_v) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        let constant = self.system.constant_mass();
        let moved = |x: &[f64], j: usize, h: f64| {
            let mut x = x.to_vec();
            x[j] += h;
            x
        };
        for j in 0..n {
            if constant {
                self.system.acceleration(&moved(x, j, h), v, &mut up);
                self.system.acceleration(&moved(x, j, -h), v, &mut down);
                (0..n).for_each(|i| by_x[(i, j)] = (down[i] - up[i]) / (2.0 * h));
                continue;
            }
            self.balance(&moved(x, j, h), v, a, push, &mut up);
            self.balance(&moved(x, j, -h), v, a, push, &mut down);
            (0..n).for_each(|i| by_x[(i, j)] = (up[i] - down[i]) / (2.0 * h));
            self.balance(x, &moved(v, j, h * omega), a, push, &mut up);
            self.balance(x, &moved(v, j, -h * omega), a, push, &mut down);
            (0..n).for_each(|i| by_v[(i, j)] = (up[i] - down[i]) / (2.0 * h * omega));
        }
        if constant {
            let m = DMatrix::from_row_slice(n, n, mass);
            by_x = &m * by_x;
            by_v = m * self.forcing.damping;
        }
        (by_x, by_v)
    }

    /// Residual and its derivatives by the unknowns and Ω, in scaled unknowns u (the last is Ω).
    fn linearise(&self, u: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let (n, size, samples) = (self.n, self.size(), self.samples());
        let omega = u[size] * self.scale[1];
        let terms = self.harmonic + 1;
        let mut residual = DVector::zeros(size);
        let mut jacobian = DMatrix::zeros(size, size + 1);
        for sample in 0..samples {
            let basis = self.basis(sample, omega);
            let of = |b: &[f64]| -> Vec<f64> {
                (0..n).map(|i| self.scale[0] * (0..terms).map(|t| b[t] * u[t * n + i]).sum::<f64>()).collect()
            };
            let (x, v, a) = (of(&basis.at), of(&basis.velocity), of(&basis.acceleration));
            let push = self.forcing.amplitude * basis.at[0];
            let mut r = vec![0.0; n];
            self.balance(&x, &v, &a, push, &mut r);
            let mass = self.system.mass(&x);
            let (by_x, by_v) = self.slopes(&x, &v, &a, push, &mass, omega);
            // v goes with Ω, a with Ω².
            let by_omega: Vec<f64> = (0..n)
                .map(|i| {
                    (0..n).map(|j| (by_v[(i, j)] * v[j] + 2.0 * mass[i * n + j] * a[j]) / omega).sum::<f64>()
                        * self.scale[1]
                })
                .collect();
            for t in 0..terms {
                let w = 2.0 * basis.at[t] / samples as f64;
                for i in 0..n {
                    residual[t * n + i] += w * r[i];
                    jacobian[(t * n + i, size)] += w * by_omega[i];
                }
                for s in 0..terms {
                    let (x, v, a) = (w * basis.at[s], w * basis.velocity[s], w * basis.acceleration[s]);
                    for j in 0..n {
                        for i in 0..n {
                            jacobian[(t * n + i, s * n + j)] +=
                                self.scale[0] * (x * by_x[(i, j)] + v * by_v[(i, j)] + a * mass[i * n + j]);
                        }
                    }
                }
            }
        }
        (residual, jacobian)
    }

    /// Newton's method from a guess in the plane across the tangent; the solution with its tangent,
    /// and how many rounds it took.
    fn correct(&self, guess: &DVector<f64>, tangent: &DVector<f64>) -> Option<(DVector<f64>, DVector<f64>, usize)> {
        let size = self.size();
        let mut u = guess.clone();
        for round in 1..=8 {
            let (residual, jacobian) = self.linearise(&u);
            let mut bordered = DMatrix::zeros(size + 1, size + 1);
            bordered.view_mut((0, 0), (size, size + 1)).copy_from(&jacobian);
            bordered.row_mut(size).copy_from(&tangent.transpose());
            let mut rhs = DMatrix::zeros(size + 1, 2);
            rhs.view_mut((0, 0), (size, 1)).copy_from(&-residual);
            rhs[(size, 0)] = tangent.dot(&(guess - &u));
            rhs[(size, 1)] = 1.0;
            let solved = bordered.lu().solve(&rhs)?;
            u += solved.column(0);
            if !u.iter().all(|v| v.is_finite()) {
                return None;
            }
            if solved.column(0).amax() < 1e-9 {
                return Some((u, solved.column(1).normalize(), round));
            }
        }
        None
    }

    fn point(&self, u: &DVector<f64>, major: &[f64]) -> Point {
        let dot = |t: usize| -> f64 { (0..self.n).map(|i| u[t * self.n + i] * major[i]).sum::<f64>() * self.scale[0] };
        let (c, s) = (dot(0), dot(1));
        Point { omega: u[self.size()] * self.scale[1], amplitude: c.hypot(s), lag: s.atan2(c) }
    }
}

/// Follows the response from `from` to `to`; amplitudes are the first harmonic's of the coordinate
/// with weights `major`.
///
/// None where the first point is not found or the curve does not reach `to` within 20 000 steps.
pub fn response(
    system: &dyn Mechanical,
    forcing: &Forcing,
    major: &[f64],
    settings: &Continuation,
) -> Option<ForcedResponse> {
    let problem =
        Problem { system, forcing, n: system.size(), harmonic: settings.harmonic.max(1) | 1, scale: settings.scale };
    let size = problem.size();
    let mut start = DVector::zeros(size + 1);
    start[size] = settings.from / settings.scale[1];
    let direction = (settings.to - settings.from).signum();
    let mut along = DVector::zeros(size + 1);
    along[size] = direction;
    // Ω is held for the first point.
    let (mut u, mut tangent, _) = problem.correct(&start, &along)?;
    let mut out = ForcedResponse { curve: vec![problem.point(&u, major)], folds: Vec::new() };
    let mut step = 0.1 * settings.step;
    for _ in 0..20_000 {
        let omega = u[size] * settings.scale[1];
        if (omega - settings.to) * direction >= 0.0 {
            return Some(out);
        }
        let found = problem.correct(&(&u + step * &tangent), &tangent);
        // The curve must not turn by more than a tenth over a step.
        let Some((next, turned, rounds)) = found.filter(|f| f.1.dot(&tangent) > 0.995) else {
            step *= 0.5;
            if step < 1e-9 {
                return None;
            }
            continue;
        };
        if turned[size] * tangent[size] < 0.0 {
            out.folds.push(problem.fold(&u, &tangent, &turned, step, major)?);
        }
        out.curve.push(problem.point(&next, major));
        (u, tangent) = (next, turned);
        if rounds <= 3 {
            step = (1.3 * step).min(settings.step);
        }
    }
    None
}

impl Problem<'_> {
    /// Where the tangent's part along Ω is 0 within a step from u.
    fn fold(
        &self,
        u: &DVector<f64>,
        tangent: &DVector<f64>,
        turned: &DVector<f64>,
        step: f64,
        major: &[f64],
    ) -> Option<Point> {
        let size = self.size();
        let (mut low, mut high) = ((0.0, tangent[size]), (step, turned[size]));
        let mut best = u.clone();
        for _ in 0..8 {
            let s = (low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1)).clamp(0.0, step);
            let (next, t, _) = self.correct(&(u + s * tangent), tangent)?;
            best = next;
            if (s - low.0).abs() < 1e-7 * step || (s - high.0).abs() < 1e-7 * step || t[size] == 0.0 {
                break;
            }
            if t[size] * low.1 > 0.0 { low = (s, t[size]) } else { high = (s, t[size]) }
        }
        Some(self.point(&best, major))
    }
}

#[cfg(test)]
mod tests {
    use super::super::systems::Mechanical;
    use super::*;

    /// ẍ + x + x³ = … : a Duffing oscillator.
    struct Duffing;

    impl Mechanical for Duffing {
        fn coordinates(&self) -> Vec<String> {
            vec!["x".into()]
        }
        fn mass(&self, _x: &[f64]) -> Vec<f64> {
            vec![1.0]
        }
        fn potential(&self, x: &[f64]) -> f64 {
            0.5 * x[0] * x[0] + 0.25 * x[0].powi(4)
        }
        fn gradient(&self, x: &[f64]) -> Vec<f64> {
            vec![x[0] + x[0].powi(3)]
        }
        fn acceleration(&self, x: &[f64], _v: &[f64], out: &mut [f64]) {
            out[0] = -x[0] - x[0].powi(3);
        }
    }

    #[test]
    fn a_duffing_oscillators_folds_are_those_of_its_amplitude_equation() {
        let forcing = Forcing { amplitude: 0.02, shape: vec![1.0], damping: 0.02 };
        let settings = Continuation { harmonic: 1, from: 0.8, to: 1.8, scale: [1.0, 0.3], step: 0.02 };
        let response = response(&Duffing, &forcing, &[1.0], &settings).unwrap();
        assert_eq!(response.folds.len(), 2, "{:?}", response.folds);
        // One harmonic: ((1 + ¾a² − Ω²)² + c²Ω²) a² = F².
        for p in &response.curve {
            let left = ((1.0 + 0.75 * p.amplitude.powi(2) - p.omega.powi(2)).powi(2) + (0.02 * p.omega).powi(2)).sqrt();
            assert!((left * p.amplitude / 0.02 - 1.0).abs() < 1e-7, "{p:?}");
        }
        let frequency = |a: f64, side: f64| -> f64 {
            // Ω² by its quadratic equation.
            let (b, c) = (1.0 + 0.75 * a * a, 0.02_f64.powi(2));
            let half = b - 0.5 * c;
            let root = (half * half - b * b + (0.02 / a).powi(2)).max(0.0).sqrt();
            (half + side * root).sqrt()
        };
        let fold = response.folds[1];
        let least = (1..4000).map(|i| frequency(0.0002 * f64::from(i), 1.0)).fold(f64::INFINITY, f64::min);
        assert!((fold.omega / least - 1.0).abs() < 1e-6, "{fold:?} {least}");
    }
}

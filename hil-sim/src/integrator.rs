//! An embedded Runge–Kutta integrator of order 8 with adaptive steps.
//!
//! Method: Dormand and Prince's 8(5,3) pair in the form of E. Hairer, S. P. Nørsett, G.
//! Wanner, *Solving Ordinary Differential Equations I*, second edition, 1993, section II.10
//! (DOP853): twelve stages, error estimates of orders 5 and 3 combined into
//! `h·e5²/√(e5² + e3²/100)`. There is no dense output: whoever needs the solution at a time (a
//! sample, the instant at which friction changes its sign) ends a step there, which costs twelve
//! evaluations and keeps order 8.
//!
//! Time in s, states in the caller's units. Every loop is bounded and a value that is not finite is
//! an error, so that integration ends on any input.

/// Why an integration ended early.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum IntegrationError {
    /// A state or a derivative became infinite or not a number.
    #[error("the state is no longer finite {seconds} s into the interval")]
    NotFinite {
        /// Time at which it was seen.
        seconds: f64,
    },
    /// The step size fell below the resolution of the time, or more than [`MAX_STEPS`] steps were
    /// needed.
    #[error("no step is small enough {seconds} s into the interval: the system is too stiff for this integrator")]
    TooStiff {
        /// Time at which it was seen.
        seconds: f64,
    },
    /// Dry friction changed its state more often than any mechanism does (see [`crate::plant`]).
    #[error("dry friction changed its state {events} times within one sampling interval")]
    Chatter {
        /// Changes counted.
        events: u32,
    },
}

/// Most steps, accepted or not, within one call of [`Integrator::advance`].
pub const MAX_STEPS: u32 = 10_000;
/// Smallest step, s.
const SMALLEST_STEP: f64 = 1e-15;
const SAFETY: f64 = 0.9;
const GROW: f64 = 6.0;
const SHRINK: f64 = 0.2;

/// Admissible local error of each state: `absolute + relative·|y|`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance<const N: usize> {
    /// In the state's unit.
    pub absolute: [f64; N],
    /// Share of the state's size. 0 for angles that whirl, lest the tolerance grow with the turns.
    pub relative: [f64; N],
}

/// A system and the step size that it needs.
#[derive(Clone, Debug)]
pub struct Integrator<const N: usize> {
    tolerance: Tolerance<N>,
    next_step: f64,
}

/// One accepted step.
#[derive(Clone, Copy, Debug)]
pub struct Step<const N: usize> {
    /// Length, s.
    pub h: f64,
    /// Derivative at the start.
    pub start_rate: [f64; N],
    /// State at the end.
    pub end: [f64; N],
}

impl<const N: usize> Integrator<N> {
    /// An integrator that has taken no step yet.
    pub fn new(tolerance: Tolerance<N>) -> Self {
        Self { tolerance, next_step: f64::INFINITY }
    }

    /// One accepted step from (t, y), at most `longest` long.
    ///
    /// # Errors
    /// [`IntegrationError::NotFinite`] and [`IntegrationError::TooStiff`].
    pub fn step(
        &mut self,
        mut f: impl FnMut(f64, &[f64; N]) -> [f64; N],
        t: f64,
        y: &[f64; N],
        longest: f64,
    ) -> Result<Step<N>, IntegrationError> {
        let start_rate = f(t, y);
        if !(start_rate.iter().chain(y).all(|v| v.is_finite()) && longest.is_finite()) {
            return Err(IntegrationError::NotFinite { seconds: t });
        }
        let mut h = longest.min(self.next_step);
        let mut rejected = false;
        // A rejected step shrinks by at least 0.9; 400 of them pass from years to the smallest
        // step.
        for _ in 0..400 {
            let (end, error) = stages(&mut f, t, y, &start_rate, h, &self.tolerance);
            if error <= 1.0 {
                let grow = if error > 0.0 { (SAFETY / eighth_root(error)).clamp(SHRINK, GROW) } else { GROW };
                let grow = if rejected { grow.min(1.0) } else { grow };
                // A step cut short by `longest` says little about longer ones, but never asks for a
                // shorter one.
                self.next_step =
                    if h < self.next_step && grow >= 1.0 { self.next_step.max(h * grow) } else { h * grow };
                return Ok(Step { h, start_rate, end });
            }
            rejected = true;
            // An infinite or undefined error means that the step left the domain: shrink as far as
            // allowed.
            let shrink = if error.is_finite() { (SAFETY / eighth_root(error)).clamp(SHRINK, 0.9) } else { SHRINK };
            h *= shrink;
            if h < SMALLEST_STEP {
                return Err(if error.is_finite() {
                    IntegrationError::TooStiff { seconds: t }
                } else {
                    IntegrationError::NotFinite { seconds: t }
                });
            }
        }
        Err(IntegrationError::TooStiff { seconds: t })
    }

    /// The state a given short time later, by one step without error control. For times inside an
    /// accepted step.
    pub fn inside(
        &self,
        mut f: impl FnMut(f64, &[f64; N]) -> [f64; N],
        t: f64,
        y: &[f64; N],
        start_rate: &[f64; N],
        h: f64,
    ) -> [f64; N] {
        stages(&mut f, t, y, start_rate, h, &self.tolerance).0
    }

    /// The state at `end`, starting from `y` at `start`, for a smooth system.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn advance(
        &mut self,
        mut f: impl FnMut(f64, &[f64; N]) -> [f64; N],
        start: f64,
        end: f64,
        y: &[f64; N],
    ) -> Result<[f64; N], IntegrationError> {
        let (mut t, mut y) = (start, *y);
        for _ in 0..MAX_STEPS {
            let left = end - t;
            if left <= 0.0 {
                return Ok(y);
            }
            let step = self.step(&mut f, t, &y, left)?;
            t = if step.h >= left { end } else { t + step.h };
            y = step.end;
        }
        Err(IntegrationError::TooStiff { seconds: t })
    }
}

/// error^(1/8), by square roots, which are the same on every machine.
fn eighth_root(error: f64) -> f64 {
    error.sqrt().sqrt().sqrt()
}

/// The twelve stages: state after h and its error in units of the tolerance.
fn stages<const N: usize>(
    f: &mut impl FnMut(f64, &[f64; N]) -> [f64; N],
    t: f64,
    y: &[f64; N],
    start_rate: &[f64; N],
    h: f64,
    tolerance: &Tolerance<N>,
) -> ([f64; N], f64) {
    let mut k = [[0.0; N]; 12];
    k[0] = *start_rate;
    for stage in 1..12 {
        let mut at = *y;
        for i in 0..N {
            let mut sum = 0.0;
            for &(j, a) in A[stage] {
                sum += a * k[j][i];
            }
            at[i] += h * sum;
        }
        k[stage] = f(t + C[stage] * h, &at);
    }
    let mut end = *y;
    let (mut e5, mut e3) = (0.0, 0.0);
    for i in 0..N {
        let (mut sum, mut sum5, mut sum3) = (0.0, 0.0, 0.0);
        for j in 0..12 {
            sum += B[j] * k[j][i];
            sum5 += E5[j] * k[j][i];
            sum3 += E3[j] * k[j][i];
        }
        end[i] += h * sum;
        let scale = tolerance.absolute[i] + tolerance.relative[i] * y[i].abs().max(end[i].abs());
        e5 += (sum5 / scale) * (sum5 / scale);
        e3 += (sum3 / scale) * (sum3 / scale);
    }
    let error = if e5 == 0.0 { 0.0 } else { h * e5 / ((e5 + 0.01 * e3) * N as f64).sqrt() };
    let finite = end.iter().all(|v| v.is_finite()) && error.is_finite();
    (end, if finite { error } else { f64::INFINITY })
}

type Row = &'static [(usize, f64)];
const A: [Row; 12] = [
    &[],
    &[(0, 0.05260015195876773)],
    &[(0, 0.0197250569845379), (1, 0.0591751709536137)],
    &[(0, 0.02958758547680685), (2, 0.08876275643042054)],
    &[(0, 0.2413651341592667), (2, -0.8845494793282861), (3, 0.924834003261792)],
    &[(0, 0.037037037037037035), (3, 0.17082860872947386), (4, 0.12546768756682242)],
    &[(0, 0.037109375), (3, 0.17025221101954405), (4, 0.06021653898045596), (5, -0.017578125)],
    &[
        (0, 0.03709200011850479),
        (3, 0.17038392571223998),
        (4, 0.10726203044637328),
        (5, -0.015319437748624402),
        (6, 0.008273789163814023),
    ],
    &[
        (0, 0.6241109587160757),
        (3, -3.3608926294469414),
        (4, -0.868219346841726),
        (5, 27.59209969944671),
        (6, 20.154067550477894),
        (7, -43.48988418106996),
    ],
    &[
        (0, 0.47766253643826434),
        (3, -2.4881146199716677),
        (4, -0.590290826836843),
        (5, 21.230051448181193),
        (6, 15.279233632882423),
        (7, -33.28821096898486),
        (8, -0.020331201708508627),
    ],
    &[
        (0, -0.9371424300859873),
        (3, 5.186372428844064),
        (4, 1.0914373489967295),
        (5, -8.149787010746927),
        (6, -18.52006565999696),
        (7, 22.739487099350505),
        (8, 2.4936055526796523),
        (9, -3.0467644718982196),
    ],
    &[
        (0, 2.273310147516538),
        (3, -10.53449546673725),
        (4, -2.0008720582248625),
        (5, -17.9589318631188),
        (6, 27.94888452941996),
        (7, -2.8589982771350235),
        (8, -8.87285693353063),
        (9, 12.360567175794303),
        (10, 0.6433927460157636),
    ],
];
const C: [f64; 12] = [
    0.0,
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
];
const B: [f64; 12] = [
    0.054293734116568765,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    0.3111643669578199,
    -0.1521609496625161,
    0.20136540080403034,
    0.04471061572777259,
];
const E5: [f64; 12] = [
    0.01312004499419488,
    0.0,
    0.0,
    0.0,
    0.0,
    -1.2251564463762044,
    -0.4957589496572502,
    1.6643771824549864,
    -0.35032884874997366,
    0.3341791187130175,
    0.08192320648511571,
    -0.022355307863886294,
];
const E3: [f64; 12] = [
    -0.18980075407240762,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    -0.4226823213237919,
    -0.1521609496625161,
    0.20136540080403034,
    0.02265179219836082,
];

#[cfg(test)]
mod tests {
    use super::*;

    fn tolerance<const N: usize>(value: f64) -> Tolerance<N> {
        Tolerance { absolute: [value; N], relative: [0.0; N] }
    }

    fn oscillator(_: f64, y: &[f64; 2]) -> [f64; 2] {
        [y[1], -y[0]]
    }

    #[test]
    fn one_step_errs_with_the_ninth_power_of_its_length() {
        let integrator = Integrator::new(tolerance(1.0));
        let error = |h: f64| {
            let y = [1.0, 0.5];
            let end = integrator.inside(oscillator, 0.0, &y, &oscillator(0.0, &y), h);
            let exact = [h.cos() + 0.5 * h.sin(), 0.5 * h.cos() - h.sin()];
            (end[0] - exact[0]).hypot(end[1] - exact[1])
        };
        let order = (error(1.0) / error(0.5)).log2();
        assert!((8.6..9.6).contains(&order), "local order {order}");
    }

    #[test]
    fn global_order_is_eight_on_a_nonlinear_pendulum() {
        let pendulum = |_: f64, y: &[f64; 2]| [y[1], -y[0].sin()];
        let solve = |steps: u32| {
            let integrator = Integrator::new(tolerance(1.0));
            let mut y = [2.0, 0.0];
            let h = 6.0 / f64::from(steps);
            for _ in 0..steps {
                y = integrator.inside(pendulum, 0.0, &y, &pendulum(0.0, &y), h);
            }
            y
        };
        let fine = solve(400);
        let error = |n: u32| (solve(n)[0] - fine[0]).hypot(solve(n)[1] - fine[1]);
        let order = (error(12) / error(24)).log2();
        assert!((7.5..9.5).contains(&order), "global order {order}");
    }

    #[test]
    fn error_follows_the_tolerance() {
        for exponent in [6, 8, 10, 12] {
            let value = 10f64.powi(-exponent);
            let mut integrator = Integrator::new(tolerance(value));
            let y = integrator.advance(oscillator, 0.0, 30.0, &[1.0, 0.0]).unwrap();
            let error = (y[0] - 30f64.cos()).hypot(y[1] + 30f64.sin());
            assert!(error < 20.0 * value, "tolerance 1e-{exponent}: {error:e}");
        }
    }

    #[test]
    fn time_dependent_systems_see_the_right_time() {
        let mut integrator = Integrator::new(tolerance(1e-12));
        let y = integrator.advance(|t, _: &[f64; 1]| [t.powi(7)], 0.5, 2.0, &[0.0]).unwrap();
        assert!((y[0] - (256.0 - 0.5f64.powi(8)) / 8.0).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_integrated_is_an_error() {
        let mut integrator = Integrator::new(tolerance(1e-10));
        // y' = y² from 1 is infinite at t = 1.
        let blow_up = integrator.advance(|_, y: &[f64; 1]| [y[0] * y[0]], 0.0, 2.0, &[1.0]);
        assert!(blow_up.is_err(), "{blow_up:?}");
        let mut integrator = Integrator::new(tolerance(1e-10));
        let nan = integrator.advance(|_, _: &[f64; 1]| [f64::NAN], 0.0, 2.0, &[1.0]);
        assert_eq!(nan, Err(IntegrationError::NotFinite { seconds: 0.0 }));
        let mut integrator = Integrator::new(tolerance(1e-10));
        let stiff = integrator.advance(|t, y: &[f64; 1]| [-1e9 * (y[0] - t.cos())], 0.0, 10.0, &[1.0]);
        assert!(matches!(stiff, Err(IntegrationError::TooStiff { .. })), "{stiff:?}");
    }
}

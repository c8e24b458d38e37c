//! Regression rows of the driven double pendulum in the weak form, accumulated sample by sample in fixed memory.
//!
//! With τ = Ω t and the test functions w_m(u) = sin⁴(πu) e^{−2πimu}, u ∈ [0, 1] over a window of n drive periods, the
//! equations of motion (3.4) give, for every m = 0 … M, one complex row an equation:
//!
//! ```text
//! F(φ1′) + B11 [F(φ2′ cos Δ) − V(φ1′φ2′ sin Δ)] + B12 V(sin φ1) + B13 V(sin φ1 cos τ) + B14 V(sin φ1 sin τ)
//!        + C11 V(sign φ1′) − C12 V(φ2′ − φ1′) = 0
//! F(φ2′) + B21 [F(φ1′ cos Δ) + V(φ1′φ2′ sin Δ)] + B22 V(sin φ2) + B23 V(sin φ2 cos τ) + B24 V(sin φ2 sin τ)
//!        + C2 V(φ2′ − φ1′) = 0,          V(s) = ∫ w_m s,   F(s) = −∫ w_m′ s = ∫ w_m s′
//! ```
//!
//! As sin⁴(πu) = Σ a_k e^{−2πiku}, a = (1, −4, 6, −4, 1)/16, each integral is a combination of five harmonics of the plain
//! sums S(n) = Σ s e^{−2πint/L}. A [`HarmonicBank`] keeps those of half a window; two halves are a window, S = S₁ + (−1)ⁿ S₂, so
//! that windows overlap by half at the cost of one.
//!
//! Velocities are slopes of a cubic through nine samples (Savitzky and Golay), so that a sample's row is four samples late; the
//! phase is that of the middle. Rows carry the weight 1/(1 + (m/m₀)²), m₀ the drive's frequency: the noise of counts grows like the
//! square of the frequency in F(φ′).
//!
//! Limits: encoder 1 on the frame, encoder 2 on arm 1; the drive's increment is constant within a window. A gap or a change of
//! the drive starts the windows anew. Angles enter as counts, exactly; sums are of type `T`.

use crate::encoder::CountScale;
use crate::harmonics::{HarmonicBank, HarmonicSettings, Window};
use crate::real::{Real, cos_sin_turns};

/// Series that are summed.
const SERIES: usize = 12;
/// Unknowns of the first equation: B11 B12 B13 B14 C11 C12.
pub const UNKNOWNS1: usize = 6;
/// Unknowns of the second equation: B21 B22 B23 B24 C2.
pub const UNKNOWNS2: usize = 5;
/// Names of the unknowns, of both equations in order.
pub const NAMES: [&str; UNKNOWNS1 + UNKNOWNS2] =
    ["B11", "B12", "B13", "B14", "C11", "C12", "B21", "B22", "B23", "B24", "C2"];

/// Points of the slope.
const POINTS: usize = 9;
/// Slope of a cubic through nine points, times 1188.
const SLOPE: [i32; POINTS] = [86, -142, -193, -126, 0, 126, 193, 142, -86];
const SLOPE_DIVISOR: f64 = 1188.0;
/// a_k.
const SIN4: [f64; 5] = [0.0625, -0.25, 0.375, -0.25, 0.0625];
/// Velocities below this have no sign to speak of: it goes over linearly, rad/s.
const SIGN_WIDTH: f64 = 0.2;

/// What a regressor is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegressorSettings {
    /// Counts a turn of both encoders.
    pub scales: [CountScale; 2],
    /// Sampling rate, mHz.
    pub sample_rate_millihertz: u32,
    /// Length of a window, drive periods.
    pub periods: u32,
}

/// Rows of both equations at one m: unknowns' columns, then the target (minus F(φ_i′)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<T> {
    /// First equation.
    pub first: ([T; UNKNOWNS1], T),
    /// Second equation.
    pub second: ([T; UNKNOWNS2], T),
}

#[derive(Clone, Copy, Debug)]
struct Reading {
    counts: [i32; 2],
    phase: u32,
}

/// Sums over two overlapping windows; `B` harmonics, of which all but the last two give rows.
#[derive(Clone, Debug)]
pub struct Regressor<T: Real, const B: usize> {
    settings: RegressorSettings,
    increment: u32,
    last_tick: u32,
    readings: [Reading; POINTS],
    held: usize,
    /// The half that is being summed, and the one before.
    bank: HarmonicBank<T, SERIES, B>,
    before: Half<T, B>,
    /// Halves that are complete, at most two.
    halves: u8,
    length: u32,
    /// Counts' slope to rad/s.
    rate_scale: [T; 2],
}

/// Sums of half a window.
#[derive(Clone, Debug)]
struct Half<T, const B: usize> {
    plain: [T; SERIES],
    sums: [[[T; 2]; B]; SERIES],
}

impl<T: Real, const B: usize> Regressor<T, B> {
    /// Nothing summed yet.
    #[must_use]
    pub fn new(settings: RegressorSettings) -> Self {
        let bank = HarmonicBank::new(HarmonicSettings { increment: 0, length: 1, window: Window::Rectangular });
        Self {
            settings,
            increment: 0,
            last_tick: 0,
            readings: [Reading { counts: [0; 2], phase: 0 }; POINTS],
            held: 0,
            bank,
            before: Half { plain: [T::zero(); SERIES], sums: [[[T::zero(); 2]; B]; SERIES] },
            halves: 0,
            length: 0,
            rate_scale: settings.scales.map(|scale| {
                let rate_hz = f64::from(settings.sample_rate_millihertz) * 1e-3;
                T::from_f64(core::f64::consts::TAU * rate_hz / (f64::from(scale.counts_per_turn()) * SLOPE_DIVISOR))
            }),
        }
    }

    /// Rows beyond m = 0 of a window.
    pub const FREQUENCIES: usize = B.saturating_sub(2);

    /// Ticks of a window; 0 before the first driven sample.
    #[must_use]
    pub fn length(&self) -> u32 {
        self.length
    }

    fn restart(&mut self, increment: u32) {
        self.increment = increment;
        self.held = 0;
        // Whole periods to the nearest even tick.
        let turns = u64::from(self.settings.periods) << 32;
        let ticks = turns.saturating_add(u64::from(increment)).checked_div(2 * u64::from(increment)).unwrap_or(0);
        // Even, for half a window is whole ticks; nothing where that does not fit.
        self.length = ticks.checked_mul(2).and_then(|ticks| u32::try_from(ticks).ok()).unwrap_or(0);
        let length = u64::from(self.length.max(1));
        let turn = ((1_u128 << 64) / u128::from(length)) as u64;
        let settings = HarmonicSettings { increment: turn, length: self.length / 2, window: Window::Rectangular };
        self.bank = HarmonicBank::new(settings);
        self.halves = 0;
    }

    /// Takes a sample: its tick, counts, drive's phase and increment. True where a window is complete with it, whose rows are
    /// then given by [`Self::rows`].
    pub fn push(&mut self, tick: u32, counts: [i32; 2], phase: u32, increment: u32) -> bool {
        let follows = self.held > 0 && tick == self.last_tick.wrapping_add(1);
        if !follows || increment != self.increment {
            self.restart(increment);
        }
        self.last_tick = tick;
        if self.length < 16 {
            self.held = 1;
            return false;
        }
        self.readings.rotate_left(1);
        self.readings[POINTS - 1] = Reading { counts, phase };
        if self.held < POINTS {
            self.held += 1;
        }
        if self.held < POINTS {
            return false;
        }
        if self.bank.complete() {
            self.turn_over();
        }
        let series = self.series();
        if !self.bank.push(series) {
            return false;
        }
        self.halves = (self.halves + 1).min(2);
        self.halves == 2
    }

    /// The half that is complete becomes the one before.
    fn turn_over(&mut self) {
        for series in 0..SERIES {
            self.before.plain[series] = self.bank.sum(series, 0).map_or(T::zero(), |[re, _]| re);
            for n in 0..B {
                self.before.sums[series][n] = self.bank.sum(series, n + 1).unwrap_or([T::zero(); 2]);
            }
        }
        self.bank.restart(0);
    }

    /// S(n) of the window, n from 0 to B.
    fn sum(&self, series: usize, n: usize) -> Option<[T; 2]> {
        let [re, im] = self.bank.sum(series, n)?;
        let [re0, im0] = match n.checked_sub(1) {
            None => [self.before.plain[series], T::zero()],
            Some(j) => *self.before.sums[series].get(j)?,
        };
        Some(if n.is_multiple_of(2) { [re0 + re, im0 + im] } else { [re0 - re, im0 - im] })
    }

    fn series(&self) -> [T; SERIES] {
        let middle = self.readings[POINTS / 2];
        let mut rates = [T::zero(); 2];
        let mut turns = [0_u64; 2];
        for i in 0..2 {
            let per_turn = self.settings.scales[i].counts_per_turn();
            let slope: i32 = SLOPE
                .iter()
                .zip(&self.readings)
                .map(|(s, r)| s.wrapping_mul(r.counts[i].wrapping_sub(middle.counts[i])))
                .fold(0, i32::wrapping_add);
            rates[i] = T::from_i64(i64::from(slope)) * self.rate_scale[i];
            // (c + ½)/N turns, to 2⁻³¹.
            let within = i64::from(middle.counts[i]).rem_euclid(i64::from(per_turn)).unsigned_abs();
            turns[i] = (((2 * within + 1) << 30) / u64::from(per_turn)) << 33;
        }
        let (rate1, relative) = (rates[0], rates[1]);
        let rate2 = rate1 + relative;
        let (cos1, sin1) = cos_sin_turns::<T>(turns[0]);
        let (cos_delta, sin_delta) = cos_sin_turns::<T>(turns[1]);
        // Cheaper than another sine, in which libm computes in double precision.
        let sin2 = sin1 * cos_delta + cos1 * sin_delta;
        let (cos_tau, sin_tau) = cos_sin_turns::<T>(u64::from(middle.phase) << 32);
        let one = T::one();
        let sign = (rate1 * T::from_f64(1.0 / SIGN_WIDTH)).max(-one).min(one);
        [
            rate1,
            rate2,
            rate1 * cos_delta,
            rate2 * cos_delta,
            rate1 * rate2 * sin_delta,
            sin1,
            sin2,
            sin1 * cos_tau,
            sin1 * sin_tau,
            sin2 * cos_tau,
            sin2 * sin_tau,
            sign,
        ]
    }

    /// Gives the rows of the window that is complete: m = 0, then the real and the imaginary row of each m. Only until the next
    /// sample; false where no window is complete.
    pub fn rows(&self, mut rows: impl FnMut(Row<T>)) -> bool {
        if self.halves < 2 || !self.bank.complete() {
            return false;
        }
        for m in 0..=Self::FREQUENCIES {
            let [real, imaginary] = self.rows_at(m);
            rows(real);
            if m > 0 {
                rows(imaginary);
            }
        }
        true
    }

    /// V and F of a series at m: real and imaginary part of each.
    fn integrals(&self, series: usize, m: usize) -> [[T; 2]; 2] {
        let length_s = f64::from(self.length) * 1e3 / f64::from(self.settings.sample_rate_millihertz);
        let mut sums = [[T::zero(); 2]; 2];
        for (k, a) in SIN4.into_iter().enumerate() {
            let n = m as i64 + k as i64 - 2;
            let harmonic = usize::try_from(n.unsigned_abs()).unwrap_or(usize::MAX);
            let Some([re, im]) = self.sum(series, harmonic) else { continue };
            let im = if n < 0 { -im } else { im };
            let a = T::from_f64(a / f64::from(self.length));
            // −w′: 2πin/L a_n e^{−2πinu}.
            let slope = T::from_f64(core::f64::consts::TAU * n as f64 / length_s);
            sums[0] = [sums[0][0] + a * re, sums[0][1] + a * im];
            sums[1] = [sums[1][0] - a * slope * im, sums[1][1] + a * slope * re];
        }
        sums
    }

    /// The real and the imaginary row.
    fn rows_at(&self, m: usize) -> [Row<T>; 2] {
        let all: [[[T; 2]; 2]; SERIES] = core::array::from_fn(|series| self.integrals(series, m));
        let rate = f64::from(self.settings.sample_rate_millihertz) * 1e-3;
        let omega = core::f64::consts::TAU * rate * f64::from(self.increment) / 4_294_967_296.0;
        let relative_frequency = m as f64 / f64::from(self.settings.periods.max(1));
        let weight = 1.0 / (1.0 + relative_frequency * relative_frequency);
        let value = T::from_f64(weight);
        let first = T::from_f64(weight / omega);
        let second = T::from_f64(weight / (omega * omega));
        [0, 1].map(|part| {
            let v = |series: usize| all[series][0][part];
            let f = |series: usize| all[series][1][part];
            let damping = (v(1) - v(0)) * first;
            Row {
                first: (
                    [(f(3) - v(4)) * second, v(5) * value, v(7) * value, v(8) * value, v(11) * value, -damping],
                    -f(0) * second,
                ),
                second: ([(f(2) + v(4)) * second, v(6) * value, v(9) * value, v(10) * value, damping], -f(1) * second),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{PI, TAU};
    use std::vec::Vec;

    const PERIODS: u32 = 4;
    const INCREMENT: u32 = 1 << 25; // 128 ticks a period

    fn settings() -> RegressorSettings {
        let scale = CountScale::new(1 << 20).unwrap();
        RegressorSettings { scales: [scale; 2], sample_rate_millihertz: 500_000, periods: PERIODS }
    }

    fn theta(t: f64) -> [f64; 2] {
        [0.8 * (9.0 * t).sin(), 6.0 * t + 0.5 * (11.0 * t).cos()]
    }

    fn feed(regressor: &mut Regressor<f64, 12>, ticks: core::ops::Range<u32>) -> Vec<Vec<Row<f64>>> {
        let mut windows = Vec::new();
        for tick in ticks {
            let counts = theta(f64::from(tick) / 500.0).map(|x| (x * f64::from(1 << 20) / TAU).floor() as i32);
            if regressor.push(tick, counts, tick.wrapping_mul(INCREMENT), INCREMENT) {
                let mut rows = Vec::new();
                regressor.rows(|row| rows.push(row));
                windows.push(rows);
            }
        }
        windows
    }

    #[test]
    fn rows_are_the_integrals_of_the_equation() {
        let mut regressor = Regressor::new(settings());
        let windows = feed(&mut regressor, 0..2_000);
        let length = 512;
        assert_eq!(regressor.length(), length);
        // Starts at tick 4 (the slope's reach), then every half window.
        assert_eq!(windows.len(), (2_000 - 8) / 256 - 1);
        let omega = TAU * 500.0 / 128.0;
        for (index, rows) in windows.iter().enumerate() {
            assert_eq!(rows.len(), 1 + 2 * 10);
            for (r, row) in rows.iter().enumerate() {
                let m = r.div_ceil(2);
                // Direct quadrature with the exact second derivative.
                let mut sums = [0.0; 6];
                for n in 0..length {
                    let tick = 4 + 256 * index as u32 + n;
                    let (t, u) = (f64::from(tick) / 500.0, f64::from(n) / f64::from(length));
                    let turn = -TAU * m as f64 * u;
                    let w = (PI * u).sin().powi(4) * if r % 2 == 1 || r == 0 { turn.cos() } else { turn.sin() };
                    let [theta1, theta2] = theta(t);
                    let (rate1, rate2) = (7.2 * (9.0 * t).cos(), 6.0 - 5.5 * (11.0 * t).sin() + 7.2 * (9.0 * t).cos());
                    let accel1 = -64.8 * (9.0 * t).sin();
                    let accel2 = accel1 - 60.5 * (11.0 * t).cos();
                    let tau = TAU * f64::from(tick) / 128.0;
                    let parts = [
                        (accel2 * theta2.cos() - rate2 * rate2 * theta2.sin()) / (omega * omega),
                        theta1.sin(),
                        (theta1 + theta2).sin() * tau.cos(),
                        (accel1 * theta2.cos() + rate1 * rate1 * theta2.sin()) / (omega * omega),
                        -(rate2 - rate1) / omega,
                        -accel1 / (omega * omega),
                    ];
                    sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += w * part / f64::from(length));
                }
                let weight = 1.0 + (m as f64 / f64::from(PERIODS)).powi(2);
                let found =
                    [row.first.0[0], row.first.0[1], row.second.0[2], row.second.0[0], row.first.0[5], row.first.1];
                for (k, (found, expected)) in found.into_iter().zip(sums).enumerate() {
                    assert!(
                        (found * weight - expected).abs() < 2e-5,
                        "window {index} row {r} part {k}: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_gap_or_another_drive_begins_anew() {
        let mut regressor = Regressor::new(settings());
        assert!(feed(&mut regressor, 0..519).is_empty());
        assert!(feed(&mut regressor, 520..1_039).is_empty());
        assert_eq!(feed(&mut regressor, 1_039..1_041).len(), 1);
        // A drive at rest gives nothing.
        for tick in 0..3_000 {
            assert!(!regressor.push(tick, [0, 0], 0, 0));
        }
    }
}

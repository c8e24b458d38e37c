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

/// What a sample has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// Windows begin anew with this sample: it does not follow the one before, or another drive.
    Began,
    /// Nothing to be told of.
    Taken,
    /// A window is complete; [`Regressor::rows_at`] gives its rows until the next one is.
    Complete,
}

/// Sums over two overlapping windows; `B` harmonics, of which all but the last two give rows.
#[derive(Clone, Debug)]
pub struct Regressor<T: Real, const B: usize> {
    /// None before it is set up: then nothing is taken.
    settings: Option<RegressorSettings>,
    increment: u32,
    last_tick: u32,
    readings: [Reading; POINTS],
    held: usize,
    /// The half that is being summed.
    bank: HarmonicBank<T, SERIES, B>,
    /// The half before it, and both together as soon as they are complete.
    before: Sums<T, B>,
    window: Sums<T, B>,
    /// Halves that are complete, at most two.
    halves: u8,
    length: u32,
    /// Counts' slope to rad/s.
    rate_scale: [T; 2],
    factors: Factors<T>,
}

/// Harmonic sums of all series: n = 0, then n from 1 to B.
#[derive(Clone, Debug)]
struct Sums<T, const B: usize> {
    plain: [T; SERIES],
    sums: [[[T; 2]; B]; SERIES],
}

impl<T: Real, const B: usize> Sums<T, B> {
    const fn zero() -> Self {
        Self { plain: [T::ZERO; SERIES], sums: [[[T::ZERO; 2]; B]; SERIES] }
    }
}

/// What depends on the window's length and the drive alone, kept so that a device without double precision works it out once.
#[derive(Clone, Copy, Debug)]
struct Factors<T> {
    /// a_k over the window's ticks.
    values: [T; 5],
    /// 2π over the window's length, rad/s.
    slope: T,
    /// 1/Ω, s.
    time: T,
    /// 1 over the window's periods.
    periods: T,
}

impl<T: Real, const B: usize> Regressor<T, B> {
    /// One without settings, to be set up in its place: all of it zero, so that a device needs neither stack nor flash for it.
    #[must_use]
    pub const fn idle() -> Self {
        let zero = T::ZERO;
        Self {
            settings: None,
            increment: 0,
            last_tick: 0,
            readings: [Reading { counts: [0; 2], phase: 0 }; POINTS],
            held: 0,
            bank: HarmonicBank::idle(),
            before: Sums::zero(),
            window: Sums::zero(),
            halves: 0,
            length: 0,
            rate_scale: [zero; 2],
            factors: Factors { values: [zero; 5], slope: zero, time: zero, periods: zero },
        }
    }

    /// Nothing summed yet.
    #[must_use]
    pub fn new(settings: RegressorSettings) -> Self {
        let mut regressor = Self::idle();
        regressor.set_up(settings);
        regressor
    }

    /// Begins anew with other settings.
    pub fn set_up(&mut self, settings: RegressorSettings) {
        self.settings = Some(settings);
        let rate_hz = f64::from(settings.sample_rate_millihertz) * 1e-3;
        self.rate_scale = settings.scales.map(|scale| {
            T::from_f64(core::f64::consts::TAU * rate_hz / (f64::from(scale.counts_per_turn()) * SLOPE_DIVISOR))
        });
        self.restart(0);
    }

    /// Highest m of a window's rows.
    pub const FREQUENCIES: usize = B.saturating_sub(2);
    /// Samples by which a window is complete later than its last tick: the slope's reach.
    pub const DELAY: u32 = (POINTS / 2) as u32;

    /// Ticks of a window; 0 before the first driven sample, or where the drive is at rest.
    #[must_use]
    pub fn length(&self) -> u32 {
        self.length
    }

    /// Whether the next sample, if it follows, completes a window.
    #[must_use]
    pub fn completes_next(&self) -> bool {
        self.halves > 0 && self.bank.ticks() + 1 >= self.length / 2
    }

    /// Windows begin anew with the next sample.
    pub fn clear(&mut self) {
        self.held = 0;
    }

    fn restart(&mut self, increment: u32) {
        self.increment = increment;
        self.held = 0;
        self.halves = 0;
        let Some(RegressorSettings { sample_rate_millihertz, periods, .. }) = self.settings else { return };
        // Whole periods to the nearest even tick.
        let turns = u64::from(periods) << 32;
        let ticks = turns.saturating_add(u64::from(increment)).checked_div(2 * u64::from(increment)).unwrap_or(0);
        // Even, for half a window is whole ticks; nothing where that does not fit.
        self.length = ticks.checked_mul(2).and_then(|ticks| u32::try_from(ticks).ok()).unwrap_or(0);
        let length = u64::from(self.length.max(1));
        let turn = ((1_u128 << 64) / u128::from(length)) as u64;
        let settings = HarmonicSettings { increment: turn, length: self.length / 2, window: Window::Rectangular };
        self.bank.set_up(settings);
        let rate_hz = f64::from(sample_rate_millihertz) * 1e-3;
        let ticks = f64::from(self.length.max(1));
        let omega = core::f64::consts::TAU * rate_hz * f64::from(increment.max(1)) / 4_294_967_296.0;
        self.factors = Factors {
            values: SIN4.map(|a| T::from_f64(a / ticks)),
            slope: T::from_f64(core::f64::consts::TAU * rate_hz / ticks),
            time: T::from_f64(1.0 / omega),
            periods: T::from_f64(1.0 / f64::from(periods.max(1))),
        };
    }

    /// Takes a sample: its tick, counts, drive's phase and increment.
    pub fn push(&mut self, tick: u32, counts: [i32; 2], phase: u32, increment: u32) -> Pushed {
        let follows = self.held > 0 && tick == self.last_tick.wrapping_add(1) && increment == self.increment;
        if !follows {
            self.restart(increment);
        }
        self.last_tick = tick;
        if self.length < 16 {
            self.held = 1;
        } else {
            self.readings.rotate_left(1);
            self.readings[POINTS - 1] = Reading { counts, phase };
            self.held = (self.held + 1).min(POINTS);
            if self.held == POINTS {
                let complete = self.series().is_some_and(|series| self.bank.push(series));
                if complete && self.turn_over() {
                    return Pushed::Complete;
                }
            }
        }
        if follows { Pushed::Taken } else { Pushed::Began }
    }

    /// The half that is complete becomes the one before; whether there is a window now. S = S₁ + (−1)ⁿ S₂.
    fn turn_over(&mut self) -> bool {
        let (sums, plain) = self.bank.sums();
        for series in 0..SERIES {
            self.window.plain[series] = self.before.plain[series] + plain[series];
            self.before.plain[series] = plain[series];
            let places = self.window.sums[series].iter_mut().zip(&mut self.before.sums[series]);
            for (n, ((window, before), half)) in (1_usize..).zip(places.zip(&sums[series])) {
                let [re, im] = *half;
                *window = if n.is_multiple_of(2) {
                    [before[0] + re, before[1] + im]
                } else {
                    [before[0] - re, before[1] - im]
                };
                *before = *half;
            }
        }
        self.bank.restart(0);
        self.halves = (self.halves + 1).min(2);
        self.halves == 2
    }

    fn series(&self) -> Option<[T; SERIES]> {
        let scales = self.settings?.scales;
        let middle = self.readings[POINTS / 2];
        let mut rates = [T::zero(); 2];
        let mut turns = [0_u64; 2];
        for i in 0..2 {
            let per_turn = scales[i].counts_per_turn();
            let slope: i32 = SLOPE
                .iter()
                .zip(&self.readings)
                .map(|(s, r)| s.wrapping_mul(r.counts[i].wrapping_sub(middle.counts[i])))
                .fold(0, i32::wrapping_add);
            rates[i] = T::from_i32(slope) * self.rate_scale[i];
            // (c + ½)/N turns, to 2⁻³¹.
            let within = i64::from(middle.counts[i]).rem_euclid(i64::from(per_turn)).unsigned_abs();
            turns[i] = (((2 * within + 1) << 30) / u64::from(per_turn)) << 33;
        }
        let (rate1, relative) = (rates[0], rates[1]);
        let rate2 = rate1 + relative;
        let (cos1, sin1) = cos_sin_turns::<T>(turns[0]);
        let (cos_delta, sin_delta) = cos_sin_turns::<T>(turns[1]);
        // Cheaper than another sine.
        let sin2 = sin1 * cos_delta + cos1 * sin_delta;
        let (cos_tau, sin_tau) = cos_sin_turns::<T>(u64::from(middle.phase) << 32);
        let one = T::one();
        let sign = (rate1 * T::from_f64(1.0 / SIGN_WIDTH)).max(-one).min(one);
        Some([
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
        ])
    }

    /// The rows of the last complete window at m, from the real and from the imaginary part (which is zero at m = 0); `None` beyond
    /// [`Self::FREQUENCIES`] or before there is a window.
    #[must_use]
    pub fn rows_at(&self, m: usize) -> Option<[Row<T>; 2]> {
        if self.halves < 2 || m > Self::FREQUENCIES {
            return None;
        }
        let all: [[[T; 2]; 2]; SERIES] = core::array::from_fn(|series| self.integrals(series, m));
        let relative_frequency = T::from_i32(m as i32) * self.factors.periods;
        let value = T::one() / (T::one() + relative_frequency * relative_frequency);
        let first = value * self.factors.time;
        let second = first * self.factors.time;
        Some([0, 1].map(|part| {
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
        }))
    }

    /// The targets of both equations at m, real and imaginary part, without the rest of the rows.
    #[must_use]
    pub fn targets_at(&self, m: usize) -> Option<[[T; 2]; 2]> {
        if self.halves < 2 || m > Self::FREQUENCIES {
            return None;
        }
        let relative_frequency = T::from_i32(m as i32) * self.factors.periods;
        let second = self.factors.time * self.factors.time / (T::one() + relative_frequency * relative_frequency);
        let [[_, f1], [_, f2]] = [self.integrals(0, m), self.integrals(1, m)];
        Some([0, 1].map(|part| [-f1[part] * second, -f2[part] * second]))
    }

    /// V and F of a series at m: real and imaginary part of each.
    fn integrals(&self, series: usize, m: usize) -> [[T; 2]; 2] {
        let mut sums = [[T::zero(); 2]; 2];
        for (k, a) in self.factors.values.into_iter().enumerate() {
            let n = m as i32 + k as i32 - 2;
            let [re, im] = match usize::try_from(n.unsigned_abs()).unwrap_or(usize::MAX).checked_sub(1) {
                None => [self.window.plain[series], T::zero()],
                // Of a real series.
                Some(j) => match self.window.sums[series].get(j) {
                    Some([re, im]) if n < 0 => [*re, -*im],
                    Some(sum) => *sum,
                    None => continue,
                },
            };
            // −w′: 2πin/L a_n e^{−2πinu}.
            let slope = self.factors.slope * T::from_i32(n);
            let (re, im) = (a * re, a * im);
            sums[0] = [sums[0][0] + re, sums[0][1] + im];
            sums[1] = [sums[1][0] - slope * im, sums[1][1] + slope * re];
        }
        sums
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
            let completes = regressor.completes_next();
            let pushed = regressor.push(tick, counts, tick.wrapping_mul(INCREMENT), INCREMENT);
            assert!(completes || pushed != Pushed::Complete);
            if pushed == Pushed::Complete {
                assert!(regressor.rows_at(11).is_none());
                let rows: Vec<_> = (0..=10).flat_map(|m| regressor.rows_at(m).unwrap()).collect();
                for (m, pair) in rows.chunks(2).enumerate() {
                    let targets = [0, 1].map(|part: usize| [pair[part].first.1, pair[part].second.1]);
                    for (a, b) in targets.iter().flatten().zip(regressor.targets_at(m).unwrap().iter().flatten()) {
                        assert!((a - b).abs() <= 1e-14 * a.abs(), "{a} {b}");
                    }
                }
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
            assert_eq!(rows.len(), 2 * 11);
            for (r, row) in rows.iter().enumerate() {
                let m = r / 2;
                // Direct quadrature with the exact second derivative.
                let mut sums = [0.0; 6];
                for n in 0..length {
                    let tick = 4 + 256 * index as u32 + n;
                    let (t, u) = (f64::from(tick) / 500.0, f64::from(n) / f64::from(length));
                    let turn = -TAU * m as f64 * u;
                    let w = (PI * u).sin().powi(4) * if r % 2 == 0 { turn.cos() } else { turn.sin() };
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
            let expected = if tick == 0 { Pushed::Began } else { Pushed::Taken };
            assert_eq!(regressor.push(tick, [0, 0], 0, 0), expected);
        }
        // And so does who says so.
        assert_eq!(feed(&mut regressor, 0..520).len(), 1);
        regressor.clear();
        assert!(feed(&mut regressor, 520..1_030).is_empty() && regressor.rows_at(0).is_none());
    }
}

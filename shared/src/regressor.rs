//! Regression rows of the driven double pendulum in the weak form, accumulated sample by sample in
//! fixed memory.
//!
//! With τ = Ω t and the test functions w_m(u) = sin⁴(πu) e^{−2πimu}, u ∈ [0, 1] over a window of n
//! drive periods, the equations of motion (3.4) give, for every m = 0 … M, one complex row an
//! equation:
//!
//! ```text
//! F(φ1′) + B11 [F(φ2′ cos Δ) − V(φ1′φ2′ sin Δ)] + B12 V(sin φ1) + B13 V(sin φ1 cos τ) + B14 V(sin φ1 sin τ)
//!        + C11 V(sign φ1′) − C12 V(φ2′ − φ1′) = 0
//! F(φ2′) + B21 [F(φ1′ cos Δ) + V(φ1′φ2′ sin Δ)] + B22 V(sin φ2) + B23 V(sin φ2 cos τ) + B24 V(sin φ2 sin τ)
//!        + C2 V(φ2′ − φ1′) = 0,          V(s) = ∫ w_m s,   F(s) = −∫ w_m′ s = ∫ w_m s′
//! ```
//!
//! As sin⁴(πu) = Σ a_k e^{−2πiku}, a = (1, −4, 6, −4, 1)/16, each integral is a combination of five
//! harmonics of the plain sums S(n) = Σ s e^{−2πint/L}. A [`HarmonicBank`] keeps those of half a
//! window; two halves are a window, S = S₁ + (−1)ⁿ S₂, so that windows overlap by half at the cost
//! of one.
//!
//! Velocities are slopes of polynomials through samples around the middle one (Savitzky and Golay),
//! so that a sample's row is [`Regressor::DELAY`] samples late: of degree 6 through fifteen, which
//! is flat to 0.1 % up to a tenth of the sampling rate and has a quarter of the noise of a
//! difference of neighbours; for signs, on which noise tells most, of degree 4 through nineteen. A
//! sign is its mean over the sampling step in which the velocity passes zero.
//!
//! Rows carry weights, m₀ the drive's frequency: 1/(1 + 1.5 (m/m₀)³) in the first equation, 1/(1 +
//! (m/m₀)²) in the second. So the host's residuals grow on records of the chaotic rig, where the
//! noise of counts in F(φ′) grows like the square of the frequency and friction adds to it.
//!
//! Limits: encoder 1 on the frame, encoder 2 on arm 1; the drive's increment is constant within a
//! window. A gap or a change of the drive starts the windows anew. Angles enter as counts, exactly;
//! sums are of type `T`.

mod rows;

use crate::encoder::CountScale;
use crate::harmonics::{HarmonicBank, HarmonicSettings, Window};
use crate::real::{Real, cos_sin_turns};

pub use self::rows::{Row, weights};

/// Series that are summed.
const SERIES: usize = 12;
/// Unknowns of the first equation: B11 B12 B13 B14 C11 C12.
pub const UNKNOWNS1: usize = 6;
/// Unknowns of the second equation: B21 B22 B23 B24 C2.
pub const UNKNOWNS2: usize = 5;
/// Names of the unknowns, of both equations in order.
pub const NAMES: [&str; UNKNOWNS1 + UNKNOWNS2] =
    ["B11", "B12", "B13", "B14", "C11", "C12", "B21", "B22", "B23", "B24", "C2"];

/// Slope of a polynomial of degree 6 through fifteen points, from the middle on (the other half is
/// its negative), and its divisor.
const SLOPE: [i32; 7] = [175_125, 279_975, 266_401, 130_506, -65_229, -169_819, 78_351];
const SLOPE_DIVISOR: f64 = 2_519_400.0;
/// The same of degree 4 through nineteen points; its divisor does not matter to a sign.
const CLEAR_SLOPE: [i32; 9] = [2_816, 5_363, 7_372, 8_574, 8_700, 7_481, 4_648, -68, -6_936];
/// Samples held: the reach of the clear slope on either side, of the samples next to the middle
/// too.
const POINTS: usize = 2 * CLEAR_SLOPE.len() + 3;
const MIDDLE: usize = POINTS / 2;
/// a_k.
const SIN4: [f64; 5] = [0.0625, -0.25, 0.375, -0.25, 0.0625];

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
    /// The clear slope of encoder 1, in its own unit, at the sample before the middle one and at
    /// the middle one.
    clear: [T; 2],
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

/// What depends on the window's length and the drive alone, kept so that a device without double
/// precision works it out once.
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
    /// One without settings, to be set up in its place: all of it zero, so that a device needs
    /// neither stack nor flash for it.
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
            clear: [zero; 2],
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
    pub const DELAY: u32 = MIDDLE as u32;

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
            if self.held + 1 == POINTS {
                self.clear = [self.slope(0, MIDDLE - 1, &CLEAR_SLOPE), self.slope(0, MIDDLE, &CLEAR_SLOPE)];
            }
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

    /// The half that is complete becomes the one before; whether there is a window now. S = S₁ +
    /// (−1)ⁿ S₂.
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

    /// Slope of a channel's counts around a sample, times the kernel's divisor.
    fn slope(&self, channel: usize, middle: usize, kernel: &[i32]) -> T {
        let counts = |place: usize| self.readings.get(place).map_or(0, |r| r.counts[channel]);
        let sum: i64 = kernel
            .iter()
            .zip(1_usize..)
            .map(|(s, k)| {
                let difference = counts(middle + k).wrapping_sub(counts(middle.wrapping_sub(k)));
                i64::from(*s) * i64::from(difference)
            })
            .sum();
        T::from_i64(sum)
    }

    fn series(&mut self) -> Option<[T; SERIES]> {
        let scales = self.settings?.scales;
        let middle = self.readings[MIDDLE];
        let rates = [0, 1].map(|i| self.slope(i, MIDDLE, &SLOPE) * self.rate_scale[i]);
        let turns = [0, 1].map(|i: usize| {
            let per_turn = scales[i].counts_per_turn();
            // (c + ½)/N turns, to 2⁻³¹.
            let within = i64::from(middle.counts[i]).rem_euclid(i64::from(per_turn)).unsigned_abs();
            (((2 * within + 1) << 30) / u64::from(per_turn)) << 33
        });
        let [before, clear] = self.clear;
        let after = self.slope(0, MIDDLE + 1, &CLEAR_SLOPE);
        self.clear = [clear, after];
        // The velocity changes by half of after − before over the step around the middle:
        // clamp(2v/|step|).
        let (four, change) = (T::from_i32(4) * clear, (after - before).abs());
        let one = T::one();
        let sign = if four.abs() < change {
            four / change
        } else if clear > T::zero() {
            one
        } else if clear < T::zero() {
            -one
        } else {
            T::zero()
        };
        let (rate1, relative) = (rates[0], rates[1]);
        let rate2 = rate1 + relative;
        let (cos1, sin1) = cos_sin_turns::<T>(turns[0]);
        let (cos_delta, sin_delta) = cos_sin_turns::<T>(turns[1]);
        // Cheaper than another sine.
        let sin2 = sin1 * cos_delta + cos1 * sin_delta;
        let (cos_tau, sin_tau) = cos_sin_turns::<T>(u64::from(middle.phase) << 32);
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
}

#[cfg(test)]
mod tests;

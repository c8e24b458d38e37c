//! Fixed-size banks of harmonic accumulators, one pass over the samples.
//!
//! For C signals x_c and the M harmonics j = 1 … M of the sub-harmonic base ω/k, over a window of L
//! ticks n = 0 … L − 1:
//!
//! ```text
//!   S_cj = Σ_n w_n x_c(n) e^{−ijφ_n},   φ_n = φ_0 + n Δφ,   Δφ = ω/(k f_s),   w_n = sin⁴(πn/L) or 1
//! ```
//!
//! j = 0 (Σ w x) is kept too. The base need not be commensurate with the sampling rate: Δφ is an
//! integer of 64 bits in turns · 2⁻⁶⁴, and so is φ.
//!
//! The phasors are advanced by recurrence, z ← z·r, and renormalised to first order, z ←
//! z(3 − |z|²)/2, which keeps |z| = 1 but lets the phase walk off with the rounding of r. So each
//! tick one phasor in turn is set from the exact integer phase jφ_n: each has been through at most
//! M recurrences, whatever the length of the record. Error of a phasor: at most 1.5(M + 2)ε in
//! length and phase together, ε = 1.2e-7 (`f32`) or 2.3e-16 (`f64`).
//!
//! Cost: C·M complex multiply-adds, M complex multiplications and two sines and cosines a tick; no
//! allocation. Sums are plain: their rounding error is at most L ε/2 · Σ|w x|, of the order of √L ε
//! in practice.

use crate::real::{Real, cos_sin_turns};

/// Weight of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Window {
    /// sin⁴(πn/L): vanishes at both ends with its first three derivatives.
    #[default]
    SinFourth,
    /// 1.
    Rectangular,
}

/// Settings of a bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HarmonicSettings {
    /// Δφ, the advance of the base's phase in one tick, turns · 2⁻⁶⁴.
    pub increment: u64,
    /// L, ticks.
    pub length: u32,
    /// Weight.
    pub window: Window,
}

impl HarmonicSettings {
    /// From the drive's increment (turns · 2⁻³², [`crate::waveform`]) and k, rounded to 2⁻⁶⁴ turns;
    /// `None` where k or the length is zero.
    #[must_use]
    pub fn of_drive(increment: u32, k: u32, length: u32, window: Window) -> Option<Self> {
        let turns = u64::from(increment) << 32;
        let increment = turns.checked_add(u64::from(k / 2))?.checked_div(u64::from(k))?;
        (length > 0).then_some(Self { increment, length, window })
    }

    /// From the drive's frequency and the sampling rate in mHz, and k: the nearest increment to
    /// f/(k f_s). `None` where k, the rate or the length is zero or the frequency is not below the
    /// sampling rate.
    #[must_use]
    pub fn of_frequency(
        frequency_millihertz: u32,
        sample_rate_millihertz: u32,
        k: u32,
        length: u32,
        window: Window,
    ) -> Option<Self> {
        let divisor = u128::from(sample_rate_millihertz) * u128::from(k);
        if divisor == 0 || length == 0 || frequency_millihertz >= sample_rate_millihertz {
            return None;
        }
        let increment = u64::try_from(((u128::from(frequency_millihertz) << 64) + divisor / 2) / divisor).ok()?;
        Some(Self { increment, length, window })
    }
}

/// Sums of C signals over M harmonics.
#[derive(Clone, Debug)]
pub struct HarmonicBank<T: Real, const C: usize, const M: usize> {
    settings: HarmonicSettings,
    /// Half a turn over L, turns · 2⁻⁶⁴.
    window_step: u64,
    phase: u64,
    ticks: u32,
    refresh: usize,
    /// e^{−ijφ}, as cos and −sin.
    phasors: [[T; 2]; M],
    rotations: [[T; 2]; M],
    sums: [[[T; 2]; M]; C],
    plain: [T; C],
    weight: T,
}

fn phasor<T: Real>(harmonic: usize, phase: u64) -> [T; 2] {
    if phase == 0 {
        return [T::one(), T::zero()];
    }
    let (cos, sin) = cos_sin_turns(phase.wrapping_mul(harmonic as u64));
    [cos, -sin]
}

fn product<T: Real>(a: [T; 2], b: [T; 2]) -> [T; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

impl<T: Real, const C: usize, const M: usize> HarmonicBank<T, C, M> {
    /// A bank of length 0, to be set up in its place: all of it zero, so that a device needs
    /// neither stack nor flash for it.
    #[must_use]
    pub const fn idle() -> Self {
        Self {
            settings: HarmonicSettings { increment: 0, length: 0, window: Window::SinFourth },
            window_step: 0,
            phase: 0,
            ticks: 0,
            refresh: 0,
            phasors: [[T::ZERO; 2]; M],
            rotations: [[T::ZERO; 2]; M],
            sums: [[[T::ZERO; 2]; M]; C],
            plain: [T::ZERO; C],
            weight: T::ZERO,
        }
    }

    /// An empty bank whose first sample has phase 0. A length of zero counts as 1.
    #[must_use]
    pub fn new(settings: HarmonicSettings) -> Self {
        let mut bank = Self::idle();
        bank.set_up(settings);
        bank
    }

    /// Empties the bank for other settings; its first sample has phase 0. A length of zero counts
    /// as 1.
    pub fn set_up(&mut self, settings: HarmonicSettings) {
        self.settings = HarmonicSettings { length: settings.length.max(1), ..settings };
        let length = u64::from(self.settings.length);
        self.window_step = ((1 << 63) + length / 2) / length;
        for (rotation, j) in self.rotations.iter_mut().zip(1..) {
            *rotation = phasor(j, settings.increment);
        }
        self.restart(0);
    }

    /// Empties the bank; `phase` is φ_0, that of the base ω/k at the next sample, turns · 2⁻⁶⁴.
    pub fn restart(&mut self, phase: u64) {
        self.phase = phase;
        self.ticks = 0;
        self.refresh = 0;
        for (z, j) in self.phasors.iter_mut().zip(1..) {
            *z = phasor(j, phase);
        }
        self.sums.as_flattened_mut().fill([T::zero(); 2]);
        self.plain.fill(T::zero());
        self.weight = T::zero();
    }

    /// Takes the next sample of every signal; whether the window is complete with it. A complete
    /// bank takes no more until [`Self::restart`]. After a gap in the samples the window is lost:
    /// restart.
    pub fn push(&mut self, signals: [T; C]) -> bool {
        if self.complete() {
            return true;
        }
        let weight = self.window_weight();
        self.weight = self.weight + weight;
        for ((signal, plain), sums) in signals.iter().zip(&mut self.plain).zip(&mut self.sums) {
            let x = *signal * weight;
            *plain = *plain + x;
            for (sum, z) in sums.iter_mut().zip(&self.phasors) {
                sum[0] = sum[0] + x * z[0];
                sum[1] = sum[1] + x * z[1];
            }
        }
        self.advance();
        self.complete()
    }

    fn window_weight(&self) -> T {
        match self.settings.window {
            Window::Rectangular => T::one(),
            Window::SinFourth => {
                let (_, sin) = cos_sin_turns::<T>(self.window_step.wrapping_mul(u64::from(self.ticks)));
                let square = sin * sin;
                square * square
            }
        }
    }

    fn advance(&mut self) {
        self.ticks += 1;
        self.phase = self.phase.wrapping_add(self.settings.increment);
        let half = T::from_f64(0.5);
        let three_halves = T::from_f64(1.5);
        for (z, rotation) in self.phasors.iter_mut().zip(&self.rotations) {
            let next = product(*z, *rotation);
            let scale = three_halves - half * (next[0] * next[0] + next[1] * next[1]);
            *z = [next[0] * scale, next[1] * scale];
        }
        // One in turn from the exact phase.
        if let Some(z) = self.phasors.get_mut(self.refresh) {
            *z = phasor(self.refresh + 1, self.phase);
        }
        self.refresh = if self.refresh + 1 < M { self.refresh + 1 } else { 0 };
    }

    /// Whether L samples have been taken.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.ticks >= self.settings.length
    }

    /// Samples taken.
    #[must_use]
    pub fn ticks(&self) -> u32 {
        self.ticks
    }

    /// Phase of the base at the next sample, turns · 2⁻⁶⁴: what the next window is restarted with.
    #[must_use]
    pub fn phase(&self) -> u64 {
        self.phase
    }

    /// Σ w of the samples taken.
    #[must_use]
    pub fn weight(&self) -> T {
        self.weight
    }

    /// S_cj as real and imaginary part, for the samples taken until now; `None` beyond C or M.
    #[must_use]
    pub fn sum(&self, channel: usize, harmonic: usize) -> Option<[T; 2]> {
        match harmonic.checked_sub(1) {
            None => Some([*self.plain.get(channel)?, T::zero()]),
            Some(j) => self.sums.get(channel)?.get(j).copied(),
        }
    }

    /// All S_cj, j from 1, and all S_c0, for the samples taken until now.
    #[must_use]
    pub fn sums(&self) -> (&[[[T; 2]; M]; C], &[T; C]) {
        (&self.sums, &self.plain)
    }
}

#[cfg(test)]
mod tests;

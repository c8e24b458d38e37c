//! An arbitrary periodic motion: y/a at any phase, from the control points of a spline.
//!
//! ```text
//! y = a Σ c_j B(N φ − j),   N φ taken around N points,   φ in turns
//! ```
//!
//! B is the uniform cubic B-spline: the motion has a continuous second derivative. It lies in the
//! hull of its control points, so that |y| ≤ a max|c_j|; its slope is at most a N max|c_{j+1} − c_j|
//! a turn; and its second derivative, which is piecewise linear with the values
//! a N² (c_{j−1} − 2 c_j + c_{j+1}) at the points, is greatest at one of them: the acceleration at
//! f turns a second is at most a N² f² max|c_{j−1} − 2 c_j + c_{j+1}|, and reaches that.
//!
//! All is computed in integers. Between points j and j + 1, u = N φ − j,
//! 6 y/a = d₀ + u (d₁ + u (d₂ + u d₃)) with d₀ = c_{j−1} + 4 c_j + c_{j+1}, d₁ = 3 (c_{j+1} −
//! c_{j−1}), d₂ = 3 (c_{j−1} − 2 c_j + c_{j+1}), d₃ = c_{j+2} − 3 c_{j+1} + 3 c_j − c_{j−1}: in
//! 2⁻²⁶, u cut to 2⁻³¹, each product cut downward to a whole number. y is rounded once, half away
//! from zero.

use core::fmt;

use serde::{Deserialize, Serialize};

use super::{Excitation, Part, Refusal, WHOLE};
use crate::frame::ShakerLimits;
use crate::waveform::rounded;

/// Fewest and most points of a table.
pub const POINTS: [usize; 2] = [8, 256];
/// Points in a command: as many as make none longer in memory.
pub const CHUNK: usize = 6;

/// Binary places of 6 y/a beside those of the points.
const PLACES: u32 = 11;

/// Which table it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableName {
    /// N; 0 for none.
    pub points: u16,
    /// FNV-1a over its points, 16 bits of each at a time: those of another one hardly have the same.
    pub check: u32,
}

impl TableName {
    /// No table.
    pub const NONE: Self = Self { points: 0, check: 0 };

    /// Whether there is one.
    #[must_use]
    pub const fn is_some(self) -> bool {
        self.points > 0
    }
}

/// What a table's points say of its motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extent {
    /// Which table it is.
    pub name: TableName,
    /// max|c_{j+1} − c_j|, in 1/[`WHOLE`].
    pub steepest: u32,
    /// max|c_{j−1} − 2 c_j + c_{j+1}|, in 1/[`WHOLE`].
    pub sharpest: u32,
}

impl Extent {
    /// Greatest amplitude in µm at which the acceleration a N² f² max|c_{j−1} − 2 c_j + c_{j+1}|
    /// keeps within a limit in mm/s², f in mHz; rounded down.
    #[must_use]
    pub fn amplitude_limit(&self, acceleration_millimetre_per_s2: u32, frequency_millihertz: u32) -> u32 {
        // 10³ µm a mm, 10⁶ mHz² a Hz².
        let numerator = u128::from(acceleration_millimetre_per_s2) * 1_000_000_000 * u128::from(WHOLE);
        let knots = u128::from(frequency_millihertz) * u128::from(self.name.points);
        u32::try_from(numerator / (knots * knots * u128::from(self.sharpest)).max(1)).unwrap_or(u32::MAX)
    }

    /// Greatest frequency in mHz at which no tick has more than one of its points.
    #[must_use]
    pub fn frequency_limit(&self, sample_rate_millihertz: u32) -> u32 {
        sample_rate_millihertz / u32::from(self.name.points).max(1)
    }

    /// Why a shaker of these limits must not do an excitation that names a table, where this is what
    /// it has; none where it may, or where no table is named.
    ///
    /// The order of the checks: number of points, check, frequency, acceleration.
    #[must_use]
    pub fn refusal(
        &self,
        excitation: &Excitation,
        limits: &ShakerLimits,
        sample_rate_millihertz: u32,
    ) -> Option<Refusal> {
        let name = excitation.table;
        if !name.is_some() {
            return None;
        }
        let [fewest, most] = POINTS;
        let count = usize::from(name.points);
        if !(fewest..=most).contains(&count) {
            return Some(Refusal::Points(if count < fewest { fewest as u32 } else { most as u32 }));
        }
        if self.name != name {
            return Some(Refusal::Table(self.name.check));
        }
        let limit = self.frequency_limit(sample_rate_millihertz);
        if excitation.frequency_millihertz > limit {
            return Some(Refusal::Frequency(limit));
        }
        let most = excitation.amplitudes().iter().copied().max().unwrap_or(0);
        let limit = self.amplitude_limit(limits.acceleration_millimetre_per_s2, excitation.frequency_millihertz);
        (most > limit).then_some(Refusal::Acceleration(limit))
    }
}

/// A table: its control points in 1/[`WHOLE`], and how many of them count.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Table {
    points: [i16; POINTS[1]],
    extent: Extent,
}

impl Default for Table {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl fmt::Debug for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Table").field("extent", &self.extent).finish_non_exhaustive()
    }
}

impl Table {
    /// No points.
    pub const EMPTY: Self =
        Self { points: [0; POINTS[1]], extent: Extent { name: TableName::NONE, steepest: 0, sharpest: 0 } };

    /// A table of so many points; none where they are too few or too many.
    #[must_use]
    pub fn of(points: &[i16]) -> Option<Self> {
        let mut table = Self::EMPTY;
        table.points.get_mut(..points.len())?.copy_from_slice(points);
        table.take(table.extent(u16::try_from(points.len()).ok()?)?);
        Some(table)
    }

    /// The points that count.
    #[must_use]
    pub fn points(&self) -> &[i16] {
        self.points.get(..usize::from(self.extent.name.points)).unwrap_or(&self.points)
    }

    /// Greatest slope, 1/turn.
    #[must_use]
    pub fn steepest(&self) -> f32 {
        self.extent.steepest as f32 * f32::from(self.extent.name.points) / f32::from(WHOLE)
    }

    /// What its points say of it.
    #[must_use]
    pub fn known(&self) -> Extent {
        self.extent
    }

    /// The parts that bring its points to a device.
    pub fn parts(&self) -> impl Iterator<Item = Part> + Clone + '_ {
        self.points().chunks(CHUNK).zip(0_u8..).map(|(chunk, place)| {
            let mut points = [0; CHUNK];
            points.iter_mut().zip(chunk).for_each(|(to, from)| *to = *from);
            Part::Points { place, points }
        })
    }

    /// Puts points in.
    ///
    /// # Errors
    /// The last place, where there is none such.
    pub(super) fn put(&mut self, place: u8, points: &[i16; CHUNK]) -> Result<(), u32> {
        let last = (POINTS[1] / CHUNK) as u32;
        // The last place has room for fewer.
        let to = self.points.chunks_mut(CHUNK).nth(usize::from(place)).ok_or(last)?;
        to.iter_mut().zip(points).for_each(|(to, from)| *to = *from);
        Ok(())
    }

    /// What its first `count` points would say; none where these are too few or too many.
    #[must_use]
    pub fn extent(&self, count: u16) -> Option<Extent> {
        let points = self.points.get(..usize::from(count)).filter(|points| points.len() >= POINTS[0])?;
        let (mut check, mut steepest, mut sharpest) = (0x811c_9dc5_u32, 0, 0);
        let mut before = i32::from(*points.last()?);
        let mut step_before = before - i32::from(*points.get(points.len() - 2)?);
        for &point in points {
            check = (check ^ u32::from(point as u16)).wrapping_mul(0x0100_0193);
            let step = i32::from(point) - before;
            steepest = steepest.max(step.unsigned_abs());
            sharpest = sharpest.max((step - step_before).unsigned_abs());
            (before, step_before) = (i32::from(point), step);
        }
        Some(Extent { name: TableName { points: count, check }, steepest, sharpest })
    }

    /// So many points count from now on.
    pub fn take(&mut self, extent: Extent) {
        self.extent = extent;
    }

    /// d₀ to d₃ at a phase, and u in 2⁻³¹.
    fn piece(&self, phase: u32) -> ([i32; 4], u32) {
        let count = usize::from(self.extent.name.points);
        let at = u64::from(phase) * count as u64;
        let (j, u) = ((at >> 32) as usize, (at as u32) >> 1);
        let around = |j: usize| i32::from(self.points.get(if j < count { j } else { j - count }).copied().unwrap_or(0));
        let [p, q, r, s] = [j + count.max(1) - 1, j, j + 1, j + 2].map(around);
        ([p + 4 * q + r, 3 * (r - p), 3 * (p - 2 * q + r), s - 3 * r + 3 * q - p], u)
    }

    /// y/a at a phase (turns · 2⁻³²), in 2⁻³¹; from −1 to 1 within 2⁻²⁶.
    fn share(&self, phase: u32) -> i64 {
        let ([d0, d1, d2, d3], u) = self.piece(phase);
        // |d| ≤ 6 · 2¹⁵, 6 · 2¹⁵, 12 · 2¹⁵ and 8 · 2¹⁵: every sum is below 2³¹.
        let times = |x: i32| ((i64::from(x) * i64::from(u)) >> 31) as i32;
        let sum = (d2 << PLACES) + times(d3 << PLACES);
        let sum = (d1 << PLACES) + times(sum);
        let sum = (d0 << PLACES) + times(sum);
        // 2³¹/(6 · 2²⁶) is 5 and a third.
        5 * i64::from(sum) + i64::from(sum / 3)
    }

    /// Displacement at an amplitude (nm) and a phase (turns · 2⁻³²), nm: rounded once, half away
    /// from zero; at most the amplitude, and ±(2³¹ − 1).
    #[must_use]
    pub fn displacement(&self, amplitude_nanometre: u32, phase: u32) -> i32 {
        let most = i32::try_from(amplitude_nanometre).unwrap_or(i32::MAX);
        rounded(i64::from(amplitude_nanometre).saturating_mul(self.share(phase))).clamp(-most, most)
    }

    /// y/a at a phase (turns · 2⁻³²), and its slope, 1/turn: for motion between ticks, which nobody
    /// needs to the last bit.
    #[must_use]
    pub fn slope(&self, phase: u32) -> [f32; 2] {
        let ([_, d1, d2, d3], u) = self.piece(phase);
        let u = u as f32 * (1.0 / 2_147_483_648.0);
        let slope = d1 as f32 + u * (2.0 * d2 as f32 + u * 3.0 * d3 as f32);
        let per_turn = f32::from(self.extent.name.points) / (6.0 * f32::from(WHOLE));
        [self.share(phase) as f32 * (1.0 / 2_147_483_648.0), slope * per_turn]
    }
}

#[cfg(test)]
mod tests;

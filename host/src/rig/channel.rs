//! A measured column: what it measures, in which unit, and how its values are read.

use serde::{Deserialize, Serialize};

use crate::record::Column;

/// One measured column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Name of the column; with `=` before it an expression over columns ([`super::computed`]).
    pub name: String,
    /// What the column measures, in the model's terms (`theta1`, `theta2`, `phi1`, `phi2`).
    pub measures: String,
    /// Unit of the column.
    pub unit: String,
    /// Counts a turn, for unit `count`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts_per_turn: Option<u32>,
    /// What the column's values are multiplied by to be in the unit; 1 where none. For counts 1 or
    /// −1 (mounted the other way round).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// What is added then, in the unit; 0 where none. For counts a whole number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// For counts: how many lie from where the angle is 0 to the encoder's index mark. A record
    /// that tells at which count the mark was seen then has a known zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub index_at: Option<f64>,
    /// Lowest bits of a record's counts that never change; none in a rig file.
    #[serde(skip)]
    pub stuck: Option<StuckBits>,
}

/// Lowest bits of a count that are stuck: a count shows a block of 2^bits counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StuckBits {
    /// How many, from bit 0 up.
    pub bits: u32,
    /// What they show.
    pub value: u32,
}

impl StuckBits {
    /// Counts that it shows as one.
    pub fn counts(self) -> f64 {
        f64::from(1_u32 << self.bits)
    }

    /// From a count to the middle of those that it stands for.
    pub fn middle(self) -> f64 {
        0.5 * self.counts() - f64::from(self.value)
    }
}

impl Channel {
    /// Factor from the column's unit to SI (rad, m, V, N); for counts 2π/N. A count c also stands
    /// for the middle of [c, c+1), see [`crate::record::Column::angle`].
    pub fn scale(&self) -> f64 {
        match self.unit.as_str() {
            "count" => core::f64::consts::TAU / f64::from(self.counts_per_turn.unwrap_or(1)),
            "deg" => core::f64::consts::PI / 180.0,
            "mm" => 1e-3,
            "um" => 1e-6,
            "mV" => 1e-3,
            "mN" => 1e-3,
            "kN" => 1e3,
            _ => 1.0,
        }
    }

    /// Size of one step of the counts, rad; the factor to SI of what does not count.
    pub fn step(&self) -> f64 {
        self.scale() * self.counts_a_step()
    }

    /// Counts that one shown count stands for: 1, or 2^k where k lowest bits are stuck.
    pub fn counts_a_step(&self) -> f64 {
        self.stuck.map_or(1.0, |s| s.counts())
    }

    /// From a count c to the middle of what it shows: ½ for [c, c + 1).
    pub fn middle(&self) -> f64 {
        self.stuck.map_or(0.5, |s| s.middle())
    }

    /// Whether values are taken as they stand.
    pub fn is_plain(&self) -> bool {
        self.gain.unwrap_or(1.0) == 1.0 && self.offset.unwrap_or(0.0) == 0.0
    }

    /// Applies gain and offset to values as they stand in a file. A count c, which stands for [c,
    /// c + 1), becomes −c − 1 for gain −1.
    ///
    /// # Errors
    /// Index of a count that leaves 32 bits.
    pub fn apply(&self, column: &mut Column) -> core::result::Result<(), usize> {
        if self.is_plain() {
            return Ok(());
        }
        let (gain, offset) = (self.gain.unwrap_or(1.0), self.offset.unwrap_or(0.0));
        match column {
            Column::Values(v) => v.iter_mut().for_each(|v| *v = gain * *v + offset),
            Column::Counts(c) => {
                for (i, c) in c.iter_mut().enumerate() {
                    let turned = if gain < 0.0 { -1 - i64::from(*c) } else { i64::from(*c) };
                    // Checked to be whole and within 32 bits when the rig file was read.
                    *c = i32::try_from(turned + offset as i64).map_err(|_| i)?;
                }
            }
        }
        Ok(())
    }
}

/// Units that a channel may have.
pub const UNITS: &[&str] =
    &["count", "rad", "deg", "m", "mm", "um", "V", "mV", "N", "mN", "kN", "A", "m/s", "m/s2", "1"];

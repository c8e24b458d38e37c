//! A measured column: what it measures, in which unit, and how its values are read.

use core::f64::consts::{PI, TAU};

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
    /// Values as they stand, which measure what the column is called.
    pub fn new(name: &str, unit: &str) -> Self {
        Self {
            name: name.to_owned(),
            measures: name.to_owned(),
            unit: unit.to_owned(),
            counts_per_turn: None,
            gain: None,
            offset: None,
            index_at: None,
            stuck: None,
        }
    }

    /// Factor from the column's unit to SI ([`Channel::si_unit`]); for counts 2π/N. A count c also
    /// stands for the middle of [c, c+1), see [`crate::record::Column::angle`].
    pub fn scale(&self) -> f64 {
        let size = self.in_si().map_or(1.0, |u| u.2);
        if self.unit == COUNT { size / f64::from(self.counts_per_turn.unwrap_or(1)) } else { size }
    }

    /// SI unit of its values times [`Channel::scale`]; the unit itself of what is none of [`UNITS`].
    pub fn si_unit(&self) -> &str {
        self.in_si().map_or(self.unit.as_str(), |u| u.1)
    }

    fn in_si(&self) -> Option<&'static (&'static str, &'static str, f64)> {
        IN_SI.iter().find(|u| u.0 == self.unit)
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

    /// Takes gain and offset off values in the unit again, so that [`Channel::apply`] leads back to
    /// them: what a file holds that is read with this channel.
    ///
    /// # Errors
    /// Index of a count that leaves 32 bits.
    pub fn take_off(&self, column: &mut Column) -> core::result::Result<(), usize> {
        if self.is_plain() {
            return Ok(());
        }
        let (gain, offset) = (self.gain.unwrap_or(1.0), self.offset.unwrap_or(0.0));
        match column {
            Column::Values(v) => v.iter_mut().for_each(|v| *v = (*v - offset) / gain),
            Column::Counts(c) => {
                for (i, c) in c.iter_mut().enumerate() {
                    *c = self.count_taken_off(*c).ok_or(i)?;
                }
            }
        }
        Ok(())
    }

    /// The same for one count; none where it leaves 32 bits.
    pub fn count_taken_off(&self, count: i32) -> Option<i32> {
        // Whole and within 32 bits, see [`Channel::apply`].
        let turned = i64::from(count) - self.offset.unwrap_or(0.0) as i64;
        i32::try_from(if self.gain.unwrap_or(1.0) < 0.0 { -1 - turned } else { turned }).ok()
    }
}

/// Unit of an encoder's column.
const COUNT: &str = "count";

/// Units that a channel may have, the SI unit of each and its size in that; counts are parts of a
/// turn.
const IN_SI: [(&str, &str, f64); 17] = [
    (COUNT, "rad", TAU),
    ("rad", "rad", 1.0),
    ("deg", "rad", PI / 180.0),
    ("m", "m", 1.0),
    ("mm", "m", 1e-3),
    ("um", "m", 1e-6),
    ("V", "V", 1.0),
    ("mV", "V", 1e-3),
    ("N", "N", 1.0),
    ("mN", "N", 1e-3),
    ("kN", "N", 1e3),
    ("N m", "N m", 1.0),
    ("mN m", "N m", 1e-3),
    ("A", "A", 1.0),
    ("m/s", "m/s", 1.0),
    ("m/s2", "m/s2", 1.0),
    ("1", "1", 1.0),
];

/// Units that a channel may have.
pub const UNITS: [&str; IN_SI.len()] = {
    let mut out = [""; IN_SI.len()];
    let mut k = 0;
    while k < out.len() {
        out[k] = IN_SI[k].0;
        k += 1;
    }
    out
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unit_has_its_si_unit_and_scales_can_be_taken_off() {
        let channel = |unit: &str| Channel { counts_per_turn: Some(4096), ..Channel::new("c", unit) };
        for (unit, si, scale) in
            [("count", "rad", TAU / 4096.0), ("mN", "N", 1e-3), ("kN", "N", 1e3), ("um", "m", 1e-6), ("1", "1", 1.0)]
        {
            let c = channel(unit);
            assert_eq!((c.si_unit(), c.scale()), (si, scale), "{unit}");
        }
        // What was taken off is read again.
        let turned = Channel { gain: Some(-1.0), offset: Some(10.0), ..channel("count") };
        let counts = Column::Counts(vec![9, 10, 2, -7]);
        let mut column = counts.clone();
        turned.take_off(&mut column).unwrap();
        assert_eq!(column, Column::Counts(vec![0, -1, 7, 16]));
        turned.apply(&mut column).unwrap();
        assert_eq!(column, counts);
        assert_eq!(turned.take_off(&mut Column::Counts(vec![0, i32::MIN])), Err(1));
        let volts = Channel { gain: Some(0.25), offset: Some(-2.0), ..channel("deg") };
        let mut column = Column::Values(vec![-2.0, 1.5]);
        volts.take_off(&mut column).unwrap();
        assert_eq!(column, Column::Values(vec![0.0, 14.0]));
        // What values are in after they were scaled is a unit of size 1.
        for unit in UNITS {
            assert_eq!(channel(channel(unit).si_unit()).scale(), 1.0, "{unit}");
        }
    }
}

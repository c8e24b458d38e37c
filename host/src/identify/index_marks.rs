//! Zeros that encoders' index marks tell.
//!
//! The device tells at which count within a turn each encoder's index mark was first seen since its
//! zero was set ([`crate::record::device_boot::EncoderZero`]). Where the rig file says how many
//! counts lie from angle 0 to the mark (`index_at`), a record's zero is z = 2π/N (seen − index_at),
//! to the nearest turn: known to a count, 2π/(N √12) as a standard error, however often the power
//! came and went.
//!
//! Limits: encoders are those of the channels that count, in the rig file's order, as at capture.

use core::f64::consts::TAU;

use crate::record::Record;
use crate::rig::measures::ObservedModel;
use crate::rig::{Channel, Rig};

/// Where the index marks of the sensors were seen, by record and sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Indices {
    seen: Vec<Vec<Option<Seen>>>,
}

/// A mark that was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    /// At which count.
    count: f64,
    /// Counts of a turn, and the size of one.
    turn: f64,
    scale: f64,
    /// How many counts it is from angle 0, where the rig file says so.
    at: Option<f64>,
}

/// To the nearest turn.
fn wrapped(counts: f64, turn: f64) -> f64 {
    counts - turn * (counts / turn).round()
}

impl Indices {
    /// Of records whose stretches each count from one zero.
    pub fn of(records: &[Record], rig: &Rig, bound: &ObservedModel) -> Self {
        let one = |record: &Record| bound.sensors.iter().map(|i| seen(record, &rig.channel, *i)).collect();
        Self { seen: records.iter().map(one).collect() }
    }

    fn at(&self, record: usize, sensor: usize) -> Option<&Seen> {
        self.seen.get(record)?.get(sensor)?.as_ref()
    }

    /// A sensor's zero and its standard error, rad, where they are known.
    pub fn zero(&self, record: usize, sensor: usize) -> Option<(f64, f64)> {
        let seen = self.at(record, sensor)?;
        Some((seen.scale * wrapped(seen.count - seen.at?, seen.turn), seen.scale / 12f64.sqrt()))
    }

    /// Counts from angle 0 to the mark of a sensor whose zero (rad) was found.
    pub fn mark(&self, record: usize, sensor: usize, zero: f64) -> Option<f64> {
        let seen = self.at(record, sensor)?;
        Some(wrapped(seen.count - zero / seen.scale, seen.turn))
    }
}

/// Where a record's device saw the mark of a channel's encoder, in the counts of the channel.
fn seen(record: &Record, channels: &[Channel], channel: usize) -> Option<Seen> {
    let c = &channels[channel];
    let turn = f64::from(c.counts_per_turn.filter(|_| c.unit == "count")?);
    let encoder = channels[..channel].iter().filter(|c| c.unit == "count").count();
    let boot = record.segments.first()?.boot;
    let index = f64::from(record.metadata.as_ref()?.told_of(boot)?.zeros.get(encoder)?.index?);
    // As a count is: one of an encoder that is mounted the other way round becomes −c − 1.
    let turned = if c.gain.unwrap_or(1.0) < 0.0 { -1.0 - index } else { index };
    Some(Seen { count: turned + c.offset.unwrap_or(0.0), turn, scale: TAU / turn, at: c.index_at })
}

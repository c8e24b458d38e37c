//! Records taken block by block: memory is that of one block, whatever the record's length.
//!
//! A block is a part of an unbroken stretch, all channels in SI units, wrapped angles made
//! continuous over the whole stretch: the samples are those that [`super::Record::read`] gives,
//! with gaps and missing values cut as there, the rig's rate telling what a gap is. Two things need
//! the whole record and are not done: an uneven clock is not made even, and its jitter is not told.
//! Whether a column of counts or of an angle wraps is told by all of it too: such a record is read
//! twice, unless it is whirl's own.

use std::ops::Range;
use std::path::Path;

use super::formats::{self, ReadOptions};
use super::rows::Rows;
use super::{Column, Losses, Metadata, rate, segments, time_fit, unwrap};
use crate::error::{BadInput, Result};
use crate::rig::{Rig, computed};
use crate::warning::Warning;

/// Numbers in a block, about: rows times channels.
const BLOCK: usize = 1 << 18;

/// A format that can be read block by block.
#[derive(Clone, Copy)]
pub(super) struct Streamed {
    /// Opens a file.
    pub(super) open: for<'a> fn(&'a Path, &'a Rig, &ReadOptions) -> Result<Box<dyn Source + 'a>>,
    /// How many rows it has, or about so many; none where that cannot be told.
    pub(super) rows: fn(&Path) -> Option<u64>,
}

/// Rows of a file, some at a time.
pub(super) trait Source {
    /// Appends up to `most` rows; false where there are no more.
    fn fill(&mut self, rows: &mut Rows<'_>, most: usize) -> Result<bool>;
    /// What was noticed; the error of a file that broke off, unless it may be recovered.
    fn warnings(&mut self, rows: &Rows<'_>) -> Result<Vec<Warning>>;
    /// What places count: "line" or "row".
    fn word(&self) -> &'static str;
    /// Whether the device's ticks are there.
    fn own(&self) -> bool;
    /// Metadata of a record of whirl's own.
    fn metadata(&self) -> Option<&Metadata>;
    /// Its losses.
    fn losses(&self) -> Option<&Losses>;
}

/// A part of an unbroken stretch.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Whether a stretch begins with it (otherwise it goes on with the one before).
    pub begins: bool,
    /// One vector for each channel of the rig, SI units.
    pub columns: Vec<Vec<f64>>,
}

/// What is known of a record once it has been read.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// What did not arrive.
    pub losses: Losses,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// About how many numbers (rows times channels) a record holds; none where its format cannot be
/// read block by block.
///
/// # Errors
/// A file that cannot be opened or is of no known format.
pub fn size(path: &Path, rig: &Rig) -> Result<Option<u64>> {
    let streamed = formats::of(path)?.stream.filter(|_| !computed::any(&rig.channel));
    Ok(streamed.and_then(|s| (s.rows)(path)).map(|n| n.saturating_mul(rig.channel.len() as u64)))
}

/// Reads a record, handing its blocks to `take` in their order.
///
/// # Errors
/// As [`super::Record::read`], and a format that cannot be read block by block.
pub fn read(path: &Path, rig: &Rig, options: &ReadOptions, take: &mut dyn FnMut(&Block)) -> Result<Summary> {
    blocks(path, rig, options, take).map_err(|e| formats::with_journal(e, path, rig))
}

fn blocks(path: &Path, rig: &Rig, options: &ReadOptions, take: &mut dyn FnMut(&Block)) -> Result<Summary> {
    let format = formats::of(path)?;
    let Some(streamed) = format.stream else {
        return Err(BadInput::new(format!("a record in the format {}", format.id), "Parquet or CSV")
            .in_file(path)
            .at("start of file")
            .remedy("Only these are read block by block: export the record as one of them"));
    };
    if options.resample {
        return Err(BadInput::new("--resample", "a record that is read as a whole")
            .in_file(path)
            .at("column t")
            .remedy("Resample the record before it is handed in, or cut it into shorter ones"));
    }
    if let Some(c) = rig.channel.iter().find(|c| computed::expression(c).is_some()) {
        return Err(BadInput::new(format!("the computed channel \"{}\"", c.name), "channels that are columns")
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", c.name))
            .remedy("Channels are computed only where a record is read as a whole: cut it into shorter ones, or compute the column before"));
    }
    let mut source = (streamed.open)(path, rig, options)?;
    let own = source.metadata().is_some();
    let moduli = if own { vec![None; rig.channel.len()] } else { moduli(streamed, path, rig, options)? };
    let mut carried = vec![unwrap::Carry::default(); rig.channel.len()];
    let mut wraps = vec![0u64; rig.channel.len()];
    let mut summary = pass(&mut *source, path, rig, &mut |rows, range, begins| {
        let mut columns = Vec::with_capacity(rows.columns.len());
        for (k, column) in rows.columns.iter().enumerate() {
            if begins {
                carried[k] = unwrap::Carry::default();
            }
            let mut part = match column {
                Column::Values(v) => Column::Values(v[range.clone()].to_vec()),
                Column::Counts(c) => Column::Counts(c[range.clone()].to_vec()),
            };
            rig.channel[k].apply(&mut part).map_err(|i| {
                let place = (rows.passed + range.start + i + 1) as u64;
                rows.beyond(place, k, "a count that leaves 32 bits with the channel's offset".to_owned())
            })?;
            if let Some(modulus) = moduli[k] {
                wraps[k] += unwrap::column(&mut part, modulus, &mut carried[k]).map_err(|i| {
                    let place = (rows.passed + range.start + i + 1) as u64;
                    rows.beyond(place, k, "a count that leaves 32 bits when unwrapped".to_owned())
                })?;
            }
            columns.push(part.angle(&rig.channel[k]));
        }
        take(&Block { begins, columns });
        Ok(())
    })?;
    for (k, modulus) in moduli.iter().enumerate() {
        if let (Some(modulus), true) = (modulus, wraps[k] > 0) {
            summary.warnings.push(segments::unwrapped_warning(&rig.channel[k], *modulus, wraps[k]));
        }
    }
    Ok(summary)
}

/// What each channel wraps at, none where it does not: the record read through.
fn moduli(streamed: Streamed, path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Vec<Option<f64>>> {
    if rig.channel.iter().all(|c| c.unit != "count" && unwrap::turn(c).is_none()) {
        return Ok(vec![None; rig.channel.len()]);
    }
    let mut spans = vec![unwrap::Span::default(); rig.channel.len()];
    let mut turns: Vec<Option<unwrap::Turns>> =
        rig.channel.iter().map(|c| unwrap::turn(c).map(unwrap::Turns::new)).collect();
    let mut first = (streamed.open)(path, rig, options)?;
    pass(&mut *first, path, rig, &mut |rows, range, begins| {
        for (k, column) in rows.columns.iter().enumerate() {
            match (column, &mut turns[k]) {
                (Column::Counts(x), _) => spans[k].add(&x[range.clone()], begins),
                (Column::Values(x), Some(turns)) => {
                    let mut part = Column::Values(x[range.clone()].to_vec());
                    // Values have no range that a gain could leave.
                    let _ = rig.channel[k].apply(&mut part);
                    if let Column::Values(x) = &part {
                        turns.add(x, begins);
                    }
                }
                (Column::Values(_), None) => {}
            }
        }
        Ok(())
    })?;
    let each = rig.channel.iter().zip(spans.iter().zip(&turns));
    let modulus = each.map(|(channel, (span, turns))| match turns {
        Some(turns) if turns.wrap() => unwrap::turn(channel),
        _ => span.modulus(channel),
    });
    Ok(modulus.collect())
}

/// Takes rows of a range, and whether a stretch begins with it.
type Take<'a> = dyn FnMut(&Rows<'_>, Range<usize>, bool) -> Result<()> + 'a;

/// Goes through a file once; `take` gets ranges of rows that belong to one stretch, and whether it
/// begins there.
fn pass(source: &mut dyn Source, path: &Path, rig: &Rig, take: &mut Take<'_>) -> Result<Summary> {
    let mut rows = Rows::new(path, rig, source.word(), source.own());
    rows.limit = usize::MAX;
    let most = (BLOCK / rig.channel.len().max(1)).max(256);
    let nominal = 1.0 / rig.sample_rate_hz;
    let mut losses = Losses::default();
    let (mut stretches, mut pooled, mut clock) = (0u64, time_fit::Pool::default(), time_fit::Running::default());
    // The last row is held back until the next one tells whether its stretch goes on.
    let (mut held, mut begins) = (false, true);
    loop {
        let more = source.fill(&mut rows, most)?;
        let count = rows.t.len();
        if count == 0 {
            if more {
                continue;
            }
            break;
        }
        if !held {
            let rough = time_fit::rough_step(&rows.t, nominal).unwrap_or(nominal);
            rate::check(path, rig, count as u64, rough)?;
        }
        let mut hole = vec![false; count];
        rows.missing.iter().flatten().for_each(|i| hole[*i] = true);
        losses.nan_rows += hole[usize::from(held)..].iter().filter(|h| **h).count() as u64;
        let mut begin = vec![false; count];
        begin[0] = begins;
        for i in 1..count {
            let lost = match &rows.device {
                // Ticks have been checked to increase.
                Some(d) => d.tick[i].abs_diff(d.tick[i - 1]).saturating_sub(1),
                None => segments::lost_between(rows.t[i] - rows.t[i - 1], nominal),
            };
            losses.gaps += u64::from(lost > 0);
            losses.lost_on_link = losses.lost_on_link.saturating_add(lost);
            begin[i] = lost > 0 || hole[i - 1];
        }
        let until = if more { count - 1 } else { count };
        let mut from = 0;
        while from < until {
            if hole[from] {
                from += 1;
                continue;
            }
            let to = (from + 1..until).find(|&i| begin[i] || hole[i]).unwrap_or(until);
            if begin[from] {
                pooled.add(&std::mem::take(&mut clock));
                stretches += 1;
            }
            rows.t[from..to].iter().for_each(|t| clock.add(*t));
            losses.received += (to - from) as u64;
            take(&rows, from..to, begin[from])?;
            from = to;
        }
        if !more {
            break;
        }
        (held, begins) = (true, begin[count - 1]);
        rows.keep_last();
    }
    let mut warnings = source.warnings(&rows)?;
    let all = (rows.passed + rows.t.len()) as u64;
    if all == 0 {
        return Err(segments::no_row(path));
    }
    if let Some((place, channel)) = rows.first_missing {
        warnings.push(segments::nan_warning(losses.nan_rows, all, rows.word, place, &rig.channel[channel].name));
    }
    if losses.received == 0 {
        return Err(segments::no_whole_row(path, rig));
    }
    pooled.add(&clock);
    let rate = rate::check(path, rig, all, pooled.step().unwrap_or(nominal))?;
    warnings.extend(segments::gap_warning(&losses, stretches));
    let own_rate = source.metadata().map(|m| m.sample_rate_hz).filter(|r| *r > 0.0 && rows.device.is_some());
    if let Some(stored) = source.losses() {
        losses = Losses { received: losses.received, nan_rows: losses.nan_rows, ..stored.clone() };
        rows.damage.count(&mut losses, true);
    } else {
        rows.damage.count(&mut losses, false);
    }
    Ok(Summary { sample_rate_hz: own_rate.unwrap_or(rate), losses, warnings })
}

#[cfg(test)]
#[path = "stream_tests.rs"]
mod tests;

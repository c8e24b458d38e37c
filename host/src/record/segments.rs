//! Rows into segments: gaps found and counted, clocks fitted, wrapped angles made continuous.
//!
//! A gap is a difference of more than 1.5 steps between neighbours (or ticks that do not follow
//! each other in a record of whirl's own), or a row with a missing cell. Lost rows of a gap Δt:
//! round(Δt/step) − 1.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use super::rows::{DeviceColumns, Rows};
use super::{Column, Losses, Metadata, Record, Segment, bridge, rate, time_fit, unwrap};
use crate::error::{BadInput, Result};
use crate::rig::{Channel, Rig, UNKNOWN_RATE};
use crate::suspects::{self, Numbering};
use crate::warning::Warning;
use crate::wording::format::{behind, rounded, significant};

/// Rms deviation of `t` from an even clock, in steps, from which a warning is given.
const JITTER_WARNING: f64 = 0.05;

/// Builds the record. `metadata` and `losses` are those that a record of whirl's own carries.
pub(super) fn assemble(
    mut rows: Rows<'_>,
    metadata: Option<Metadata>,
    stored_losses: Option<Losses>,
    mut warnings: Vec<Warning>,
) -> Result<Record> {
    super::computing::compute(&mut rows)?;
    if rows.resample && !rows.t.is_empty() && rows.rig.sample_rate_hz != UNKNOWN_RATE {
        super::resample::even(&mut rows, &mut warnings);
    }
    let rig = rows.rig;
    if rows.t.is_empty() {
        return Err(no_row(rows.path));
    }
    scaled(&mut rows)?;
    let nominal = nominal_step(&rows);
    let rough = time_fit::rough_step(&rows.t, nominal).unwrap_or(nominal);
    let mut losses = Losses::default();
    let ranges = split(&rows, rough, &mut losses);
    // Resampled rows have a value everywhere, and a warning of their own.
    if let Some((place, channel)) = rows.first_missing.filter(|_| losses.nan_rows > 0) {
        let (missing, all) = (losses.nan_rows, rows.t.len() as u64);
        warnings.push(nan_warning(missing, all, rows.word, place, &rig.channel[channel].name));
    }
    if ranges.is_empty() {
        return Err(no_whole_row(rows.path, rig));
    }
    let sums: Vec<time_fit::Sums> = ranges.iter().map(|r| time_fit::sums(&rows.t[r.clone()])).collect();
    let step = time_fit::pooled_step(&sums).unwrap_or(rough);
    let rate_hz = rate::check(rows.path, rig, rows.t.len() as u64, step)?;

    // A record of whirl's own knows its clock; all others are fitted.
    let own_step =
        metadata.as_ref().map(|m| m.sample_rate_hz).filter(|r| *r > 0.0 && rows.device.is_some()).map(|r| 1.0 / r);
    let rate_hz = own_step.map_or(rate_hz, |step| 1.0 / step);
    let clocks = clocks(&rows, &ranges, &sums, own_step, step)?;
    let modulus = |(column, channel)| unwrap::modulus(column, channel, &ranges).filter(|_| metadata.is_none());
    let moduli: Vec<Option<f64>> = rows.columns.iter().zip(&rig.channel).map(modulus).collect();
    let columns = columns(&mut rows, &ranges, &moduli, &mut warnings)?;
    let segments = segments(&mut rows, &ranges, clocks, columns, metadata.as_ref(), step);
    losses.received = segments.iter().map(|s| s.len() as u64).sum();
    let worst = segments.iter().map(|s| s.jitter_s / s.step_s).fold(0.0, f64::max);
    if worst > JITTER_WARNING {
        warnings.push(Warning::new(
            "jitter",
            format!("t deviates from an even clock by {:.1} % of a step (rms)", 100.0 * worst),
            "Print t with more digits; if the samples themselves were taken unevenly, read them with --resample",
        ));
    }
    let losses = accounted(&rows, losses, stored_losses);
    let mut record = Record {
        path: rows.path.to_path_buf(),
        sample_rate_hz: rate_hz,
        channels: rig.channel.clone(),
        segments,
        losses,
        warnings,
        metadata,
        numbering: None,
    };
    let first_rows = ranges.iter().map(|r| r.start).collect();
    if rig.sample_rate_hz == UNKNOWN_RATE {
        // Columns of which nothing is known yet: what they may do is not known either.
        record.warnings.extend(gap_warning(&record.losses, record.segments.len() as u64));
        return Ok(record);
    }
    let (word, places) = if rows.resample { ("resampled row", vec![]) } else { (rows.word, rows.places) };
    let stretches = record.segments.iter().map(|s| (s.start_s, s.step_s, s.len())).collect();
    let numbering = Arc::new(Numbering { word, first_rows, places, stretches });
    record.numbering = Some(numbering.clone());
    suspects::examine(&mut record, rig, &numbering);
    let sensors = suspects::sensors(&record, rig);
    let filled = bridge::fill(&mut record, &moduli, &sensors);
    let stretches = record.segments.len() as u64;
    record.warnings.extend(gap_warning(&record.losses, stretches));
    record.warnings.extend(filled.warning(stretches));
    Ok(record)
}

/// The clock of each stretch.
fn clocks(
    rows: &Rows<'_>,
    ranges: &[Range<usize>],
    sums: &[time_fit::Sums],
    own_step: Option<f64>,
    step: f64,
) -> Result<Vec<time_fit::Clock>> {
    let clock = |(range, sums): (&Range<usize>, &time_fit::Sums)| {
        let t = &rows.t[range.clone()];
        let clock = match own_step {
            Some(step_s) => time_fit::Clock { start_s: t[0], step_s, jitter_s: 0.0 },
            None => time_fit::clock(t, sums, step),
        };
        if (0.5 * step..=2.0 * step).contains(&clock.step_s) { Ok(clock) } else { Err(other_clock(rows, range, step)) }
    };
    ranges.iter().zip(sums).map(clock).collect()
}

/// The channels of each stretch, what was recorded modulo of something made continuous. A record
/// without a gap is not copied.
fn columns(
    rows: &mut Rows<'_>,
    ranges: &[Range<usize>],
    moduli: &[Option<f64>],
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Vec<Column>>> {
    let mut wraps = vec![0u64; moduli.len()];
    let mut out = Vec::with_capacity(ranges.len());
    for range in ranges {
        let mut parts: Vec<Column> = if is_whole(rows, ranges) {
            std::mem::take(&mut rows.columns)
        } else {
            rows.columns.iter().map(|c| cut(c, range)).collect()
        };
        for (k, part) in parts.iter_mut().enumerate() {
            let Some(modulus) = moduli[k] else { continue };
            wraps[k] += unwrap::column(part, modulus, &mut unwrap::Carry::default()).map_err(|i| {
                let place = (rows.passed + range.start + i + 1) as u64;
                rows.beyond(place, k, "a count that leaves 32 bits when unwrapped".to_owned())
            })?;
        }
        out.push(parts);
    }
    for ((modulus, wraps), channel) in moduli.iter().zip(wraps).zip(&rows.rig.channel) {
        if let Some(m) = modulus.filter(|_| wraps > 0) {
            warnings.push(unwrapped_warning(channel, m, wraps));
        }
    }
    Ok(out)
}

/// Whether one stretch holds all rows.
fn is_whole(rows: &Rows<'_>, ranges: &[Range<usize>]) -> bool {
    ranges.len() == 1 && ranges[0] == (0..rows.t.len())
}

/// The stretches with their clocks, channels and what the device told.
fn segments(
    rows: &mut Rows<'_>,
    ranges: &[Range<usize>],
    clocks: Vec<time_fit::Clock>,
    columns: Vec<Vec<Column>>,
    metadata: Option<&Metadata>,
    step: f64,
) -> Vec<Segment> {
    let whole = is_whole(rows, ranges);
    let mut device = rows.device.take();
    let parts = ranges.iter().zip(clocks).zip(columns);
    let segment = |((range, clock), columns): ((&Range<usize>, time_fit::Clock), Vec<Column>)| {
        let mut own = |column: fn(&mut DeviceColumns) -> &mut Vec<u32>| {
            device.as_mut().map(column).map(|c| if whole { std::mem::take(c) } else { c[range.clone()].to_vec() })
        };
        let (phase, amplitude_nm) = (own(|d| &mut d.phase), own(|d| &mut d.amplitude_nm));
        let first_tick = match &device {
            Some(d) => d.tick[range.start],
            // Saturates for absurdly long gaps.
            None => ((rows.t[range.start] - rows.t[0]) / step).round() as i64,
        };
        Segment {
            first_tick,
            boot: metadata.filter(|_| device.is_some()).map_or(0, |m| m.boot_at(first_tick)),
            start_s: clock.start_s,
            step_s: clock.step_s,
            jitter_s: clock.jitter_s,
            columns,
            phase,
            amplitude_nm,
            filled: Vec::new(),
        }
    };
    parts.map(segment).collect()
}

/// What was lost: as the record's own account says, where it has one, with the rows found empty or
/// damaged.
fn accounted(rows: &Rows<'_>, found: Losses, stored: Option<Losses>) -> Losses {
    let own = stored.is_some();
    let mut losses = match stored {
        Some(stored) => Losses { received: found.received, nan_rows: found.nan_rows, ..stored },
        None => found,
    };
    rows.damage.count(&mut losses, own);
    losses
}

/// The step that the rig file says; where it says none, the middle one of the rows.
fn nominal_step(rows: &Rows<'_>) -> f64 {
    if rows.rig.sample_rate_hz != UNKNOWN_RATE {
        return 1.0 / rows.rig.sample_rate_hz;
    }
    let mut steps: Vec<f64> = rows.t.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 1.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Applies the channels' gains and offsets.
fn scaled(rows: &mut Rows<'_>) -> Result<()> {
    for k in 0..rows.columns.len() {
        if let Err(i) = rows.rig.channel[k].apply(&mut rows.columns[k]) {
            let place = (rows.passed + i + 1) as u64;
            return Err(rows.beyond(place, k, "a count that leaves 32 bits with the channel's offset".to_owned()));
        }
    }
    Ok(())
}

/// The error for a stretch whose rows follow each other otherwise than those of the record do:
/// names the first that does.
fn other_clock(rows: &Rows<'_>, range: &Range<usize>, step: f64) -> BadInput {
    let i = (range.start + 1..range.end).find(|&i| rows.t[i] - rows.t[i - 1] < 0.5 * step).unwrap_or(range.start);
    let before = rows.t[i.saturating_sub(1)];
    // A CSV's first row is its second line.
    let place = rows.passed + i + if rows.word == "line" { 2 } else { 1 };
    rows.bad(
        place as u64,
        "t",
        format!("{} after {before}", rows.t[i]),
        &format!("a time about {} s later", significant(step, 4)),
    )
    .remedy("Mend the times, or take these rows out: they do not follow the record's clock")
}

/// Ranges of rows without gap, losses counted.
fn split(rows: &Rows<'_>, step: f64, losses: &mut Losses) -> Vec<Range<usize>> {
    let mut holes: Vec<usize> = rows.missing.iter().flatten().copied().collect();
    holes.sort_unstable();
    holes.dedup();
    losses.nan_rows = holes.len() as u64;
    let ticks = rows.device.as_ref().map(|d| &d.tick);
    let mut ranges = Vec::new();
    let (mut from, mut hole) = (0, holes.iter().copied().peekable());
    for i in 0..rows.t.len() {
        if i > 0 {
            let lost = match ticks {
                // Ticks have been checked to increase. Between two boots one is missing at least
                // (see capture::accounting).
                Some(tick) => tick[i].abs_diff(tick[i - 1]).saturating_sub(1),
                None => lost_between(rows.t[i] - rows.t[i - 1], step),
            };
            if lost > 0 {
                losses.gaps += 1;
                losses.lost_on_link = losses.lost_on_link.saturating_add(lost);
                if from < i {
                    ranges.push(from..i);
                }
                from = i;
            }
        }
        if hole.next_if_eq(&i).is_some() {
            if from < i {
                ranges.push(from..i);
            }
            from = i + 1;
        }
    }
    if from < rows.t.len() {
        ranges.push(from..rows.t.len());
    }
    ranges
}

/// Rows lost between neighbours so far apart.
pub(super) fn lost_between(gap: f64, step: f64) -> u64 {
    if gap > 1.5 * step { ((gap / step).round() - 1.0).max(1.0) as u64 } else { 0 }
}

/// Rows (how many of how many) without a value in some channel.
pub(super) fn nan_warning(missing: u64, all: u64, word: &str, place: u64, channel: &str) -> Warning {
    Warning::new(
        "nan-is-gap",
        format!(
            "{missing} of {all} rows have no value in some channel, the first at {word} {place} in {channel}: each is a gap"
        ),
        "Find out why the sensor was silent there",
    )
}

/// The error for a record without a row.
pub(super) fn no_row(path: &Path) -> BadInput {
    BadInput::new("no row", "at least one row below the header")
        .in_file(path)
        .at("after the header")
        .remedy("Record again, or export the data with the header")
}

/// The error for a record without a single whole row.
pub(super) fn no_whole_row(path: &Path, rig: &Rig) -> BadInput {
    BadInput::new("no row with a value in every channel", "samples of all channels of the rig file")
        .in_file(path)
        .at(format!("columns {}", rig.channel.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ")))
        .remedy("Leave the empty channel out of the rig file, or export the record again")
}

/// Jumps that were undone.
pub(super) fn unwrapped_warning(c: &Channel, modulus: f64, wraps: u64) -> Warning {
    let unit = if c.unit == "count" { " counts".to_owned() } else { behind(&c.unit) };
    let were = if wraps == 1 { "was" } else { "were" };
    Warning::new(
        "unwrapped",
        format!("{} is recorded modulo {}{unit}: {} {were} undone", c.name, rounded(modulus, 6), plural(wraps, "jump")),
        "Right as long as no arm turns by half of that within one sample",
    )
}

/// A count with its noun.
pub(super) fn plural(count: u64, noun: &str) -> String {
    let ending = match (count, noun.ends_with("ch")) {
        (1, _) => "",
        (_, true) => "es",
        (_, false) => "s",
    };
    format!("{count} {noun}{ending}")
}

/// Gaps that were found, where there are any.
pub(super) fn gap_warning(losses: &Losses, segments: u64) -> Option<Warning> {
    let (gaps, rows) = (plural(losses.gaps, "gap"), plural(losses.lost_on_link, "row"));
    let text = format!("{gaps} in t: {rows} missing, {} left", plural(segments, "unbroken stretch"));
    (losses.gaps > 0).then(|| Warning::new("gaps", text, "Each stretch is used by itself"))
}

/// One segment's part of a column.
fn cut(column: &Column, range: &Range<usize>) -> Column {
    match column {
        Column::Values(v) => Column::Values(v[range.clone()].to_vec()),
        Column::Counts(c) => Column::Counts(c[range.clone()].to_vec()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where no rate is known it is the rows' middle step; one row has none, and counts as a second.
    #[test]
    fn an_unknown_rate_is_that_of_the_rows() {
        let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"m\"\n";
        let mut rig = crate::rig::Rig::parse(text, std::path::Path::new("rig.toml")).unwrap();
        rig.sample_rate_hz = UNKNOWN_RATE;
        let step = |t: &[f64]| {
            let mut rows = Rows::new(std::path::Path::new("r.csv"), &rig, "line", false);
            rows.t = t.to_vec();
            nominal_step(&rows)
        };
        assert_eq!((step(&[]), step(&[7.0])), (1.0, 1.0));
        assert_eq!((step(&[7.0, 7.5]), step(&[0.0, 0.25, 0.5, 4.0])), (0.5, 0.25));
    }

    #[test]
    fn counts_have_their_plurals() {
        assert_eq!((plural(1, "gap"), plural(2, "gap")), ("1 gap".to_owned(), "2 gaps".to_owned()));
        assert_eq!(plural(3, "unbroken stretch"), "3 unbroken stretches");
    }
}

//! Regression rows of the wire into a record of rows: messages into windows, windows into runs.
//!
//! A window counts only whole: one of which a message is missing, doubled or not finite is lost,
//! and counted. A run ends where a window does not follow the one before by half of its length.

use std::path::PathBuf;

use whirl_shared::frame::Rows;
use whirl_shared::frame::regression::{Binary24, ROW_LEN};
use whirl_shared::tick::HELLO_LATE;

use crate::error::Result;
use crate::record::regression_rows::{Footer, RowsWriter, Window};
use crate::record::{Losses, Metadata};

/// Messages of a window that is on its way.
#[derive(Debug)]
struct Partial {
    tick: i64,
    first: Rows,
    /// Beyond all where a message is missing.
    next_frequency: usize,
    rows: Vec<[Binary24; ROW_LEN]>,
}

/// Collects windows and writes them.
pub(super) struct RowsRecorder {
    output: PathBuf,
    writer: Option<RowsWriter>,
    partial: Option<Partial>,
    /// The last window: its number on the device, and as it was written.
    last: Option<(u32, Window)>,
    /// The device has restarted since the last window.
    restarted: bool,
    /// The device's tick of the newest window seen, and where that is on the record's line; what is
    /// added to its ticks before that is known.
    line: Option<(u32, i64)>,
    base: i64,
    /// Ticks to record.
    limit: Option<i64>,
    /// From when on the time is counted: the first that was seen of the device.
    begin: Option<i64>,
    /// Of the first window in the record.
    first_tick: Option<i64>,
    covered: u64,
    pub(super) windows: u64,
    pub(super) lost: u64,
    /// Of these, since the last whole window.
    lost_since_window: u64,
    /// No further window fits.
    pub(super) full: bool,
}

impl RowsRecorder {
    pub(super) fn new(output: PathBuf, limit: Option<i64>) -> Self {
        Self {
            output,
            writer: None,
            partial: None,
            last: None,
            restarted: false,
            line: None,
            base: 0,
            limit,
            begin: None,
            first_tick: None,
            covered: 0,
            windows: 0,
            lost: 0,
            lost_since_window: 0,
            full: false,
        }
    }

    /// The device has restarted: its ticks begin anew.
    pub(super) fn restarted(&mut self) {
        self.drop_partial();
        if let Some((_, newest)) = self.line.take() {
            self.restarted = true;
            self.base = newest.saturating_add(1);
        }
    }

    /// Whether a hello of the same boot id tells a tick before those that have come.
    pub(super) fn goes_back(&self, tick: u32) -> bool {
        self.line.is_some_and(|(known, _)| known.wrapping_sub(tick).cast_signed() > HELLO_LATE.cast_signed())
    }

    /// A tick of the device on the record's line.
    fn place(&mut self, tick: u32) -> i64 {
        let placed = match self.line {
            Some((known, line)) => line.saturating_add(i64::from(tick.wrapping_sub(known).cast_signed())),
            None => self.base.saturating_add(i64::from(tick)),
        };
        if self.line.is_none_or(|(_, line)| placed > line) {
            self.line = Some((tick, placed));
        }
        placed
    }

    fn drop_partial(&mut self) {
        let dropped = u64::from(self.partial.take().is_some());
        self.lost += dropped;
        self.lost_since_window += dropped;
    }

    /// The device is at a tick: the recording begins there if it has not, and ends where its time
    /// is over, whether windows come or not.
    pub(super) fn time(&mut self, tick: u32) {
        let placed = self.place(tick);
        let begin = *self.begin.get_or_insert(placed);
        self.full |= self.limit.is_some_and(|limit| placed.saturating_sub(begin) > limit);
    }

    /// Takes a message whose window belongs to the recording; `metadata` for the first.
    ///
    /// # Errors
    /// A full disk.
    pub(super) fn push(&mut self, rows: &Rows, metadata: impl FnOnce() -> Metadata) -> Result<()> {
        let tick = self.place(rows.tick);
        let start = tick.saturating_sub(i64::from(rows.window_ticks)).saturating_add(1);
        let begin = *self.begin.get_or_insert(start);
        let end = tick.saturating_sub(begin).saturating_add(1);
        if start < begin || self.limit.is_some_and(|limit| end > limit) {
            self.full |= start >= begin;
            return Ok(());
        }
        let frequency = usize::from(rows.frequency);
        match &mut self.partial {
            Some(p) if p.tick == tick && p.next_frequency == frequency && p.first.window == rows.window => {
                p.rows.extend(&rows.rows);
                p.next_frequency += rows.rows.len() / 2;
            }
            // A message that was repeated on the way, or one that comes behind a gap: then the
            // window is lost.
            Some(p) if p.tick == tick => {
                if frequency > p.next_frequency {
                    p.next_frequency = usize::MAX;
                }
            }
            _ => {
                self.drop_partial();
                if self.last.as_ref().is_some_and(|(_, last)| tick <= last.tick) {
                    return Ok(());
                }
                self.partial = Some(Partial {
                    tick,
                    first: rows.clone(),
                    next_frequency: if frequency == 0 { rows.rows.len() / 2 } else { usize::MAX },
                    rows: rows.rows.to_vec(),
                });
            }
        }
        let complete = self.partial.as_ref().is_some_and(|p| p.next_frequency == usize::from(rows.last_frequency) + 1);
        if complete && let Some(partial) = self.partial.take() {
            self.window(&partial, metadata)?;
        }
        Ok(())
    }

    fn window(&mut self, partial: &Partial, metadata: impl FnOnce() -> Metadata) -> Result<()> {
        let rows = &partial.first;
        let number = |row: &[Binary24; ROW_LEN], i: usize| f32::from(row[i]);
        // The imaginary row of m = 0 is nothing.
        let kept = || partial.rows.iter().enumerate().filter(|(i, _)| *i != 1).map(|(_, row)| row);
        let window = Window {
            run: 0,
            index: 0,
            tick: partial.tick,
            window_ticks: rows.window_ticks,
            phase_increment: rows.phase_increment,
            amplitude_nm: rows.amplitude_nanometre,
            first: kept().map(|row| core::array::from_fn(|i| number(row, i))).collect(),
            second: kept().map(|row| core::array::from_fn(|i| number(row, 7 + i))).collect(),
        };
        let finite = window.first.as_flattened().iter().chain(window.second.as_flattened()).all(|x| x.is_finite());
        if !finite || window.window_ticks < 16 || window.phase_increment == 0 {
            self.lost += 1;
            self.lost_since_window += 1;
            return Ok(());
        }
        let half = i64::from(window.window_ticks / 2);
        let window = match &self.last {
            None => window,
            Some((number, last)) => {
                let ahead = window.tick - last.tick;
                let same_run = !self.restarted && rows.window == number.wrapping_add(1) && ahead == half;
                // Of the same stretch of the device, but some are missing; those that came in part
                // are counted already.
                let missing = i64::from(rows.window.wrapping_sub(*number).wrapping_sub(1));
                if !same_run && !self.restarted && (missing + 1).saturating_mul(half) == ahead {
                    self.lost += missing.unsigned_abs().saturating_sub(self.lost_since_window);
                }
                let (run, index) = if same_run { (last.run, last.index + 1) } else { (last.run + 1, 0) };
                Window { run, index, ..window }
            }
        };
        self.restarted = false;
        let begin = self.begin.unwrap_or(0);
        self.full |= self.limit.is_some_and(|limit| window.tick + 1 - begin + half > limit);
        self.first_tick.get_or_insert(window.tick - i64::from(window.window_ticks) + 1);
        let fresh = self.last.as_ref().map_or(i64::MAX, |(_, last)| window.tick - last.tick);
        self.covered += fresh.clamp(0, i64::from(window.window_ticks)).unsigned_abs();
        if self.writer.is_none() {
            self.writer = Some(RowsWriter::create(&self.output, metadata())?);
        }
        if let Some(writer) = &mut self.writer {
            writer.push(window.clone())?;
        }
        self.windows += 1;
        self.lost_since_window = 0;
        self.last = Some((rows.window, Window { first: Vec::new(), second: Vec::new(), ..window }));
        Ok(())
    }

    /// Tick of the first sample under a window.
    pub(super) fn first_tick(&self) -> Option<i64> {
        self.first_tick
    }

    /// Tick of the last sample under a window.
    pub(super) fn last_tick(&self) -> Option<i64> {
        self.last.as_ref().map(|(_, window)| window.tick)
    }

    /// Unbroken stretches.
    pub(super) fn runs(&self) -> u64 {
        self.last.as_ref().map_or(0, |(_, window)| window.run as u64 + 1)
    }

    /// Samples under the windows.
    pub(super) fn covered(&self) -> u64 {
        self.covered
    }

    /// Ends the record.
    ///
    /// # Errors
    /// A full disk.
    pub(super) fn finish(&mut self, losses: &Losses) -> Result<()> {
        self.drop_partial();
        let footer = Footer { windows: self.windows, windows_lost: self.lost, losses: losses.clone() };
        self.writer.take().map_or(Ok(()), |writer| writer.finish(footer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::ReadOptions;
    use crate::record::regression_rows::RowsRecord;

    /// Messages of a window, two frequencies each, m from 0 to 4.
    fn messages(window: u32, tick: u32) -> Vec<Rows> {
        (0..3_u8)
            .map(|i| {
                let n = if i < 2 { 4 } else { 2 };
                let mut rows = heapless::Vec::new();
                for k in 0..n {
                    let value = f32::from(10 * i + k) + window as f32 * 100.0;
                    rows.push(core::array::from_fn(|j| (value + j as f32 / 16.0).into())).unwrap();
                }
                Rows {
                    tick,
                    window_ticks: 200,
                    window,
                    phase_increment: 429_496_730,
                    amplitude_nanometre: 5,
                    frequency: 2 * i,
                    last_frequency: 4,
                    rows,
                }
            })
            .collect()
    }

    fn record(list: &[Rows], limit: Option<i64>) -> (RowsRecord, u64) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r");
        let mut recorder = RowsRecorder::new(path.clone(), limit);
        for rows in list {
            recorder.push(rows, Metadata::default).unwrap();
        }
        recorder.finish(&Losses::default()).unwrap();
        (RowsRecord::read(&path, &ReadOptions::default()).unwrap(), recorder.covered())
    }

    #[test]
    fn windows_come_out_whole_and_in_order() {
        let list: Vec<Rows> = (1..=4).flat_map(|w| messages(w, (u32::MAX - 150).wrapping_add(100 * w))).collect();
        let (read, covered) = record(&list, None);
        let places: Vec<_> = read.windows.iter().map(|w| (w.run, w.index, w.tick - read.windows[0].tick)).collect();
        assert_eq!(places, [(0, 0, 0), (0, 1, 100), (0, 2, 200), (0, 3, 300)]);
        assert_eq!((read.footer.windows, read.footer.windows_lost, covered), (4, 0, 500));
        // Real of 0, then both of 1 to 4.
        let column: Vec<f32> = read.windows[0].first.iter().map(|row| row[0] - 100.0).collect();
        assert_eq!(column, [0.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0, 20.0, 21.0]);
        assert_eq!(read.windows[0].second[0], [7.0, 8.0, 9.0, 10.0, 11.0, 12.0].map(|j| 100.0 + j / 16.0));
    }

    #[test]
    fn what_is_not_whole_is_lost_and_counted() {
        let mut list: Vec<Rows> = (1..=6).flat_map(|w| messages(w, 1_000 + 100 * w)).collect();
        list.insert(5, list[4].clone());
        // Middle of window 3, start of window 5.
        list.retain(|r| (r.window, r.frequency) != (3, 2) && (r.window, r.frequency) != (5, 0));
        let (read, covered) = record(&list, None);
        let places: Vec<_> = read.windows.iter().map(|w| (w.run, w.index, w.tick)).collect();
        assert_eq!(places, [(0, 0, 1_100), (0, 1, 1_200), (1, 0, 1_400), (2, 0, 1_600)]);
        // Incomplete, and missing in the numbers: told once.
        assert_eq!((read.footer.windows, read.footer.windows_lost), (4, 2));
        assert_eq!(covered, 200 + 100 + 200 + 200);
    }

    #[test]
    fn the_time_asked_for_ends_it_without_windows_too() {
        let dir = tempfile::tempdir().unwrap();
        let mut recorder = RowsRecorder::new(dir.path().join("r"), Some(450));
        for tick in [100, 300, 550] {
            recorder.time(tick);
            assert!(!recorder.full);
        }
        recorder.time(551);
        assert!(recorder.full && recorder.windows == 0);
    }

    #[test]
    fn the_time_asked_for_ends_it() {
        let list: Vec<Rows> = (1..=9).flat_map(|w| messages(w, 100 * w + 99)).collect();
        let (read, covered) = record(&list, Some(450));
        assert_eq!((read.windows.len(), covered), (3, 400));
    }
}

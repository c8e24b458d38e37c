//! What is done to a record: samples left out as gaps, stretches split, slips taken back.

use crate::record::{Column, Record, Segment};

/// Samples beside a stretch that is left out in which nothing else is looked for.
const MARGIN: usize = 8;

/// All that is to be done.
#[derive(Clone, Debug, Default)]
pub struct Mending {
    /// (segment, first, last + 1) of samples to leave out; empty to split only.
    cuts: Vec<(usize, usize, usize)>,
    /// (channel, segment, first sample, what to subtract from there on).
    slips: Vec<(usize, usize, usize, f64)>,
}

impl Mending {
    /// Leaves samples out.
    pub fn leave_out(&mut self, segment: usize, from: usize, to: usize) {
        self.cuts.push((segment, from, to));
    }

    /// Splits a segment before a sample.
    pub fn split(&mut self, segment: usize, at: usize) {
        self.cuts.push((segment, at, at));
    }

    /// Subtracts `size` from a channel from a sample on, to the end of the record.
    pub fn take_back(&mut self, channel: usize, segment: usize, from: usize, size: f64) {
        self.slips.push((channel, segment, from, size));
    }

    /// Whether samples lie in or at something left out.
    pub fn near(&self, segment: usize, from: usize, to: usize) -> bool {
        self.cuts.iter().any(|&(s, a, b)| s == segment && from < b + MARGIN && a < to + MARGIN)
    }

    /// Samples of the longest stretch that would be left.
    pub fn longest_left(&self, record: &Record) -> usize {
        let mut cuts = self.cuts.clone();
        cuts.sort_unstable();
        let mut longest = 0;
        for (k, s) in record.segments.iter().enumerate() {
            let mut from = 0;
            for &(_, a, b) in cuts.iter().filter(|c| c.0 == k) {
                longest = longest.max(a.saturating_sub(from));
                from = from.max(b);
            }
            longest = longest.max(s.len().saturating_sub(from));
        }
        longest
    }

    /// Leaves all samples where they are.
    pub fn keep_all(&mut self) {
        self.cuts.clear();
    }

    /// Does it all.
    pub fn apply(mut self, record: &mut Record) {
        for &(channel, segment, from, size) in &self.slips {
            for (k, s) in record.segments.iter_mut().enumerate().skip(segment) {
                let first = if k == segment { from } else { 0 };
                match &mut s.columns[channel] {
                    Column::Counts(c) => {
                        // A slip of counts is within the range of counts; what would leave it
                        // stays.
                        let size = size.round() as i64;
                        c[first..].iter_mut().for_each(|v| *v = i32::try_from(i64::from(*v) - size).unwrap_or(*v));
                    }
                    Column::Values(c) => c[first..].iter_mut().for_each(|v| *v -= size),
                }
            }
        }
        if self.cuts.is_empty() {
            return;
        }
        self.cuts.sort_unstable();
        let mut segments = Vec::with_capacity(record.segments.len() + self.cuts.len());
        for (k, segment) in std::mem::take(&mut record.segments).into_iter().enumerate() {
            let mut cuts = self.cuts.iter().filter(|c| c.0 == k).peekable();
            if cuts.peek().is_none() {
                segments.push(segment);
                continue;
            }
            let end = segment.len();
            let whole = Whole::new(segment);
            let mut from = 0;
            for &(_, a, b) in cuts {
                if a > from {
                    segments.push(whole.part(from, a.min(end)));
                }
                from = from.max(b).min(end);
            }
            if from < end {
                segments.push(whole.part(from, end));
            }
        }
        record.segments = segments;
    }
}

/// A segment whose samples are set aside, so that its parts copy no more than their own.
struct Whole {
    shell: Segment,
    columns: Vec<Column>,
    phase: Option<Vec<u32>>,
    amplitude_nm: Option<Vec<u32>>,
}

impl Whole {
    fn new(mut segment: Segment) -> Self {
        let (columns, phase) = (std::mem::take(&mut segment.columns), segment.phase.take());
        let amplitude_nm = segment.amplitude_nm.take();
        Self { shell: segment, columns, phase, amplitude_nm }
    }

    /// Samples `from` to before `to`.
    fn part(&self, from: usize, to: usize) -> Segment {
        let column = |c: &Column| match c {
            Column::Counts(c) => Column::Counts(c[from..to].to_vec()),
            Column::Values(v) => Column::Values(v[from..to].to_vec()),
        };
        let own = |x: &Option<Vec<u32>>| x.as_ref().map(|x| x[from..to].to_vec());
        Segment {
            first_tick: self.shell.first_tick.saturating_add(from as i64),
            start_s: self.shell.time(from),
            columns: self.columns.iter().map(column).collect(),
            phase: own(&self.phase),
            amplitude_nm: own(&self.amplitude_nm),
            filled: self.shell.filled_within(&(from..to)),
            ..self.shell.clone()
        }
    }
}

//! A part of a record, by its own time t: from ≤ t < to.

use super::{Losses, Record, Segment};
use crate::error::{BadInput, Result};
use crate::wording::format::{instant, shortest};

/// Which part of a record is used, s; all of it without bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Part {
    /// From this time on.
    pub from_s: Option<f64>,
    /// Up to this time, which is not in it.
    pub to_s: Option<f64>,
}

impl Part {
    /// Whether it is all of a record.
    pub fn is_all(&self) -> bool {
        self.from_s.is_none() && self.to_s.is_none()
    }

    /// Checks the bounds.
    ///
    /// # Errors
    /// A time that is no number, or an end that is not behind the beginning.
    pub fn validate(&self) -> Result<()> {
        let bad = |option: &str, found: f64, expected: String| {
            Err(BadInput::new(found.to_string(), expected).at(option).remedy("Give times of the record's t, s"))
        };
        for (option, bound) in [("--from", self.from_s), ("--to", self.to_s)] {
            if let Some(s) = bound.filter(|s| !s.is_finite()) {
                return bad(option, s, "a time in seconds".to_owned());
            }
        }
        match (self.from_s, self.to_s) {
            (Some(from), Some(to)) if to <= from => bad("--to", to, format!("a time behind --from {from}")),
            _ => Ok(()),
        }
    }
}

impl Record {
    /// Leaves out what is not of the part. Losses are then those between its first and last sample;
    /// their causes are known of a whole record only.
    ///
    /// # Errors
    /// No sample lies in it.
    pub fn cut(&mut self, part: &Part) -> Result<()> {
        if part.is_all() {
            return Ok(());
        }
        let whole = self
            .segments
            .first()
            .zip(self.segments.last())
            .map(|(a, b)| (a.start_s, b.start_s + b.duration_s(), b.step_s));
        self.segments = self.segments.iter().filter_map(|s| of_segment(s, part)).collect();
        if self.segments.is_empty() {
            let (from, to, step_s) = whole.unwrap_or_default();
            let bound = |s: Option<f64>, without: f64| shortest(s.unwrap_or(without));
            return Err(BadInput::new(
                format!("no sample from t = {} to {} s", bound(part.from_s, from), bound(part.to_s, to)),
                format!("a part of t = {} to {} s", instant(from, step_s), instant(to, step_s)),
            )
            .in_file(&self.path)
            .at("--from, --to")
            .remedy("Give times of the record's t, s"));
        }
        let missing = |pair: &[Segment]| {
            let end = pair[0].first_tick.saturating_add(pair[0].len() as i64);
            u64::try_from(pair[1].first_tick.saturating_sub(end)).unwrap_or(0)
        };
        let filled = || self.segments.iter().flat_map(|s| &s.filled);
        let rows = filled().map(|f| f.len() as u64).sum::<u64>();
        self.losses = Losses {
            received: self.samples() as u64 - rows,
            lost_on_link: self.segments.windows(2).map(missing).fold(rows, u64::saturating_add),
            gaps: self.segments.len() as u64 - 1 + filled().count() as u64,
            restarts: self.segments.windows(2).filter(|pair| pair[0].boot != pair[1].boot).count() as u64,
            ..Losses::default()
        };
        Ok(())
    }
}

/// The rows of a stretch that are of the part; none where there is none.
fn of_segment(s: &Segment, part: &Part) -> Option<Segment> {
    let before = |bound: Option<f64>, without: usize| match bound {
        // The first row at or behind the bound; a row that rounding put a millionth of a step
        // before it counts as at it.
        Some(t) => (((t - s.start_s) / s.step_s - 1e-6).ceil().max(0.0) as usize).min(s.len()),
        None => without,
    };
    let rows = before(part.from_s, 0)..before(part.to_s, s.len());
    (!rows.is_empty()).then(|| s.rows(rows))
}

#[cfg(test)]
mod tests {
    use super::super::Column;
    use super::*;

    fn record() -> Record {
        let segment = |first_tick: i64, n: i32, boot: u32| {
            let columns = vec![Column::Counts((0..n).collect()), Column::Values(vec![0.5; n as usize])];
            let phase = Some((0..n as u32).collect());
            let amplitude_nm = Some((0..n as u32).map(|i| 7 * i).collect());
            let start_s = first_tick as f64 * 0.002;
            Segment { first_tick, boot, phase, amplitude_nm, ..Segment::new(start_s, 0.002, columns) }
        };
        Record {
            path: "r.csv".into(),
            sample_rate_hz: 500.0,
            segments: vec![segment(500, 500, 0), segment(1100, 400, 1)],
            losses: Losses { received: 900, overruns: 100, ..Losses::default() },
            ..Record::default()
        }
    }

    fn part(from_s: Option<f64>, to_s: Option<f64>) -> Result<Record> {
        let mut record = record();
        record.cut(&Part { from_s, to_s }).map(|()| record)
    }

    #[test]
    fn the_part_has_its_rows_and_no_others() {
        let all = part(None, None).unwrap();
        assert_eq!((all.samples(), all.losses.overruns), (900, 100));
        let r = part(Some(1.5), Some(2.4)).unwrap();
        let s = &r.segments;
        assert_eq!((s[0].first_tick, s[0].len(), s[1].first_tick, s[1].len()), (750, 250, 1100, 100));
        assert_eq!((&s[0].columns[0], s[0].start_s), (&Column::Counts((250..500).collect()), 1.5));
        assert_eq!((s[0].phase.as_ref().unwrap()[0], s[0].amplitude_nm.as_ref().unwrap()[0]), (250, 7 * 250));
        assert_eq!((r.losses.received, r.losses.lost_on_link, r.losses.gaps, r.losses.restarts), (350, 100, 1, 1));
        // 2.2 / 0.002 is no whole number in binary.
        let r = part(Some(2.2), None).unwrap();
        assert_eq!((r.segments.len(), r.segments[0].boot, r.samples(), r.losses.lost()), (1, 1, 400, 0));
        assert_eq!(part(None, Some(1.002)).unwrap().samples(), 1);
    }

    #[test]
    fn what_cannot_be_is_told() {
        let e = part(Some(5.0), None).unwrap_err().to_string();
        assert!(e.contains("no sample from t = 5 to 3 s, expected a part of t = 1.000 to 3.000 s"), "{e}");
        let e = Part { from_s: Some(2.0), to_s: Some(2.0) }.validate().unwrap_err().to_string();
        assert!(e.contains("--to") && e.contains("behind --from 2"), "{e}");
        assert!(Part { from_s: Some(f64::NAN), to_s: None }.validate().is_err());
        assert!(Part { from_s: Some(2.0), to_s: Some(2.5) }.validate().is_ok());
    }
}

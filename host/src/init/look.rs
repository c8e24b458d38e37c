//! Readings of a record looked at on one footing, so that their misfits compare.

use rayon::prelude::*;

use super::raw::nice;
use super::{Draft, DraftDrive, Statement};
use crate::identify::suspects::{self, Footing};
use crate::record::Record;
use crate::rig::Direction;

/// Fewest periods of a drive in a record, and its highest frequency in units of the sampling rate
/// and of the highest test frequency: beyond, it moves the rig too little to be told.
const FEWEST_PERIODS: f64 = 30.0;
const OF_RATE: f64 = 0.1;
const OF_TOP: f64 = 4.0;

/// A reading that was tried.
pub(super) struct Tried {
    /// The reading.
    pub draft: Draft,
    /// ln of residual over noise power.
    pub left: f64,
}

/// What readings are looked at on: the same rows for all of them.
pub(super) struct Look<'a> {
    pub record: &'a Record,
    pub on: Footing,
    /// Longest unbroken stretch, s.
    pub span_s: f64,
}

impl Look<'_> {
    /// Whether two frequencies are one in this record.
    pub fn one_line(&self, a: f64, b: f64) -> bool {
        (a - b).abs() * self.span_s < 0.5
    }

    /// Readings, the one that fits best first.
    pub fn at_all(&self, list: Vec<Draft>) -> Vec<Tried> {
        let one = |draft: Draft| {
            let (record, rig) = self.of(&draft)?;
            Some(Tried { left: suspects::misfit(&record, &rig, &self.on)?, draft })
        };
        let tried: Vec<Option<Tried>> = list.into_par_iter().map(one).collect();
        let mut tried: Vec<Tried> = tried.into_iter().flatten().collect();
        sort(&mut tried);
        tried
    }

    fn of(&self, draft: &Draft) -> Option<(Record, crate::rig::Rig)> {
        let rig = draft.rig().ok()?;
        Some((Record { channels: rig.channel.clone(), ..self.record.clone() }, rig))
    }

    /// Tries drives of all frequencies: with the reading that fits best so far, then, with the one
    /// of them that fits best, all that are open.
    pub fn beside_the_lines(&self, tried: &mut Vec<Tried>, open: &[Draft]) {
        let Some(best) = tried.first().map(|t| t.draft.clone()) else { return };
        let sideways = best.pendulum().is_some_and(|p| p.takes(Direction::Horizontal));
        let directions = [Some(Direction::Vertical), sideways.then_some(Direction::Horizontal)];
        let drives = directions.into_iter().flatten().flat_map(|d| self.drives(&best, d)).collect::<Vec<_>>();
        let found = self.at_all(drives.into_iter().map(|d| with(&best, d)).collect());
        if let Some(drive) = found.first().filter(|f| f.left < tried[0].left).and_then(|f| f.draft.drive.clone()) {
            tried.extend(self.at_all(open.iter().map(|d| with(d, drive.clone())).collect()));
        }
        tried.extend(found);
        sort(tried);
    }

    fn drives(&self, draft: &Draft, direction: Direction) -> Vec<DraftDrive> {
        let rate = self.record.sample_rate_hz;
        let top = self.on.top_hz().map_or(OF_RATE * rate, |top| (OF_TOP * top).min(OF_RATE * rate));
        let range = [FEWEST_PERIODS / self.span_s, top];
        let any = DraftDrive { direction, frequency_hz: top, why: Vec::new() };
        let Some((record, rig)) = self.of(&with(draft, any)) else { return Vec::new() };
        let Some((found, error)) = suspects::drive_frequencies(&record, &rig, &self.on, range) else {
            return Vec::new();
        };
        let drive = |hz: f64| {
            let frequency_hz = nice(hz, error / hz);
            let name = if direction == Direction::Vertical { "vertical" } else { "horizontal" };
            let text = "the motion has no clear line of it, but of all frequencies the equations of motion ask for it";
            let why = vec![
                Statement::new("drive", format!("{frequency_hz} Hz"), text),
                Statement::new("drive", name, "the equations of motion fit better so").unsure(),
            ];
            DraftDrive { direction, frequency_hz, why }
        };
        found.into_iter().map(drive).collect()
    }
}

fn with(draft: &Draft, drive: DraftDrive) -> Draft {
    Draft { drive: Some(drive), ..draft.clone() }
}

fn sort(tried: &mut [Tried]) {
    tried.sort_by(|a, b| a.left.total_cmp(&b.left));
}

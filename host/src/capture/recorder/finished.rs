//! The end of a recording: what was held back is written, and what there is to warn of is said.

use std::path::PathBuf;

use super::Recorder;
use crate::capture::RowsOutcome;
use crate::capture::device;
use crate::capture::estimates::DeviceEstimate;
use crate::error::Result;
use crate::record::{DeviceLine, Losses, Metadata};
use crate::warning::Warning;

/// What a finished recording was.
pub(in crate::capture) struct Finished {
    pub(in crate::capture) metadata: Metadata,
    pub(in crate::capture) losses: Losses,
    pub(in crate::capture) first_tick: Option<i64>,
    pub(in crate::capture) last_tick: Option<i64>,
    pub(in crate::capture) rows: Option<RowsOutcome>,
    /// Of rows, whether all windows that fit are there.
    pub(in crate::capture) full: Option<bool>,
    pub(in crate::capture) estimates: Option<PathBuf>,
    pub(in crate::capture) estimate: Option<DeviceEstimate>,
    pub(in crate::capture) warnings: Vec<Warning>,
    pub(in crate::capture) lines: Vec<DeviceLine>,
}

impl Recorder<'_> {
    /// Writes what is held back and ends the record.
    ///
    /// # Errors
    /// A full disk.
    pub(in crate::capture) fn finish(mut self) -> Result<Finished> {
        self.accounting.finish(&mut self.taken);
        self.write()?;
        let losses = self.losses();
        let metadata = self.metadata();
        if let Some(rows) = &mut self.rows {
            rows.finish(&losses)?;
            if rows.lost > 0 {
                self.warnings.push(Warning::new(
                    "windows-lost",
                    format!(
                        "{} windows of rows came in part or not at all; {} are in the record",
                        rows.lost, rows.windows
                    ),
                    "See to cable and baud rate; each gap ends a run",
                ));
            }
        }
        if let Some(mut writer) = self.writer.take() {
            writer.lines(&self.lines);
            writer.excitation(self.excited.as_ref());
            writer.device(&self.boots);
            writer.finish(&losses)?;
        }
        if losses.dropped_late > 0 {
            self.warnings.push(
                Warning::new(
                    "too-late",
                    format!(
                        "{} samples came when their place had been passed, or could not be placed: they are not in the record",
                        losses.dropped_late
                    ),
                    "The link holds data back for longer than 0.6 s and reorders it, or the device's clock jumps: use another one",
                )
                .with("samples", losses.dropped_late),
            );
        }
        let again = self.accounting.again();
        if again.samples > 0 {
            self.warnings.push(
                Warning::new(
                    "samples-again",
                    format!(
                        "{} samples came a second time, long after the first: the device's ticks went back behind tick {} of the record",
                        again.samples, again.behind
                    ),
                    "They are left out; from there on the counts may have another zero. See whether the device restarts, or sends what it has sent before",
                )
                .with("samples", again.samples)
                .with("tick", again.behind),
            );
        }
        let said = device::Said { lines: &self.lines, all: self.said };
        self.warnings.extend(device::warnings(self.restarted_behind, losses.restarts, &self.boots, &said));
        if losses.lost() > 0 && self.rows.is_none() {
            self.warnings.push(Warning::new(
                "samples-lost",
                format!(
                    "{} samples are missing in {} gap{}: {} lost on the link, {} damaged, {} overrun, {} dropped by the device",
                    losses.lost(),
                    losses.gaps,
                    if losses.gaps == 1 { "" } else { "s" },
                    losses.lost_on_link,
                    losses.damaged,
                    losses.overruns,
                    losses.dropped_by_device
                ),
                "Nothing is written in their place; check cable and baud rate (lost, damaged) or the firmware's load (overrun, dropped)",
            ));
        }
        let rows = self.rows.as_ref().map(|rows| RowsOutcome {
            windows: rows.windows,
            windows_lost: rows.lost,
            runs: rows.runs(),
        });
        let (first_tick, last_tick) = match &self.rows {
            Some(rows) => (rows.first_tick().filter(|_| rows.windows > 0), rows.last_tick()),
            None => (self.accounting.first_tick(), self.last_tick),
        };
        Ok(Finished {
            metadata,
            losses,
            first_tick,
            last_tick,
            full: self.rows.as_ref().map(|rows| rows.full),
            rows,
            estimates: self.estimates.file(),
            estimate: self.estimates.last,
            warnings: self.warnings,
            lines: self.lines,
        })
    }
}

//! Records too long for memory: modes, energies and channel faults in one pass, block by block
//! ([`crate::record::stream`]).
//!
//! The numbers are those of the whole record: means and covariances are combined exactly
//! ([`super::streaming`]), angles that turn over are decomposed on the circle as they are there.
//! What needs a stretch as a whole is not done: releases, and with them a constraint, a model and
//! its curve. Memory: a block, and 2n² numbers for n channels (10n² with angles), whatever the
//! length.

use std::path::Path;

use super::channel_faults::Watch;
use super::circular;
use super::releases::{self, Absolute};
use super::streaming::Accumulator;
use super::{Constraint, ReduceSettings, Reduction};
use crate::error::{BadInput, Result};
use crate::record::{Losses, ReadOptions, stream};
use crate::rig::Rig;
use crate::warning::Warning;

/// Numbers (rows times channels, all records together) from which records are taken block by block:
/// 128 MiB, of which reading and reducing as a whole hold four or five copies.
pub const LONG: u64 = 1 << 24;

/// Whether records together are longer than [`LONG`], as far as can be told without reading them.
///
/// # Errors
/// A file that cannot be opened or is of no known format.
pub fn is_long(paths: &[impl AsRef<Path>], rig: &Rig) -> Result<bool> {
    let mut numbers = 0_u64;
    for path in paths {
        numbers = numbers.saturating_add(stream::size(path.as_ref(), rig)?.unwrap_or(0));
    }
    Ok(numbers > LONG)
}

/// Sums over all blocks.
struct Sums {
    plain: Accumulator,
    /// Cosines and sines, where there is an angle.
    circle: Option<Accumulator>,
    watch: Watch,
    /// For each channel that is an angle, lowest and highest value of the present stretch.
    range: Vec<Option<(f64, f64)>>,
    whirling: bool,
    absolute: Absolute,
    /// Channels that show coordinates.
    shown: Vec<usize>,
    /// A stretch's first sample as long as it is the only one: alone it is left out.
    waiting: Option<Vec<Vec<f64>>>,
    short: usize,
}

impl Sums {
    fn new(rig: &Rig) -> Self {
        let (shown, units) = (releases::shown(rig), releases::units(rig));
        let n = shown.len();
        let angles = units.iter().any(|u| u == "rad");
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        Self {
            plain: Accumulator::new(n),
            circle: angles.then(|| Accumulator::new(2 * n)),
            watch: Watch::new(n),
            range: units.iter().map(|u| (u == "rad").then_some(start)).collect(),
            whirling: false,
            absolute: Absolute::of(rig),
            shown,
            waiting: None,
            short: 0,
        }
    }

    /// A part of a stretch.
    fn take(&mut self, block: &stream::Block) {
        let mut columns: Vec<Vec<f64>> = self.shown.iter().map(|c| block.columns[*c].clone()).collect();
        self.absolute.make(&mut columns);
        if block.begins {
            self.begin();
            if columns.first().is_some_and(|c| c.len() == 1) {
                self.waiting = Some(columns);
                return;
            }
        }
        if let Some(first) = self.waiting.take() {
            columns.iter_mut().zip(first).for_each(|(c, f)| drop(c.splice(0..0, f)));
        }
        for (range, x) in self.range.iter_mut().zip(&columns) {
            if let Some((low, high)) = range {
                (*low, *high) = x.iter().fold((*low, *high), |(l, h), x| (l.min(*x), h.max(*x)));
                // More than a whole turn between the ends of a swing.
                self.whirling |= *high - *low > std::f64::consts::TAU;
            }
        }
        let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        self.plain.add(&slices);
        self.watch.add(&slices);
        if let Some(circle) = &mut self.circle {
            let both = circular::on_circle(&slices);
            circle.add(&both.iter().map(Vec::as_slice).collect::<Vec<_>>());
        }
    }

    /// A stretch begins: the one before it has ended.
    fn begin(&mut self) {
        self.short += usize::from(self.waiting.take().is_some());
        self.range.iter_mut().flatten().for_each(|r| *r = (f64::INFINITY, f64::NEG_INFINITY));
    }
}

/// Reduces records block by block; answers the samples that are missing too. `progress` is told the
/// samples taken since it was last called.
///
/// # Errors
/// Settings out of range, a constraint (which needs releases), a format that cannot be read block
/// by block, and what reading reports.
pub fn reduce(
    paths: &[impl AsRef<Path>],
    rig: &Rig,
    options: &ReadOptions,
    settings: &ReduceSettings,
    progress: &dyn Fn(u64),
) -> Result<(Reduction, u64)> {
    let coordinates = releases::shown(rig).len();
    super::check(settings, coordinates)?;
    if let Some(constraint) = settings.constraint.filter(|c| *c != Constraint::None) {
        return Err(BadInput::new(
            format!("{} for records that are taken block by block", format!("{constraint:?}").to_lowercase()),
            "none: a constraint needs releases, and they must fit into memory",
        )
        .at("--constraint")
        .remedy(format!(
            "Cut the free swings out of the record, up to {LONG} numbers (rows times channels) together"
        )));
    }
    if settings.force.is_some() {
        return Err(super::forced_needs_polar());
    }
    let mut sums = Sums::new(rig);
    let mut warnings = Vec::new();
    let mut lost = 0;
    let mut rate: Option<(&Path, f64)> = None;
    for path in paths {
        let path = path.as_ref();
        let summary = stream::read(path, rig, options, &mut |block| {
            sums.take(block);
            progress(block.columns.first().map_or(0, Vec::len) as u64);
        })?;
        let (first, first_rate) = *rate.get_or_insert((path, summary.sample_rate_hz));
        if (summary.sample_rate_hz / first_rate - 1.0).abs() > 1e-3 {
            return Err(releases::other_rate(path, summary.sample_rate_hz, first, first_rate));
        }
        lost += Losses::lost(&summary.losses);
        warnings.extend(summary.warnings);
    }
    sums.begin();
    if sums.short > 0 {
        warnings.push(releases::short_stretches(sums.short));
    }
    let Some((first, _)) = rate.filter(|_| sums.plain.count() > 0) else {
        return Err(match paths.first() {
            Some(path) => releases::no_stretch(path.as_ref()),
            None => BadInput::new("no record", "at least one record"),
        });
    };
    let samples = sums.plain.count();
    warnings.push(Warning::new(
        "taken-block-by-block",
        format!("{samples} samples of {coordinates} channels: modes and energies of all of them, and no model"),
        format!("For a model hand in free swings of up to {LONG} numbers (rows times channels) together"),
    ));
    let faults = sums.watch.finish();
    let names = releases::names(rig);
    warnings.extend(faults.iter().map(|f| super::fault_warning(f, &names)));
    let frame = super::Frame { names, units: releases::units(rig), faults, warnings, samples };
    if let (true, Some(circle)) = (sums.whirling, &sums.circle) {
        return Ok((super::on_circle(frame, circular::from_sums(circle), settings), lost));
    }
    let (pod, kept, frame) = super::decomposed(sums.plain, frame, settings, first)?;
    Ok((super::without_model(frame, pod, kept), lost))
}

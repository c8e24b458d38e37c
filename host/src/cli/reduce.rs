//! `whirl reduce`: modes, a reduced-order model, its frequency–energy curve.

use std::fmt::Write;

use clap::{Args, ValueEnum};

use super::output::{Output, print_warnings};
use super::{Answer, Records};
use crate::error::Result;
use crate::reduce::{Constraint, ReduceSettings, Reduction, reduce};
use crate::report::format::{percent, significant};
use crate::report::{Report, Results};

/// Constraints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// Minor coordinates zero: the major coordinate's equation alone.
    None,
    /// Polynomial constraint, nonlinearity in the major coordinate.
    Type1,
    /// Polynomial constraint, nonlinearity in major and minor coordinates.
    Type2,
    /// Periodic motions parametrised by amplitude and phase.
    Polar,
}

/// Arguments of `reduce`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    records: Records,
    /// Modes to keep [default: as many as hold the share of --energy].
    #[arg(long, value_name = "N")]
    modes: Option<usize>,
    /// Share of the energy that the kept modes hold [default: 0.999].
    #[arg(long, value_name = "SHARE")]
    energy: Option<f64>,
    /// How minor coordinates follow the major one [default: polar where the releases are close to periodic, otherwise none].
    #[arg(long, value_enum)]
    constraint: Option<Choice>,
    /// Masses of the channels, for mass-weighted modes: m1,m2,…
    #[arg(long, value_name = "M,…", value_delimiter = ',')]
    masses: Option<Vec<f64>>,
    #[command(flatten)]
    out: Output,
}

/// The answer for people.
pub fn human(r: &Reduction) -> String {
    let mut text = String::new();
    let shares: Vec<String> = r.energy.iter().take(6).map(|e| percent(*e, 4)).collect();
    let _ = writeln!(
        text,
        "energy {}{}; {} mode{} kept of {} coordinates (rank {}){}",
        shares.join(", "),
        if r.energy.len() > 6 { ", …" } else { "" },
        r.kept,
        if r.kept == 1 { "" } else { "s" },
        r.coordinates.len(),
        r.rank,
        if r.modes_imaginary.is_some() { ", on the circle z = exp(iφ)" } else { "" }
    );
    for (k, mode) in r.modes.iter().take(r.kept.min(4)).enumerate() {
        let entries: Vec<String> = mode.iter().take(8).map(|x| significant(*x, 4)).collect();
        let more = if mode.len() > 8 { ", …" } else { "" };
        let _ = writeln!(text, "  mode {}: {}{more}", k + 1, entries.join(", "));
    }
    if r.model.is_some() && r.releases.len() <= 12 {
        for release in &r.releases {
            let remarks =
                if release.remarks.is_empty() { String::new() } else { format!("; {}", release.remarks.join(", ")) };
            let _ = writeln!(
                text,
                "  release at amplitude {}: {} Hz{}{}",
                significant(release.amplitude, 4),
                significant(release.frequency_hz, 7),
                if release.used { "" } else { ", not used" },
                remarks
            );
        }
    }
    if r.model.is_some() {
        let name = format!("{:?}", r.constraint).to_lowercase();
        let _ = write!(text, "model: {name}");
        if let Some(e) = r.error.frequency {
            let _ = write!(text, ", greatest error of frequency {}", percent(e, 2));
        }
        if let Some(e) = r.error.left_out {
            let _ = write!(text, ", {} at a release left out", percent(e, 2));
        }
        if let Some([low, high]) = r.error.range {
            let _ = write!(text, ", to be used from amplitude {} to {}", significant(low, 4), significant(high, 4));
        }
        match r.error.stable {
            Some(true) => text.push_str(", stable there"),
            Some(false) => text.push_str(", NOT stable over all of it"),
            None => {}
        }
        text.push('\n');
    } else {
        text.push_str("no equation: the record is not close to periodic\n");
    }
    text
}

/// Reads, reduces, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let (rig, records) = arguments.records.read()?;
    let settings = ReduceSettings {
        modes: arguments.modes,
        constraint: arguments.constraint.map(|c| match c {
            Choice::None => Constraint::None,
            Choice::Type1 => Constraint::Type1,
            Choice::Type2 => Constraint::Type2,
            Choice::Polar => Constraint::Polar,
        }),
        energy: arguments.energy,
        masses: arguments.masses.clone(),
    };
    let result = reduce(&records, &rig, &settings)?;
    print_warnings(&result.warnings);
    arguments.out.write_json(&result)?;
    arguments.out.say(&human(&result));
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.iter().map(|r| r.path.display().to_string()).collect();
        let mut results = Results::new();
        results.add(result);
        Report::of(format!("Reduction: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    Ok(arguments.records.answer(&records))
}

//! `whirl reduce`: modes, a reduced-order model, its frequency–energy curve.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::output::{Output, print_warnings};
use super::{Answer, Records};
use crate::error::{BadInput, Result};
use crate::files::write_file;
use crate::record::stream;
use crate::reduce::forced::ResponsePoint;
use crate::reduce::{Constraint, Force, Forced, ReduceSettings, Reduction, long, reduce};
use crate::report::{Report, Results};
use crate::wording::format::{percent, significant};

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
    /// Rig file (`whirl init` writes one from a record).
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Modes to keep [default: as many as hold the share of --energy].
    #[arg(long, value_name = "N")]
    modes: Option<usize>,
    /// Share of the energy that the kept modes hold [default: 0.999].
    #[arg(long, value_name = "SHARE")]
    energy: Option<f64>,
    /// How minor coordinates follow the major one [default: polar where the releases are close to
    /// periodic, otherwise none].
    #[arg(long, value_enum)]
    constraint: Option<Choice>,
    /// Masses of the channels, for mass-weighted modes: m1,m2,…
    #[arg(long, value_name = "M,…", value_delimiter = ',')]
    masses: Option<Vec<f64>>,
    /// Take the records block by block, in little memory: modes and energies without a model
    /// [default: beyond 16.8 million numbers].
    #[arg(long)]
    stream: bool,
    /// The response of the polar model to a force F b cos Ωt: its amplitude F, in the unit of mass
    /// × coordinate/s² (unit masses unless known).
    #[arg(long, value_name = "F")]
    force: Option<f64>,
    /// Where the force acts, one number a channel: b1,b2,… [default: along the first mode, of unit
    /// length].
    #[arg(long, value_name = "B,…", value_delimiter = ',', allow_hyphen_values = true, requires = "force")]
    force_shape: Option<Vec<f64>>,
    /// Damping c in 1/s, in proportion to mass [default: from the decays].
    #[arg(long, value_name = "C", requires = "force")]
    damping: Option<f64>,
    /// Frequency against amplitude and energy, free and forced, as a table.
    #[arg(long, value_name = "FILE.csv")]
    curves: Option<PathBuf>,
    #[command(flatten)]
    out: Output,
}

/// The answer for people.
pub fn human(r: &Reduction) -> String {
    let mut text = String::new();
    let shares: Vec<String> = r.energy.iter().take(6).map(|e| percent(*e, 4)).collect();
    let _ = writeln!(
        text,
        "shares of the modes in the energy: {}{}; {} mode{} kept of {} coordinate{} (rank {}){}",
        shares.join(", "),
        if r.energy.len() > 6 { ", …" } else { "" },
        r.kept,
        if r.kept == 1 { "" } else { "s" },
        r.coordinates.len(),
        if r.coordinates.len() == 1 { "" } else { "s" },
        r.rank,
        if r.modes_imaginary.is_some() { ", on the circle z = exp(iφ)" } else { "" }
    );
    for (k, mode) in r.modes.iter().take(r.kept.min(4)).enumerate() {
        let entry = |(x, name): (&f64, &String)| format!("{name} {}", significant(*x, 4));
        let entries: Vec<String> = mode.iter().zip(&r.coordinates).take(8).map(entry).collect();
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
        if let Some(worst) =
            r.frequency_amplitude.iter().map(|p| p.std_error_hz / p.frequency_hz).max_by(f64::total_cmp)
        {
            let _ = writeln!(text, "  standard error of the frequency at an amplitude: up to {}", percent(worst, 2));
        }
        if let Some(f) = &r.forced {
            text.push_str(&forced(f));
        }
    } else {
        text.push_str(if r.warnings.iter().any(|w| w.id == "taken-block-by-block") {
            "no equation: taken block by block\n"
        } else {
            "no equation: the record is not close to periodic. One needs free releases along one mode: let go from rest in its shape, at several amplitudes (docs/reduce.md)\n"
        });
    }
    text
}

/// The forced response in a few lines.
fn forced(f: &Forced) -> String {
    let error =
        f.damping_found.map_or_else(String::new, |d| format!(" ± {} from the decays", significant(d.std_error, 2)));
    let mut text =
        format!("forced by {}, damping {}{error} 1/s:\n", significant(f.amplitude, 4), significant(f.damping, 4));
    let mut line = |what: &str, p: &ResponsePoint| {
        let (frequency, amplitude) = (significant(p.frequency_hz, 7), significant(p.amplitude, 4));
        let _ = writeln!(text, "  {what} at {frequency} Hz, amplitude {amplitude}");
    };
    if let Some(p) = &f.peak {
        line("peak", p);
    }
    f.folds.iter().for_each(|p| line("fold", p));
    if f.folds.is_empty() {
        text.push_str("  no fold\n");
    }
    text
}

/// Frequency against amplitude, free and forced, one row a point.
fn curves(r: &Reduction) -> String {
    let mut text = "curve,frequency_hz,frequency_std_error_hz,amplitude,energy,lag_rad,stable\n".to_owned();
    for p in &r.frequency_amplitude {
        let _ = writeln!(text, "free,{},{},{},{},,", p.frequency_hz, p.std_error_hz, p.amplitude, p.energy);
    }
    let points = r.forced.iter().flat_map(|f| {
        let of = |name, points: &[ResponsePoint]| points.iter().map(|p| (name, *p)).collect::<Vec<_>>();
        [of("forced", &f.curve), of("fold", &f.folds)].concat()
    });
    for (name, p) in points {
        let _ = writeln!(text, "{name},{},,{},,{},{}", p.frequency_hz, p.amplitude, p.lag, p.stable);
    }
    text
}

/// Reads, reduces, writes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
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
        force: arguments.force.map(|amplitude| Force {
            amplitude,
            shape: arguments.force_shape.clone(),
            damping: arguments.damping,
        }),
    };
    let records = &arguments.records;
    let (rig, files) = records.begin(&arguments.rig, &arguments.out, None)?;
    files.table("--curves", arguments.curves.as_ref()).check()?;
    let long = arguments.stream || long::is_long(&records.records, &rig)?;
    if long && !records.part().is_all() {
        return Err(BadInput::new(
            "--from or --to with a record that is read block by block",
            "one that is read as a whole",
        )
        .at("--from, --to")
        .remedy("Cut the record into shorter ones"));
    }
    let (result, lost) = if long {
        let numbers = records.records.iter().map(|p| Ok(stream::size(p, &rig)?.unwrap_or(0))).sum::<Result<u64>>()?;
        let bar = super::progress::bar("reading", numbers / rig.channel.len().max(1) as u64);
        let reduced = long::reduce(&records.records, &rig, &records.options(), &settings, &|n| bar.inc(n));
        bar.finish_and_clear();
        reduced?
    } else {
        let read = records.read_for(&rig)?;
        let reduced = super::progress::during("reducing", || reduce(&read, &rig, &settings))?;
        (reduced, read.iter().map(|r| r.losses.lost()).sum())
    };
    print_warnings(&result.warnings);
    if let Some(path) = &arguments.curves {
        write_file(path, curves(&result).as_bytes())?;
    }
    if let Some(path) = &arguments.out.report {
        let names: Vec<String> = records.records.iter().map(|p| p.display().to_string()).collect();
        let mut results = Results::new();
        results.add(result.clone());
        Report::of(format!("Reduction: {}", rig.name), names.join(", "), &results).write(path)?;
    }
    arguments.out.write_json(&result)?;
    arguments.out.say(&human(&result));
    Ok(Answer::that_stands(&result.warnings).and(records.answer_for(lost)))
}

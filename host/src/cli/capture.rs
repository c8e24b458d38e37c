//! `whirl capture`: a record from a rig, surviving unplugging, accounting for every sample.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;

use super::Answer;
use super::output::{Output, print_warnings};
use crate::capture::progress::on_terminal;
use crate::capture::{CaptureOutcome, CaptureSettings, run as capture};
use crate::error::{BadInput, Result};
use crate::report::format::{count, duration};
use crate::rig::Rig;

/// Arguments of `capture`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Source: serial:/dev/ttyACM0[@BAUD], tcp:HOST:PORT, rtt[:CHIP], sim, file:FRAMES.
    #[arg(long, value_name = "SOURCE")]
    from: String,
    /// Rig file.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Record: Parquet, or CSV by extension.
    #[arg(short, long, value_name = "REC")]
    output: PathBuf,
    /// Device time to record, s [default: until Ctrl-C, or the end of a file].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Amplitude of the base, m [default: the rig file's].
    #[arg(long, value_name = "M")]
    amplitude_m: Option<f64>,
    /// Leave the shaker alone.
    #[arg(long)]
    no_drive: bool,
    /// Record from the first sample on, also while the shaker starts.
    #[arg(long)]
    from_first_sample: bool,
    /// How long a lost link is tried again, s.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    reconnect_s: f64,
    /// How long the device may take to answer at the start, s.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    handshake_s: f64,
    /// Keep the journal of raw frames (REC.frames) after a clean end.
    #[arg(long)]
    keep_frames: bool,
    /// Seed of a simulated rig (source sim).
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Effect to put into a simulated rig (source sim).
    #[arg(long = "effect", value_name = "ID@PLACE=VALUE[,name=value]")]
    effects: Vec<String>,
    /// Exit with status 1 where samples are missing.
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    out: Output,
}

/// The answer for people.
pub fn human(outcome: &CaptureOutcome) -> String {
    let l = &outcome.losses;
    let mut text = format!(
        "{}: {} samples over {} at {} Hz from {} on {}\n",
        outcome.record.display(),
        count(l.received),
        duration(outcome.duration_s),
        outcome.sample_rate_hz,
        outcome.firmware,
        outcome.board
    );
    text.push_str(&format!(
        "missing {}: {} lost on the link, {} damaged, {} overruns, {} dropped by the device; {} repeated, {} gaps, {} restarts\n",
        count(l.lost()),
        count(l.lost_on_link),
        count(l.damaged),
        count(l.overruns),
        count(l.dropped_by_device),
        count(l.duplicates),
        l.gaps,
        l.restarts
    ));
    text
}

/// Captures.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let rig = Rig::read(&arguments.rig)?;
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    // The second Ctrl-C ends the program at once: the journal stays.
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(|e| BadInput::new(e.to_string(), "to be told of Ctrl-C"))?;
    let settings = CaptureSettings {
        seconds: arguments.seconds,
        reconnect_s: arguments.reconnect_s,
        handshake_s: arguments.handshake_s,
        amplitude_m: arguments.amplitude_m,
        drive: !arguments.no_drive,
        wait_for_drive: !arguments.from_first_sample,
        keep_frames: arguments.keep_frames,
        seed: arguments.seed,
        effects: arguments.effects.clone(),
        stop,
        ..CaptureSettings::new(arguments.from.clone(), arguments.output.clone())
    };
    let outcome = capture(&settings, &rig, &mut *on_terminal())?;
    print_warnings(&outcome.warnings);
    arguments.out.write_json(&outcome)?;
    arguments.out.say(&human(&outcome));
    if let Some(path) = &arguments.out.report {
        super::inspect::report_of(&outcome.record, &rig, path)?;
    }
    if arguments.strict && outcome.losses.lost() > 0 {
        eprintln!("whirl: {} samples are missing (--strict)", outcome.losses.lost());
        return Ok(Answer::Negative);
    }
    Ok(Answer::Positive)
}

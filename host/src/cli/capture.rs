//! `whirl capture`: a record from a rig, surviving unplugging, accounting for every sample.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;

use super::Answer;
use super::output::{Output, Replace, print_warnings};
use super::outputs::Outputs;
use crate::capture::estimates;
use crate::capture::excite::{Band, Excite};
use crate::capture::feed::Feed;
use crate::capture::journal::{is_kept, path_of};
use crate::capture::level::told;
use crate::capture::precision::Until;
use crate::capture::sim::Simulated;
use crate::capture::{CaptureOutcome, CaptureSettings, Progress, run as capture};
use crate::error::{BadInput, Result, plain};
use crate::record::writer::check_ending;
use crate::rig::Rig;
use crate::terminal_view::View;
use crate::wording::format::{count, duration};

/// Arguments of `capture`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Source: serial:/dev/ttyACM0[@BAUD], tcp:HOST:PORT, rtt[:CHIP], sim[:SEED], file:FRAMES.
    #[arg(long, value_name = "SOURCE")]
    from: String,
    /// Rig file.
    #[arg(long, value_name = "RIG.toml")]
    pub(super) rig: PathBuf,
    /// Record: Parquet, or CSV by extension.
    #[arg(short, long, value_name = "REC")]
    pub(super) output: PathBuf,
    /// Device time to record, s [default: until Ctrl-C, or the end of a file].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Amplitude of the base, m [default: the rig file's].
    #[arg(long, value_name = "M")]
    amplitude_m: Option<f64>,
    #[command(flatten)]
    excite: ExciteArguments,
    /// Before the record begins, change what is commanded until the channel that measures the base
    /// shows the amplitude that is wanted.
    #[arg(long, conflicts_with_all = ["no_drive", "rows", "plan", "from_first_sample"])]
    level_amplitude: bool,
    /// Leave the shaker alone.
    #[arg(long)]
    no_drive: bool,
    /// Record from the first sample on, also while the shaker starts.
    #[arg(long)]
    from_first_sample: bool,
    /// Record the device's regression rows instead of samples: a third of the bytes, for
    /// `whirl identify` alone.
    #[arg(long)]
    rows: bool,
    /// Start the shaker again where it has stopped by itself, after a lost link or a restart of the
    /// device. Without this it stays off.
    #[arg(long, conflicts_with = "no_drive")]
    restart_drive: bool,
    /// How long a lost link is tried again, s.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    reconnect_s: f64,
    /// How long the device may take to answer at the start, s.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    handshake_s: f64,
    /// Go on in the record of a capture that was interrupted (killed, stopped or lost its device):
    /// from its journal, on its terms.
    #[arg(long)]
    resume: bool,
    /// Keep the journal of raw frames (REC.frames) after a clean end.
    #[arg(long)]
    keep_frames: bool,
    /// End once the device's own estimate of a parameter is so narrow: ± (95 %) over the value,
    /// such as C2=1%.
    #[arg(long, value_name = "NAME=X%")]
    until: Option<Until>,
    /// Run the records of a plan (`whirl plan -o`) one after the other, REC-1, REC-2 …, until what
    /// was asked is decided.
    #[arg(long, value_name = "PLAN.toml", conflicts_with_all = ["seconds", "amplitude_m", "no_drive", "rows", "resume", "until", "live", "report"])]
    plan: Option<PathBuf>,
    /// Show the motion, the drive, losses and the device's estimate in the terminal meanwhile; a
    /// simulated rig then runs in real time.
    #[arg(long)]
    live: bool,
    /// Effect to put into a simulated rig (source sim).
    #[arg(long = "effect", value_name = "ID@PLACE=VALUE[,name=value]")]
    pub(super) effects: Vec<String>,
    /// Exit with status 1 where samples are missing, or fewer came than were asked for.
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    pub(super) out: Output,
}

/// What the shaker does beyond one sine.
#[derive(Clone, Debug, Args)]
struct ExciteArguments {
    /// Sweep the drive's frequency from one to the other, Hz, such as 2..8.
    #[arg(long, value_name = "F0..F1", conflicts_with_all = ["rows", "plan"])]
    sweep: Option<Band>,
    /// Time of the sweep, s.
    #[arg(long, value_name = "S")]
    sweep_s: Option<f64>,
    /// Sweep by the same factor in every second, not by as many hertz.
    #[arg(long)]
    sweep_log: bool,
    /// Sweep back again, and so on; without this the frequency stays at the sweep's end.
    #[arg(long)]
    sweep_back: bool,
    /// Harmonics of the drive's frequency that move the base together, of equal amplitudes, with
    /// Schroeder's phases: 1,2,3. The amplitude is that of their sum at most.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', conflicts_with_all = ["rows", "plan"])]
    multisine: Vec<u8>,
    /// One period of the base's displacement, repeated at the drive's frequency: a text with one
    /// number a line, m, equally spaced. Scaled to `--amplitude-m`, where that is given.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rows", "plan"])]
    table: Option<PathBuf>,
    /// Amplitudes of the base one after the other, m; the last one stays.
    #[arg(long, value_name = "M,M,…", value_delimiter = ',', conflicts_with_all = ["amplitude_m", "plan"])]
    amplitude_steps: Vec<f64>,
    /// Time for which each of these is held, s.
    #[arg(long, value_name = "S")]
    hold_s: Option<f64>,
    /// Start the shaker when the device's trigger input is active.
    #[arg(long, conflicts_with = "plan")]
    on_trigger: bool,
}

impl ExciteArguments {
    fn asked(&self) -> Excite {
        Excite {
            sweep: self.sweep,
            sweep_s: self.sweep_s,
            logarithmic: self.sweep_log,
            back: self.sweep_back,
            multisine: self.multisine.clone(),
            table: self.table.clone(),
            amplitude_steps_m: self.amplitude_steps.clone(),
            hold_s: self.hold_s,
            on_trigger: self.on_trigger,
        }
    }
}

fn plural(n: u64, word: &str) -> String {
    if n == 1 { format!("1 {word}") } else { format!("{} {word}s", count(n)) }
}

/// The answer for people.
pub fn human(outcome: &CaptureOutcome) -> String {
    let l = &outcome.losses;
    let mut text = format!(
        "{}: {} samples over {} at {} Hz from {} on {}\n",
        plain(&outcome.record.to_string_lossy()),
        count(l.received),
        duration(outcome.duration_s),
        outcome.sample_rate_hz,
        plain(&outcome.firmware),
        plain(&outcome.board)
    );
    text.push_str(&format!(
        "missing {}: {} lost on the link, {} damaged, {} overruns, {} dropped by the device; {} repeated, {} came too late, {}, {}\n",
        count(l.lost()),
        count(l.lost_on_link),
        count(l.damaged),
        count(l.overruns),
        count(l.dropped_by_device),
        count(l.duplicates),
        count(l.dropped_late),
        plural(l.gaps, "gap"),
        plural(l.restarts, "restart")
    ));
    if l.restored > 0 {
        text.push_str(&format!(
            "restored {}: the link had lost them, and the device has sent them again\n",
            count(l.restored)
        ));
    }
    if let Some(frames) = &outcome.frames {
        // One that may be gone on with has a warning that says so, too.
        text.push_str(&format!(
            "its journal is kept: {}; --resume goes on in the record from there, and the file may be deleted\n",
            plain(&frames.to_string_lossy())
        ));
    }
    if let Some(level) = &outcome.level {
        text.push_str(&format!("{}\n", told(level)));
    }
    if let Some(until) = &outcome.until {
        text.push_str(&format!("until {}\n", until.words()));
    }
    if let Some(rows) = &outcome.rows {
        text.push_str(&format!(
            "regression rows of {} in {}, {} lost: for `whirl identify`; what was recorded after the last whole window is not in them\n",
            plural(rows.windows, "window"),
            if rows.runs == 1 { "1 stretch".to_owned() } else { format!("{} stretches", count(rows.runs)) },
            plural(rows.windows_lost, "window")
        ));
    }
    if let (Some(estimate), Some(path)) = (&outcome.estimate, &outcome.estimates) {
        text.push_str(&estimate.human());
        text.push_str(&format!("every estimate: {}\n", path.display()));
    }
    text
}

/// Captures from a simulated rig with effects put into it; the seed is that of `sim:SEED`, 1
/// without one.
///
/// # Errors
/// Another source; effects that are not to be had; what a capture reports.
pub fn from_simulated(
    settings: &CaptureSettings,
    rig: &Rig,
    effects: &[String],
    progress: &mut dyn FnMut(&Progress),
) -> Result<CaptureOutcome> {
    let bad = || {
        BadInput::new(format!("--from {} with --effect", settings.from), "--from sim or sim:SEED")
            .at("--effect")
            .remedy("Effects can be put into a simulated rig only")
    };
    let mut parts = settings.from.splitn(2, ':');
    if parts.next() != Some("sim") {
        return Err(bad());
    }
    let seed = parts.next().map(|s| s.parse::<u64>().map_err(|_| bad())).transpose()?;
    let effects = crate::simulate::effects(effects)?;
    let mut source = Simulated::new(rig, &effects, seed, settings.seconds)?;
    crate::capture::run_from(settings, rig, &mut source, progress)
}

/// What is read and written: the record, its journal and the device's estimates beside it. A record
/// is made again without more ado from the journal that an interrupted capture of it has left, not
/// from one that was to be kept; where a journal is in a new capture's way, the recorder says what
/// to do with it.
pub(super) fn files(arguments: &Arguments, rig: &Rig) -> Outputs {
    let (record, journal) = (&arguments.output, path_of(&arguments.output));
    let frames = arguments.from.strip_prefix("file:").map(Path::new);
    let left = |frames: &Path| crate::files::same(frames, &journal) && !is_kept(&journal);
    let of = if frames.map_or(journal.exists(), left) { Outputs::again } else { Outputs::record };
    let files = of(
        Outputs::of(&arguments.out, Some(arguments.replace))
            .reads_rig(rig)
            .reads(frames)
            .reads(arguments.excite.table.as_deref()),
        "-o",
        record,
    );
    let files = of(files, "-o", &estimates::path_of(record));
    // From a file nothing is journalled.
    if frames.is_some() { files } else { files.again("-o", &journal) }
}

/// Captures.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    if let Some(plan) = &arguments.plan {
        return super::capture_plan::run(arguments, plan);
    }
    let rig = Rig::read(&arguments.rig)?;
    files(arguments, &rig).check()?;
    // Rows are lines of JSON, whatever the name.
    if !arguments.rows {
        check_ending(&arguments.output)?;
    }
    if arguments.rows && arguments.out.report.is_some() {
        return Err(BadInput::new("--report with --rows", "one of them")
            .at("--report")
            .remedy("A report shows samples; `whirl identify --report` makes one from rows"));
    }
    if arguments.live {
        View::possible()?;
        if arguments.from.starts_with("file:") {
            return Err(BadInput::new(format!("--live from {}", plain(&arguments.from)), "a device")
                .at("--live")
                .remedy("Leave it out; `whirl inspect` shows what a record holds"));
        }
    }
    let stop = Arc::new(AtomicBool::new(false));
    end_on_signals(&stop)?;
    let settings = settings_of(arguments, stop);
    let mut outcome = shown(arguments, &rig, &settings)?;
    if let Some(path) = &arguments.out.report {
        outcome.warnings.extend(super::inspect::report_of(&outcome.record, &rig, path)?);
    }
    // First what others wait for: a terminal may be gone.
    arguments.out.write_json(&outcome)?;
    print_warnings(&outcome.warnings);
    arguments.out.say(&human(&outcome));
    Ok(match short_of(&outcome).filter(|_| arguments.strict) {
        Some(what) => {
            crate::error::tell(format!("{what} (--strict)"));
            Answer::Negative
        }
        None => Answer::Positive,
    })
}

/// Ctrl-C, SIGTERM and SIGHUP end the capture in order; the second one ends the program at once:
/// the journal stays.
pub(super) fn end_on_signals(stop: &Arc<AtomicBool>) -> Result<()> {
    let flag = Arc::clone(stop);
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(|e| BadInput::new(e.to_string(), "to be told of Ctrl-C and of the end of the session"))
}

/// How the capture is made.
pub(super) fn settings_of(arguments: &Arguments, stop: Arc<AtomicBool>) -> CaptureSettings {
    CaptureSettings {
        seconds: arguments.seconds,
        reconnect_s: arguments.reconnect_s,
        handshake_s: arguments.handshake_s,
        amplitude_m: arguments.amplitude_m,
        excite: arguments.excite.asked(),
        level: arguments.level_amplitude,
        drive: !arguments.no_drive,
        wait_for_drive: !arguments.from_first_sample,
        effects: arguments.effects.clone(),
        rows: arguments.rows,
        restart_drive: arguments.restart_drive,
        resume: arguments.resume,
        keep_frames: arguments.keep_frames,
        until: arguments.until.clone(),
        feed: arguments.live.then(Arc::default),
        stop,
        ..CaptureSettings::new(arguments.from.clone(), arguments.output.clone())
    }
}

/// Captures, with a line of progress or the view in the terminal meanwhile.
fn shown(arguments: &Arguments, rig: &Rig, settings: &CaptureSettings) -> Result<CaptureOutcome> {
    let run = |progress: &mut dyn FnMut(&Progress)| {
        if arguments.effects.is_empty() {
            capture(settings, rig, progress)
        } else {
            from_simulated(settings, rig, &arguments.effects, progress)
        }
    };
    let Some(feed) = &settings.feed else { return run(&mut *super::progress::of_capture()) };
    let view = begin_view(arguments, rig, feed, settings)?;
    let outcome = run(&mut |_| {});
    // What the view has shown and taken away again.
    view.end().iter().for_each(crate::error::tell);
    outcome
}

fn begin_view(arguments: &Arguments, rig: &Rig, feed: &Arc<Feed>, settings: &CaptureSettings) -> Result<View> {
    let title = plain(&arguments.output.to_string_lossy());
    View::begin(rig, &title, Arc::clone(feed), Arc::clone(&settings.stop))
}

/// What is missing of a record in which nothing was to be missing.
fn short_of(outcome: &CaptureOutcome) -> Option<String> {
    let l = &outcome.losses;
    let of = |n: u64, is: &str, are: &str| {
        if n == 1 { format!("1 sample {is}") } else { format!("{} samples {are}", count(n)) }
    };
    match () {
        () if l.lost() > 0 => Some(of(l.lost(), "is missing", "are missing")),
        () if l.dropped_late > 0 => Some(of(l.dropped_late, "came too late", "came too late")),
        () if outcome.until.as_ref().is_some_and(|until| !until.reached) => {
            Some("the precision that was asked for is not reached".to_owned())
        }
        () if !outcome.complete => {
            Some(format!("fewer samples came than were asked for: {}", duration(outcome.duration_s)))
        }
        () => None,
    }
}

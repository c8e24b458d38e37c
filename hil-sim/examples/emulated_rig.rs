//! The firmware's image on an emulated board against the simulated rig, from the command line.
//!
//! ```text
//! cargo build --release --target thumbv7em-none-eabihf -p whirl-board-mps2-an386
//! cargo run --release -p whirl-hil-sim --example emulated_rig -- \
//!     target/thumbv7em-none-eabihf/release/whirl-board-mps2-an386 --seconds 3600 -o hour.frames
//! ```
//! drives the shaker (5 Hz, 15.525 mm), accounts for every sample and compares all bytes with those
//! of the firmware on this machine. With `--port PORT` the board's stream is at
//! `whirl capture --from tcp:127.0.0.1:PORT` instead, until `--seconds` are over or the capture
//! goes.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use whirl_hil_sim::emulated::{
    Emulation, EmulatorSettings, Script, Sent, Serial, board_settings, on_this_machine, run,
};
use whirl_hil_sim::{Effect, RigSettings};

const USAGE: &str = "emulated_rig IMAGE [--seconds S] [--port PORT] [--effect ID@PLACE=VALUE]… [--seed N] [-o FRAMES]";

struct Arguments {
    image: PathBuf,
    seconds: f64,
    port: Option<u16>,
    seed: Option<u64>,
    effects: Vec<Effect>,
    output: Option<PathBuf>,
}

fn arguments() -> Result<Arguments, String> {
    let mut parsed =
        Arguments { image: PathBuf::new(), seconds: 60.0, port: None, seed: None, effects: Vec::new(), output: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value; usage: {USAGE}"));
        let bad = |text: &str| format!("{word}: found {text}, expected a number");
        match word.as_str() {
            "--seconds" => {
                let text = value()?;
                parsed.seconds = text.parse().ok().filter(|s| (0.01..1e6).contains(s)).ok_or_else(|| bad(&text))?;
            }
            "--port" => {
                let text = value()?;
                parsed.port = Some(text.parse().map_err(|_| bad(&text))?);
            }
            "--seed" => {
                let text = value()?;
                parsed.seed = Some(text.parse().map_err(|_| bad(&text))?);
            }
            "--effect" => parsed.effects.push(Effect::parse(&value()?).map_err(|e| e.to_string())?),
            "-o" => parsed.output = Some(value()?.into()),
            image if parsed.image.as_os_str().is_empty() && !image.starts_with('-') => parsed.image = image.into(),
            other => return Err(format!("{other} is not known; usage: {USAGE}")),
        }
    }
    if parsed.image.as_os_str().is_empty() { Err(format!("no image; usage: {USAGE}")) } else { Ok(parsed) }
}

fn say(emulation: &Emulation, took: Duration) {
    println!("{} of wall time; console of the board:", format_args!("{:.1} s", took.as_secs_f64()));
    println!("{}", emulation.console.trim_end());
}

fn main_or() -> Result<bool, String> {
    let arguments = arguments()?;
    let ticks = (arguments.seconds * 500.0).round() as u32;
    let folder = std::env::temp_dir().join(format!("whirl-emulated-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let rig = RigSettings { seed: arguments.seed, effects: arguments.effects, ..RigSettings::default() };
    let mut settings = EmulatorSettings {
        rig,
        stop: Arc::new(AtomicBool::new(false)),
        ..EmulatorSettings::new(&arguments.image, &folder, ticks)
    };
    match arguments.port {
        Some(port) => {
            settings.serial = Serial::Tcp(port);
            settings.patience = Duration::from_secs(600);
            println!("waiting for a capture from tcp:127.0.0.1:{port}");
        }
        None => settings.script = Script::new().drive(0, ticks, 10_000, 15_525, 5_000),
    }
    let start = Instant::now();
    let emulation = run(&settings).map_err(|e| e.to_string());
    // It is ours, and no longer needed.
    let _ = std::fs::remove_dir_all(&folder);
    let emulation = emulation?;
    say(&emulation, start.elapsed());
    if arguments.port.is_some() {
        return Ok(emulation.status == Some(0));
    }
    if let Some(path) = &arguments.output {
        std::fs::write(path, &emulation.frames).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    let sent = Sent::of(&emulation.frames);
    let counters = sent.samples;
    let (frames, received, missing) = (sent.frames, counters.received, counters.missing);
    println!(
        "{}: {} bytes, {frames} frames, {received} samples, {missing} missing",
        sent.firmware,
        emulation.frames.len()
    );
    settings.rig.device = board_settings(&sent.firmware);
    let here = on_this_machine(&settings.rig, &settings.script, ticks).map_err(|e| e.to_string())?;
    let equal = here == emulation.frames;
    println!("{} the bytes of the firmware on this machine", if equal { "equal to" } else { "NOT equal to" });
    // Samples of a block that is not full at the end have not been sent.
    Ok(equal && missing == 0 && sent.bad == 0 && received + 10 > u64::from(ticks))
}

fn main() -> ExitCode {
    match main_or() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("emulated_rig: {message}");
            ExitCode::from(2)
        }
    }
}

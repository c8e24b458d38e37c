//! The firmware's image on an emulated board against the simulated rig, from the command line.
//!
//! ```text
//! cargo build --release --target thumbv7em-none-eabihf -p whirl-board-mps2-an386
//! cargo run --release -p whirl-hil-sim --example emulated_rig -- \
//!     target/thumbv7em-none-eabihf/release/whirl-board-mps2-an386 --seconds 3600 -o hour.frames
//! ```
//! drives the shaker (5 Hz, 15.525 mm), accounts for every sample and compares all bytes with those
//! of the firmware on this machine. With `--faults` the base is a third channel, and in every minute
//! the board misses ticks, its link takes nothing for some seconds, which the host asks for again,
//! and the host's line brings noise: every tick is there then, but for those that it missed. With `--port PORT` the board's stream is at
//! `whirl capture --from tcp:127.0.0.1:PORT` instead, until `--seconds` are over or the capture
//! goes.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use whirl_firmware::lock_step::Order;
use whirl_hil_sim::emulated::{
    Emulation, EmulatorSettings, Script, Sent, Serial, board_settings, on_this_machine, run,
};
use whirl_hil_sim::{BaseQuantity, BaseSettings, Effect, RigSettings};
use whirl_shared::block::samples;
use whirl_shared::codec::Decoder;
use whirl_shared::frame::{BaseKind, Command, DeviceMessage, Setting};

const USAGE: &str =
    "emulated_rig IMAGE [--seconds S] [--faults] [--port PORT] [--effect ID@PLACE=VALUE]… [--seed N] [-o FRAMES]";

struct Arguments {
    image: PathBuf,
    seconds: f64,
    faults: bool,
    port: Option<u16>,
    seed: Option<u64>,
    effects: Vec<Effect>,
    output: Option<PathBuf>,
}

fn arguments() -> Result<Arguments, String> {
    let mut parsed = Arguments {
        image: PathBuf::new(),
        seconds: 60.0,
        faults: false,
        port: None,
        seed: None,
        effects: Vec::new(),
        output: None,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value; usage: {USAGE}"));
        let bad = |text: &str| format!("{word}: found {text}, expected a number");
        match word.as_str() {
            "--seconds" => {
                let text = value()?;
                parsed.seconds = text.parse().ok().filter(|s| (0.01..1e6).contains(s)).ok_or_else(|| bad(&text))?;
            }
            "--faults" => parsed.faults = true,
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

/// Ticks of a minute.
const MINUTE: u32 = 30_000;

/// A third channel from a restart on, then minutes with their faults.
fn faults(ticks: u32) -> Script {
    let mut script = Script::new()
        .command(50, Command::Set(Setting::Base { kind: BaseKind::Position }))
        .command(60, Command::Set(Setting::BaseScale { scale: 1_000_000 }))
        .command(100, Command::Restart)
        .drive(500, ticks, 10_000, 15_525, 5_000);
    for minute in 0..ticks / MINUTE {
        let from = minute * MINUTE;
        let noise: Vec<u8> =
            (0..40).map(|i| ((minute + 1).wrapping_mul(2_654_435_761) >> (i % 24)) as u8).chain([0]).collect();
        let outage = 1_000 + 500 * (minute % 8);
        // Its ticks are some hundred fewer since the restart.
        let again = Command::BackFill { boot_id: 2, first_tick: from + 9_500, ticks: outage + 1_000 };
        script = script
            .order(from + 4_000, Order::Stall(3 + 7 * (minute % 9) as u16))
            .order(from + 10_000, Order::BlockLink(outage as u16))
            .command(from + 10_700 + outage, again)
            .bytes(from + 27_000, &noise);
    }
    script
}

/// Ticks of the last boot that are there, streamed or restored, and those that are not, up to the
/// newest one.
fn ticks_there(frames: &[u8]) -> [usize; 2] {
    let (mut decoder, mut there) = (Decoder::<DeviceMessage>::new(), Vec::new());
    for envelope in frames.iter().filter_map(|&byte| decoder.push(byte)?.ok()) {
        match envelope.message {
            DeviceMessage::Hello(hello) if hello.tick == 0 => there.clear(),
            DeviceMessage::Samples(block) | DeviceMessage::Restored(block) => {
                for sample in samples(&block) {
                    let tick = sample.tick as usize;
                    there.resize(there.len().max(tick + 1), false);
                    there[tick] = true;
                }
            }
            _ => {}
        }
    }
    let found = there.iter().filter(|&&there| there).count();
    [found, there.len() - found]
}

/// Whether nothing is missing but what the board missed.
fn accounted(emulation: &Emulation) -> bool {
    let sent = Sent::of(&emulation.frames);
    let [there, missing] = ticks_there(&emulation.frames);
    let overruns = sent.statuses.last().map_or(0, |status| status.overruns);
    let restored: usize = sent.restored.iter().map(|block| samples(block).count()).sum();
    let dropped = sent.statuses.last().map_or(0, |status| status.dropped_samples);
    println!(
        "{} bytes, {} frames; ticks: {there} there, {missing} not, {overruns} missed by the board",
        emulation.frames.len(),
        sent.frames
    );
    println!("{dropped} samples were not streamed; {restored} sent again, in {} answers", sent.back_filled.len());
    let three = sent.hellos.last().is_some_and(|hello| hello.base.kind == BaseKind::Position);
    three && missing == overruns as usize && sent.bad == 0 && emulation.status == Some(0)
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
        None if arguments.faults => {
            let (scale, noise) = (1e-6, 5e-6);
            let quantity = BaseQuantity::Position;
            settings.rig.base = Some(BaseSettings { quantity, scale, gain: 1.0, offset: 0.0, noise, seed: 1 });
            settings.script = faults(ticks);
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
    if arguments.faults {
        return Ok(accounted(&emulation));
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

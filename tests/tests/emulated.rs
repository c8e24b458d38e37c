//! The firmware's image on an emulated Cortex-M4F, against the simulated plant.
//!
//! Needs `qemu-system-arm` and the target thumbv7em-none-eabihf. Without them the tests say that
//! they did not run; with `WHIRL_EMULATOR=required` (as `./check` sets it) they fail instead.
#![cfg(unix)]

#[path = "emulated/back_fill.rs"]
mod back_fill;
#[path = "emulated/base.rs"]
mod base;
#[path = "emulated/excitations.rs"]
mod excitations;
#[path = "emulated/faults.rs"]
mod faults;
#[path = "emulated/identification.rs"]
mod identification;
#[path = "emulated/image.rs"]
mod image;
#[path = "emulated/lasting.rs"]
mod lasting;
#[path = "emulated/programs.rs"]
mod programs;

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use whirl::capture::{self, CaptureSettings};
use whirl::identify::{Settings, identify};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl_firmware::history::KEPT;
use whirl_hil_sim::emulated::{
    Emulation, EmulatorSettings, Script, Sent, Serial, board_settings, on_this_machine, run,
};
use whirl_shared::block::samples;
use whirl_shared::codec::Decoder;
use whirl_shared::frame::regression::EquationEstimate;
use whirl_shared::frame::{DeviceMessage, ShakerState};

/// Ticks a second.
const RATE: u32 = 500;

fn driven(ticks: u32) -> Script {
    Script::new().drive(0, ticks, 10_000, 15_525, 5_000)
}

/// FNV-1a over the fields of all samples and the numbers of all estimates: what the golden file
/// holds.
fn digest(frames: &[u8]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut decoder = Decoder::<DeviceMessage>::new();
    for envelope in frames.iter().filter_map(|&byte| decoder.push(byte)?.ok()) {
        let mut take = |byte: u8| hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        match envelope.message {
            DeviceMessage::Samples(block) => {
                for sample in samples(&block) {
                    let words = [sample.tick, sample.phase, sample.counts[0] as u32, sample.counts[1] as u32];
                    words.iter().flat_map(|word| word.to_le_bytes()).for_each(&mut take);
                }
            }
            DeviceMessage::Estimate(estimate) => {
                if let EquationEstimate::Known { unknowns, .. } = estimate.first {
                    unknowns.iter().flat_map(|u| [u.value.0, u.std_error.0]).flatten().for_each(&mut take);
                }
                if let EquationEstimate::Known { unknowns, .. } = estimate.second {
                    unknowns.iter().flat_map(|u| [u.value.0, u.std_error.0]).flatten().for_each(&mut take);
                }
            }
            _ => {}
        }
    }
    hash
}

/// Runs the chaotic rig on the emulated board: every sample is there, the tick's period is exact,
/// and all bytes are those of the firmware on this machine.
fn exact(image: PathBuf, ticks: u32) -> Emulation {
    let folder = tempfile::tempdir().unwrap();
    let mut settings = EmulatorSettings {
        script: driven(ticks),
        patience: Duration::from_secs(300),
        ..EmulatorSettings::new(image, folder.path(), ticks)
    };
    let emulation = run(&settings).unwrap();
    assert_eq!(emulation.status, Some(0), "{}", emulation.console);
    let sent = Sent::of(&emulation.frames);
    // The last block is not full.
    assert!(sent.samples.received > u64::from(ticks) - 10, "{:?}", sent.samples);
    assert_eq!((sent.samples.missing, sent.bad, sent.sequence.lost), (0, 0, 0));
    let status = sent.statuses.last().unwrap();
    assert_eq!(status.shaker, ShakerState::Running);
    assert_eq!([status.overruns, status.dropped_samples, status.dropped_frames, status.bad_frames], [0; 4]);

    let account = emulation.account.unwrap();
    println!("{} samples, {} estimates; {account:?}", sent.samples.received, sent.estimates.len());
    assert_eq!(account.ticks, ticks);
    // 500 Hz exactly; QEMU 7.2 may be a few clocks off.
    assert_eq!(account.period[0], 50_000);
    assert!(account.period[1] <= 5 && account.period[2] <= 5, "{account:?}");
    // Statics and stack, the estimate's too: beside the blocks that are kept, and with them.
    let kept = KEPT as u32;
    assert!(account.statics - kept + account.stack < 64 * 1024 && account.stack < 16 * 1024, "{account:?}");
    assert!(account.statics < 112 * 1024, "{account:?}");
    // An estimate every twenty periods; numbers from the fourth window on.
    assert!(sent.estimates.len() as u32 >= (ticks - 1_500) / 2_000 - 1, "{}", sent.estimates.len());
    let last = sent.estimates.last().unwrap();
    assert!(matches!(last.first, EquationEstimate::Known { .. }), "{last:?}");

    settings.rig.device = board_settings(&sent.firmware);
    let here = on_this_machine(&settings.rig, &settings.script, ticks).unwrap();
    let first = here.iter().zip(&emulation.frames).position(|(a, b)| a != b);
    assert_eq!((first, here.len()), (None, emulation.frames.len()));
    identified_alike(&emulation.frames, &here);
    emulation
}

/// What the host identifies from a board's bytes, as JSON.
fn identified(frames: &[u8], name: &str, folder: &Path, rig: &Rig) -> String {
    let file = folder.join(format!("{name}.bytes"));
    std::fs::write(&file, frames).unwrap();
    let output = folder.join(format!("{name}.parquet"));
    let settings = CaptureSettings::new(format!("file:{}", file.display()), &output);
    let outcome = capture::run(&settings, rig, &mut |_| {}).unwrap();
    assert_eq!(outcome.losses.lost(), 0);
    let record = Record::read(&output, rig, &ReadOptions::default()).unwrap();
    let result = identify(&[record], rig, &Settings::default()).unwrap();
    for p in result.parameters.iter().filter(|p| p.name == "B21" || p.name == "C11") {
        println!("{name}: {} {} ± {}", p.name, p.value, p.std_error);
    }
    serde_json::to_string(&result).unwrap()
}

/// The host's result from the emulated board's capture is, digit for digit, that from the firmware
/// on this machine.
fn identified_alike(emulated: &[u8], here: &[u8]) {
    let rig = Rig::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/chaotic.toml"))).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = [(emulated, "emulated"), (here, "here")].map(|(f, name)| identified(f, name, folder.path(), &rig));
    assert!(a.contains("\"B21\"") && a == b);
}

#[test]
fn a_minute_is_that_of_the_firmware_on_this_machine_byte_for_byte() {
    let Some(image) = image::image() else { return };
    let emulation = exact(image, 60 * RATE);
    let sent = Sent::of(&emulation.frames);
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/emulated-minute.txt");
    let text = format!(
        "bytes-without-hello {}\nframes {}\nsamples {}\nestimates {}\ndigest {:016x}\n",
        emulation.frames.len() - emulation.frames.iter().position(|&b| b == 0).unwrap() - 1,
        sent.frames,
        sent.samples.received,
        sent.estimates.len(),
        digest(&emulation.frames),
    );
    if std::env::var_os("WHIRL_BLESS").is_some() {
        std::fs::write(&golden, &text).unwrap();
    }
    assert_eq!(text, std::fs::read_to_string(&golden).unwrap_or_default(), "WHIRL_BLESS=1 accepts what has changed");
}

/// Ten minutes or so:
/// `WHIRL_EMULATOR=required cargo test --release -p whirl-tests --test emulated an_hour -- --ignored --nocapture`.
#[test]
#[ignore = "takes ten minutes"]
fn an_hour_loses_nothing_and_is_identified_alike() {
    let Some(image) = image::image() else { return };
    exact(image, 3_600 * RATE);
}

#[test]
fn a_run_is_the_same_at_every_repeat() {
    let Some(image) = image::image() else { return };
    let mut runs = [(), ()].map(|()| {
        let folder = tempfile::tempdir().unwrap();
        let ticks = 5 * RATE;
        run(&EmulatorSettings { script: driven(ticks), ..EmulatorSettings::new(&image, folder.path(), ticks) }).unwrap()
    });
    assert!(runs[0].frames.len() > 10_000);
    assert_eq!(std::mem::take(&mut runs[0].frames), std::mem::take(&mut runs[1].frames));
    assert_eq!(runs[0].account, runs[1].account);
    assert!(runs[0].account.is_some());
}

#[test]
fn capture_from_tcp_has_every_sample() {
    let Some(image) = image::image() else { return };
    let folder = tempfile::tempdir().unwrap();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let stop = Arc::new(AtomicBool::new(false));
    let settings = EmulatorSettings {
        serial: Serial::Tcp(port),
        ticks: None,
        stop: Arc::clone(&stop),
        ..EmulatorSettings::new(image, folder.path(), 0)
    };
    let board = std::thread::spawn(move || run(&settings));
    let rig = Rig::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../rigs/chaotic.toml"))).unwrap();
    let capture = CaptureSettings {
        seconds: Some(10.0),
        amplitude_m: Some(0.015_525),
        ..CaptureSettings::new(format!("tcp:127.0.0.1:{port}"), folder.path().join("record.parquet"))
    };
    // Until the emulator listens.
    let deadline = Instant::now() + Duration::from_secs(30);
    let outcome = loop {
        match capture::run(&capture, &rig, &mut |_| {}) {
            Err(error) if Instant::now() < deadline && error.to_string().contains("refused") => {
                std::thread::sleep(Duration::from_millis(50));
            }
            other => break other,
        }
    };
    stop.store(true, Ordering::Relaxed);
    let emulation = board.join().unwrap().unwrap();
    let outcome = outcome.unwrap();
    assert_eq!((outcome.losses.received, outcome.losses.lost()), (5_000, 0));
    assert_eq!(outcome.board, "mps2-an386");
    assert!(outcome.complete && outcome.warnings.is_empty(), "{:?}", outcome.warnings);
    assert_eq!(emulation.status, Some(0), "{}", emulation.console);
    // The capture has left the shaker at rest.
    assert_eq!((emulation.last.displacement_nanometre, emulation.last.amplifier_on), (0, false));
}

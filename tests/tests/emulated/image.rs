//! The image under test, built once, and runs of it.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use whirl_hil_sim::emulated::{Emulation, EmulatorSettings, Script, Sent, run};

const TARGET: &str = "thumbv7em-none-eabihf";
const BOARD: &str = "whirl-board-mps2-an386";

/// The image; `None`, with a word about it, where this machine cannot run it and nobody insists.
pub fn image() -> Option<PathBuf> {
    binary(BOARD)
}

/// A run of the board by a script, of which nothing is lost on the way: every frame that it sends
/// is whole and there.
pub fn emulate(script: &Script, ticks: u32) -> Option<(Emulation, Sent)> {
    let image = image()?;
    let folder = tempfile::tempdir().unwrap();
    let settings = EmulatorSettings { script: script.clone(), ..EmulatorSettings::new(image, folder.path(), ticks) };
    let emulation = run(&settings).unwrap();
    assert_eq!(emulation.status, Some(0), "{}", emulation.console);
    let sent = Sent::of(&emulation.frames);
    assert_eq!((sent.bad, sent.sequence.lost), (0, 0));
    Some((emulation, sent))
}

/// One of the emulated board's binaries.
pub fn binary(name: &str) -> Option<PathBuf> {
    static BUILT: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match BUILT.get_or_init(build) {
        Ok(folder) => Some(folder.join(name)),
        Err(why) => {
            assert_ne!(std::env::var("WHIRL_EMULATOR").as_deref(), Ok("required"), "{why}");
            eprintln!("did not run: {why}");
            None
        }
    }
}

fn build() -> Result<PathBuf, String> {
    let qemu = Command::new("qemu-system-arm").arg("--version").output();
    if !qemu.is_ok_and(|output| output.status.success()) {
        return Err("no qemu-system-arm: `apt-get install qemu-system-arm`".to_owned());
    }
    let library = Command::new("rustc").args(["--print", "target-libdir", "--target", TARGET]).output();
    let library = library.map_err(|e| e.to_string())?.stdout;
    if !Path::new(String::from_utf8_lossy(&library).trim()).is_dir() {
        return Err(format!("no target {TARGET}: `rustup target add {TARGET}`"));
    }
    // The messages name the file, wherever the target folder is.
    let built = Command::new(env!("CARGO"))
        .args(["build", "--release", "--locked", "--target", TARGET, "--package", BOARD, "--message-format", "json"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .map_err(|e| e.to_string())?;
    // A build that fails is no reason not to run.
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let messages = String::from_utf8_lossy(&built.stdout);
    messages
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter_map(|message| Some(PathBuf::from(message.get("executable")?.as_str()?)))
        .find_map(|path| path.parent().map(Path::to_owned))
        .ok_or_else(|| "cargo named no executable".to_owned())
}

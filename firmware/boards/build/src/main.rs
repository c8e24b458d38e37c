//! `cargo run -p whirl-board-build -- FOLDER` builds the images of all boards and leaves them there
//! as `.elf`, `.bin` and `.uf2`, with their sizes, so that a board can be flashed without Rust and
//! without a debug probe. An image that its chip would not run, or that says nothing of itself, is
//! an error.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::{env, fs};

use whirl_board_build::image::{Chip, Image, has_messages};

const CORTEX_M4F: &str = "thumbv7em-none-eabihf";
const CORTEX_M33F: &str = "thumbv8m.main-none-eabihf";
/// Both NUCLEO boards: 512 kB of flash, of which the second half is the settings' (the G474RE's
/// second bank, in whose end they lie, so that the program goes on while they are written; sectors
/// 6 and 7 of the F446RE).
const NUCLEO: Chip = Chip { flash: 0x0800_0000, room: 256 << 10, memory: 128 << 10, boot_block: false };
/// The Pico 2, of whose 4 MB a program may take what an image may.
const PICO2: Chip = Chip { flash: 0x1000_0000, room: 1 << 20, memory: 512 << 10, boot_block: true };

/// Boards, with their targets, their chips and those families in UF2 (microsoft/uf2,
/// `utils/uf2families.json`).
const BOARDS: [(&str, &str, Chip, u32); 3] = [
    ("nucleo-g474re", CORTEX_M4F, NUCLEO, 0x4c71_240a),
    ("nucleo-f446re", CORTEX_M4F, NUCLEO, 0x5775_5a57),
    // RP2350, Arm, secure.
    ("pico2", CORTEX_M33F, PICO2, 0xe48b_ff59),
];

fn cargo(arguments: &[&str], root: &Path) -> Result<Vec<u8>, String> {
    let program = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(program)
        .args(arguments)
        .current_dir(root)
        .stderr(std::process::Stdio::inherit())
        .output()
        .map_err(|e| format!("cargo: {e}"))?;
    if output.status.success() { Ok(output.stdout) } else { Err(format!("cargo {} failed", arguments.join(" "))) }
}

/// Where cargo builds.
fn target_folder(root: &Path) -> Result<PathBuf, String> {
    let metadata = cargo(&["metadata", "--format-version", "1", "--no-deps", "--locked"], root)?;
    let text = String::from_utf8_lossy(&metadata);
    let folder = text.split_once("\"target_directory\":\"").and_then(|(_, rest)| rest.split_once('"'));
    folder.map(|(folder, _)| PathBuf::from(folder)).ok_or_else(|| "cargo metadata names no target folder".to_owned())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    fs::write(path, bytes).map_err(|e| format!("{}: {e}", path.display()))?;
    println!("{:>8} bytes  {}", bytes.len(), path.display());
    Ok(())
}

fn images(folder: &Path) -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
    fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let built = target_folder(&root)?;
    for (board, target, chip, family) in BOARDS {
        let package = format!("whirl-board-{board}");
        // One after another: the chips exclude each other within one build.
        cargo(&["build", "--release", "--locked", "--target", target, "--package", &package], &root)?;
        let path = built.join(target).join("release").join(&package);
        let elf = fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let image = Image::of_elf(&elf).map_err(|e| format!("{}: {e}", path.display()))?;
        if !has_messages(&elf) {
            return Err(format!("{package} has no messages of level info: is DEFMT_LOG set to something else?"));
        }
        if let Some(why) = image.unfit(&chip) {
            return Err(format!("{package} is no program for its chip: {why}"));
        }
        let file = |extension: &str| folder.join(format!("whirl-{board}.{extension}"));
        write(&file("elf"), &elf)?;
        write(&file("bin"), &image.bytes)?;
        write(&file("uf2"), &image.to_uf2(family))?;
    }
    write(&folder.join("README.txt"), readme().as_bytes())
}

/// What a person finds beside the files.
fn readme() -> String {
    let mut text = format!(
        "Firmware of whirl {} for three boards. One file flashes a board; it needs neither Rust nor a debug probe.\n\n",
        env!("CARGO_PKG_VERSION")
    );
    for (board, _, chip, _) in BOARDS {
        text += &if chip.boot_block {
            format!("whirl-{board}.uf2  hold BOOTSEL, plug the board in, copy this onto the drive RP2350\n")
        } else {
            let drive = board.trim_start_matches("nucleo-").to_uppercase();
            format!("whirl-{board}.bin  plug the board in, copy this onto the drive NODE_{drive}\n")
        };
    }
    text + "\n`whirl flash --board BOARD --image FILE` flashes any of them by a debug probe. The .elf files hold the names for\n\
            the board's messages (probe-rs), and suit STM32CubeProgrammer; the .uf2 files of the NUCLEO boards suit a UF2\n\
            bootloader. Settings that a board has kept stay, unless this firmware speaks another protocol.\n\
            Then: `whirl device show`. Pins and wiring: docs/boards.md of the repository.\n"
}

fn main() -> ExitCode {
    let mut arguments = env::args_os().skip(1);
    let (Some(folder), None) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: cargo run -p whirl-board-build -- FOLDER");
        return ExitCode::from(2);
    };
    match images(Path::new(&folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("images: {error}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_beside_the_files_names_one_for_each_board() {
        let text = readme();
        for line in [
            "whirl-nucleo-g474re.bin  plug the board in, copy this onto the drive NODE_G474RE\n",
            "whirl-nucleo-f446re.bin  plug the board in, copy this onto the drive NODE_F446RE\n",
            "whirl-pico2.uf2  hold BOOTSEL",
        ] {
            assert!(text.contains(line), "{text}");
        }
        assert!(text.lines().all(|line| line.len() <= 120), "{text}");
    }
}

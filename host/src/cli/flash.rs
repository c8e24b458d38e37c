//! `whirl flash`: builds a board's firmware, or takes a file of it, and flashes it through a debug
//! probe.

use std::path::PathBuf;

use clap::Args;

use super::Answer;
use super::flash_image::{self, Kind};
use super::output::Output;
use super::outputs::Outputs;
use crate::boards;
use crate::error::{BadInput, Result};

/// Arguments of `flash`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Board: see `whirl list boards`.
    #[arg(long, value_name = "BOARD")]
    board: String,
    /// Image to flash: .elf, .bin or .uf2 [default: it is built from the repository in which this
    /// is called].
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    #[command(flatten)]
    out: Output,
}

/// Builds and flashes.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    Outputs::of(&arguments.out, None).reads(&arguments.image).check()?;
    arguments.out.tell_no_report("a board", "`whirl device show` tells of it");
    let Some(board) = boards::of(&arguments.board) else {
        return Err(BadInput::new(format!("\"{}\"", arguments.board), format!("one of {}", boards::flashable()))
            .at("--board")
            .remedy("`whirl list boards` tells what they are"));
    };
    let Some(chip) = board.chip else {
        return Err(BadInput::new(
            format!("{}, which has no flash", board.id),
            format!("one of {}", boards::flashable()),
        )
        .at("--board")
        .remedy("It is run, not flashed: see docs/boards.md"));
    };
    // What would spoil the board is told first, in every build.
    let given = arguments.image.as_ref().map(|path| Ok((path.clone(), flash_image::of(path, board, chip)?)));
    flash(board, chip, given.transpose()?, &arguments.out)
}

#[cfg(not(feature = "probe"))]
fn flash(board: &boards::Board, _: &str, given: Option<(PathBuf, Kind)>, _: &Output) -> Result<Answer> {
    let taken = |kind: &Kind| match kind {
        Kind::Bin(_) => board.drop == "bin",
        Kind::Uf2 => board.drop == "uf2",
        Kind::Elf => false,
    };
    let (image, made) = match &given {
        Some((path, kind)) if taken(kind) => (path.display().to_string(), ""),
        _ => (format!("whirl-{}.{}", board.id, board.drop), " (`cargo run -p whirl-board-build -- images` makes it)"),
    };
    Err(BadInput::new("a build that cannot flash", "a build with --features probe").remedy(format!(
        "Build it with `cargo build --release --features probe`, or copy {image}{made} onto the \
         drive that the board shows on USB, see docs/boards.md"
    )))
}

#[cfg(feature = "probe")]
use with_probe::flash;

#[cfg(feature = "probe")]
mod with_probe {
    use std::path::{Path, PathBuf};
    use std::process::Command;

    use probe_rs::flashing::{BinLoader, BinOptions, ElfLoader, ElfOptions, Uf2Loader, download_file};
    use probe_rs::{Session, SessionConfig};

    use super::Kind;
    use crate::boards::Board;
    use crate::cli::Answer;
    use crate::cli::output::Output;
    use crate::error::{BadInput, Result};

    pub(super) fn flash(board: &Board, chip: &str, given: Option<(PathBuf, Kind)>, out: &Output) -> Result<Answer> {
        let (image, kind) = match given {
            Some(given) => given,
            None => (build(board)?, Kind::Elf),
        };
        let failed = |what: &str, error: &dyn std::fmt::Display, remedy: &str| {
            BadInput::new(error.to_string(), what).at(format!("--board {}", board.id)).remedy(remedy)
        };
        let mut session = Session::auto_attach(chip, SessionConfig::default()).map_err(|e| {
            failed(
                "a board on a debug probe",
                &e,
                "Plug the board in by its ST-LINK's USB; see docs/boards.md for permissions",
            )
        })?;
        let downloaded = match kind {
            Kind::Elf => download_file(&mut session, &image, ElfLoader(ElfOptions::default())),
            Kind::Uf2 => download_file(&mut session, &image, Uf2Loader),
            Kind::Bin(address) => {
                let options = BinOptions { base_address: Some(address.into()), skip: 0 };
                download_file(&mut session, &image, BinLoader(options))
            }
        };
        downloaded.map_err(|e| {
            failed("an image that can be flashed", &e, "Try again; the shaker is silent while the board is flashed")
        })?;
        session
            .core(0)
            .and_then(|mut core| core.reset())
            .map_err(|e| failed("a board that restarts", &e, "Press its reset button"))?;
        out.write_json(&serde_json::json!({ "board": board.id, "image": image, "warnings": [] }))?;
        out.say(&format!("{} runs {}\n", board.id, image.display()));
        Ok(Answer::Positive)
    }

    /// Builds the firmware in the repository that the present folder belongs to.
    fn build(board: &Board) -> Result<PathBuf> {
        let here = std::env::current_dir().map_err(|e| BadInput::new(e.to_string(), "a folder to work in"))?;
        let Some(root) = here.ancestors().find(|folder| folder.join("firmware/boards").is_dir()) else {
            return Err(BadInput::new("no firmware/boards in this folder or above it", "whirl's repository")
                .in_file(&here)
                .remedy("Call it there, or give an image with --image"));
        };
        let cargo = |message: String| {
            BadInput::new(message, format!("a build of {}", board.package))
                .remedy(format!("`rustup target add {}`, then look at the compiler's messages", board.target))
        };
        let output = Command::new("cargo")
            .args(["build", "--release", "--target", board.target, "--package", board.package])
            .args(["--message-format", "json-render-diagnostics"])
            .current_dir(root)
            .stderr(std::process::Stdio::inherit())
            .output()
            .map_err(|e| cargo(format!("cargo could not be started: {e}")))?;
        if !output.status.success() {
            return Err(cargo(format!("cargo ended with {}", output.status)));
        }
        executable(&String::from_utf8_lossy(&output.stdout), board.package)
            .ok_or_else(|| cargo("no image named by cargo".to_owned()))
    }

    /// The image among cargo's messages.
    fn executable(messages: &str, package: &str) -> Option<PathBuf> {
        messages
            .lines()
            .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
            .filter_map(|message| Some(PathBuf::from(message.get("executable")?.as_str()?)))
            .find(|path| path.file_name() == Path::new(package).file_name())
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn the_image_is_the_one_that_cargo_names() {
            let messages = "{\"reason\":\"x\"}\nno json\n{\"executable\":null}\n{\"executable\":\"/t/other\"}\n\
                {\"executable\":\"/t/whirl-board-nucleo-g474re\"}\n";
            assert_eq!(
                executable(messages, "whirl-board-nucleo-g474re"),
                Some(PathBuf::from("/t/whirl-board-nucleo-g474re"))
            );
            assert_eq!(executable("", "x"), None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused_with(board: &str, image: Option<PathBuf>) -> String {
        run(&Arguments { board: board.to_owned(), image, out: Output::default() }).unwrap_err().to_string()
    }

    fn refused(board: &str) -> String {
        refused_with(board, Some(PathBuf::from("/nowhere/image")))
    }

    #[test]
    fn boards_that_are_not_there_or_cannot_be_flashed_are_refused() {
        let unknown = refused("nucleo-g474");
        assert!(unknown.contains("nucleo-g474re") && unknown.contains("--board"), "{unknown}");
        assert!(refused("mps2-an386").contains("not flashed"));
        assert!(refused("virtual-rig").contains("not flashed"));
    }

    #[cfg(not(feature = "probe"))]
    #[test]
    fn without_the_probe_s_library_it_says_so() {
        let message = refused_with("nucleo-f446re", None);
        assert!(message.contains("--features probe") && message.contains("whirl-nucleo-f446re.bin"), "{message}");
        let message = refused_with("pico2", None);
        assert!(message.contains("copy whirl-pico2.uf2"), "{message}");
        // An image that is given, where the board's drive takes such.
        for (board, kind, named) in [
            ("nucleo-f446re", Kind::Bin(0x0800_0000), "copy /i onto"),
            ("nucleo-f446re", Kind::Elf, "copy whirl-nucleo-f446re.bin"),
            ("nucleo-f446re", Kind::Uf2, "copy whirl-nucleo-f446re.bin"),
            ("pico2", Kind::Uf2, "copy /i onto"),
            ("pico2", Kind::Bin(0x1000_0000), "copy whirl-pico2.uf2"),
        ] {
            let given = Some(("/i".into(), kind));
            let message = flash(boards::of(board).unwrap(), "", given, &Output::default()).unwrap_err().to_string();
            assert!(message.contains(named), "{message}");
        }
    }

    #[test]
    fn an_image_that_is_not_there_is_named() {
        let message = refused("nucleo-f446re");
        assert!(message.contains("/nowhere/image"), "{message}");
    }
}

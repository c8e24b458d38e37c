//! What the build scripts of all boards share: linker arguments and the build id. The program makes
//! files of their images.

pub mod image;

use std::env;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Folders and files of the repository that decide what an image does.
const SOURCES: [&str; 6] = [
    "Cargo.lock",
    "shared/Cargo.toml",
    "shared/src",
    "firmware/Cargo.toml",
    "firmware/src",
    "firmware/boards/lasting/src",
];

/// Sets `WHIRL_BUILD_ID` for the crate, and the linker's arguments where it is built for a device.
///
/// `own` are the board's own sources, by their paths in the repository; `scripts` the linker
/// scripts, in order.
///
/// # Errors
/// Sources that cannot be read.
pub fn board(own: &[&str], scripts: &[&str]) -> io::Result<()> {
    // The packages of boards lie two folders below the repository's root's `firmware`.
    let manifest = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let root = manifest.join("../../..");
    let mut paths = Vec::new();
    for source in SOURCES.iter().chain(own) {
        println!("cargo::rerun-if-changed={}", root.join(source).display());
        collect(&root, Path::new(source), &mut paths)?;
    }
    println!("cargo::rustc-env=WHIRL_BUILD_ID={:08x}", id(&root, paths)?);
    if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("none") {
        // Sections are not to start on pages: flash has none.
        println!("cargo::rustc-link-arg-bins=--nmagic");
        for script in scripts {
            println!("cargo::rustc-link-arg-bins=-T{script}");
        }
    }
    Ok(())
}

/// Writes a linker script and tells the linker where it is.
///
/// # Errors
/// The build's output folder cannot be written.
pub fn script(name: &str, text: &str) -> io::Result<()> {
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::write(out.join(name), text)?;
    println!("cargo::rustc-link-search={}", out.display());
    Ok(())
}

/// The files below a path, relative to the root. Tests do not decide what an image does.
fn collect(root: &Path, path: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    let whole = root.join(path);
    if whole.is_file() {
        found.push(path.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(&whole)? {
        let name = entry?.file_name();
        if !is_test(&name.to_string_lossy()) {
            collect(root, &path.join(name), found)?;
        }
    }
    Ok(())
}

fn is_test(name: &str) -> bool {
    name == "tests" || name == "testing.rs" || name.ends_with("tests.rs")
}

/// FNV-1a over names and contents, in the order of the names: the same sources have the same id on
/// every machine.
fn id(root: &Path, mut paths: Vec<PathBuf>) -> io::Result<u32> {
    paths.sort();
    let mut hash = 0x811c_9dc5_u32;
    for path in paths {
        let name = path.to_string_lossy().replace('\\', "/");
        let text = fs::read(root.join(&path))?;
        // Line ends may be changed by a check-out.
        for &byte in name.as_bytes().iter().chain(&[0]).chain(text.iter().filter(|&&b| b != b'\r')) {
            hash = (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        }
    }
    Ok(hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_id_follows_the_sources_and_nothing_else() {
        let root = env::temp_dir().join(format!("whirl-build-id-{}", std::process::id()));
        fs::create_dir_all(root.join("src/tests")).unwrap();
        let of = || {
            let mut paths = Vec::new();
            collect(&root, Path::new("src"), &mut paths).unwrap();
            id(&root, paths).unwrap()
        };
        fs::write(root.join("src/a.rs"), "a\n").unwrap();
        let first = of();
        fs::write(root.join("src/a.rs"), "a\r\n").unwrap();
        fs::write(root.join("src/tests/t.rs"), "t").unwrap();
        fs::write(root.join("src/more_tests.rs"), "t").unwrap();
        assert_eq!(of(), first);
        fs::write(root.join("src/a.rs"), "b\n").unwrap();
        assert_ne!(of(), first);
        fs::remove_dir_all(root).unwrap();
    }
}

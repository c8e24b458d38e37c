//! Linker arguments, memory layout and build id.

/// As much as the NUCLEO-F446RE has flash, less the settings' pages (`src/flash.rs`), and RAM, of
/// the machine's 4 MB each.
const MEMORY: &str =
    "MEMORY\n{\n  FLASH : ORIGIN = 0x00000000, LENGTH = 508K\n  RAM : ORIGIN = 0x20000000, LENGTH = 128K\n}\n";

fn main() -> std::io::Result<()> {
    whirl_board_build::script("memory.x", MEMORY)?;
    // The vector table is in the crate itself, no handler has a name of its own.
    whirl_board_build::script("device.x", "")?;
    whirl_board_build::board(&["firmware/boards/mps2-an386/src"], &["link.x"])
}

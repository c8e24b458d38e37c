//! The board, linker arguments and build id; the memory layout comes from embassy-stm32.

fn main() -> std::io::Result<()> {
    println!("cargo::rustc-check-cfg=cfg(chip, values(\"g474re\", \"f446re\"))");
    let package = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    if let Some(chip) = package.strip_prefix("whirl-board-nucleo-") {
        println!("cargo::rustc-cfg=chip=\"{chip}\"");
    }
    whirl_board_build::board(&["firmware/boards/nucleo"], &["link.x", "defmt.x"])
}

//! Linker arguments and build id; the memory layout comes from embassy-stm32.

fn main() -> std::io::Result<()> {
    whirl_board_build::board(&["firmware/boards/nucleo"], &["link.x", "defmt.x"])
}

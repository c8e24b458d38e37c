//! Linker arguments, memory layout and build id.

/// The board's 4 MB of flash less the settings' two sectors of 4 kB (`src/board.rs`), and the
/// chip's striped RAM. What tells the boot ROM that this is a program lies within the first 4 kB,
/// behind the vector table (RP2350 datasheet, 5.9.5).
const MEMORY: &str = "MEMORY
{
  FLASH : ORIGIN = 0x10000000, LENGTH = 4096K - 8K
  RAM : ORIGIN = 0x20000000, LENGTH = 512K
}
SECTIONS
{
  .start_block : ALIGN(4)
  {
    KEEP(*(.start_block));
  } > FLASH
} INSERT AFTER .vector_table;
_stext = ADDR(.start_block) + SIZEOF(.start_block);
";

fn main() -> std::io::Result<()> {
    whirl_board_build::script("memory.x", MEMORY)?;
    whirl_board_build::board(&["firmware/boards/pico2/src"], &["link.x", "defmt.x"])
}

//! Files that a board is flashed with: `.elf` as cargo builds them, `.bin` and `.uf2` as
//! `cargo run -p whirl-board-build` makes them. The content decides, not the name.
//!
//! What would leave a board without firmware is refused before the probe is asked for: a file that
//! is cut, is for another processor, or for another board.

use std::path::Path;

use crate::boards::{BOARDS, Board};
use crate::error::{BadInput, Result};
use crate::files;

/// Greatest file, bytes: an ELF with all that a debugger wants.
const LARGEST: u64 = 256 << 20;
/// Bytes of a UF2 block, and the words that begin and end it (microsoft/uf2).
const UF2_BLOCK: usize = 512;
const UF2_BEGINS: [u32; 2] = [0x0a32_4655, 0x9e5d_5157];
const UF2_ENDS: u32 = 0x0ab1_6f30;
/// Flag: the block names a family of chips.
const UF2_FAMILY: u32 = 0x2000;

/// A family of chips.
struct Chip {
    /// How its names begin.
    name: &'static str,
    /// Its number in UF2 (`utils/uf2families.json`).
    family: u32,
    /// Where its flash begins.
    flash: u32,
}

static CHIPS: [Chip; 3] = [
    Chip { name: "STM32G4", family: 0x4c71_240a, flash: 0x0800_0000 },
    Chip { name: "STM32F4", family: 0x5775_5a57, flash: 0x0800_0000 },
    // Its Arm cores in secure state.
    Chip { name: "RP235", family: 0xe48b_ff59, flash: 0x1000_0000 },
];
/// Memory of all of them begins here; none has more than that many bytes of it, or of flash.
const RAM: u32 = 0x2000_0000;
const RAM_MOST: u32 = 1 << 20;
const FLASH_MOST: u32 = 16 << 20;

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// ELF.
    Elf,
    /// UF2.
    Uf2,
    /// The flash's bytes, from this address on.
    Bin(u32),
}

/// Reads a file and sees that it may be flashed onto a board.
///
/// # Errors
/// No file, one that is cut or no image, one for another processor or board.
pub(super) fn of(path: &Path, board: &Board, chip: &str) -> Result<Kind> {
    let remedy =
        "Make images with `cargo run -p whirl-board-build -- images`, or leave --image out in whirl's repository";
    let mut file = files::open(path, "an image", remedy).map_err(|e| e.at("--image"))?;
    let length = file.metadata().map_or(0, |m| m.len());
    let bad =
        |found: String, expected: String| BadInput::new(found, expected).in_file(path).at("--image").remedy(remedy);
    if length > LARGEST {
        return Err(bad(format!("{length} bytes"), format!("an image of at most {LARGEST} bytes")));
    }
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut file, &mut bytes).map_err(|e| BadInput::io(path, &e))?;
    let chip = CHIPS.iter().find(|known| chip.starts_with(known.name));
    let kind = kind(&bytes, chip).map_err(|found| bad(found.to_owned(), format!("an image of {}", board.id)))?;
    if let Some(other) = of_another(&bytes, board, kind, chip) {
        return Err(bad(format!("an image of {other}"), format!("one of {}", board.id)));
    }
    Ok(kind)
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// What the bytes are; why they are no image.
fn kind(bytes: &[u8], chip: Option<&Chip>) -> core::result::Result<Kind, &'static str> {
    if bytes.is_empty() {
        return Err("an empty file");
    }
    if bytes.starts_with(b"\x7fELF") {
        // 32 bits, little-endian; machine 40 is ARM.
        let arm = bytes.get(4..6) == Some(&[1, 1]) && bytes.get(18..20) == Some(&[40, 0]);
        if !arm {
            return Err("an ELF file of another processor");
        }
        let end = || {
            let (offset, size) = (word(bytes, 28)?, word(bytes, 42)? & 0xffff);
            let number = word(bytes, 44)? & 0xffff;
            (offset as usize).checked_add((size as usize).checked_mul(number as usize)?)
        };
        return if end().is_some_and(|end| end <= bytes.len()) {
            Ok(Kind::Elf)
        } else {
            Err("an ELF file that is cut")
        };
    }
    if word(bytes, 0) == Some(UF2_BEGINS[0]) {
        let whole = |block: &[u8]| {
            [word(block, 0), word(block, 4), word(block, 508)]
                == [Some(UF2_BEGINS[0]), Some(UF2_BEGINS[1]), Some(UF2_ENDS)]
        };
        let blocks = word(bytes, 24).unwrap_or(0) as usize;
        let cut = !bytes.len().is_multiple_of(UF2_BLOCK)
            || bytes.len() / UF2_BLOCK < blocks
            || !bytes.chunks(UF2_BLOCK).all(whole);
        return if cut { Err("a UF2 file that is cut") } else { Ok(Kind::Uf2) };
    }
    // The flash's bytes begin with the initial stack pointer and the reset vector, whose lowest bit
    // says Thumb.
    let chip = chip.ok_or("a file that is neither ELF nor UF2")?;
    let starts = word(bytes, 0).zip(word(bytes, 4)).is_some_and(|(stack, reset)| {
        (RAM..=RAM + RAM_MOST).contains(&stack)
            && stack.is_multiple_of(4)
            && reset % 2 == 1
            && (chip.flash..chip.flash + FLASH_MOST).contains(&reset)
            && ((reset - chip.flash) as usize) < bytes.len()
    });
    if starts { Ok(Kind::Bin(chip.flash)) } else { Err("a file that is no image, or one that is cut") }
}

/// Another board that this image says it is for.
fn of_another(bytes: &[u8], board: &Board, kind: Kind, chip: Option<&Chip>) -> Option<String> {
    if kind == Kind::Uf2 && word(bytes, 8)? & UF2_FAMILY != 0 {
        let family = word(bytes, 28)?;
        if let Some(chip) = chip.filter(|chip| chip.family != family) {
            let known = CHIPS.iter().find(|known| known.family == family);
            let name = known.map_or_else(|| format!("UF2 family {family:08x}"), |known| format!("an {}", known.name));
            return Some(format!("{name}, not of an {}", chip.name));
        }
    }
    // The firmware's hello has the board's name.
    let names = |id: &str| bytes.windows(id.len()).any(|window| window == id.as_bytes());
    if kind == Kind::Uf2 || names(board.id) {
        return None;
    }
    BOARDS.iter().find(|other| other.chip.is_some() && names(other.id)).map(|other| other.id.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boards;

    fn outcome(bytes: &[u8], board: &str) -> core::result::Result<Kind, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image");
        std::fs::write(&path, bytes).unwrap();
        let board = boards::of(board).unwrap();
        of(&path, board, board.chip.unwrap()).map_err(|e| e.to_string())
    }

    fn bin(name: &str) -> Vec<u8> {
        let mut bytes = [0x2002_0000_u32, 0x0800_0009].map(u32::to_le_bytes).concat();
        bytes.extend_from_slice(name.as_bytes());
        bytes
    }

    fn uf2(family: u32, blocks: u32) -> Vec<u8> {
        let mut file = Vec::new();
        for number in 0..blocks {
            for word in [UF2_BEGINS[0], UF2_BEGINS[1], UF2_FAMILY, 0x0800_0000, 256, number, blocks, family] {
                file.extend(word.to_le_bytes());
            }
            file.extend([0; 476]);
            file.extend(UF2_ENDS.to_le_bytes());
        }
        file
    }

    fn elf(name: &str) -> Vec<u8> {
        let mut file = vec![0; 52];
        file[..6].copy_from_slice(b"\x7fELF\x01\x01");
        file[18] = 40;
        file[28] = 52;
        file[42] = 32;
        file[44] = 1;
        file.extend([0; 32]);
        file.extend_from_slice(name.as_bytes());
        file
    }

    #[test]
    fn the_content_tells_what_a_file_is() {
        assert_eq!(outcome(&elf("nucleo-g474re"), "nucleo-g474re"), Ok(Kind::Elf));
        assert_eq!(outcome(&uf2(0x4c71_240a, 2), "nucleo-g474re"), Ok(Kind::Uf2));
        assert_eq!(outcome(&bin("nucleo-f446re"), "nucleo-f446re"), Ok(Kind::Bin(0x0800_0000)));
        // An image of somebody's own, without a name.
        assert_eq!(outcome(&bin("mine"), "nucleo-f446re"), Ok(Kind::Bin(0x0800_0000)));
    }

    #[test]
    fn what_would_spoil_a_board_is_refused() {
        for (bytes, part) in [
            (bin("nucleo-f446re"), "found an image of nucleo-f446re, expected one of nucleo-g474re"),
            (elf("nucleo-f446re"), "found an image of nucleo-f446re"),
            (uf2(0x5775_5a57, 1), "an STM32F4, not of an STM32G4"),
            (uf2(0x1234_5678, 1), "UF2 family 12345678"),
            (Vec::new(), "an empty file"),
            (b"\x7fELF\x02\x01".to_vec(), "another processor"),
            (elf("")[..60].to_vec(), "an ELF file that is cut"),
            (uf2(0x4c71_240a, 3)[..1024].to_vec(), "a UF2 file that is cut"),
            (uf2(0x4c71_240a, 1)[..500].to_vec(), "a UF2 file that is cut"),
            (b"t,count1,count2\n0,1,2\n".to_vec(), "no image"),
            (bin("")[..7].to_vec(), "no image"),
        ] {
            let e = outcome(&bytes, "nucleo-g474re").unwrap_err();
            assert!(e.contains(part) && e.contains("--image"), "{part}: {e}");
        }
    }
}

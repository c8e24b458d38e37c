//! An image as a file that a board takes by drag and drop: `.bin` as the ST-LINK's drive wants it,
//! `.uf2` for bootloaders that show a drive of their own.
//!
//! The bytes are those of the ELF file's loadable segments at their load addresses (System V ABI,
//! 32 bits, little-endian); what lies between two segments is 0xFF, as in erased flash. UF2 is
//! Microsoft's format: blocks of 512 bytes with 256 of payload each, every block with its address,
//! number and the chip family's id.

use std::fmt;
use std::ops::Range;

/// What flash reads where nothing was written.
const ERASED: u8 = 0xff;
/// Payload of a UF2 block.
const PAYLOAD: usize = 256;
/// Most flash that a board here has, bytes: a file that spans more is no image.
const FLASH_MAX: u32 = 1 << 20;

/// Where RAM begins on every Cortex-M.
const MEMORY: u32 = 0x2000_0000;

/// What a chip takes for a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chip {
    /// Where its flash begins: the vector table.
    pub flash: u32,
    /// Most bytes that a program may take: what lies behind is the settings'.
    pub room: u32,
    /// RAM, bytes.
    pub memory: u32,
    /// Its boot ROM looks for a block ([`Image::has_boot_block`]).
    pub boot_block: bool,
}

/// An image: where it begins, and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Address of the first byte.
    pub address: u32,
    /// All bytes.
    pub bytes: Vec<u8>,
}

/// Why a file is no image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoImage(&'static str);

impl fmt::Display for NoImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no image of a board: {}", self.0)
    }
}

impl std::error::Error for NoImage {}

impl Image {
    /// The image in an ELF file.
    ///
    /// # Errors
    /// A file that is none of 32 bits for ARM, or is cut, or holds nothing to be flashed.
    pub fn of_elf(file: &[u8]) -> Result<Self, NoImage> {
        let cut = || NoImage("the file is cut");
        let half = |at: usize| Some(u16::from_le_bytes(file.get(at..at + 2)?.try_into().ok()?));
        let word = |at: usize| Some(u32::from_le_bytes(file.get(at..at + 4)?.try_into().ok()?));
        // Magic, 32 bits, little-endian; machine 40 is ARM.
        if file.get(..6) != Some(b"\x7fELF\x01\x01") || half(18) != Some(40) {
            return Err(NoImage("not an ELF file of 32 bits for ARM"));
        }
        let table = word(28).ok_or_else(cut)? as usize;
        let (size, number) = (half(42).ok_or_else(cut)?, half(44).ok_or_else(cut)?);
        let mut parts = Vec::new();
        for entry in (0..usize::from(number)).map(|i| table + i * usize::from(size)) {
            let field = |i: usize| word(entry + 4 * i).ok_or_else(cut);
            let (kind, offset, address, length) = (field(0)?, field(1)? as usize, field(3)?, field(4)? as usize);
            // Type 1 is loaded; what has no bytes in the file is memory.
            if kind == 1 && length > 0 {
                parts.push((address, file.get(offset..offset.saturating_add(length)).ok_or_else(cut)?));
            }
        }
        parts.sort_by_key(|&(address, _)| address);
        let address = parts.first().ok_or(NoImage("nothing in it is loaded"))?.0;
        let mut bytes = Vec::new();
        for (at, part) in parts {
            let from = at - address;
            if from > FLASH_MAX || part.len() > FLASH_MAX as usize || bytes.len() > from as usize {
                return Err(NoImage("its parts lie far from each other or over each other"));
            }
            bytes.resize(from as usize, ERASED);
            bytes.extend_from_slice(part);
        }
        Ok(Self { address, bytes })
    }

    /// Whether the boot ROM of an RP2350 takes it for a program: a block of its own that says so
    /// lies within the first 4 kB (datasheet, 5.9).
    #[must_use]
    pub fn has_boot_block(&self) -> bool {
        // The block's begin, then its first item: type of image, one word.
        let begin = [0xffff_ded3_u32.to_le_bytes(), [0x42, 0x01, 0x21, 0x10]].concat();
        self.bytes.iter().take(4_096).copied().collect::<Vec<_>>().windows(8).any(|window| window == begin)
    }

    /// Why a chip would not run it as it is meant to; none where nothing speaks against it.
    ///
    /// The vector table (ARMv7-M and ARMv8-M, B1.5.3): the stack's end in RAM, aligned to 8, then
    /// the handlers of the processor's own exceptions: code of this image, in Thumb state, or none.
    #[must_use]
    pub fn unfit(&self, chip: &Chip) -> Option<String> {
        let length = self.bytes.len();
        if self.address != chip.flash {
            return Some(format!("it begins at {:#010x}, and the flash at {:#010x}", self.address, chip.flash));
        }
        if length > chip.room as usize {
            return Some(format!("it takes {length} bytes, and there is room for {}", chip.room));
        }
        let table: Vec<u32> =
            self.bytes.chunks_exact(4).take(16).map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]])).collect();
        let [stack, reset, others @ ..] = &table[..] else { return Some("it is shorter than its vector table".into()) };
        if table.len() < 16 {
            return Some("it is shorter than its vector table".into());
        }
        if !(MEMORY + 1..=MEMORY + chip.memory).contains(stack) || !stack.is_multiple_of(8) {
            return Some(format!("its stack would begin at {stack:#010x}"));
        }
        let code: Range<u32> = chip.flash + 64..chip.flash + length as u32;
        let runs = |handler: &u32| handler % 2 == 1 && code.contains(handler);
        if !runs(reset) {
            return Some(format!("its reset handler would be at {reset:#010x}"));
        }
        // Numbers of exceptions: 2 on.
        if let Some((handler, number)) = others.iter().zip(2..).find(|&(handler, _)| *handler != 0 && !runs(handler)) {
            return Some(format!("its handler of exception {number} would be at {handler:#010x}"));
        }
        let block = !chip.boot_block || self.has_boot_block();
        (!block).then(|| "it has no block within its first 4 kB by which the boot ROM knows a program".to_owned())
    }

    /// As UF2, for a family of chips.
    #[must_use]
    pub fn to_uf2(&self, family: u32) -> Vec<u8> {
        let blocks = self.bytes.chunks(PAYLOAD);
        // An image of at most 1 MB has 4096 blocks.
        let (total, mut file) = (blocks.len() as u32, Vec::new());
        for ((number, block), address) in (0_u32..).zip(blocks).zip((self.address..).step_by(PAYLOAD)) {
            // Two magic words; flag: the family's id is in the place of the file's length.
            for word in [0x0a32_4655, 0x9e5d_5157, 0x2000, address, PAYLOAD as u32, number, total, family] {
                file.extend(word.to_le_bytes());
            }
            let mut data = [0; 476];
            data[..PAYLOAD].fill(ERASED);
            data[..block.len()].copy_from_slice(block);
            file.extend(data);
            file.extend(0x0ab1_6f30_u32.to_le_bytes());
        }
        file
    }
}

/// Whether an image holds messages of level info: without them a board that is well says nothing.
#[must_use]
pub fn has_messages(elf: &[u8]) -> bool {
    elf.windows(10).any(|window| window == b"defmt_info")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ELF file with segments of (type, address, bytes).
    fn elf(segments: &[(u32, u32, &[u8])]) -> Vec<u8> {
        let mut file = vec![0; 52 + 32 * segments.len()];
        file[..6].copy_from_slice(b"\x7fELF\x01\x01");
        file[18] = 40;
        file[28] = 52;
        file[42] = 32;
        file[44] = segments.len() as u8;
        for (i, (kind, address, bytes)) in segments.iter().enumerate() {
            let offset = file.len() as u32;
            for (k, word) in [*kind, offset, 0x2000_0000, *address, bytes.len() as u32].into_iter().enumerate() {
                file[52 + 32 * i + 4 * k..][..4].copy_from_slice(&word.to_le_bytes());
            }
            file.extend_from_slice(bytes);
        }
        file
    }

    #[test]
    fn segments_go_to_their_load_addresses_with_erased_flash_between() {
        let file = elf(&[(1, 0x0800_0004, &[4, 5]), (6, 0, &[9]), (1, 0x0800_0000, &[1, 2]), (1, 7, &[])]);
        let image = Image::of_elf(&file).unwrap();
        assert_eq!(image, Image { address: 0x0800_0000, bytes: vec![1, 2, 0xff, 0xff, 4, 5] });
    }

    #[test]
    fn what_is_no_image_is_refused() {
        let good = elf(&[(1, 0x0800_0000, &[1, 2, 3, 4])]);
        for length in 0..good.len() {
            assert!(Image::of_elf(&good[..length]).is_err(), "{length}");
        }
        for segments in
            [&[(1, 0, &[0_u8; 4][..]), (1, 2, &[0; 4])][..], &[(1, 0, &[0; 4]), (1, 0x2000_0000, &[0; 4])], &[]]
        {
            assert!(Image::of_elf(&elf(segments)).is_err());
        }
    }

    #[test]
    fn a_boot_block_is_looked_for_where_the_boot_rom_looks() {
        let block = [0xd3, 0xde, 0xff, 0xff, 0x42, 0x01, 0x21, 0x10];
        for (at, found) in [(0, true), (0x114, true), (4_088, true), (4_089, false), (5_000, false)] {
            let mut bytes = vec![0; 8_192];
            bytes[at..at + 8].copy_from_slice(&block);
            assert_eq!(Image { address: 0x1000_0000, bytes }.has_boot_block(), found, "{at}");
        }
        assert!(!Image { address: 0x1000_0000, bytes: vec![0; 3] }.has_boot_block());
    }

    #[test]
    fn a_chip_runs_what_begins_where_it_looks_and_nothing_else() {
        let chip = Chip { flash: 0x0800_0000, room: 1_024, memory: 0x2_0000, boot_block: false };
        let good = || {
            let mut table = vec![0x2002_0000_u32, 0x0800_0101, 0x0800_0103, 0x0800_0105];
            table.resize(16, 0);
            Image { address: chip.flash, bytes: table.iter().flat_map(|w| w.to_le_bytes()).chain([0; 500]).collect() }
        };
        let with = |place: usize, word: u32| {
            let mut image = good();
            image.bytes[4 * place..4 * place + 4].copy_from_slice(&word.to_le_bytes());
            image
        };
        assert_eq!(good().unfit(&chip), None);
        assert_eq!(with(15, 0x0800_0107).unfit(&chip), None);
        for (image, part) in [
            (Image { address: 0x0800_4000, ..good() }, "begins at 0x08004000"),
            (Image { bytes: [good().bytes, vec![0; 1_024]].concat(), ..good() }, "takes 1588 bytes"),
            (Image { bytes: good().bytes[..60].to_vec(), ..good() }, "shorter than"),
            (Image { bytes: vec![1], ..good() }, "shorter than"),
            (with(0, 0x2002_0008), "stack"),
            (with(0, 0x2000_0000), "stack"),
            (with(0, 0x2001_fffc), "stack"),
            (with(1, 0x0800_0100), "reset handler would be at 0x08000100"),
            (with(1, 0), "reset handler"),
            (with(1, 0x0800_0021), "reset handler"),
            (with(3, 0x0800_0301), "exception 3"),
            (with(15, 0x2000_0001), "exception 15"),
        ] {
            assert!(image.unfit(&chip).is_some_and(|why| why.contains(part)), "{part}: {:?}", image.unfit(&chip));
        }
        assert!(good().unfit(&Chip { boot_block: true, ..chip }).is_some_and(|why| why.contains("boot ROM")));
        let mut block = good();
        block.bytes[100..108].copy_from_slice(&[0xd3, 0xde, 0xff, 0xff, 0x42, 0x01, 0x21, 0x10]);
        assert_eq!(block.unfit(&Chip { boot_block: true, ..chip }), None);
    }

    #[test]
    fn messages_are_known_by_their_names() {
        assert!(has_messages(b"..\"tag\":\"defmt_info\".."));
        assert!(!has_messages(b"..\"tag\":\"defmt_error\"..") && !has_messages(b""));
    }

    #[test]
    fn a_uf2_has_every_byte_at_its_address() {
        let bytes: Vec<u8> = (0..600_u32).map(|i| (i % 251) as u8).collect();
        let file = Image { address: 0x0800_0000, bytes: bytes.clone() }.to_uf2(0x4c71_240a);
        assert_eq!(file.len(), 3 * 512);
        let mut back = Vec::new();
        for (number, block) in file.chunks(512).enumerate() {
            let word = |i: usize| u32::from_le_bytes(block[4 * i..4 * i + 4].try_into().unwrap());
            assert_eq!([word(0), word(1), word(127)], [0x0a32_4655, 0x9e5d_5157, 0x0ab1_6f30]);
            assert_eq!([word(3), word(5), word(6)], [0x0800_0000 + 256 * number as u32, number as u32, 3]);
            assert_eq!(word(7), 0x4c71_240a);
            back.extend_from_slice(&block[32..32 + 256]);
        }
        assert_eq!(back[..600], bytes);
        assert!(back[600..].iter().all(|&byte| byte == 0xff));
    }
}

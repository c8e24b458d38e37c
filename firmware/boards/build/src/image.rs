//! An image as a file that a board takes by drag and drop: `.bin` as the ST-LINK's drive wants it,
//! `.uf2` for bootloaders that show a drive of their own.
//!
//! The bytes are those of the ELF file's loadable segments at their load addresses (System V ABI,
//! 32 bits, little-endian); what lies between two segments is 0xFF, as in erased flash. UF2 is
//! Microsoft's format: blocks of 512 bytes with 256 of payload each, every block with its address,
//! number and the chip family's id.

use std::fmt;

/// What flash reads where nothing was written.
const ERASED: u8 = 0xff;
/// Payload of a UF2 block.
const PAYLOAD: usize = 256;
/// Most flash that a board here has, bytes: a file that spans more is no image.
const FLASH_MAX: u32 = 1 << 20;

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

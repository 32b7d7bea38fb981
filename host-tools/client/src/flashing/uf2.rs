//! UF2 files: firmware as a boot loader takes it that shows itself as a drive.
//!
//! The format is Microsoft's, <https://github.com/microsoft/uf2>: blocks of 512 bytes, each with a
//! page of 256 and the address that it goes to, so that the loader needs to know nothing of files.

use std::collections::BTreeMap;

use esm_toolkit::boards::Flash;
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Architecture, Endianness, Object};
use thiserror::Error;

/// Length of a block.
pub const BLOCK_BYTES: usize = 512;

/// What a block has of the flash.
pub const PAGE_BYTES: u32 = 256;

/// Room for the page in a block, with what other loaders use.
const DATA_BYTES: usize = 476;

const MAGIC_START: [u32; 2] = [0x0a32_4655, 0x9e5d_5157];
const MAGIC_END: u32 = 0x0ab1_6f30;

/// A block says which chips it is for.
const HAS_FAMILY: u32 = 0x2000;

/// A byte of flash that was erased.
const ERASED: u8 = 0xff;

/// Why an ELF file is no firmware for a board's flash.
#[derive(Debug, Error)]
pub enum ImageError {
    /// It cannot be read.
    #[error("it is no whole ELF file for a 32-bit processor ({0})")]
    NotElf(object::Error),
    /// It is for another processor.
    #[error("it was built for another processor than a Cortex-M")]
    OtherProcessor,
    /// It ends before its end.
    #[error("it is cut off before its end")]
    Cut,
    /// Something of it does not go into the flash.
    #[error(
        "{length} bytes of it go to {from:#010x}, where the board has no flash: that is {} KiB from {:#010x} on",
        flash.bytes >> 10,
        flash.origin
    )]
    OutsideFlash {
        /// Where they go.
        from: u32,
        /// How many.
        length: u32,
        /// The board's flash.
        flash: Flash,
    },
    /// Two parts of it want the same place.
    #[error("two parts of it go to {at:#010x}")]
    Overlap {
        /// The place.
        at: u32,
    },
    /// Nothing of it is where the board starts.
    #[error("it has nothing at {:#010x}, where the board starts", flash.origin)]
    NoStart {
        /// The board's flash.
        flash: Flash,
    },
}

/// What goes into a board's flash, by pages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    pages: BTreeMap<u32, [u8; PAGE_BYTES as usize]>,
}

impl Image {
    /// What is to be loaded of an ELF file, with all of it in the flash.
    ///
    /// # Errors
    /// [`ImageError`]
    pub fn of_elf(bytes: &[u8], flash: Flash) -> Result<Self, ImageError> {
        let elf = ElfFile32::<Endianness>::parse(bytes).map_err(ImageError::NotElf)?;
        if elf.architecture() != Architecture::Arm || !elf.is_little_endian() {
            return Err(ImageError::OtherProcessor);
        }
        let mut image = Image {
            pages: BTreeMap::new(),
        };
        let mut ends = BTreeMap::new();
        for segment in elf.elf_program_headers() {
            let (from, length) = (
                segment.p_paddr(elf.endian()),
                segment.p_filesz(elf.endian()),
            );
            if segment.p_type(elf.endian()) != object::elf::PT_LOAD || length == 0 {
                continue;
            }
            let data = segment.data(elf.endian(), bytes);
            let data = data.map_err(|()| ImageError::Cut)?;
            let end = u64::from(from) + u64::from(length);
            let flash_end = u64::from(flash.origin) + u64::from(flash.bytes);
            if from < flash.origin || end > flash_end {
                return Err(ImageError::OutsideFlash {
                    from,
                    length,
                    flash,
                });
            }
            if let Some(end_before) = ends.insert(from, end) {
                // Two begin at one place.
                ends.insert(from, end.max(end_before));
                return Err(ImageError::Overlap { at: from });
            }
            image.put(from, data);
        }
        let mut end_before = 0;
        for (from, end) in ends {
            if u64::from(from) < end_before {
                return Err(ImageError::Overlap { at: from });
            }
            end_before = end;
        }
        if !image.pages.contains_key(&page_of(flash.origin)) {
            return Err(ImageError::NoStart { flash });
        }
        image.fill_sectors(flash.erase_bytes);
        Ok(image)
    }

    /// Puts bytes into their pages. All have addresses of 32 bits.
    fn put(&mut self, from: u32, data: &[u8]) {
        for (at, byte) in (from..=u32::MAX).zip(data) {
            let page = self.page(page_of(at));
            page[(at % PAGE_BYTES) as usize] = *byte;
        }
    }

    fn page(&mut self, at: u32) -> &mut [u8; PAGE_BYTES as usize] {
        let erased = [ERASED; PAGE_BYTES as usize];
        self.pages.entry(at).or_insert(erased)
    }

    /// Gives each sector that something goes into all of its pages, up to the last page. A boot
    /// drive erases sectors by the numbers of blocks and not by their addresses: behind a gap
    /// within a sector, pages of the next one would be lost (`elf2uf2` of the Pico SDK does the
    /// same).
    fn fill_sectors(&mut self, sector_bytes: u32) {
        let Some(last) = self.pages.keys().next_back().copied() else {
            return;
        };
        let sector_bytes = sector_bytes.max(PAGE_BYTES);
        let sectors: Vec<u32> = self.pages.keys().map(|at| at - at % sector_bytes).collect();
        for sector in sectors {
            let end = sector.saturating_add(sector_bytes - 1).min(last);
            for page in (sector..=end).step_by(PAGE_BYTES as usize) {
                self.page(page);
            }
        }
    }

    /// How many blocks its UF2 file has.
    pub fn blocks(&self) -> usize {
        self.pages.len()
    }

    /// The UF2 file for chips of this family.
    pub fn to_uf2(&self, family: u32) -> Vec<u8> {
        let mut file = Vec::with_capacity(self.pages.len() * BLOCK_BYTES);
        // A flash of 32 address bits has fewer pages than that.
        let count = u32::try_from(self.pages.len()).unwrap_or(u32::MAX);
        for (number, (&at, page)) in (0_u32..).zip(&self.pages) {
            let [first, second] = MAGIC_START;
            let header = [
                first, second, HAS_FAMILY, at, PAGE_BYTES, number, count, family,
            ];
            file.extend(header.iter().flat_map(|word| word.to_le_bytes()));
            file.extend(page);
            file.extend([0; DATA_BYTES - PAGE_BYTES as usize]);
            file.extend(MAGIC_END.to_le_bytes());
        }
        file
    }
}

/// The page of an address.
fn page_of(at: u32) -> u32 {
    at - at % PAGE_BYTES
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::elf;

    const RP2040: u32 = 0xe48b_ff56;
    const ARM: u16 = 40;
    const RISC_V: u16 = 243;

    const FLASH: Flash = Flash {
        origin: 0x1000_0000,
        bytes: 2 << 20,
        erase_bytes: 4096,
    };

    /// Reads a UF2 file as a boot loader does: what it would write, by addresses.
    fn read(file: &[u8], family: u32) -> BTreeMap<u32, [u8; 256]> {
        assert_eq!(file.len() % BLOCK_BYTES, 0);
        let count = file.len() / BLOCK_BYTES;
        let mut pages = BTreeMap::new();
        for (number, block) in file.chunks(BLOCK_BYTES).enumerate() {
            let word = |at: usize| u32::from_le_bytes(block[at..at + 4].try_into().unwrap());
            assert_eq!(&block[..8], b"UF2\nWQ\x5d\x9e");
            assert_eq!(word(8), 0x2000, "its family is told, and nothing else");
            assert_eq!(
                [word(16), word(20), word(24)],
                [256, number as u32, count as u32]
            );
            assert_eq!(word(28), family);
            assert_eq!(word(12) % 256, 0, "a page begins where the flash has one");
            assert!(block[32 + 256..508].iter().all(|byte| *byte == 0));
            assert_eq!(&block[508..], [0x30, 0x6f, 0xb1, 0x0a]);
            let page: [u8; 256] = block[32..288].try_into().unwrap();
            assert!(pages.insert(word(12), page).is_none());
        }
        pages
    }

    #[test]
    fn what_goes_in_comes_out_at_its_address() {
        let boot: Vec<u8> = (0..=255).collect();
        let code: Vec<u8> = (0..5_000_u32).map(|it| (it * 7 % 251) as u8).collect();
        let segments = [
            (0x1000_0000, &boot[..]),
            (0x1000_0100, &code[..]),
            // In the page where the one before ends, and far behind it.
            (0x1000_0100 + 5_001, &boot[..3]),
            (0x1010_0123, &code[..700]),
        ];
        let image = Image::of_elf(&elf(ARM, &segments), FLASH).unwrap();
        let file = image.to_uf2(RP2040);
        let pages = read(&file, RP2040);
        assert_eq!(pages.len(), image.blocks());
        let byte = |at: u32| {
            pages
                .get(&(at - at % 256))
                .map(|page| page[(at % 256) as usize])
        };
        for (from, data) in segments {
            for (at, expected) in (from..).zip(data) {
                assert_eq!(byte(at), Some(*expected), "{at:#x}");
            }
        }
        assert_eq!(
            byte(0x1000_0100 + 5_000),
            Some(0xff),
            "between two segments"
        );
        // All blocks of a sector are there, so that numbers and addresses of blocks go together.
        let addresses: Vec<u32> = pages.keys().copied().collect();
        assert_eq!(
            addresses[..32],
            *(0..32).map(|it| 0x1000_0000 + it * 256).collect::<Vec<_>>()
        );
        assert_eq!(
            addresses[32], 0x1010_0000,
            "the next sector begins with its first page"
        );
        assert_eq!(
            addresses.last(),
            Some(&0x1010_0300),
            "and ends with the last page"
        );
    }

    #[test]
    fn an_elf_that_the_flash_cannot_take_is_refused() {
        let page = [1; 256];
        let end = FLASH.origin + FLASH.bytes;
        let start = (FLASH.origin, &page[..]);
        let said = |bytes: &[u8]| Image::of_elf(bytes, FLASH).unwrap_err().to_string();
        for (what, bytes, why) in [
            ("empty", vec![], "no whole ELF"),
            ("RISC-V", elf(RISC_V, &[start]), "another processor"),
            (
                "below",
                elf(ARM, &[start, (0x0800_0000, &page)]),
                "0x08000000",
            ),
            (
                "in RAM",
                elf(ARM, &[start, (0x2000_0000, &page)]),
                "no flash",
            ),
            (
                "too long",
                elf(ARM, &[start, (end - 255, &page)]),
                "no flash",
            ),
            (
                "at the last address",
                elf(ARM, &[start, (u32::MAX, &page)]),
                "no flash",
            ),
            ("twice", elf(ARM, &[start, start]), "two parts"),
            (
                "across",
                elf(ARM, &[start, (FLASH.origin + 255, &page)]),
                "two parts",
            ),
            (
                "without a start",
                elf(ARM, &[(FLASH.origin + 256, &page)]),
                "where the board starts",
            ),
            ("nothing", elf(ARM, &[]), "where the board starts"),
        ] {
            let said = said(&bytes);
            assert!(said.contains(why), "{what}: {said}");
        }
        let whole = elf(ARM, &[start]);
        assert!(said(&whole[..whole.len() - 1]).contains("cut off"));
        // Up to the last byte it may go.
        assert!(Image::of_elf(&elf(ARM, &[start, (end - 256, &page)]), FLASH).is_ok());
    }
}

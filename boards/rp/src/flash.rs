//! The flash that missions are kept in: the last sectors of the chip's own.
//!
//! Erasing and writing is done by functions in the boot ROM. Meanwhile nothing can be read from the
//! flash, and nothing needs it: code and data are in RAM (`rp.x`), so that slots interrupt an
//! operation like any other work of the link.

use crate::hal::rom_data;
use cortex_m_board::on_chip_flash::{Cells, OnChip};
use cortex_m_board::store::{self, FlashTimes};
use embedded_storage::nor_flash::NorFlashErrorKind;
use rt_firmware::store::flash_store::{self, FlashStore};

/// What is erased at once.
const SECTOR_BYTES: u32 = 4_096;
/// What the boot ROM writes at once.
const PAGE_BYTES: usize = 256;
/// What the store writes at once. The rest of the page is written as ones, which leave a bit as it
/// is.
const WRITE_BYTES: usize = 32;

/// What the linker script of a board leaves for the store.
const RESERVED_BYTES: u32 = 64 << 10;

/// Where the flash is read.
const READ_AT: u32 = 0x1000_0000;

/// Milliseconds that it takes at most to keep a mission of so many bytes that is signed.
///
/// The data sheets of the W25Q16JV (Pico) and the W25Q32RV (Pico 2) give 400 ms for a sector and
/// 3 ms for a page at most, 45 ms and 0.4 ms as a rule.
pub const fn longest_ms(blob_bytes: usize) -> u16 {
    let times = FlashTimes {
        erase_bytes: SECTOR_BYTES,
        erase_us: 400_000,
        write_bytes: WRITE_BYTES as u32,
        write_us: 3_000,
    };
    times.longest_ms(blob_bytes as u32)
}

/// The flash of a board, of so many bytes, and what is kept in it: missions of so many.
pub type BoardStore<const FLASH_BYTES: u32, const BLOB_BYTES: usize> =
    FlashStore<'static, OnChip<Sectors<FLASH_BYTES, BLOB_BYTES>>>;
/// The memory of what the board keeps.
pub type StoreMemory<const FLASH_BYTES: u32, const BLOB_BYTES: usize> =
    store::StoreMemory<OnChip<Sectors<FLASH_BYTES, BLOB_BYTES>>>;

/// Opens what is kept in the flash.
pub fn open<const FLASH_BYTES: u32, const BLOB_BYTES: usize>(
    memory: &'static mut StoreMemory<FLASH_BYTES, BLOB_BYTES>,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore<FLASH_BYTES, BLOB_BYTES>> {
    memory.open(OnChip::new(), BLOB_BYTES as u32, default_mission)
}

/// The sectors of the store: the last of the flash.
#[derive(Debug)]
pub struct Sectors<const FLASH_BYTES: u32, const BLOB_BYTES: usize>;

impl<const FLASH_BYTES: u32, const BLOB_BYTES: usize> Sectors<FLASH_BYTES, BLOB_BYTES> {
    /// Where the store begins, in the flash.
    const START: u32 = FLASH_BYTES - RESERVED_BYTES;
}

/// Does something to the flash, which cannot be read meanwhile. Not inlined: what makes the robot
/// lies in flash, and may call this.
#[inline(never)]
fn change(act: impl FnOnce()) {
    // SAFETY: nothing is read from the flash between the first and the last of these: code,
    // constants and vectors are in RAM, and the store, which alone reads it, is waiting here.
    unsafe {
        rom_data::connect_internal_flash();
        rom_data::flash_exit_xip();
        act();
        rom_data::flash_flush_cache();
        rom_data::flash_enter_cmd_xip();
    }
}

impl<const FLASH_BYTES: u32, const BLOB_BYTES: usize> Cells for Sectors<FLASH_BYTES, BLOB_BYTES> {
    const READ_AT: u32 = READ_AT + Self::START;
    const BYTES: u32 = {
        let bytes = flash_store::flash_bytes_with_script(BLOB_BYTES as u32, SECTOR_BYTES);
        assert!(bytes <= RESERVED_BYTES);
        bytes
    };
    const ERASE_BYTES: usize = SECTOR_BYTES as usize;
    const WRITE_BYTES: usize = WRITE_BYTES;

    fn erase(offset: u32) -> Result<(), NorFlashErrorKind> {
        /// The flash's command for a sector of 4 KiB. Larger blocks have others, which are faster,
        /// and no slot waits for either.
        const ERASE_SECTOR: u8 = 0x20;
        change(|| {
            // SAFETY: a sector of the store, between connecting the flash and reading it again.
            unsafe {
                rom_data::flash_range_erase(
                    Self::START + offset,
                    SECTOR_BYTES as usize,
                    SECTOR_BYTES,
                    ERASE_SECTOR,
                );
            }
        });
        Ok(())
    }

    fn write(offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let mut at = offset;
        let mut rest = bytes;
        while !rest.is_empty() {
            let in_page = at as usize % PAGE_BYTES;
            let (part, behind) = rest.split_at(rest.len().min(PAGE_BYTES - in_page));
            let mut page = [0xFF; PAGE_BYTES];
            if let Some(place) = page.get_mut(in_page..in_page + part.len()) {
                place.copy_from_slice(part);
            }
            change(|| {
                // SAFETY: a page of the store, from RAM, between connecting the flash and reading
                // it again.
                unsafe {
                    rom_data::flash_range_program(
                        Self::START + at - in_page as u32,
                        page.as_ptr(),
                        PAGE_BYTES,
                    );
                }
            });
            at += part.len() as u32;
            rest = behind;
        }
        Ok(())
    }
}

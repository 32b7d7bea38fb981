//! The flash that missions are kept in: the last sectors of the chip's own.
//!
//! Erasing and writing is done by functions in the boot ROM. Meanwhile nothing can be read from the
//! flash, and nothing needs it: code and data are in RAM (`pico.x`), so that slots interrupt an
//! operation like any other work of the link.

use cortex_m_board::on_chip_flash::{Cells, OnChip};
use cortex_m_board::store::{self, FlashTimes};
use embedded_storage::nor_flash::NorFlashErrorKind;
use rp2040_hal::rom_data;
use rt_firmware::store::flash_store::{self, FlashStore};

use crate::settings;

/// What is erased at once.
const SECTOR_BYTES: u32 = 4_096;
/// What the boot ROM writes at once.
const PAGE_BYTES: usize = 256;
/// What the store writes at once. The rest of the page is written as ones, which leave a bit as it
/// is.
const WRITE_BYTES: usize = 32;

/// Bytes of the store.
pub const BYTES: u32 = flash_store::flash_bytes(settings::BLOB_BYTES as u32, SECTOR_BYTES);
/// Bytes of a Pico's flash.
const FLASH_BYTES: u32 = 2 << 20;
/// What `pico.x` leaves for the store.
const RESERVED_BYTES: u32 = 64 << 10;
/// Where the store begins, in the flash.
const START: u32 = FLASH_BYTES - RESERVED_BYTES;
const _: () = assert!(BYTES <= RESERVED_BYTES);

/// Where the flash is read.
const READ_AT: u32 = 0x1000_0000;

/// Milliseconds that it takes at most to keep a mission that is signed.
///
/// The data sheet of the W25Q16JV gives 400 ms for a sector and 3 ms for a page at most, 45 ms and
/// 0.4 ms as a rule.
pub const LONGEST_MS: u16 = FlashTimes {
    erase_bytes: SECTOR_BYTES,
    erase_us: 400_000,
    write_bytes: WRITE_BYTES as u32,
    write_us: 3_000,
}
.longest_ms(settings::BLOB_BYTES as u32);

/// The flash, and what is kept in it.
pub type BoardStore = FlashStore<'static, OnChip<Sectors>>;
/// The memory of what the board keeps.
pub type StoreMemory = store::StoreMemory<OnChip<Sectors>>;

/// Opens what is kept in the flash.
pub fn open(
    memory: &'static mut StoreMemory,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore> {
    memory.open(OnChip::new(), settings::BLOB_BYTES as u32, default_mission)
}

/// The sectors of the store.
#[derive(Debug)]
pub struct Sectors;

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

impl Cells for Sectors {
    const READ_AT: u32 = READ_AT + START;
    const BYTES: u32 = BYTES;
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
                    START + offset,
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
                        START + at - in_page as u32,
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

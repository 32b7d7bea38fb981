//! The flash that missions are kept in: [`sectors`](super::sectors) of the chip's own.
//!
//! While the chip erases or writes, nothing can be read from its flash: a processor that runs from
//! it stands still, for up to 2 s with an erase. So nothing is erased or written as long as a motor
//! has power: the operation fails, and the store says that the flash did not take it. A robot that
//! stands is deaf meanwhile, its clock may stand still for rounds of SysTick, and the watchdog is
//! fed by a function in RAM.

use cortex_m_board::on_chip_flash::OnChip;
use cortex_m_board::store::{self, FlashTimes};
use rt_firmware::store::flash_store::{self, FlashStore};

use super::sectors::{BYTES, SECTOR_BYTES, Sectors, WORD_BYTES};
use crate::settings::BLOB_BYTES;

const _: () = assert!(flash_store::flash_bytes(BLOB_BYTES as u32, SECTOR_BYTES) <= BYTES);

/// Milliseconds that it takes at most to keep a mission that is signed. The data sheet gives 2 s
/// for a sector and 100 µs for a word at most, 1 s and 16 µs as a rule (tables 40 and 41).
pub const LONGEST_MS: u16 = FlashTimes {
    erase_bytes: SECTOR_BYTES,
    erase_us: 2_000_000,
    write_bytes: WORD_BYTES as u32,
    write_us: 100,
}
.longest_ms(BLOB_BYTES as u32);

/// The flash, and what is kept in it.
pub type BoardStore = FlashStore<'static, OnChip<Sectors>>;
/// The memory of what the board keeps.
pub type StoreMemory = store::StoreMemory<OnChip<Sectors>>;

/// Opens what is kept in the flash.
pub fn open(
    memory: &'static mut StoreMemory,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore> {
    memory.open(OnChip::new(), BLOB_BYTES as u32, default_mission)
}

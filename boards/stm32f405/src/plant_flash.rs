//! The flash that missions are kept in, in the emulator: the plant's
//! ([`cortex_m_board::plant_flash`]).

use cortex_m_board::plant_flash;

use crate::Stm32f405;
use crate::settings::BLOB_BYTES;

/// Milliseconds that it takes at most to keep a mission that is signed.
pub const LONGEST_MS: u16 = plant_flash::longest_ms(BLOB_BYTES);

/// The flash, and what is kept in it.
pub type BoardStore = plant_flash::BoardStore<Stm32f405>;
/// The memory of what the board keeps.
pub type StoreMemory = plant_flash::StoreMemory<Stm32f405>;

/// Opens what is kept in the flash.
pub fn open(
    memory: &'static mut StoreMemory,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore> {
    plant_flash::open(memory, BLOB_BYTES, default_mission)
}

//! The flash that missions are kept in: the plant's ([`cortex_m_board::plant_flash`]).

use cortex_m_board::plant_flash;

use crate::Lm3s6965;
use crate::settings::BLOB_BYTES;

/// Milliseconds that it takes at most to keep a mission that is signed.
pub const LONGEST_MS: u16 = plant_flash::longest_ms(BLOB_BYTES);

/// The flash, and what is kept in it.
pub type BoardStore = plant_flash::BoardStore<Lm3s6965>;
/// The memory of what the board keeps.
pub type StoreMemory = plant_flash::StoreMemory<Lm3s6965>;

/// Opens what is kept in the flash.
pub fn open(
    memory: &'static mut StoreMemory,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore> {
    plant_flash::open(memory, BLOB_BYTES, default_mission)
}

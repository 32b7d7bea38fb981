//! The board as the real-time side sees it.

use cortex_m_board::chip::Chip;

use crate::{Stm32f405, clock, watchdog};

/// Time, body and pins for the slot timer's handler.
#[cfg(feature = "emulation")]
pub type SlotBoard = cortex_m_board::plant_board::PlantBoard<Stm32f405>;

#[cfg(not(feature = "emulation"))]
pub use crate::silicon::SlotBoard;

impl Chip for Stm32f405 {
    const TICKS_PER_US: u32 = clock::TICKS_PER_US;

    fn feed_watchdog() {
        watchdog::feed();
    }
}

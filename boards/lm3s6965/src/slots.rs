//! The board as the real-time side sees it.

use cortex_m_board::chip::Chip;
use cortex_m_board::plant_board::PlantBoard;

use crate::{Lm3s6965, clock, watchdog};

/// Time, body and pins for the slot timer's handler.
pub type SlotBoard = PlantBoard<Lm3s6965>;

impl Chip for Lm3s6965 {
    const TICKS_PER_US: u32 = clock::TICKS_PER_US;

    fn feed_watchdog() {
        watchdog::feed();
    }
}
